//! Lane changes among cars that brake in full at random: the traffic in which a guard that sees too little fails.

use super::*;
use crate::models::rss::safe_gap_m;
use lanecraft_net::random::Stream;

/// How far from the center of its old lane the ego may still turn back, m.
const TURN_BACK_M: f64 = 0.9;
const CARS: usize = 4;
const CHANGE_S: f64 = 2.5;

/// A straight road with two lanes, cars ahead that speed up, cruise and brake in full at random, and an ego that changes lane
/// whenever the law allows it.
struct Stress {
    scene: Scene,
    accels_mps2: [f64; CARS],
    draw: Stream,
    origin: LaneIndex,
    target: LaneIndex,
    elapsed_s: f64,
    from_m: f64,
    changes: u32,
}

impl Stress {
    fn new(seed: u64, adhesion: f64) -> Self {
        let mut scene = scene(25.0, adhesion);
        scene.neighbors = (0..CARS).map(|i| car(i, 60.0 + 40.0 * i as f64, 25.0)).collect();
        Self {
            scene,
            accels_mps2: [0.0; CARS],
            draw: Stream::new(seed, "control.stress.lanes"),
            origin: LaneIndex(0),
            target: LaneIndex(0),
            elapsed_s: CHANGE_S,
            from_m: 0.0,
            changes: 0,
        }
    }

    fn lanes(&self) -> [Option<LaneIndex>; 2] {
        [Some(self.target), (self.origin != self.target).then_some(self.origin)]
    }

    /// Begins a change if all gaps of the other lane are safe, gives one up if the guard advises it.
    fn decide(&mut self, guard: &Guard, config: &ControlConfig) {
        let braking = config.braking(self.scene.road.adhesion());
        let ego = self.scene.ego;
        if self.origin != self.target {
            if self.elapsed_s >= CHANGE_S {
                self.origin = self.target;
            } else if (ego.d_m - self.scene.road.lane_center_m(self.origin)).abs() < TURN_BACK_M
                && guard.abort_advised(&self.scene, self.origin, self.target).is_some()
            {
                (self.origin, self.target) = (self.target, self.origin);
                (self.elapsed_s, self.from_m) = (0.0, ego.d_m);
            }
        } else if self.draw.bernoulli(0.1) {
            let other = LaneIndex(1 - self.target.0);
            let free = self.scene.neighbors.iter().filter(|n| n.occupies(other)).all(|n| {
                let needed = safe_gap_m(ego.speed_mps, ego.accel_mps2, n.speed_mps, &braking) + 1.0;
                n.gap_m(4.8) > if n.ahead_m > 0.0 { needed } else { 5.0 }
            });
            if free {
                self.changes += 1;
                self.target = other;
                (self.elapsed_s, self.from_m) = (0.0, ego.d_m);
            }
        }
    }

    fn reference(&self) -> [f64; 6] {
        let (shift, t) = (self.scene.road.lane_center_m(self.target) - self.from_m, CHANGE_S);
        let t3 = t * t * t;
        [self.from_m, 0.0, 0.0, 10.0 * shift / t3, -15.0 * shift / (t3 * t), 6.0 * shift / (t3 * t * t)]
    }

    fn move_cars(&mut self, k: u32, travelled_m: f64, hardest_mps2: f64) {
        let lanes = self.lanes();
        for (i, n) in self.scene.neighbors.iter_mut().enumerate() {
            if k.is_multiple_of(20) {
                let brakes = self.draw.bernoulli(0.15) || n.speed_mps > 33.0;
                self.accels_mps2[i] = if brakes { -hardest_mps2 } else { self.draw.range(-1.0, 3.0) };
            }
            let mut next = (n.speed_mps + self.accels_mps2[i] * PERIOD_S).max(0.0);
            if n.ahead_m < 0.0 && lanes.into_iter().flatten().any(|lane| n.occupies(lane)) {
                // Whoever is behind yields.
                next = next.min(self.scene.ego.speed_mps);
            }
            n.ahead_m += 0.5 * (n.speed_mps + next) * PERIOD_S - travelled_m;
            n.speed_mps = next;
            if n.ahead_m < -40.0 {
                // Far enough for any speed the ego reaches, whatever the road.
                *n = car(i, self.draw.range(220.0, 300.0), self.draw.range(0.0, 30.0));
            }
        }
        self.scene.neighbors.sort_by(|a, b| a.ahead_m.total_cmp(&b.ahead_m).then(a.id.cmp(&b.id)));
    }

    /// The first car ahead that the ego's body overlaps.
    fn touched(&self) -> Option<&Neighbor> {
        let d_m = self.scene.ego.d_m;
        self.scene.neighbors.iter().find(|n| n.ahead_m > 0.0 && n.ahead_m < 4.8 && (n.d_m - d_m).abs() < 1.9)
    }
}

/// Cars take the lanes in turn.
fn car(index: usize, ahead_m: f64, speed_mps: f64) -> Neighbor {
    let lane = LaneIndex((index % 2) as u8);
    let id = VehicleId(index as u32);
    Neighbor { id, ahead_m, d_m: 3.75 * f64::from(lane.0), lane, target_lane: lane, ..leader(0.0, speed_mps) }
}

/// One minute; the number of lane changes begun.
fn run(seed: u64, adhesion: f64) -> u32 {
    let (config, params) = (ControlConfig::default(), VehicleParams::default());
    let guard = Guard::new(&config, &params, PERIOD_S);
    let mut speed = LongitudinalMpc::new(&config, &params, PERIOD_S);
    let mut steer = LateralMpc::new(&config, &params, PERIOD_S);
    let hardest = config.braking(adhesion).leader_brake_mps2;
    let mut stress = Stress::new(seed, adhesion);
    for k in 0..1200 {
        stress.decide(&guard, &config);
        let lanes = stress.lanes();
        let forecast = constant_speed(&stress.scene);
        let goal = SpeedGoal { reference_accel_mps2: 2.0, target_speed_mps: 33.333, lanes };
        let plan = speed.plan(&stress.scene, &forecast, &goal, 0.025);
        let coefficients = stress.reference();
        let reference =
            LateralReference::Path { coefficients: &coefficients, duration_s: CHANGE_S, elapsed_s: stress.elapsed_s };
        let turn = steer.plan(&stress.scene, reference, &plan.speeds_mps, 1e-3);
        let wanted = ControlInput { accel_mps2: plan.accel_mps2, steer_rad: turn.steer_rad };
        let (input, _) = guard.check(&stress.scene, lanes, wanted);
        let before_m = stress.scene.ego.s_m;
        drive(&params, &mut stress.scene, &input);
        stress.elapsed_s += PERIOD_S;
        stress.scene.ego_lane = stress.scene.road.nearest_lane(stress.scene.ego.d_m);
        let travelled_m = stress.scene.ego.s_m - before_m;
        stress.move_cars(k, travelled_m, hardest);
        let d_m = stress.scene.ego.d_m;
        assert!((-0.3..4.05).contains(&d_m), "seed {seed}, step {k}: {d_m} m");
        let touched = stress.touched();
        assert!(touched.is_none(), "seed {seed}, step {k}: {touched:?} and {:?}", stress.scene.ego);
    }
    stress.changes
}

#[test]
fn lane_changes_among_braking_cars_touch_nobody() {
    let changes: u32 = (0..25).map(|seed| run(seed, if seed % 4 == 3 { 0.4 } else { 0.85 })).sum();
    assert!(changes > 300, "{changes} lane changes");
}
