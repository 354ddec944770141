//! The observation `Kinematics` of highway-env (Leurent, 2018).

use super::config::{Feature, KinematicsConfig, MAX_OBSERVED, SIGHT_M};
use super::ego::EgoState;
use crate::road::Road;
use crate::scene::VehicleId;
use crate::traffic::{Vehicle, World};

/// Where vehicles are still seen that are behind but not `see_behind`, m: two lengths of highway-env's vehicles.
const BESIDE_M: f64 = 10.0;
/// Speeds are scaled by this, m/s: twice highway-env's largest one.
const SPEED_SCALE_MPS: f64 = 80.0;

/// A vehicle as a row shows it: x along the road, y to the right.
#[derive(Clone, Copy)]
struct Row {
    at_m: [f64; 2],
    velocity_mps: [f64; 2],
    heading_rad: f64,
}

impl Row {
    fn of_ego(ego: &EgoState, road: &Road) -> Self {
        let (along_mps, left_mps) = ego.velocity_mps();
        Self {
            at_m: [ego.s_m, right_m(road, ego.d_m)],
            velocity_mps: [along_mps, -left_mps],
            heading_rad: -ego.heading_rad,
        }
    }

    fn of_other(vehicle: &Vehicle, x_m: f64, road: &Road) -> Self {
        let velocity_mps = [vehicle.speed_mps, -vehicle.lateral_speed_mps];
        // Most keep their lanes.
        let keeps = vehicle.lateral_speed_mps == 0.0;
        let heading_rad = if keeps { 0.0 } else { libm::atan2(velocity_mps[1], velocity_mps[0]) };
        Self { at_m: [x_m, right_m(road, vehicle.d_m)], velocity_mps, heading_rad }
    }

    fn relative_to(self, origin: &Self) -> Self {
        let less = |a: [f64; 2], b: [f64; 2]| [a[0] - b[0], a[1] - b[1]];
        Self { at_m: less(self.at_m, origin.at_m), velocity_mps: less(self.velocity_mps, origin.velocity_mps), ..self }
    }

    fn write(&self, config: &KinematicsConfig, road: &Road, out: &mut [f32]) {
        let width_m = f64::from(road.config().lanes) * road.lane_width_m();
        for (out, feature) in out.iter_mut().zip(&config.features) {
            let scaled = |value: f64, scale: f64| {
                if config.normalize { (value / scale).clamp(-1.0, 1.0) } else { value }
            };
            let value = match feature {
                Feature::Presence => 1.0,
                Feature::X => scaled(self.at_m[0], SIGHT_M),
                Feature::Y => scaled(self.at_m[1], width_m),
                Feature::Vx => scaled(self.velocity_mps[0], SPEED_SCALE_MPS),
                Feature::Vy => scaled(self.velocity_mps[1], SPEED_SCALE_MPS),
                Feature::Heading => self.heading_rad,
                Feature::CosH => libm::cos(self.heading_rad),
                Feature::SinH => libm::sin(self.heading_rad),
            };
            *out = value as f32;
        }
    }
}

/// Position to the right of the middle of the leftmost lane, m.
fn right_m(road: &Road, d_m: f64) -> f64 {
    f64::from(road.config().lanes - 1) * road.lane_width_m() - d_m
}

/// Writes the rows, zeros where there is no vehicle.
pub(super) fn observe(config: &KinematicsConfig, world: &World, ego: &EgoState, out: &mut [f32]) {
    let road = world.road();
    let mut seen = [(0.0, VehicleId(0)); MAX_OBSERVED];
    let seen = nearest(config, world, ego, &mut seen);
    let own = Row::of_ego(ego, road);
    let mut rows = out.chunks_exact_mut(config.features.len());
    if let Some(out) = rows.next() {
        own.write(config, road, out);
    }
    for (&(ahead_m, id), out) in seen.iter().zip(&mut rows) {
        let Some(vehicle) = world.vehicle(id) else { continue };
        let row = Row::of_other(&vehicle, ego.s_m + ahead_m, road);
        let row = if config.absolute { row } else { row.relative_to(&own) };
        row.write(config, road, out);
    }
    rows.for_each(|out| out.fill(0.0));
}

/// How far ahead the nearest vehicles along the road are and who, nearest first, the lower id first of two; fills `seen` from the front.
fn nearest<'a>(
    config: &KinematicsConfig,
    world: &World,
    ego: &EgoState,
    seen: &'a mut [(f64, VehicleId); MAX_OBSERVED],
) -> &'a [(f64, VehicleId)] {
    let (road, most) = (world.road(), config.observed_vehicles - 1);
    let behind_m = if config.see_behind { SIGHT_M } else { BESIDE_M };
    let mut count = 0;
    let (middle_m, reach_m) = (0.5 * (SIGHT_M - behind_m), 0.5 * (SIGHT_M + behind_m));
    for vehicle in world.vehicles_near(ego.s_m + middle_m, reach_m) {
        let ahead_m = road.ahead_m(ego.s_m, vehicle.s_m);
        let aside_m = vehicle.d_m - ego.d_m;
        if ahead_m <= -behind_m || ahead_m * ahead_m + aside_m * aside_m >= SIGHT_M * SIGHT_M {
            continue;
        }
        let comes_before = |&(other_m, id): &(f64, VehicleId)| {
            let nearer = other_m.abs() < ahead_m.abs();
            nearer || (other_m.abs() == ahead_m.abs() && id.0 < vehicle.id.0)
        };
        let place = seen[..count].partition_point(comes_before);
        if place == most {
            continue;
        }
        count = (count + 1).min(most);
        seen[place..count].rotate_right(1);
        seen[place] = (ahead_m, vehicle.id);
    }
    &seen[..count]
}
