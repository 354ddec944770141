//! Learners and policies to and from bytes: numbers as named tensors, everything else as a small serializable struct.
//!
//! A checkpoint holds all that the next update depends on, replay buffer and its position included, so that training
//! continues bit for bit. It holds no time, path or thread count, so that equal trainings give equal bytes. Files, and
//! hashes that prove their content, are the caller's; shapes and ranges are checked here.

use std::sync::Arc;

use lanecraft_net::tensors::{NamedTensor, TensorError, TensorFile, Values, to_bytes};
use lanecraft_net::{Adam, Ensemble, NetShape, ShapeError};
use serde::{Deserialize, Serialize};

use crate::config::{MAX_INPUTS, MAX_MASK_BITS, count};
use crate::prior::Prior;
use crate::q_network::QNetwork;
use crate::replay::{Fields, all_actions};
use crate::{ConfigError, Learner, LearnerConfig, Policy, Readout, ReplayBuffer};

/// Version of the layout of checkpoints and policies; another is refused.
const FORMAT_VERSION: u32 = 1;
/// Counts beyond the integers that f64 and JSON readers hold exactly are damage.
const MAX_COUNT: u64 = 1 << 53;

/// What a checkpoint of a learner holds besides tensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnerMetadata {
    /// Version of the layout.
    pub format_version: u32,
    /// Settings.
    pub config: LearnerConfig,
    /// Length of an observation.
    pub inputs: usize,
    /// Number of actions.
    pub actions: usize,
    /// Seed of all random streams.
    pub seed: u64,
    /// Updates made; together with the seed the state of all random streams.
    pub updates: u64,
    /// Transitions ever pushed to the replay buffer.
    pub replay_pushed: u64,
}

/// What a saved policy holds besides tensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyMetadata {
    /// Version of the layout.
    pub format_version: u32,
    /// Length of an observation.
    pub inputs: usize,
    /// Number of actions.
    pub actions: usize,
    /// Widths of the shared layers.
    pub core: Vec<usize>,
    /// Widths of the hidden layers of each head.
    pub head: Vec<usize>,
    /// Number of heads.
    pub heads: usize,
    /// What the outputs mean; not written if they are plain values.
    #[serde(default, skip_serializing_if = "is_default")]
    pub readout: Readout,
    /// Scale of the prior, whose tensors are then there; not written if it is 0.
    #[serde(default, skip_serializing_if = "is_default")]
    pub prior_scale: f64,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// What is wrong with a checkpoint or a saved policy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// A layout of another version.
    #[error("the format version is {found}, but this program reads {expected}")]
    Version {
        /// Version read by this program.
        expected: u32,
        /// Version found.
        found: u32,
    },
    /// A count that no training reaches.
    #[error("`{key}` is {found}, but must be at most {max}; the metadata are damaged")]
    Count {
        /// Which count.
        key: &'static str,
        /// The count found.
        found: u64,
        /// The largest count accepted.
        max: u64,
    },
    /// Settings outside their range.
    #[error("the metadata are damaged")]
    Config(#[from] ConfigError),
    /// A network that cannot be.
    #[error("the metadata describe no network")]
    Shape(#[from] ShapeError),
    /// Tensors missing, unknown, of another shape or damaged.
    #[error("the tensors do not fit the metadata")]
    Tensor(#[from] TensorError),
    /// A value that no training could have written.
    #[error("tensor `{name}` holds {value} at row {row}, which no training writes; the file is damaged")]
    Value {
        /// Name of the tensor.
        name: &'static str,
        /// Row of the tensor.
        row: usize,
        /// The value, as text.
        value: String,
    },
    /// A replay buffer that belongs to another learner.
    #[error("the replay buffer has capacity, inputs and actions {found:?}, but the learner has {expected:?}")]
    Replay {
        /// Capacity, inputs and actions of the learner.
        expected: (usize, usize, usize),
        /// The same of the buffer.
        found: (usize, usize, usize),
    },
}

impl Learner {
    /// The whole learner and its replay buffer as metadata and the bytes of a safetensors file.
    pub fn to_checkpoint(&self, replay: &ReplayBuffer) -> Result<(LearnerMetadata, Vec<u8>), CheckpointError> {
        let expected = (self.config.replay_capacity, self.inputs, self.actions);
        let found = (replay.capacity, replay.inputs, replay.actions);
        if expected != found {
            return Err(CheckpointError::Replay { expected, found });
        }
        let shape = self.network.trained.shape();
        let mut tensors = network_tensors("network", shape, self.network.trained.parameters());
        tensors.extend(network_tensors("target", shape, self.target.trained.parameters()));
        tensors.extend(network_tensors("adam.first", shape, self.adam.first_moment()));
        tensors.extend(network_tensors("adam.second", shape, self.adam.second_moment()));
        tensors.extend(replay_tensors(replay));
        let metadata = LearnerMetadata {
            format_version: FORMAT_VERSION,
            config: self.config.clone(),
            inputs: self.inputs,
            actions: self.actions,
            seed: self.seed,
            updates: self.updates(),
            replay_pushed: replay.pushed,
        };
        Ok((metadata, to_bytes(&tensors)?))
    }

    /// The learner and the replay buffer of a checkpoint.
    pub fn from_checkpoint(metadata: &LearnerMetadata, bytes: &[u8]) -> Result<(Self, ReplayBuffer), CheckpointError> {
        check_version(metadata.format_version)?;
        check_count("updates", metadata.updates)?;
        check_count("replay_pushed", metadata.replay_pushed)?;
        metadata.config.validate()?;
        check_dimensions(metadata.inputs, metadata.actions)?;
        let shape = metadata.config.net_shape(metadata.inputs, metadata.actions);
        let mut file = TensorFile::parse(bytes)?;
        let network = Ensemble::from_parameters(shape.clone(), read_network(&mut file, "network", &shape)?)?;
        let target = Ensemble::from_parameters(shape.clone(), read_network(&mut file, "target", &shape)?)?;
        let first = read_network(&mut file, "adam.first", &shape)?;
        let second = read_network(&mut file, "adam.second", &shape)?;
        refuse("adam.second", &second, |moment| *moment < 0.0)?;
        let adam = Adam::from_moments(first, second, metadata.updates);
        let replay = read_replay(&mut file, metadata)?;
        file.finish()?;
        Ok((Self::from_parts(metadata.config.clone(), metadata.seed, network, target, adam), replay))
    }
}

impl Policy {
    /// The policy as metadata and the bytes of a safetensors file.
    pub fn to_bytes(&self) -> Result<(PolicyMetadata, Vec<u8>), CheckpointError> {
        let QNetwork { trained, readout, prior } = &self.network;
        let mut tensors = network_tensors("network", trained.shape(), trained.parameters());
        if let Some(prior) = prior {
            tensors.extend(network_tensors("prior", prior.network.shape(), prior.network.parameters()));
        }
        let metadata = PolicyMetadata {
            format_version: FORMAT_VERSION,
            inputs: self.inputs(),
            actions: self.actions(),
            core: trained.shape().core.clone(),
            head: trained.shape().head.clone(),
            heads: self.heads(),
            readout: *readout,
            prior_scale: prior.as_ref().map_or(0.0, |prior| prior.scale),
        };
        Ok((metadata, to_bytes(&tensors)?))
    }

    /// A saved policy.
    pub fn from_bytes(metadata: &PolicyMetadata, bytes: &[u8]) -> Result<Self, CheckpointError> {
        check_version(metadata.format_version)?;
        let shape = metadata.shape()?;
        let mut file = TensorFile::parse(bytes)?;
        let parameters = read_network(&mut file, "network", &shape)?;
        let prior = if metadata.prior_scale > 0.0 {
            let prior_shape = Prior::shape(&shape);
            let parameters = read_network(&mut file, "prior", &prior_shape)?;
            let network = Ensemble::from_parameters(prior_shape, parameters)?;
            Some(Arc::new(Prior { network, scale: metadata.prior_scale }))
        } else {
            None
        };
        file.finish()?;
        let trained = Arc::new(Ensemble::from_parameters(shape, parameters)?);
        Ok(Self { network: QNetwork { trained, readout: metadata.readout, prior } })
    }
}

impl PolicyMetadata {
    /// The shape of the trained network, once everything is in its range.
    fn shape(&self) -> Result<NetShape, CheckpointError> {
        let (core, head, heads) = (self.core.clone(), self.head.clone(), self.heads);
        let (quantiles, prior_scale) = (self.readout.per_action(), self.prior_scale);
        LearnerConfig {
            core: core.clone(),
            head: head.clone(),
            heads,
            quantiles,
            prior_scale,
            ..LearnerConfig::default()
        }
        .validate()?;
        check_dimensions(self.inputs, self.actions)?;
        let (outputs, heads) = (self.actions * quantiles, heads * self.readout.streams());
        let shape = NetShape { inputs: self.inputs, core, head, outputs, heads };
        shape.validate()?;
        Ok(shape)
    }
}

fn check_version(found: u32) -> Result<(), CheckpointError> {
    let expected = FORMAT_VERSION;
    if found == expected { Ok(()) } else { Err(CheckpointError::Version { expected, found }) }
}

fn check_count(key: &'static str, found: u64) -> Result<(), CheckpointError> {
    if found <= MAX_COUNT { Ok(()) } else { Err(CheckpointError::Count { key, found, max: MAX_COUNT }) }
}

fn check_dimensions(inputs: usize, actions: usize) -> Result<(), ConfigError> {
    count("inputs", inputs, 1, MAX_INPUTS)?;
    count("actions", actions, 1, MAX_MASK_BITS)
}

/// One tensor for each weight and bias of a vector laid out like the parameters.
fn network_tensors<'a>(prefix: &str, shape: &NetShape, values: &'a [f32]) -> Vec<NamedTensor<'a>> {
    let slots = shape.tensors().into_iter();
    slots
        .map(|slot| NamedTensor {
            name: format!("{prefix}.{}", slot.name),
            shape: slot.shape,
            values: Values::F32(&values[slot.range]),
        })
        .collect()
}

fn read_network(file: &mut TensorFile<'_>, prefix: &str, shape: &NetShape) -> Result<Vec<f32>, TensorError> {
    let mut values = Vec::new();
    for slot in shape.tensors() {
        values.extend(file.take_f32(&format!("{prefix}.{}", slot.name), &slot.shape)?);
    }
    Ok(values)
}

fn replay_tensors(replay: &ReplayBuffer) -> Vec<NamedTensor<'_>> {
    let (fields, length) = (&replay.fields, replay.len());
    let tensor = |name: &str, columns: Option<usize>, values| NamedTensor {
        name: format!("replay.{name}"),
        shape: std::iter::once(length).chain(columns).collect(),
        values,
    };
    vec![
        tensor("observation", Some(replay.inputs), Values::F32(&fields.observation)),
        tensor("next_observation", Some(replay.inputs), Values::F32(&fields.next_observation)),
        tensor("action", None, Values::U32(&fields.action)),
        tensor("reward", None, Values::F32(&fields.reward)),
        tensor("discount", None, Values::F32(&fields.discount)),
        tensor("next_action_mask", None, Values::U32(&fields.next_action_mask)),
        tensor("bootstrap_mask", None, Values::U32(&fields.bootstrap_mask)),
    ]
}

fn read_replay(file: &mut TensorFile<'_>, metadata: &LearnerMetadata) -> Result<ReplayBuffer, CheckpointError> {
    let (capacity, inputs, actions) = (metadata.config.replay_capacity, metadata.inputs, metadata.actions);
    let length = metadata.replay_pushed.min(capacity as u64) as usize;
    let fields = Fields {
        observation: file.take_f32("replay.observation", &[length, inputs])?,
        next_observation: file.take_f32("replay.next_observation", &[length, inputs])?,
        action: file.take_u32("replay.action", &[length])?,
        reward: file.take_f32("replay.reward", &[length])?,
        discount: file.take_f32("replay.discount", &[length])?,
        next_action_mask: file.take_u32("replay.next_action_mask", &[length])?,
        bootstrap_mask: file.take_u32("replay.bootstrap_mask", &[length])?,
    };
    refuse("replay.action", &fields.action, |action| *action as usize >= actions)?;
    refuse("replay.discount", &fields.discount, |discount| !(0.0..=1.0).contains(discount))?;
    let open: Vec<u32> = fields.discount.iter().map(|discount| u32::from(*discount > 0.0)).collect();
    let allowed: Vec<(u32, u32)> = fields.next_action_mask.iter().copied().zip(open).collect();
    refuse("replay.next_action_mask", &allowed, |(mask, open)| *open == 1 && mask & all_actions(actions) == 0)?;
    Ok(ReplayBuffer { capacity, inputs, actions, pushed: metadata.replay_pushed, fields })
}

/// An error for the first value that is `wrong`.
fn refuse<T: std::fmt::Debug>(
    name: &'static str,
    values: &[T],
    wrong: impl Fn(&T) -> bool,
) -> Result<(), CheckpointError> {
    match values.iter().position(wrong) {
        Some(row) => Err(CheckpointError::Value { name, row, value: format!("{:?}", values[row]) }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::{CheckpointError, LearnerMetadata, PolicyMetadata};
    use crate::{Actor, Algorithm, Learner, LearnerConfig, Policy, Readout, ReplayBuffer, Transition};
    use lanecraft_net::random::Stream;
    use lanecraft_net::tensors::TensorError;

    fn config() -> LearnerConfig {
        LearnerConfig {
            heads: 2,
            core: vec![6],
            head: vec![5],
            batch: 8,
            replay_capacity: 30,
            learning_starts: 10,
            target_update_period: 7,
            ..LearnerConfig::default()
        }
    }

    /// Pushes and updates in turn, as a training does, with an environment that depends on the step alone.
    fn advance(learner: &mut Learner, replay: &mut ReplayBuffer, steps: u64) {
        for _ in 0..steps {
            let mut stream = Stream::keyed(1, "environment", replay.pushed(), 0);
            let transition = Transition {
                observation: (0..3).map(|_| stream.normal() as f32).collect(),
                action: stream.below(4),
                reward: stream.normal() as f32,
                discount: if stream.bernoulli(0.2) { 0.0 } else { 0.9 },
                next_observation: (0..3).map(|_| stream.normal() as f32).collect(),
                next_action_mask: 1 + stream.below(15) as u32,
                bootstrap_mask: learner.bootstrap_mask(replay.pushed()),
            };
            replay.push(&transition).unwrap();
            if replay.len() >= 10 {
                learner.update(replay, 1e-3).unwrap();
            }
        }
    }

    fn trained(steps: u64) -> (Learner, ReplayBuffer) {
        trained_by(&config(), steps)
    }

    /// Every readout, and a prior.
    fn variants() -> [LearnerConfig; 4] {
        [
            config(),
            LearnerConfig { prior_scale: 0.7, ..config() },
            LearnerConfig { algorithm: Algorithm::DuelingDqn, ..config() },
            LearnerConfig { algorithm: Algorithm::QuantileDqn, quantiles: 3, ..config() },
        ]
    }

    fn trained_by(config: &LearnerConfig, steps: u64) -> (Learner, ReplayBuffer) {
        let mut learner = Learner::new(config, 3, 4, 21).unwrap();
        let mut replay = learner.empty_replay();
        advance(&mut learner, &mut replay, steps);
        (learner, replay)
    }

    #[test]
    fn a_resumed_training_continues_bit_for_bit() {
        // 0 and 5: nothing learned yet; 43: the buffer has wrapped and the target is between two copies.
        for (config, steps) in variants().iter().flat_map(|config| [0, 5, 43].map(|steps| (config, steps))) {
            let (mut learner, mut replay) = trained_by(config, steps);
            let (metadata, bytes) = learner.to_checkpoint(&replay).unwrap();
            let text = serde_json::to_string(&metadata).unwrap();
            let metadata: LearnerMetadata = serde_json::from_str(&text).unwrap();
            let (mut resumed, mut resumed_replay) = Learner::from_checkpoint(&metadata, &bytes).unwrap();
            assert_eq!(resumed_replay, replay);
            advance(&mut learner, &mut replay, 40);
            advance(&mut resumed, &mut resumed_replay, 40);
            assert_eq!(learner.to_checkpoint(&replay).unwrap(), resumed.to_checkpoint(&resumed_replay).unwrap());
        }
    }

    #[test]
    fn a_policy_returns_with_the_same_decisions() {
        for config in variants() {
            let (learner, _) = trained_by(&config, 43);
            let (metadata, bytes) = learner.policy().to_bytes().unwrap();
            let text = serde_json::to_string(&metadata).unwrap();
            let metadata: PolicyMetadata = serde_json::from_str(&text).unwrap();
            let policy = Policy::from_bytes(&metadata, &bytes).unwrap();
            assert_eq!((policy.actions(), policy.heads()), (4, config.head_count()));
            let mut stream = Stream::new(1, "test");
            let (mut first, mut second) = (Actor::new(learner.policy()), Actor::new(policy));
            for _ in 0..50 {
                let observation = [0, 1, 2].map(|_| stream.normal() as f32);
                assert_eq!(first.greedy(&observation, 0b1101), second.greedy(&observation, 0b1101));
            }
        }
    }

    #[test]
    fn a_plain_policy_is_written_as_ever_and_others_say_what_they_are() {
        let told =
            |config: &LearnerConfig| serde_json::to_string(&trained_by(config, 0).0.policy().to_bytes().unwrap().0);
        let [plain, prior, dueling, quantile] = variants().map(|config| told(&config).unwrap());
        assert_eq!(plain, r#"{"format_version":1,"inputs":3,"actions":4,"core":[6],"head":[5],"heads":2}"#);
        assert!(prior.contains(r#""prior_scale":0.7"#) && dueling.contains(r#""readout":{"kind":"dueling"}"#));
        assert!(quantile.contains(r#""readout":{"kind":"quantile","quantiles":3}"#));
    }

    #[test]
    fn a_policy_without_its_prior_or_with_an_absurd_readout_is_refused() {
        let [_, with_prior, _, _] = variants();
        let (mut metadata, bytes) = trained_by(&with_prior, 0).0.policy().to_bytes().unwrap();
        metadata.prior_scale = 0.0;
        assert!(matches!(Policy::from_bytes(&metadata, &bytes), Err(CheckpointError::Tensor(_))));
        metadata.prior_scale = f64::NAN;
        assert!(matches!(Policy::from_bytes(&metadata, &bytes), Err(CheckpointError::Config(_))));
        let (mut metadata, bytes) = trained(0).0.policy().to_bytes().unwrap();
        for readout in
            [Readout::Dueling, Readout::Quantile { quantiles: 0 }, Readout::Quantile { quantiles: usize::MAX }]
        {
            metadata.readout = readout;
            assert!(Policy::from_bytes(&metadata, &bytes).is_err());
        }
        (metadata.readout, metadata.heads) = (Readout::Dueling, 32);
        assert!(matches!(Policy::from_bytes(&metadata, &bytes), Err(CheckpointError::Shape(_))));
    }

    #[test]
    fn other_shapes_are_named_with_both_shapes() {
        let (learner, replay) = trained(20);
        let (mut metadata, bytes) = learner.to_checkpoint(&replay).unwrap();
        metadata.config.heads = 3;
        let refused = Learner::from_checkpoint(&metadata, &bytes).unwrap_err();
        let CheckpointError::Tensor(TensorError::Shape { name, expected, found }) = refused else {
            panic!("{refused:?}");
        };
        assert_eq!((name.as_str(), expected, found), ("network.head.0.weight", vec![3, 6, 5], vec![2, 6, 5]));
        metadata.config.heads = 2;
        metadata.updates = u64::MAX;
        let refused = Learner::from_checkpoint(&metadata, &bytes);
        assert!(matches!(refused, Err(CheckpointError::Count { key: "updates", .. })));
        metadata.format_version = 2;
        let refused = Learner::from_checkpoint(&metadata, &bytes);
        assert!(matches!(refused, Err(CheckpointError::Version { expected: 1, found: 2 })));
        let other = ReplayBuffer::new(5, 3, 4);
        assert!(matches!(learner.to_checkpoint(&other), Err(CheckpointError::Replay { .. })));
    }

    #[test]
    fn every_cut_is_refused_and_no_flipped_bit_panics() {
        let (learner, replay) = trained(12);
        let (metadata, bytes) = learner.to_checkpoint(&replay).unwrap();
        for length in 0..bytes.len() {
            assert!(Learner::from_checkpoint(&metadata, &bytes[..length]).is_err(), "{length} of {}", bytes.len());
        }
        for byte in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[byte] ^= 1 << (byte % 8);
            // A changed number may still be a number, which only a hash of the content shows; it must load and act.
            if let Ok((mut loaded, mut replay)) = Learner::from_checkpoint(&metadata, &damaged) {
                let _ = loaded.update(&replay, 1e-3);
                let _ = Actor::new(loaded.policy()).greedy(&[0.1, 0.2, 0.3], 0b1111);
                let _ = replay.push(&replay.get(0).unwrap());
            }
        }
    }

    #[test]
    fn values_that_no_training_writes_are_refused() {
        let damage: [fn(&mut ReplayBuffer); 3] = [
            |replay| replay.fields.action[3] = 4,
            |replay| replay.fields.discount[3] = -0.5,
            |replay| (replay.fields.discount[3], replay.fields.next_action_mask[3]) = (0.9, 0b1_0000),
        ];
        for damage in damage {
            let (learner, mut replay) = trained(12);
            damage(&mut replay);
            let (metadata, bytes) = learner.to_checkpoint(&replay).unwrap();
            let refused = Learner::from_checkpoint(&metadata, &bytes);
            assert!(matches!(refused, Err(CheckpointError::Value { row: 3, .. })));
        }
    }
}
