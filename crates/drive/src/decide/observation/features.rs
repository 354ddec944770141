//! The default form: ten values of the ego, four of each of six slots, four of each of three lanes.

use super::{
    ACCEL_SCALE_MPS2, LANES_SEEN, MEMORY_S, MIDDLE_SPEED_MPS, ObservationConfig, SLOTS, SPEED_SCALE_MPS, Situation,
    Writer, flag, lanes_seen,
};
use crate::road::{LaneIndex, Side};
use crate::scene::{Neighbor, Scene};

const FLAG: (f32, f32) = (0.0, 1.0);
/// A difference of speeds of 100 m/s.
const RELATIVE_SPEED: (f32, f32) = (-10.0, 10.0);

/// Offset in the lane, place across the road, speed, acceleration, two lanes beside, two changes allowed, progress, time since.
pub(super) const EGO: [(f32, f32); 10] =
    [(-2.0, 2.0), (-4.0, 4.0), (-2.5, 7.5), (-5.0, 5.0), FLAG, FLAG, FLAG, FLAG, (0.0, 2.0), FLAG];
/// Δx, Δy, ΔV, present.
pub(super) const SLOT: [(f32, f32); 4] = [(-1.0, 1.0), (-8.0, 8.0), RELATIVE_SPEED, FLAG];
/// Second leader's Δx and ΔV, mean relative speed and number of vehicles ahead.
const LANE: [(f32, f32); 4] = [(0.0, 1.0), RELATIVE_SPEED, RELATIVE_SPEED, (0.0, 20.0)];

pub(super) const SIZE: usize = EGO.len() + SLOTS * SLOT.len() + LANES_SEEN * LANE.len();

pub(super) fn bound(place: usize) -> (f32, f32) {
    let slots_end = EGO.len() + SLOTS * SLOT.len();
    match place {
        place if place < EGO.len() => EGO[place],
        place if place < slots_end => SLOT[(place - EGO.len()) % SLOT.len()],
        place => LANE[(place - slots_end) % LANE.len()],
    }
}

pub(super) fn write(config: &ObservationConfig, scene: &Scene, situation: &Situation, out: &mut Writer) {
    ego_features(scene, situation, out);
    for lane in lanes_seen(scene) {
        slot_features(config, scene, lane, out);
    }
    for lane in lanes_seen(scene) {
        lane_features(scene, lane, out);
    }
}

fn ego_features(scene: &Scene, situation: &Situation, out: &mut Writer) {
    let ego = &scene.ego;
    let width_m = scene.road.lane_width_m();
    let lanes = scene.road.lanes().count() as f64;
    out.push(&[
        (ego.d_m - scene.road.lane_center_m(scene.ego_lane)) / width_m,
        2.0 * (ego.d_m / (width_m * (lanes - 1.0).max(1.0))) - 1.0,
        (ego.speed_mps - MIDDLE_SPEED_MPS) / SPEED_SCALE_MPS,
        ego.accel_mps2 / ACCEL_SCALE_MPS2,
        flag(scene.beside(scene.ego_lane, Side::Left).is_some()),
        flag(scene.beside(scene.ego_lane, Side::Right).is_some()),
        flag(situation.allowed[0]),
        flag(situation.allowed[1]),
        situation.progress,
        situation.since_change_s.min(MEMORY_S) / MEMORY_S,
    ]);
}

/// A missing lane looks blocked (a standing car abreast), a missing vehicle looks far and equally fast.
fn slot_features(config: &ObservationConfig, scene: &Scene, lane: Option<LaneIndex>, out: &mut Writer) {
    let Some(lane) = lane else {
        out.push(&[0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 1.0, 1.0]);
        return;
    };
    for (neighbor, direction) in [(scene.leader(lane), 1.0), (scene.follower(lane), -1.0)] {
        match neighbor.filter(|n| n.ahead_m.abs() < config.range_m) {
            Some(n) => out.push(&[
                n.ahead_m / config.range_m,
                (n.d_m - scene.ego.d_m) / scene.road.lane_width_m(),
                (n.speed_mps - scene.ego.speed_mps) / SPEED_SCALE_MPS,
                1.0,
            ]),
            None => out.push(&[direction, 0.0, 0.0, 0.0]),
        }
    }
}

fn lane_features(scene: &Scene, lane: Option<LaneIndex>, out: &mut Writer) {
    let Some(lane) = lane else {
        out.push(&[0.0, -1.0, -1.0, 1.0]);
        return;
    };
    let ahead = || scene.neighbors.iter().filter(|n| n.ahead_m >= 0.0 && n.occupies(lane));
    let relative = |n: &Neighbor| (n.speed_mps - scene.ego.speed_mps) / SPEED_SCALE_MPS;
    match ahead().nth(1) {
        Some(second) => out.push(&[(second.ahead_m / 200.0).min(1.0), relative(second)]),
        None => out.push(&[1.0, 0.0]),
    }
    let count = ahead().count() as f64;
    out.push(&[ahead().map(relative).sum::<f64>() / count.max(1.0), count / 5.0]);
}
