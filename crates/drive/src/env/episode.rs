//! What is measured of an episode, apart from any reward.

use serde::{Deserialize, Serialize};

use crate::driver::DriverCounts;
use crate::scene::Scene;
use crate::traffic::Collision;

/// Times to collision above this count as this, s.
pub const TIME_TO_COLLISION_CAP_S: f64 = 20.0;

/// Measurements since the start of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Ticks driven; control steps, if these were handed in one by one.
    pub ticks: u32,
    /// Control steps driven.
    pub control_steps: u64,
    /// Sum of the speed over control steps, m/s.
    pub speed_sum_mps: f64,
    /// Sum of the absolute jerk over control steps, m/s³.
    pub jerk_sum_mps3: f64,
    /// Sum of the score over ticks.
    pub score_sum: f64,
    /// Smallest time to collision, s, at most [`TIME_TO_COLLISION_CAP_S`].
    pub min_time_to_collision_s: f64,
    /// The collision that ended it.
    pub collision: Option<Collision>,
    /// What did not go as planned.
    pub counts: DriverCounts,
}

impl Default for Episode {
    fn default() -> Self {
        Self {
            ticks: 0,
            control_steps: 0,
            speed_sum_mps: 0.0,
            jerk_sum_mps3: 0.0,
            score_sum: 0.0,
            min_time_to_collision_s: TIME_TO_COLLISION_CAP_S,
            collision: None,
            counts: DriverCounts::default(),
        }
    }
}

impl Episode {
    /// Time mean of the speed, m/s.
    pub fn mean_speed_mps(&self) -> f64 {
        self.speed_sum_mps / (self.control_steps.max(1) as f64)
    }

    /// Mean absolute jerk, m/s³.
    pub fn mean_jerk_mps3(&self) -> f64 {
        self.jerk_sum_mps3 / (self.control_steps.max(1) as f64)
    }

    /// Mean score of a tick.
    pub fn mean_score(&self) -> f64 {
        self.score_sum / f64::from(self.ticks.max(1))
    }
}

/// Time until the ego touches the vehicle ahead if both keep their speeds, over all vehicles in its path, s.
pub(super) fn time_to_collision_s(scene: &Scene) -> f64 {
    let ego = &scene.ego;
    let ahead = scene.neighbors.iter().filter(|n| n.ahead_m > 0.0 && !n.is_lane_end());
    let in_path = ahead.filter(|n| (n.d_m - ego.d_m).abs() < 0.5 * (n.width_m + scene.ego_width_m));
    let times_s = in_path.filter_map(|n| {
        let closing_mps = ego.speed_mps - n.speed_mps;
        (closing_mps > 0.0).then(|| n.gap_m(scene.ego_length_m).max(0.0) / closing_mps)
    });
    times_s.fold(TIME_TO_COLLISION_CAP_S, f64::min)
}
