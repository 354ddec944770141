//! Settings of the value learners.

use lanecraft_net::NetShape;
use serde::{Deserialize, Serialize};

use crate::{Algorithm, Readout};

/// Masks of actions and heads are 32 bits wide.
pub(crate) const MAX_MASK_BITS: usize = 32;
/// Longer observations are a slip of the keyboard.
pub(crate) const MAX_INPUTS: usize = 65_536;
/// More layers or larger batches would ask for more memory than machines have.
const MAX_LAYERS: usize = 8;
const MAX_BATCH: usize = 4096;
/// A width of a layer beyond this is a slip of the keyboard.
const MAX_WIDTH: usize = 4096;
/// A return over more decisions is no longer one of temporal differences.
const MAX_N_STEP: usize = 100;
/// More quantiles than returns could tell apart.
const MAX_QUANTILES: usize = 256;
/// Values are of the order of 1 after `reward_scale`; a prior beyond this would drown them.
const MAX_PRIOR_SCALE: f64 = 100.0;
/// Longer buffers would not fit the memory of the machines this is made for.
const MAX_REPLAY: usize = 100_000_000;

/// Settings of a learner. The defaults are those of preset `default`; the paper's values are named where it prints them
/// (Table III); where it does not, the value of preset `paper` is given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LearnerConfig {
    /// Which learner. Paper: all three, compared.
    pub algorithm: Algorithm,
    /// Heads K of the bootstrapped network (Table III: 6); the other algorithms have one head whatever stands here.
    pub heads: usize,
    /// Widths of the layers that all heads share. Table III prints 128, 64, 64 without the split.
    pub core: Vec<usize>,
    /// Widths of the hidden layers of each head.
    pub head: Vec<usize>,
    /// Learning rate of Adam at the first decision. Paper: 1e-4.
    pub learning_rate: f64,
    /// Share of the learning rate left at the last decision, reached linearly. Preset `paper`: 1 (no decay).
    pub learning_rate_end_fraction: f64,
    /// Discount γ for one tick. Paper: 0.95.
    pub discount: f64,
    /// Decisions whose rewards a return sums before the value of the next state takes over (Hessel et al., 2018). Paper: 1, Eq. 10.
    pub n_step: usize,
    /// Transitions in one update. Paper: 64.
    pub batch: usize,
    /// Transitions the replay buffer holds. Paper: 15 000.
    pub replay_capacity: usize,
    /// Transitions in the buffer before the first update. Paper: a full buffer, 15 000.
    pub learning_starts: usize,
    /// Updates between two copies of the network into the target network. Paper: 500 steps, counted within an episode as
    /// printed, so that episodes shorter than that never copy; here updates are counted over the whole training.
    pub target_update_period: u64,
    /// Decisions between two updates. Preset `paper`: 1.
    pub decisions_per_update: u64,
    /// Share of random decisions at the start, for all learners but `bootstrapped-dqn`. Preset `paper`: 0, no exploration is mentioned.
    pub epsilon_start: f64,
    /// Share of random decisions after the linear decrease. Preset `paper`: 0.
    pub epsilon_end: f64,
    /// Share of all decisions over which the decrease runs.
    pub epsilon_fraction: f64,
    /// Constant share of random decisions for `bootstrapped-dqn`. Preset `paper`: 0.
    pub bootstrapped_epsilon: f64,
    /// Probability that a transition is shown to a head. Preset `paper`: 0.5, the paper gives no distribution.
    pub mask_probability: f64,
    /// Whether the bootstrapped targets take the action from the online network and its value from the target network
    /// (van Hasselt et al., 2016). Preset `paper`: false, Eq. 10 takes the maximum.
    pub double_targets: bool,
    /// Scale β of the fixed random network that is added to each head of `bootstrapped-dqn` (Osband, Aslanides and Cassirer, 2018), in
    /// units of scaled reward; 0 means none. Paper: none.
    pub prior_scale: f64,
    /// Quantiles of each action's return for `quantile-dqn` (Dabney et al., 2018, take 200). Paper: none.
    pub quantiles: usize,
    /// Error at which the Huber loss turns from quadratic to linear.
    pub huber_delta: f64,
    /// Factor on rewards before they are learned from, so that values are of the order of 1.
    pub reward_scale: f64,
}

impl Default for LearnerConfig {
    fn default() -> Self {
        Self {
            algorithm: Algorithm::BootstrappedDqn,
            heads: 6,
            core: vec![128],
            head: vec![64, 64],
            learning_rate: 5e-4,
            learning_rate_end_fraction: 0.05,
            discount: 0.95,
            n_step: 1,
            batch: 64,
            replay_capacity: 50_000,
            learning_starts: 2_000,
            target_update_period: 500,
            decisions_per_update: 4,
            epsilon_start: 1.0,
            epsilon_end: 0.05,
            epsilon_fraction: 0.2,
            bootstrapped_epsilon: 0.05,
            mask_probability: 0.5,
            double_targets: true,
            prior_scale: 0.0,
            quantiles: 16,
            huber_delta: 1.0,
            reward_scale: 0.05,
        }
    }
}

/// A setting outside its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[error("`{key}` is {value}, but must be {allowed}")]
pub struct ConfigError {
    /// Full key, for example `learner.discount`.
    pub key: &'static str,
    /// The value found.
    pub value: String,
    /// What is allowed.
    pub allowed: String,
}

impl LearnerConfig {
    /// Checks every setting; NaN is outside every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.validate_network()?;
        self.validate_counts()?;
        self.validate_numbers()
    }

    fn validate_network(&self) -> Result<(), ConfigError> {
        count("learner.heads", self.heads, 1, MAX_MASK_BITS)?;
        count("learner.quantiles", self.quantiles, 1, MAX_QUANTILES)?;
        widths("learner.core", &self.core)?;
        widths("learner.head", &self.head)
    }

    fn validate_counts(&self) -> Result<(), ConfigError> {
        count("learner.n_step", self.n_step, 1, MAX_N_STEP)?;
        count("learner.batch", self.batch, 1, MAX_BATCH)?;
        count("learner.replay_capacity", self.replay_capacity, 1, MAX_REPLAY)?;
        count("learner.learning_starts", self.learning_starts, 1, self.replay_capacity)?;
        positive("learner.target_update_period", self.target_update_period)?;
        positive("learner.decisions_per_update", self.decisions_per_update)
    }

    fn validate_numbers(&self) -> Result<(), ConfigError> {
        above_zero("learner.learning_rate", self.learning_rate, 1.0)?;
        within("learner.learning_rate_end_fraction", self.learning_rate_end_fraction)?;
        within("learner.discount", self.discount)?;
        within("learner.epsilon_start", self.epsilon_start)?;
        within("learner.epsilon_end", self.epsilon_end)?;
        within("learner.epsilon_fraction", self.epsilon_fraction)?;
        within("learner.bootstrapped_epsilon", self.bootstrapped_epsilon)?;
        above_zero("learner.mask_probability", self.mask_probability, 1.0)?;
        if !(0.0..=MAX_PRIOR_SCALE).contains(&self.prior_scale) {
            return refused("learner.prior_scale", &self.prior_scale, format!("in 0..={MAX_PRIOR_SCALE}"));
        }
        above_zero("learner.huber_delta", self.huber_delta, 1e6)?;
        above_zero("learner.reward_scale", self.reward_scale, 1e6)
    }

    /// The heads the algorithm works with.
    pub fn head_count(&self) -> usize {
        if self.algorithm == Algorithm::BootstrappedDqn { self.heads } else { 1 }
    }

    /// What the outputs of the algorithm's network mean.
    pub fn readout(&self) -> Readout {
        self.algorithm.readout(self)
    }

    /// The scale of the prior that the algorithm works with.
    pub(crate) fn prior_scale_used(&self) -> f64 {
        if self.algorithm == Algorithm::BootstrappedDqn { self.prior_scale } else { 0.0 }
    }

    /// The network for observations of `inputs` numbers and `actions` actions.
    pub fn net_shape(&self, inputs: usize, actions: usize) -> NetShape {
        NetShape {
            inputs,
            core: self.core.clone(),
            head: self.head.clone(),
            outputs: actions * self.readout().per_action(),
            heads: self.head_count() * self.readout().streams(),
        }
    }
}

fn refused(key: &'static str, value: &impl ToString, allowed: String) -> Result<(), ConfigError> {
    Err(ConfigError { key, value: value.to_string(), allowed })
}

pub(crate) fn count(key: &'static str, value: usize, min: usize, max: usize) -> Result<(), ConfigError> {
    if (min..=max).contains(&value) { Ok(()) } else { refused(key, &value, format!("in {min}..={max}")) }
}

fn widths(key: &'static str, widths: &[usize]) -> Result<(), ConfigError> {
    if widths.len() <= MAX_LAYERS && widths.iter().all(|width| (1..=MAX_WIDTH).contains(width)) {
        return Ok(());
    }
    let allowed = format!("a list of at most {MAX_LAYERS} widths in 1..={MAX_WIDTH}");
    Err(ConfigError { key, value: format!("{widths:?}"), allowed })
}

fn positive(key: &'static str, value: u64) -> Result<(), ConfigError> {
    if value > 0 { Ok(()) } else { refused(key, &value, "at least 1".to_owned()) }
}

fn within(key: &'static str, value: f64) -> Result<(), ConfigError> {
    if (0.0..=1.0).contains(&value) { Ok(()) } else { refused(key, &value, "in 0..=1".to_owned()) }
}

pub(crate) fn above_zero(key: &'static str, value: f64, max: f64) -> Result<(), ConfigError> {
    if value > 0.0 && value <= max { Ok(()) } else { refused(key, &value, format!("above 0 and at most {max}")) }
}

#[cfg(test)]
mod tests {
    use super::LearnerConfig;
    use crate::Algorithm;

    #[test]
    fn the_default_is_valid_and_survives_json() {
        let config = LearnerConfig::default();
        config.validate().unwrap();
        let text = serde_json::to_string(&config).unwrap();
        assert!(text.contains("\"bootstrapped-dqn\""));
        assert_eq!(serde_json::from_str::<LearnerConfig>(&text).unwrap(), config);
        assert!(serde_json::from_str::<LearnerConfig>("{\"discuont\": 0.9}").is_err());
    }

    #[test]
    fn values_out_of_range_and_nan_are_refused_by_key() {
        type Change = fn(&mut LearnerConfig);
        let cases: [(&str, Change); 14] = [
            ("learner.heads", |c| c.heads = 33),
            ("learner.core", |c| c.core = vec![0]),
            ("learner.head", |c| c.head = vec![8; 9]),
            ("learner.n_step", |c| c.n_step = 0),
            ("learner.quantiles", |c| c.quantiles = 257),
            ("learner.prior_scale", |c| c.prior_scale = -1.0),
            ("learner.prior_scale", |c| c.prior_scale = f64::NAN),
            ("learner.batch", |c| c.batch = 0),
            ("learner.learning_starts", |c| c.learning_starts = c.replay_capacity + 1),
            ("learner.decisions_per_update", |c| c.decisions_per_update = 0),
            ("learner.learning_rate", |c| c.learning_rate = f64::NAN),
            ("learner.discount", |c| c.discount = 1.01),
            ("learner.huber_delta", |c| c.huber_delta = f64::INFINITY),
            ("learner.mask_probability", |c| c.mask_probability = 0.0),
        ];
        for (key, change) in cases {
            let mut config = LearnerConfig::default();
            change(&mut config);
            assert_eq!(config.validate().unwrap_err().key, key);
        }
    }

    #[test]
    fn only_the_bootstrapped_learner_has_several_heads() {
        let with = |algorithm| LearnerConfig { algorithm, ..LearnerConfig::default() };
        let heads = |algorithm| with(algorithm).head_count();
        assert_eq!([heads(Algorithm::Dqn), heads(Algorithm::DoubleDqn), heads(Algorithm::BootstrappedDqn)], [1, 1, 6]);
        let outputs = |algorithm| {
            let shape = with(algorithm).net_shape(4, 5);
            (shape.heads, shape.outputs)
        };
        // Two streams; 16 quantiles of 5 actions.
        assert_eq!([outputs(Algorithm::DuelingDqn), outputs(Algorithm::QuantileDqn)], [(2, 5), (1, 80)]);
    }
}
