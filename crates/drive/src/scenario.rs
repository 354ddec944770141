//! Scenes and distributions over scenes, from text.
//!
//! A [`Scenario`] is a plain value: the road, every vehicle with its driver, where the ego starts, and the seed of what is drawn
//! later. It comes from a [`ScenarioFile`], which is strict TOML, or from a [`ScenarioDistribution`] and a seed.

use std::fmt;
use std::sync::Arc;

use lanecraft_net::random::Stream;
use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_order, check_range};
use crate::models::idm::IdmParams;
use crate::models::safe_distance::BrakingLimits;
use crate::road::{LaneIndex, Road, RoadConfig, Topology};
use crate::vehicle::VehicleParams;

/// Standard gravity, m/s².
const GRAVITY_MPS2: f64 = 9.81;
/// Share of the adhesion that braking can use: the rest keeps the wheels rolling and the vehicle on its path.
const USABLE_ADHESION: f64 = 0.95;
/// Gap left between two standing vehicles by the law of the safe distance, m.
const SAFE_MARGIN_M: f64 = 1.0;
/// Sampled vehicles start at this share of their desired speed, as far as that is safe.
const START_SPEED_SHARE: f64 = 0.95;
/// A driver's first lane change comes at the earliest after a time drawn from 0 to this, s.
const FIRST_COOLDOWN_S: f64 = 4.0;

/// What kind of vehicle a human drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VehicleKind {
    /// 4.8 m × 1.9 m.
    Car,
    /// 12 m × 2.5 m: the longest and widest rigid truck allowed on Chinese (and European) roads.
    Truck,
}

impl VehicleKind {
    /// Length, m.
    pub fn length_m(self) -> f64 {
        match self {
            Self::Car => 4.8,
            Self::Truck => 12.0,
        }
    }

    /// Width, m.
    pub fn width_m(self) -> f64 {
        match self {
            Self::Car => 1.9,
            Self::Truck => 2.5,
        }
    }
}

/// The human drivers and how many there are. The paper names IDM and MOBIL and gives no number but the road's speed limits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrafficConfig {
    /// Vehicles per kilometer and lane: 14 leaves gaps; from 20 on the flow holds everybody near 20 m/s.
    pub density_veh_per_km_lane: f64,
    /// Half-width of the uniform range from which each scenario draws its density around the value above.
    pub density_spread_veh_per_km_lane: f64,
    /// Share of trucks. 0: the paper speaks of cars, and the published ceilings are those of cars.
    pub truck_share: f64,
    /// Slowest desired speed of a car v₀, m/s: below the limit, so that overtaking pays.
    pub desired_speed_min_mps: f64,
    /// Fastest desired speed of a car, m/s.
    pub desired_speed_max_mps: f64,
    /// Slowest desired speed of a truck, m/s.
    pub truck_desired_speed_min_mps: f64,
    /// Fastest desired speed of a truck, m/s (90 km/h, the usual limiter).
    pub truck_desired_speed_max_mps: f64,
    /// Shortest time headway T, s (Treiber 2000, Kesting 2007: 1 to 1.8).
    pub time_headway_min_s: f64,
    /// Longest time headway, s.
    pub time_headway_max_s: f64,
    /// Gap at standstill s₀, m (Treiber 2000).
    pub min_gap_m: f64,
    /// Acceleration of a car a_max, m/s².
    pub max_accel_mps2: f64,
    /// Acceleration of a truck, m/s².
    pub truck_max_accel_mps2: f64,
    /// Comfortable deceleration b, m/s² (positive).
    pub comfort_decel_mps2: f64,
    /// Hardest braking of a car on a dry road, m/s² (positive); 0.95 μ g bounds it further.
    pub max_brake_mps2: f64,
    /// Hardest braking of a truck, m/s² (positive): 5 m/s² is what heavy vehicles must reach.
    pub truck_max_brake_mps2: f64,
    /// Hardest braking that human drivers expect of the ego, m/s² (positive): the plant's limit.
    pub ego_max_brake_mps2: f64,
    /// MOBIL's weight p of the others' gain (Kesting 2007: 0 to 0.5).
    pub politeness: f64,
    /// MOBIL's threshold Δa_th, m/s².
    pub accel_gain_threshold_mps2: f64,
    /// MOBIL's hardest forced braking b_safe, m/s² (positive).
    pub safe_decel_mps2: f64,
    /// Time from the start of a lane change to the next one, s; stops ping-pong.
    pub lane_change_cooldown_s: f64,
    /// Duration of a lane change, s.
    pub lane_change_duration_s: f64,
    /// Time between two looks at the other lanes, s; vehicles look at different steps.
    pub lane_decision_period_s: f64,
    /// Whether human drivers cut in before the ego only at a distance safe for its delays, too.
    pub courteous: bool,
    /// Time that sampled traffic drives alone before the ego is placed, s.
    pub warm_up_s: f64,
    /// Largest random shift of a start position, in shares of the free space between vehicles.
    pub start_jitter: f64,
    /// Rate at which each car near ahead of the ego starts a full brake of 3 s, 1/s; for stress tests only.
    pub stress_brake_rate_hz: f64,
}

impl Default for TrafficConfig {
    fn default() -> Self {
        Self {
            density_veh_per_km_lane: 14.0,
            density_spread_veh_per_km_lane: 0.0,
            truck_share: 0.0,
            desired_speed_min_mps: 19.0,
            desired_speed_max_mps: 27.0,
            truck_desired_speed_min_mps: 20.0,
            truck_desired_speed_max_mps: 25.0,
            time_headway_min_s: 1.0,
            time_headway_max_s: 1.8,
            min_gap_m: 2.0,
            max_accel_mps2: 1.5,
            truck_max_accel_mps2: 0.8,
            comfort_decel_mps2: 2.0,
            max_brake_mps2: 7.0,
            truck_max_brake_mps2: 5.0,
            ego_max_brake_mps2: 8.0,
            politeness: 0.3,
            accel_gain_threshold_mps2: 0.2,
            safe_decel_mps2: 3.0,
            lane_change_cooldown_s: 6.0,
            lane_change_duration_s: 3.0,
            lane_decision_period_s: 0.5,
            courteous: false,
            warm_up_s: 5.0,
            start_jitter: 0.3,
            stress_brake_rate_hz: 0.0,
        }
    }
}

impl TrafficConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("traffic.density_veh_per_km_lane", self.density_veh_per_km_lane, 0.0, 200.0)?;
        let spread = self.density_spread_veh_per_km_lane;
        check_range("traffic.density_spread_veh_per_km_lane", spread, 0.0, self.density_veh_per_km_lane)?;
        check_range("traffic.truck_share", self.truck_share, 0.0, 1.0)?;
        check_range("traffic.start_jitter", self.start_jitter, 0.0, 0.5)?;
        check_range("traffic.warm_up_s", self.warm_up_s, 0.0, 600.0)?;
        check_range("traffic.stress_brake_rate_hz", self.stress_brake_rate_hz, 0.0, 10.0)?;
        self.validate_speeds()?;
        self.validate_driving()?;
        self.validate_lane_changes()
    }

    fn validate_speeds(&self) -> Result<(), ConfigError> {
        let car = [
            ("traffic.desired_speed_min_mps", self.desired_speed_min_mps),
            ("traffic.desired_speed_max_mps", self.desired_speed_max_mps),
        ];
        let truck = [
            ("traffic.truck_desired_speed_min_mps", self.truck_desired_speed_min_mps),
            ("traffic.truck_desired_speed_max_mps", self.truck_desired_speed_max_mps),
        ];
        for [low, high] in [car, truck] {
            check_range(low.0, low.1, 1.0, 60.0)?;
            check_range(high.0, high.1, 1.0, 60.0)?;
            check_order(low, high)?;
        }
        let low = ("traffic.time_headway_min_s", self.time_headway_min_s);
        let high = ("traffic.time_headway_max_s", self.time_headway_max_s);
        check_range(low.0, low.1, 0.1, 10.0)?;
        check_range(high.0, high.1, 0.1, 10.0)?;
        check_order(low, high)
    }

    fn validate_driving(&self) -> Result<(), ConfigError> {
        check_range("traffic.min_gap_m", self.min_gap_m, 0.0, 20.0)?;
        check_range("traffic.max_accel_mps2", self.max_accel_mps2, 0.1, 6.0)?;
        check_range("traffic.truck_max_accel_mps2", self.truck_max_accel_mps2, 0.1, 6.0)?;
        check_range("traffic.comfort_decel_mps2", self.comfort_decel_mps2, 0.1, 6.0)?;
        check_range("traffic.max_brake_mps2", self.max_brake_mps2, 2.0, 12.0)?;
        check_range("traffic.truck_max_brake_mps2", self.truck_max_brake_mps2, 2.0, 12.0)?;
        check_range("traffic.ego_max_brake_mps2", self.ego_max_brake_mps2, 2.0, 12.0)?;
        // The safe distance asks that nobody brakes harder than the vehicles ahead are trusted to.
        let truck = ("traffic.truck_max_brake_mps2", self.truck_max_brake_mps2);
        check_order(truck, ("traffic.max_brake_mps2", self.max_brake_mps2))
    }

    fn validate_lane_changes(&self) -> Result<(), ConfigError> {
        check_range("traffic.politeness", self.politeness, -1.0, 2.0)?;
        check_range("traffic.accel_gain_threshold_mps2", self.accel_gain_threshold_mps2, 0.0, 100.0)?;
        check_range("traffic.safe_decel_mps2", self.safe_decel_mps2, 0.1, 9.0)?;
        check_range("traffic.lane_change_cooldown_s", self.lane_change_cooldown_s, 0.0, 600.0)?;
        check_range("traffic.lane_change_duration_s", self.lane_change_duration_s, 0.5, 20.0)?;
        check_range("traffic.lane_decision_period_s", self.lane_decision_period_s, 0.01, 60.0)
    }

    /// Hardest braking of any human-driven vehicle on a road of this adhesion, m/s².
    pub fn hardest_brake_mps2(&self, adhesion: f64) -> f64 {
        limited_by_adhesion(self.max_brake_mps2, adhesion)
    }

    /// Hardest braking that human drivers expect of the ego on a road of this adhesion, m/s².
    pub fn expected_ego_brake_mps2(&self, adhesion: f64) -> f64 {
        limited_by_adhesion(self.ego_max_brake_mps2, adhesion).max(self.hardest_brake_mps2(adhesion))
    }

    /// The law of the safe distance for a vehicle that brakes this hard, behind another human driver or behind the ego.
    pub fn braking_limits(&self, follower_mps2: f64, behind_ego: bool, adhesion: f64) -> BrakingLimits {
        let leader_mps2 =
            if behind_ego { self.expected_ego_brake_mps2(adhesion) } else { self.hardest_brake_mps2(adhesion) };
        BrakingLimits { follower_mps2, leader_mps2, margin_m: SAFE_MARGIN_M }
    }
}

fn limited_by_adhesion(brake_mps2: f64, adhesion: f64) -> f64 {
    brake_mps2.min(USABLE_ADHESION * adhesion * GRAVITY_MPS2)
}

/// A vehicle written into a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleStart {
    /// Lane, from the right, starting at 0.
    pub lane: LaneIndex,
    /// Position of its center, m.
    pub s_m: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Desired speed v₀ of its driver, m/s.
    pub desired_speed_mps: f64,
    /// Car or truck.
    pub kind: VehicleKind,
}

/// Where the ego starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum EgoStart {
    /// In the middle of the largest gap of a random lane, at the speed of the vehicle ahead.
    #[default]
    LargestGap,
    /// Where it is written.
    At {
        /// Lane, from the right, starting at 0.
        lane: LaneIndex,
        /// Position of its center, m.
        s_m: f64,
        /// Speed, m/s.
        speed_mps: f64,
    },
}

/// A scene as a file: either every vehicle is written, or `vehicles` is empty and they are drawn from `traffic`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioFile {
    /// Short name.
    pub name: String,
    /// What happens, in a sentence or two.
    pub description: String,
    /// The road.
    #[serde(default)]
    pub road: RoadConfig,
    /// The drivers.
    #[serde(default)]
    pub traffic: TrafficConfig,
    /// The ego's start.
    #[serde(default)]
    pub ego: EgoStart,
    /// Written vehicles.
    #[serde(default)]
    pub vehicles: Vec<VehicleStart>,
}

impl ScenarioFile {
    /// Reads a file's text; unknown keys are errors.
    pub fn from_toml(text: &str) -> Result<Self, ScenarioError> {
        let file: Self = toml::from_str(text).map_err(ScenarioError::Parse)?;
        file.road.validate()?;
        file.traffic.validate()?;
        Ok(file)
    }

    /// The scene with every driver drawn from `seed`.
    pub fn scenario(&self, seed: u64) -> Result<Scenario, ScenarioError> {
        if self.vehicles.is_empty() {
            let distribution = ScenarioDistribution { road: self.road.clone(), traffic: self.traffic.clone() };
            return Ok(Scenario { ego: self.ego, ..distribution.sample(seed)? });
        }
        self.traffic.validate()?;
        let road = Arc::new(Road::new(self.road.clone())?);
        let draw = Draw { traffic: &self.traffic, adhesion: road.adhesion(), seed };
        let vehicles = self.vehicles.iter().enumerate().map(|(id, start)| draw.written(id, start)).collect();
        Ok(Scenario { road, traffic: self.traffic.clone(), vehicles, ego: self.ego, warm_up_s: 0.0, seed })
    }
}

/// Everything about a human-driven vehicle at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// Hardest braking on this road, m/s² (positive).
    pub max_brake_mps2: f64,
    /// Time to its first possible lane change, s.
    pub cooldown_s: f64,
}

/// A scene: a plain value that determines all that follows.
#[derive(Clone, Debug, PartialEq)]
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
    /// Seed of what is drawn later: the ego's lane, the stress.
    pub seed: u64,
}

impl Scenario {
    /// Checks that every lane exists, that nobody overlaps and that every distance is safe.
    pub fn check(&self) -> Result<(), ScenarioError> {
        if self.vehicles.is_empty() {
            return Err(ScenarioError::EmptyRoad);
        }
        let (first_m, last_m) = match self.road.config().topology {
            Topology::Ring => (0.0, self.road.config().length_m),
            Topology::Open => (-1e5, 1e5),
        };
        for (index, vehicle) in self.vehicles.iter().enumerate() {
            check_lane(&self.road, vehicle.lane, Party::Vehicle(index as u32))?;
            check_range("vehicles.s_m", vehicle.s_m, first_m, last_m)?;
            check_range("vehicles.speed_mps", vehicle.speed_mps, 0.0, 60.0)?;
            check_range("vehicles.desired_speed_mps", vehicle.driver.desired_speed_mps, 1.0, 60.0)?;
        }
        if let EgoStart::At { lane, s_m, speed_mps } = self.ego {
            check_lane(&self.road, lane, Party::Ego)?;
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
            let limits = self.traffic.braking_limits(follower.max_brake_mps2, false, self.road.adhesion());
            let required_m = limits.required_gap_m(follower.speed_mps, leader.speed_mps);
            check_gap([Party::Vehicle(behind as u32), Party::Vehicle(ahead as u32)], gap_m, required_m)?;
        }
        Ok(())
    }
}

fn check_lane(road: &Road, lane: LaneIndex, who: Party) -> Result<(), ScenarioError> {
    let last = road.config().lanes - 1;
    if lane.0 <= last { Ok(()) } else { Err(ScenarioError::NoSuchLane { who, lane: lane.0, last }) }
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
        let draw = Draw { traffic: &self.traffic, adhesion: road.adhesion(), seed };
        let mut vehicles = Vec::new();
        for lane in road.lanes() {
            let first = vehicles.len();
            draw.fill_lane(&road, lane, &mut vehicles)?;
            draw.slow_to_safety(&road, &mut vehicles[first..]);
        }
        let warm_up_s = self.traffic.warm_up_s;
        Ok(Scenario { road, traffic: self.traffic.clone(), vehicles, ego: EgoStart::LargestGap, warm_up_s, seed })
    }
}

/// Draws drivers and places.
struct Draw<'a> {
    traffic: &'a TrafficConfig,
    adhesion: f64,
    seed: u64,
}

impl Draw<'_> {
    fn driver(&self, id: usize) -> Stream {
        Stream::keyed(self.seed, "traffic.driver", id as u64, 0)
    }

    fn density_veh_per_km(&self) -> f64 {
        let spread = self.traffic.density_spread_veh_per_km_lane;
        let mut stream = Stream::new(self.seed, "traffic.density");
        self.traffic.density_veh_per_km_lane + stream.range(-spread, spread)
    }

    fn spec(&self, kind: VehicleKind, desired_speed_mps: f64, stream: &mut Stream) -> VehicleSpec {
        let traffic = self.traffic;
        let (max_accel_mps2, brake_mps2) = match kind {
            VehicleKind::Car => (traffic.max_accel_mps2, traffic.max_brake_mps2),
            VehicleKind::Truck => (traffic.truck_max_accel_mps2, traffic.truck_max_brake_mps2),
        };
        let driver = IdmParams {
            desired_speed_mps,
            time_headway_s: stream.range(traffic.time_headway_min_s, traffic.time_headway_max_s),
            min_gap_m: traffic.min_gap_m,
            max_accel_mps2,
            comfort_decel_mps2: traffic.comfort_decel_mps2,
        };
        VehicleSpec {
            kind,
            lane: LaneIndex(0),
            s_m: 0.0,
            speed_mps: START_SPEED_SHARE * desired_speed_mps,
            driver,
            max_brake_mps2: limited_by_adhesion(brake_mps2, self.adhesion),
            cooldown_s: stream.range(0.0, FIRST_COOLDOWN_S),
        }
    }

    fn written(&self, id: usize, start: &VehicleStart) -> VehicleSpec {
        let spec = self.spec(start.kind, start.desired_speed_mps, &mut self.driver(id));
        VehicleSpec { lane: start.lane, s_m: start.s_m, speed_mps: start.speed_mps, ..spec }
    }

    fn sampled(&self, id: usize, lane: LaneIndex) -> VehicleSpec {
        let traffic = self.traffic;
        let mut stream = self.driver(id);
        let kind = if stream.bernoulli(traffic.truck_share) { VehicleKind::Truck } else { VehicleKind::Car };
        let (low_mps, high_mps) = match kind {
            VehicleKind::Car => (traffic.desired_speed_min_mps, traffic.desired_speed_max_mps),
            VehicleKind::Truck => (traffic.truck_desired_speed_min_mps, traffic.truck_desired_speed_max_mps),
        };
        let desired_speed_mps = stream.range(low_mps, high_mps);
        VehicleSpec { lane, ..self.spec(kind, desired_speed_mps, &mut stream) }
    }

    /// Adds a lane's vehicles by rising position: the free space is divided evenly, then each vehicle is shifted at random.
    fn fill_lane(&self, road: &Road, lane: LaneIndex, all: &mut Vec<VehicleSpec>) -> Result<(), ScenarioError> {
        let length_m = road.config().length_m;
        let density = self.density_veh_per_km();
        let count = (density * length_m / 1000.0).round() as usize;
        let first = all.len();
        all.extend((0..count).map(|k| self.sampled(first + k, lane)));
        let lane_vehicles = &mut all[first..];
        let shortest_m = SAFE_MARGIN_M.max(self.traffic.min_gap_m);
        let taken_m: f64 = lane_vehicles.iter().map(|vehicle| vehicle.kind.length_m() + shortest_m).sum();
        if taken_m > length_m {
            return Err(ScenarioError::TooDense { lane: lane.0, vehicles: count, taken_m, length_m });
        }
        let mut stream = Stream::keyed(self.seed, "traffic.place", u64::from(lane.0), 0);
        let space_m = (length_m - taken_m) / count.max(1) as f64;
        let mut rear_m = stream.range(0.0, space_m);
        for vehicle in lane_vehicles {
            let shift_m = space_m * stream.range(-self.traffic.start_jitter, self.traffic.start_jitter);
            vehicle.s_m = road.wrap_m(rear_m + 0.5 * vehicle.kind.length_m() + shift_m);
            rear_m += vehicle.kind.length_m() + shortest_m + space_m;
        }
        Ok(())
    }

    /// Lowers the speeds of a lane's vehicles, given by rising position, until all distances are safe.
    fn slow_to_safety(&self, road: &Road, lane: &mut [VehicleSpec]) {
        let count = lane.len();
        let ring = road.config().topology == Topology::Ring;
        // Speeds only fall, each to what its leader allows; a turn without a change ends it, and `count` turns always do.
        for _ in 0..count {
            let mut changed = false;
            for behind in (0..count).rev() {
                let ahead = (behind + 1) % count;
                if ahead == behind || (ahead == 0 && !ring) {
                    continue;
                }
                let half_lengths_m = 0.5 * (lane[behind].kind.length_m() + lane[ahead].kind.length_m());
                let mut distance_m = lane[ahead].s_m - lane[behind].s_m;
                if distance_m < 0.0 {
                    distance_m += road.config().length_m;
                }
                let limits = self.traffic.braking_limits(lane[behind].max_brake_mps2, false, self.adhesion);
                let safe_mps = limits.safe_speed_mps(distance_m - half_lengths_m, lane[ahead].speed_mps).max(0.0);
                changed |= lane[behind].speed_mps > safe_mps;
                lane[behind].speed_mps = lane[behind].speed_mps.min(safe_mps);
            }
            if !changed {
                break;
            }
        }
    }
}

/// Length of the ego that scenes assume when they place it, m.
pub(crate) fn ego_length_m() -> f64 {
    VehicleParams::default().length_m
}

/// Whom an error is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Party {
    /// The ego.
    Ego,
    /// A vehicle, by its index in the scene.
    Vehicle(u32),
}

impl fmt::Display for Party {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ego => write!(f, "the ego"),
            Self::Vehicle(index) => write!(f, "vehicle {index}"),
        }
    }
}

/// A scene that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScenarioError {
    /// The text is no scenario file.
    #[error("not a scenario file: {0}")]
    Parse(#[source] toml::de::Error),
    /// A value outside its range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// No vehicle at all.
    #[error("the road is empty: write `vehicles` or raise `traffic.density_veh_per_km_lane`")]
    EmptyRoad,
    /// More vehicles than fit.
    #[error(
        "{vehicles} vehicles in lane {lane} take {taken_m:.0} m with their standstill gaps, but it has {length_m} m"
    )]
    TooDense {
        /// The lane.
        lane: u8,
        /// How many.
        vehicles: usize,
        /// Room they take, m.
        taken_m: f64,
        /// Length of the lane, m.
        length_m: f64,
    },
    /// A lane that is not there.
    #[error("{who} is in lane {lane}, but the road has lanes 0 to {last}")]
    NoSuchLane {
        /// Whose lane.
        who: Party,
        /// The lane given.
        lane: u8,
        /// The road's leftmost lane.
        last: u8,
    },
    /// Two start in the same place.
    #[error("{first} and {second} overlap at the start by {overlap_m:.2} m")]
    Overlap {
        /// The rear one.
        first: Party,
        /// The front one.
        second: Party,
        /// By how much, m.
        overlap_m: f64,
    },
    /// A start from which a collision may be unavoidable.
    #[error("{follower} starts {gap_m:.2} m behind {leader}, but could stop behind it only from {required_m:.2} m")]
    Unsafe {
        /// The rear one.
        follower: Party,
        /// The front one.
        leader: Party,
        /// The gap given, m.
        gap_m: f64,
        /// The gap needed, m.
        required_m: f64,
    },
    /// No lane has a gap for the ego.
    #[error("no gap takes the ego: the largest has {largest_m:.1} m; lower `traffic.density_veh_per_km_lane`")]
    NoRoomForEgo {
        /// The largest gap of all lanes, m.
        largest_m: f64,
    },
}
