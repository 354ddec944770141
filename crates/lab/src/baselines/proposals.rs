//! A planner without learning and without foresight: proposals are driven in the mind, scored, and the best one is begun.
//!
//! After PDM-Closed (Dauner, Hallgarten, Geiger and Chitta, 2023), which won the planning challenge of nuPlan: a proposal is a path and
//! a way to choose the speed; each is simulated against a forecast of the others and scored by the very terms by which the drive will
//! be judged (Eqs. 5-8). Departures: paths are lanes to go to, one or two away, and not offsets within one; speeds are the reference
//! accelerations of the action set, followed by a car-following law with the spacing of the controller below, a critically damped one in
//! place of the Intelligent Driver Model, whose gap closes too slowly to stand for it; the forecast is the configured one, in which those
//! behind are held back by the ego, as they will be; an infringement costs a fixed penalty and does not end the proposal, so that there
//! is always a best one.

use lanecraft_drive::control::ControlConfig;
use lanecraft_drive::decide::score;
use lanecraft_drive::env::Env;
use lanecraft_drive::plan::{LateralState, Quintic};
use lanecraft_drive::predict::ForecastPoint;
use lanecraft_drive::road::{LaneIndex, Side};
use lanecraft_drive::scene::{Neighbor, Scene};

/// The three numbers of the rule `proposals`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proposals {
    /// How far ahead proposals are simulated, s.
    pub horizon_s: f64,
    /// What a lane change must gain in the mean score of a tick.
    pub gain_threshold: f64,
    /// What it must gain to drive slower than the lane allows. Without it the rule would put off reaching its leader for ever: that costs
    /// nothing within the horizon.
    pub restraint_threshold: f64,
}

impl Default for Proposals {
    /// Chosen on tuning scenarios (`docs/judges.md`); `lanecraft bench proposals` drives a grid around them.
    fn default() -> Self {
        Self { horizon_s: 12.0, gain_threshold: 0.1, restraint_threshold: 1.0 }
    }
}

/// Time between two simulated instants, s: a tick of the default preset, at whose end it is scored.
const STEP_S: f64 = 0.5;
/// Instants for which a reference acceleration is kept to: Eq. 25 pursues it for two seconds.
const GOAL_STEPS: usize = 4;
/// Duration of a lane change that the planner below prefers, s, where the window allows it, and its instants.
const CHANGE_S: f64 = 2.5;
const CHANGE_STEPS: usize = 5;
/// Vehicles further away than this are left out, m.
const RANGE_M: f64 = 130.0;
/// Lateral distance below which two vehicles are in each other's way, m: that of the guard.
const ABREAST_M: f64 = 2.4;
/// Gains of the car-following law, 1/s² and 1/s: critically damped with a time constant of 2.2 s.
const GAP_GAIN: f64 = 0.2;
const SPEED_GAIN: f64 = 0.9;
/// Gap and headway at which a follower is taken to stay behind the ego, m and s: the middle of the human drivers'.
const FOLLOWER_GAP_M: f64 = 2.0;
const FOLLOWER_HEADWAY_S: f64 = 1.4;
/// Time to collision below which a proposal infringes, s (PDM-Closed's bound).
const LEAST_TIME_TO_COLLISION_S: f64 = 1.0;
/// What an infringing instant costs: more than driving can earn in it.
const INFRINGEMENT: f64 = 40.0;

/// A path and a way to choose the speed.
struct Proposal {
    /// The action that begins it.
    action: usize,
    /// Lateral positions at the simulated instants, m.
    d_m: Vec<f64>,
    /// The acceleration does not exceed this, m/s², for so many instants.
    cap: (f64, usize),
    /// What it must earn beyond the others.
    bar: f64,
}

impl Proposals {
    /// The action whose proposal is best. `keep` gives the action with a reference acceleration, `change` that of a lane change if it is
    /// allowed now.
    pub(super) fn act(&self, env: &Env, keep: impl Fn(f64) -> usize, change: impl Fn(Side) -> Option<usize>) -> usize {
        let mut mind = Mind::new(env, self.steps());
        let mut best = (f64::NEG_INFINITY, 0);
        let proposals = self.keeping(env, keep).into_iter().chain(self.changing(env, change));
        for proposal in proposals {
            let worth = mind.mean_score(&proposal) - proposal.bar;
            // The first of equal ones: keeping before changing, in the order of the action set.
            if worth > best.0 {
                best = (worth, proposal.action);
            }
        }
        best.1
    }

    fn steps(&self) -> usize {
        (self.horizon_s / STEP_S) as usize
    }

    /// The present lane at each reference acceleration.
    fn keeping(&self, env: &Env, keep: impl Fn(f64) -> usize) -> Vec<Proposal> {
        let center_m = env.scene().road.lane_center_m(env.driver().target_lane());
        let levels = &env.config().actions.accel_levels_mps2;
        let most_mps2 = levels.iter().fold(f64::NEG_INFINITY, |most, &level| most.max(level));
        let proposal = |&level_mps2: &f64| Proposal {
            action: keep(level_mps2),
            d_m: vec![center_m; self.steps()],
            cap: (level_mps2, GOAL_STEPS),
            bar: if level_mps2 < most_mps2 { self.restraint_threshold } else { 0.0 },
        };
        levels.iter().map(proposal).collect()
    }

    /// The lanes beside, and those beyond them by a second change that follows at once. The speed is held meanwhile.
    fn changing(&self, env: &Env, change: impl Fn(Side) -> Option<usize>) -> Vec<Proposal> {
        let (scene, mut proposals) = (env.scene(), Vec::new());
        for side in Side::BOTH {
            let (Some(action), Ok(window)) = (change(side), env.driver().offer(side)) else { continue };
            let center_m = |lane: LaneIndex| scene.road.lane_center_m(lane);
            let duration_s = CHANGE_S.min(window.longest_s).max(window.shortest_s);
            let first = Quintic::new(window.start, center_m(window.to), duration_s);
            let instants = (duration_s / STEP_S).ceil() as usize;
            let once: Vec<f64> = (1..=self.steps()).map(|step| first.at(step as f64 * STEP_S).0).collect();
            let mut propose = |d_m, instants| {
                proposals.push(Proposal { action, d_m, cap: (0.0, instants), bar: self.gain_threshold });
            };
            if let Some(beyond) = scene.road.beside(window.to, side) {
                let start = LateralState { d_m: center_m(window.to), ..LateralState::default() };
                let second = Quintic::new(start, center_m(beyond), CHANGE_S);
                let mut twice = once.clone();
                for (step, d_m) in twice.iter_mut().enumerate().skip(instants) {
                    *d_m = second.at((step + 1 - instants) as f64 * STEP_S).0;
                }
                propose(twice, instants + CHANGE_STEPS);
            }
            propose(once, instants);
        }
        proposals
    }
}

/// The ego's idea of the next seconds.
struct Mind<'a> {
    scene: &'a Scene,
    control: &'a ControlConfig,
    /// The others within range, as they are now.
    near: Vec<Neighbor>,
    /// What is forecast of them, by instant, then by their order in `near`.
    tracks: Vec<ForecastPoint>,
    /// By how much the ego keeps each of them behind its forecast, m.
    held_m: Vec<f64>,
    /// What the scene becomes.
    imagined: Scene,
}

impl<'a> Mind<'a> {
    fn new(env: &'a Env, steps: usize) -> Self {
        let (scene, forecast) = (env.scene(), env.driver().forecast());
        let is_near = |index: &usize| scene.neighbors[*index].ahead_m.abs() < RANGE_M;
        let indices: Vec<usize> = (0..scene.neighbors.len()).filter(is_near).collect();
        let at = |step: usize| indices.iter().map(move |&index| forecast.at(index, step as f64 * STEP_S));
        let near: Vec<Neighbor> = indices.iter().map(|&index| scene.neighbors[index]).collect();
        Self {
            scene,
            control: &env.config().control,
            tracks: (1..=steps).flat_map(at).collect(),
            held_m: vec![0.0; near.len()],
            imagined: Scene { neighbors: near.clone(), ..scene.clone() },
            near,
        }
    }

    /// Drives a proposal. The mean score of its instants, less what infringements cost.
    fn mean_score(&mut self, proposal: &Proposal) -> f64 {
        self.imagined.ego = self.scene.ego;
        self.imagined.neighbors.copy_from_slice(&self.near);
        self.held_m.fill(0.0);
        let (mut s_m, mut sum) = (0.0, 0.0);
        for (step, &d_m) in proposal.d_m.iter().enumerate() {
            let accel_mps2 = self.accel_mps2(proposal, step);
            let ego = &mut self.imagined.ego;
            let before_mps = ego.speed_mps;
            ego.speed_mps = (before_mps + accel_mps2 * STEP_S).max(0.0);
            ego.d_m = d_m;
            s_m += 0.5 * (before_mps + ego.speed_mps) * STEP_S;
            self.imagined.ego_lane = self.imagined.road.nearest_lane(d_m);
            let infringes = self.move_others(step, s_m);
            sum += score(&self.imagined) - if infringes { INFRINGEMENT } else { 0.0 };
        }
        sum / proposal.d_m.len() as f64
    }

    /// The speed law behind whoever is in the way, now or by the end of a lane change.
    fn accel_mps2(&self, proposal: &Proposal, step: usize) -> f64 {
        let (scene, control) = (&self.imagined, self.control);
        let speed_mps = scene.ego.speed_mps;
        let allowed_mps = control.speed_max_mps.min(scene.road.allowed_speed_mps(scene.ego.s_m));
        let spacing_m = control.spacing_min_m + control.spacing_headway_s * speed_mps;
        let soon_m = proposal.d_m[(step + CHANGE_STEPS - 1).min(proposal.d_m.len() - 1)];
        let in_way = |d_m: f64| (d_m - scene.ego.d_m).abs().min((d_m - soon_m).abs()) < ABREAST_M;
        let mut accel_mps2 = (allowed_mps - speed_mps) / STEP_S;
        for leader in scene.neighbors.iter().filter(|n| n.ahead_m >= 0.0 && in_way(n.d_m)) {
            let spare_m = leader.gap_m(scene.ego_length_m) - spacing_m;
            accel_mps2 = accel_mps2.min(GAP_GAIN * spare_m + SPEED_GAIN * (leader.speed_mps - speed_mps));
        }
        let (cap_mps2, instants) = proposal.cap;
        let most_mps2 = if step < instants { cap_mps2.min(control.accel_max_mps2) } else { control.accel_max_mps2 };
        accel_mps2.min(most_mps2).max(control.accel_min_mps2)
    }

    /// Brings the others to the instant after `step`, when the ego will have driven `s_m`; whether one of them is too close then.
    fn move_others(&mut self, step: usize, s_m: f64) -> bool {
        let (ego, length_m) = (self.imagined.ego, self.imagined.ego_length_m);
        let tracks = &self.tracks[step * self.near.len()..];
        let mut infringes = false;
        for ((neighbor, point), held_m) in self.imagined.neighbors.iter_mut().zip(tracks).zip(&mut self.held_m) {
            let before_m = neighbor.ahead_m;
            neighbor.ahead_m = point.ahead_m - s_m - *held_m;
            (neighbor.d_m, neighbor.speed_mps) = (point.d_m, point.speed_mps);
            if (point.d_m - ego.d_m).abs() >= ABREAST_M {
                continue;
            }
            let touching_m = 0.5 * (neighbor.length_m + length_m);
            if before_m < 0.0 {
                // Whoever follows comes no closer than its headway, or than it is.
                let behind_m = touching_m + FOLLOWER_GAP_M + FOLLOWER_HEADWAY_S * point.speed_mps;
                let excess_m = (neighbor.ahead_m - before_m.max(-behind_m)).max(0.0);
                *held_m += excess_m;
                neighbor.ahead_m -= excess_m;
            }
            let closing_mps = if neighbor.ahead_m >= 0.0 { (ego.speed_mps - point.speed_mps).max(0.0) } else { 0.0 };
            infringes |= neighbor.ahead_m.abs() - touching_m < LEAST_TIME_TO_COLLISION_S * closing_mps;
        }
        infringes
    }
}
