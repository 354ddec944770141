//! The planner alone, and its polynomials.

use lanecraft_drive::plan::{LaneChangePath, LateralState, Planner, Quintic, Refusal};
use lanecraft_drive::road::Side;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::errors;
use crate::parts::Parts;
use crate::task::named;

/// Coefficients, features and rewards of the candidates, and the index of the chosen one.
type Candidates<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, usize);
/// Lane left, lane entered, shortest and longest duration.
type WindowParts = (u8, u8, f64, f64);
/// Position, speed, acceleration and jerk.
type Motion<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// The window and its candidates, or the refusal: its name, and in words.
type Outcome<'py> = (Option<(WindowParts, Candidates<'py>)>, Option<(&'static str, String)>);

/// The planner of a configuration.
#[pyclass(frozen, module = "lanecraft._lanecraft")]
pub(crate) struct PlannerCore {
    parts: Py<Parts>,
    planner: Planner,
}

#[pymethods]
impl PlannerCore {
    #[new]
    fn new(parts: Py<Parts>) -> PyResult<Self> {
        let config = parts.get().environment();
        let planner = Planner::new(&config.planner, &config.vehicle).map_err(|error| errors::config(&error))?;
        Ok(Self { parts, planner })
    }

    /// The window of one side and its candidates; or the refusal.
    fn plan<'py>(&self, py: Python<'py>, scene: &Bound<'py, PyAny>, side: &str) -> PyResult<Outcome<'py>> {
        let side = named("side", side, &[("left", Side::Left), ("right", Side::Right)])?;
        let (scene, forecast) = self.parts.get().scene(scene)?;
        let found = py.detach(|| {
            let window = self.planner.window(&scene, &forecast, side)?;
            let candidates = self.planner.candidates(&scene, &forecast, &window);
            Ok((window, candidates, self.planner.choose(&scene, &forecast, &window)))
        });
        match found {
            Ok((window, candidates, chosen)) => {
                let parts = (window.from.0, window.to.0, window.shortest_s, window.longest_s);
                let chosen = candidates.iter().position(|path| *path == chosen).unwrap_or_default();
                Ok((Some((parts, arrays(py, &candidates, chosen)?)), None))
            }
            Err(refusal) => Ok((None, Some((refusal_name(refusal), refusal.to_string())))),
        }
    }

    /// Coefficients and duration of the path to rest at `end_m`; none if no duration keeps the lateral bounds.
    fn path_to(&self, scene: &Bound<'_, PyAny>, end_m: f64, duration_s: f64) -> PyResult<Option<([f64; 6], f64)>> {
        let (scene, _) = self.parts.get().scene(scene)?;
        let path = self.planner.path_to(&scene, end_m, duration_s);
        Ok(path.map(|path| (path.coefficients, path.duration_s)))
    }
}

fn arrays<'py>(py: Python<'py>, candidates: &[LaneChangePath], chosen: usize) -> PyResult<Candidates<'py>> {
    let rows = |row: fn(&LaneChangePath) -> Vec<f64>| -> PyResult<_> {
        Ok(PyArray2::from_vec2(py, &candidates.iter().map(row).collect::<Vec<_>>())?)
    };
    let paths = rows(|path| {
        let mut row = path.quintic.coefficients.to_vec();
        row.push(path.quintic.duration_s);
        row
    })?;
    let rewards = PyArray1::from_iter(py, candidates.iter().map(|path| path.reward));
    Ok((paths, rows(|path| path.features.to_vec())?, rewards, chosen))
}

fn refusal_name(refusal: Refusal) -> &'static str {
    match refusal {
        Refusal::NoLane => "no-lane",
        Refusal::LaneEnds => "lane-ends",
        Refusal::Occupied => "occupied",
        Refusal::LateralLimit => "lateral-limit",
        Refusal::TargetLeader => "target-leader",
        Refusal::CurrentLeader => "current-leader",
        Refusal::Follower => "follower",
        Refusal::EmptyWindow => "empty-window",
    }
}

/// The coefficients from a lateral state (position, speed, acceleration) to rest.
#[pyfunction]
pub(crate) fn quintic_between(start: (f64, f64, f64), end_m: f64, duration_s: f64) -> [f64; 6] {
    let (d_m, speed_mps, accel_mps2) = start;
    Quintic::new(LateralState { d_m, speed_mps, accel_mps2 }, end_m, duration_s).coefficients
}

/// Position, speed, acceleration and jerk at each time.
#[pyfunction]
pub(crate) fn quintic_at<'py>(
    py: Python<'py>,
    coefficients: [f64; 6],
    duration_s: f64,
    times_s: PyReadonlyArray1<'py, f64>,
) -> Motion<'py> {
    let path = Quintic { coefficients, duration_s };
    let points: Vec<_> = times_s.as_array().iter().map(|&time_s| path.at(time_s)).collect();
    let column = |read: fn(&(f64, f64, f64, f64)) -> f64| PyArray1::from_iter(py, points.iter().map(read));
    (column(|p| p.0), column(|p| p.1), column(|p| p.2), column(|p| p.3))
}

/// The largest magnitudes of speed, acceleration and jerk on the whole duration.
#[pyfunction]
pub(crate) fn quintic_maxima(coefficients: [f64; 6], duration_s: f64) -> (f64, f64, f64) {
    let path = Quintic { coefficients, duration_s };
    (path.max_speed_mps(), path.max_accel_mps2(), path.max_of_accel_and_jerk(0.0, 1.0))
}
