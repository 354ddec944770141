//! The responses of constraints, kept as long as the matrices they follow from.

use crate::linalg::{Vector, same_bits};
use crate::problem::Problem;
use crate::riccati::Riccati;

/// Place of a constraint: its stage, and the index of the row, or NS for the bounds of the input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    pub(crate) stage: usize,
    pub(crate) index: usize,
}

#[derive(Clone, Debug)]
struct Known<const NX: usize> {
    valid: bool,
    state: Vector<NX>,
    input: f64,
    /// Slope of the constraint's value in `x_0`, under the unconstrained feedback.
    initial_slope: Vector<NX>,
}

/// Responses z of all constraints (docs/qp.md, Eq. 7), computed when first asked for.
#[derive(Clone, Debug)]
pub(crate) struct Responses<const NX: usize> {
    horizon: usize,
    per_stage: usize,
    /// One line of N numbers for each constraint, of which stage k uses the first k + 1.
    values: Vec<f64>,
    known: Vec<Known<NX>>,
}

impl<const NX: usize> Responses<NX> {
    pub(crate) fn new(horizon: usize, per_stage: usize) -> Self {
        let unknown = Known { valid: false, state: [0.0; NX], input: 0.0, initial_slope: [0.0; NX] };
        Self {
            horizon,
            per_stage,
            values: vec![0.0; horizon * horizon * per_stage],
            known: vec![unknown; horizon * per_stage],
        }
    }

    pub(crate) fn forget(&mut self) {
        for known in &mut self.known {
            known.valid = false;
        }
    }

    /// Number of `place` among all constraints.
    pub(crate) fn id(&self, place: Place) -> usize {
        place.stage * self.per_stage + place.index
    }

    /// Makes sure that the response of `place` is the one of `problem`.
    pub(crate) fn learn<const NS: usize>(&mut self, riccati: &Riccati<NX>, problem: &Problem<NX, NS>, place: Place) {
        let id = self.id(place);
        let none = [0.0; NX];
        let (state, input) =
            problem.stages[place.stage].rows.get(place.index).map_or((&none, 1.0), |row| (&row.state, row.input));
        let known = &mut self.known[id];
        if known.valid && same_bits(&known.state, state) && known.input.to_bits() == input.to_bits() {
            return;
        }
        let start = id * self.horizon;
        let out = &mut self.values[start..=start + place.stage];
        let initial_slope = riccati.respond(problem, (state, input), out);
        *known = Known { valid: true, state: *state, input, initial_slope };
    }

    /// z of `place`: one number for each input up to its stage.
    pub(crate) fn response(&self, place: Place) -> &[f64] {
        let start = self.id(place) * self.horizon;
        &self.values[start..=start + place.stage]
    }

    /// Slope of the value of `place` in `x_0`.
    pub(crate) fn initial_slope(&self, place: Place) -> &Vector<NX> {
        &self.known[self.id(place)].initial_slope
    }
}
