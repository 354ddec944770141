//! Episodes of car following, cut out of recorded traffic.

use std::collections::BTreeMap;

use crate::data::traffic::{FRAME_S, TrafficPoint, TrafficSite, TrafficTrack};

/// Shortest gap of a usable episode, m: below, positions or lengths are wrong, or somebody is beside the leader.
const SHORTEST_GAP_M: f64 = 0.5;

/// One driver behind one leader, in steps of [`FRAME_S`].
#[derive(Clone, Debug, PartialEq)]
pub struct Episode {
    /// Index of the site.
    pub site: usize,
    /// Which vehicle follows, within the site.
    pub vehicle_id: u32,
    /// The leader at each step.
    pub leader: Vec<Motion>,
    /// The follower at each step.
    pub follower: Vec<Motion>,
    /// What lies between both centers besides the gap, m.
    pub half_lengths_m: f64,
}

/// State of a vehicle along the road.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Position of its center, m.
    pub s_m: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
}

impl Episode {
    /// Recorded gap at a step, m.
    pub fn gap_m(&self, step: usize) -> f64 {
        self.leader[step].s_m - self.follower[step].s_m - self.half_lengths_m
    }

    /// Duration, s.
    pub fn duration_s(&self) -> f64 {
        (self.follower.len() - 1) as f64 * FRAME_S
    }

    /// The driver: site and vehicle.
    pub fn driver(&self) -> (usize, u32) {
        (self.site, self.vehicle_id)
    }
}

/// A vehicle with its leader: since which frame and until which, by index of their tracks.
#[derive(Clone, Copy)]
struct Pair {
    leader: usize,
    first: i32,
    last: i32,
}

/// All episodes of at least `shortest_s` with the same leader throughout, by site, end and vehicle.
pub fn episodes(sites: &[TrafficSite], shortest_s: f64) -> Vec<Episode> {
    let mut found = Vec::new();
    for (index, site) in sites.iter().enumerate() {
        let pairs =
            pairs(site).into_iter().filter(|(_, pair)| f64::from(pair.last - pair.first) * FRAME_S >= shortest_s);
        found.extend(pairs.filter_map(|(follower, pair)| cut_out(index, site, follower, pair)));
    }
    found
}

/// Every follower with every leader it had without a break.
fn pairs(site: &TrafficSite) -> Vec<(usize, Pair)> {
    let mut closed = Vec::new();
    let mut open: BTreeMap<usize, Pair> = BTreeMap::new();
    for (frame, leaders) in leaders(site) {
        let ended =
            |follower: &usize, pair: &Pair| pair.last + 1 != frame || leaders.get(follower) != Some(&pair.leader);
        closed.extend(open.iter().filter(|(follower, pair)| ended(follower, pair)).map(|(f, pair)| (*f, *pair)));
        open.retain(|follower, pair| !ended(follower, pair));
        for (&follower, &leader) in &leaders {
            open.entry(follower).or_insert(Pair { leader, first: frame, last: frame }).last = frame;
        }
    }
    closed.extend(open);
    closed
}

/// For each frame the vehicle ahead of each, by index of their tracks.
fn leaders(site: &TrafficSite) -> BTreeMap<i32, BTreeMap<usize, usize>> {
    let mut frames: BTreeMap<i32, Vec<(u32, f64, usize)>> = BTreeMap::new();
    for (index, track) in site.tracks.iter().enumerate() {
        for point in &track.points {
            frames.entry(point.frame).or_default().push((point.lane, point.s_m, index));
        }
    }
    let by_follower = |mut vehicles: Vec<(u32, f64, usize)>| {
        vehicles.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
        let in_one_lane = vehicles.windows(2).filter(|pair| pair[0].0 == pair[1].0);
        in_one_lane.map(|pair| (pair[0].2, pair[1].2)).collect()
    };
    frames.into_iter().map(|(frame, vehicles)| (frame, by_follower(vehicles))).collect()
}

/// The episode of a pair, if its gaps are possible.
fn cut_out(site_index: usize, site: &TrafficSite, follower: usize, pair: Pair) -> Option<Episode> {
    let (follower, leader) = (&site.tracks[follower], &site.tracks[pair.leader]);
    let episode = Episode {
        site: site_index,
        vehicle_id: follower.vehicle_id,
        leader: motions(leader, pair),
        follower: motions(follower, pair),
        half_lengths_m: 0.5 * (leader.length_m + follower.length_m),
    };
    (0..episode.follower.len()).all(|step| episode.gap_m(step) >= SHORTEST_GAP_M).then_some(episode)
}

/// The part of a track in which the pair drove; it has no missing frame.
fn motions(track: &TrafficTrack, pair: Pair) -> Vec<Motion> {
    let within = |point: &&TrafficPoint| (pair.first..=pair.last).contains(&point.frame);
    let motion = |point: &TrafficPoint| Motion { s_m: point.s_m, speed_mps: point.speed_mps.max(0.0) };
    track.points.iter().filter(within).map(motion).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A vehicle of 4 m that drives at 10 m/s from `s_m`, with its lane at each frame (0: not seen).
    fn track(vehicle_id: u32, s_m: f64, lanes: &[u32]) -> TrafficTrack {
        let points = lanes.iter().enumerate().filter(|(_, lane)| **lane > 0).map(|(frame, &lane)| TrafficPoint {
            frame: frame as i32,
            lane,
            s_m: s_m + frame as f64,
            speed_mps: 10.0,
        });
        TrafficTrack { vehicle_id, length_m: 4.0, points: points.collect() }
    }

    fn spans(tracks: Vec<TrafficTrack>, shortest_s: f64) -> Vec<(u32, usize)> {
        let sites = [TrafficSite { name: "here".into(), tracks }];
        let found = episodes(&sites, shortest_s);
        assert!(found.iter().all(|episode| episode.leader.len() == episode.follower.len()));
        found.iter().map(|episode| (episode.vehicle_id, episode.follower.len())).collect()
    }

    #[test]
    fn an_episode_ends_with_a_change_of_leader_or_a_missing_frame() {
        let whole = track(1, 50.0, &[1; 20]);
        assert_eq!(spans(vec![whole.clone(), track(2, 20.0, &[1; 20])], 1.0), [(2, 20)]);
        // Another vehicle changes into the gap after 12 frames.
        let mut lanes = [2; 20];
        lanes[12..].fill(1);
        assert_eq!(spans(vec![whole.clone(), track(2, 20.0, &[1; 20]), track(3, 35.0, &lanes)], 1.0), [(2, 12)]);
        let mut seen = [1; 20];
        seen[12] = 0;
        assert_eq!(spans(vec![whole.clone(), track(2, 20.0, &seen)], 1.0), [(2, 12)]);
        assert_eq!(spans(vec![whole.clone(), track(2, 20.0, &[2; 20])], 1.0), []);
        assert_eq!(spans(vec![whole, track(2, 20.0, &[1; 20])], 2.0), []);
    }

    #[test]
    fn overlapping_vehicles_are_no_episode_and_the_gap_is_between_bumpers() {
        assert_eq!(spans(vec![track(1, 23.0, &[1; 20]), track(2, 20.0, &[1; 20])], 1.0), []);
        let tracks = vec![track(1, 50.0, &[1; 20]), track(2, 20.0, &[1; 20])];
        let found = episodes(&[TrafficSite { name: "here".into(), tracks }], 1.0);
        assert_eq!((found[0].gap_m(0), found[0].gap_m(19)), (26.0, 26.0));
        assert!((found[0].duration_s() - 1.9).abs() < 1e-12);
    }
}
