//! Who sits in the seat that decides: a rule or a learned network.

use std::path::Path;

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
}

impl Policy {
    /// The name that results are printed under.
    pub fn name(&self) -> String {
        match self {
            Self::Rule(rule) => format!("rule:{}", rule.name()),
            Self::Learned { name, .. } => name.clone(),
        }
    }
}

/// The name of a run: its folder's.
pub fn run_name(run: &Path) -> String {
    run.file_name().map_or_else(|| run.display().to_string(), |name| name.to_string_lossy().into_owned())
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
}

impl Pilot {
    /// `policy` at the wheel.
    pub fn new(policy: &Policy) -> Self {
        let seat = match policy {
            Policy::Rule(rule) => Seat::Rule(*rule),
            Policy::Learned { network, .. } => Seat::Learned(Box::new(Actor::new(network.clone()))),
        };
        Self { seat, observation: Vec::new() }
    }

    /// The action of the coming tick: *continue* during a lane change, else the policy's choice (the vote, if it is a network).
    pub fn act(&mut self, env: &Env, scenario_seed: u64) -> Result<usize, ActError> {
        if !env.decision_due() {
            return Ok(env.actions().continue_action());
        }
        match &mut self.seat {
            Seat::Rule(rule) => Ok(rule.act(env, scenario_seed)),
            Seat::Learned(actor) => {
                self.observation.resize(env.config().observation.size(), 0.0);
                env.observe(&mut self.observation);
                Ok(actor.greedy(&self.observation, env.mask().0)?.action)
            }
        }
    }
}
