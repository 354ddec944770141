//! Drives a maneuver: perception of the scripted cars, controllers, guard, plant.

use std::sync::Arc;

use lanecraft_drive::config::ConfigError;
use lanecraft_drive::control::classical::{
    LateralController, Lqr, PiConfig, PiSpeed, SpeedController, Stanley, StanleyConfig,
};
use lanecraft_drive::control::{Guard, GuardCause, LateralMpc, LateralReference, LongitudinalMpc, Rung, SpeedGoal};
use lanecraft_drive::plan::{LateralState, Quintic};
use lanecraft_drive::predict::{Forecast, Predictor};
use lanecraft_drive::road::{LaneIndex, Road};
use lanecraft_drive::scene::Scene;
use lanecraft_drive::vehicle::{Contact, ControlInput, Plant, PlantConfig, SingleTrack, VehicleParams, VehicleState};
use serde::{Deserialize, Serialize};

use super::car::{CAR_SIZE_M, Car};
use super::{EgoScript, Leg, Maneuver, Steering};

/// Time between two control steps, s.
pub(super) const PERIOD_S: f64 = 0.05;
/// Steps of the plant in a control step, and their length, s.
const SUBSTEPS: u32 = 5;
const PLANT_PERIOD_S: f64 = PERIOD_S / SUBSTEPS as f64;
/// Cars further away are not perceived, m.
const RANGE_M: f64 = 200.0;

/// The lateral controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LateralLaw {
    /// Eq. 26.
    #[default]
    Mpc,
    /// Linear-quadratic regulator with feed-forward.
    Lqr,
    /// The law of Stanley.
    Stanley,
}

/// The speed controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SpeedLaw {
    /// Eq. 25.
    #[default]
    Mpc,
    /// Proportional-integral control.
    Pi,
}

/// Which controllers drive; the guard checks either.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stack {
    /// Steering.
    pub lateral: LateralLaw,
    /// Driving and braking.
    pub speed: SpeedLaw,
}

impl Stack {
    pub(crate) fn lateral(self, maneuver: &Maneuver) -> LateralController {
        let (config, model) = (&maneuver.control, &maneuver.model);
        match self.lateral {
            LateralLaw::Mpc => LateralController::Mpc(Box::new(LateralMpc::new(config, model, PERIOD_S))),
            LateralLaw::Lqr => {
                let lqr = Lqr::new(model, PERIOD_S, maneuver.ego.path_ratio, config.steer_change_weight);
                LateralController::Lqr(Box::new(lqr))
            }
            LateralLaw::Stanley => LateralController::Stanley(Box::new(Stanley::new(StanleyConfig::default(), model))),
        }
    }

    pub(crate) fn speed(self, maneuver: &Maneuver) -> SpeedController {
        let (config, model) = (&maneuver.control, &maneuver.model);
        match self.speed {
            SpeedLaw::Mpc => SpeedController::Mpc(Box::new(LongitudinalMpc::new(config, model, PERIOD_S))),
            SpeedLaw::Pi => SpeedController::Pi(Box::new(PiSpeed::new(PiConfig::default(), config, PERIOD_S))),
        }
    }
}

/// The state after a control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub time_s: f64,
    /// The ego.
    pub ego: VehicleState,
    /// Where it should be, m.
    pub reference_d_m: f64,
    /// Free distance to the nearest car in any direction, m: negative if bodies overlap, infinite without cars.
    pub clearance_m: f64,
    /// Bumper-to-bumper distance to the car ahead in its lane, m; infinite without one.
    pub gap_m: f64,
    /// Jerk of the control step, m/s³.
    pub jerk_mps3: f64,
    /// Whether a controller used a fall-back.
    pub fallback: bool,
    /// Whether the guard braked.
    pub guarded: bool,
}

/// A drive.
#[derive(Clone, Debug)]
pub struct Run {
    /// After each control step.
    pub samples: Vec<Sample>,
    /// The plant.
    pub plant: VehicleParams,
    /// The road.
    pub road: Arc<Road>,
    /// When the last leg of the reference ends, s; 0 without legs.
    pub legs_end_s: f64,
    /// Begin and end of open-loop steering, s; 0 without it.
    pub steer_begin_s: f64,
    /// See `steer_begin_s`.
    pub steer_end_s: f64,
    /// Its peak, rad.
    pub steer_peak_rad: f64,
}

pub(super) fn run(maneuver: &Maneuver, stack: Stack) -> Result<Run, ConfigError> {
    maneuver.plant.validate()?;
    maneuver.model.validate()?;
    maneuver.options.validate()?;
    maneuver.control.validate()?;
    let road = Arc::new(Road::new(maneuver.road.clone())?);
    let mut drive = Drive::new(maneuver, stack, Arc::clone(&road));
    let steps = (maneuver.duration_s / PERIOD_S).round() as u32;
    let samples = (0..steps).map(|k| drive.step(f64::from(k) * PERIOD_S)).collect();
    let (steer_begin_s, steer_end_s, steer_peak_rad) = open_loop(&maneuver.ego.steering);
    let legs_end_s = match &maneuver.ego.steering {
        Steering::Legs(legs) => legs.last().map_or(0.0, |leg| leg.at_s + leg.duration_s),
        _ => 0.0,
    };
    Ok(Run { samples, plant: maneuver.plant.clone(), road, legs_end_s, steer_begin_s, steer_end_s, steer_peak_rad })
}

/// Begin, end and peak of open-loop steering.
fn open_loop(steering: &Steering) -> (f64, f64, f64) {
    match *steering {
        Steering::Legs(_) => (0.0, 0.0, 0.0),
        Steering::Step { at_s, steer_rad } => (at_s, at_s, steer_rad),
        Steering::SineWithDwell { at_s, steer_rad, frequency_hz, dwell_s } => {
            (at_s, at_s + 1.0 / frequency_hz + dwell_s, steer_rad)
        }
    }
}

struct Drive<'a> {
    ego: &'a EgoScript,
    plant: &'a VehicleParams,
    options: &'a PlantConfig,
    car: Plant,
    scene: Scene,
    forecast: Forecast,
    cars: Vec<Car<'a>>,
    lateral: LateralController,
    speed: SpeedController,
    guard: Guard,
}

/// The reference at one instant.
struct Target {
    path: Option<(Quintic, f64)>,
    d_m: f64,
    lanes: [Option<LaneIndex>; 2],
}

impl<'a> Drive<'a> {
    fn new(maneuver: &'a Maneuver, stack: Stack, road: Arc<Road>) -> Self {
        let (ego, plant) = (&maneuver.ego, &maneuver.plant);
        let state = VehicleState {
            d_m: ego.d_m,
            speed_mps: ego.speed_mps,
            heading_rad: ego.heading_rad,
            yaw_rate_radps: ego.yaw_rate_radps,
            ..VehicleState::default()
        };
        let cars = maneuver.cars.iter().enumerate();
        Self {
            ego,
            plant,
            options: &maneuver.options,
            car: Plant::SingleTrack(SingleTrack::new(plant, &maneuver.options, PLANT_PERIOD_S)),
            cars: cars.map(|(i, script)| Car::new(script, i, &road, plant.length_m)).collect(),
            scene: Scene {
                ego: state,
                ego_length_m: plant.length_m,
                ego_width_m: plant.width_m,
                ego_lane: road.nearest_lane(ego.d_m),
                neighbors: Vec::new(),
                road,
            },
            forecast: Forecast::default(),
            lateral: stack.lateral(maneuver),
            speed: stack.speed(maneuver),
            guard: Guard::new(&maneuver.control, &maneuver.model, PERIOD_S),
        }
    }

    fn step(&mut self, time_s: f64) -> Sample {
        self.perceive(time_s);
        let target = self.target(time_s);
        let (input, fallback, guarded) = self.command(time_s, &target);
        let accel_before = self.scene.ego.accel_mps2;
        for substep in 0..SUBSTEPS {
            let contact = self.contact(time_s + f64::from(substep) * PLANT_PERIOD_S);
            self.scene.ego = self.car.step(&self.scene.ego, &input, &contact, PLANT_PERIOD_S);
        }
        for car in &mut self.cars {
            car.advance(&self.scene.road, time_s, PERIOD_S);
        }
        self.perceive(time_s + PERIOD_S);
        let ego = self.scene.ego;
        // Coming to rest ends the deceleration at once; that is no jerk of the controller's.
        let jerk_mps3 = if ego.speed_mps > 0.1 { (ego.accel_mps2 - accel_before) / PERIOD_S } else { 0.0 };
        Sample {
            time_s: time_s + PERIOD_S,
            ego,
            reference_d_m: self.target(time_s + PERIOD_S).d_m,
            clearance_m: self.clearance_m(),
            gap_m: self.scene.leader(self.scene.ego_lane).map_or(f64::INFINITY, |n| n.gap_m(self.plant.length_m)),
            jerk_mps3,
            fallback,
            guarded,
        }
    }

    /// What road and wind do to the car.
    fn contact(&self, time_s: f64) -> Contact {
        let (road, s_m) = (&self.scene.road, self.scene.ego.s_m);
        let (side_force_n, yaw_moment_nm) = self.options.wind_load(self.scene.ego.speed_mps, time_s);
        Contact { side_force_n, yaw_moment_nm, ..Contact::at(road, s_m) }
    }

    /// Brings the scene up to date with the scripted cars.
    fn perceive(&mut self, time_s: f64) {
        let scene = &mut self.scene;
        scene.ego_lane = scene.road.nearest_lane(scene.ego.d_m);
        scene.neighbors.clear();
        for car in &self.cars {
            let seen = car.perceived(&scene.road, scene.ego.s_m, time_s);
            scene.neighbors.extend(seen.filter(|n| n.ahead_m.abs() <= RANGE_M));
        }
        scene.neighbors.sort_by(|a, b| a.ahead_m.total_cmp(&b.ahead_m).then(a.id.cmp(&b.id)));
    }

    fn target(&self, time_s: f64) -> Target {
        let road = &self.scene.road;
        let mut target = Target {
            path: None,
            d_m: self.ego.reference_d_m,
            lanes: [Some(road.nearest_lane(self.ego.reference_d_m)), None],
        };
        let Steering::Legs(legs) = &self.ego.steering else { return target };
        for &Leg { at_s, duration_s, d_m } in legs.iter().take_while(|leg| leg.at_s <= time_s + 1e-9) {
            let start = LateralState { d_m: target.d_m, ..LateralState::default() };
            let to = road.nearest_lane(d_m);
            let elapsed_s = time_s - at_s;
            let from = target.lanes[0].filter(|from| *from != to && elapsed_s < duration_s);
            let path = Quintic::new(start, d_m, duration_s);
            target = Target { path: Some((path, elapsed_s)), d_m, lanes: [Some(to), from] };
        }
        if let Some((path, elapsed_s)) = &target.path {
            target.d_m = path.at(*elapsed_s).0;
        }
        target
    }

    /// The guarded command, whether a controller fell back and whether the guard braked.
    fn command(&mut self, time_s: f64, target: &Target) -> (ControlInput, bool, bool) {
        Predictor::ConstantVelocity.forecast(&self.scene, &mut self.forecast);
        let ego = self.ego;
        let goal = SpeedGoal {
            reference_accel_mps2: ego.reference_accel_mps2,
            target_speed_mps: ego.target_speed_mps,
            lanes: target.lanes,
        };
        let speed = self.speed.drive(&self.scene, &self.forecast, &goal, ego.speed_ratio);
        let reference = match &target.path {
            Some((path, elapsed_s)) => LateralReference::Path {
                coefficients: &path.coefficients,
                duration_s: path.duration_s,
                elapsed_s: *elapsed_s,
            },
            None => LateralReference::LaneCenter { d_m: target.d_m },
        };
        let steer = self.lateral.steer(&self.scene, reference, &speed.speeds_mps, ego.path_ratio);
        let steer_rad = signal_rad(&ego.steering, time_s).unwrap_or(steer.steer_rad);
        let wanted = ControlInput { accel_mps2: speed.accel_mps2, steer_rad };
        let (input, cause) = self.guard.check(&self.scene, target.lanes, wanted);
        self.speed.sent(input.accel_mps2);
        self.lateral.sent(input.steer_rad);
        self.guard.sent(input);
        let guarded = cause.is_some_and(GuardCause::brakes);
        (input, speed.rung.max(steer.rung) > Rung::Solved, guarded)
    }

    /// Free distance to the nearest car, hidden ones included.
    fn clearance_m(&self) -> f64 {
        let ego = &self.scene.ego;
        let apart = |car: &Car<'_>| {
            let ahead_m = (car.s_m - ego.s_m).abs() - 0.5 * (CAR_SIZE_M.0 + self.plant.length_m);
            let beside_m = (car.d_m - ego.d_m).abs() - 0.5 * (CAR_SIZE_M.1 + self.plant.width_m);
            ahead_m.max(beside_m)
        };
        self.cars.iter().map(apart).fold(f64::INFINITY, f64::min)
    }
}

/// The open-loop steering at `time_s`; `None` where the controller steers.
fn signal_rad(steering: &Steering, time_s: f64) -> Option<f64> {
    match *steering {
        Steering::Legs(_) => None,
        Steering::Step { at_s, steer_rad } => Some(if time_s + 1e-9 >= at_s { steer_rad } else { 0.0 }),
        Steering::SineWithDwell { at_s, steer_rad, frequency_hz, dwell_s } => {
            let elapsed_s = time_s - at_s;
            let peak_s = 0.75 / frequency_hz;
            let phase_s = if elapsed_s > peak_s { (elapsed_s - dwell_s).max(peak_s) } else { elapsed_s };
            let inside = (0.0..=1.0 / frequency_hz).contains(&phase_s);
            let angle = 2.0 * std::f64::consts::PI * frequency_hz * phase_s;
            Some(if inside { steer_rad * libm::sin(angle) } else { 0.0 })
        }
    }
}
