//! Runs that differ in nothing but their training seed, pooled as one method.

use std::collections::BTreeMap;

use toml::{Table, Value};

use super::load::JudgedRun;
use crate::config::RunConfig;
use crate::evaluate::{EpisodeResult, PolicyEpisodes};
use crate::metrics::Interval;
use crate::report::{Difference, MethodResult};
use crate::stats::{Pairing, SeedScores, StatsError, exact_rate_interval, rate_difference, rate_per_1000_km};

/// Number of thresholds of a performance profile.
const THRESHOLDS: u32 = 60;
/// As many keys tell methods apart in their names; their configurations on the page have all.
const NAMED_KEYS: usize = 3;
/// Characters of a value in a name.
const VALUE_LENGTH: usize = 24;

/// The trainings of one configuration.
pub(super) struct Method<'a> {
    name: String,
    /// One run for each seed.
    runs: Vec<&'a JudgedRun>,
}

/// What pooling found.
pub(super) struct Pooled<'a> {
    /// The configurations with two seeds or more.
    pub(super) methods: Vec<Method<'a>>,
    /// What must be said of it.
    pub(super) statements: Vec<String>,
}

/// Pools the runs of a set of scenarios by their configuration without the seed.
pub(super) fn pool<'a>(runs: &[&'a JudgedRun]) -> Pooled<'a> {
    let mut groups: Vec<(RunConfig, Vec<&JudgedRun>)> = Vec::new();
    let mut statements = Vec::new();
    for run in runs {
        let mut config = run.config.clone();
        config.training.seed = 0;
        let Some((_, group)) = groups.iter_mut().find(|(other, _)| *other == config) else {
            groups.push((config, vec![*run]));
            continue;
        };
        match group.iter().find(|known| known.config.training.seed == run.config.training.seed) {
            Some(known) => statements.push(format!(
                "{} and {} have the same configuration and seed, so they count as one training.",
                known.name, run.name
            )),
            None => group.push(*run),
        }
    }
    let names = names(&groups.iter().map(|(config, _)| config).collect::<Vec<_>>());
    let methods = groups.into_iter().zip(names).filter(|((_, runs), _)| runs.len() > 1);
    Pooled { methods: methods.map(|((_, runs), name)| Method { name, runs }).collect(), statements }
}

impl Method<'_> {
    pub(super) fn runs(&self) -> &[&JudgedRun] {
        &self.runs
    }

    /// A score of each episode, a row for each seed.
    fn scores(&self, of: fn(&EpisodeResult) -> f64) -> Result<SeedScores, StatsError> {
        let row = |run: &&JudgedRun| (run.config.training.seed, run.own().iter().map(of).collect());
        SeedScores::new(&self.name, self.runs.iter().map(row).collect())
    }

    /// Those of all seeds.
    fn episodes(&self) -> impl Iterator<Item = &EpisodeResult> {
        self.runs.iter().flat_map(|run| run.own())
    }

    fn reward(&self) -> Result<SeedScores, StatsError> {
        self.scores(|episode| episode.reward_per_tick)
    }

    /// The figures of the page; `thresholds` are those of the profile.
    fn result(&self, thresholds: &[f64]) -> Result<MethodResult, StatsError> {
        let all = self.episodes().filter(|e| collided(e)).count();
        let at_fault = self.episodes().filter(|e| e.at_fault).count();
        let distance_m = self.episodes().map(|e| e.speed_mps * e.duration_s).sum();
        let count = self.episodes().count();
        let reward = self.reward()?;
        let profile = reward.profile(thresholds)?;
        Ok(MethodResult {
            name: self.name.clone(),
            runs: self.runs.iter().map(|run| run.name.clone()).collect(),
            episodes: count,
            speed_mps: self.scores(|e| e.speed_mps)?.mean()?,
            reward_per_tick: reward.mean()?,
            reward_interquartile_mean: reward.interquartile_mean()?,
            collisions_per_episode: exact_rate_interval(all, count)?,
            at_fault_collisions_per_episode: exact_rate_interval(at_fault, count)?,
            collisions_per_1000_km: rate_per_1000_km(all, distance_m)?,
            at_fault_collisions_per_1000_km: rate_per_1000_km(at_fault, distance_m)?,
            collisions_by_seed: self.scores(|e| f64::from(u8::from(collided(e))))?.seed_means(),
            profile: thresholds.iter().copied().zip(profile).collect(),
        })
    }
}

fn collided(episode: &EpisodeResult) -> bool {
    !episode.collision.is_empty()
}

/// The figures of all methods.
pub(super) fn results(methods: &[Method]) -> Result<Vec<MethodResult>, StatsError> {
    let rewards = || methods.iter().flat_map(Method::episodes).map(|e| e.reward_per_tick);
    let (low, high) = rewards().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    let at = |i: u32| low + (high - low) * f64::from(i) / f64::from(THRESHOLDS - 1);
    let thresholds: Vec<f64> = (0..THRESHOLDS).map(at).collect();
    methods.iter().map(|method| method.result(&thresholds)).collect()
}

/// Each method minus every one after it, and minus every rule.
pub(super) fn differences(methods: &[Method], rules: &[&PolicyEpisodes]) -> Result<Vec<Difference>, StatsError> {
    let mut found = Vec::new();
    for (place, method) in methods.iter().enumerate() {
        for other in &methods[place + 1..] {
            found.push(difference(method, Opponent::Method(other))?);
        }
        for rule in rules {
            found.push(difference(method, Opponent::Rule(rule))?);
        }
    }
    Ok(found)
}

/// Whom a method is compared with.
#[derive(Clone, Copy)]
enum Opponent<'a> {
    Method(&'a Method<'a>),
    Rule(&'a PolicyEpisodes),
}

impl<'a> Opponent<'a> {
    fn name(self) -> &'a str {
        match self {
            Self::Method(method) => &method.name,
            Self::Rule(rule) => &rule.policy,
        }
    }

    fn episodes(self) -> Vec<&'a EpisodeResult> {
        match self {
            Self::Method(method) => method.episodes().collect(),
            Self::Rule(rule) => rule.episodes.iter().collect(),
        }
    }
}

fn difference(method: &Method, other: Opponent) -> Result<Difference, StatsError> {
    let over_seeds = |metric: fn(&EpisodeResult) -> f64| match other {
        Opponent::Method(other) => method.scores(metric)?.difference(&other.scores(metric)?),
        Opponent::Rule(rule) => {
            let scores: Vec<f64> = rule.episodes.iter().map(metric).collect();
            Ok((method.scores(metric)?.difference_from_fixed(&scores)?, Pairing::Independent))
        }
    };
    let (speed_mps, pairing) = over_seeds(|e| e.speed_mps)?;
    // Seeds without an event do not differ, and yet the next one may have some: what the episodes leave open counts as well.
    let share = |event: fn(&EpisodeResult) -> bool, score: fn(&EpisodeResult) -> f64| {
        let counts = |episodes: &[&EpisodeResult]| [episodes.iter().filter(|e| event(e)).count(), episodes.len()];
        let own: Vec<&EpisodeResult> = method.episodes().collect();
        Ok::<_, StatsError>(hull(over_seeds(score)?.0, rate_difference(counts(&own), counts(&other.episodes()))?))
    };
    Ok(Difference {
        method: method.name.clone(),
        other: other.name().to_owned(),
        unit: match (other, pairing) {
            (Opponent::Rule(_), _) => "a rule, not trained",
            (_, Pairing::BySeed) => "same seeds, paired",
            (_, Pairing::Independent) => "different seeds",
        }
        .to_owned(),
        speed_mps,
        collisions_per_episode: share(collided, |e| f64::from(u8::from(collided(e))))?,
        at_fault_collisions_per_episode: share(|e| e.at_fault, |e| f64::from(u8::from(e.at_fault)))?,
        reward_per_tick: over_seeds(|e| e.reward_per_tick)?.0,
    })
}

/// The smallest interval that holds both; their means are the same.
fn hull(a: Interval, b: Interval) -> Interval {
    Interval { mean: a.mean, low: a.low.min(b.low), high: a.high.max(b.high) }
}

/// The probability that a seed of the row's method earns more than one of the column's; the diagonal is a half of no meaning.
pub(super) fn improvement(methods: &[Method]) -> Result<Vec<Vec<Interval>>, StatsError> {
    let rewards = methods.iter().map(Method::reward).collect::<Result<Vec<_>, _>>()?;
    let row = |one: &SeedScores| rewards.iter().map(|other| one.probability_of_improvement(other)).collect();
    rewards.iter().map(row).collect()
}

/// Names that tell configurations apart: the learner, and where that is not enough what else differs.
fn names(configs: &[&RunConfig]) -> Vec<String> {
    let flat: Vec<BTreeMap<String, String>> = configs.iter().map(|config| flatten(config)).collect();
    let differs = |key: &String| flat.iter().any(|other| other.get(key) != flat[0].get(key));
    let learner = |of: &BTreeMap<String, String>| of.get(LEARNER).cloned().unwrap_or_default();
    let mut names: Vec<String> = Vec::new();
    for of in &flat {
        let mut name = learner(of);
        if flat.iter().filter(|other| learner(other) == name).count() > 1 {
            let keys = of.iter().filter(|(key, _)| *key != LEARNER && differs(key)).take(NAMED_KEYS);
            let values: Vec<String> = keys.map(|(key, value)| format!("{key}={value}")).collect();
            name = format!("{name} {}", values.join(" "));
        }
        let before = names.iter().filter(|known| known.starts_with(&name)).count();
        names.push(if before > 0 { format!("{name} ({})", before + 1) } else { name });
    }
    names
}

/// The key whose value names a method.
const LEARNER: &str = "learner.algorithm";

/// All keys with their values as short text.
fn flatten(config: &RunConfig) -> BTreeMap<String, String> {
    fn walk(prefix: &str, table: &Table, into: &mut BTreeMap<String, String>) {
        for (key, value) in table {
            let key = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
            match value {
                Value::Table(inner) => walk(&key, inner, into),
                Value::String(text) => drop(into.insert(key, text.chars().take(VALUE_LENGTH).collect())),
                other => drop(into.insert(key, other.to_string().chars().take(VALUE_LENGTH).collect())),
            }
        }
    }
    let mut flat = BTreeMap::new();
    walk("", &config.to_toml().parse().expect("what was written as TOML reads as TOML"), &mut flat);
    flat
}

#[cfg(test)]
mod tests {
    use super::names;
    use crate::config::{Preset, RunConfig};

    fn config(assignments: &[&str]) -> RunConfig {
        let assignments: Vec<String> = assignments.iter().map(ToString::to_string).collect();
        RunConfig::resolve(Preset::Default, None, &assignments).unwrap()
    }

    #[test]
    fn methods_are_named_by_what_differs() {
        let (dqn, other) = (config(&["learner.algorithm=dqn"]), config(&["learner.algorithm=double-dqn"]));
        assert_eq!(names(&[&dqn, &other]), ["dqn", "double-dqn"]);
        let patient = config(&["learner.algorithm=dqn", "learner.discount=0.5"]);
        let found = names(&[&dqn, &patient, &other]);
        assert_eq!(found[1..], ["dqn learner.discount=0.5", "double-dqn"]);
    }
}
