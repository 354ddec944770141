//! The shield: which lane changes the ego car may decide on at all.
//!
//! It stands beside the planner's veto (Eq. 15) and asks more: the ego must be able to stop behind *every* vehicle of the target lane,
//! and whoever comes from behind must be able to slow down in time (the rule of Shalev-Shwartz et al., 2017, in the form whose
//! parameters are the simulator's real limits). The guard repeats the longitudinal part at every control step.

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range};
use crate::models::rss::{Braking, safe_gap_m};
use crate::road::LaneIndex;
use crate::scene::Scene;

/// The shield's parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ShieldConfig {
    /// Whether lane changes pass the shield; off in the paper.
    pub enabled: bool,
    /// Added to the safe gap ahead, m.
    pub front_margin_m: f64,
    /// Time headway demanded of the follower in the target lane, s.
    pub rear_headway_s: f64,
    /// Gap demanded behind at equal speed and no headway, m.
    pub rear_margin_m: f64,
    /// Braking expected of the follower, m/s².
    pub rear_brake_mps2: f64,
}

impl Default for ShieldConfig {
    fn default() -> Self {
        Self { enabled: true, front_margin_m: 1.0, rear_headway_s: 0.3, rear_margin_m: 2.0, rear_brake_mps2: 4.0 }
    }
}

impl ShieldConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("shield.front_margin_m", self.front_margin_m, 0.0, 50.0)?;
        check_range("shield.rear_headway_s", self.rear_headway_s, 0.0, 3.0)?;
        check_range("shield.rear_margin_m", self.rear_margin_m, 0.0, 50.0)?;
        check_range("shield.rear_brake_mps2", self.rear_brake_mps2, 0.5, 9.0)
    }
}

/// Why the shield forbids a lane change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ShieldCause {
    /// The ego could not stop behind a vehicle of the target lane.
    Ahead,
    /// A vehicle behind in the target lane could not slow down in time.
    Behind,
}

/// Whether a change into `target` is safe now.
pub fn check_lane_change(
    config: &ShieldConfig,
    braking: &Braking,
    scene: &Scene,
    target: LaneIndex,
) -> Result<(), ShieldCause> {
    let ego = &scene.ego;
    for neighbor in scene.neighbors.iter().filter(|n| n.occupies(target)) {
        let gap_m = neighbor.gap_m(scene.ego_length_m);
        if neighbor.ahead_m >= 0.0 {
            let safe_m =
                safe_gap_m(ego.speed_mps, ego.accel_mps2, neighbor.speed_mps, &braking.behind(neighbor.accel_mps2));
            if gap_m < safe_m + config.front_margin_m {
                return Err(ShieldCause::Ahead);
            }
        } else {
            let closing_mps = (neighbor.speed_mps - ego.speed_mps).max(0.0);
            let slowing_m = closing_mps * closing_mps / (2.0 * config.rear_brake_mps2);
            if gap_m < config.rear_headway_s * neighbor.speed_mps + config.rear_margin_m + slowing_m {
                return Err(ShieldCause::Behind);
            }
        }
    }
    Ok(())
}
