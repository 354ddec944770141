//! What the ego car perceives of the world: every vehicle within range, by choice with noise, and the ends of
//! lanes ahead.
//!
//! Noise is white and normal, keyed by the world's seed, the step and the vehicle: the same whoever else is seen. The
//! ego's own state, lanes and turn signals are seen without error.

use lanecraft_net::random::Stream;
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
    /// Standard deviation of the noise of another vehicle's position, m, along and across the road. The paper has none.
    pub position_noise_m: f64,
    /// Standard deviation of the noise of its speed, m/s, along and across the road.
    pub speed_noise_mps: f64,
}

impl Default for PerceptionConfig {
    fn default() -> Self {
        Self { range_m: 200.0, position_noise_m: 0.0, speed_noise_mps: 0.0 }
    }
}

impl PerceptionConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("perception.range_m", self.range_m, 50.0, 300.0)?;
        check_range("perception.position_noise_m", self.position_noise_m, 0.0, 5.0)?;
        check_range("perception.speed_noise_mps", self.speed_noise_mps, 0.0, 5.0)
    }
}

/// The end of a lane is known from this far on, m, whatever the sensors reach: signs announce it.
const LANE_END_SIGHT_M: f64 = 400.0;

/// Brings `scene` up to date with the world around an ego car in state `ego`.
pub fn perceive(config: &PerceptionConfig, world: &World, ego: &VehicleState, scene: &mut Scene) {
    scene.ego = *ego;
    scene.ego_lane = scene.road.nearest_lane(ego.d_m);
    scene.neighbors.clear();
    for vehicle in world.vehicles_near(ego.s_m, config.range_m) {
        let ahead_m = scene.road.ahead_m(ego.s_m, vehicle.s_m);
        if ahead_m.abs() <= config.range_m {
            scene.neighbors.push(vehicle.seen(ahead_m));
        }
    }
    if config.position_noise_m > 0.0 || config.speed_noise_mps > 0.0 {
        for neighbor in &mut scene.neighbors {
            let id = u64::from(neighbor.id.0);
            blur(neighbor, config, Stream::keyed(world.seed(), "perceive.noise", world.time_step(), id));
        }
    }
    complete(scene);
}

/// Makes a scene of what was perceived: adds the ends of lanes and puts all in order.
pub fn complete(scene: &mut Scene) {
    see_lane_ends(scene);
    scene.neighbors.sort_unstable_by(|a, b| a.ahead_m.total_cmp(&b.ahead_m).then(a.id.cmp(&b.id)));
}

/// The ends of lanes ahead stand on the road like vehicles; the map knows them without error.
fn see_lane_ends(scene: &mut Scene) {
    let road = &scene.road;
    if road.has_all_lanes() {
        return;
    }
    for lane in road.lanes() {
        let end_ahead_m = road.lane_end_ahead_m(lane, scene.ego.s_m);
        if end_ahead_m > 0.0 && end_ahead_m <= LANE_END_SIGHT_M {
            scene.neighbors.push(Neighbor::lane_end(road, lane, end_ahead_m));
        }
    }
}

fn blur(neighbor: &mut Neighbor, config: &PerceptionConfig, mut noise: Stream) {
    neighbor.ahead_m += config.position_noise_m * noise.normal();
    neighbor.d_m += config.position_noise_m * noise.normal();
    neighbor.speed_mps = (neighbor.speed_mps + config.speed_noise_mps * noise.normal()).max(0.0);
    neighbor.lateral_speed_mps += config.speed_noise_mps * noise.normal();
}
