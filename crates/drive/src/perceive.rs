//! What the ego car perceives of the world: every vehicle within range, without error.

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range};
use crate::scene::{Neighbor, Scene};
use crate::traffic::World;
use crate::vehicle::VehicleState;

/// The sensors' parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PerceptionConfig {
    /// Vehicles further away than this along the road are not seen, m.
    pub range_m: f64,
}

impl Default for PerceptionConfig {
    fn default() -> Self {
        Self { range_m: 200.0 }
    }
}

impl PerceptionConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("perception.range_m", self.range_m, 50.0, 300.0)
    }
}

/// Brings `scene` up to date with the world around an ego car in state `ego`.
pub fn perceive(config: &PerceptionConfig, world: &World, ego: &VehicleState, scene: &mut Scene) {
    scene.ego = *ego;
    scene.ego_lane = scene.road.nearest_lane(ego.d_m);
    scene.neighbors.clear();
    for vehicle in world.vehicles() {
        let ahead_m = scene.road.ahead_m(ego.s_m, vehicle.s_m);
        if ahead_m.abs() <= config.range_m {
            scene.neighbors.push(Neighbor {
                id: vehicle.id,
                ahead_m,
                d_m: vehicle.d_m,
                speed_mps: vehicle.speed_mps,
                lateral_speed_mps: vehicle.lateral_speed_mps,
                accel_mps2: vehicle.accel_mps2,
                length_m: vehicle.length_m,
                width_m: vehicle.width_m,
                lane: vehicle.lane,
                target_lane: vehicle.target_lane,
            });
        }
    }
    scene.neighbors.sort_unstable_by(|a, b| a.ahead_m.total_cmp(&b.ahead_m).then(a.id.cmp(&b.id)));
}
