//! Where lanes exist and where a line between two of them may be crossed.
//!
//! A lane that `road.lanes_open` names exists on the stretches given there only, every other lane exists everywhere. A lane drop is
//! a lane whose stretch ends; an on-ramp is a lane 0 with a stretch whose first part lies behind a solid line. Where a lane ends,
//! another one must lead on: a road on which somebody would have to wait for ever is refused.

use super::{LaneIndex, Road, RoadConfig, Side, Topology};
use crate::config::{ConfigError, check_range};

/// How far before a lane's end the way out of it must be open and not behind a solid line, m.
const LAST_CHANCE_M: f64 = 50.0;

/// Part of a lane: where it begins, and its length. On a ring it may reach past the seam.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stretch {
    from_m: f64,
    length_m: f64,
}

/// Where each lane exists; a lane without stretches exists everywhere.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct LaneMap {
    stretches: Vec<Vec<Stretch>>,
}

impl LaneMap {
    /// The map of a road whose numbers are in range.
    pub(super) fn new(config: &RoadConfig) -> Self {
        if config.lanes_open.is_empty() {
            return Self::default();
        }
        let of_lane = |lane| {
            let mut stretches: Vec<Stretch> = Vec::new();
            for open in config.lanes_open.iter().filter(|open| open.lane == LaneIndex(lane)) {
                let length_m = open.to_m - open.from_m;
                match stretches.last_mut().filter(|last| last.from_m + last.length_m >= open.from_m) {
                    Some(last) => last.length_m += length_m,
                    None => stretches.push(Stretch { from_m: open.from_m, length_m }),
                }
            }
            if config.topology == Topology::Ring {
                close_ring(&mut stretches, config.length_m);
            }
            stretches
        };
        Self { stretches: (0..config.lanes).map(of_lane).collect() }
    }

    fn of(&self, lane: LaneIndex) -> &[Stretch] {
        self.stretches.get(usize::from(lane.0)).map_or(&[], Vec::as_slice)
    }
}

/// Joins the stretch that ends at the seam of a ring with the one that begins there; a lane all around has no end.
fn close_ring(stretches: &mut Vec<Stretch>, ring_m: f64) {
    let (Some(first), Some(last)) = (stretches.first().copied(), stretches.last().copied()) else { return };
    if first.from_m > 0.0 || last.from_m + last.length_m < ring_m {
        return;
    }
    stretches.remove(0);
    if let Some(last) = stretches.last_mut() {
        last.length_m += first.length_m;
    }
}

impl RoadConfig {
    /// Stretches of a lane rise without overlap, within the road.
    pub(super) fn validate_lanes(&self) -> Result<(), ConfigError> {
        let last_lane = f64::from(self.lanes - 1);
        let (first_m, last_m) = self.extent_m();
        for (index, open) in self.lanes_open.iter().enumerate() {
            let before = self.lanes_open[..index].iter().filter(|other| other.lane == open.lane);
            let free_from_m = before.map(|other| other.to_m).fold(first_m, f64::max);
            check_range("road.lanes_open.lane", f64::from(open.lane.0), 0.0, last_lane)?;
            check_range("road.lanes_open.from_m", open.from_m, free_from_m, last_m)?;
            check_range("road.lanes_open.to_m", open.to_m, open.from_m + 1.0, last_m)?;
        }
        for line in &self.solid_lines {
            check_range("road.solid_lines.right_lane", f64::from(line.right_lane.0), 0.0, (last_lane - 1.0).max(0.0))?;
            check_range("road.solid_lines.from_m", line.from_m, first_m, last_m)?;
            check_range("road.solid_lines.to_m", line.to_m, line.from_m, last_m)?;
        }
        Ok(())
    }

    /// Where positions may lie.
    pub(super) fn extent_m(&self) -> (f64, f64) {
        match self.topology {
            Topology::Ring => (0.0, self.length_m),
            Topology::Open => (-1e6, 1e6),
        }
    }
}

impl Road {
    /// Refuses a lane's end from which no other lane leads on.
    pub(super) fn check_ends(&self) -> Result<(), ConfigError> {
        for lane in self.lanes() {
            for stretch in self.lane_map.of(lane) {
                let end_m = stretch.from_m + stretch.length_m;
                let chance_m = self.wrap_m(end_m - LAST_CHANCE_M.min(0.5 * stretch.length_m));
                let side = self.way_out(lane, chance_m);
                if side.is_none_or(|side| self.neighbor_lane(lane, side, chance_m).is_none()) {
                    return Err(ConfigError::NoWayOut { lane: lane.0, end_m: self.wrap_m(end_m) });
                }
            }
        }
        Ok(())
    }

    /// Whether every lane exists everywhere.
    pub fn has_all_lanes(&self) -> bool {
        self.lane_map.stretches.is_empty()
    }

    /// The stretch of `lane` on which `s_m` lies, and how far past its beginning.
    fn stretch_at(&self, lane: LaneIndex, s_m: f64) -> Option<(f64, f64)> {
        let past = |stretch: &Stretch| (self.past_m(stretch.from_m, s_m), stretch.length_m);
        self.lane_map.of(lane).iter().map(past).find(|(past_m, length_m)| (0.0..=*length_m).contains(past_m))
    }

    /// Whether `lane` exists from `half_m` behind `s_m` to `half_m` ahead of it.
    pub fn lane_holds(&self, lane: LaneIndex, s_m: f64, half_m: f64) -> bool {
        lane.0 < self.config().lanes
            && (self.lane_map.of(lane).is_empty()
                || self
                    .stretch_at(lane, s_m)
                    .is_some_and(|(past_m, length_m)| past_m >= half_m && length_m - past_m >= half_m))
    }

    /// How far ahead of `s_m` the lane ends, m: infinite if it goes on, 0 where it does not exist.
    pub fn lane_end_ahead_m(&self, lane: LaneIndex, s_m: f64) -> f64 {
        if self.lane_map.of(lane).is_empty() {
            return f64::INFINITY;
        }
        self.stretch_at(lane, s_m).map_or(0.0, |(past_m, length_m)| length_m - past_m)
    }

    /// The lane on this side at `s_m`, if it exists there and the line between may be crossed.
    pub fn neighbor_lane(&self, lane: LaneIndex, side: Side, s_m: f64) -> Option<LaneIndex> {
        let beside = self.beside(lane, side).filter(|&beside| self.lane_holds(beside, s_m, 0.0))?;
        let right_lane = lane.min(beside);
        let solid = |line: &super::SolidLine| {
            line.right_lane == right_lane && (0.0..=line.to_m - line.from_m).contains(&self.past_m(line.from_m, s_m))
        };
        (!self.config().solid_lines.iter().any(solid)).then_some(beside)
    }

    /// The side on which a lane goes on after `lane` ends: the one with fewer lanes to cross, the left of equal ones. None if `lane`
    /// does not end.
    pub fn way_out(&self, lane: LaneIndex, s_m: f64) -> Option<Side> {
        let end_m = self.lane_end_ahead_m(lane, s_m);
        if end_m.is_infinite() {
            return None;
        }
        let crossings = |side: &Side| {
            let mut here = lane;
            for count in 1..self.config().lanes {
                here = self.beside(here, *side).filter(|&next| self.lane_holds(next, s_m, 0.0))?;
                if self.lane_end_ahead_m(here, s_m) > end_m {
                    return Some(count);
                }
            }
            None
        };
        let sides = Side::BOTH.into_iter().filter_map(|side| Some((crossings(&side)?, side)));
        sides.min_by_key(|(count, _)| *count).map(|(_, side)| side)
    }

    /// How many lanes lie between `lane` and the one that goes on after it, that one included; 0 if `lane` does not end.
    pub fn lanes_to_cross(&self, lane: LaneIndex, s_m: f64) -> u8 {
        let Some(side) = self.way_out(lane, s_m) else { return 0 };
        let end_m = self.lane_end_ahead_m(lane, s_m);
        let mut here = lane;
        let mut count = 0;
        while let Some(next) = self.beside(here, side) {
            count += 1;
            here = next;
            if self.lane_end_ahead_m(here, s_m) > end_m {
                break;
            }
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use crate::config::ConfigError;
    use crate::road::{LaneIndex, LaneStretch, Road, RoadConfig, Side, SolidLine, Topology};

    fn open(lane: u8, from_m: f64, to_m: f64) -> LaneStretch {
        LaneStretch { lane: LaneIndex(lane), from_m, to_m }
    }

    fn road(topology: Topology, lanes: u8, lanes_open: &[LaneStretch]) -> Result<Road, ConfigError> {
        Road::new(RoadConfig { lanes, topology, lanes_open: lanes_open.to_vec(), ..RoadConfig::default() })
    }

    #[test]
    fn a_lane_ends_where_its_stretch_does() {
        let road = road(Topology::Open, 3, &[open(2, -1e6, 700.0)]).expect("valid");
        assert_eq!(road.lane_end_ahead_m(LaneIndex(2), 600.0), 100.0);
        assert_eq!(road.lane_end_ahead_m(LaneIndex(2), 701.0), 0.0);
        assert_eq!(road.lane_end_ahead_m(LaneIndex(1), 600.0), f64::INFINITY);
        assert!(road.lane_holds(LaneIndex(2), 697.0, 2.4) && !road.lane_holds(LaneIndex(2), 698.0, 2.4));
        assert_eq!(road.way_out(LaneIndex(2), 0.0), Some(Side::Right));
        assert_eq!(road.way_out(LaneIndex(1), 0.0), None);
        assert_eq!(road.neighbor_lane(LaneIndex(1), Side::Left, 699.0), Some(LaneIndex(2)));
        assert_eq!(road.neighbor_lane(LaneIndex(1), Side::Left, 701.0), None);
    }

    #[test]
    fn a_stretch_goes_on_across_the_seam_of_a_ring() {
        let road = road(Topology::Ring, 2, &[open(1, 0.0, 300.0), open(1, 600.0, 1000.0)]).expect("valid");
        assert_eq!(road.lane_end_ahead_m(LaneIndex(1), 900.0), 400.0);
        assert_eq!(road.lane_end_ahead_m(LaneIndex(1), 100.0), 200.0);
        assert_eq!(road.lane_end_ahead_m(LaneIndex(1), 450.0), 0.0);
        assert!(road.lane_holds(LaneIndex(1), 0.0, 5.0) && !road.lane_holds(LaneIndex(1), 601.0, 5.0));
    }

    #[test]
    fn a_lane_all_around_a_ring_has_no_end() {
        let road = road(Topology::Ring, 2, &[open(1, 0.0, 300.0), open(1, 300.0, 1000.0)]).expect("valid");
        assert_eq!(road.lane_end_ahead_m(LaneIndex(1), 900.0), f64::INFINITY);
        assert!(road.lane_holds(LaneIndex(1), 999.0, 5.0));
    }

    #[test]
    fn the_way_out_of_two_lanes_that_end_crosses_both() {
        let ends = [open(2, -1e6, 500.0), open(3, -1e6, 500.0)];
        let road = road(Topology::Open, 4, &ends).expect("valid");
        assert_eq!([3, 2, 1].map(|lane| road.lanes_to_cross(LaneIndex(lane), 0.0)), [2, 1, 0]);
        assert_eq!(road.way_out(LaneIndex(3), 0.0), Some(Side::Right));
    }

    #[test]
    fn a_solid_line_is_not_crossed() {
        let line = SolidLine { right_lane: LaneIndex(0), from_m: 100.0, to_m: 300.0 };
        let road = Road::new(RoadConfig { solid_lines: vec![line], ..RoadConfig::default() }).expect("valid");
        assert_eq!(road.neighbor_lane(LaneIndex(0), Side::Left, 200.0), None);
        assert_eq!(road.neighbor_lane(LaneIndex(1), Side::Right, 200.0), None);
        assert_eq!(road.neighbor_lane(LaneIndex(1), Side::Left, 200.0), Some(LaneIndex(2)));
        assert_eq!(road.neighbor_lane(LaneIndex(0), Side::Left, 301.0), Some(LaneIndex(1)));
    }

    #[test]
    fn stretches_that_make_no_road_are_refused_by_key() {
        let refusals = [
            (road(Topology::Ring, 3, &[open(3, 0.0, 300.0)]), "road.lanes_open.lane"),
            (road(Topology::Ring, 3, &[open(2, 500.0, 300.0)]), "road.lanes_open.to_m"),
            (road(Topology::Ring, 3, &[open(2, 500.0, 1200.0)]), "road.lanes_open.to_m"),
            (road(Topology::Ring, 3, &[open(2, 0.0, 300.0), open(2, 200.0, 600.0)]), "road.lanes_open.from_m"),
            (road(Topology::Ring, 3, &[open(2, f64::NAN, 300.0)]), "road.lanes_open.from_m"),
        ];
        for (result, expected) in refusals {
            assert!(matches!(result, Err(ConfigError::OutOfRange { key, .. }) if key == expected), "{expected}");
        }
    }

    #[test]
    fn an_end_without_a_way_out_is_refused() {
        // Both lanes end together; a lane ends where the one beside it is closed; the way out lies behind a solid line.
        let all = road(Topology::Open, 2, &[open(0, -1e6, 500.0), open(1, -1e6, 500.0)]);
        let cut_off = road(Topology::Open, 3, &[open(0, -1e6, 500.0), open(1, 600.0, 1e6)]);
        let line = SolidLine { right_lane: LaneIndex(0), from_m: 0.0, to_m: 500.0 };
        let lanes_open = vec![open(0, 0.0, 500.0)];
        let behind_line = Road::new(RoadConfig { lanes_open, solid_lines: vec![line], ..RoadConfig::default() });
        for result in [all, cut_off, behind_line] {
            assert!(matches!(result, Err(ConfigError::NoWayOut { end_m: 500.0, .. })), "{result:?}");
        }
    }
}
