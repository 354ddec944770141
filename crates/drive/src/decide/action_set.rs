//! The finite action set (Table II): three accelerations and a lane change, each with the weights of the controllers below.
//!
//! The paper lists an eight-dimensional vector with continuous weights; a value learner needs a finite set, and only two ratios of the
//! four weights have any effect (departures 1, 2 and 4 in `docs/deviations.md`). A keep action has a speed ratio q1, a lane change a
//! path ratio q2: with three levels each and two sides that makes 3 · 3 + 2 · 3 = 15 actions.
//! Two more indices follow those of the set: *continue* and *abort*, the only ones allowed during a lane change.

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range};
use crate::control::ControlWeights;
use crate::road::Side;

/// How lane changes stand in the action set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LaneChangeActions {
    /// One action for each side.
    LeftAndRight,
    /// A single action, as in Table II; the side with more room is taken.
    One,
}

/// Levels of the actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ActionsConfig {
    /// Reference accelerations of the keep actions, m/s² (Table II: +2, 0, −2).
    pub accel_levels_mps2: Vec<f64>,
    /// Levels of q1 = P1/R1 that a keep action can choose; `docs/motion-control.md` has the catalog and what other levels earn. The
    /// printed tie R1 = 4 P1 fixes it at 0.25.
    pub speed_ratios: Vec<f64>,
    /// Levels of q2 = P21/R2 that a lane change can choose: smooth, middle, exact.
    pub path_ratios: Vec<f64>,
    /// One lane-change action, or one for each side.
    pub lane_change: LaneChangeActions,
    /// q2 while keeping the lane.
    pub keep_path_ratio: f64,
    /// q1 while changing lane.
    pub change_speed_ratio: f64,
}

impl Default for ActionsConfig {
    fn default() -> Self {
        Self {
            accel_levels_mps2: vec![2.0, 0.0, -2.0],
            speed_ratios: vec![0.0025, 0.025, 0.1],
            path_ratios: vec![1e-4, 1e-3, 1e-2],
            lane_change: LaneChangeActions::LeftAndRight,
            keep_path_ratio: 1e-3,
            change_speed_ratio: 0.025,
        }
    }
}

impl ActionsConfig {
    /// Checks every range, and that the set has at most 30 actions (a mask is 32 bits wide).
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_levels("actions.accel_levels_mps2", &self.accel_levels_mps2, -6.0, 4.0)?;
        check_levels("actions.speed_ratios", &self.speed_ratios, 0.0, 10.0)?;
        check_levels("actions.path_ratios", &self.path_ratios, 1e-8, 1e4)?;
        check_range("actions.keep_path_ratio", self.keep_path_ratio, 1e-8, 1e4)?;
        check_range("actions.change_speed_ratio", self.change_speed_ratio, 0.0, 10.0)?;
        let len = self.len();
        if len > 30 {
            return Err(ConfigError::WrongLength { key: "actions", len, allowed: "at most 30 actions in all" });
        }
        Ok(())
    }

    fn len(&self) -> usize {
        let sides = match self.lane_change {
            LaneChangeActions::LeftAndRight => 2,
            LaneChangeActions::One => 1,
        };
        self.accel_levels_mps2.len() * self.speed_ratios.len() + sides * self.path_ratios.len()
    }
}

fn check_levels(key: &'static str, levels: &[f64], min: f64, max: f64) -> Result<(), ConfigError> {
    if levels.is_empty() || levels.len() > 9 {
        return Err(ConfigError::WrongLength { key, len: levels.len(), allowed: "1 to 9 levels" });
    }
    levels.iter().try_for_each(|&level| check_range(key, level, min, max))
}

/// What the car is to do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Maneuver {
    /// Keep the lane with this reference acceleration.
    Keep {
        /// Reference acceleration, m/s².
        accel_mps2: f64,
    },
    /// Change to the lane on this side.
    Change(Side),
    /// Change to the side with more room (the paper's single lane-change action).
    ChangeWhereRoom,
    /// Go on with the lane change under way.
    Continue,
    /// Return to the lane that the car has not left yet.
    Abort,
}

/// A maneuver with the weights of the controllers that drive it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// What to do.
    pub maneuver: Maneuver,
    /// With which weights.
    pub weights: ControlWeights,
}

/// Which actions are allowed: bit i stands for action i.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ActionMask(pub u32);

impl ActionMask {
    /// Whether `action` is allowed.
    pub fn allows(self, action: usize) -> bool {
        action < 32 && self.0 >> action & 1 == 1
    }

    /// The same mask with `action` allowed.
    #[must_use]
    pub fn with(self, action: usize) -> Self {
        Self(self.0 | 1 << action)
    }
}

/// The actions, in order: keep actions by acceleration, then speed ratio; lane changes by side, then path ratio; continue; abort.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionSet {
    decisions: Vec<Decision>,
    keep: ControlWeights,
}

impl ActionSet {
    /// The set with these levels.
    pub fn new(config: &ActionsConfig) -> Result<Self, ConfigError> {
        config.validate()?;
        let mut decisions = Vec::with_capacity(config.len());
        for &accel_mps2 in &config.accel_levels_mps2 {
            decisions.extend(config.speed_ratios.iter().map(|&speed_ratio| Decision {
                maneuver: Maneuver::Keep { accel_mps2 },
                weights: ControlWeights { speed_ratio, path_ratio: config.keep_path_ratio },
            }));
        }
        let changes: &[Maneuver] = match config.lane_change {
            LaneChangeActions::LeftAndRight => &[Maneuver::Change(Side::Left), Maneuver::Change(Side::Right)],
            LaneChangeActions::One => &[Maneuver::ChangeWhereRoom],
        };
        for &maneuver in changes {
            decisions.extend(config.path_ratios.iter().map(|&path_ratio| Decision {
                maneuver,
                weights: ControlWeights { speed_ratio: config.change_speed_ratio, path_ratio },
            }));
        }
        let keep = ControlWeights { speed_ratio: config.change_speed_ratio, path_ratio: config.keep_path_ratio };
        Ok(Self { decisions, keep })
    }

    /// Number of actions among which a policy decides (15 by default); *continue* and *abort* come on top.
    #[expect(clippy::len_without_is_empty, reason = "a set of actions is never empty")]
    pub fn len(&self) -> usize {
        self.decisions.len()
    }

    /// Index of *continue*.
    pub fn continue_action(&self) -> usize {
        self.decisions.len()
    }

    /// Index of *abort*.
    pub fn abort_action(&self) -> usize {
        self.decisions.len() + 1
    }

    /// What `action` stands for, or `None` beyond the last index. *Continue* and *abort* carry weights that nobody reads.
    pub fn decode(&self, action: usize) -> Option<Decision> {
        let rest = [Maneuver::Continue, Maneuver::Abort].map(|maneuver| Decision { maneuver, weights: self.keep });
        self.decisions.iter().chain(&rest).nth(action).copied()
    }

    /// The decisions in order.
    pub fn decisions(&self) -> &[Decision] {
        &self.decisions
    }

    /// The constant weights (q1 = `change_speed_ratio`, q2 = `keep_path_ratio`), for whoever has no opinion on them.
    pub fn plain_weights(&self) -> ControlWeights {
        self.keep
    }

    /// The first action with this maneuver whose weights lie nearest to the constant ones (q1 = `change_speed_ratio`,
    /// q2 = `keep_path_ratio`): what a policy without an opinion on weights takes.
    pub fn plain(&self, maneuver: Maneuver) -> Option<usize> {
        let octaves = |a: f64, b: f64| if a == b { 0.0 } else { libm::log(a.max(1e-9) / b.max(1e-9)).abs() };
        let distance = |d: &Decision| {
            octaves(d.weights.speed_ratio, self.keep.speed_ratio) + octaves(d.weights.path_ratio, self.keep.path_ratio)
        };
        let mut best: Option<(usize, f64)> = None;
        for (action, decision) in self.decisions.iter().enumerate() {
            let away = distance(decision);
            if decision.maneuver == maneuver && best.is_none_or(|(_, least)| away < least) {
                best = Some((action, away));
            }
        }
        best.map(|(action, _)| action)
    }

    /// The action in words.
    pub fn name(&self, action: usize) -> String {
        let Some(decision) = self.decode(action) else { return format!("action {action}") };
        let ControlWeights { speed_ratio, path_ratio } = decision.weights;
        match decision.maneuver {
            Maneuver::Keep { accel_mps2 } if accel_mps2 > 0.0 => format!("accelerate {accel_mps2:+} q1={speed_ratio}"),
            Maneuver::Keep { accel_mps2 } if accel_mps2 < 0.0 => format!("decelerate {accel_mps2:+} q1={speed_ratio}"),
            Maneuver::Keep { .. } => format!("hold q1={speed_ratio}"),
            Maneuver::Change(Side::Left) => format!("change left q2={path_ratio}"),
            Maneuver::Change(Side::Right) => format!("change right q2={path_ratio}"),
            Maneuver::ChangeWhereRoom => format!("change lane q2={path_ratio}"),
            Maneuver::Continue => "continue".to_owned(),
            Maneuver::Abort => "abort".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_set_has_fifteen_actions_and_the_papers_twelve() {
        let set = ActionSet::new(&ActionsConfig::default()).expect("valid");
        assert_eq!(set.len(), 15);
        assert_eq!(set.decode(set.continue_action()).map(|d| d.maneuver), Some(Maneuver::Continue));
        assert_eq!(set.decode(set.abort_action()).map(|d| d.maneuver), Some(Maneuver::Abort));
        assert_eq!(set.decode(17), None);
        let one = ActionsConfig { lane_change: LaneChangeActions::One, ..ActionsConfig::default() };
        assert_eq!(ActionSet::new(&one).expect("valid").len(), 12);
    }

    #[test]
    fn plain_actions_carry_the_constant_weights() {
        let set = ActionSet::new(&ActionsConfig::default()).expect("valid");
        let keep = set.plain(Maneuver::Keep { accel_mps2: 0.0 }).and_then(|a| set.decode(a)).expect("there is one");
        assert_eq!(keep.weights, ControlWeights { speed_ratio: 0.025, path_ratio: 1e-3 });
        let change = set.plain(Maneuver::Change(Side::Right)).and_then(|a| set.decode(a)).expect("there is one");
        assert_eq!(change.weights, ControlWeights { speed_ratio: 0.025, path_ratio: 1e-3 });
        assert_eq!(set.plain(Maneuver::ChangeWhereRoom), None);
    }

    #[test]
    fn empty_and_overfull_levels_are_refused() {
        assert!(ActionsConfig { path_ratios: vec![], ..ActionsConfig::default() }.validate().is_err());
        let many = vec![0.1; 9];
        let config = ActionsConfig { speed_ratios: many.clone(), path_ratios: many, ..ActionsConfig::default() };
        assert!(config.validate().is_err());
    }
}
