//! The paper's form: `[Y, X, V]` of the ego and its differences to six vehicles, in m and m/s.

use super::{ObservationConfig, SLOTS, Situation, Writer, lanes_seen};
use crate::scene::Scene;

pub(super) const SIZE: usize = 3 + SLOTS * 3;

/// A road of eight lanes is 60 m wide at most.
const ACROSS_M: f32 = 100.0;
/// The longest road.
const ALONG_M: f32 = 1e7;
const SPEED_MPS: f32 = 100.0;

pub(super) fn bound(place: usize, range_m: f64) -> (f32, f32) {
    let range_m = range_m as f32;
    match place {
        1 => (-ALONG_M, ALONG_M),
        2 => (0.0, SPEED_MPS),
        place => [(-ACROSS_M, ACROSS_M), (-range_m, range_m), (-SPEED_MPS, SPEED_MPS)][place % 3],
    }
}

pub(super) fn write(config: &ObservationConfig, scene: &Scene, situation: &Situation, out: &mut Writer) {
    let ego = &scene.ego;
    out.push(&[ego.d_m, situation.driven_m, ego.speed_mps]);
    for lane in lanes_seen(scene) {
        let pair = [lane.and_then(|l| scene.leader(l)), lane.and_then(|l| scene.follower(l))];
        for neighbor in pair {
            match neighbor.filter(|n| n.ahead_m.abs() < config.range_m) {
                Some(n) => out.push(&[ego.d_m - n.d_m, -n.ahead_m, ego.speed_mps - n.speed_mps]),
                None => out.push(&[0.0, -config.range_m, 0.0]),
            }
        }
    }
}
