//! What the parts that can be used alone share: a configuration, and a scene made of arrays.

use std::sync::Arc;

use lanecraft_drive::decide::ActionSet;
use lanecraft_drive::perceive::complete;
use lanecraft_drive::predict::{FORECAST_STEPS, Forecast, ForecastPoint};
use lanecraft_drive::road::{LaneIndex, Road};
use lanecraft_drive::scene::{Neighbor, Scene, VehicleId};
use lanecraft_drive::vehicle::VehicleState;
use lanecraft_lab::config::{EnvironmentConfig, RunConfig};
use numpy::ndarray::{ArrayView, Dimension};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{self, ConfigError};
use crate::task::resolved;

/// Vehicles in a scene at most: each is forecast.
const MAX_NEIGHBORS: usize = 1000;

/// A preset with the user's own numbers laid over it, and the road it describes.
#[pyclass(frozen, module = "lanecraft._lanecraft")]
pub(crate) struct Parts {
    pub(crate) run: RunConfig,
    pub(crate) road: Arc<Road>,
}

#[pymethods]
impl Parts {
    #[new]
    fn new(preset: &str, config: &Bound<'_, PyDict>) -> PyResult<Self> {
        let run = resolved(preset, config, None)?;
        let road = Road::new(run.environment.road.clone()).map_err(|error| errors::config(&error))?;
        Ok(Self { run, road: Arc::new(road) })
    }

    /// The complete configuration as TOML.
    #[getter]
    fn config_toml(&self) -> String {
        self.run.to_toml()
    }

    /// Width of a lane, m.
    #[getter]
    fn lane_width_m(&self) -> f64 {
        self.road.lane_width_m()
    }

    /// The weights q1 and q2 of whoever has no opinion on them.
    #[getter]
    fn plain_weights(&self) -> PyResult<(f64, f64)> {
        let actions = ActionSet::new(&self.environment().actions).map_err(|error| errors::config(&error))?;
        let weights = actions.plain_weights();
        Ok((weights.speed_ratio, weights.path_ratio))
    }
}

impl Parts {
    pub(crate) fn environment(&self) -> &EnvironmentConfig {
        &self.run.environment
    }

    /// The lane of this index, if the road has it.
    pub(crate) fn lane(&self, lane: usize) -> PyResult<LaneIndex> {
        self.road.lanes().nth(lane).ok_or_else(|| {
            let last = self.road.lanes().count() - 1;
            ConfigError::new_err(format!("there is no lane {lane}; the road's lanes are 0 to {last}, from the right"))
        })
    }

    /// The scene on this road, with its forecast.
    pub(crate) fn scene(&self, scene: &Bound<'_, PyAny>) -> PyResult<(Scene, Forecast)> {
        let arrays: SceneArrays<'_> = scene.extract()?;
        let ego = arrays.state()?;
        let mut made = Scene {
            road: Arc::clone(&self.road),
            ego,
            ego_length_m: arrays.size.0,
            ego_width_m: arrays.size.1,
            ego_lane: arrays.lane.map_or(Ok(self.road.nearest_lane(ego.d_m)), |lane| self.lane(lane))?,
            neighbors: arrays.neighbors(self)?,
        };
        complete(&mut made);
        let mut forecast = Forecast::default();
        self.environment().prediction.predictor.forecast(&made, &mut forecast);
        arrays.overwrite(&made, &mut forecast)?;
        Ok((made, forecast))
    }
}

/// What `lanecraft.scene.Scene` holds for this side.
#[derive(FromPyObject)]
struct SceneArrays<'py> {
    /// s, d, heading, speed, lateral speed, yaw rate, steering angle, acceleration.
    #[pyo3(attribute("_ego"))]
    ego: PyReadonlyArray1<'py, f64>,
    #[pyo3(attribute("_size_m"))]
    size: (f64, f64),
    #[pyo3(attribute("ego_lane"))]
    lane: Option<usize>,
    /// For each neighbor: ahead, d, speed, lateral speed, acceleration, length, width.
    #[pyo3(attribute("_neighbors"))]
    neighbors: PyReadonlyArray2<'py, f64>,
    /// For each neighbor: its lane and the one it changes into.
    #[pyo3(attribute("_lanes"))]
    lanes: PyReadonlyArray2<'py, i64>,
    /// Neighbors × points × (ahead, d, speed), in place of the predictor's.
    #[pyo3(attribute("forecast"))]
    forecast: Option<PyReadonlyArray3<'py, f64>>,
}

impl SceneArrays<'_> {
    fn state(&self) -> PyResult<VehicleState> {
        let ego = self.ego.as_array();
        shaped("ego", &ego, &[8])?;
        Ok(VehicleState {
            s_m: ego[0],
            d_m: ego[1],
            heading_rad: ego[2],
            speed_mps: ego[3],
            lateral_speed_mps: ego[4],
            yaw_rate_radps: ego[5],
            steer_rad: ego[6],
            accel_mps2: ego[7],
        })
    }

    fn neighbors(&self, parts: &Parts) -> PyResult<Vec<Neighbor>> {
        let (numbers, lanes) = (self.neighbors.as_array(), self.lanes.as_array());
        let count = numbers.shape()[0];
        shaped("neighbors", &numbers, &[count, 7])?;
        shaped("lanes", &lanes, &[count, 2])?;
        if count > MAX_NEIGHBORS {
            return Err(ConfigError::new_err(format!("{count} neighbors, but at most {MAX_NEIGHBORS} are allowed")));
        }
        let lane = |lane: i64| parts.lane(usize::try_from(lane).unwrap_or(usize::MAX));
        (0..count as u32)
            .zip(numbers.rows())
            .zip(lanes.rows())
            .map(|((id, row), lanes)| {
                Ok(Neighbor {
                    id: VehicleId(id),
                    ahead_m: row[0],
                    d_m: row[1],
                    speed_mps: row[2],
                    lateral_speed_mps: row[3],
                    accel_mps2: row[4],
                    length_m: row[5],
                    width_m: row[6],
                    lane: lane(lanes[0])?,
                    target_lane: lane(lanes[1])?,
                })
            })
            .collect()
    }

    /// Puts the caller's forecast, if there is one, in the place of the predictor's.
    fn overwrite(&self, scene: &Scene, forecast: &mut Forecast) -> PyResult<()> {
        let Some(given) = &self.forecast else { return Ok(()) };
        let given = given.as_array();
        let count = self.neighbors.as_array().shape()[0];
        shaped("forecast", &given, &[count, FORECAST_STEPS + 1, 3])?;
        for (index, neighbor) in scene.neighbors.iter().enumerate().filter(|(_, neighbor)| !neighbor.is_lane_end()) {
            for (step, point) in forecast.track_mut(index).iter_mut().enumerate() {
                let at = |column: usize| given[[neighbor.id.0 as usize, step, column]];
                *point = ForecastPoint { ahead_m: at(0), d_m: at(1), speed_mps: at(2) };
            }
        }
        Ok(())
    }
}

/// Refuses an array of another shape.
pub(crate) fn shaped<T, D: Dimension>(what: &str, array: &ArrayView<'_, T, D>, shape: &[usize]) -> PyResult<()> {
    if array.shape() == shape {
        return Ok(());
    }
    let found = array.shape();
    Err(ConfigError::new_err(format!("`{what}` has shape {found:?}, but must have {shape:?}")))
}
