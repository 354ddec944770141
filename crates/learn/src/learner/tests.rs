//! Learning, reproducibility and refusals of the shared training step.

use super::{Learner, UpdateError, all_finite, clip, huber};
use crate::{Actor, Algorithm, Exploration, LearnerConfig, OptionAccumulator, ReplayBuffer, Transition};
use lanecraft_net::random::Stream;

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

#[test]
fn every_algorithm_learns_the_corridor_to_its_known_values() {
    for algorithm in [Algorithm::Dqn, Algorithm::DoubleDqn, Algorithm::BootstrappedDqn] {
        let config = small(algorithm);
        let (learner, _) = train_corridor(&config);
        let mut actor = Actor::new(learner.policy());
        for cell in 0..CELLS {
            let choice = actor.greedy(&one_hot(cell), corridor_mask(cell)).unwrap();
            // The optimal value of going right from cell i is γ^(4−i), by the Bellman equation.
            let value = (cell + 1..CELLS).fold(1.0, |value, _| value * config.discount);
            assert_eq!(choice.action, 1, "{algorithm:?} in cell {cell}");
            assert!((choice.q - value).abs() < 0.08, "{algorithm:?} in cell {cell}: {} for {value}", choice.q);
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
    learner.network.parameters().to_vec()
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
    let found = [Algorithm::Dqn, Algorithm::DoubleDqn, Algorithm::BootstrappedDqn]
        .map(|algorithm| fingerprint(&parameters_after(&small(algorithm), 100)));
    assert_eq!(found, [0x2DAE_B3C2_7967_FB0C, 0xCEFF_C037_3925_AC95, 0x6B7E_66B9_1213_442C], "{found:#018X?}");
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
    let start = learner.target.parameters().to_vec();
    for update in 1..=100_u64 {
        learner.update(&replay, 1e-3).unwrap();
        let synced = learner.target.parameters() == learner.network.parameters();
        assert_eq!(synced, update % 50 == 0, "update {update}");
        assert_eq!(learner.target.parameters() == start, update < 50);
    }
}

#[test]
fn a_head_that_no_mask_names_keeps_its_weights() {
    let config = small(Algorithm::BootstrappedDqn);
    let mut learner = Learner::new(&config, CELLS, 3, 3).unwrap();
    let mut replay = noise_buffer(&learner, 200);
    replay.fields.bootstrap_mask.fill(0b1011);
    let before = learner.network.parameters().to_vec();
    learner.update(&replay, 1e-3).unwrap();
    let after = learner.network.parameters();
    for slot in learner.network.shape().tensors().iter().filter(|slot| slot.name.starts_with("head")) {
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
    let before = learner.network.parameters().to_vec();
    replay.fields.observation.fill(f32::MAX);
    assert!(matches!(learner.update(&replay, 1e-3), Err(UpdateError::NotFinite { update: 2, .. })));
    assert_eq!(learner.network.parameters(), before);
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

#[test]
fn the_loss_is_huber_s_with_its_derivative() {
    for error in [-3.0_f32, -1.0, -0.4, 0.0, 0.7, 2.5] {
        let step = 1.0 / 256.0;
        let numeric = (huber(error + step, 1.0) - huber(error - step, 1.0)) / (2.0 * step);
        assert!((numeric - clip(error, 1.0)).abs() < 3e-3, "at {error}");
    }
    assert!(clip(f32::NAN, 1.0).is_nan());
    assert!(all_finite(&[0.0, -1e38]) && !all_finite(&[0.0, f32::NAN]) && !all_finite(&[f32::NEG_INFINITY]));
}
