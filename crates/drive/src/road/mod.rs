//! The road: a reference line with curvature κ(s), grade and bank, lanes beside it, which may begin and end, speed limits, and its
//! adhesion, which patches may change.
//!
//! Positions are (s, d): s along the reference line, d to its left. The reference line is the center of lane 0, the rightmost lane;
//! lane `i` has its center at `d = i · lane_width_m`. A ring closes on itself after `length_m`; an open road goes on without end,
//! and `length_m` is the stretch on which traffic is placed at the start.

mod config;
mod lanes;
mod speed;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use self::config::{
    AdhesionPatch, BankPoint, CurvaturePoint, GradePoint, LaneStretch, RoadConfig, SolidLine, SpeedLimit,
};
use self::lanes::LaneMap;
use crate::config::ConfigError;

/// A lane, counted from the right, starting at 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct LaneIndex(pub u8);

/// A side of the car.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Topology {
    /// Closed after `length_m`.
    Ring,
    /// Without end.
    Open,
}

impl AdhesionPatch {
    /// Whether it covers some of the stretch of `range_m` from `s_m` on.
    fn meets(&self, road: &Road, s_m: f64, range_m: f64) -> bool {
        (0.0..self.length_m).contains(&road.past_m(self.s_m, s_m))
            || (0.0..=range_m).contains(&road.past_m(s_m, self.s_m))
    }
}

/// A checked road.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RoadConfig", into = "RoadConfig")]
pub struct Road {
    config: RoadConfig,
    lane_map: LaneMap,
}

impl TryFrom<RoadConfig> for Road {
    type Error = ConfigError;

    fn try_from(config: RoadConfig) -> Result<Self, ConfigError> {
        Self::new(config)
    }
}

impl From<Road> for RoadConfig {
    fn from(road: Road) -> Self {
        road.config
    }
}

impl Road {
    /// A road with these parameters.
    pub fn new(config: RoadConfig) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self::unchecked(config))
    }

    fn unchecked(config: RoadConfig) -> Self {
        Self { lane_map: LaneMap::new(&config), config }
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

    /// How far `s_m` lies past `from_s_m` in driving direction, m: once round at most on a ring, negative before it on an
    /// open road.
    fn past_m(&self, from_s_m: f64, s_m: f64) -> f64 {
        match self.config.topology {
            Topology::Open => s_m - from_s_m,
            Topology::Ring => self.wrap_m(s_m - from_s_m),
        }
    }

    /// Adhesion coefficient μ at `s_m`.
    pub fn adhesion_at(&self, s_m: f64) -> f64 {
        let here = self.config.adhesion_patches.iter().find(|patch| patch.meets(self, s_m, 0.0));
        here.map_or(self.config.adhesion, |patch| patch.adhesion)
    }

    /// Lowest adhesion coefficient μ from `s_m` on for `range_m`, the road's own included.
    pub fn lowest_adhesion(&self, s_m: f64, range_m: f64) -> f64 {
        let met = self.config.adhesion_patches.iter().filter(|patch| patch.meets(self, s_m, range_m));
        met.fold(self.config.adhesion, |lowest, patch| lowest.min(patch.adhesion))
    }

    /// The lowest and the highest adhesion coefficient μ of the road.
    pub fn adhesion_range(&self) -> (f64, f64) {
        let patches = self.config.adhesion_patches.iter().map(|patch| patch.adhesion);
        let all = (self.config.adhesion, self.config.adhesion);
        patches.fold(all, |(lowest, highest), adhesion| (lowest.min(adhesion), highest.max(adhesion)))
    }

    /// Whether the adhesion is the same everywhere.
    pub fn is_uniform(&self) -> bool {
        self.config.adhesion_patches.is_empty()
    }

    /// Curvature of the reference line at `s_m`, rad/m, positive to the left.
    pub fn curvature_radpm(&self, s_m: f64) -> f64 {
        self.piecewise(&self.config.curvature, s_m, |point| (point.s_m, point.curvature_radpm))
    }

    /// Grade at `s_m`, m/m, positive uphill.
    pub fn grade(&self, s_m: f64) -> f64 {
        self.piecewise(&self.config.grade, s_m, |point| (point.s_m, point.grade))
    }

    /// Steepest way down from `s_m` on for `range_m`, m/m, at least 0.
    pub fn steepest_descent(&self, s_m: f64, range_m: f64) -> f64 {
        if self.config.grade.is_empty() {
            return 0.0;
        }
        // Between its points the grade is linear: its extremes lie at points or at the ends.
        let ends = -self.grade(s_m).min(self.grade(s_m + range_m));
        let points = self.config.grade.iter().filter(|point| (0.0..=range_m).contains(&self.past_m(s_m, point.s_m)));
        points.fold(ends.max(0.0), |steepest, point| steepest.max(-point.grade))
    }

    /// Bank at `s_m`, rad, positive where the left side is the higher one.
    pub fn bank_rad(&self, s_m: f64) -> f64 {
        self.piecewise(&self.config.bank, s_m, |point| (point.s_m, point.bank_rad))
    }

    /// Linear between `points`, constant outside them, 0 without any.
    fn piecewise<P>(&self, points: &[P], s_m: f64, read: impl Fn(&P) -> (f64, f64)) -> f64 {
        let (Some(first), Some(last)) = (points.first(), points.last()) else { return 0.0 };
        let s_m = self.wrap_m(s_m);
        let (first_m, first_value) = read(first);
        if s_m <= first_m {
            return first_value;
        }
        for pair in points.windows(2) {
            let ((from_m, from), (to_m, to)) = (read(&pair[0]), read(&pair[1]));
            if s_m <= to_m {
                let share = if to_m > from_m { (s_m - from_m) / (to_m - from_m) } else { 1.0 };
                return from + share * (to - from);
            }
        }
        read(last).1
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
    fn patches_lie_where_they_are_also_round_the_ring() {
        let ice = AdhesionPatch { s_m: 950.0, length_m: 100.0, adhesion: 0.2 };
        let road = Road::new(RoadConfig { adhesion_patches: vec![ice], ..RoadConfig::default() }).expect("valid");
        for (s_m, adhesion) in [(949.0, 0.85), (950.0, 0.2), (10.0, 0.2), (49.9, 0.2), (50.0, 0.85), (500.0, 0.85)] {
            assert_eq!(road.adhesion_at(s_m), adhesion, "at {s_m} m");
        }
        assert_eq!([road.lowest_adhesion(800.0, 149.0), road.lowest_adhesion(800.0, 151.0)], [0.85, 0.2]);
        let open = RoadConfig { adhesion_patches: vec![ice], topology: Topology::Open, ..RoadConfig::default() };
        let open = Road::new(open).expect("valid");
        assert_eq!(
            [open.adhesion_at(10.0), open.adhesion_at(1010.0), open.lowest_adhesion(1060.0, 1e3)],
            [0.85, 0.2, 0.85]
        );
    }

    #[test]
    fn the_steepest_descent_is_that_within_reach() {
        let grade = [(0.0, 0.02), (400.0, 0.02), (500.0, -0.04), (600.0, 0.0)]
            .map(|(s_m, grade)| GradePoint { s_m, grade })
            .to_vec();
        let road = Road::new(RoadConfig { grade, ..RoadConfig::default() }).expect("valid");
        assert_eq!(road.steepest_descent(0.0, 400.0), 0.0);
        assert!((road.steepest_descent(300.0, 150.0) - 0.01).abs() < 1e-12);
        assert_eq!(road.steepest_descent(300.0, 300.0), 0.04);
        assert!((road.steepest_descent(550.0, 100.0) - 0.02).abs() < 1e-12);
    }

    #[test]
    fn a_bad_road_is_refused() {
        assert!(Road::new(RoadConfig { lanes: 0, ..RoadConfig::default() }).is_err());
        assert!(Road::new(RoadConfig { adhesion: f64::NAN, ..RoadConfig::default() }).is_err());
    }
}
