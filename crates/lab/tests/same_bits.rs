//! The same bits at any number of threads and in batches of any size.

use std::sync::Arc;

use lanecraft_drive::decide::Maneuver;
use lanecraft_drive::env::{Config, Env};
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;

const EPISODES: u64 = 24;

/// Digests after 10 s of as many episodes, driven in batches of `batch` by a pool of `threads`.
fn digests(threads: usize, batch: usize) -> Vec<u64> {
    let mut config = Config::default();
    config.env.episode_s = 10.0;
    let config = Arc::new(config);
    let drive = |seed: &u64| {
        let mut env = Env::new(&config, *seed).expect("the default scenario can be built");
        let keep = env.actions().plain(Maneuver::Keep { accel_mps2: 0.0 }).expect("there is a hold action");
        while !env.is_over() {
            let action = (0..32).rev().find(|&action| env.mask().allows(action)).unwrap_or(keep);
            let _ = env.step(action).expect("allowed");
        }
        env.digest()
    };
    let seeds: Vec<u64> = (0..EPISODES).collect();
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
    pool.install(|| seeds.par_chunks(batch).flat_map_iter(|seeds| seeds.iter().map(drive)).collect())
}

#[test]
fn threads_and_batches_change_no_bit() {
    let alone = digests(1, EPISODES as usize);
    assert!(alone.windows(2).all(|pair| pair[0] != pair[1]));
    for threads in [1, 2, 4, 8] {
        for batch in [1, 7, 24] {
            assert_eq!(digests(threads, batch), alone, "{threads} threads, batches of {batch}");
        }
    }
}
