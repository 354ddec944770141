//! Rules of the road as policies: what a learned one has to beat.
//!
//! They sit in the same seat as a learner: they see the scene, choose among the allowed actions, and planner, controllers, shield
//! and guard below are the same. Weights are the constant ones.

use std::str::FromStr;

use lanecraft_drive::decide::{ActionSet, Maneuver};
use lanecraft_drive::env::Env;
use lanecraft_drive::models::idm::{IdmParams, idm_accel, idm_free_accel};
use lanecraft_drive::models::mobil::{AccelChange, MobilParams, MobilSituation, mobil_gain};
use lanecraft_drive::road::{LaneIndex, Side};
use lanecraft_drive::scene::{Neighbor, Scene};
use lanecraft_net::random::Stream;

use super::proposals::Proposals;

/// A baseline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// Always accelerate, never change lane.
    KeepLane,
    /// Any allowed action, each as likely as the others.
    Random,
    /// The human drivers' own model, IDM and MOBIL, with the ego's speed limit as desired speed.
    IdmMobil,
    /// Go where the anticipated speed is highest.
    BestLane(BestLane),
    /// Simulate some proposals and begin the best.
    Proposals(Proposals),
}

/// The two numbers of the rule `best-lane`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BestLane {
    /// A gap of so many seconds' gain counts as one second's worth of speed: the gap beyond 15 m is divided by this, s.
    pub gap_time_s: f64,
    /// Anticipated gain below which the lane is kept, m/s.
    pub gain_threshold_mps: f64,
}

impl Default for BestLane {
    /// The best of a grid on tuning scenarios: `lanecraft bench best-lane` repeats it, `docs/decisions.md` has its table.
    fn default() -> Self {
        Self { gap_time_s: 2.0, gain_threshold_mps: 0.5 }
    }
}

/// A rule that does not exist.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no rule `{name}`; the rules are {}", Rule::NAMES.join(", "))]
pub struct UnknownRule {
    /// The name given.
    pub name: String,
}

impl FromStr for Rule {
    type Err = UnknownRule;

    fn from_str(name: &str) -> Result<Self, UnknownRule> {
        let found = Self::all().into_iter().find(|rule| rule.name() == name);
        found.ok_or_else(|| UnknownRule { name: name.to_owned() })
    }
}

impl Rule {
    /// All names, as they stand after `rule:`.
    pub const NAMES: [&'static str; 5] = ["keep-lane", "random", "idm-mobil", "best-lane", "proposals"];

    /// All rules, in the order of [`Self::NAMES`].
    pub fn all() -> [Self; 5] {
        let (best_lane, proposals) = (Self::BestLane(BestLane::default()), Self::Proposals(Proposals::default()));
        [Self::KeepLane, Self::Random, Self::IdmMobil, best_lane, proposals]
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::KeepLane => Self::NAMES[0],
            Self::Random => Self::NAMES[1],
            Self::IdmMobil => Self::NAMES[2],
            Self::BestLane(_) => Self::NAMES[3],
            Self::Proposals(_) => Self::NAMES[4],
        }
    }

    /// The action in a tick in which a decision is due. `scenario_seed` keys the random rule's draws.
    pub fn act(self, env: &Env, scenario_seed: u64) -> usize {
        let wanted = match self {
            Self::KeepLane => accelerate(env.actions()),
            Self::Random => random(env, scenario_seed),
            Self::IdmMobil => idm_mobil(env),
            Self::BestLane(rule) => rule.act(env),
            Self::Proposals(rule) => {
                rule.act(env, |accel_mps2| keep(env.actions(), accel_mps2), |side| change(env, side))
            }
        };
        if env.mask().allows(wanted) { wanted } else { forced_change(env).unwrap_or(wanted) }
    }
}

/// The lane change that is left where the lane ends and keeping it is no choice.
fn forced_change(env: &Env) -> Option<usize> {
    Side::BOTH.into_iter().find_map(|side| change(env, side))
}

/// The keep action nearest to this acceleration, with constant weights.
fn keep(actions: &ActionSet, accel_mps2: f64) -> usize {
    let levels = actions.decisions().iter().filter_map(|decision| match decision.maneuver {
        Maneuver::Keep { accel_mps2 } => Some(accel_mps2),
        _ => None,
    });
    let nearest = levels.min_by(|a, b| (a - accel_mps2).abs().total_cmp(&(b - accel_mps2).abs()));
    nearest.and_then(|accel_mps2| actions.plain(Maneuver::Keep { accel_mps2 })).unwrap_or(0)
}

fn accelerate(actions: &ActionSet) -> usize {
    keep(actions, 1e3)
}

/// The action that changes to this side, if it is allowed now.
fn change(env: &Env, side: Side) -> Option<usize> {
    let actions = env.actions();
    let action = actions.plain(Maneuver::Change(side)).or_else(|| actions.plain(Maneuver::ChangeWhereRoom));
    action.filter(|&action| env.mask().allows(action))
}

fn random(env: &Env, scenario_seed: u64) -> usize {
    let allowed: Vec<usize> = (0..env.actions().len()).filter(|&action| env.mask().allows(action)).collect();
    let mut stream = Stream::keyed(scenario_seed, "rule.random", u64::from(env.episode().ticks), 0);
    allowed[stream.below(allowed.len())]
}

/// The ego as one of the human drivers, in a hurry.
const EGO_IDM: IdmParams = IdmParams {
    desired_speed_mps: 120.0 / 3.6,
    time_headway_s: 1.0,
    min_gap_m: 2.0,
    max_accel_mps2: 1.5,
    comfort_decel_mps2: 2.0,
};
/// Its lane choice: selfish, as every ego baseline of the field.
const EGO_MOBIL: MobilParams = MobilParams { politeness: 0.0, accel_gain_threshold_mps2: 0.2, safe_decel_mps2: 3.0 };

/// The same, as far as the speed limit lets it.
fn ego_idm(scene: &Scene) -> IdmParams {
    let allowed_mps = scene.road.allowed_speed_mps(scene.ego.s_m);
    IdmParams { desired_speed_mps: EGO_IDM.desired_speed_mps.min(allowed_mps), ..EGO_IDM }
}

fn idm_mobil(env: &Env) -> usize {
    let scene = env.scene();
    let keep_mps2 = ego_accel(scene, scene.ego_lane);
    let mut best: Option<(f64, usize)> = None;
    for side in Side::BOTH {
        let Some(target) = scene.road.beside(scene.ego_lane, side) else { continue };
        let Some(action) = change(env, side) else { continue };
        let situation = MobilSituation {
            changer: AccelChange { keep_mps2, change_mps2: ego_accel(scene, target) },
            new_follower: AccelChange { keep_mps2: 0.0, change_mps2: follower_accel(scene, target) },
            old_follower: AccelChange::default(),
        };
        let gain = mobil_gain(&situation, &EGO_MOBIL);
        if let Some(gain) = gain.filter(|gain| best.is_none_or(|(most, _)| *gain > most)) {
            best = Some((gain, action));
        }
    }
    best.map_or_else(|| keep(env.actions(), keep_mps2), |(_, action)| action)
}

fn ego_accel(scene: &Scene, lane: LaneIndex) -> f64 {
    let (speed_mps, driver) = (scene.ego.speed_mps, ego_idm(scene));
    match scene.leader(lane) {
        Some(leader) => idm_accel(leader.gap_m(scene.ego_length_m), speed_mps, speed_mps - leader.speed_mps, &driver),
        None => idm_free_accel(speed_mps, &driver),
    }
}

/// What the follower in `lane` would have to do behind the ego, if it drives like the ego at its present speed.
fn follower_accel(scene: &Scene, lane: LaneIndex) -> f64 {
    scene.follower(lane).map_or(0.0, |follower| {
        let params = IdmParams { desired_speed_mps: follower.speed_mps.max(20.0), ..EGO_IDM };
        let approach_mps = follower.speed_mps - scene.ego.speed_mps;
        idm_accel(follower.gap_m(scene.ego_length_m), follower.speed_mps, approach_mps, &params)
    })
}

/// Gap that counts for nothing, m.
const SPARE_GAP_M: f64 = 15.0;

impl BestLane {
    fn act(self, env: &Env) -> usize {
        let scene = env.scene();
        let mut best = (self.anticipated_mps(env, scene.leader(scene.ego_lane)) + self.gain_threshold_mps, None);
        for side in Side::BOTH {
            let Some(target) = scene.road.beside(scene.ego_lane, side) else { continue };
            let Some(action) = change(env, side) else { continue };
            let speed_mps = self.anticipated_mps(env, scene.leader(target));
            if speed_mps > best.0 {
                best = (speed_mps, Some(action));
            }
        }
        best.1.unwrap_or_else(|| accelerate(env.actions()))
    }

    /// min(V_max, v_leader + max(gap − 15 m, 0)/τ).
    fn anticipated_mps(self, env: &Env, leader: Option<&Neighbor>) -> f64 {
        let scene = env.scene();
        let max_mps = env.config().control.speed_max_mps.min(scene.road.allowed_speed_mps(scene.ego.s_m));
        leader.map_or(max_mps, |leader| {
            let gap_m = leader.gap_m(scene.ego_length_m);
            (leader.speed_mps + (gap_m - SPARE_GAP_M).max(0.0) / self.gap_time_s).min(max_mps)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Rule;

    #[test]
    fn every_name_is_a_rule_and_others_are_named_in_the_error() {
        for (rule, name) in Rule::all().into_iter().zip(Rule::NAMES) {
            assert_eq!(rule.name(), name);
            assert_eq!(name.parse(), Ok(rule));
        }
        let error = "best-lan".parse::<Rule>().expect_err("misspelt");
        assert!(error.to_string().contains("best-lane"));
    }
}
