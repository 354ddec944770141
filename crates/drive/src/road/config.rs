//! The section `[road]`: what a road is made of, and what makes no road.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{LaneIndex, Road, Topology};
use crate::config::{ConfigError, check_range};

/// A point of the piecewise linear curvature κ(s).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CurvaturePoint {
    /// Position along the reference line, m.
    pub s_m: f64,
    /// Curvature there, rad/m, positive to the left.
    pub curvature_radpm: f64,
}

/// A point of the piecewise linear grade.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GradePoint {
    /// Position along the reference line, m.
    pub s_m: f64,
    /// Rise over run there, m/m, positive uphill.
    pub grade: f64,
}

/// A point of the piecewise linear bank.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BankPoint {
    /// Position along the reference line, m.
    pub s_m: f64,
    /// Bank angle there, rad, positive where the left side is the higher one.
    pub bank_rad: f64,
}

/// A stretch of road with an adhesion of its own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AdhesionPatch {
    /// Where it begins, m.
    pub s_m: f64,
    /// How long it is, m.
    pub length_m: f64,
    /// Adhesion coefficient μ on it.
    pub adhesion: f64,
}

/// A stretch on which a lane exists.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LaneStretch {
    /// Which lane.
    pub lane: LaneIndex,
    /// Where it begins, m; the stretches of a lane by rising place.
    pub from_m: f64,
    /// Where it ends, m. On a ring a lane goes on across the seam from a stretch that ends there to one that begins there.
    pub to_m: f64,
}

/// A line between two lanes that must not be crossed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SolidLine {
    /// The lane on its right.
    pub right_lane: LaneIndex,
    /// Where it begins, m.
    pub from_m: f64,
    /// Where it ends, m.
    pub to_m: f64,
}

/// A stretch with a speed limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpeedLimit {
    /// Where it begins, m.
    pub from_m: f64,
    /// Where it ends, m.
    pub to_m: f64,
    /// The limit, m/s.
    pub limit_mps: f64,
}

/// The road's parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RoadConfig {
    /// Number of lanes, 1 to 8. The paper does not say; three make its four lane changes possible.
    pub lanes: u8,
    /// Width of each lane, m: 3.75 m is the Chinese expressway's.
    pub lane_width_m: f64,
    /// Length of the ring, or of the stretch of open road that is filled at the start, m.
    pub length_m: f64,
    /// Ring or open road.
    pub topology: Topology,
    /// Adhesion coefficient μ between tires and road: 0.85 dry, 0.4 wet.
    pub adhesion: f64,
    /// Piecewise linear curvature, by rising `s_m`; empty = straight. Constant before the first and after the last point.
    pub curvature: Vec<CurvaturePoint>,
    /// Piecewise linear grade, in the same way. The paper's road is level.
    pub grade: Vec<GradePoint>,
    /// Piecewise linear bank, in the same way.
    pub bank: Vec<BankPoint>,
    /// Stretches with an adhesion of their own, the first one that covers a place counting there. Human drivers brake on the
    /// whole road no harder than its most slippery place allows, and keep their distances by that.
    pub adhesion_patches: Vec<AdhesionPatch>,
    /// Where lanes exist: a lane that is named here exists on its stretches only, every other one everywhere.
    pub lanes_open: Vec<LaneStretch>,
    /// Where a line between two lanes must not be crossed.
    pub solid_lines: Vec<SolidLine>,
    /// Speed limits, the lowest one counting where several hold.
    pub speed_limits: Vec<SpeedLimit>,
}

impl Default for RoadConfig {
    fn default() -> Self {
        Self {
            lanes: 3,
            lane_width_m: 3.75,
            length_m: 1000.0,
            topology: Topology::Ring,
            adhesion: 0.85,
            curvature: Vec::new(),
            grade: Vec::new(),
            bank: Vec::new(),
            adhesion_patches: Vec::new(),
            lanes_open: Vec::new(),
            solid_lines: Vec::new(),
            speed_limits: Vec::new(),
        }
    }
}

impl RoadConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("road.lanes", f64::from(self.lanes), 1.0, 8.0)?;
        check_range("road.lane_width_m", self.lane_width_m, 2.5, 6.0)?;
        check_range("road.length_m", self.length_m, 200.0, 1e7)?;
        check_range("road.adhesion", self.adhesion, 0.05, 1.5)?;
        let mut last_m = f64::NEG_INFINITY;
        for point in &self.curvature {
            check_range("road.curvature.s_m", point.s_m, last_m, 1e6)?;
            check_range("road.curvature.curvature_radpm", point.curvature_radpm, -0.02, 0.02)?;
            last_m = point.s_m;
        }
        last_m = f64::NEG_INFINITY;
        for point in &self.grade {
            check_range("road.grade.s_m", point.s_m, last_m, 1e6)?;
            check_range("road.grade.grade", point.grade, -0.15, 0.15)?;
            last_m = point.s_m;
        }
        last_m = f64::NEG_INFINITY;
        for point in &self.bank {
            check_range("road.bank.s_m", point.s_m, last_m, 1e6)?;
            check_range("road.bank.bank_rad", point.bank_rad, -0.15, 0.15)?;
            last_m = point.s_m;
        }
        for patch in &self.adhesion_patches {
            check_range("road.adhesion_patches.s_m", patch.s_m, -1e6, 1e6)?;
            check_range("road.adhesion_patches.length_m", patch.length_m, 0.0, 1e6)?;
            check_range("road.adhesion_patches.adhesion", patch.adhesion, 0.05, 1.5)?;
        }
        let (first_m, last_m) = self.extent_m();
        for limit in &self.speed_limits {
            check_range("road.speed_limits.from_m", limit.from_m, first_m, last_m)?;
            check_range("road.speed_limits.to_m", limit.to_m, limit.from_m, last_m)?;
            check_range("road.speed_limits.limit_mps", limit.limit_mps, 1.0, 60.0)?;
        }
        self.validate_lanes()?;
        Road::unchecked(self.clone()).check_ends()
    }
}
