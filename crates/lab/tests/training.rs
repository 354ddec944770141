//! Training that stops and goes on: the same bits for every learner.

use lanecraft_lab::config::RunConfig;
use lanecraft_lab::train::Trainer;
use lanecraft_learn::{Algorithm, LearnerConfig};

/// A training of a second or less.
fn small(learner: &LearnerConfig) -> RunConfig {
    let learner = LearnerConfig { core: vec![8], head: vec![8], batch: 8, learning_starts: 30, ..learner.clone() };
    let mut config = RunConfig { learner, ..RunConfig::default() };
    config.training.environments = 3;
    config.training.decisions = 100;
    config.environment.env.episode_s = 4.0;
    config
}

fn drive(trainer: &mut Trainer, decisions: u64) {
    while trainer.decisions() < decisions {
        trainer.round().expect("training goes on");
    }
}

#[test]
fn a_training_taken_up_again_has_the_bits_of_one_that_was_not_stopped() {
    let default = LearnerConfig::default;
    let learners = [
        LearnerConfig { n_step: 3, ..default() },
        LearnerConfig { prior_scale: 1.0, ..default() },
        LearnerConfig { algorithm: Algorithm::DuelingDqn, ..default() },
        LearnerConfig { algorithm: Algorithm::QuantileDqn, n_step: 5, ..default() },
    ];
    for config in learners.map(|learner| small(&learner)) {
        let mut whole = Trainer::new(&config).expect("valid");
        // In the middle of episodes, with options and returns under way.
        drive(&mut whole, 61);
        let (state, tensors) = whole.checkpoint().expect("can be stored");
        let mut resumed = Trainer::resume(&config, &state, &tensors).expect("can be taken up");
        drive(&mut whole, 100);
        drive(&mut resumed, 100);
        assert!(whole.updates() > 0);
        assert!(whole.checkpoint().unwrap() == resumed.checkpoint().unwrap(), "{:?}", config.learner);
    }
}

#[test]
fn returns_over_several_decisions_lose_no_decision() {
    // Every decision of a finished episode becomes a transition, however many of them a return sums; but for an option that the time
    // limit cuts off.
    let stored = |n_step| {
        let config = small(&LearnerConfig { n_step, ..LearnerConfig::default() });
        let mut trainer = Trainer::new(&config).expect("valid");
        drive(&mut trainer, 29);
        trainer.checkpoint().expect("can be stored").0.learner.replay_pushed
    };
    let (one, three) = (stored(1), stored(3));
    // Up to two decisions of each of the three environments still wait.
    assert!(three < one && one - three <= 6, "{one} and {three}");
}
