//! Many environments at once.

use std::sync::Arc;

use lanecraft_lab::gym::{self, ActionSpace, Actions, Autoreset, MetricKind, Outputs, VectorGym};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::env::reals;
use crate::errors::{self, ActionError, ClosedEnvironmentError, ResetNeeded};
use crate::task::{Task, named};

const AUTORESETS: [(&str, Autoreset); 3] =
    [("NextStep", Autoreset::NextStep), ("SameStep", Autoreset::SameStep), ("Disabled", Autoreset::Disabled)];

/// The engine of `lanecraft.VectorEnv`. All arrays are its own and are written anew by every step.
#[pyclass(module = "lanecraft._lanecraft")]
pub(crate) struct VectorCore {
    task: Arc<gym::Task>,
    num_envs: usize,
    autoreset: Autoreset,
    threads: usize,
    closed: bool,
    gym: Option<VectorGym>,
    arrays: Arrays,
}

/// What every step writes.
struct Arrays {
    observations: Py<PyArray2<f32>>,
    rewards: Py<PyArray1<f64>>,
    terminated: Py<PyArray1<bool>>,
    truncated: Py<PyArray1<bool>>,
    masks: Py<PyArray2<bool>>,
    metrics: Py<PyArray2<f64>>,
    final_observations: Py<PyArray2<f32>>,
    final_metrics: Py<PyArray2<f64>>,
}

#[pymethods]
impl VectorCore {
    #[new]
    fn new(py: Python<'_>, task: &Task, num_envs: usize, autoreset: &str, threads: usize) -> PyResult<Self> {
        let task = Arc::clone(&task.inner);
        let (size, metrics) = (task.observations().size(), task.metrics().len());
        let autoreset = named("autoreset_mode", autoreset, &AUTORESETS)?;
        let last = if autoreset == Autoreset::SameStep { num_envs } else { 0 };
        let arrays = Arrays {
            observations: PyArray2::zeros(py, [num_envs, size], false).unbind(),
            rewards: PyArray1::zeros(py, [num_envs], false).unbind(),
            terminated: PyArray1::zeros(py, [num_envs], false).unbind(),
            truncated: PyArray1::zeros(py, [num_envs], false).unbind(),
            masks: PyArray2::zeros(py, [num_envs, task.mask_width()], false).unbind(),
            metrics: PyArray2::zeros(py, [num_envs, metrics], false).unbind(),
            final_observations: PyArray2::zeros(py, [last, size], false).unbind(),
            final_metrics: PyArray2::zeros(py, [last, metrics], false).unbind(),
        };
        Ok(Self { task, num_envs, autoreset, threads, closed: false, gym: None, arrays })
    }

    /// Names and kinds (`float`, `int`, `bool`) of the columns of `metrics`.
    #[getter]
    fn metric_columns(&self) -> Vec<(&'static str, &'static str)> {
        let kind = |kind| match kind {
            MetricKind::Float => "float",
            MetricKind::Count => "int",
            MetricKind::Flag => "bool",
        };
        self.task.metrics().iter().map(|metric| (metric.name, kind(metric.kind))).collect()
    }

    #[getter]
    fn observations(&self, py: Python<'_>) -> Py<PyArray2<f32>> {
        self.arrays.observations.clone_ref(py)
    }

    #[getter]
    fn rewards(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        self.arrays.rewards.clone_ref(py)
    }

    #[getter]
    fn terminated(&self, py: Python<'_>) -> Py<PyArray1<bool>> {
        self.arrays.terminated.clone_ref(py)
    }

    #[getter]
    fn truncated(&self, py: Python<'_>) -> Py<PyArray1<bool>> {
        self.arrays.truncated.clone_ref(py)
    }

    #[getter]
    fn masks(&self, py: Python<'_>) -> Py<PyArray2<bool>> {
        self.arrays.masks.clone_ref(py)
    }

    #[getter]
    fn metrics(&self, py: Python<'_>) -> Py<PyArray2<f64>> {
        self.arrays.metrics.clone_ref(py)
    }

    #[getter]
    fn final_observations(&self, py: Python<'_>) -> Py<PyArray2<f32>> {
        self.arrays.final_observations.clone_ref(py)
    }

    #[getter]
    fn final_metrics(&self, py: Python<'_>) -> Py<PyArray2<f64>> {
        self.arrays.final_metrics.clone_ref(py)
    }

    /// Begins the episodes of these seeds, or of the next ones where `chosen`.
    #[pyo3(signature = (seeds, chosen))]
    fn reset(&mut self, py: Python<'_>, seeds: Option<Vec<u64>>, chosen: Option<Vec<bool>>) -> PyResult<()> {
        self.check_open()?;
        let lengths = [seeds.as_ref().map(Vec::len), chosen.as_ref().map(Vec::len)];
        if let Some(length) = lengths.into_iter().flatten().find(|length| *length != self.num_envs) {
            return Err(ActionError::new_err(format!("got {length} entries for {} environments", self.num_envs)));
        }
        if let (None, Some(seeds)) = (&self.gym, &seeds) {
            let made = py.detach(|| VectorGym::new(&self.task, seeds, self.autoreset, self.threads));
            self.gym = Some(made.map_err(|error| errors::gym(&error))?);
        }
        let (Some(gym), arrays) = (&mut self.gym, &self.arrays) else { return Err(reset_needed()) };
        arrays.write(py, |outputs| py.detach(|| gym.reset(seeds.as_deref(), chosen.as_deref(), outputs)))
    }

    /// One step of every environment.
    fn step(&mut self, py: Python<'_>, actions: &Bound<'_, PyAny>) -> PyResult<()> {
        self.check_open()?;
        let (Some(gym), arrays) = (&mut self.gym, &self.arrays) else { return Err(reset_needed()) };
        match self.task.actions() {
            ActionSpace::Discrete(_) => {
                let actions = wholes(actions, self.num_envs)?;
                arrays.write(py, |outputs| py.detach(|| gym.step(Actions::Discrete(&actions), outputs)))
            }
            ActionSpace::Continuous(ranges) => {
                let actions = reals(actions, &[self.num_envs, ranges.len()])?;
                arrays.write(py, |outputs| py.detach(|| gym.step(Actions::Continuous(&actions), outputs)))
            }
        }
    }

    /// A digest of the state of every environment.
    fn digests(&self) -> PyResult<Vec<u64>> {
        self.check_open()?;
        Ok(self.gym.as_ref().ok_or_else(reset_needed)?.gyms().map(gym::Gym::digest).collect())
    }

    /// Lets go of all episodes.
    fn close(&mut self) {
        (self.gym, self.closed) = (None, true);
    }
}

impl VectorCore {
    fn check_open(&self) -> PyResult<()> {
        if self.closed { Err(ClosedEnvironmentError::new_err("the environments are closed")) } else { Ok(()) }
    }
}

impl Arrays {
    /// Lets `job` write all arrays.
    fn write(&self, py: Python<'_>, job: impl FnOnce(Outputs) -> Result<(), gym::GymError>) -> PyResult<()> {
        let mut observations = self.observations.bind(py).try_readwrite()?;
        let mut rewards = self.rewards.bind(py).try_readwrite()?;
        let mut terminated = self.terminated.bind(py).try_readwrite()?;
        let mut truncated = self.truncated.bind(py).try_readwrite()?;
        let mut masks = self.masks.bind(py).try_readwrite()?;
        let mut metrics = self.metrics.bind(py).try_readwrite()?;
        let mut final_observations = self.final_observations.bind(py).try_readwrite()?;
        let mut final_metrics = self.final_metrics.bind(py).try_readwrite()?;
        let outputs = Outputs {
            observations: observations.as_slice_mut()?,
            rewards: rewards.as_slice_mut()?,
            terminated: terminated.as_slice_mut()?,
            truncated: truncated.as_slice_mut()?,
            masks: masks.as_slice_mut()?,
            metrics: metrics.as_slice_mut()?,
            final_observations: final_observations.as_slice_mut()?,
            final_metrics: final_metrics.as_slice_mut()?,
        };
        job(outputs).map_err(|error| errors::gym(&error))
    }
}

fn reset_needed() -> PyErr {
    ResetNeeded::new_err("the first episodes have not begun; call reset()")
}

/// Whole numbers, one for each environment, from an array or anything that NumPy makes one of.
fn wholes(values: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<i64>> {
    let array = values.py().import("numpy")?.call_method1("asarray", (values,))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if !["i", "u", "b"].contains(&kind.as_str()) {
        return Err(PyTypeError::new_err(format!("actions are whole numbers here, not {}", array.getattr("dtype")?)));
    }
    let array: PyReadonlyArrayDyn<'_, i64> = array.call_method1("astype", ("int64",))?.extract()?;
    let array = array.as_array();
    if array.shape() != [count] {
        return Err(ActionError::new_err(format!("actions have shape {:?}, but must have [{count}]", array.shape())));
    }
    Ok(array.iter().copied().collect())
}
