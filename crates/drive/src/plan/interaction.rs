//! What a path is to those in its way: time headway, time to collision, and the effect on the new follower.
//!
//! In the way of the ego are vehicles whose centers lie less than half a lane from its own across the road. Means over the samples,
//! of the nearest one ahead exp(−gap / (V · 1 s)) (Huang, Wu and Lv, 2022) and the inverse time to collision, at most 1 per second; of
//! the nearest one behind the acceleration that the ego takes from it by the Intelligent Driver Model (Treiber, Hennecke and Helbing,
//! 2000) with nominal parameters, as in the politeness of MOBIL (Kesting, Treiber and Helbing, 2007), at most 10 m/s².

use super::features::Selection;
use super::samples::{Along, SampledCourse, Track};
use crate::models::idm::{idm_accel, idm_free_accel};
use crate::predict::NOMINAL;

/// Where these features stand in a vector.
const TIME_HEADWAY: usize = 6;
const TIME_TO_COLLISION: usize = 7;
const FOLLOWER: usize = 8;

/// How many they are.
const INTERACTIONS: usize = 3;

/// Time headway at which the risk falls to 1/e, s.
const HEADWAY_SCALE_S: f64 = 1.0;
/// Largest inverse time to collision, 1/s.
const MAX_CLOSING_PER_S: f64 = 1.0;
/// Largest acceleration taken from a follower, m/s²: more is an emergency.
const MAX_IMPOSED_MPS2: f64 = 10.0;
/// Gaps below this, and overlaps, count as this, m.
const MIN_GAP_M: f64 = 0.1;
/// Vehicles farther away change none of the features noticeably, m.
const RANGE_M: f64 = 150.0;

/// A vehicle in the way of the ego at one instant.
struct Other {
    along_m: f64,
    gap_m: f64,
    speed_mps: f64,
}

/// Whether `selection` has one of these features.
pub(super) fn interacts(selection: &Selection) -> bool {
    selection[TIME_HEADWAY] || selection[TIME_TO_COLLISION] || selection[FOLLOWER]
}

/// Sums of these features over the samples of the path `d_m`.
pub(super) fn interaction(course: &SampledCourse, d_m: &[f64], lane_width_m: f64) -> [f64; INTERACTIONS] {
    let [mut headway, mut closing, mut imposed] = [0.0; INTERACTIONS];
    let Along { way_m, speed_mps, .. } = course.along();
    for (sample, (d_m, (way_m, &ego_mps))) in d_m.iter().zip(way_m.iter().zip(speed_mps)).enumerate() {
        let in_way = |track: &Track| {
            let along_m = track.ahead_m[sample] - way_m;
            let counts = along_m.abs() < RANGE_M && (track.d_m[sample] - d_m).abs() < 0.5 * lane_width_m;
            let gap_m = (along_m.abs() - track.half_lengths_m).max(MIN_GAP_M);
            counts.then_some(Other { along_m, gap_m, speed_mps: track.speed_mps[sample] })
        };
        let nearest = |ahead: bool| {
            let others = course.tracks().iter().filter_map(in_way).filter(|other| (other.along_m >= 0.0) == ahead);
            others.min_by(|a, b| a.gap_m.total_cmp(&b.gap_m))
        };
        if let Some(leader) = nearest(true) {
            headway += libm::exp(-leader.gap_m / (ego_mps.max(MIN_GAP_M) * HEADWAY_SCALE_S));
            closing += ((ego_mps - leader.speed_mps).max(0.0) / leader.gap_m).min(MAX_CLOSING_PER_S);
        }
        if let Some(follower) = nearest(false) {
            let speed_mps = follower.speed_mps.max(0.0);
            let left_mps2 = idm_accel(follower.gap_m, speed_mps, speed_mps - ego_mps, &NOMINAL);
            imposed += (idm_free_accel(speed_mps, &NOMINAL) - left_mps2).clamp(0.0, MAX_IMPOSED_MPS2);
        }
    }
    [headway, closing, imposed]
}
