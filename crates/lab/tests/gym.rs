//! Environments as learners see them: the bits of the loop, at any number of threads, and nothing moves on bad actions.

use std::sync::Arc;

use lanecraft_drive::env::{Config, Env};
use lanecraft_drive::kinematic::KinematicConfig;
use lanecraft_lab::baselines::Rule;
use lanecraft_lab::evaluate::record;
use lanecraft_lab::gym::{Actions, Autoreset, Gym, GymError, MaskedActions, Outputs, Seat, Task, Units, VectorGym};
use lanecraft_lab::policy::Policy;

fn config() -> Arc<Config> {
    let mut config = Config::default();
    config.env.episode_s = 4.0;
    Arc::new(config)
}

fn drive(seat: Seat, masked: MaskedActions, units: Units) -> Arc<Task> {
    Arc::new(Task::drive(config(), seat, masked, units).expect("the default scenario can be built"))
}

fn fast() -> Arc<Task> {
    let config = Arc::new(KinematicConfig::default());
    Arc::new(Task::kinematic(config, MaskedActions::Replace).expect("the default traffic can be built"))
}

#[test]
fn the_actions_of_a_recorded_episode_give_its_bits() {
    let mut env = Env::new(&config(), 7).expect("the default scenario can be built");
    let trace = record(&Policy::Rule(Rule::Random), &mut env, 7).expect("a rule can drive");
    let mut gym =
        Gym::new(&drive(Seat::Decide, MaskedActions::Refuse, Units::Normalized), 7).expect("the same scenario");
    for tick in &trace.ticks {
        let command = gym.command(Actions::Discrete(&[tick.action as i64])).expect("it was allowed");
        gym.step(&command).expect("it was allowed");
        let frame = tick.frames.last().expect("a tick has frames");
        assert_eq!(format!("{:016x}", gym.digest()), frame.digest);
    }
    assert!(gym.is_over());
}

struct Buffers {
    observations: Vec<f32>,
    rewards: Vec<f64>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    masks: Vec<bool>,
    metrics: Vec<f64>,
    final_observations: Vec<f32>,
    final_metrics: Vec<f64>,
}

impl Buffers {
    fn new(task: &Task, environments: usize) -> Self {
        let (size, metrics) = (task.observations().size(), task.metrics().len());
        Self {
            observations: vec![0.0; environments * size],
            rewards: vec![0.0; environments],
            terminated: vec![false; environments],
            truncated: vec![false; environments],
            masks: vec![false; environments * task.mask_width()],
            metrics: vec![0.0; environments * metrics],
            final_observations: vec![0.0; environments * size],
            final_metrics: vec![0.0; environments * metrics],
        }
    }

    fn outputs(&mut self) -> Outputs<'_> {
        Outputs {
            observations: &mut self.observations,
            rewards: &mut self.rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            masks: &mut self.masks,
            metrics: &mut self.metrics,
            final_observations: &mut self.final_observations,
            final_metrics: &mut self.final_metrics,
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    for (task, autoreset) in
        [(drive(Seat::Decide, MaskedActions::Replace, Units::Si), Autoreset::SameStep), (fast(), Autoreset::NextStep)]
    {
        let run = |threads| {
            let mut gym = VectorGym::new(&task, &[1, 2, 3, 4, 5], autoreset, threads).expect("all can be built");
            let mut buffers = Buffers::new(&task, 5);
            for step in 0..40_i64 {
                let actions = [0, 1, 2, 3, 4].map(|lane| (step + lane) % task.mask_width() as i64);
                gym.step(Actions::Discrete(&actions), buffers.outputs()).expect("any action is taken");
            }
            let bits: Vec<u32> = buffers.observations.iter().map(|value| value.to_bits()).collect();
            (gym.gyms().map(Gym::digest).collect::<Vec<_>>(), bits)
        };
        let alone = run(1);
        assert!(run(2) == alone && run(8) == alone);
    }
}

#[test]
fn what_cannot_be_done_moves_nothing() {
    let task = drive(Seat::Control, MaskedActions::Replace, Units::Normalized);
    let mut gym = VectorGym::new(&task, &[1, 2], Autoreset::Disabled, 1).expect("both can be built");
    let mut buffers = Buffers::new(&task, 2);
    let digests = |gym: &VectorGym| gym.gyms().map(Gym::digest).collect::<Vec<_>>();
    let before = digests(&gym);
    for bad in [f64::NAN, f64::INFINITY, 1.01, -1.01] {
        let refusal = gym.step(Actions::Continuous(&[0.0, 0.0, 0.0, bad]), buffers.outputs());
        let Err(GymError::At { index: 1, source }) = refusal else { panic!("{refusal:?}") };
        assert!(matches!(*source, GymError::OutOfBounds { index: 1, .. }));
    }
    for actions in [Actions::Continuous(&[0.0; 3]), Actions::Discrete(&[0, 0])] {
        assert!(matches!(gym.step(actions, buffers.outputs()), Err(GymError::WrongShape { .. })));
    }
    assert_eq!(digests(&gym), before);
}

#[test]
fn the_ends_of_normalized_numbers_are_the_bounds() {
    let (si, normalized) =
        [Units::Si, Units::Normalized].map(|units| drive(Seat::Plan, MaskedActions::Replace, units)).into();
    let lanecraft_lab::gym::ActionSpace::Continuous(ranges) = si.actions() else { panic!("a path has numbers") };
    for (share, pick) in [(-1.0, 0), (0.0, 1), (1.0, 2)] {
        let path: Vec<f64> = ranges.iter().map(|range| [range.low, range.middle, range.high][pick]).collect();
        let (mut one, mut other) =
            (Gym::new(&si, 3).expect("it can be built"), Gym::new(&normalized, 3).expect("it can be built"));
        let command = one.command(Actions::Continuous(&path)).expect("it is within");
        assert_eq!(other.command(Actions::Continuous(&[share; 3])).expect("it is within"), command);
        one.step(&command).expect("it can be driven");
        other.step(&command).expect("it can be driven");
        assert_eq!(one.digest(), other.digest());
    }
}
