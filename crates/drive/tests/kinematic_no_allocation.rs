//! A decision of the fast environment and its observation ask for no memory. A binary of its own, because it counts the allocations of a
//! whole process.
// Counting allocations takes an allocator, and implementing one is unsafe by its nature.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;

use lanecraft_drive::kinematic::{KinematicConfig, KinematicEnv, MetaAction};

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
