//! Traffic as films: what an onlooker behind everybody sees, ten times a second.
//!
//! The onlooker stands for the ego of a scene, but far behind, so that nobody follows it. Simulated traffic drives on a ring, which is
//! cut open behind one vehicle that the onlooker keeps at its side; the vehicles ahead on the cut's other side are seen without their
//! leaders and are left out of what is learned and judged.

use std::sync::Arc;

use lanecraft_drive::env::Config;
use lanecraft_drive::road::{Road, Topology};
use lanecraft_drive::scenario::{ScenarioDistribution, ScenarioError};
use lanecraft_drive::scene::{Neighbor, Scene, VehicleId};
use lanecraft_drive::traffic::{Vehicle, World};
use lanecraft_drive::vehicle::VehicleState;

use crate::config::SeedRole;

/// Time between two scenes, s.
pub(super) const SCENE_S: f64 = 0.1;
/// Simulated steps between two scenes: traffic is driven as fast as in the closed loop.
const STEPS: usize = 2;
/// Length before the cut of a ring whose vehicles do not count, m: whom they follow may be out of sight.
const BEFORE_CUT_M: f64 = 250.0;

/// Scenes of one traffic, `SCENE_S` apart.
#[derive(Clone, Debug)]
pub struct Film {
    /// Name of the site, or number of the scenario.
    pub name: String,
    pub(super) scenes: Vec<Scene>,
    /// Where the onlooker stands in each scene, m.
    origins_m: Vec<f64>,
    /// Length of the ring; infinite on an open road.
    ring_m: f64,
}

impl Film {
    /// A film on an open road with an onlooker who stands still.
    pub(super) fn standing(name: String, scenes: Vec<Scene>) -> Self {
        Self { name, origins_m: vec![0.0; scenes.len()], scenes, ring_m: f64::INFINITY }
    }

    /// The simulated traffic of `config` in the scenario of this index, for `duration_s`.
    ///
    /// # Errors
    /// If the scenario cannot be built.
    pub fn simulated(
        config: &Config,
        role: SeedRole,
        seed: u64,
        index: u64,
        duration_s: f64,
    ) -> Result<Self, ScenarioError> {
        let distribution = ScenarioDistribution { road: config.road.clone(), traffic: config.traffic.clone() };
        let mut world = World::new(&distribution.sample(role.scenario_seed(seed, index))?)?;
        let road = Arc::clone(world.road());
        let ring_m = if road.config().topology == Topology::Ring { road.config().length_m } else { f64::INFINITY };
        let mut film = Self { name: format!("simulated-{index}"), scenes: Vec::new(), origins_m: Vec::new(), ring_m };
        let mut origin_m = 0.0;
        let mut cut_m: Option<f64> = None;
        for _ in 0..(duration_s / SCENE_S).round() as usize {
            // The first vehicle drives along with the onlooker, or the hindmost one of an open road.
            let Some(s_m) = world.vehicles().map(|vehicle| vehicle.s_m).next() else { break };
            let hindmost_m = world.vehicles().map(|vehicle| vehicle.s_m).fold(f64::INFINITY, f64::min);
            let here_m = if ring_m.is_finite() { s_m } else { hindmost_m };
            origin_m += cut_m.map_or(0.0, |before_m| road.ahead_m(before_m, here_m));
            cut_m = Some(here_m);
            film.scenes.push(scene(&road, world.vehicles(), here_m, ring_m));
            film.origins_m.push(origin_m);
            for _ in 0..STEPS {
                let _ = world.step_alone(SCENE_S / STEPS as f64);
            }
        }
        Ok(film)
    }

    /// Whether this vehicle of a scene counts.
    pub(super) fn counts(&self, neighbor: &Neighbor) -> bool {
        neighbor.ahead_m < self.ring_m - BEFORE_CUT_M
    }

    /// A vehicle in a scene.
    pub(super) fn vehicle(&self, scene: usize, id: VehicleId) -> Option<&Neighbor> {
        self.scenes.get(scene)?.neighbors.iter().find(|neighbor| neighbor.id == id)
    }

    /// How far this vehicle moves from one scene to a later one: along and to the left, m; nothing if it is then out of sight.
    pub(super) fn displacement_m(&self, from: (usize, &Neighbor), later: usize) -> Option<(f64, f64)> {
        let then = self.vehicle(later, from.1.id)?;
        let moved_m = self.origins_m[later] + then.ahead_m - self.origins_m[from.0] - from.1.ahead_m;
        // Who passes the cut appears to leap by the ring's length.
        let leaps = if self.ring_m.is_finite() { (moved_m / self.ring_m).round() * self.ring_m } else { 0.0 };
        Some((moved_m - leaps, then.d_m - from.1.d_m))
    }
}

fn scene(road: &Arc<Road>, vehicles: impl Iterator<Item = Vehicle>, here_m: f64, ring_m: f64) -> Scene {
    let neighbor = |vehicle: Vehicle| {
        let ahead_m = vehicle.s_m - here_m;
        vehicle.seen(if ring_m.is_finite() { ahead_m.rem_euclid(ring_m) } else { ahead_m })
    };
    onlooker(road, vehicles.map(neighbor).collect())
}

/// The scene of somebody behind all of these.
pub(super) fn onlooker(road: &Arc<Road>, mut neighbors: Vec<Neighbor>) -> Scene {
    neighbors.sort_by(|a, b| a.ahead_m.total_cmp(&b.ahead_m).then(a.id.cmp(&b.id)));
    let ego = VehicleState::default();
    let ego_lane = road.nearest_lane(ego.d_m);
    Scene { road: Arc::clone(road), ego, ego_length_m: 4.8, ego_width_m: 1.9, ego_lane, neighbors }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displacements_on_a_ring_are_the_integral_of_speed_and_nobody_leaps() {
        let film = Film::simulated(&Config::default(), SeedRole::Prediction, 0, 0, 20.0).unwrap();
        assert_eq!(film.scenes.len(), 200);
        for neighbor in &film.scenes[20].neighbors {
            let mut by_speed_m = 0.0;
            for scene in 20..60 {
                let speed_mps = |at| film.vehicle(at, neighbor.id).unwrap().speed_mps;
                by_speed_m += 0.5 * SCENE_S * (speed_mps(scene) + speed_mps(scene + 1));
            }
            let (moved_m, _) = film.displacement_m((20, neighbor), 60).unwrap();
            // The rule of the trapezoid over 0.1 s is off by at most a · 0.1² / 12 for each step.
            assert!((moved_m - by_speed_m).abs() < 0.1, "{moved_m} {by_speed_m}");
        }
    }

    #[test]
    fn vehicles_before_the_cut_do_not_count() {
        let film = Film::simulated(&Config::default(), SeedRole::Prediction, 0, 1, 1.0).unwrap();
        let scene = &film.scenes[0];
        assert_eq!(scene.neighbors[0].ahead_m, 0.0);
        let counted = scene.neighbors.iter().filter(|neighbor| film.counts(neighbor)).count();
        assert!(counted > scene.neighbors.len() / 2 && counted < scene.neighbors.len());
    }
}
