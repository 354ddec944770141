//! A caller's own policy in the seat that decides.

use std::sync::{Arc, Mutex};

use lanecraft_drive::env::Env;
use lanecraft_lab::baselines::Rule;
use lanecraft_lab::config::{EnvironmentConfig, EvaluationConfig, SeedRole};
use lanecraft_lab::evaluate::{EvaluateError, PolicyEpisodes, evaluate};
use lanecraft_lab::policy::{DecideError, OwnPolicy, Policy};
use lanecraft_lab::progress::Progress;

const EVALUATION: EvaluationConfig = EvaluationConfig { episodes: 4, episode_s: 15.0, seed: 3 };

fn drive(policy: &Policy) -> Result<PolicyEpisodes, EvaluateError> {
    evaluate(policy, &EnvironmentConfig::default(), &EVALUATION, SeedRole::Test, &Progress::silent())
}

#[test]
fn a_policy_that_does_as_a_rule_does_gets_its_figures_to_the_bit() {
    let rule = Rule::BestLane(lanecraft_lab::baselines::BestLane::default());
    let mimic = OwnPolicy::new("rule:best-lane", move |env: &Env| Ok(rule.act(env, env.world().seed())));
    let (own, expected) = (drive(&Policy::Own(mimic)).unwrap(), drive(&Policy::Rule(rule)).unwrap());
    assert!(expected.episodes.iter().any(|episode| episode.lane_changes > 0), "nothing to continue");
    assert_eq!(own, expected);
}

#[test]
fn it_is_asked_only_where_a_decision_is_due_and_episode_by_episode() {
    let seen = Arc::new(Mutex::new(Vec::new()));
    let notes = Arc::clone(&seen);
    let policy = OwnPolicy::new("own", move |env: &Env| {
        assert!(env.decision_due());
        notes.lock().unwrap().push((env.world().seed(), env.episode().ticks));
        Ok(Rule::IdmMobil.act(env, 0))
    });
    drive(&Policy::Own(policy)).unwrap();
    let seen = seen.lock().unwrap();
    let seeds: Vec<u64> = (0..4).map(|index| SeedRole::Test.scenario_seed(EVALUATION.seed, index)).collect();
    let mut begun: Vec<u64> = seen.iter().map(|(seed, _)| *seed).collect();
    begun.dedup();
    assert_eq!(begun, seeds);
    assert!(seen.is_sorted());
}

#[test]
fn its_errors_come_back_as_they_are() {
    let policy = OwnPolicy::new("own", |_: &Env| Err("lost".into()));
    let error = drive(&Policy::Own(policy)).unwrap_err();
    assert_eq!(error.to_string(), "policy `own`: lost");
    assert!(matches!(error, EvaluateError::Act { source: DecideError::Own(_), .. }));
}

#[test]
fn an_action_that_is_not_allowed_is_refused() {
    let policy = OwnPolicy::new("own", |_: &Env| Ok(99));
    assert!(matches!(drive(&Policy::Own(policy)), Err(EvaluateError::Step { .. })));
}
