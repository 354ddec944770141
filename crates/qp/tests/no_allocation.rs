//! After `new`, the solver never asks for memory. A binary of its own, because it counts the allocations of a whole process.
// Counting allocations takes an allocator, and implementing one is unsafe by its nature.
#![allow(unsafe_code)]

use lanecraft_qp::{Problem, Row, Solver, Start, Status};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's obligations are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller's obligations are passed on.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Every row violated from the start, inputs that cannot help: the largest active set there is.
fn overloaded(horizon: usize) -> Problem<2, 3> {
    let mut problem = Problem::new(horizon);
    problem.initial_state = [100.0, -50.0];
    (problem.input_min, problem.input_max) = (-1.0, 1.0);
    for stage in &mut problem.stages {
        stage.a = [[1.0, 0.1], [0.0, 1.0]];
        stage.b = [0.005, 0.1];
        stage.state_weight = [1.0, 0.1];
        stage.rows = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(|state| Row {
            state,
            input: 0.1,
            lower: -1.0,
            upper: 1.0,
            l1_weight: 10.0,
            l2_weight: 1.0,
        });
    }
    problem
}

#[test]
fn solving_does_not_allocate() {
    let mut problem = overloaded(30);
    let mut bad = problem.clone();
    bad.stages[3].c[1] = f64::NAN;
    let mut solver = Solver::new(30);
    let before = ALLOCATIONS.with(Cell::get);
    let mut most_active = 0;
    for step in 0..20 {
        let verdict = solver.solve(&problem, if step % 5 == 0 { Start::Cold } else { Start::Shifted(1) });
        assert_eq!(verdict.status, Status::Solved);
        most_active = verdict.active.max(most_active);
        problem.initial_state = solver.states()[0];
        problem.stages[step].a[0][1] += 0.001;
    }
    let _ = solver.solve(&bad, Start::Shifted(1));
    let _ = solver.solve(&problem, Start::Shifted(1));
    solver.reset();
    let _ = solver.solve(&problem, Start::Cold);
    assert_eq!(ALLOCATIONS.with(Cell::get) - before, 0);
    assert!(most_active > 60, "only {most_active} constraints active: no load");
}
