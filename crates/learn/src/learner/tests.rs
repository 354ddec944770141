//! Learning, reproducibility and refusals of the shared training step.

use std::sync::Arc;

use super::{Learner, Scratch, UpdateError};
use crate::{Actor, Algorithm, Exploration, LearnerConfig, OptionAccumulator, ReplayBuffer, Transition};
use lanecraft_net::random::Stream;
use lanecraft_net::{Ensemble, Workspace};

fn small(algorithm: Algorithm) -> LearnerConfig {
    LearnerConfig {
        algorithm,
        heads: 4,
        core: vec![16],
        head: vec![16],
        learning_rate: 3e-3,
        batch: 32,
        replay_capacity: 2_000,
        learning_starts: 100,
        target_update_period: 50,
        decisions_per_update: 1,
        reward_scale: 1.0,
        ..LearnerConfig::default()
    }
}

const CELLS: usize = 5;
const DECISIONS: u64 = 3_000;

fn one_hot(cell: usize) -> Vec<f32> {
    (0..CELLS).map(|i| f32::from(u8::from(i == cell))).collect()
}

/// A corridor with the actions left, right and a jump that pays 100 and is never allowed. Left is not allowed in cell 0.
fn corridor_mask(cell: usize) -> u32 {
    if cell == 0 { 0b010 } else { 0b011 }
}

/// Going right from the last cell pays 1 and ends the episode; staying alive pays nothing.
fn corridor_step(cell: usize, action: usize) -> (usize, f64, bool) {
    match action {
        0 => (cell - 1, 0.0, false),
        1 if cell + 1 == CELLS => (cell, 1.0, true),
        1 => (cell + 1, 0.0, false),
        _ => unreachable!("the jump is masked"),
    }
}

fn train_corridor(config: &LearnerConfig) -> (Learner, ReplayBuffer) {
    let mut learner = Learner::new(config, CELLS, 3, 11).unwrap();
    let mut replay = learner.empty_replay();
    let (mut cell, mut episode, mut steps) = (0, 0, 0);
    for decision in 1..=DECISIONS {
        let mut actor = Actor::new(learner.policy());
        let exploration = Exploration { head: learner.head(episode), epsilon: learner.epsilon(decision, DECISIONS) };
        let mut stream = learner.exploration_stream(decision);
        let action = actor.act(&one_hot(cell), corridor_mask(cell), exploration, &mut stream).unwrap();
        let (next, reward, terminated) = corridor_step(cell, action);
        let mut option = OptionAccumulator::start(one_hot(cell), action, config);
        option.tick(reward);
        let mask = learner.bootstrap_mask(replay.pushed());
        replay.push(&option.finish(one_hot(next), corridor_mask(next), terminated, mask)).unwrap();
        if learner.is_update_due(decision, &replay) {
            learner.update(&replay, learner.learning_rate(decision, DECISIONS)).unwrap();
        }
        steps += 1;
        (cell, episode, steps) = if terminated || steps == 50 { (0, episode + 1, 0) } else { (next, episode, steps) };
    }
    (learner, replay)
}

const ALGORITHMS: [Algorithm; 5] =
    [Algorithm::Dqn, Algorithm::DoubleDqn, Algorithm::BootstrappedDqn, Algorithm::DuelingDqn, Algorithm::QuantileDqn];

/// Every algorithm, and bootstrapped deep Q-learning with a prior.
fn all_learners() -> Vec<LearnerConfig> {
    let with_prior = LearnerConfig { prior_scale: 0.5, ..small(Algorithm::BootstrappedDqn) };
    ALGORITHMS.map(small).into_iter().chain([with_prior]).collect()
}

#[test]
fn every_learner_learns_the_corridor_to_its_known_values() {
    for config in all_learners() {
        let (algorithm, prior) = (config.algorithm, config.prior_scale);
        let (learner, _) = train_corridor(&config);
        let mut actor = Actor::new(learner.policy());
        for cell in 0..CELLS {
            let choice = actor.greedy(&one_hot(cell), corridor_mask(cell)).unwrap();
            // The optimal value of going right from cell i is γ^(4−i), by the Bellman equation.
            let value = (cell + 1..CELLS).fold(1.0, |value, _| value * config.discount);
            assert_eq!(choice.action, 1, "{algorithm:?}, prior {prior}, in cell {cell}");
            let error = (choice.q - value).abs();
            assert!(error < 0.08, "{algorithm:?}, prior {prior}, in cell {cell}: {} for {value}", choice.q);
        }
    }
}

fn noise_buffer(learner: &Learner, count: usize) -> ReplayBuffer {
    let (mut replay, mut stream) = (learner.empty_replay(), Stream::new(5, "noise"));
    for _ in 0..count {
        let observation = (0..CELLS).map(|_| stream.normal() as f32).collect();
        let next_observation = (0..CELLS).map(|_| stream.normal() as f32).collect();
        let bootstrap_mask = learner.bootstrap_mask(replay.pushed());
        replay
            .push(&Transition {
                observation,
                action: stream.below(3),
                reward: stream.normal() as f32,
                discount: if stream.bernoulli(0.1) { 0.0 } else { 0.9 },
                next_observation,
                next_action_mask: 1 + stream.below(7) as u32,
                bootstrap_mask,
            })
            .unwrap();
    }
    replay
}

fn parameters_after(config: &LearnerConfig, updates: usize) -> Vec<f32> {
    let mut learner = Learner::new(config, CELLS, 3, 3).unwrap();
    let replay = noise_buffer(&learner, 300);
    for _ in 0..updates {
        learner.update(&replay, 1e-3).unwrap();
    }
    learner.network.trained.parameters().to_vec()
}

#[test]
fn one_bootstrapped_head_that_sees_everything_is_deep_q_learning_bit_for_bit() {
    let single = |double_targets| LearnerConfig {
        heads: 1,
        mask_probability: 1.0,
        double_targets,
        ..small(Algorithm::BootstrappedDqn)
    };
    let updates = 120;
    assert_eq!(parameters_after(&small(Algorithm::Dqn), updates), parameters_after(&single(false), updates));
    assert_eq!(parameters_after(&small(Algorithm::DoubleDqn), updates), parameters_after(&single(true), updates));
    assert_ne!(parameters_after(&small(Algorithm::Dqn), updates), parameters_after(&single(true), updates));
}

/// FNV-1a of the bits, after Fowler, Noll and Vo.
fn fingerprint(values: &[f32]) -> u64 {
    let bytes = values.iter().flat_map(|value| value.to_le_bytes());
    bytes.fold(0xCBF2_9CE4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3))
}

#[test]
fn training_has_these_bits_on_every_processor() {
    // A change of these numbers means that results of older trainings no longer repeat: say so in the change log.
    let found: Vec<u64> = all_learners().iter().map(|config| fingerprint(&parameters_after(config, 100))).collect();
    let expected = [
        0x2DAE_B3C2_7967_FB0C,
        0xCEFF_C037_3925_AC95,
        0x6B7E_66B9_1213_442C,
        0xF933_3B97_1083_F4AA,
        0x02AF_9E41_5D21_8068,
        0xDF06_C644_4C18_A87A,
    ];
    assert_eq!(found, expected, "{found:#018X?}");
}

#[test]
fn a_policy_stays_as_it_was_while_the_learner_goes_on() {
    let mut learner = Learner::new(&small(Algorithm::BootstrappedDqn), CELLS, 3, 3).unwrap();
    let replay = noise_buffer(&learner, 200);
    let policy = learner.policy();
    let before = policy.network().parameters().to_vec();
    learner.update(&replay, 1e-3).unwrap();
    assert_eq!(policy.network().parameters(), before);
    assert_ne!(learner.policy().network().parameters(), before);
}

#[test]
fn the_target_follows_after_each_period() {
    let mut learner = Learner::new(&small(Algorithm::Dqn), CELLS, 3, 3).unwrap();
    let replay = noise_buffer(&learner, 200);
    let start = learner.target.trained.parameters().to_vec();
    for update in 1..=100_u64 {
        learner.update(&replay, 1e-3).unwrap();
        let synced = learner.target.trained.parameters() == learner.network.trained.parameters();
        assert_eq!(synced, update % 50 == 0, "update {update}");
        assert_eq!(learner.target.trained.parameters() == start, update < 50);
    }
}

#[test]
fn a_head_that_no_mask_names_keeps_its_weights() {
    let config = small(Algorithm::BootstrappedDqn);
    let mut learner = Learner::new(&config, CELLS, 3, 3).unwrap();
    let mut replay = noise_buffer(&learner, 200);
    replay.fields.bootstrap_mask.fill(0b1011);
    let before = learner.network.trained.parameters().to_vec();
    learner.update(&replay, 1e-3).unwrap();
    let after = learner.network.trained.parameters();
    for slot in learner.network.trained.shape().tensors().iter().filter(|slot| slot.name.starts_with("head")) {
        let size = slot.range.len() / 4;
        for head in 0..4 {
            let range = slot.range.start + head * size..slot.range.start + (head + 1) * size;
            assert_eq!(before[range.clone()] == after[range], head == 2, "{} of head {head}", slot.name);
        }
    }
}

#[test]
fn masks_have_the_wanted_share_and_heads_are_drawn_evenly() {
    let learner = Learner::new(&LearnerConfig::default(), 2, 3, 9).unwrap();
    let draws = 4_000_u64;
    let ones: u32 = (0..draws).map(|i| learner.bootstrap_mask(i).count_ones()).sum();
    // Six standard deviations of a binomial with 24 000 draws of 0.5 are 0.019 of the share.
    assert!((f64::from(ones) / (6.0 * draws as f64) - 0.5).abs() < 0.02);
    let mut counts = [0_i64; 6];
    (0..6_000).for_each(|episode| counts[learner.head(episode)] += 1);
    assert!(counts.iter().all(|count| (count - 1_000).abs() < 180), "{counts:?}");
}

#[test]
fn schedules_end_where_they_should() {
    let learner = Learner::new(&small(Algorithm::Dqn), 2, 3, 9).unwrap();
    let near = |x: f64, y: f64| assert!((x - y).abs() < 1e-12, "{x} {y}");
    near(learner.epsilon(0, 1_000), 1.0);
    near(learner.epsilon(100, 1_000), 0.525);
    near(learner.epsilon(200, 1_000), 0.05);
    near(learner.epsilon(900, 1_000), 0.05);
    near(learner.learning_rate(0, 1_000), 3e-3);
    near(learner.learning_rate(1_000, 1_000), 3e-3 * 0.05);
    let bootstrapped = Learner::new(&small(Algorithm::BootstrappedDqn), 2, 3, 9).unwrap();
    near(bootstrapped.epsilon(0, 1_000), 0.05);
}

#[test]
fn divergence_is_reported_and_changes_nothing() {
    let mut learner = Learner::new(&small(Algorithm::Dqn), CELLS, 3, 3).unwrap();
    let mut replay = noise_buffer(&learner, 200);
    learner.update(&replay, 1e-3).unwrap();
    let before = learner.network.trained.parameters().to_vec();
    replay.fields.observation.fill(f32::MAX);
    let refused = learner.update(&replay, 1e-3).unwrap_err();
    let UpdateError::NotFinite { update: 2, batch, .. } = &refused else { panic!("{refused:?}") };
    assert!(batch.len() == 32 && batch.iter().all(|slot| *slot < 200));
    assert!(refused.to_string().contains(&format!("{batch:?}")));
    assert_eq!(learner.network.trained.parameters(), before);
}

#[test]
fn buffers_too_short_or_of_other_dimensions_are_refused() {
    let mut learner = Learner::new(&small(Algorithm::Dqn), CELLS, 3, 3).unwrap();
    let replay = noise_buffer(&learner, 99);
    assert_eq!(learner.update(&replay, 1e-3), Err(UpdateError::TooFew { found: 99, needed: 100 }));
    assert!(!learner.is_update_due(1, &replay));
    assert!(matches!(learner.update(&replay, f64::NAN), Err(UpdateError::LearningRate { .. })));
    let other = ReplayBuffer::new(10, 2, 3);
    assert!(matches!(learner.update(&other, 1e-3), Err(UpdateError::Dimensions { .. })));
}

/// The loss of the batch of the next update.
fn batch_loss(learner: &mut Learner, replay: &ReplayBuffer) -> f64 {
    learner.sample(replay);
    learner.evaluate();
    learner.estimate_slopes(replay).loss
}

#[test]
fn every_gradient_is_that_of_central_differences() {
    for config in all_learners() {
        // With one head that sees every row, the loss told is the loss whose gradient is taken.
        let config =
            LearnerConfig { heads: 1, mask_probability: 1.0, core: vec![6], head: vec![5], quantiles: 4, ..config };
        let mut learner = Learner::new(&config, CELLS, 3, 3).unwrap();
        let replay = noise_buffer(&learner, 300);
        learner.update(&replay, 1e-2).unwrap();
        batch_loss(&mut learner, &replay);
        let Scratch { workspace, observation, slopes, gradient, .. } = &mut learner.scratch;
        learner.network.backward(observation, slopes, workspace, gradient);
        let (gradient, shape) = (gradient.clone(), learner.network.trained.shape().clone());
        let core_end = shape.tensors()[1].range.end;
        // As in the network's own test: rounding stays near 1e-3 in the quotient, and a rectifier or an error of size κ may
        // switch inside the step, hence the share.
        let step = 1.0 / 1024.0_f32;
        let close = (0..gradient.len()).filter(|&index| {
            let mut at = |value: f32| {
                let parameter = &mut Arc::make_mut(&mut learner.network.trained).parameters_mut()[index];
                let before = std::mem::replace(parameter, *parameter + value);
                let loss = batch_loss(&mut learner, &replay);
                Arc::make_mut(&mut learner.network.trained).parameters_mut()[index] = before;
                loss
            };
            let numeric = (at(step) - at(-step)) / (2.0 * f64::from(step));
            // Two streams count as two heads, by which the ensemble divides the core's gradient.
            let scale = if index < core_end { shape.heads as f64 } else { 1.0 };
            let analytic = scale * f64::from(gradient[index]);
            (numeric - analytic).abs() <= 5e-3 * (1.0 + analytic.abs())
        });
        let share = close.count() as f64 / gradient.len() as f64;
        assert!(share > 0.99, "{share} of the gradient of {:?}, prior {}", config.algorithm, config.prior_scale);
    }
}

#[test]
fn the_prior_is_added_to_every_head_and_never_learns() {
    let config = LearnerConfig { prior_scale: 0.5, ..small(Algorithm::BootstrappedDqn) };
    let mut learner = Learner::new(&config, CELLS, 3, 3).unwrap();
    let replay = noise_buffer(&learner, 200);
    let prior = learner.network.prior.clone().unwrap();
    let before = prior.network.parameters().to_vec();
    for _ in 0..60 {
        learner.update(&replay, 1e-3).unwrap();
    }
    // Past a copy into the target network, all three still have the prior of the beginning.
    for network in [&learner.network, &learner.target, &learner.policy().network] {
        assert_eq!(network.prior.as_ref().unwrap().network.parameters(), before);
    }
    let observation = [0.3, -1.0, 0.7, 0.1, 2.0];
    let pass = |network: &Ensemble| network.forward(&observation, &mut Workspace::new(network, 1)).to_vec();
    let (trained, prior) = (pass(&learner.network.trained), pass(&prior.network));
    assert!(prior.chunks_exact(3).skip(1).all(|head| *head != prior[..3]));
    let mut actor = Actor::new(learner.policy());
    for head in 0..4 {
        let q: Vec<f32> = (3 * head..3 * head + 3).map(|i| trained[i] + 0.5 * prior[i]).collect();
        let exploration = Exploration { head, epsilon: 0.0 };
        let action = actor.act(&observation, 0b111, exploration, &mut Stream::new(1, "test")).unwrap();
        assert!(q.iter().all(|value| *value <= q[action]));
    }
    let choice = actor.greedy(&observation, 0b010).unwrap();
    let mean = (0..4).map(|head| f64::from(trained[3 * head + 1] + 0.5 * prior[3 * head + 1])).sum::<f64>() / 4.0;
    assert!((choice.q - mean).abs() < 1e-6);
}

#[test]
fn without_a_scale_there_is_no_prior_and_other_learners_have_none() {
    let prior = |config: &LearnerConfig| Learner::new(config, CELLS, 3, 3).unwrap().network.prior;
    assert!(prior(&small(Algorithm::BootstrappedDqn)).is_none());
    for algorithm in [Algorithm::Dqn, Algorithm::DuelingDqn, Algorithm::QuantileDqn] {
        assert!(prior(&LearnerConfig { prior_scale: 3.0, ..small(algorithm) }).is_none());
    }
}
