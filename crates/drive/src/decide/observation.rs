//! What the decision layer sees: a fixed number of features of the scene, scaled to about one.
//!
//! The paper gives the state as raw positions and differences in meters, with an absolute X that grows without bound; that form is
//! kept for the preset `paper`. The default drops X and adds what makes the state Markov: lanes that exist, the phase of a lane
//! change, the allowed changes and the traffic further ahead (departure 7 in `docs/deviations.md`).

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range};
use crate::road::{LaneIndex, Side};
use crate::scene::{Neighbor, Scene};

/// Which features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObservationForm {
    /// Scaled features of six slots, the ego and the traffic ahead.
    Features,
    /// `[Y, X, V]` of the ego and the six differences, in meters, as printed.
    Raw,
}

/// The observation's parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObservationConfig {
    /// Which features.
    pub form: ObservationForm,
    /// Vehicles further away than this leave their slot empty, m.
    pub range_m: f64,
}

impl Default for ObservationConfig {
    fn default() -> Self {
        Self { form: ObservationForm::Features, range_m: 100.0 }
    }
}

impl ObservationConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("observation.range_m", self.range_m, 10.0, 200.0)
    }

    /// Number of features.
    pub fn size(&self) -> usize {
        match self.form {
            ObservationForm::Features => EGO_FEATURES + SLOTS * SLOT_FEATURES + LANES_SEEN * LANE_FEATURES,
            ObservationForm::Raw => 3 + SLOTS * 3,
        }
    }
}

/// Front and rear in the left, the own and the right lane.
const SLOTS: usize = 6;
/// Δx, Δy, ΔV, present.
const SLOT_FEATURES: usize = 4;
const EGO_FEATURES: usize = 10;
const LANES_SEEN: usize = 3;
/// Second leader's Δx and ΔV, mean relative speed and number of vehicles ahead.
const LANE_FEATURES: usize = 4;
/// Speed differences are divided by this, m/s.
const SPEED_SCALE_MPS: f64 = 10.0;
/// The time since the last lane change is seen up to this, s.
const MEMORY_S: f64 = 10.0;

/// What the scene does not hold: where the ego is in its own lane change and what it may do next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Situation {
    /// Elapsed share of the lane change under way, 0 while keeping.
    pub progress: f64,
    /// Time since the last lane change ended, s.
    pub since_change_s: f64,
    /// Whether a change to the left and to the right is allowed now.
    pub allowed: [bool; 2],
    /// Distance driven since the start, m (only the raw form shows it).
    pub driven_m: f64,
}

/// Writes the observation into `out`, whose length is [`ObservationConfig::size`].
pub fn observe(config: &ObservationConfig, scene: &Scene, situation: &Situation, out: &mut [f32]) {
    debug_assert_eq!(out.len(), config.size());
    let mut writer = Writer { out, at: 0 };
    match config.form {
        ObservationForm::Features => {
            ego_features(scene, situation, &mut writer);
            for lane in lanes_seen(scene) {
                slot_features(config, scene, lane, &mut writer);
            }
            for lane in lanes_seen(scene) {
                lane_features(scene, lane, &mut writer);
            }
        }
        ObservationForm::Raw => raw_features(config, scene, situation, &mut writer),
    }
}

struct Writer<'a> {
    out: &'a mut [f32],
    at: usize,
}

impl Writer<'_> {
    fn push(&mut self, values: &[f64]) {
        for &value in values {
            self.out[self.at] = value as f32;
            self.at += 1;
        }
    }
}

/// Left, own and right lane, where they exist.
fn lanes_seen(scene: &Scene) -> [Option<LaneIndex>; LANES_SEEN] {
    let beside = |side| scene.beside(scene.ego_lane, side);
    [beside(Side::Left), Some(scene.ego_lane), beside(Side::Right)]
}

fn flag(value: bool) -> f64 {
    f64::from(u8::from(value))
}

fn ego_features(scene: &Scene, situation: &Situation, out: &mut Writer) {
    let ego = &scene.ego;
    let width_m = scene.road.lane_width_m();
    let lanes = scene.road.lanes().count() as f64;
    out.push(&[
        (ego.d_m - scene.road.lane_center_m(scene.ego_lane)) / width_m,
        2.0 * (ego.d_m / (width_m * (lanes - 1.0).max(1.0))) - 1.0,
        (ego.speed_mps - 25.0) / SPEED_SCALE_MPS,
        ego.accel_mps2 / 3.0,
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

fn raw_features(config: &ObservationConfig, scene: &Scene, situation: &Situation, out: &mut Writer) {
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::road::{Road, RoadConfig};
    use crate::scene::VehicleId;
    use crate::vehicle::VehicleState;

    fn scene() -> Scene {
        let neighbor = |id, ahead_m: f64, lane: u8| {
            Neighbor::car(VehicleId(id), LaneIndex(lane), 3.75 * f64::from(lane), ahead_m, 20.0)
        };
        Scene {
            road: Arc::new(Road::new(RoadConfig::default()).expect("valid")),
            ego: VehicleState { speed_mps: 25.0, ..VehicleState::default() },
            ego_length_m: 4.8,
            ego_width_m: 1.9,
            ego_lane: LaneIndex(0),
            neighbors: vec![neighbor(1, -30.0, 1), neighbor(2, 40.0, 0), neighbor(3, 90.0, 0), neighbor(4, 150.0, 1)],
        }
    }

    #[test]
    fn both_forms_fill_their_length_with_finite_numbers() {
        for form in [ObservationForm::Features, ObservationForm::Raw] {
            let config = ObservationConfig { form, ..ObservationConfig::default() };
            let mut out = vec![f32::NAN; config.size()];
            observe(&config, &scene(), &Situation::default(), &mut out);
            assert!(out.iter().all(|x| x.is_finite()), "{form:?}: {out:?}");
        }
    }

    #[test]
    fn slots_hold_the_nearest_vehicle_within_range() {
        let config = ObservationConfig::default();
        let mut out = vec![0.0; config.size()];
        observe(&config, &scene(), &Situation::default(), &mut out);
        let slots: Vec<&[f32]> = out[EGO_FEATURES..].chunks(SLOT_FEATURES).take(SLOTS).collect();
        assert_eq!(slots[0], [1.0, 0.0, 0.0, 0.0], "the left leader is out of range");
        assert_eq!(slots[1], [-0.3, 1.0, -0.5, 1.0], "the left follower is 30 m behind");
        assert_eq!(slots[2], [0.4, 0.0, -0.5, 1.0], "the own leader is 40 m ahead");
        assert_eq!(slots[4], [0.0, 0.0, -1.0, 1.0], "there is no right lane");
    }
}
