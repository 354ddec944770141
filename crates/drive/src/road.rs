//! The road: a reference line with curvature κ(s), lanes beside it, and its adhesion.
//!
//! Positions are (s, d): s along the reference line, d to its left. The reference line is the center of lane 0, the rightmost lane;
//! lane `i` has its center at `d = i · lane_width_m`. A ring closes on itself after `length_m`; an open road goes on without end,
//! and `length_m` is the stretch on which traffic is placed at the start.

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range};

/// A lane, counted from the right, starting at 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct LaneIndex(pub u8);

/// A side of the car.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// Towards higher lane indices and larger d.
    Left,
    /// Towards lower lane indices.
    Right,
}

impl Side {
    /// Both sides, left first.
    pub const BOTH: [Self; 2] = [Self::Left, Self::Right];
}

/// Whether the road closes on itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Topology {
    /// Closed after `length_m`.
    Ring,
    /// Without end.
    Open,
}

/// A point of the piecewise linear curvature κ(s).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvaturePoint {
    /// Position along the reference line, m.
    pub s_m: f64,
    /// Curvature there, rad/m, positive to the left.
    pub curvature_radpm: f64,
}

/// The road's parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
        }
    }
}

impl RoadConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("road.lanes", f64::from(self.lanes), 1.0, 8.0)?;
        check_range("road.lane_width_m", self.lane_width_m, 2.5, 6.0)?;
        check_range("road.length_m", self.length_m, 200.0, 1e5)?;
        check_range("road.adhesion", self.adhesion, 0.05, 1.5)?;
        let mut last_m = f64::NEG_INFINITY;
        for point in &self.curvature {
            check_range("road.curvature.s_m", point.s_m, last_m, 1e6)?;
            check_range("road.curvature.curvature_radpm", point.curvature_radpm, -0.02, 0.02)?;
            last_m = point.s_m;
        }
        Ok(())
    }
}

/// A checked road.
#[derive(Clone, Debug, PartialEq)]
pub struct Road {
    config: RoadConfig,
}

impl Road {
    /// A road with these parameters.
    pub fn new(config: RoadConfig) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self { config })
    }

    /// The parameters.
    pub fn config(&self) -> &RoadConfig {
        &self.config
    }

    /// All lanes, from the right.
    pub fn lanes(&self) -> impl DoubleEndedIterator<Item = LaneIndex> + use<> {
        (0..self.config.lanes).map(LaneIndex)
    }

    /// Adhesion coefficient μ.
    pub fn adhesion(&self) -> f64 {
        self.config.adhesion
    }

    /// Width of a lane, m.
    pub fn lane_width_m(&self) -> f64 {
        self.config.lane_width_m
    }

    /// Lateral position of the center of `lane`, m.
    pub fn lane_center_m(&self, lane: LaneIndex) -> f64 {
        f64::from(lane.0) * self.config.lane_width_m
    }

    /// The lane whose center is nearest to `d_m` (outside the road: the outermost lane).
    pub fn nearest_lane(&self, d_m: f64) -> LaneIndex {
        let last = f64::from(self.config.lanes - 1);
        LaneIndex((d_m / self.config.lane_width_m).round().clamp(0.0, last) as u8)
    }

    /// The lane on this side, if there is one.
    pub fn beside(&self, lane: LaneIndex, side: Side) -> Option<LaneIndex> {
        match side {
            Side::Left => (lane.0 + 1 < self.config.lanes).then(|| LaneIndex(lane.0 + 1)),
            Side::Right => lane.0.checked_sub(1).map(LaneIndex),
        }
    }

    /// Lateral positions of the right and left edge of the road, m.
    pub fn edges_m(&self) -> (f64, f64) {
        let half_m = 0.5 * self.config.lane_width_m;
        (-half_m, f64::from(self.config.lanes) * self.config.lane_width_m - half_m)
    }

    /// `s_m` brought back onto a ring; unchanged on an open road.
    pub fn wrap_m(&self, s_m: f64) -> f64 {
        match self.config.topology {
            Topology::Open => s_m,
            Topology::Ring => {
                let wrapped_m = s_m - self.config.length_m * (s_m / self.config.length_m).floor();
                // A tiny negative position rounds to the length itself.
                if wrapped_m >= self.config.length_m { 0.0 } else { wrapped_m }
            }
        }
    }

    /// How far `to_s_m` lies ahead of `from_s_m`, m: the shorter way round on a ring, negative if behind.
    pub fn ahead_m(&self, from_s_m: f64, to_s_m: f64) -> f64 {
        let ahead_m = to_s_m - from_s_m;
        match self.config.topology {
            Topology::Open => ahead_m,
            Topology::Ring => {
                let length_m = self.config.length_m;
                ahead_m - length_m * (ahead_m / length_m).round()
            }
        }
    }

    /// Curvature of the reference line at `s_m`, rad/m, positive to the left.
    pub fn curvature_radpm(&self, s_m: f64) -> f64 {
        let points = &self.config.curvature;
        let (Some(first), Some(last)) = (points.first(), points.last()) else { return 0.0 };
        let s_m = self.wrap_m(s_m);
        if s_m <= first.s_m {
            return first.curvature_radpm;
        }
        for pair in points.windows(2) {
            if s_m <= pair[1].s_m {
                let span_m = pair[1].s_m - pair[0].s_m;
                let share = if span_m > 0.0 { (s_m - pair[0].s_m) / span_m } else { 1.0 };
                return pair[0].curvature_radpm + share * (pair[1].curvature_radpm - pair[0].curvature_radpm);
            }
        }
        last.curvature_radpm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring() -> Road {
        Road::new(RoadConfig::default()).expect("the default road is valid")
    }

    #[test]
    fn distances_on_a_ring_take_the_shorter_way() {
        let road = ring();
        assert_eq!(road.ahead_m(990.0, 10.0), 20.0);
        assert_eq!(road.ahead_m(10.0, 990.0), -20.0);
        assert_eq!(road.wrap_m(-5.0), 995.0);
        assert!(road.wrap_m(-1e-18) < 1000.0);
    }

    #[test]
    fn lanes_count_from_the_right() {
        let road = ring();
        assert_eq!(road.beside(LaneIndex(0), Side::Right), None);
        assert_eq!(road.beside(LaneIndex(0), Side::Left), Some(LaneIndex(1)));
        assert_eq!(road.beside(LaneIndex(2), Side::Left), None);
        assert_eq!(road.nearest_lane(3.6), LaneIndex(1));
        assert_eq!(road.nearest_lane(-9.0), LaneIndex(0));
        assert_eq!(road.edges_m(), (-1.875, 9.375));
    }

    #[test]
    fn curvature_is_piecewise_linear() {
        let curvature = [(100.0, 0.0), (200.0, 0.001), (300.0, 0.001), (400.0, 0.0)]
            .map(|(s_m, curvature_radpm)| CurvaturePoint { s_m, curvature_radpm })
            .to_vec();
        let road = Road::new(RoadConfig { curvature, ..RoadConfig::default() }).expect("valid");
        assert_eq!(road.curvature_radpm(50.0), 0.0);
        assert!((road.curvature_radpm(150.0) - 0.0005).abs() < 1e-15);
        assert_eq!(road.curvature_radpm(250.0), 0.001);
        assert_eq!(road.curvature_radpm(900.0), 0.0);
    }

    #[test]
    fn a_bad_road_is_refused() {
        assert!(Road::new(RoadConfig { lanes: 0, ..RoadConfig::default() }).is_err());
        assert!(Road::new(RoadConfig { adhesion: f64::NAN, ..RoadConfig::default() }).is_err());
    }
}
