//! What the recurrent predictor is told of a vehicle at one instant: its own motion, and whom it follows.
//!
//! A vehicle follows the nearest one ahead of it that is in one of its lanes: those it is in and changes into, as in the roll-out. The
//! ego is one of those that can be followed. All values are scaled to be about 1 at most.

use crate::road::LaneIndex;
use crate::scene::{Neighbor, Scene, VehicleId};

/// Values for each instant.
pub const FEATURES: usize = 10;

/// What the predictor is told of one vehicle at one instant.
pub type Features = [f32; FEATURES];

/// A gap of this length has a closeness of one half, m: about that of a second at 10 m/s.
const CLOSE_GAP_M: f64 = 10.0;

/// A road has at most this many lanes.
const MAX_LANES: usize = 8;

/// Those of whom somebody can be the follower.
#[derive(Clone, Copy)]
struct Body {
    ahead_m: f64,
    speed_mps: f64,
    accel_mps2: f64,
    length_m: f64,
    lanes: [LaneIndex; 2],
    /// Its own leader: gap, speed.
    leader: Option<(f64, f64)>,
}

/// Writes what the predictor is told of each vehicle of `scene`, by its index, with its id; ends of lanes are followed but not told of.
pub(super) fn features(scene: &Scene, told: &mut Vec<(VehicleId, Features)>) {
    told.clear();
    let mut last: [Option<Body>; MAX_LANES] = [None; MAX_LANES];
    let mut ego_passed = false;
    for neighbor in scene.neighbors.iter().rev() {
        if neighbor.ahead_m < 0.0 && !ego_passed {
            enter(&mut last, ego(scene));
            ego_passed = true;
        }
        let body = Body {
            ahead_m: neighbor.ahead_m,
            speed_mps: neighbor.speed_mps,
            accel_mps2: neighbor.accel_mps2,
            length_m: neighbor.length_m,
            lanes: [neighbor.lane, neighbor.target_lane],
            leader: None,
        };
        let leader = enter(&mut last, body);
        if !neighbor.is_lane_end() {
            told.push((neighbor.id, values(scene, neighbor, leader)));
        }
    }
    told.reverse();
}

fn ego(scene: &Scene) -> Body {
    Body {
        ahead_m: 0.0,
        speed_mps: scene.ego.road_speed_mps(),
        accel_mps2: scene.ego.accel_mps2,
        length_m: scene.ego_length_m,
        lanes: [scene.ego_lane; 2],
        leader: None,
    }
}

/// Puts `body` behind those in its lanes and returns the nearest of them with the gap to it.
fn enter(last: &mut [Option<Body>; MAX_LANES], mut body: Body) -> Option<(f64, Body)> {
    let slots = body.lanes.map(|lane| usize::from(lane.0).min(MAX_LANES - 1));
    let leaders = slots.iter().filter_map(|&slot| last[slot]);
    let leader = leaders.min_by(|a, b| a.ahead_m.total_cmp(&b.ahead_m));
    let followed = leader.map(|leader| {
        let gap_m = leader.ahead_m - body.ahead_m - 0.5 * (leader.length_m + body.length_m);
        (gap_m.max(0.0), leader)
    });
    body.leader = followed.map(|(gap_m, leader)| (gap_m, leader.speed_mps));
    for slot in slots {
        last[slot] = Some(body);
    }
    followed
}

fn values(scene: &Scene, vehicle: &Neighbor, leader: Option<(f64, Body)>) -> Features {
    let closeness = |gap_m: f64| CLOSE_GAP_M / (CLOSE_GAP_M + gap_m);
    let slower = |speed_mps: f64| (speed_mps - vehicle.speed_mps) / 5.0;
    let first = leader
        .map_or([0.0; 3], |(gap_m, leader)| [closeness(gap_m), slower(leader.speed_mps), leader.accel_mps2 / 2.0]);
    let second = leader.and_then(|(_, leader)| leader.leader);
    let second = second.map_or([0.0; 2], |(gap_m, speed_mps)| [closeness(gap_m), slower(speed_mps)]);
    let signal = f64::from(vehicle.target_lane.0) - f64::from(vehicle.lane.0);
    let [closeness_1, slower_1, accel_1] = first;
    let [closeness_2, slower_2] = second;
    [
        (vehicle.speed_mps - 20.0) / 10.0,
        vehicle.accel_mps2 / 2.0,
        closeness_1,
        slower_1,
        accel_1,
        closeness_2,
        slower_2,
        vehicle.d_m - scene.road.lane_center_m(vehicle.lane),
        vehicle.lateral_speed_mps,
        signal,
    ]
    .map(|value| value as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predict::tests::{neighbor, scene};

    fn of(scene: &Scene) -> Vec<Features> {
        let mut told = Vec::new();
        features(scene, &mut told);
        told.into_iter().map(|(_, features)| features).collect()
    }

    #[test]
    fn the_leader_and_its_leader_are_those_in_the_vehicles_lanes() {
        // The ego, at 25 m/s and 4.8 m long, is in lane 1 at 0 m.
        let seen = of(&scene(vec![neighbor(-24.8, 20.0, 1), neighbor(14.8, 25.0, 1), neighbor(40.0, 10.0, 0)]));
        let [close, slower, _, close_2, slower_2] = seen[0][2..7] else { panic!("five values") };
        assert_eq!([close, slower], [10.0 / 30.0, 1.0]);
        assert_eq!([close_2, slower_2], [0.5, 1.0]);
        // The first of each lane follows nobody.
        assert_eq!(seen[1][2..7], [0.0; 5]);
        assert_eq!(seen[2][2..7], [0.0; 5]);
    }

    #[test]
    fn who_changes_lane_follows_the_nearer_leader_and_leads_in_both_lanes() {
        let changing = Neighbor { target_lane: LaneIndex(2), ..neighbor(14.8, 25.0, 1) };
        let seen = of(&scene(vec![neighbor(0.0, 25.0, 2), changing, neighbor(29.6, 20.0, 2), neighbor(50.0, 5.0, 1)]));
        assert_eq!((seen[0][2], seen[1][2], seen[1][3], seen[1][9]), (0.5, 0.5, -1.0, 1.0));
    }

    #[test]
    fn the_end_of_a_lane_is_followed_but_not_told_of() {
        let mut scene = scene(vec![neighbor(10.0, 20.0, 0)]);
        let end = Neighbor::lane_end(&scene.road, LaneIndex(0), 50.0);
        scene.neighbors.push(end);
        let seen = of(&scene);
        assert_eq!((seen.len(), seen[0][3]), (1, -4.0));
    }
}
