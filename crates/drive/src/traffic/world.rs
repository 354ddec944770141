//! The world as a value, and its step.

use std::sync::Arc;

use lanecraft_net::random::Stream;

use super::collision::{Collision, FaultClass, touch_in_step};
use super::fleet::{Fleet, Vehicle, steps};
use super::neighbors::Neighbors;
use crate::models::idm::{idm_accel, idm_free_accel};
use crate::models::safe_distance::BrakingLimits;
use crate::road::{LaneIndex, Road, Topology};
use crate::scenario::{Scenario, ScenarioError, TrafficConfig};
use crate::scene::VehicleId;

/// Step of the warm-up, s.
const WARM_UP_STEP_S: f64 = 0.05;
/// Stress: how far ahead of the ego cars brake, m.
const STRESS_RANGE_M: f64 = 80.0;
/// Stress: for how long they brake, s.
const STRESS_DURATION_S: f64 = 3.0;

/// An externally driven car, as the traffic sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
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
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ego {
    body: ExternalBody,
    /// Speed along the road, m/s.
    pub(super) speed_mps: f64,
    /// Half sides of its bounding box along and across the road, m.
    half_m: (f64, f64),
    /// Lanes that its body touches or that it changes into, as bits.
    lane_bits: u8,
    /// Steps since it last changed its target lane or crossed a lane line; saturates.
    since_change_steps: u32,
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
        Self { body, speed_mps: (body.speed_mps * cos).max(0.0), half_m, lane_bits, since_change_steps: u32::MAX }
    }

    pub(super) fn occupies(&self, lane: u8) -> bool {
        self.lane_bits & (1 << lane) != 0
    }
}

/// The traffic and the ego's body in it: a value that continues bit for bit from any copy.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    pub(super) road: Arc<Road>,
    pub(super) traffic: TrafficConfig,
    pub(super) fleet: Fleet,
    pub(super) neighbors: Neighbors,
    pub(super) ego: Option<Ego>,
    pub(super) time_step: u64,
    /// How hard a human driver, and the ego, are trusted to brake at most.
    trust: [BrakingLimits; 2],
    /// Length of the ring, infinite on an open road, m.
    ring_m: f64,
    seed: u64,
    ego_start: (f64, LaneIndex, f64),
}

impl World {
    /// The world of a scene after its warm-up, with a place found for the ego, which does not stand there yet.
    ///
    /// # Errors
    /// If the scene is impossible or unsafe.
    pub fn new(scenario: &Scenario) -> Result<Self, ScenarioError> {
        scenario.traffic.validate()?;
        scenario.check()?;
        let ring = scenario.road.config().topology == Topology::Ring;
        let fleet = Fleet::new(scenario, WARM_UP_STEP_S);
        let mut world = Self {
            road: Arc::clone(&scenario.road),
            traffic: scenario.traffic.clone(),
            neighbors: Neighbors::new(&fleet, ring),
            fleet,
            ego: None,
            time_step: 0,
            ring_m: if ring { scenario.road.config().length_m } else { f64::INFINITY },
            trust: [false, true].map(|ego| scenario.traffic.braking_limits(0.0, ego, scenario.road.adhesion())),
            seed: scenario.seed,
            ego_start: (0.0, LaneIndex(0), 0.0),
        };
        for _ in 0..(scenario.warm_up_s / WARM_UP_STEP_S).round() as u64 {
            let _ = world.step_humans(WARM_UP_STEP_S);
            world.time_step += 1;
        }
        world.time_step = 0;
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

    /// One step of `dt_s`, the same in every call, for changes and pauses are counted in steps: human drivers decide on the present state, then all move; `ego` is the ego's
    /// body after the step.
    pub fn step(&mut self, ego: ExternalBody, dt_s: f64) -> StepEvents {
        debug_assert!([ego.s_m, ego.d_m, ego.heading_rad, ego.speed_mps].iter().all(|value| value.is_finite()));
        self.start_stress_brakes(dt_s);
        let (lane_changes, hdv_overlaps) = self.step_humans(dt_s);
        let mut next = Ego::new(ego, &self.road);
        let last = self.ego.take().unwrap_or_else(|| next.clone());
        let crossed = self.road.nearest_lane(last.body.d_m) != self.road.nearest_lane(ego.d_m);
        let changed = crossed || last.body.target_lane != ego.target_lane;
        next.since_change_steps = if changed { 0 } else { last.since_change_steps.saturating_add(1) };
        let collision = self.find_collision(&last, &next, dt_s);
        self.ego = Some(next);
        self.time_step += 1;
        StepEvents { collision, hdv_overlaps, lane_changes }
    }

    /// Human drivers decide and move; returns the lane changes started and the pairs that touched.
    fn step_humans(&mut self, dt_s: f64) -> (u32, u32) {
        self.neighbors.sweep(&self.fleet);
        let lane_changes = self.choose_lanes(dt_s);
        for i in 0..self.fleet.len() {
            self.fleet.accel_mps2[i] = self.demand_mps2(i, dt_s);
        }
        for i in 0..self.fleet.len() {
            self.fleet.advance(i, &self.road, self.ring_m, dt_s);
        }
        self.neighbors.sort(&self.fleet);
        (lane_changes, self.count_overlaps())
    }

    /// IDM towards the leaders of all occupied lanes, the ego included, below what keeps the distances safe.
    fn demand_mps2(&self, i: usize, dt_s: f64) -> f64 {
        let fleet = &self.fleet;
        let brake_mps2 = fleet.max_brake_mps2[i];
        if fleet.brake_steps[i] > 0 {
            return -brake_mps2;
        }
        let (speed_mps, driver) = (fleet.speed_mps[i], &fleet.driver[i]);
        let ego = self.ego.as_ref().filter(|ego| ego.lane_bits & fleet.lane_bits(i) != 0);
        let ego = ego.map(|ego| (ego, self.ego_gap_m(i, ego))).filter(|(_, (ahead, _))| *ahead);
        let lanes = [fleet.lane[i], fleet.target_lane[i]];
        let mut accel_mps2 = idm_free_accel(speed_mps, driver);
        for &lane in if lanes[0] == lanes[1] { &lanes[..1] } else { &lanes[..] } {
            let mut nearest_m = f64::INFINITY;
            if let Some(j) = self.neighbors.ahead(i, lane) {
                let leader_mps = fleet.speed_mps[j];
                nearest_m = self.gap_m(i, j);
                let safe_mps2 = self.limits(i, false).safe_accel_mps2(nearest_m, speed_mps, leader_mps, dt_s);
                let wish_mps2 = idm_accel(nearest_m, speed_mps, speed_mps - leader_mps, driver);
                accel_mps2 = accel_mps2.min(wish_mps2).min(safe_mps2);
            }
            // The ego never hides a vehicle, for it may do anything: both are leaders.
            if let Some((ego, (_, gap_m))) = ego.filter(|(ego, (_, gap_m))| ego.occupies(lane) && *gap_m < nearest_m) {
                let safe_mps2 = self.limits(i, true).safe_accel_mps2(gap_m, speed_mps, ego.speed_mps, dt_s);
                let wish_mps2 = idm_accel(gap_m, speed_mps, speed_mps - ego.speed_mps, driver);
                accel_mps2 = accel_mps2.min(wish_mps2).min(safe_mps2);
            }
        }
        accel_mps2.max(-brake_mps2)
    }

    /// Cars near ahead of the ego, in its lane and beside it, begin a full brake at random.
    fn start_stress_brakes(&mut self, dt_s: f64) {
        let rate_hz = self.traffic.stress_brake_rate_hz;
        let Some(ego) = self.ego.as_ref().filter(|_| rate_hz > 0.0) else { return };
        let beside_m = 1.5 * self.road.lane_width_m();
        for i in 0..self.fleet.len() {
            let ahead_m = self.signed_ahead_m(ego.body.s_m, self.fleet.s_m[i]);
            let near = ahead_m > 0.0 && ahead_m < STRESS_RANGE_M && (self.fleet.d_m[i] - ego.body.d_m).abs() < beside_m;
            if !near || self.fleet.brake_steps[i] > 0 {
                continue;
            }
            let mut stream = Stream::keyed(self.seed, "traffic.stress", i as u64, self.time_step);
            if stream.bernoulli(rate_hz * dt_s) {
                self.fleet.brake_steps[i] = steps(STRESS_DURATION_S, dt_s);
            }
        }
    }

    /// Pairs of human-driven vehicles that touched in the last step.
    fn count_overlaps(&self) -> u32 {
        let fleet = &self.fleet;
        let order = self.neighbors.order();
        let longest_m = fleet.half_length_m.iter().copied().fold(0.0, f64::max);
        let fastest_m = fleet.moved_m.iter().map(|moved| moved.0).fold(0.0, f64::max);
        let mut overlaps = 0;
        for (k, &i) in order.iter().enumerate() {
            let i = i as usize;
            let reach_m = fleet.half_length_m[i] + longest_m + fastest_m;
            // On a ring the last is followed by the first; on an open road those are behind, which ends the search as well.
            for &j in order[k + 1..].iter().chain(&order[..k]) {
                let j = j as usize;
                let ahead_m = self.ahead_m(fleet.s_m[i], fleet.s_m[j]);
                if !(0.0..reach_m).contains(&ahead_m) {
                    break;
                }
                let end_m = (ahead_m, fleet.d_m[j] - fleet.d_m[i]);
                let moved_m = (fleet.moved_m[j].0 - fleet.moved_m[i].0, fleet.moved_m[j].1 - fleet.moved_m[i].1);
                let sums_m =
                    (fleet.half_length_m[i] + fleet.half_length_m[j], fleet.half_width_m[i] + fleet.half_width_m[j]);
                overlaps += u32::from(touch_in_step(end_m, moved_m, sums_m));
            }
        }
        overlaps
    }

    /// The first vehicle, by id, that the ego touched in the step.
    fn find_collision(&self, last: &Ego, ego: &Ego, dt_s: f64) -> Option<Collision> {
        let fleet = &self.fleet;
        let ego_moved_m = (self.signed_ahead_m(last.body.s_m, ego.body.s_m), ego.body.d_m - last.body.d_m);
        // The larger of the boxes before and after.
        let half_m = (ego.half_m.0.max(last.half_m.0), ego.half_m.1.max(last.half_m.1));
        let with = (0..fleet.len()).find(|&i| {
            let end_m = (self.signed_ahead_m(ego.body.s_m, fleet.s_m[i]), fleet.d_m[i] - ego.body.d_m);
            let moved_m = (fleet.moved_m[i].0 - ego_moved_m.0, fleet.moved_m[i].1 - ego_moved_m.1);
            let reach_m = (fleet.half_length_m[i] + half_m.0, fleet.half_width_m[i] + half_m.1);
            touch_in_step(end_m, moved_m, reach_m)
        })?;
        let since_s = |count: u32| if count == u32::MAX { f64::INFINITY } else { f64::from(count) * dt_s };
        let other_ahead = self.signed_ahead_m(ego.body.s_m, fleet.s_m[with]) >= 0.0;
        let since_ego_s = since_s(ego.since_change_steps);
        let fault = FaultClass::judge(other_ahead, since_ego_s, since_s(fleet.since_change_steps[with]));
        Some(Collision { with: VehicleId(with as u32), fault })
    }

    /// The law of the safe distance for vehicle `i`.
    pub(super) fn limits(&self, i: usize, behind_ego: bool) -> BrakingLimits {
        BrakingLimits { follower_mps2: self.fleet.max_brake_mps2[i], ..self.trust[usize::from(behind_ego)] }
    }

    /// How far `to_m` lies ahead, never behind on a ring, m. Both positions are wrapped.
    fn ahead_m(&self, from_m: f64, to_m: f64) -> f64 {
        let ahead_m = to_m - from_m;
        if ahead_m < 0.0 && self.ring_m.is_finite() { ahead_m + self.ring_m } else { ahead_m }
    }

    /// How far `to_m` lies ahead, negative behind, by the shorter way on a ring, m. Both positions are wrapped.
    pub(super) fn signed_ahead_m(&self, from_m: f64, to_m: f64) -> f64 {
        let ahead_m = to_m - from_m;
        if ahead_m > 0.5 * self.ring_m {
            ahead_m - self.ring_m
        } else if ahead_m < -0.5 * self.ring_m {
            ahead_m + self.ring_m
        } else {
            ahead_m
        }
    }

    /// Bumper-to-bumper gap from vehicle `i` to vehicle `j` ahead of it, m.
    pub(super) fn gap_m(&self, i: usize, j: usize) -> f64 {
        let fleet = &self.fleet;
        self.ahead_m(fleet.s_m[i], fleet.s_m[j]) - fleet.half_length_m[i] - fleet.half_length_m[j]
    }

    /// Whether the ego's center is ahead of vehicle `i`'s, and the gap between them, m.
    pub(super) fn ego_gap_m(&self, i: usize, ego: &Ego) -> (bool, f64) {
        let ahead_m = self.signed_ahead_m(self.fleet.s_m[i], ego.body.s_m);
        (ahead_m >= 0.0, ahead_m.abs() - self.fleet.half_length_m[i] - ego.half_m.0)
    }

    /// Number of human-driven vehicles.
    pub fn len(&self) -> usize {
        self.fleet.len()
    }

    /// Whether there is no human-driven vehicle.
    pub fn is_empty(&self) -> bool {
        self.fleet.len() == 0
    }

    /// The human-driven vehicle with this index, which is its id.
    ///
    /// # Panics
    /// If there is none.
    pub fn vehicle(&self, index: usize) -> Vehicle {
        self.fleet.vehicle(index)
    }

    /// All human-driven vehicles by rising id.
    pub fn vehicles(&self) -> impl ExactSizeIterator<Item = Vehicle> + '_ {
        (0..self.fleet.len()).map(|i| self.fleet.vehicle(i))
    }

    /// Seed of the scenario.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Steps since the start.
    pub fn time_step(&self) -> u64 {
        self.time_step
    }

    /// The road.
    pub fn road(&self) -> &Arc<Road> {
        &self.road
    }

    /// A hash of all bits that determine what follows (FNV-1a over 64-bit words).
    pub fn digest(&self) -> u64 {
        let mut hash = 0xCBF2_9CE4_8422_2325_u64;
        let mut add = |word: u64| hash = (hash ^ word).wrapping_mul(0x0000_0100_0000_01B3);
        add(self.time_step);
        add(self.seed);
        if let Some(ego) = &self.ego {
            let body = &ego.body;
            let values = [body.s_m, body.d_m, body.heading_rad, body.speed_mps, body.accel_mps2];
            for value in values {
                add(value.to_bits());
            }
            add(u64::from(ego.since_change_steps) << 32
                | u64::from(ego.lane_bits) << 8
                | u64::from(body.target_lane.0));
        }
        let fleet = &self.fleet;
        for i in 0..fleet.len() {
            let values =
                [fleet.s_m[i], fleet.d_m[i], fleet.speed_mps[i], fleet.lateral_speed_mps[i], fleet.accel_mps2[i]];
            for value in values {
                add(value.to_bits());
            }
            add(u64::from(fleet.lane[i]) << 8 | u64::from(fleet.target_lane[i]));
            add(u64::from(fleet.change[i].done_steps) << 32 | u64::from(fleet.change[i].total_steps));
            add(u64::from(fleet.cooldown_steps[i]) << 32 | u64::from(fleet.since_change_steps[i]));
            add(u64::from(fleet.brake_steps[i]));
        }
        hash
    }
}
