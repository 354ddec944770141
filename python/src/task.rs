//! What is simulated: a preset with the user's own numbers laid over it, and the seat that is taken.

use std::sync::Arc;

use lanecraft_lab::config::{Preset, RunConfig, resolve_kinematic};
use lanecraft_lab::gym::{self, ActionSpace, MaskedActions, Range, Seat, Units};
use lanecraft_lab::scenarios::LoadedScenario;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use toml::{Table, Value};

use crate::errors::{self, ConfigError};

/// The presets of the whole loop, and the fast environment.
const PRESETS: [(&str, Option<Preset>); 3] =
    [("default", Some(Preset::Default)), ("paper", Some(Preset::Paper)), ("fast", None)];

/// An environment to be made again and again.
#[pyclass(frozen, module = "lanecraft._lanecraft")]
pub(crate) struct Task {
    pub(crate) inner: Arc<gym::Task>,
}

#[pymethods]
impl Task {
    #[new]
    fn new(
        preset: &str,
        config: &Bound<'_, PyDict>,
        scenario: Option<&str>,
        seat: &str,
        masked_actions: &str,
        units: &str,
    ) -> PyResult<Self> {
        let masked = named("value of masked_actions", masked_actions, &MaskedActions::NAMES)?;
        let units = named("value of units", units, &Units::NAMES)?;
        let seat = named("seat", seat, &Seat::NAMES)?;
        let inner = if named("preset", preset, &PRESETS)?.is_some() {
            let run = resolved(preset, config, scenario)?;
            gym::Task::drive(Arc::new(run.environment), seat, masked, units)
        } else {
            if scenario.is_some() || seat != Seat::Decide {
                let text = "the preset `fast` has its own traffic and the seat `decide` alone";
                return Err(ConfigError::new_err(text));
            }
            let config = resolve_kinematic(&values(config, None)?).map_err(|error| errors::config(&error))?;
            gym::Task::kinematic(Arc::new(config), masked)
        };
        Ok(Self { inner: Arc::new(inner.map_err(|error| errors::config(&error))?) })
    }

    /// Number of discrete actions, or `None`.
    #[getter]
    fn actions(&self) -> Option<usize> {
        match self.inner.actions() {
            ActionSpace::Discrete(count) => Some(*count),
            ActionSpace::Continuous(_) => None,
        }
    }

    /// The smallest action, the one in the middle and the largest, in SI units, if actions are continuous.
    #[getter]
    fn action_bounds(&self) -> Option<(Vec<f64>, Vec<f64>, Vec<f64>)> {
        let ActionSpace::Continuous(ranges) = self.inner.actions() else { return None };
        let each = |number: fn(&Range) -> f64| ranges.iter().map(number).collect();
        Some((each(|range| range.low), each(|range| range.middle), each(|range| range.high)))
    }

    /// Shape of an observation.
    #[getter]
    fn observation_shape(&self) -> Vec<usize> {
        self.inner.observations().shape.clone()
    }

    /// The smallest and the largest observation, flat.
    #[getter]
    fn observation_bounds(&self) -> (Vec<f32>, Vec<f32>) {
        let space = self.inner.observations();
        (space.low.clone(), space.high.clone())
    }

    /// The complete configuration as TOML.
    #[getter]
    fn config_toml(&self) -> String {
        self.inner.config_toml()
    }

    /// Simulated time from one step to the next, s.
    #[getter]
    fn step_s(&self) -> f64 {
        self.inner.step_s()
    }

    /// What each action does, in words; empty if actions are continuous.
    #[getter]
    fn action_names(&self) -> Vec<String> {
        self.inner.action_names().to_vec()
    }
}

/// Names of the scenarios that come with the package.
#[pyfunction]
pub(crate) fn scenarios() -> Vec<String> {
    lanecraft_lab::scenarios::names()
}

/// The whole configuration: the preset, with the user's own numbers and scenario laid over it.
pub(crate) fn resolved(preset: &str, config: &Bound<'_, PyDict>, scenario: Option<&str>) -> PyResult<RunConfig> {
    let Some(preset) = named("preset", preset, &PRESETS)? else {
        return Err(ConfigError::new_err("the preset `fast` is for environments alone; take `default` or `paper`"));
    };
    RunConfig::resolve_table(preset, &values(config, scenario)?).map_err(|error| errors::config(&error))
}

/// The user's own numbers and scenario as keys and values.
pub(crate) fn values(config: &Bound<'_, PyDict>, scenario: Option<&str>) -> PyResult<Table> {
    let mut values = table(config, 0)?;
    if let Some(scenario) = scenario {
        let text = lanecraft_lab::scenarios::named(scenario).and_then(LoadedScenario::into_value);
        values.insert("env.scenario".to_owned(), Value::String(text.map_err(|error| errors::config(&error))?));
    }
    Ok(values)
}

/// The value of this name, or an exception with all names.
pub(crate) fn named<T: Copy>(what: &str, name: &str, names: &[(&str, T)]) -> PyResult<T> {
    names.iter().find(|(known, _)| *known == name).map(|(_, value)| *value).ok_or_else(|| {
        let known: Vec<_> = names.iter().map(|(name, _)| *name).collect();
        ConfigError::new_err(lanecraft_lab::config::unknown_name(what, name, &known))
    })
}

/// Deeper than this no configuration is, but one that holds itself.
const DEEPEST: usize = 16;

/// A dictionary as a table; keys may be dotted or nested.
pub(crate) fn table(dict: &Bound<'_, PyDict>, depth: usize) -> PyResult<Table> {
    dict.iter().map(|(key, value)| Ok((key.extract::<String>()?, to_toml(&value, depth + 1)?))).collect()
}

/// Plain values, lists and dictionaries; numbers of NumPy, too.
fn to_toml(value: &Bound<'_, PyAny>, depth: usize) -> PyResult<Value> {
    if depth > DEEPEST {
        Err(ConfigError::new_err("the configuration is nested too deeply"))
    } else if value.is_instance_of::<PyBool>() {
        Ok(Value::Boolean(value.extract()?))
    } else if value.is_instance_of::<PyInt>() {
        let whole = value.extract().map_err(|_| ConfigError::new_err(format!("{value} does not fit 64 bits")))?;
        Ok(Value::Integer(whole))
    } else if value.is_instance_of::<PyFloat>() {
        Ok(Value::Float(value.extract()?))
    } else if let Ok(text) = value.cast::<PyString>() {
        Ok(Value::String(text.to_str()?.to_owned()))
    } else if let Ok(dict) = value.cast::<PyDict>() {
        Ok(Value::Table(table(dict, depth)?))
    } else if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        Ok(Value::Array(value.try_iter()?.map(|item| to_toml(&item?, depth + 1)).collect::<PyResult<_>>()?))
    } else if value.hasattr("tolist")? {
        to_toml(&value.call_method0("tolist")?, depth + 1)
    } else {
        let kind = value.get_type().name()?;
        Err(PyTypeError::new_err(format!("a configuration holds numbers, strings, lists and dictionaries, not {kind}")))
    }
}
