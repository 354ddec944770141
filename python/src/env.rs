//! One environment.

use std::sync::Arc;

use lanecraft_drive::snapshot::Snapshot;
use lanecraft_lab::gym::{self, ActionSpace, Actions, Gym, MetricKind};
use lanecraft_lab::render;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::exceptions::PyTypeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyString};

use crate::errors::{self, ActionError, ClosedEnvironmentError, ResetNeeded, SnapshotError};
use crate::task::Task;

/// What a step hands back: observation, reward, terminated, truncated, info.
type Step<'py> = (Bound<'py, PyArrayDyn<f32>>, f64, bool, bool, Bound<'py, PyDict>);

/// An environment; the base of `lanecraft.Env`.
#[pyclass(subclass, module = "lanecraft._lanecraft")]
pub(crate) struct EnvCore {
    state: State,
    /// Seed and number of the present episode.
    series: Option<(u64, u64)>,
    names: Vec<Py<PyString>>,
    observation: Vec<f32>,
    mask: Vec<bool>,
    metrics: Vec<f64>,
}

enum State {
    /// No task yet, or closed.
    Closed,
    /// Waits for its first episode.
    Ready(Arc<gym::Task>),
    /// In an episode.
    Running(Arc<gym::Task>, Box<Gym>),
}

#[pymethods]
impl EnvCore {
    #[new]
    #[pyo3(signature = (*_args, **_kwargs))]
    fn new(_args: &Bound<'_, PyAny>, _kwargs: Option<&Bound<'_, PyAny>>) -> Self {
        Self {
            state: State::Closed,
            series: None,
            names: Vec::new(),
            observation: Vec::new(),
            mask: Vec::new(),
            metrics: Vec::new(),
        }
    }

    /// Takes on a task; to be called once, by `__init__`.
    fn _open(&mut self, py: Python<'_>, task: &Task) {
        let inner = Arc::clone(&task.inner);
        self.names = inner.metrics().iter().map(|metric| PyString::intern(py, metric.name).unbind()).collect();
        self.observation = vec![0.0; inner.observations().size()];
        self.mask = vec![false; inner.mask_width()];
        self.metrics = vec![0.0; self.names.len()];
        self.state = State::Ready(inner);
    }

    /// Begins the episode of this seed, or the next one of the series that the last seed began.
    #[pyo3(signature = (seed))]
    fn _begin<'py>(
        &mut self,
        py: Python<'py>,
        seed: Option<u64>,
    ) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyDict>)> {
        let task = Arc::clone(self.task()?);
        let (seed, episode) = match (seed, self.series) {
            (Some(seed), _) => (seed, 0),
            (None, Some((seed, episode))) => (seed, episode + 1),
            (None, None) => return Err(ResetNeeded::new_err("the first reset needs a seed")),
        };
        let gym = py.detach(|| Gym::new(&task, gym::episode_seed(seed, episode)));
        let gym = gym.map_err(|error| errors::gym(&error))?;
        self.state = State::Running(task, Box::new(gym));
        self.series = Some((seed, episode));
        self.look(py)
    }

    /// One step.
    fn step<'py>(&mut self, py: Python<'py>, action: &Bound<'py, PyAny>) -> PyResult<Step<'py>> {
        let State::Running(task, gym) = &mut self.state else { return Err(self.not_running()) };
        let command = match task.actions() {
            ActionSpace::Discrete(_) => gym.command(Actions::Discrete(&[whole(action)?])),
            ActionSpace::Continuous(ranges) => gym.command(Actions::Continuous(&reals(action, &[ranges.len()])?)),
        };
        let command = command.map_err(|error| errors::gym(&error))?;
        let outcome = py.detach(|| gym.step(&command)).map_err(|error| errors::gym(&error))?;
        let (observation, info) = self.look(py)?;
        Ok((observation, outcome.0, outcome.1, outcome.2, info))
    }

    /// Which actions are allowed now, as booleans.
    fn action_masks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let mut mask = vec![false; self.mask.len()];
        self.gym()?.mask(&mut mask);
        Ok(PyArray1::from_vec(py, mask))
    }

    /// The running episode as bytes.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let snapshot = self.gym()?.snapshot().map_err(|error| errors::gym(&error))?;
        Ok(PyBytes::new(py, snapshot.as_bytes()))
    }

    /// Goes on from an episode that was stored.
    fn restore<'py>(
        &mut self,
        py: Python<'py>,
        snapshot: &[u8],
    ) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyDict>)> {
        let task = Arc::clone(self.task()?);
        let snapshot =
            Snapshot::from_bytes(snapshot.to_vec()).map_err(|error| SnapshotError::new_err(errors::message(&error)))?;
        let gym = Gym::restore(&task, &snapshot).map_err(|error| errors::gym(&error))?;
        self.state = State::Running(task, Box::new(gym));
        self.look(py)
    }

    /// The running episode as bytes, if there is one.
    fn _stored<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        if let State::Running(..) = self.state { self.snapshot(py).map(Some) } else { Ok(None) }
    }

    /// Seed and number of the present episode.
    fn _series(&self) -> Option<(u64, u64)> {
        self.series
    }

    /// Goes on from an episode that was stored, and in its series.
    fn _resume(&mut self, py: Python<'_>, series: (u64, u64), snapshot: &[u8]) -> PyResult<()> {
        self.restore(py, snapshot)?;
        self.series = Some(series);
        Ok(())
    }

    /// A digest of the whole physical state: equal states have equal digests.
    fn digest(&self) -> PyResult<u64> {
        Ok(self.gym()?.digest())
    }

    /// The present instant as pixels: RGB, shape (`height_px`, `width_px`, 3).
    fn _rgb<'py>(&self, py: Python<'py>, width_px: u32, height_px: u32) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        let pixels = render::rgb(&self.gym()?.view(), width_px, height_px).map_err(|error| errors::config(&error))?;
        PyArray1::from_vec(py, pixels).reshape(&[height_px as usize, width_px as usize, 3][..])
    }

    /// The present instant as text for a terminal.
    fn _ansi(&self, columns: usize) -> PyResult<String> {
        render::ansi(&self.gym()?.view(), columns).map_err(|error| errors::config(&error))
    }

    /// Lets go of the episode.
    fn _close(&mut self) {
        self.state = State::Closed;
    }
}

impl EnvCore {
    fn task(&self) -> PyResult<&Arc<gym::Task>> {
        match &self.state {
            State::Closed => Err(self.not_running()),
            State::Ready(task) | State::Running(task, _) => Ok(task),
        }
    }

    pub(crate) fn gym(&self) -> PyResult<&Gym> {
        match &self.state {
            State::Running(_, gym) => Ok(gym),
            _ => Err(self.not_running()),
        }
    }

    fn not_running(&self) -> PyErr {
        match self.state {
            State::Closed => ClosedEnvironmentError::new_err("the environment is closed"),
            _ => ResetNeeded::new_err("the first episode has not begun; call reset()"),
        }
    }

    /// Observation and info as they stand.
    fn look<'py>(&mut self, py: Python<'py>) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyDict>)> {
        let State::Running(task, gym) = &self.state else { return Err(self.not_running()) };
        gym.observe(&mut self.observation);
        let observation = PyArray1::from_slice(py, &self.observation);
        let shape = &task.observations().shape;
        let observation =
            if shape.len() == 1 { observation.to_dyn().clone() } else { observation.reshape(&shape[..])? };
        gym.metrics(&mut self.metrics);
        let info = PyDict::new(py);
        for ((name, value), metric) in self.names.iter().zip(&self.metrics).zip(task.metrics()) {
            match metric.kind {
                MetricKind::Float => info.set_item(name, value)?,
                MetricKind::Count => info.set_item(name, *value as i64)?,
                MetricKind::Flag => info.set_item(name, *value != 0.0)?,
            }
        }
        if !self.mask.is_empty() {
            gym.mask(&mut self.mask);
            let mask: Vec<i8> = self.mask.iter().map(|allowed| i8::from(*allowed)).collect();
            info.set_item(intern!(py, "action_mask"), PyArray1::from_vec(py, mask))?;
        }
        Ok((observation, info))
    }
}

/// A whole number of Python or NumPy.
pub(crate) fn whole(action: &Bound<'_, PyAny>) -> PyResult<i64> {
    action.extract().map_err(|error: PyErr| {
        let py = action.py();
        if error.is_instance_of::<pyo3::exceptions::PyOverflowError>(py) {
            ActionError::new_err(format!("action {action} does not fit 64 bits"))
        } else {
            PyTypeError::new_err(format!("an action is a whole number here, not {}", described(action)))
        }
    })
}

/// Real numbers of this shape, from an array or anything that NumPy makes one of.
pub(crate) fn reals(values: &Bound<'_, PyAny>, shape: &[usize]) -> PyResult<Vec<f64>> {
    let kind = intern!(values.py(), "float64");
    let array = values.py().import(intern!(values.py(), "numpy"))?.call_method1("asarray", (values, kind));
    let array =
        array.map_err(|_| PyTypeError::new_err(format!("actions are real numbers here, not {}", described(values))))?;
    let array: PyReadonlyArrayDyn<'_, f64> = array.extract()?;
    let array = array.as_array();
    if array.shape() != shape {
        return Err(ActionError::new_err(format!("actions have shape {:?}, but must have {shape:?}", array.shape())));
    }
    Ok(array.iter().copied().collect())
}

fn described(value: &Bound<'_, PyAny>) -> String {
    value.get_type().name().map_or_else(|_| "this".to_owned(), |name| name.to_string())
}
