//! A solver as it is stored, for those who save a controller and go on with it later.
//!
//! Stored are the last problem's matrices, the active set and the factor that follows it, whose bits depend on the way there. All
//! tables that follow from the matrices are made anew, so that the next solves give the bits of a solver that was never stored.

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::active::SavedSet;
use crate::problem::Problem;
use crate::solver::Solver;

#[derive(Serialize, Deserialize)]
#[serde(bound(serialize = "Problem<NX, NS>: Serialize", deserialize = "Problem<NX, NS>: Deserialize<'de>"))]
pub(crate) struct Saved<const NX: usize, const NS: usize> {
    pub(crate) inputs: Vec<f64>,
    pub(crate) problem: Option<Problem<NX, NS>>,
    pub(crate) active: SavedSet,
}

impl<const NX: usize, const NS: usize> Serialize for Solver<NX, NS>
where
    Problem<NX, NS>: Serialize,
{
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.to_saved().serialize(serializer)
    }
}

impl<'de, const NX: usize, const NS: usize> Deserialize<'de> for Solver<NX, NS>
where
    Problem<NX, NS>: Deserialize<'de>,
{
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let solver = Self::restored(Saved::deserialize(deserializer)?);
        solver.ok_or_else(|| D::Error::custom("the parts of a stored solver do not fit each other"))
    }
}

#[cfg(test)]
mod tests {
    use super::Solver;
    use crate::problem::Problem;
    use crate::verdict::Start;

    /// A double integrator on its way to a target that jumps, between bounds that hold it back.
    fn problem(k: u32) -> Problem<2, 1> {
        let mut problem = Problem::new(12);
        problem.initial_state = [0.1 * f64::from(k), 1.0];
        (problem.input_min, problem.input_max) = (-0.5, 0.5);
        for stage in &mut problem.stages {
            stage.a = [[1.0, 0.2], [0.0, 1.0]];
            (stage.b, stage.state_weight) = ([0.02, 0.2], [1.0, 0.1]);
            stage.state_reference = [if k % 7 < 4 { 3.0 } else { -3.0 }, 0.0];
            // The rows change now and then, and with them all that follows from them.
            (stage.rows[0].state, stage.rows[0].input) = ([0.0, 1.0], 0.1 + 0.1 * f64::from(k / 10));
            (stage.rows[0].lower, stage.rows[0].upper) = (-1.2, 0.6);
        }
        problem
    }

    #[test]
    fn a_stored_solver_goes_on_bit_for_bit() {
        let mut solver = Solver::<2, 1>::new(12);
        let mut again: Option<Solver<2, 1>> = None;
        let mut held = 0;
        for k in 0..60 {
            let start = Start::Shifted(usize::from(k % 3 == 0));
            let verdict = solver.solve(&problem(k), start);
            if let Some(mut again) = again {
                assert_eq!(again.solve(&problem(k), start), verdict, "step {k}");
                assert_eq!(again.inputs(), solver.inputs(), "step {k}");
                assert_eq!(again.feedback(), solver.feedback(), "step {k}");
            }
            held += solver.active_rows().count();
            again = Some(Solver::restored(solver.to_saved()).expect("its own parts fit"));
        }
        assert!(held > 60, "the bounds hold too little back");
    }

    #[test]
    fn parts_of_different_solvers_do_not_fit() {
        let mut solver = Solver::<2, 1>::new(12);
        let _ = solver.solve(&problem(0), Start::Cold);
        let mut saved = solver.to_saved();
        saved.inputs.truncate(3);
        assert!(Solver::restored(saved).is_none());
    }
}
