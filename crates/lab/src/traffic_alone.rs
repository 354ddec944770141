//! Human drivers without an ego car.

use lanecraft_drive::road::LaneIndex;
use lanecraft_drive::scenario::{Scenario, ScenarioError};
use lanecraft_drive::traffic::{ExternalBody, StepEvents, World};

/// Far beside the road and in none of its lanes.
const ABSENT: ExternalBody = ExternalBody {
    s_m: 0.0,
    d_m: 1000.0,
    heading_rad: 0.0,
    speed_mps: 0.0,
    accel_mps2: 0.0,
    length_m: 4.8,
    width_m: 1.9,
    target_lane: LaneIndex(u8::MAX),
};

/// The scene's world after its warm-up.
///
/// # Errors
/// If the scene is impossible or unsafe.
pub(crate) fn world(scenario: &Scenario) -> Result<World, ScenarioError> {
    let mut world = World::new(scenario)?;
    world.set_ego(ABSENT);
    Ok(world)
}

/// Moves the human drivers by a step.
pub(crate) fn step(world: &mut World, dt_s: f64) -> StepEvents {
    world.step(ABSENT, dt_s)
}
