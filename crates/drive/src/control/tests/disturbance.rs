//! Wind, bank, grade, wrong mass, delays and ice: what the models do not know.

use super::*;
use crate::road::{AdhesionPatch, BankPoint, GradePoint};
use crate::vehicle::{Plant, PlantConfig, SingleTrack};

/// A car that keeps its lane and its speed through whatever road and plant do to it.
struct Keeper {
    scene: Scene,
    plant: Plant,
    options: PlantConfig,
    speed: LongitudinalMpc,
    steer: LateralMpc,
    steps: u32,
}

impl Keeper {
    fn new(params: &VehicleParams, options: &PlantConfig, control: &ControlConfig, road: RoadConfig) -> Self {
        let mut scene = scene(25.0, 0.85);
        scene.road = Arc::new(Road::new(RoadConfig { topology: Topology::Open, ..road }).unwrap());
        Self {
            scene,
            plant: Plant::SingleTrack(SingleTrack::new(params, options, 0.01)),
            options: options.clone(),
            speed: LongitudinalMpc::new(control, params, PERIOD_S),
            steer: LateralMpc::new(control, params, PERIOD_S),
            steps: 0,
        }
    }

    /// One control step towards d = 0 and 25 m/s; both controllers must solve.
    fn step(&mut self) {
        let goal = SpeedGoal { reference_accel_mps2: 0.0, target_speed_mps: 25.0, lanes: [None; 2] };
        let plan = self.speed.plan(&self.scene, &Forecast::default(), &goal, 0.025);
        let center = LateralReference::LaneCenter { d_m: 0.0 };
        let turn = self.steer.plan(&self.scene, center, &plan.speeds_mps, 1e-3);
        assert_eq!((plan.rung, turn.rung), (Rung::Solved, Rung::Solved));
        self.send(&ControlInput { accel_mps2: plan.accel_mps2, steer_rad: turn.steer_rad });
    }

    fn send(&mut self, input: &ControlInput) {
        for k in 0..5 {
            let ego = &self.scene.ego;
            let road = &self.scene.road;
            let time_s = f64::from(5 * self.steps + k) * 0.01;
            let (side_force_n, yaw_moment_nm) = self.options.wind_load(ego.speed_mps, time_s);
            let contact = Contact { side_force_n, yaw_moment_nm, ..Contact::at(road, ego.s_m) };
            self.scene.ego = self.plant.step(ego, input, &contact, 0.01);
        }
        self.steps += 1;
    }

    /// Mean offset from the lane's center, m, and from the speed, m/s, between `from_s` and `to_s`.
    fn offsets(&mut self, from_s: f64, to_s: f64) -> (f64, f64) {
        let (first, last) = ((from_s / PERIOD_S) as u32, (to_s / PERIOD_S) as u32);
        let (mut d, mut v) = (0.0, 0.0);
        for k in 0..last {
            self.step();
            if k >= first {
                d += self.scene.ego.d_m / f64::from(last - first);
                v += (self.scene.ego.speed_mps - 25.0) / f64::from(last - first);
            }
        }
        (d, v)
    }
}

fn observing() -> ControlConfig {
    ControlConfig { observer: true, ..ControlConfig::default() }
}

fn bank(bank_rad: f64) -> RoadConfig {
    RoadConfig { bank: vec![BankPoint { s_m: 0.0, bank_rad }], ..RoadConfig::default() }
}

fn grade(grade: f64) -> RoadConfig {
    RoadConfig { grade: vec![GradePoint { s_m: 0.0, grade }], ..RoadConfig::default() }
}

#[test]
fn neither_wind_nor_bank_leaves_an_offset_with_the_observer() {
    let windy = PlantConfig { wind_mps: 12.0, ..PlantConfig::default() };
    let calm = PlantConfig::default();
    for (name, options, road) in
        [("wind", &windy, RoadConfig::default()), ("bank", &calm, bank(0.05)), ("both", &windy, bank(-0.05))]
    {
        let params = VehicleParams::default();
        let with = Keeper::new(&params, options, &observing(), road.clone()).offsets(10.0, 15.0).0;
        let without = Keeper::new(&params, options, &ControlConfig::default(), road).offsets(10.0, 15.0).0;
        assert!(with.abs() < 0.02, "{name}: {with} m");
        assert!(without.abs() > 2.0 * with.abs() && without.abs() > 0.02, "{name}: {without} m against {with} m");
    }
}

#[test]
fn neither_grade_nor_mass_leaves_an_error_of_the_speed_with_the_observer() {
    let params = VehicleParams::default();
    for (slope, mass_factor) in [(0.04, 1.0), (-0.04, 1.0), (0.04, 1.2), (0.04, 0.8)] {
        let options = PlantConfig { mass_factor, ..PlantConfig::default() };
        let with = Keeper::new(&params, &options, &observing(), grade(slope)).offsets(60.0, 65.0).1;
        let without = Keeper::new(&params, &options, &ControlConfig::default(), grade(slope)).offsets(60.0, 65.0).1;
        assert!(with.abs() < 0.1, "{slope}, {mass_factor}: {with} m/s");
        assert!(without.abs() > 2.0 * with.abs() && without.abs() > 0.1, "{slope}, {mass_factor}: {without} m/s");
    }
}

#[test]
fn the_observer_keeps_out_of_a_straight_drive() {
    let keep = |control: &ControlConfig| {
        let mut keeper =
            Keeper::new(&VehicleParams::default(), &PlantConfig::default(), control, RoadConfig::default());
        keeper.scene.ego.d_m = 0.5;
        let offsets = keeper.offsets(0.0, 6.0);
        (offsets, keeper.scene.ego.d_m)
    };
    let (with, without) = (keep(&observing()), keep(&ControlConfig::default()));
    assert!((with.0.0 - without.0.0).abs() < 0.01 && with.1.abs() < 2e-3, "{with:?} {without:?}");
}

/// Root mean square from the path of a lane change in 3 s at 25 m/s, and the largest overshoot, m.
fn change_lane(params: &VehicleParams, control: &ControlConfig) -> (f64, f64) {
    let t3 = 27.0;
    let coefficients = [0.0, 0.0, 0.0, 37.5 / t3, -56.25 / (t3 * 3.0), 22.5 / (t3 * 9.0)];
    let mut keeper = Keeper::new(params, &PlantConfig::default(), control, RoadConfig::default());
    let (mut squares, mut overshoot_m) = (0.0, 0.0_f64);
    for k in 0..140 {
        let elapsed_s = f64::from(k) * PERIOD_S;
        let reference = LateralReference::Path { coefficients: &coefficients, duration_s: 3.0, elapsed_s };
        let turn = keeper.steer.plan(&keeper.scene, reference, &[25.0; 3], 1e-2);
        keeper.send(&ControlInput { accel_mps2: 0.0, steer_rad: turn.steer_rad });
        let tau = ((elapsed_s + PERIOD_S) / 3.0).min(1.0);
        let error = keeper.scene.ego.d_m - 3.75 * tau * tau * tau * (10.0 - 15.0 * tau + 6.0 * tau * tau);
        squares += error * error / 140.0;
        overshoot_m = overshoot_m.max(keeper.scene.ego.d_m - 3.75);
    }
    (squares.sqrt(), overshoot_m)
}

#[test]
fn delays_of_the_steering_are_compensated() {
    let off = ControlConfig { delay_compensation: false, ..ControlConfig::default() };
    let prompt = change_lane(&VehicleParams::default(), &off);
    for (delay_s, allowed_m) in [(0.05, 0.02), (0.08, 0.02), (0.1, 0.02), (0.15, 0.03), (0.2, 0.04)] {
        let params = VehicleParams { steer_delay_s: delay_s, ..VehicleParams::default() };
        let with = change_lane(&params, &ControlConfig::default());
        assert!(with.0 < prompt.0 + allowed_m && with.1 < 0.1, "{delay_s} s: {with:?}, without delay {prompt:?}");
        let without = change_lane(&params, &off);
        assert!(delay_s < 0.09 || without.0 > 1.5 * with.0, "{delay_s} s: {without:?} against {with:?}");
    }
}

#[test]
fn a_wrong_mass_is_tracked_with() {
    for mass_factor in [0.8, 1.2] {
        let options = PlantConfig { mass_factor, ..PlantConfig::default() };
        let mut keeper = Keeper::new(&VehicleParams::default(), &options, &observing(), RoadConfig::default());
        (keeper.scene.ego.d_m, keeper.scene.ego.speed_mps) = (0.8, 24.5);
        let (d, v) = keeper.offsets(60.0, 65.0);
        assert!(d.abs() < 0.01 && v.abs() < 0.1, "{mass_factor}: {d} m, {v} m/s");
    }
}

/// Closest approach to a standing car, m, of an ego at 25 m/s with controller and guard.
fn stop(params: &VehicleParams, options: &PlantConfig, control: &ControlConfig, road: RoadConfig) -> f64 {
    let mut keeper = Keeper::new(params, options, control, road);
    let mut guard = Guard::new(control, params, PERIOD_S);
    keeper.scene.neighbors = vec![leader(180.0, 0.0)];
    let mut smallest = f64::INFINITY;
    for _ in 0..600 {
        let scene = &keeper.scene;
        let plan = keeper.speed.plan(scene, &constant_speed(scene), &keep(0.0), 0.025);
        let wanted = ControlInput { accel_mps2: plan.accel_mps2, steer_rad: 0.0 };
        let (input, _) = guard.check(scene, [Some(LaneIndex(0)), None], wanted);
        keeper.speed.sent(input.accel_mps2);
        guard.sent(input);
        let before_m = keeper.scene.ego.s_m;
        keeper.send(&input);
        let travelled_m = keeper.scene.ego.s_m - before_m;
        move_leader(&mut keeper.scene, 0.0, travelled_m);
        smallest = smallest.min(keeper.scene.neighbors[0].gap_m(4.8));
    }
    assert_eq!(keeper.scene.ego.speed_mps, 0.0);
    smallest
}

#[test]
fn ice_ahead_is_braked_for_before_it_is_reached() {
    let patch = AdhesionPatch { s_m: 60.0, length_m: 200.0, adhesion: 0.3 };
    let icy = RoadConfig { adhesion_patches: vec![patch], ..RoadConfig::default() };
    let (params, options) = (VehicleParams::default(), PlantConfig { combined_grip: true, ..PlantConfig::default() });
    let gap_m = stop(&params, &options, &ControlConfig::default(), icy);
    assert!(gap_m > 0.9, "{gap_m} m");
}

#[test]
fn delays_of_the_brakes_and_wrong_masses_still_stop_in_time() {
    for (drive_delay_s, mass_factor) in [(0.1, 1.0), (0.2, 1.0), (0.12, 1.0), (0.0, 0.8), (0.0, 1.2), (0.2, 1.2)] {
        let params = VehicleParams { drive_delay_s, ..VehicleParams::default() };
        let options = PlantConfig { mass_factor, ..PlantConfig::default() };
        let control = ControlConfig { mass_margin: (mass_factor - 1.0_f64).max(0.0), ..observing() };
        let gap_m = stop(&params, &options, &control, RoadConfig::default());
        assert!(gap_m > 0.9, "{drive_delay_s} s, {mass_factor}: {gap_m} m");
    }
}

#[test]
fn a_descent_is_counted_against_the_brakes() {
    let (params, options) = (VehicleParams::default(), PlantConfig::default());
    let gap_m = stop(&params, &options, &observing(), grade(-0.06));
    assert!(gap_m > 0.9, "{gap_m} m");
    // The guard alone, on a wet descent, behind a standing car and a wish to go on: 3.7 − 0.6 m/s² must be enough.
    let road = RoadConfig { adhesion: 0.4, ..grade(-0.06) };
    let control = ControlConfig::default();
    let mut keeper = Keeper::new(&params, &options, &control, road);
    let mut guard = Guard::new(&control, &params, PERIOD_S);
    keeper.scene.neighbors = vec![leader(180.0, 0.0)];
    for _ in 0..600 {
        let wanted = ControlInput { accel_mps2: 1.0, steer_rad: 0.0 };
        let (input, _) = guard.check(&keeper.scene, [Some(LaneIndex(0)), None], wanted);
        guard.sent(input);
        let before_m = keeper.scene.ego.s_m;
        keeper.send(&input);
        let travelled_m = keeper.scene.ego.s_m - before_m;
        move_leader(&mut keeper.scene, 0.0, travelled_m);
        assert!(keeper.scene.neighbors[0].gap_m(4.8) > 0.5);
    }
    assert!(keeper.scene.neighbors[0].gap_m(4.8) < 20.0);
}
