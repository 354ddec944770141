//! The two controllers alone.

use lanecraft_drive::control::{LateralMpc, LateralReference, LongitudinalMpc, Rung, SolveSummary, SpeedGoal};
use lanecraft_drive::road::LaneIndex;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::parts::Parts;

/// Solved, iterations, active constraints, largest slack, residual.
type Solve = (bool, u32, u32, f64, f64);
/// Acceleration, jerk, speeds, states, rung, solve.
type SpeedAnswer<'py> = (f64, f64, Bound<'py, PyArray1<f64>>, Option<Bound<'py, PyArray2<f64>>>, &'static str, Solve);
/// Steering angle, states, rung, solve, use of front slip, rear slip and yaw rate.
type SteerAnswer<'py> = (f64, Option<Bound<'py, PyArray2<f64>>>, &'static str, Solve, (f64, f64, f64));

fn rung_name(rung: Rung) -> &'static str {
    match rung {
        Rung::Solved => "solved",
        Rung::ShiftedPlan => "shifted-plan",
        Rung::FeedbackLaw => "feedback-law",
        Rung::BrakeInLane => "brake-in-lane",
        Rung::FullBrake => "full-brake",
    }
}

fn solve_parts(solve: &SolveSummary) -> Solve {
    (solve.solved, solve.iterations, solve.active, solve.slack_max, solve.kkt_residual)
}

fn rows<'py, const N: usize>(py: Python<'py>, states: &[[f64; N]]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows: Vec<Vec<f64>> = states.iter().map(|state| state.to_vec()).collect();
    Ok(PyArray2::from_vec2(py, &rows)?)
}

/// The longitudinal controller with its warm start.
#[pyclass(module = "lanecraft._lanecraft")]
pub(crate) struct LongitudinalCore {
    parts: Py<Parts>,
    mpc: LongitudinalMpc,
}

#[pymethods]
impl LongitudinalCore {
    #[new]
    fn new(parts: Py<Parts>) -> Self {
        let config = parts.get().environment();
        let mpc = LongitudinalMpc::new(&config.control, &config.vehicle, config.env.control_period_s);
        Self { parts, mpc }
    }

    /// Plans behind the leaders of `lanes`.
    fn plan<'py>(
        &mut self,
        py: Python<'py>,
        scene: &Bound<'py, PyAny>,
        aim: (f64, Option<f64>),
        lanes: (Option<usize>, Option<usize>),
        speed_ratio: f64,
    ) -> PyResult<SpeedAnswer<'py>> {
        let (reference_accel_mps2, target_speed_mps) = aim;
        let parts = self.parts.get();
        let (scene, forecast) = parts.scene(scene)?;
        let lane =
            |lane: Option<usize>| -> PyResult<Option<LaneIndex>> { lane.map(|lane| parts.lane(lane)).transpose() };
        let control = &parts.environment().control;
        let limit_mps = control.speed_max_mps.min(scene.road.allowed_speed_mps(scene.ego.s_m));
        let goal = SpeedGoal {
            reference_accel_mps2,
            target_speed_mps: target_speed_mps.unwrap_or(limit_mps),
            lanes: [lane(lanes.0)?.or(Some(scene.ego_lane)), lane(lanes.1)?],
        };
        let mpc = &mut self.mpc;
        let plan = py.detach(|| mpc.plan(&scene, &forecast, &goal, speed_ratio));
        let speeds = PyArray1::from_slice(py, &plan.speeds_mps[..=usize::from(control.longitudinal_horizon)]);
        let states = self.mpc.planned_states().map(|states| rows(py, states)).transpose()?;
        let solve = solve_parts(&plan.solve);
        Ok((plan.accel_mps2, plan.jerk_mps3, speeds, states, rung_name(plan.rung), solve))
    }

    /// Another command was sent than the last plan's.
    fn sent(&mut self, accel_mps2: f64) {
        self.mpc.sent(accel_mps2);
    }
}

/// The lateral controller with its warm start.
#[pyclass(module = "lanecraft._lanecraft")]
pub(crate) struct LateralCore {
    parts: Py<Parts>,
    mpc: LateralMpc,
}

#[pymethods]
impl LateralCore {
    #[new]
    fn new(parts: Py<Parts>) -> Self {
        let config = parts.get().environment();
        let mpc = LateralMpc::new(&config.control, &config.vehicle, config.env.control_period_s);
        Self { parts, mpc }
    }

    /// Plans along a path, `elapsed_s` after its begin.
    fn plan<'py>(
        &mut self,
        py: Python<'py>,
        scene: &Bound<'py, PyAny>,
        path: ([f64; 6], f64, f64),
        speeds_mps: PyReadonlyArray1<'py, f64>,
        path_ratio: f64,
    ) -> PyResult<SteerAnswer<'py>> {
        let (coefficients, duration_s, elapsed_s) = path;
        let (scene, _) = self.parts.get().scene(scene)?;
        let reference = LateralReference::Path { coefficients: &coefficients, duration_s, elapsed_s };
        let speeds_mps: Vec<f64> = speeds_mps.as_array().iter().copied().collect();
        let mpc = &mut self.mpc;
        let plan = py.detach(|| mpc.plan(&scene, reference, &speeds_mps, path_ratio));
        let states = self.mpc.planned_states().map(|states| rows(py, states)).transpose()?;
        let uses = (plan.front_slip_use, plan.rear_slip_use, plan.yaw_rate_use);
        Ok((plan.steer_rad, states, rung_name(plan.rung), solve_parts(&plan.solve), uses))
    }

    /// Another command was sent than the last plan's.
    fn sent(&mut self, steer_rad: f64) {
        self.mpc.sent(steer_rad);
    }
}
