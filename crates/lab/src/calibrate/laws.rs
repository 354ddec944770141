//! Laws of car following, driven behind recorded leaders and fitted to what their followers did.
//!
//! A law starts in the follower's recorded state and then drives alone, so that its errors add up as they would in a simulation
//! (Treiber and Kesting, 2013, chapter 17). It is fitted by the mixed error √(⟨(Δs)²/s⟩ / ⟨s⟩), s the recorded gap and Δs what the simulated
//! one is off: it weighs small gaps more than the absolute error does and large ones more than the relative error does.

use std::ops::AddAssign;

use lanecraft_drive::models::car_following::{CarFollowing, Leader};
use lanecraft_drive::models::idm::IdmParams;
use lanecraft_drive::models::safe_distance::ballistic_step;

use super::episodes::{Episode, Motion};
use super::search::{Range, minimize};
use crate::data::traffic::FRAME_S;

/// Hardest braking of a car on a dry road, m/s²: no law brakes harder.
const HARDEST_BRAKE_MPS2: f64 = 9.0;

/// What drives behind a leader.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// A model of the traffic.
    Model(CarFollowing, IdmParams),
    /// a = k_s (s − s₀ − v T) + k_v (v_l − v), the linear law of constant time headway.
    ConstantHeadway {
        /// Time headway T, s.
        time_headway_s: f64,
        /// Gap at standstill s₀, m.
        min_gap_m: f64,
        /// k_s, 1/s².
        gap_gain: f64,
        /// k_v, 1/s.
        speed_gain: f64,
    },
    /// Takes over the leader's speed at once, so that the gap stays as it is.
    KeepGap,
}

impl Law {
    fn accel_mps2(&self, speed_mps: f64, leader: &Leader) -> f64 {
        match self {
            Self::Model(model, params) => model.accel_mps2(speed_mps, leader, &params.into()),
            Self::ConstantHeadway { time_headway_s, min_gap_m, gap_gain, speed_gain } => {
                gap_gain * (leader.gap_m - min_gap_m - speed_mps * time_headway_s)
                    + speed_gain * (leader.speed_mps - speed_mps)
            }
            Self::KeepGap => (leader.speed_mps - speed_mps) / FRAME_S,
        }
    }

    /// Gap and speed at each step behind the recorded leader, m and m/s, from the recorded start.
    pub fn drive(&self, episode: &Episode) -> Vec<(f64, f64)> {
        let mut states = Vec::with_capacity(episode.follower.len());
        self.visit(episode, |_, gap_m, speed_mps| states.push((gap_m, speed_mps)));
        states
    }

    /// What it is off behind the recorded leader.
    pub fn errors(&self, episode: &Episode) -> Errors {
        let mut errors = Errors::default();
        self.visit(episode, |step, gap_m, speed_mps| {
            if step > 0 {
                errors.note(
                    gap_m - episode.gap_m(step),
                    speed_mps - episode.follower[step].speed_mps,
                    episode.gap_m(step),
                );
            }
        });
        errors
    }

    fn visit(&self, episode: &Episode, mut visit: impl FnMut(usize, f64, f64)) {
        let Motion { mut s_m, mut speed_mps } = episode.follower[0];
        let last = episode.leader.len() - 1;
        for (step, ahead) in episode.leader.iter().enumerate() {
            let gap_m = ahead.s_m - s_m - episode.half_lengths_m;
            visit(step, gap_m, speed_mps);
            let next_mps = episode.leader[(step + 1).min(last)].speed_mps;
            let leader =
                Leader { gap_m, speed_mps: ahead.speed_mps, accel_mps2: (next_mps - ahead.speed_mps) / FRAME_S };
            let accel_mps2 = self.accel_mps2(speed_mps, &leader).max(-HARDEST_BRAKE_MPS2);
            let (moved_m, after_mps) = ballistic_step(speed_mps, accel_mps2, FRAME_S);
            s_m += moved_m;
            speed_mps = after_mps;
        }
    }
}

/// Sums of squares over steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    steps: f64,
    gap_sum_m: f64,
    gap_squares: f64,
    gap_squares_by_gap: f64,
    relative_squares: f64,
    speed_squares: f64,
}

impl Errors {
    fn note(&mut self, gap_error_m: f64, speed_error_mps: f64, gap_m: f64) {
        let square = gap_error_m * gap_error_m;
        self.steps += 1.0;
        self.gap_sum_m += gap_m;
        self.gap_squares += square;
        self.gap_squares_by_gap += square / gap_m;
        self.relative_squares += square / (gap_m * gap_m);
        self.speed_squares += speed_error_mps * speed_error_mps;
    }

    /// Root mean square of the gap's error, m.
    pub fn gap_rmse_m(&self) -> f64 {
        (self.gap_squares / self.steps).sqrt()
    }

    /// Root mean square of the speed's error, m/s.
    pub fn speed_rmse_mps(&self) -> f64 {
        (self.speed_squares / self.steps).sqrt()
    }

    /// Root mean square of the gap's error in shares of the recorded gap.
    pub fn relative_gap_error(&self) -> f64 {
        (self.relative_squares / self.steps).sqrt()
    }

    /// The mixed error.
    pub fn mixed(&self) -> f64 {
        (self.gap_squares_by_gap / self.gap_sum_m).sqrt()
    }
}

impl AddAssign for Errors {
    fn add_assign(&mut self, other: Self) {
        self.steps += other.steps;
        self.gap_sum_m += other.gap_sum_m;
        self.gap_squares += other.gap_squares;
        self.gap_squares_by_gap += other.gap_squares_by_gap;
        self.relative_squares += other.relative_squares;
        self.speed_squares += other.speed_squares;
    }
}

/// A kind of law that is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A model of the traffic.
    Model(CarFollowing),
    /// The linear law of constant time headway.
    ConstantHeadway,
}

/// Where the parameters v₀, T, s₀, a and b are searched.
pub(super) const IDM_RANGES: [Range; 5] = [(15.0, 45.0), (0.1, 3.0), (0.5, 8.0), (0.3, 4.0), (0.3, 6.0)];
/// The same for T, s₀, k_s and k_v.
const HEADWAY_RANGES: [Range; 4] = [(0.1, 3.0), (0.5, 8.0), (0.001, 1.0), (0.0, 2.0)];

/// Where the searches start, far from the walls: the default drivers on a road with a higher limit.
pub(super) const IDM_START: [f64; 5] = [30.0, 1.4, 2.0, 1.5, 2.0];
const HEADWAY_START: [f64; 4] = [1.4, 2.0, 0.1, 0.5];

/// Parameters of IDM from v₀, T, s₀, a and b.
pub(super) fn idm_params(
    [desired_speed_mps, time_headway_s, min_gap_m, max_accel_mps2, comfort_decel_mps2]: [f64; 5],
) -> IdmParams {
    IdmParams { desired_speed_mps, time_headway_s, min_gap_m, max_accel_mps2, comfort_decel_mps2 }
}

impl Kind {
    /// The law of this kind with the least mixed error over the episodes.
    pub fn fit(self, episodes: &[&Episode]) -> Law {
        match self {
            Self::Model(model) => Law::Model(model, idm_params(fit_model(model, episodes, IDM_START))),
            Self::ConstantHeadway => constant_headway(
                minimize(&HEADWAY_RANGES, HEADWAY_START, |p| mixed(&constant_headway(*p), episodes)).point,
            ),
        }
    }
}

fn constant_headway([time_headway_s, min_gap_m, gap_gain, speed_gain]: [f64; 4]) -> Law {
    Law::ConstantHeadway { time_headway_s, min_gap_m, gap_gain, speed_gain }
}

/// v₀, T, s₀, a and b of all drivers in common.
pub(super) fn fit_model(model: CarFollowing, episodes: &[&Episode], start: [f64; 5]) -> [f64; 5] {
    minimize(&IDM_RANGES, start, |p| mixed(&Law::Model(model, idm_params(*p)), episodes)).point
}

/// T and a of one driver, the others as they are in `common`.
///
/// Half a minute of one driver does not tell more: with s₀ and b free as well, two drivers of three end at a wall of either.
pub(super) fn fit_driver(model: CarFollowing, episodes: &[&Episode], common: [f64; 5]) -> [f64; 5] {
    let [v0, t, s0, a, b] = common;
    let whole = |[t, a]: [f64; 2]| [v0, t, s0, a, b];
    let of = |p: &[f64; 2]| mixed(&Law::Model(model, idm_params(whole(*p))), episodes);
    whole(minimize(&[IDM_RANGES[1], IDM_RANGES[3]], [t, a], of).point)
}

/// The mixed error over some episodes.
fn mixed(law: &Law, episodes: &[&Episode]) -> f64 {
    let mut errors = Errors::default();
    for episode in episodes {
        errors += law.errors(episode);
    }
    errors.mixed()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A driver with these parameters behind a leader that goes through 15, 3 and 12 m/s, for 30 s.
    pub(in crate::calibrate) fn made_up(law: &Law, site: usize, vehicle_id: u32, gap_m: f64) -> Episode {
        let speed_mps = |step: usize| {
            let t = step as f64 * FRAME_S + f64::from(vehicle_id);
            9.0 + 6.0 * libm::sin(0.35 * t) * libm::cos(0.11 * t)
        };
        let mut leader = vec![Motion { s_m: gap_m + 5.0, speed_mps: speed_mps(0) }];
        for step in 1..300 {
            let last = leader[step - 1];
            let s_m = last.s_m + 0.5 * (last.speed_mps + speed_mps(step)) * FRAME_S;
            leader.push(Motion { s_m, speed_mps: speed_mps(step) });
        }
        let start = Motion { s_m: 0.0, speed_mps: speed_mps(0) };
        let follower = vec![start; leader.len()];
        let mut episode = Episode { site, vehicle_id, leader, follower, half_lengths_m: 5.0 };
        let driven = law.drive(&episode);
        for (step, (gap_m, speed_mps)) in driven.into_iter().enumerate() {
            let s_m = episode.leader[step].s_m - episode.half_lengths_m - gap_m;
            episode.follower[step] = Motion { s_m, speed_mps };
        }
        episode
    }

    #[test]
    fn known_parameters_are_recovered() {
        let truth = [25.0, 1.1, 3.0, 1.8, 1.2];
        for model in [CarFollowing::Idm, CarFollowing::EnhancedIdm] {
            let law = Law::Model(model, idm_params(truth));
            let episodes: Vec<Episode> = (0..4).map(|id| made_up(&law, 0, id, 8.0 + 4.0 * f64::from(id))).collect();
            let found = fit_model(model, &episodes.iter().collect::<Vec<_>>(), IDM_START);
            for (found, truth) in found.iter().zip(truth) {
                // 2 %: the search stops where the error no longer tells the points apart.
                assert!((found / truth - 1.0).abs() < 0.02, "{model:?}: {found} instead of {truth}");
            }
            let driver = fit_driver(model, &[&episodes[0]], [25.0, 1.4, 3.0, 1.0, 1.2]);
            assert!((driver[1] / 1.1 - 1.0).abs() < 0.02 && (driver[3] / 1.8 - 1.0).abs() < 0.02, "{driver:?}");
        }
    }

    #[test]
    fn the_truth_has_no_error_and_the_errors_are_those_of_a_known_offset() {
        let law = Law::Model(CarFollowing::Idm, idm_params([25.0, 1.1, 3.0, 1.8, 1.2]));
        let episode = made_up(&law, 0, 1, 10.0);
        assert!(law.errors(&episode).mixed() < 1e-12);
        let mut errors = Errors::default();
        errors.note(3.0, -0.5, 10.0);
        errors.note(-4.0, 0.5, 20.0);
        assert!((errors.gap_rmse_m() - 12.5_f64.sqrt()).abs() < 1e-12);
        assert!((errors.relative_gap_error() - (0.5_f64 * (0.09 + 0.04)).sqrt()).abs() < 1e-12);
        assert!((errors.mixed() - ((0.9_f64 + 0.8) / 30.0).sqrt()).abs() < 1e-12);
        assert!((errors.speed_rmse_mps() - 0.5).abs() < 1e-12);
    }

    #[test]
    fn one_who_keeps_the_gap_keeps_it() {
        let episode = made_up(&Law::KeepGap, 0, 2, 15.0);
        // A step's lag behind accelerations of up to 2 m/s²: they change the speed by 12 m/s at most, over 0.15 s.
        assert!((0..300).all(|step| (episode.gap_m(step) - 15.0).abs() < 2.0));
    }
}
