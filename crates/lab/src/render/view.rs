//! What a picture shows.

use std::sync::Arc;

use lanecraft_drive::env::Env;
use lanecraft_drive::kinematic::KinematicEnv;
use lanecraft_drive::plan::Quintic;
use lanecraft_drive::road::{LaneIndex, Road, Side};
use lanecraft_drive::scenario::VehicleKind;
use lanecraft_drive::traffic::Vehicle;
use lanecraft_drive::vehicle::VehicleState;

use super::DASH_M;

/// Vehicles longer than this are drawn as trucks, m.
const LONG_M: f64 = 7.0;
/// Pieces of a path.
const PATH_PIECES: u32 = 24;

/// A vehicle to be drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Position of its center along the road, m.
    pub s_m: f64,
    /// Position of its center to the left of the reference line, m.
    pub d_m: f64,
    /// Heading relative to the road, rad, positive to the left.
    pub heading_rad: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Length, m.
    pub length_m: f64,
    /// Width, m.
    pub width_m: f64,
    /// Car or truck.
    pub kind: VehicleKind,
    /// Its turn signal.
    pub signal: Option<Side>,
}

/// One instant: the road, the ego, everybody else. Any simulator can fill it.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The road.
    pub road: Arc<Road>,
    /// Time since the start, s.
    pub time_s: f64,
    /// The ego car.
    pub ego: Body,
    /// The lane that it keeps or changes into.
    pub target_lane: LaneIndex,
    /// The other vehicles, in any order.
    pub vehicles: Vec<Body>,
    /// Points (s, d) of the path still ahead of the ego, m; empty without one.
    pub path: Vec<(f64, f64)>,
    /// Which of `vehicles` the ego touches.
    pub collision: Option<usize>,
    /// What the line of text ends with, for example the action; only ASCII can be drawn.
    pub note: String,
}

impl View {
    /// The present instant of an environment.
    pub fn of(env: &Env) -> Self {
        let (world, driver, ego) = (env.world(), env.driver(), env.ego());
        let (road, vehicle, env_config) = (world.road(), &env.config().vehicle, &env.config().env);
        let touched = env.episode().collision.map(|collision| collision.with);
        let change = driver.change();
        let signal = change.map(|change| change.path.side);
        Self {
            road: Arc::clone(road),
            time_s: env.episode().control_steps as f64 * env_config.control_period_s,
            ego: Body {
                s_m: ego.s_m,
                d_m: ego.d_m,
                heading_rad: ego.heading_rad,
                speed_mps: ego.speed_mps,
                length_m: vehicle.length_m,
                width_m: vehicle.width_m,
                kind: VehicleKind::Car,
                signal,
            },
            target_lane: driver.target_lane(),
            vehicles: world.vehicles().map(|vehicle| body_of(&vehicle)).collect(),
            path: driver.path().map_or_else(Vec::new, |path| path_ahead(path, ego)),
            collision: touched.and_then(|with| world.vehicles().position(|vehicle| vehicle.id == with)),
            note: note(env),
        }
    }

    /// The present instant of a fast environment.
    pub fn of_kinematic(env: &KinematicEnv) -> Self {
        let (world, ego, (length_m, width_m)) = (env.world(), env.ego(), env.ego_size_m());
        let touched = env.collision().map(|collision| collision.with);
        let note =
            env.collision().map_or_else(String::new, |collision| format!("collision: {}", collision.fault.name()));
        Self {
            road: Arc::clone(world.road()),
            time_s: env.time_s(),
            ego: Body {
                s_m: world.road().wrap_m(ego.s_m),
                d_m: ego.d_m,
                heading_rad: ego.heading_rad,
                speed_mps: ego.speed_mps,
                length_m,
                width_m,
                kind: VehicleKind::Car,
                signal: None,
            },
            target_lane: ego.target_lane,
            vehicles: world.vehicles().map(|vehicle| body_of(&vehicle)).collect(),
            path: Vec::new(),
            collision: touched.and_then(|with| world.vehicles().position(|vehicle| vehicle.id == with)),
            note,
        }
    }

    /// How far ahead of the ego a place is, m, the shorter way round a ring.
    pub(super) fn ahead_m(&self, s_m: f64) -> f64 {
        self.road.ahead_m(self.ego.s_m, s_m)
    }

    /// The place this far ahead of the ego, m.
    pub(super) fn s_ahead_m(&self, ahead_m: f64) -> f64 {
        self.road.wrap_m(self.ego.s_m + ahead_m)
    }

    /// The lines between lanes and at the road's edges, from the right.
    pub(super) fn lines(&self) -> impl DoubleEndedIterator<Item = u8> {
        0..=self.road.config().lanes
    }

    /// What is painted at `s_m` on the line to the right of lane `line`.
    pub(super) fn paint(&self, line: u8, s_m: f64) -> Paint {
        let lane_at = |lane: u8| self.road.lane_holds(LaneIndex(lane), s_m, 0.0).then_some(LaneIndex(lane));
        let right = line.checked_sub(1).and_then(lane_at);
        match (right, lane_at(line)) {
            (None, None) => Paint::Nothing,
            (Some(right), Some(_)) if self.road.neighbor_lane(right, Side::Left, s_m).is_some() => {
                if s_m.rem_euclid(DASH_M.1) < DASH_M.0 { Paint::Dash } else { Paint::Gap }
            }
            _ => Paint::Solid,
        }
    }

    /// The line of text.
    pub(super) fn status(&self) -> String {
        let lane = u32::from(self.road.nearest_lane(self.ego.d_m).0) + 1;
        let (time_s, speed_mps, lanes) = (self.time_s, self.ego.speed_mps, self.road.config().lanes);
        format!("{time_s:6.1} s  {speed_mps:4.1} m/s  lane {lane}/{lanes}  {}", self.note)
    }
}

/// What is painted on a place of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Paint {
    /// There is no lane on either side.
    Nothing,
    /// Not to be crossed, or the edge of the road.
    Solid,
    /// A dash of a line that may be crossed.
    Dash,
    /// The gap between two dashes.
    Gap,
}

fn body_of(vehicle: &Vehicle) -> Body {
    let side = if vehicle.target_lane > vehicle.lane { Side::Left } else { Side::Right };
    Body {
        s_m: vehicle.s_m,
        d_m: vehicle.d_m,
        // It drives where it points; one that hardly moves points along the road.
        heading_rad: libm::atan2(vehicle.lateral_speed_mps, vehicle.speed_mps.max(1.0)),
        speed_mps: vehicle.speed_mps,
        length_m: vehicle.length_m,
        width_m: vehicle.width_m,
        kind: if vehicle.length_m > LONG_M { VehicleKind::Truck } else { VehicleKind::Car },
        signal: (vehicle.target_lane != vehicle.lane).then_some(side),
    }
}

/// The rest of a path, driven at the present speed.
fn path_ahead((quintic, elapsed_s): (&Quintic, f64), ego: &VehicleState) -> Vec<(f64, f64)> {
    let left_s = (quintic.duration_s - elapsed_s).max(0.0);
    let point = |k| {
        let time_s = left_s * f64::from(k) / f64::from(PATH_PIECES);
        (ego.s_m + ego.speed_mps * time_s, quintic.at(elapsed_s + time_s).0)
    };
    (0..=PATH_PIECES).map(point).collect()
}

/// What the driver does, or how the episode ended.
fn note(env: &Env) -> String {
    if let Some(collision) = env.episode().collision {
        return format!("collision: {}", collision.fault.name());
    }
    if let Some(cause) = env.driver().guard_cause() {
        return format!("guard: {}", cause.name());
    }
    match env.driver().change() {
        Some(change) if change.aborted => "back to its lane".to_owned(),
        Some(change) => match change.path.side {
            Side::Left => "change left".to_owned(),
            Side::Right => "change right".to_owned(),
        },
        None => "keep lane".to_owned(),
    }
}
