//! The world as a value, and its step.

use std::sync::Arc;

use lanecraft_net::random::Stream;
use pulp::Arch;
use serde::{Deserialize, Serialize};

use super::collision::{Collision, FaultClass, touch_in_step};
use super::command::{Command, Order};
use super::fleet::{Fleet, NEVER, Vehicle, steps};
use super::following::{Leaders, Obstacle};
use super::script::Script;
use crate::models::car_following::Leader;
use crate::models::safe_distance::BrakingLimits;
use crate::road::{LaneIndex, Road, Topology};
use crate::scenario::{Scenario, ScenarioError, TrafficConfig, VehicleSpec};
use crate::scene::VehicleId;

/// Step of the warm-up where none is named, s.
const WARM_UP_STEP_S: f64 = 0.05;
/// Stress: how far ahead of the ego cars brake, m.
const STRESS_RANGE_M: f64 = 80.0;
/// Stress: for how long they brake, s.
const STRESS_DURATION_S: f64 = 3.0;

/// An externally driven car, as the traffic sees it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExternalBody {
    /// Position of its center along the road, m.
    pub s_m: f64,
    /// Position of its center to the left of the reference line, m.
    pub d_m: f64,
    /// Heading relative to the road, rad, positive to the left.
    pub heading_rad: f64,
    /// Speed along its heading, m/s.
    pub speed_mps: f64,
    /// Acceleration along its heading, m/s².
    pub accel_mps2: f64,
    /// Length, m.
    pub length_m: f64,
    /// Width, m.
    pub width_m: f64,
    /// The lane that it keeps or changes into.
    pub target_lane: LaneIndex,
}

/// What happened in a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[must_use]
pub struct StepEvents {
    /// The ego touched a vehicle.
    pub collision: Option<Collision>,
    /// Pairs of human-driven vehicles that touched; always 0, counted to prove it.
    pub hdv_overlaps: u32,
    /// Lane changes that human drivers started.
    pub lane_changes: u32,
}

/// The ego as the world keeps it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Ego {
    body: ExternalBody,
    /// Speed along the road, m/s.
    pub(super) speed_mps: f64,
    /// Half sides of its bounding box along and across the road, m.
    half_m: (f64, f64),
    /// Lanes that its body touches or that it changes into, as bits.
    lane_bits: u8,
    /// The step in which it last changed its target lane or crossed a lane line.
    changed_step: i64,
}

impl Ego {
    fn new(body: ExternalBody, road: &Road) -> Self {
        let (sin, cos) = libm::sincos(body.heading_rad);
        let half_m = (
            0.5 * (body.length_m * cos.abs() + body.width_m * sin.abs()),
            0.5 * (body.length_m * sin.abs() + body.width_m * cos.abs()),
        );
        let reach_m = 0.5 * road.lane_width_m() + half_m.1;
        let touched = road.lanes().filter(|&lane| (body.d_m - road.lane_center_m(lane)).abs() < reach_m);
        let lane_bits = touched
            .fold(1_u8.checked_shl(u32::from(body.target_lane.0)).unwrap_or(0), |bits, lane| bits | (1 << lane.0));
        let body = ExternalBody { s_m: road.wrap_m(body.s_m), ..body };
        Self { body, speed_mps: (body.speed_mps * cos).max(0.0), half_m, lane_bits, changed_step: NEVER }
    }

    /// What drivers follow if it is this far ahead.
    pub(super) fn as_leader(&self, gap_m: f64) -> Leader {
        Leader { gap_m, speed_mps: self.speed_mps, accel_mps2: self.body.accel_mps2 }
    }

    pub(super) fn occupies(&self, lane: u8) -> bool {
        self.lane_bits & (1 << lane) != 0
    }

    /// Whether it is in `lane` and does not signal to leave it.
    pub(super) fn keeps(&self, lane: LaneIndex) -> bool {
        self.body.target_lane == lane && self.occupies(lane.0)
    }

    pub(super) fn s_m(&self) -> f64 {
        self.body.s_m
    }

    pub(super) fn d_m(&self) -> f64 {
        self.body.d_m
    }

    pub(super) fn half_length_m(&self) -> f64 {
        self.half_m.0
    }

    pub(super) fn half_width_m(&self) -> f64 {
        self.half_m.1
    }

    /// Whether its center is ahead of that of the vehicle in slot `i`, and the gap between them, m.
    pub(super) fn gap_m(&self, fleet: &Fleet, i: usize) -> (bool, f64) {
        let ahead_m = fleet.signed_ahead_m(fleet.s_m[i], self.body.s_m);
        (ahead_m >= 0.0, ahead_m.abs() - fleet.half_length_m[i] - self.half_m.0)
    }

    pub(super) fn digest_words(&self, now: i64) -> [u64; 6] {
        let body = &self.body;
        let since = if self.changed_step == NEVER { i64::from(u32::MAX) } else { now - self.changed_step };
        [
            body.s_m.to_bits(),
            body.d_m.to_bits(),
            body.heading_rad.to_bits(),
            body.speed_mps.to_bits(),
            body.accel_mps2.to_bits(),
            (since as u64) << 32 | u64::from(self.lane_bits) << 8 | u64::from(body.target_lane.0),
        ]
    }
}

/// The traffic and the ego's body in it: a value that continues bit for bit from any copy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct World {
    pub(super) road: Arc<Road>,
    pub(super) traffic: TrafficConfig,
    pub(super) fleet: Fleet,
    pub(super) leaders: Leaders,
    /// By rising position.
    pub(super) obstacles: Vec<Obstacle>,
    /// Commands under way, by rising id.
    pub(super) orders: Vec<Order>,
    pub(super) ego: Option<Ego>,
    /// The present step; negative during the warm-up.
    pub(super) now: i64,
    /// How hard a human driver, and the ego, are trusted to brake at most.
    trust: [BrakingLimits; 2],
    seed: u64,
    ego_start: (f64, LaneIndex, f64),
    /// What the scenario has happen later, if anything.
    pub(super) script: Option<Box<Script>>,
}

impl World {
    /// The world of a scene after its warm-up, with a place found for the ego, which does not stand there yet.
    ///
    /// # Errors
    /// If the scene is impossible or unsafe.
    pub fn new(scenario: &Scenario) -> Result<Self, ScenarioError> {
        Self::with_step(scenario, WARM_UP_STEP_S)
    }

    /// The same for a world that is then stepped by `step_s`: the warm-up takes that step, too, and the drivers' first pauses are counted
    /// in it.
    ///
    /// # Errors
    /// If the scene is impossible or unsafe.
    pub fn with_step(scenario: &Scenario, step_s: f64) -> Result<Self, ScenarioError> {
        scenario.traffic.validate()?;
        scenario.check()?;
        let road = &scenario.road;
        let ring_m = if road.config().topology == Topology::Ring { road.config().length_m } else { f64::INFINITY };
        let start = -((scenario.warm_up_s / step_s).round() as i64);
        let free_step = |spec: &VehicleSpec| start + i64::from(steps(spec.cooldown_s, step_s));
        let free_steps: Vec<i64> = scenario.vehicles.iter().map(free_step).collect();
        let mut world = Self {
            road: Arc::clone(road),
            traffic: scenario.traffic.clone(),
            fleet: Fleet::new(&scenario.vehicles, &free_steps, road, ring_m),
            leaders: Leaders::default(),
            obstacles: Vec::new(),
            orders: Vec::new(),
            ego: None,
            now: start,
            trust: [false, true].map(|ego| scenario.traffic.braking_limits(0.0, ego, road)),
            seed: scenario.seed,
            ego_start: (0.0, LaneIndex(0), 0.0),
            script: Script::new(scenario),
        };
        world.leaders.resize(world.fleet.len());
        while world.now < 0 {
            let _ = world.step_alone(step_s);
        }
        world.begin_script();
        world.ego_start = world.place_ego(scenario)?;
        Ok(world)
    }

    /// Where the ego is to start: position in m, lane, speed in m/s.
    pub fn ego_start(&self) -> (f64, LaneIndex, f64) {
        self.ego_start
    }

    /// Puts the ego into the world.
    pub fn set_ego(&mut self, ego: ExternalBody) {
        self.ego = Some(Ego::new(ego, &self.road));
    }

    /// Puts a vehicle on the road between two steps and returns its id, which no other ever had. Nobody asks whether it is safe there:
    /// see [`Self::has_room_for`]. `dt_s` counts its pause before the first lane change.
    pub fn insert(&mut self, spec: &VehicleSpec, dt_s: f64) -> VehicleId {
        debug_assert!(self.road.lanes().any(|lane| lane == spec.lane), "there is no {:?}", spec.lane);
        let free_step = self.now + i64::from(steps(spec.cooldown_s, dt_s));
        let id = self.fleet.insert(spec, &self.road, free_step);
        self.leaders.resize(self.fleet.len());
        id
    }

    /// Takes a vehicle off the road between two steps; returns whether there was one of this id.
    pub fn remove(&mut self, id: VehicleId) -> bool {
        let found = self.fleet.remove(id);
        self.leaders.resize(self.fleet.len());
        self.end_orders();
        found
    }

    /// What stands in the lanes from now on and is no vehicle.
    pub fn set_obstacles(&mut self, mut obstacles: Vec<Obstacle>) {
        obstacles.sort_by(|a, b| a.s_m.total_cmp(&b.s_m).then(a.lane.cmp(&b.lane)));
        self.obstacles = obstacles;
    }

    /// One step of `dt_s`, the same in every call, for changes and pauses are counted in steps: human drivers decide on the present
    /// state, then all move; `ego` is the ego's body after the step.
    pub fn step(&mut self, ego: ExternalBody, dt_s: f64) -> StepEvents {
        debug_assert!([ego.s_m, ego.d_m, ego.heading_rad, ego.speed_mps].iter().all(|value| value.is_finite()));
        self.run_script(dt_s);
        self.end_orders();
        self.start_stress_brakes(dt_s);
        let (lane_changes, hdv_overlaps) = self.step_humans(dt_s);
        let mut next = Ego::new(ego, &self.road);
        let last = self.ego.take().unwrap_or_else(|| next.clone());
        let crossed = self.road.nearest_lane(last.body.d_m) != self.road.nearest_lane(ego.d_m);
        let changed = crossed || last.body.target_lane != ego.target_lane;
        self.now += 1;
        next.changed_step = if changed { self.now } else { last.changed_step };
        let collision = self.find_collision(&last, &next, dt_s);
        self.ego = Some(next);
        StepEvents { collision, hdv_overlaps, lane_changes }
    }

    /// One step of a road without an ego.
    pub fn step_alone(&mut self, dt_s: f64) -> StepEvents {
        self.ego = None;
        if self.now >= 0 {
            self.run_script(dt_s);
        }
        self.end_orders();
        let (lane_changes, hdv_overlaps) = self.step_humans(dt_s);
        self.now += 1;
        StepEvents { collision: None, hdv_overlaps, lane_changes }
    }

    /// Human drivers decide and move; returns the lane changes started and the pairs that touched.
    fn step_humans(&mut self, dt_s: f64) -> (u32, u32) {
        self.step_humans_on(Arch::new(), dt_s)
    }

    /// The same with the vectors of a given processor, which give the same bits.
    fn step_humans_on(&mut self, arch: Arch, dt_s: f64) -> (u32, u32) {
        let lane_changes = self.choose_lanes(dt_s);
        self.find_leaders();
        self.follow_leaders(arch, dt_s);
        self.heed_road(dt_s);
        self.obey();
        self.advance(arch, dt_s);
        self.follow_tracks();
        self.fleet.sort();
        (lane_changes, self.fleet.count_overlaps(arch))
    }

    /// Cars near ahead of the ego, in its lane and beside it, begin a full brake at random.
    fn start_stress_brakes(&mut self, dt_s: f64) {
        let rate_hz = self.traffic.stress_brake_rate_hz;
        let Some(ego) = self.ego.as_ref().filter(|_| rate_hz > 0.0) else { return };
        let (fleet, body, beside_m) = (&self.fleet, ego.body, 1.5 * self.road.lane_width_m());
        let draws = fleet.near(body.s_m, STRESS_RANGE_M).filter(|&i| {
            let ahead_m = fleet.signed_ahead_m(body.s_m, fleet.s_m[i]);
            ahead_m > 0.0 && ahead_m < STRESS_RANGE_M && (fleet.d_m[i] - body.d_m).abs() < beside_m
        });
        let brakes = draws.map(|i| VehicleId(fleet.id[i])).filter(|&id| {
            let mut stream = Stream::keyed(self.seed, "traffic.stress", u64::from(id.0), self.time_step());
            !self.is_commanded(id) && stream.bernoulli(rate_hz * dt_s)
        });
        for id in brakes.collect::<Vec<_>>() {
            let steps = steps(STRESS_DURATION_S, dt_s);
            self.command(id, Command::Accelerate { accel_mps2: f64::NEG_INFINITY, steps });
        }
    }

    /// The first vehicle, by id, that the ego touched in the step.
    fn find_collision(&self, last: &Ego, ego: &Ego, dt_s: f64) -> Option<Collision> {
        let fleet = &self.fleet;
        let ego_moved_m = (fleet.signed_ahead_m(last.body.s_m, ego.body.s_m), ego.body.d_m - last.body.d_m);
        // The larger of the boxes before and after.
        let half_m = (ego.half_m.0.max(last.half_m.0), ego.half_m.1.max(last.half_m.1));
        let touched = fleet.near(ego.body.s_m, fleet.reach_m() + half_m.0 + ego_moved_m.0.abs()).filter(|&i| {
            let end_m = (fleet.signed_ahead_m(ego.body.s_m, fleet.s_m[i]), fleet.d_m[i] - ego.body.d_m);
            let moved_m = (fleet.moved_m[i] - ego_moved_m.0, fleet.moved_left_m[i] - ego_moved_m.1);
            let reach_m = (fleet.half_length_m[i] + half_m.0, fleet.half_width_m[i] + half_m.1);
            touch_in_step(end_m, moved_m, reach_m)
        });
        let with = touched.min_by_key(|&i| fleet.id[i])?;
        let since_s = |step: i64| if step == NEVER { f64::INFINITY } else { (self.now - step) as f64 * dt_s };
        let other_ahead = fleet.signed_ahead_m(ego.body.s_m, fleet.s_m[with]) >= 0.0;
        let fault = FaultClass::judge(other_ahead, since_s(ego.changed_step), since_s(fleet.changed_step[with]));
        Some(Collision { with: VehicleId(fleet.id[with]), fault })
    }

    /// The law of the safe distance for slot `i`.
    pub(super) fn limits(&self, i: usize, behind_ego: bool) -> BrakingLimits {
        BrakingLimits { follower_mps2: self.fleet.max_brake_mps2[i], ..self.trust(behind_ego) }
    }

    /// The law of the safe distance, but for the follower's braking.
    pub(super) fn trust(&self, behind_ego: bool) -> BrakingLimits {
        self.trust[usize::from(behind_ego)]
    }

    /// Number of human-driven vehicles.
    pub fn len(&self) -> usize {
        self.fleet.len()
    }

    /// Whether there is no human-driven vehicle.
    pub fn is_empty(&self) -> bool {
        self.fleet.len() == 0
    }

    /// The human-driven vehicle with this id, if it is on the road.
    pub fn vehicle(&self, id: VehicleId) -> Option<Vehicle> {
        self.fleet.slot(id).map(|slot| self.fleet.vehicle(slot))
    }

    /// All human-driven vehicles by rising id.
    pub fn vehicles(&self) -> impl Iterator<Item = Vehicle> + '_ {
        self.fleet.by_id().map(|slot| self.fleet.vehicle(slot))
    }

    /// The human-driven vehicles not further than `range_m` from a place, along the road.
    pub fn vehicles_near(&self, s_m: f64, range_m: f64) -> impl Iterator<Item = Vehicle> + '_ {
        self.fleet.near(self.road.wrap_m(s_m), range_m).map(|slot| self.fleet.vehicle(slot))
    }

    /// Seed of the scenario.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Steps since the start.
    pub fn time_step(&self) -> u64 {
        self.now.max(0) as u64
    }

    /// The road.
    pub fn road(&self) -> &Arc<Road> {
        &self.road
    }
}

#[cfg(test)]
mod tests {
    use pulp::Arch;

    use super::World;
    use crate::road::RoadConfig;
    use crate::scenario::{ScenarioDistribution, TrafficConfig};

    #[test]
    fn every_vector_width_gives_the_same_bits() {
        let mut archs = vec![Arch::Scalar, Arch::new()];
        #[cfg(target_arch = "x86_64")]
        archs.extend(pulp::x86::V3::try_new().map(Arch::V3));
        let traffic = TrafficConfig { truck_share: 0.2, density_veh_per_km_lane: 23.0, ..TrafficConfig::default() };
        let distribution = ScenarioDistribution { road: RoadConfig::default(), traffic };
        let start = distribution.sample(4).and_then(|scenario| World::new(&scenario)).expect("possible");
        let after = archs.into_iter().map(|arch| {
            let mut world = start.clone();
            for _ in 0..600 {
                assert_eq!(world.step_humans_on(arch, 0.05).1, 0);
                world.now += 1;
            }
            world
        });
        let after: Vec<_> = after.collect();
        assert!(after.iter().all(|world| *world == after[0]));
    }
}
