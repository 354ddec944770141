//! Invalid input is named, computes nothing, and leaves no trace.

use crate::common::{MILD, Random, random_problem};
use lanecraft_qp::{Field, InvalidInput, Problem, Solver, Start, Status};

type Poison = Box<dyn Fn(&mut Problem<3, 2>, f64)>;

const STAGE: usize = 4;

/// Every number of a problem, with its name.
fn fields() -> Vec<(Field, usize, Poison)> {
    let mut fields: Vec<(Field, usize, Poison)> = vec![
        (Field::InputBounds, 0, Box::new(|p, v| p.input_min = v)),
        (Field::InputBounds, 0, Box::new(|p, v| p.input_max = v)),
        (Field::InputWeight, STAGE, Box::new(|p, v| p.stages[STAGE].input_weight = v)),
        (Field::InputReference, STAGE, Box::new(|p, v| p.stages[STAGE].input_reference = v)),
    ];
    for i in 0..3 {
        fields.push((Field::InitialState, 0, Box::new(move |p, v| p.initial_state[i] = v)));
        fields.push((Field::B, STAGE, Box::new(move |p, v| p.stages[STAGE].b[i] = v)));
        fields.push((Field::C, STAGE, Box::new(move |p, v| p.stages[STAGE].c[i] = v)));
        fields.push((Field::StateWeight, STAGE, Box::new(move |p, v| p.stages[STAGE].state_weight[i] = v)));
        fields.push((Field::StateReference, STAGE, Box::new(move |p, v| p.stages[STAGE].state_reference[i] = v)));
        for j in 0..3 {
            fields.push((Field::A, STAGE, Box::new(move |p, v| p.stages[STAGE].a[i][j] = v)));
        }
    }
    for i in 0..2 {
        fields.push((Field::RowInput(i), STAGE, Box::new(move |p, v| p.stages[STAGE].rows[i].input = v)));
        fields.push((Field::RowBounds(i), STAGE, Box::new(move |p, v| p.stages[STAGE].rows[i].lower = v)));
        fields.push((Field::RowBounds(i), STAGE, Box::new(move |p, v| p.stages[STAGE].rows[i].upper = v)));
        fields.push((Field::RowL1Weight(i), STAGE, Box::new(move |p, v| p.stages[STAGE].rows[i].l1_weight = v)));
        fields.push((Field::RowL2Weight(i), STAGE, Box::new(move |p, v| p.stages[STAGE].rows[i].l2_weight = v)));
        for j in 0..3 {
            fields.push((Field::RowState(i), STAGE, Box::new(move |p, v| p.stages[STAGE].rows[i].state[j] = v)));
        }
    }
    fields
}

fn is_bound(field: Field) -> bool {
    matches!(field, Field::InputBounds | Field::RowBounds(_))
}

#[test]
fn nan_in_any_single_field_is_named_and_leaves_the_solver_as_new() {
    let good = random_problem::<3, 2>(&mut Random(31), 9, MILD);
    let mut fresh = Solver::new(9);
    let expected = fresh.solve(&good, Start::Shifted(1));
    assert_eq!(expected.status, Status::Solved);
    let mut solver = Solver::new(9);
    for (field, stage, poison) in fields() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            if is_bound(field) && value.is_infinite() {
                continue;
            }
            let _ = solver.solve(&good, Start::Shifted(1));
            let mut bad = good.clone();
            poison(&mut bad, value);
            let Status::InvalidInput(error) = solver.solve(&bad, Start::Shifted(1)).status else {
                panic!("{field:?} = {value} was accepted");
            };
            match error {
                InvalidInput::NotFinite { field: f, stage: k }
                | InvalidInput::IllOrdered { field: f, stage: k, .. } => {
                    assert_eq!((f, k), (field, stage));
                }
                _ => panic!("{field:?} = {value} was called {error}"),
            }
            assert!(solver.inputs().iter().all(|u| *u == 0.0) && solver.active_rows().next().is_none());
            assert_eq!(solver.solve(&good, Start::Shifted(1)), expected);
            assert_eq!(solver.inputs(), fresh.inputs());
            assert_eq!(solver.states(), fresh.states());
        }
    }
}

#[test]
fn numbers_out_of_range_are_named() {
    let good = random_problem::<3, 2>(&mut Random(32), 9, MILD);
    let refusal = |change: &dyn Fn(&mut Problem<3, 2>)| {
        let mut bad = good.clone();
        change(&mut bad);
        match Solver::new(9).solve(&bad, Start::Cold).status {
            Status::InvalidInput(error) => error,
            status => panic!("{status:?}"),
        }
    };
    assert_eq!(
        refusal(&|p| p.stages[2].input_weight = 0.0),
        InvalidInput::NotPositive { field: Field::InputWeight, stage: 2, value: 0.0 }
    );
    assert_eq!(
        refusal(&|p| p.stages[3].state_weight[1] = -1.0),
        InvalidInput::NotPositive { field: Field::StateWeight, stage: 3, value: -1.0 }
    );
    assert_eq!(
        refusal(&|p| p.stages[8].rows[1].l1_weight = -2.0),
        InvalidInput::NotPositive { field: Field::RowL1Weight(1), stage: 8, value: -2.0 }
    );
    assert_eq!(
        refusal(&|p| p.stages[8].rows[0].l2_weight = 0.0),
        InvalidInput::NotPositive { field: Field::RowL2Weight(0), stage: 8, value: 0.0 }
    );
    assert_eq!(
        refusal(&|p| (p.input_min, p.input_max) = (1.0, -1.0)),
        InvalidInput::IllOrdered { field: Field::InputBounds, stage: 0, lower: 1.0, upper: -1.0 }
    );
    assert_eq!(
        refusal(&|p| p.stages[1].rows[0].lower = f64::INFINITY),
        InvalidInput::IllOrdered {
            field: Field::RowBounds(0),
            stage: 1,
            lower: f64::INFINITY,
            upper: good.stages[1].rows[0].upper
        }
    );
    assert_eq!(refusal(&|p| p.stages.truncate(8)), InvalidInput::Horizon { expected: 9, found: 8 });
}
