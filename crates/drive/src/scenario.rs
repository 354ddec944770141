//! Scenes and distributions over scenes, from text.
//!
//! A [`Scenario`] is a plain value: the road, every vehicle with its driver, where the ego starts, what happens later, and the
//! seed of what is drawn later. It comes from a [`ScenarioFile`], which is strict TOML, or from a [`ScenarioDistribution`] and a
//! seed. A file with `ranges` is itself a distribution: each seed draws its numbers.

mod distribution;
mod draw;
mod drivers;
mod error;
mod file;
mod ranges;
mod recording;
mod script;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use self::distribution::Distribution;
use self::draw::Draw;
pub use self::drivers::{TrafficConfig, VehicleKind};
pub use self::error::{Party, ScenarioError};
pub use self::file::{EgoStart, Flow, ScenarioFile, VehicleStart};
pub use self::ranges::{Range, Ranges};
pub use self::recording::{RecordedTraffic, Recording, Track, TrackSample};
pub use self::script::{Action, Event, ScriptedEvent, Trigger};
use crate::config::{ConfigError, check_range};
use crate::models::idm::IdmParams;
use crate::road::{LaneIndex, Road, RoadConfig, Topology};
use crate::vehicle::VehicleParams;

/// Everything about a human-driven vehicle at the start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VehicleSpec {
    /// Car or truck.
    pub kind: VehicleKind,
    /// Lane.
    pub lane: LaneIndex,
    /// Position of its center, m.
    pub s_m: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Its driver's car following.
    pub driver: IdmParams,
    /// Its driver's weight of the others' gain when it chooses a lane.
    pub politeness: f64,
    /// Hardest braking on this road, m/s² (positive).
    pub max_brake_mps2: f64,
    /// Time to its first possible lane change, s.
    pub cooldown_s: f64,
}

/// A scene: a plain value that determines all that follows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scenario {
    /// The road.
    pub road: Arc<Road>,
    /// Parameters that all drivers share, and the stress.
    pub traffic: TrafficConfig,
    /// The vehicles; the index is the id.
    pub vehicles: Vec<VehicleSpec>,
    /// Where the ego starts.
    pub ego: EgoStart,
    /// Time that the traffic drives alone first, s; 0 for written vehicles.
    pub warm_up_s: f64,
    /// What vehicles do apart from driving on.
    pub script: Vec<ScriptedEvent>,
    /// Vehicles that enter later. Where there are any, whoever reaches the end of the road leaves it.
    pub flows: Vec<Flow>,
    /// Recorded vehicles, and whether they follow the ego once it is ahead of them.
    pub recording: Option<(Arc<Recording>, bool)>,
    /// Seed of what is drawn later: the ego's lane, the stress, the flows.
    pub seed: u64,
}

impl Scenario {
    /// A scene in which nothing happens but these vehicles driving on.
    fn of_vehicles(
        road: Arc<Road>,
        traffic: TrafficConfig,
        vehicles: Vec<VehicleSpec>,
        ego: EgoStart,
        seed: u64,
    ) -> Self {
        let (script, flows, recording) = (Vec::new(), Vec::new(), None);
        Self { road, traffic, vehicles, ego, warm_up_s: 0.0, script, flows, recording, seed }
    }

    /// Draws the driver of the vehicle with this index among all that enter lane `lane` later.
    pub(crate) fn draw_entering(&self, lane: LaneIndex, index: u64) -> VehicleSpec {
        let draw = Draw { traffic: &self.traffic, road: &self.road, seed: self.seed };
        draw.entering(lane, index)
    }

    /// Checks that every lane exists, that nobody overlaps and that every distance is safe.
    pub fn check(&self) -> Result<(), ScenarioError> {
        if self.vehicles.is_empty() && self.flows.is_empty() && self.recording.is_none() {
            return Err(ScenarioError::EmptyRoad);
        }
        let (first_m, last_m) = match self.road.config().topology {
            Topology::Ring => (0.0, self.road.config().length_m),
            Topology::Open => (-1e5, 1e5),
        };
        for (index, vehicle) in self.vehicles.iter().enumerate() {
            let party = Party::Vehicle(index as u32);
            check_lane(&self.road, vehicle.lane, party)?;
            check_vehicle(vehicle, first_m, last_m).map_err(|source| ScenarioError::Vehicle { index, source })?;
            let end_gap_m = check_on_lane(&self.road, (vehicle.lane, vehicle.s_m), vehicle.kind.length_m(), party)?;
            let limits = self.traffic.braking_limits(vehicle.max_brake_mps2, false, &self.road);
            check_end(party, end_gap_m, limits.required_gap_m(vehicle.speed_mps, 0.0))?;
        }
        if let EgoStart::At { lane, s_m, speed_mps } = self.ego {
            check_lane(&self.road, lane, Party::Ego)?;
            let end_gap_m = check_on_lane(&self.road, (lane, s_m), ego_length_m(), Party::Ego)?;
            let brake_mps2 = self.traffic.hardest_brake_mps2(self.road.adhesion_range().0);
            let limits = self.traffic.braking_limits(brake_mps2, false, &self.road);
            check_end(Party::Ego, end_gap_m, limits.required_gap_m(speed_mps, 0.0))?;
            check_range("ego.s_m", s_m, first_m, last_m)?;
            check_range("ego.speed_mps", speed_mps, 0.0, 60.0)?;
        }
        self.road.lanes().try_for_each(|lane| self.check_distances(lane))
    }

    /// Each vehicle of the lane against the one ahead of it.
    fn check_distances(&self, lane: LaneIndex) -> Result<(), ScenarioError> {
        let mut order: Vec<usize> = (0..self.vehicles.len()).filter(|&i| self.vehicles[i].lane == lane).collect();
        order.sort_by(|&a, &b| self.vehicles[a].s_m.total_cmp(&self.vehicles[b].s_m).then(a.cmp(&b)));
        let ring_m = match self.road.config().topology {
            Topology::Ring => self.road.config().length_m,
            Topology::Open => f64::INFINITY,
        };
        for (k, &behind) in order.iter().enumerate() {
            let ahead = order[(k + 1) % order.len()];
            let (follower, leader) = (&self.vehicles[behind], &self.vehicles[ahead]);
            let turn_m = if k + 1 == order.len() { ring_m } else { 0.0 };
            let half_lengths_m = 0.5 * (follower.kind.length_m() + leader.kind.length_m());
            let gap_m = leader.s_m - follower.s_m + turn_m - half_lengths_m;
            let limits = self.traffic.braking_limits(follower.max_brake_mps2, false, &self.road);
            let required_m = limits.required_gap_m(follower.speed_mps, leader.speed_mps);
            check_gap([Party::Vehicle(behind as u32), Party::Vehicle(ahead as u32)], gap_m, required_m)?;
        }
        Ok(())
    }
}

fn check_vehicle(vehicle: &VehicleSpec, first_m: f64, last_m: f64) -> Result<(), ConfigError> {
    check_range("vehicles.s_m", vehicle.s_m, first_m, last_m)?;
    check_range("vehicles.speed_mps", vehicle.speed_mps, 0.0, 60.0)?;
    check_range("vehicles.desired_speed_mps", vehicle.driver.desired_speed_mps, 1.0, 60.0)
}

fn check_lane(road: &Road, lane: LaneIndex, who: Party) -> Result<(), ScenarioError> {
    let last = road.config().lanes - 1;
    if lane.0 <= last { Ok(()) } else { Err(ScenarioError::NoSuchLane { who, lane: lane.0, last }) }
}

/// The lane must exist under the whole vehicle; returns the gap to its end, m.
fn check_on_lane(road: &Road, (lane, s_m): (LaneIndex, f64), length_m: f64, who: Party) -> Result<f64, ScenarioError> {
    if road.lane_holds(lane, s_m, 0.5 * length_m) {
        return Ok(road.lane_end_ahead_m(lane, s_m) - 0.5 * length_m);
    }
    Err(ScenarioError::OffLane { who, lane: lane.0, s_m })
}

/// Who starts must be able to stop before the end of its lane.
fn check_end(who: Party, gap_m: f64, required_m: f64) -> Result<(), ScenarioError> {
    // Sampled speeds are the fastest safe ones, up to rounding.
    if gap_m >= required_m - 1e-9 { Ok(()) } else { Err(ScenarioError::PastStopping { who, gap_m, required_m }) }
}

/// The follower's gap to its leader must be at least the required one.
pub(crate) fn check_gap([follower, leader]: [Party; 2], gap_m: f64, required_m: f64) -> Result<(), ScenarioError> {
    if gap_m < 0.0 {
        return Err(ScenarioError::Overlap { first: follower, second: leader, overlap_m: -gap_m });
    }
    // Sampled speeds are the fastest safe ones, up to rounding.
    if gap_m < required_m - 1e-9 {
        return Err(ScenarioError::Unsafe { follower, leader, gap_m, required_m });
    }
    Ok(())
}

/// A distribution over scenes: a seed gives a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScenarioDistribution {
    /// The road.
    pub road: RoadConfig,
    /// The traffic.
    pub traffic: TrafficConfig,
}

impl ScenarioDistribution {
    /// The scene of this seed.
    pub fn sample(&self, seed: u64) -> Result<Scenario, ScenarioError> {
        self.traffic.validate()?;
        let road = Arc::new(Road::new(self.road.clone())?);
        let draw = Draw { traffic: &self.traffic, road: &road, seed };
        let mut vehicles = Vec::new();
        for lane in road.lanes() {
            let first = vehicles.len();
            draw.fill_lane(lane, &mut vehicles)?;
            draw.slow_to_safety(&mut vehicles[first..]);
        }
        let warm_up_s = self.traffic.warm_up_s;
        let ego = EgoStart::LargestGap;
        let traffic = self.traffic.clone();
        Ok(Scenario { warm_up_s, ..Scenario::of_vehicles(road, traffic, vehicles, ego, seed) })
    }
}

/// Length of the ego that scenes assume when they place it, m.
pub(crate) fn ego_length_m() -> f64 {
    VehicleParams::default().length_m
}
