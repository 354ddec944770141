//! Evaluation: policies of Rust on all threads, those of Python called back for each decision.

use lanecraft_drive::env::Env;
use lanecraft_lab::config::{RunConfig, SeedRole};
use lanecraft_lab::evaluate::{EvaluateError, PolicyEpisodes, compare, evaluate as drive};
use lanecraft_lab::gym::{MaskedActions, legal_action};
use lanecraft_lab::pairing::{Entrant, environments};
use lanecraft_lab::policy::{DecideError, OwnError, OwnPolicy, Policy};
use lanecraft_lab::progress::Progress;
use lanecraft_lab::stats::StatsError;
use lanecraft_lab::text_table::text_table;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::ThreadPoolBuilder;

use crate::env::whole;
use crate::errors::{self, ActionError, ConfigError};
use crate::policy::PolicyCore;
use crate::task;

/// The first policy against another: names, lead with the ends of its interval, and in words.
type Comparison = (String, String, (f64, f64, f64), String);

/// The episodes of an evaluation; the engine of `lanecraft.Results`.
#[pyclass(frozen, module = "lanecraft._lanecraft")]
pub(crate) struct ResultsCore {
    policies: Vec<PolicyEpisodes>,
}

#[pymethods]
impl ResultsCore {
    /// The figures of each policy, as the lines of JSON that the command line prints.
    fn rows(&self) -> PyResult<Vec<String>> {
        self.policies.iter().map(|of| Ok(json(&of.result().map_err(stats)?))).collect()
    }

    /// The episodes of all policies, as JSON.
    fn episodes(&self) -> Vec<String> {
        self.policies.iter().flat_map(|of| &of.episodes).map(json).collect()
    }

    /// The first policy against each of the others.
    fn comparisons(&self) -> PyResult<Vec<Comparison>> {
        let all = compare(&self.policies).map_err(stats)?;
        let parts = all.into_iter().map(|one| {
            let (lead, words) = (one.lead, one.to_string());
            (one.policy, one.other, (lead.mean, lead.low, lead.high), words)
        });
        Ok(parts.collect())
    }

    /// The table that the command line prints.
    fn table(&self) -> PyResult<String> {
        let results: Result<Vec<_>, _> = self.policies.iter().map(PolicyEpisodes::result).collect();
        Ok(text_table(&results.map_err(stats)?))
    }
}

fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).expect("plain numbers and names serialize")
}

fn stats(error: StatsError) -> PyErr {
    ConfigError::new_err(errors::message(&error))
}

/// Drives each policy, a `PolicyCore` or anything callable with a name, through the same scenarios; `environment`: preset, configuration
/// and scenario.
#[pyfunction]
pub(crate) fn evaluate(
    py: Python<'_>,
    policies: Vec<(String, Bound<'_, PyAny>)>,
    environment: (String, Bound<'_, PyDict>, Option<String>),
    masked_actions: &str,
    threads: usize,
) -> PyResult<ResultsCore> {
    let (preset, config, scenario) = environment;
    let masked = task::named("value of masked_actions", masked_actions, &MaskedActions::NAMES)?;
    let run = task::resolved(&preset, &config, scenario.as_deref())?;
    let values = task::values(&config, scenario.as_deref())?;
    let entrants: Vec<Entrant> = policies.into_iter().map(|(name, policy)| entrant(name, policy, masked)).collect();
    let environments = environments(&entrants, &run.environment, |path| RunConfig::resolve_table_over(path, &values));
    let environments = environments.map_err(|error| errors::config(&error))?;
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| PyRuntimeError::new_err(errors::message(&error)))?;
    let mut all = Vec::new();
    for (Entrant { policy, .. }, environment) in entrants.iter().zip(&environments) {
        let drive = || drive(policy, environment, &run.evaluation, SeedRole::Test, &Progress::silent());
        let episodes = py.detach(|| match policy {
            // Python is called back on the thread that called.
            Policy::Own(_) => drive(),
            _ => pool.install(drive),
        });
        all.push(episodes.map_err(raised)?);
    }
    Ok(ResultsCore { policies: all })
}

fn entrant(name: String, policy: Bound<'_, PyAny>, masked: MaskedActions) -> Entrant {
    if let Ok(policy) = policy.cast::<PolicyCore>() {
        return policy.get().entrant.clone();
    }
    let callable = policy.unbind();
    let decide = move |env: &Env| Python::attach(|py| decide(callable.bind(py), env, masked)).map_err(OwnError::from);
    Policy::Own(OwnPolicy::new(name, decide)).into()
}

/// The action that `callable` returns for an observation and its info.
fn decide(callable: &Bound<'_, PyAny>, env: &Env, masked: MaskedActions) -> PyResult<usize> {
    let py = callable.py();
    let config = &env.config().observation;
    let mut observation = vec![0.0_f32; config.size()];
    env.observe(&mut observation);
    let observation = PyArray1::from_vec(py, observation).reshape(&config.shape()[..])?;
    let action = callable.call1((observation, info(py, env)?))?;
    legal_action(env, masked, whole(&action)?).map_err(|error| errors::gym(&error))
}

/// What else a policy is told.
fn info<'py>(py: Python<'py>, env: &Env) -> PyResult<Bound<'py, PyDict>> {
    let info = PyDict::new(py);
    let (mask, ego, episode) = (env.mask(), env.ego(), env.episode());
    let allowed = (0..env.actions().len() + 2).map(|action| i8::from(mask.allows(action)));
    info.set_item(intern!(py, "action_mask"), PyArray1::from_vec(py, allowed.collect()))?;
    info.set_item(intern!(py, "scenario_seed"), env.world().seed())?;
    info.set_item(intern!(py, "tick"), episode.ticks)?;
    info.set_item(intern!(py, "time_s"), f64::from(episode.ticks) * env.config().env.decision_period_s)?;
    info.set_item(intern!(py, "speed_mps"), ego.speed_mps)?;
    info.set_item(intern!(py, "d_m"), ego.d_m)?;
    info.set_item(intern!(py, "lane"), env.scene().ego_lane.0)?;
    info.set_item(intern!(py, "driven_m"), env.driven_m())?;
    Ok(info)
}

/// What was raised in a policy of Python comes back as it is.
fn raised(error: EvaluateError) -> PyErr {
    let text = errors::message(&error);
    match error {
        EvaluateError::Act { source: DecideError::Own(own), .. } => match own.downcast::<PyErr>() {
            Ok(raised) => *raised,
            Err(_) => PyRuntimeError::new_err(text),
        },
        EvaluateError::Act { .. } | EvaluateError::Step { .. } => ActionError::new_err(text),
        _ => ConfigError::new_err(text),
    }
}
