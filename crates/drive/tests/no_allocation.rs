//! A control step asks for no memory, whatever is switched on, and neither does a decision of the fast environment with its observation.
//! A binary of its own, because it counts allocations.
// Counting allocations takes an allocator, and implementing one is unsafe by its nature.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;

use lanecraft_drive::decide::Maneuver;
use lanecraft_drive::env::{Config, Env};
use lanecraft_drive::kinematic::{KinematicConfig, KinematicEnv, MetaAction};
use lanecraft_drive::predict::Predictor;

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

#[test]
fn driving_does_not_allocate() {
    for predictor in Predictor::ALL {
        drive(predictor);
    }
}

fn drive(predictor: Predictor) {
    let mut config = Config::default();
    config.prediction.predictor = predictor;
    (config.vehicle.steer_delay_s, config.vehicle.drive_delay_s) = (0.12, 0.2);
    (config.control.observer, config.plant.combined_grip) = (true, true);
    (config.plant.wind_mps, config.perception.position_noise_m) = (8.0, 0.1);
    let mut env = Env::new(&Arc::new(config), 3).expect("a valid configuration");
    let keep = env.actions().plain(Maneuver::Keep { accel_mps2: 0.0 }).expect("there is a hold action");
    for _ in 0..10 {
        let _ = env.step(keep).expect("allowed");
    }
    let before = ALLOCATIONS.with(Cell::get);
    for _ in 0..40 {
        let _ = env.step(keep).expect("allowed");
    }
    assert_eq!(ALLOCATIONS.with(Cell::get) - before, 0, "{}", predictor.name());
}

#[test]
fn deciding_and_observing_do_not_allocate() {
    let config = Arc::new(KinematicConfig::default());
    let mut observation = vec![0.0; config.task.observation.size()];
    for seed in 0..20 {
        let mut env = KinematicEnv::new(&config, seed).expect("a valid configuration");
        let before = ALLOCATIONS.with(Cell::get);
        for action in (0..MetaAction::ALL.len()).cycle() {
            if env.step(action).is_err() {
                break;
            }
            env.observe(&mut observation);
        }
        assert_eq!(ALLOCATIONS.with(Cell::get) - before, 0);
    }
}
