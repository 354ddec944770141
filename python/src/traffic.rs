//! The traffic alone, and the formulas that its drivers follow.

use lanecraft_drive::config::check_range;
use lanecraft_drive::models::idm::{IdmParams, idm_accel};
use lanecraft_drive::models::safe_distance::BrakingLimits;
use lanecraft_drive::road::{LaneIndex, Road};
use lanecraft_drive::snapshot::Snapshot;
use lanecraft_drive::traffic::{ExternalBody, StepEvents, Vehicle, World};
use lanecraft_lab::scenarios::named as named_scenario;
use numpy::{Element, PyArray1, PyReadonlyArrayDyn, PyReadwriteArrayDyn};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::errors::{self, ConfigError, SnapshotError};
use crate::task;

/// Steps between two looks whether the user wants to stop.
const STEPS_AT_ONCE: u64 = 200;

/// Position along the road and to the left (m), heading (rad), speed (m/s), acceleration (m/s²), length, width (m), target lane.
type Body = ([f64; 7], u8);

/// Lane changes begun, pairs that touched, and whom the ego touched: id, fault class, whether it was the ego's fault.
type Events = (u64, u64, Option<(u32, &'static str, bool)>);

/// The traffic of one road; the base of `lanecraft.traffic.World`.
#[pyclass(subclass, module = "lanecraft._lanecraft")]
pub(crate) struct WorldCore {
    world: World,
    step_s: f64,
}

#[pymethods]
impl WorldCore {
    #[new]
    fn new(
        py: Python<'_>,
        preset: &str,
        config: &Bound<'_, PyDict>,
        scenario: Option<&str>,
        seed: u64,
    ) -> PyResult<Self> {
        let environment = task::resolved(preset, config, None)?.environment;
        let step_s = environment.env.control_period_s;
        let scene = match scenario {
            None => environment.scenario(seed).map_err(|error| errors::config(&error))?,
            Some(name) => {
                named_scenario(name).and_then(|file| file.scenario(seed)).map_err(|error| errors::config(&error))?
            }
        };
        let world = py.detach(|| World::with_step(&scene, step_s)).map_err(|error| errors::config(&error))?;
        Ok(Self { world, step_s })
    }

    /// So many steps without an ego.
    fn _step(&mut self, py: Python<'_>, steps: u64) -> PyResult<Events> {
        let (world, step_s) = (&mut self.world, self.step_s);
        let mut sum = (0, 0, None);
        for first in (0..steps).step_by(STEPS_AT_ONCE as usize) {
            py.check_signals()?;
            py.detach(|| {
                for _ in first..steps.min(first + STEPS_AT_ONCE) {
                    add(&mut sum, &world.step_alone(step_s));
                }
            });
        }
        Ok(sum)
    }

    /// One step with the ego's body after it.
    fn _step_with(&mut self, py: Python<'_>, ego: Body) -> PyResult<Events> {
        let ego = body(ego, self.world.road())?;
        let mut sum = (0, 0, None);
        py.detach(|| add(&mut sum, &self.world.step(ego, self.step_s)));
        Ok(sum)
    }

    /// Puts the ego into the world.
    fn _place(&mut self, ego: Body) -> PyResult<()> {
        self.world.set_ego(body(ego, self.world.road())?);
        Ok(())
    }

    /// The world as bytes.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let snapshot = self.world.snapshot().map_err(|error| SnapshotError::new_err(errors::message(&error)))?;
        Ok(PyBytes::new(py, snapshot.as_bytes()))
    }

    /// Goes on from a world that was stored.
    fn restore(&mut self, snapshot: &[u8]) -> PyResult<()> {
        let world = Snapshot::from_bytes(snapshot.to_vec()).and_then(|snapshot| World::restore(&snapshot));
        self.world = world.map_err(|error| SnapshotError::new_err(errors::message(&error)))?;
        Ok(())
    }

    /// A digest of the whole state: equal states have equal digests.
    fn digest(&self) -> u64 {
        self.world.digest()
    }

    fn __len__(&self) -> usize {
        self.world.len()
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.world.seed()
    }

    #[getter]
    fn step_s(&self) -> f64 {
        self.step_s
    }

    #[getter]
    fn time_s(&self) -> f64 {
        self.world.time_step() as f64 * self.step_s
    }

    #[getter]
    fn ego_start(&self) -> (f64, u8, f64) {
        let (s_m, lane, speed_mps) = self.world.ego_start();
        (s_m, lane.0, speed_mps)
    }

    #[getter]
    fn lane_centers_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let road = self.world.road();
        PyArray1::from_iter(py, road.lanes().map(|lane| road.lane_center_m(lane)))
    }

    #[getter]
    fn id<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.column(py, |vehicle| i64::from(vehicle.id.0))
    }

    #[getter]
    fn s_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |vehicle| vehicle.s_m)
    }

    #[getter]
    fn d_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |vehicle| vehicle.d_m)
    }

    #[getter]
    fn speed_mps<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |vehicle| vehicle.speed_mps)
    }

    #[getter]
    fn lateral_speed_mps<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |vehicle| vehicle.lateral_speed_mps)
    }

    #[getter]
    fn accel_mps2<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |vehicle| vehicle.accel_mps2)
    }

    #[getter]
    fn length_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |vehicle| vehicle.length_m)
    }

    #[getter]
    fn width_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |vehicle| vehicle.width_m)
    }

    #[getter]
    fn lane<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.column(py, |vehicle| i64::from(vehicle.lane.0))
    }

    #[getter]
    fn target_lane<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.column(py, |vehicle| i64::from(vehicle.target_lane.0))
    }
}

impl WorldCore {
    /// A number of every vehicle, by rising id.
    fn column<'py, T: Element>(&self, py: Python<'py>, of: impl Fn(&Vehicle) -> T) -> Bound<'py, PyArray1<T>> {
        PyArray1::from_vec(py, self.world.vehicles().map(|vehicle| of(&vehicle)).collect())
    }
}

fn add(sum: &mut Events, events: &StepEvents) {
    sum.0 += u64::from(events.lane_changes);
    sum.1 += u64::from(events.hdv_overlaps);
    sum.2 = events.collision.map(|collision| (collision.with.0, collision.fault.name(), collision.fault.at_fault()));
}

/// The ego's body, checked.
fn body((numbers, target_lane): Body, road: &Road) -> PyResult<ExternalBody> {
    const RANGES: [(&str, f64, f64); 7] = [
        ("s_m", -1e7, 1e7),
        ("d_m", -1e3, 1e3),
        ("heading_rad", -3.2, 3.2),
        ("speed_mps", 0.0, 150.0),
        ("accel_mps2", -100.0, 100.0),
        ("length_m", 0.1, 30.0),
        ("width_m", 0.1, 5.0),
    ];
    in_ranges(&numbers, &RANGES)?;
    let target_lane = LaneIndex(target_lane);
    if !road.lanes().any(|lane| lane == target_lane) {
        let last = road.lanes().count() - 1;
        return Err(ConfigError::new_err(format!("target_lane is {}, but must be in 0..={last}", target_lane.0)));
    }
    let [s_m, d_m, heading_rad, speed_mps, accel_mps2, length_m, width_m] = numbers;
    Ok(ExternalBody { s_m, d_m, heading_rad, speed_mps, accel_mps2, length_m, width_m, target_lane })
}

fn in_ranges(numbers: &[f64], ranges: &[(&'static str, f64, f64)]) -> PyResult<()> {
    let check = |(value, (name, low, high)): (&f64, &(&'static str, f64, f64))| check_range(name, *value, *low, *high);
    numbers.iter().zip(ranges).try_for_each(check).map_err(|error| errors::config(&error))
}

const SPEED: (f64, f64) = (0.0, 1e3);
const BRAKING: (f64, f64) = (1e-3, 1e3);

/// The IDM's acceleration at every place of `out`.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "arguments from Python are handed over")]
pub(crate) fn idm(arrays: [PyReadonlyArrayDyn<'_, f64>; 8], out: PyReadwriteArrayDyn<'_, f64>) -> PyResult<()> {
    let ranges = [
        ("gap_m", 0.0, f64::INFINITY),
        ("speed_mps", SPEED.0, SPEED.1),
        ("approach_mps", -1e3, 1e3),
        ("desired_speed_mps", 1e-3, 1e3),
        ("time_headway_s", 0.0, 1e3),
        ("min_gap_m", 0.0, 1e3),
        ("max_accel_mps2", BRAKING.0, BRAKING.1),
        ("comfort_decel_mps2", BRAKING.0, BRAKING.1),
    ];
    everywhere(&arrays, &ranges, out, |[gap, speed, approach, desired, headway, min_gap, accel, decel]| {
        let driver = IdmParams {
            desired_speed_mps: desired,
            time_headway_s: headway,
            min_gap_m: min_gap,
            max_accel_mps2: accel,
            comfort_decel_mps2: decel,
        };
        idm_accel(gap, speed, approach, &driver)
    })
}

/// The smallest safe gap at every place of `out`.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "arguments from Python are handed over")]
pub(crate) fn safe_gap(arrays: [PyReadonlyArrayDyn<'_, f64>; 5], out: PyReadwriteArrayDyn<'_, f64>) -> PyResult<()> {
    let speed = ("speed_mps", SPEED.0, SPEED.1);
    everywhere(&arrays, &with_limits(speed), out, |[speed, leader_speed, own, leader, margin]| {
        limits(own, leader, margin).required_gap_m(speed, leader_speed)
    })
}

/// The largest safe speed at every place of `out`.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "arguments from Python are handed over")]
pub(crate) fn safe_speed(arrays: [PyReadonlyArrayDyn<'_, f64>; 5], out: PyReadwriteArrayDyn<'_, f64>) -> PyResult<()> {
    let gap = ("gap_m", 0.0, f64::INFINITY);
    everywhere(&arrays, &with_limits(gap), out, |[gap, leader_speed, own, leader, margin]| {
        limits(own, leader, margin).safe_speed_mps(gap, leader_speed)
    })
}

fn limits(follower_mps2: f64, leader_mps2: f64, margin_m: f64) -> BrakingLimits {
    BrakingLimits { follower_mps2, leader_mps2, margin_m }
}

fn with_limits(first: (&'static str, f64, f64)) -> [(&'static str, f64, f64); 5] {
    [
        first,
        ("leader_speed_mps", SPEED.0, SPEED.1),
        ("braking_mps2", BRAKING.0, BRAKING.1),
        ("leader_braking_mps2", BRAKING.0, BRAKING.1),
        ("margin_m", 0.0, 1e3),
    ]
}

/// Writes `law` of the arrays, all of one shape, once every number was found in its range.
fn everywhere<const N: usize>(
    arrays: &[PyReadonlyArrayDyn<'_, f64>; N],
    ranges: &[(&'static str, f64, f64); N],
    mut out: PyReadwriteArrayDyn<'_, f64>,
    law: impl Fn([f64; N]) -> f64,
) -> PyResult<()> {
    let views = arrays.each_ref().map(PyReadonlyArrayDyn::as_array);
    let mut out = out.as_array_mut();
    if views.iter().any(|view| view.shape() != out.shape()) {
        return Err(ConfigError::new_err("the arrays must have one shape"));
    }
    let mut numbers = views.each_ref().map(|view| view.iter());
    for value in &mut out {
        let row = numbers.each_mut().map(|numbers| numbers.next().copied().unwrap_or(f64::NAN));
        in_ranges(&row, ranges)?;
        *value = law(row);
    }
    Ok(())
}
