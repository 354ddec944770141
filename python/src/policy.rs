//! Policies that need no Python: rules, and networks that were trained.

use std::path::Path;

use lanecraft_drive::decide::ActionMask;
use lanecraft_lab::baselines::{Rule, UnknownRule};
use lanecraft_lab::pairing::Entrant;
use lanecraft_lab::policy::{Pilot, Policy, vote};
use lanecraft_lab::runs::read_config;
use lanecraft_learn::Actor;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::env::EnvCore;
use crate::errors::{self, ActionError};

/// A policy; the base of `lanecraft.policies.Policy`.
#[pyclass(frozen, subclass, module = "lanecraft._lanecraft")]
pub(crate) struct PolicyCore {
    pub(crate) entrant: Entrant,
    shape: Option<Vec<usize>>,
}

#[pymethods]
impl PolicyCore {
    #[new]
    fn new(name: &str) -> PyResult<Self> {
        if let Some(rule) = name.strip_prefix("rule:") {
            let rule: Rule = rule.parse().map_err(|error: UnknownRule| errors::config(&error))?;
            return Ok(Self { entrant: Policy::Rule(rule).into(), shape: None });
        }
        let entrant = Entrant::of_run(Path::new(name)).map_err(|error| errors::config(&error))?;
        let config = read_config(Path::new(name)).map_err(|error| errors::config(&error))?;
        Ok(Self { entrant, shape: Some(config.environment.observation.shape()) })
    }

    #[getter]
    fn name(&self) -> String {
        self.entrant.policy.name()
    }

    #[getter]
    fn observation_shape(&self) -> Option<Vec<usize>> {
        self.shape.clone()
    }

    #[getter]
    fn actions(&self) -> Option<usize> {
        self.network().map(lanecraft_learn::Policy::actions).ok()
    }

    /// The action in the present tick of an environment.
    fn _act(&self, env: &EnvCore) -> PyResult<usize> {
        let Some(env) = env.gym()?.drive_env() else {
            return Err(PyTypeError::new_err("policies drive in the whole loop, not in the preset `fast`"));
        };
        let action = Pilot::new(&self.entrant.policy).act(env, env.world().seed());
        action.map_err(|error| ActionError::new_err(errors::message(&error)))
    }

    /// The actions for these observations, one a row, with what is allowed.
    fn _predict<'py>(
        &self,
        py: Python<'py>,
        observations: &Bound<'py, PyArray2<f32>>,
        masks: &Bound<'py, PyArray2<bool>>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let mut actor = Actor::new(self.network()?.clone());
        let (rows, masks) = (observations.try_readonly()?, masks.try_readonly()?);
        let (rows, masks) = (rows.as_array(), masks.as_array());
        let act = |(row, allowed): (numpy::ndarray::ArrayView1<'_, f32>, numpy::ndarray::ArrayView1<'_, bool>)| {
            let set = allowed.iter().enumerate().filter(|(_, allowed)| **allowed);
            let mask = set.fold(ActionMask::default(), |mask, (action, _)| mask.with(action));
            vote(&mut actor, &row.to_vec(), mask).map(|action| action as i64)
        };
        let actions: Result<Vec<_>, _> = rows.rows().into_iter().zip(masks.rows()).map(act).collect();
        let actions = actions.map_err(|error| ActionError::new_err(errors::message(&error)))?;
        Ok(PyArray1::from_vec(py, actions))
    }

    /// Q of every head for these observations, one a row: observations × heads × actions.
    fn _q_heads<'py>(
        &self,
        py: Python<'py>,
        observations: &Bound<'py, PyArray2<f32>>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let network = self.network()?;
        let mut actor = Actor::new(network.clone());
        let rows = observations.try_readonly()?;
        let rows = rows.as_array();
        let mut q = Vec::with_capacity(rows.nrows() * network.heads() * network.actions());
        for row in rows.rows() {
            let of_row = actor.q_heads(&row.to_vec());
            q.extend_from_slice(of_row.map_err(|error| ActionError::new_err(errors::message(&error)))?);
        }
        PyArray1::from_vec(py, q).reshape([rows.nrows(), network.heads(), network.actions()])
    }

    /// The network as the bytes of an ONNX model.
    fn to_onnx<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.network()?.to_onnx()))
    }
}

impl PolicyCore {
    fn network(&self) -> PyResult<&lanecraft_learn::Policy> {
        match &self.entrant.policy {
            Policy::Learned { network, .. } => Ok(network),
            _ => Err(PyTypeError::new_err("a rule needs the environment: use `act`")),
        }
    }
}
