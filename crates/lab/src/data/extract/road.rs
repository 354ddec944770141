//! The road from the tracks alone: its direction, and a line along it that the vehicles have in common.
//!
//! The road runs along the main axis of all displacements. Vehicles that go forth and back along it are two roads. For each, positions (u, y)
//! along and across the axis are explained by y = p(u) + c_i with a quintic p for all vehicles and an intercept c_i for each, fitted by
//! least squares that are reweighted by Cauchy's weights (so that lane changes count little). s is the length of p up to the foot of the
//! perpendicular, d the distance to the left of it. A road that turns by more than about 45° is no graph over its axis, and is not fitted
//! well: the tracks must be cut first.

use std::collections::BTreeMap;

use super::Skip;
use super::solve::solve;
use crate::data::read::median;
use crate::data::recording::{Recording, VehicleTrack};

/// Degree of p.
const DEGREE: usize = 5;
/// Passes: lanes that are parallel along a bend are so along the axis only nearly, but along the line of the first pass.
const PASSES: usize = 2;
/// Rounds of reweighting.
const ROUNDS: usize = 12;
/// Residuals beyond this many medians count little.
const CAUCHY_MEDIANS: f64 = 3.0;
/// Smallest scale of residuals, m: the noise of good recordings.
const SMALLEST_SCALE_M: f64 = 0.05;
/// Displacement below which a vehicle has no direction, m.
const HARDLY_M: f64 = 10.0;
/// Share of the displacement that must lie along the axis.
const ALONG_SHARE: f64 = 0.7;
/// Distance between the points at which the length is tabulated, m.
const TABLE_STEP_M: f64 = 1.0;

/// A position along the road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RoadSample {
    pub(super) frame: i32,
    pub(super) s_m: f64,
    pub(super) d_m: f64,
}

/// A vehicle along the road.
pub(super) struct RoadTrack {
    pub(super) vehicle_id: u32,
    pub(super) length_m: f64,
    pub(super) width_m: f64,
    pub(super) samples: Vec<RoadSample>,
}

/// The vehicles of one direction of a recording, along the road.
pub(super) fn roads(recording: &Recording, skips: &mut BTreeMap<Skip, u64>) -> Vec<Vec<RoadTrack>> {
    let displacement = |vehicle: &VehicleTrack| {
        let (first, last) = (vehicle.samples[0], vehicle.samples[vehicle.samples.len() - 1]);
        [last.x_m - first.x_m, last.y_m - first.y_m]
    };
    let (mut xx_yy, mut xy) = (0.0, 0.0);
    for vehicle in &recording.vehicles {
        let [x, y] = displacement(vehicle);
        xx_yy += x * x - y * y;
        xy += x * y;
    }
    let (sin, cos) = libm::sincos(0.5 * libm::atan2(2.0 * xy, xx_yy));
    let mut directions: [Vec<&VehicleTrack>; 2] = [Vec::new(), Vec::new()];
    for vehicle in &recording.vehicles {
        let [x, y] = displacement(vehicle);
        let (length, along) = (libm::hypot(x, y), cos * x + sin * y);
        if length < HARDLY_M {
            *skips.entry(Skip::HardlyMoves).or_default() += 1;
        } else if along.abs() < ALONG_SHARE * length {
            *skips.entry(Skip::CrossesTheRoad).or_default() += 1;
        } else {
            directions[usize::from(along < 0.0)].push(vehicle);
        }
    }
    let axes = [[cos, sin], [-cos, -sin]];
    let used = directions.into_iter().zip(axes).filter(|(vehicles, _)| !vehicles.is_empty());
    used.map(|(vehicles, axis)| along_road(&vehicles, axis)).collect()
}

/// The vehicles along the line that they have in common; the axis points their way.
fn along_road(vehicles: &[&VehicleTrack], [cos, sin]: [f64; 2]) -> Vec<RoadTrack> {
    let mut points: Vec<Vec<[f64; 2]>> = vehicles
        .iter()
        .map(|vehicle| {
            let turn = |x: f64, y: f64| [cos * x + sin * y, cos * y - sin * x];
            vehicle.samples.iter().map(|sample| turn(sample.x_m, sample.y_m)).collect()
        })
        .collect();
    for _ in 0..PASSES {
        let line = Line::fit(&points);
        let table = line.lengths();
        points.iter_mut().flatten().for_each(|point| *point = line.road_position(&table, *point));
    }
    let track = |(vehicle, points): (&&VehicleTrack, Vec<[f64; 2]>)| {
        let samples = vehicle.samples.iter().zip(points);
        RoadTrack {
            vehicle_id: vehicle.vehicle_id,
            length_m: vehicle.length_m,
            width_m: vehicle.width_m,
            samples: samples.map(|(sample, [s_m, d_m])| RoadSample { frame: sample.frame, s_m, d_m }).collect(),
        }
    };
    vehicles.iter().zip(points).map(track).collect()
}

/// y = base + Σ a_k t^(k+1) with t = (u - middle) / half. The base, the middle one of all intercepts, puts the line among the vehicles, so that
/// perpendiculars to it are short.
struct Line {
    base_m: f64,
    a: [f64; DEGREE],
    middle_m: f64,
    half_m: f64,
}

impl Line {
    fn fit(tracks: &[Vec<[f64; 2]>]) -> Self {
        let all = || tracks.iter().flatten().map(|point| point[0]);
        let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), u| (l.min(u), h.max(u)));
        let mut line =
            Self { base_m: 0.0, a: [0.0; DEGREE], middle_m: f64::midpoint(low, high), half_m: 0.5 * (high - low) };
        let mut scale_m = f64::INFINITY;
        for _ in 0..ROUNDS {
            let mut residuals = Vec::new();
            let (mut normal, mut right) = ([[0.0; DEGREE]; DEGREE], [0.0; DEGREE]);
            for track in tracks {
                let intercept = line.intercept(track);
                let rest = |point: &[f64; 2]| point[1] - line.y(point[0]) - intercept;
                let weight = |point: &[f64; 2]| {
                    let relative = rest(point) / scale_m;
                    1.0 / (1.0 + relative * relative)
                };
                line.add_normal(track, weight, (&mut normal, &mut right));
                residuals.extend(track.iter().map(|point| rest(point).abs()));
            }
            line.a = solve(normal, right);
            line.base_m += median(tracks.iter().map(|track| line.intercept(track)).collect());
            scale_m = (CAUCHY_MEDIANS * median(residuals)).max(SMALLEST_SCALE_M);
        }
        line
    }

    /// Adds the normal equations of one track, from which its intercept is eliminated by taking off weighted means.
    fn add_normal(
        &self,
        track: &[[f64; 2]],
        weight: impl Fn(&[f64; 2]) -> f64,
        (normal, right): (&mut [[f64; DEGREE]; DEGREE], &mut [f64; DEGREE]),
    ) {
        let mut sums = [0.0; DEGREE + 1];
        let mut total = 0.0;
        let row = |point: &[f64; 2]| {
            let mut row = [0.0; DEGREE + 1];
            row[..DEGREE].copy_from_slice(&self.powers(point[0]));
            row[DEGREE] = point[1];
            row
        };
        for point in track {
            let w = weight(point);
            total += w;
            sums.iter_mut().zip(row(point)).for_each(|(sum, value)| *sum += w * value);
        }
        for point in track {
            let (w, mut row) = (weight(point), row(point));
            row.iter_mut().zip(sums).for_each(|(value, sum)| *value -= sum / total);
            for i in 0..DEGREE {
                right[i] += w * row[i] * row[DEGREE];
                for j in 0..DEGREE {
                    normal[i][j] += w * row[i] * row[j];
                }
            }
        }
    }

    /// The middle one of what the line leaves of a track.
    fn intercept(&self, track: &[[f64; 2]]) -> f64 {
        median(track.iter().map(|point| point[1] - self.y(point[0])).collect())
    }

    fn powers(&self, u_m: f64) -> [f64; DEGREE] {
        let t = (u_m - self.middle_m) / self.half_m;
        let mut power = 1.0;
        [(); DEGREE].map(|()| {
            power *= t;
            power
        })
    }

    fn y(&self, u_m: f64) -> f64 {
        self.base_m + self.a.iter().zip(self.powers(u_m)).map(|(a, power)| a * power).sum::<f64>()
    }

    fn slope(&self, u_m: f64) -> f64 {
        let t = (u_m - self.middle_m) / self.half_m;
        let derivative = self.a.iter().enumerate().rev().fold(0.0, |sum, (k, a)| sum * t + (k + 1) as f64 * a);
        derivative / self.half_m
    }

    /// Lengths from the begin at each step of the table, m.
    fn lengths(&self) -> Vec<f64> {
        let steps = (2.0 * self.half_m / TABLE_STEP_M).ceil() as usize + 1;
        let mut length_m = 0.0;
        let grow = |step: usize| {
            let slope = self.slope(self.middle_m - self.half_m + (step as f64 + 0.5) * TABLE_STEP_M);
            let here = length_m;
            length_m += TABLE_STEP_M * libm::hypot(1.0, slope);
            here
        };
        (0..=steps).map(grow).collect()
    }

    /// (s, d) of a point, m.
    fn road_position(&self, table: &[f64], [u_m, y_m]: [f64; 2]) -> [f64; 2] {
        // The foot of the perpendicular: u_f = u + (y - p) p'.
        let foot_m = (0..4).fold(u_m, |foot_m, _| u_m + (y_m - self.y(foot_m)) * self.slope(foot_m));
        let d_m = (y_m - self.y(foot_m)) * libm::hypot(1.0, self.slope(foot_m));
        let place = (foot_m - self.middle_m + self.half_m) / TABLE_STEP_M;
        let step = (place.max(0.0) as usize).min(table.len() - 2);
        [table[step] + (place - step as f64) * (table[step + 1] - table[step]), d_m]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::events::RoadKind;
    use crate::data::recording::{Format, Sample};

    /// Vehicles in three lanes of an arc of radius 1500 m that begins in the direction 2 rad.
    fn arc(lanes_m: &[f64]) -> Recording {
        let radius_m = 1500.0;
        let sample = |frame: i32, lane_m: f64| {
            let angle = 2.5 * f64::from(frame) / radius_m;
            let (sin, cos) = libm::sincos(angle);
            let (x, y) = ((radius_m - lane_m) * sin, radius_m - (radius_m - lane_m) * cos);
            let (turn_sin, turn_cos) = libm::sincos(2.0);
            Sample {
                frame,
                lane: 0,
                x_m: turn_cos * x - turn_sin * y,
                y_m: turn_sin * x + turn_cos * y,
                speed_mps: 25.0,
            }
        };
        let vehicle = |(id, lane_m): (usize, &f64)| VehicleTrack {
            vehicle_id: id as u32,
            length_m: 4.5,
            width_m: 1.8,
            samples: (0..200).map(|frame| sample(frame + 10 * id as i32, *lane_m)).collect(),
        };
        let vehicles = lanes_m.iter().enumerate().map(vehicle).collect();
        let (site, oddities) = ("arc".to_owned(), BTreeMap::new());
        Recording { site, format: Format::Traffic, road: RoadKind::Freeway, rate_hz: 10.0, vehicles, oddities }
    }

    #[test]
    fn on_an_arc_each_lane_stays_where_it_is() {
        let lanes_m = [0.0, 3.5, 7.0];
        let roads = roads(&arc(&lanes_m), &mut BTreeMap::new());
        assert_eq!(roads.len(), 1);
        let origin_m = roads[0][0].samples[100].d_m;
        for (track, lane_m) in roads[0].iter().zip(lanes_m) {
            for pair in track.samples.windows(2) {
                // The quintic meets an arc of 0.33 rad within centimeters.
                assert!((pair[0].d_m - origin_m - lane_m).abs() < 0.03, "{} for {lane_m}", pair[0].d_m - origin_m);
                // Lengths are taken on the common line, which lies somewhere among the lanes.
                assert!((pair[1].s_m - pair[0].s_m - 2.5).abs() < 0.02);
            }
        }
    }

    #[test]
    fn forth_and_back_are_two_roads_and_cross_traffic_is_counted() {
        let mut recording = arc(&[0.0, 3.5, -7.0]);
        recording.vehicles[2].samples.reverse();
        for (sample, frame) in recording.vehicles[2].samples.iter_mut().zip(0..) {
            sample.frame = frame;
        }
        let mut crossing = recording.vehicles[0].clone();
        for sample in &mut crossing.samples {
            (sample.x_m, sample.y_m) = (-sample.y_m, sample.x_m);
        }
        let mut standing = recording.vehicles[0].clone();
        standing.samples.truncate(2);
        recording.vehicles.extend([crossing, standing]);
        let mut skips = BTreeMap::new();
        let roads = roads(&recording, &mut skips);
        // The axis points to growing x, and two drive the other way.
        assert_eq!(roads.iter().map(Vec::len).collect::<Vec<_>>(), [1, 2]);
        assert_eq!((skips[&Skip::CrossesTheRoad], skips[&Skip::HardlyMoves]), (1, 1));
        // Both drive ahead, and the left is the left of each.
        assert!(roads.iter().flatten().all(|track| track.samples[9].s_m > track.samples[0].s_m));
    }
}
