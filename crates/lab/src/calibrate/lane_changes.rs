//! Lane changes of a recording: how often, and into which gaps.

use std::collections::BTreeMap;

use lanecraft_drive::road::RoadConfig;
use lanecraft_drive::scenario::{ScenarioDistribution, ScenarioError, TrafficConfig};
use lanecraft_drive::traffic::World;

use crate::data::traffic::{TrafficPoint, TrafficSite, TrafficTrack};
use crate::metrics::Interval;

/// A vehicle must be seen so many frames in a lane before and after a change, else it touched a line only.
const SETTLED_FRAMES: usize = 10;
/// Step of the model's traffic, s.
const STEP_S: f64 = 0.1;
/// Time that the model's traffic drives before and while its lane changes are counted, s.
const COUNTED_S: f64 = 300.0;

/// How often lanes were changed, and into which gaps.
#[derive(Clone, Debug, PartialEq)]
pub struct LaneChanges {
    /// How many.
    pub changes: usize,
    /// Distance of all vehicles, km.
    pub vehicle_km: f64,
    /// Gaps to the leader in the new lane when the lane line was crossed, m, rising.
    pub front_gaps_m: Vec<f64>,
    /// Gaps to the follower in the new lane, m, rising.
    pub rear_gaps_m: Vec<f64>,
    /// Vehicles per kilometer and lane: the inverse of the mean distance from one vehicle to the next.
    pub density_veh_per_km_lane: f64,
    /// Mean speed, m/s.
    pub speed_mps: f64,
}

impl LaneChanges {
    /// Changes per vehicle-kilometer with the 95 % interval of a Poisson count, by its square root's constant variance.
    pub fn per_vehicle_km(&self) -> Interval {
        let root = (self.changes as f64).sqrt();
        let end = |root: f64| root * root / self.vehicle_km;
        Interval { mean: end(root), low: end((root - 0.98).max(0.0)), high: end(root + 0.98) }
    }
}

/// Counts the lane changes of all sites.
pub(super) fn recorded(sites: &[TrafficSite]) -> LaneChanges {
    let mut found = LaneChanges {
        changes: 0,
        vehicle_km: 0.0,
        front_gaps_m: Vec::new(),
        rear_gaps_m: Vec::new(),
        density_veh_per_km_lane: 0.0,
        speed_mps: 0.0,
    };
    let (mut speeds_mps, mut points, mut spacings_m, mut spaces) = (0.0, 0.0, 0.0, 0.0);
    for site in sites {
        for positions_m in lanes(site) {
            spacings_m += positions_m.last().map_or(0.0, |last| last - positions_m[0]);
            spaces += positions_m.len() as f64 - 1.0;
        }
        for track in &site.tracks {
            let steps = track.points.windows(2).filter(|pair| unbroken(pair));
            found.vehicle_km += steps.map(|pair| pair[1].s_m - pair[0].s_m).sum::<f64>() / 1000.0;
            speeds_mps += track.points.iter().map(|point| point.speed_mps).sum::<f64>();
            points += track.points.len() as f64;
            for change in changes(track) {
                found.changes += 1;
                let (front_m, rear_m) = gaps_m(site, track, change);
                found.front_gaps_m.extend(front_m);
                found.rear_gaps_m.extend(rear_m);
            }
        }
    }
    found.front_gaps_m.sort_by(f64::total_cmp);
    found.rear_gaps_m.sort_by(f64::total_cmp);
    found.density_veh_per_km_lane = 1000.0 * spaces / spacings_m;
    found.speed_mps = speeds_mps / points;
    found
}

/// The first points in a new lane.
fn changes(track: &TrafficTrack) -> impl Iterator<Item = &TrafficPoint> {
    let settled = |part: &[TrafficPoint]| part.iter().all(|point| point.lane == part[0].lane);
    let windows = track.points.windows(2 * SETTLED_FRAMES);
    windows.filter_map(move |window| {
        let (before, after) = window.split_at(SETTLED_FRAMES);
        let changed = settled(before) && settled(after) && before[0].lane != after[0].lane;
        (changed && unbroken(window)).then_some(&after[0])
    })
}

/// Whether no frame is missing: who leaves the view may come back elsewhere.
fn unbroken(points: &[TrafficPoint]) -> bool {
    points.windows(2).all(|pair| pair[0].frame + 1 == pair[1].frame)
}

/// Front and rear bumper-to-bumper gap of a vehicle in the lane it enters, if somebody is seen there, m.
fn gaps_m(site: &TrafficSite, track: &TrafficTrack, at: &TrafficPoint) -> (Option<f64>, Option<f64>) {
    let (mut front_m, mut rear_m): (Option<f64>, Option<f64>) = (None, None);
    for other in site.tracks.iter().filter(|other| other.vehicle_id != track.vehicle_id) {
        let Ok(index) = other.points.binary_search_by_key(&at.frame, |point| point.frame) else { continue };
        let point = &other.points[index];
        if point.lane == at.lane {
            let gap_m = (point.s_m - at.s_m).abs() - 0.5 * (other.length_m + track.length_m);
            let side = if point.s_m > at.s_m { &mut front_m } else { &mut rear_m };
            *side = Some(side.map_or(gap_m, |nearest| nearest.min(gap_m)));
        }
    }
    (front_m, rear_m)
}

/// The positions in each lane with at least one vehicle at each frame, rising, m.
fn lanes(site: &TrafficSite) -> impl Iterator<Item = Vec<f64>> {
    let mut lanes: BTreeMap<(i32, u32), Vec<f64>> = BTreeMap::new();
    for point in site.tracks.iter().flat_map(|track| &track.points) {
        lanes.entry((point.frame, point.lane)).or_default().push(point.s_m);
    }
    lanes.into_values().map(|mut positions_m| {
        positions_m.sort_by(f64::total_cmp);
        positions_m
    })
}

/// What the model's traffic does on a ring of five lanes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelTraffic {
    /// Lane changes per vehicle-kilometer.
    pub changes_per_vehicle_km: f64,
    /// Mean speed, m/s.
    pub speed_mps: f64,
}

/// Drives the model's traffic and counts its lane changes in the second half of the time.
///
/// # Errors
/// If the traffic is impossible.
pub(super) fn simulated(traffic: &TrafficConfig) -> Result<ModelTraffic, ScenarioError> {
    let road = RoadConfig { lanes: 5, ..RoadConfig::default() };
    let mut world = World::new(&ScenarioDistribution { road, traffic: traffic.clone() }.sample(0)?)?;
    let (mut changes, mut meters, steps) = (0, 0.0, (COUNTED_S / STEP_S) as u32);
    for step in 0..2 * steps {
        let events = world.step_alone(STEP_S);
        if step >= steps {
            changes += events.lane_changes;
            meters += world.vehicles().map(|vehicle| vehicle.speed_mps * STEP_S).sum::<f64>();
        }
    }
    let speed_mps = meters / (world.len() as f64 * f64::from(steps) * STEP_S);
    Ok(ModelTraffic { changes_per_vehicle_km: 1000.0 * f64::from(changes) / meters, speed_mps })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(vehicle_id: u32, s_m: f64, lanes: &[u32]) -> TrafficTrack {
        let points = lanes.iter().enumerate().map(|(frame, &lane)| TrafficPoint {
            frame: frame as i32,
            lane,
            s_m: s_m + 2.0 * frame as f64,
            speed_mps: 20.0,
        });
        TrafficTrack { vehicle_id, length_m: 4.0, points: points.collect() }
    }

    #[test]
    fn a_change_counts_once_and_a_touch_not_at_all() {
        let mut change = [1; 60];
        change[30..].fill(2);
        let mut touch = [2; 60];
        touch[30..35].fill(1);
        let tracks = vec![track(1, 100.0, &change), track(2, 130.0, &touch), track(3, 80.0, &[2; 60])];
        let found = recorded(&[TrafficSite { name: "here".into(), tracks }]);
        assert_eq!((found.changes, found.front_gaps_m, found.rear_gaps_m), (1, vec![], vec![16.0]));
        assert!((found.vehicle_km - 3.0 * 0.118).abs() < 1e-12 && found.speed_mps == 20.0);
        // Whoever is out of sight between two lanes has not been seen to change.
        let mut broken = track(1, 100.0, &change);
        broken.points[30..].iter_mut().for_each(|point| point.frame += 50);
        let found = recorded(&[TrafficSite { name: "here".into(), tracks: vec![broken] }]);
        assert_eq!(found.changes, 0);
        assert!((found.vehicle_km - 0.116).abs() < 1e-12);
    }
}
