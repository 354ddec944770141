//! Draws drivers and their places from a seed.

use lanecraft_net::random::Stream;

use super::drivers::{SAFE_MARGIN_M, TrafficConfig, VehicleKind, limited_by_adhesion};
use super::{ScenarioError, VehicleSpec, VehicleStart};
use crate::models::idm::IdmParams;
use crate::road::{LaneIndex, Road, Topology};

/// Sampled vehicles start at this share of their desired speed, as far as that is safe.
const START_SPEED_SHARE: f64 = 0.95;
/// A driver's first lane change comes at the earliest after a time drawn from 0 to this, s.
const FIRST_COOLDOWN_S: f64 = 4.0;

/// Draws drivers and places.
pub(super) struct Draw<'a> {
    pub(super) traffic: &'a TrafficConfig,
    pub(super) road: &'a Road,
    pub(super) seed: u64,
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
        let (max_accel, brake_mps2) = match kind {
            VehicleKind::Car => (traffic.max_accel_mps2, traffic.max_brake_mps2),
            VehicleKind::Truck => (traffic.truck_max_accel_mps2, traffic.truck_max_brake_mps2),
        };
        let time_headway_s = traffic.time_headway_s.sample(stream);
        let cooldown_s = stream.range(0.0, FIRST_COOLDOWN_S);
        let driver = IdmParams {
            desired_speed_mps,
            time_headway_s,
            min_gap_m: traffic.min_gap_m.sample(stream),
            max_accel_mps2: max_accel.sample(stream),
            comfort_decel_mps2: traffic.comfort_decel_mps2.sample(stream),
        };
        VehicleSpec {
            kind,
            lane: LaneIndex(0),
            s_m: 0.0,
            speed_mps: START_SPEED_SHARE * desired_speed_mps,
            driver,
            politeness: traffic.politeness.sample(stream),
            max_brake_mps2: limited_by_adhesion(brake_mps2, self.road.adhesion_range().0),
            cooldown_s,
        }
    }

    /// A written vehicle with the rest of its driver drawn.
    pub(super) fn written(&self, id: usize, start: &VehicleStart) -> VehicleSpec {
        let spec = self.spec(start.kind, start.desired_speed_mps, &mut self.driver(id));
        VehicleSpec { lane: start.lane, s_m: start.s_m, speed_mps: start.speed_mps, ..spec }
    }

    fn sampled(&self, id: usize, lane: LaneIndex) -> VehicleSpec {
        self.drawn_from(self.driver(id), lane)
    }

    /// The vehicle with this index among those that enter `lane` later.
    pub(super) fn entering(&self, lane: LaneIndex, index: u64) -> VehicleSpec {
        self.drawn_from(Stream::keyed(self.seed, "traffic.entering", u64::from(lane.0), index), lane)
    }

    fn drawn_from(&self, mut stream: Stream, lane: LaneIndex) -> VehicleSpec {
        let traffic = self.traffic;
        let kind = if stream.bernoulli(traffic.truck_share) { VehicleKind::Truck } else { VehicleKind::Car };
        let desired_speed = match kind {
            VehicleKind::Car => traffic.desired_speed_mps,
            VehicleKind::Truck => traffic.truck_desired_speed_mps,
        };
        let desired_speed_mps = desired_speed.sample(&mut stream);
        VehicleSpec { lane, ..self.spec(kind, desired_speed_mps, &mut stream) }
    }

    /// Adds a lane's vehicles by rising position: the free space is divided evenly, then each vehicle is shifted at random.
    pub(super) fn fill_lane(&self, lane: LaneIndex, all: &mut Vec<VehicleSpec>) -> Result<(), ScenarioError> {
        let road = self.road;
        let length_m = road.config().length_m;
        let density = self.density_veh_per_km();
        let count = (density * length_m / 1000.0).round() as usize;
        let first = all.len();
        all.extend((0..count).map(|k| self.sampled(first + k, lane)));
        let lane_vehicles = &mut all[first..];
        let room_m = |vehicle: &VehicleSpec| vehicle.kind.length_m() + SAFE_MARGIN_M.max(vehicle.driver.min_gap_m);
        let taken_m: f64 = lane_vehicles.iter().map(room_m).sum();
        if taken_m > length_m {
            return Err(ScenarioError::TooDense { lane: lane.0, vehicles: count, taken_m, length_m });
        }
        let mut stream = Stream::keyed(self.seed, "traffic.place", u64::from(lane.0), 0);
        let space_m = (length_m - taken_m) / count.max(1) as f64;
        let mut rear_m = stream.range(0.0, space_m);
        for vehicle in lane_vehicles {
            let shift_m = space_m * stream.range(-self.traffic.start_jitter, self.traffic.start_jitter);
            vehicle.s_m = road.wrap_m(rear_m + 0.5 * vehicle.kind.length_m() + shift_m);
            rear_m += room_m(vehicle) + space_m;
        }
        self.fit_to_road(lane, first, all);
        Ok(())
    }

    /// Leaves out the vehicles of `lane`, those from `first` on, that would not be on it, and slows the others to what the road allows.
    fn fit_to_road(&self, lane: LaneIndex, first: usize, all: &mut Vec<VehicleSpec>) {
        let road = self.road;
        let mut index = 0;
        all.retain(|vehicle| {
            index += 1;
            let body_m = SAFE_MARGIN_M + 0.5 * vehicle.kind.length_m();
            index <= first || road.lane_holds(lane, vehicle.s_m, body_m)
        });
        for vehicle in &mut all[first..] {
            let limits = self.traffic.braking_limits(vehicle.max_brake_mps2, false, road);
            let end_gap_m = road.lane_end_ahead_m(lane, vehicle.s_m) - 0.5 * vehicle.kind.length_m();
            let allowed_mps = road.allowed_speed_mps(vehicle.s_m).min(limits.safe_speed_mps(end_gap_m, 0.0));
            vehicle.speed_mps = vehicle.speed_mps.min(allowed_mps);
        }
    }

    /// Lowers the speeds of a lane's vehicles, given by rising position, until all distances are safe.
    pub(super) fn slow_to_safety(&self, lane: &mut [VehicleSpec]) {
        let road = self.road;
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
                let limits = self.traffic.braking_limits(lane[behind].max_brake_mps2, false, road);
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
