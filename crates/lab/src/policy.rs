//! Who sits in the seat that decides: a rule, a learned network, or a caller's own policy.

use std::error::Error;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

use lanecraft_drive::decide::ActionMask;
use lanecraft_drive::env::Env;
use lanecraft_learn::{ActError, Actor};

use crate::baselines::Rule;

/// A policy.
#[derive(Clone, Debug)]
pub enum Policy {
    /// A rule.
    Rule(Rule),
    /// A network, with the name that results are printed under.
    Learned {
        /// For example `bootstrapped-dqn`, or the run's folder.
        name: String,
        /// The network.
        network: lanecraft_learn::Policy,
    },
    /// A caller's own.
    Own(OwnPolicy),
}

/// Why a caller's own policy cannot decide.
pub type OwnError = Box<dyn Error + Send + Sync>;

/// A caller's own policy: an action for each environment in which a decision is due.
///
/// ```
/// use lanecraft_lab::policy::{OwnPolicy, Policy};
///
/// let lowest = |env: &lanecraft_drive::env::Env| Ok(env.mask().0.trailing_zeros() as usize);
/// assert_eq!(Policy::Own(OwnPolicy::new("lowest", lowest)).name(), "lowest");
/// ```
#[derive(Clone)]
pub struct OwnPolicy {
    name: String,
    decide: Arc<Decide>,
}

type Decide = dyn Fn(&Env) -> Result<usize, OwnError> + Send + Sync;

impl OwnPolicy {
    /// The policy that `decide` is, with the name that results are printed under.
    pub fn new(
        name: impl Into<String>,
        decide: impl Fn(&Env) -> Result<usize, OwnError> + Send + Sync + 'static,
    ) -> Self {
        Self { name: name.into(), decide: Arc::new(decide) }
    }
}

impl fmt::Debug for OwnPolicy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OwnPolicy").field("name", &self.name).finish_non_exhaustive()
    }
}

/// Why a policy cannot decide.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
#[non_exhaustive]
pub enum DecideError {
    /// A network.
    Network(#[from] ActError),
    /// A caller's own policy.
    Own(OwnError),
}

impl Policy {
    /// The name that results are printed under.
    pub fn name(&self) -> String {
        match self {
            Self::Rule(rule) => format!("rule:{}", rule.name()),
            Self::Learned { name, .. } | Self::Own(OwnPolicy { name, .. }) => name.clone(),
        }
    }
}

/// The name of a run: its folder's.
pub fn run_name(run: &Path) -> String {
    run.file_name().map_or_else(|| run.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// What a network does with an observation and the mask that belongs to it: it goes on with a lane change under way, and votes where a
/// decision is due, as a [`Pilot`] does.
pub fn vote(actor: &mut Actor, observation: &[f32], mask: ActionMask) -> Result<usize, ActError> {
    // Stands behind the actions that a network chooses among, and is allowed only where no decision is due.
    let continue_action = actor.policy().actions();
    if mask.allows(continue_action) {
        return Ok(continue_action);
    }
    Ok(actor.greedy(observation, mask.0)?.action)
}

/// A policy at the wheel of one environment at a time, with the memory it needs.
#[derive(Clone, Debug)]
pub struct Pilot {
    seat: Seat,
    observation: Vec<f32>,
}

#[derive(Clone, Debug)]
enum Seat {
    Rule(Rule),
    Learned(Box<Actor>),
    Own(OwnPolicy),
}

impl Pilot {
    /// `policy` at the wheel.
    pub fn new(policy: &Policy) -> Self {
        let seat = match policy {
            Policy::Rule(rule) => Seat::Rule(*rule),
            Policy::Learned { network, .. } => Seat::Learned(Box::new(Actor::new(network.clone()))),
            Policy::Own(own) => Seat::Own(own.clone()),
        };
        Self { seat, observation: Vec::new() }
    }

    /// The action of the coming tick: *continue* during a lane change, else the policy's choice (the vote, if it is a network).
    pub fn act(&mut self, env: &Env, scenario_seed: u64) -> Result<usize, DecideError> {
        if !env.decision_due() {
            return Ok(env.actions().continue_action());
        }
        match &mut self.seat {
            Seat::Rule(rule) => Ok(rule.act(env, scenario_seed)),
            Seat::Learned(actor) => {
                self.observation.resize(env.config().observation.size(), 0.0);
                env.observe(&mut self.observation);
                Ok(vote(actor, &self.observation, env.mask())?)
            }
            Seat::Own(own) => (own.decide)(env).map_err(DecideError::Own),
        }
    }
}

#[cfg(test)]
mod tests {
    use lanecraft_drive::decide::ActionMask;
    use lanecraft_learn::{Actor, Learner, LearnerConfig};

    use super::vote;

    #[test]
    fn a_network_goes_on_with_a_lane_change_and_votes_else() {
        let learner = Learner::new(&LearnerConfig::default(), 3, 5, 1).expect("valid");
        let mut actor = Actor::new(learner.policy());
        assert_eq!(vote(&mut actor, &[0.0; 3], ActionMask(0b110_0000)), Ok(5));
        assert_eq!(vote(&mut actor, &[0.0; 3], ActionMask(0b1000)), Ok(3));
        assert!(vote(&mut actor, &[0.0; 3], ActionMask(0)).is_err());
    }
}
