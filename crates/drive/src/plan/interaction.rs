//! What a path is to those in its way: time headway, time to collision, and the effect on the new follower.
//!
//! In the way of the ego are vehicles whose centers lie less than half a lane from its own across the road. Means over the samples,
//! of the nearest one ahead exp(−gap / (V · 1 s)) (Huang, Wu and Lv, 2022) and the inverse time to collision, at most 1 per second; of
//! the nearest one behind the acceleration that the ego takes from it by the Intelligent Driver Model (Treiber, Hennecke and Helbing,
//! 2000) with nominal parameters, as in the politeness of MOBIL (Kesting, Treiber and Helbing, 2007), at most 10 m/s².

use super::features::{FEATURES, Selection, Surroundings};
use super::motion::Course;
use crate::models::idm::{idm_accel, idm_free_accel};
use crate::predict::{ForecastPoint, NOMINAL};

/// Where these features stand in a vector.
const TIME_HEADWAY: usize = 6;
const TIME_TO_COLLISION: usize = 7;
const FOLLOWER: usize = 8;

/// How many they are, the last ones of a vector.
pub(super) const INTERACTIONS: usize = 3;

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

/// One vehicle at one instant.
struct Other {
    along_m: f64,
    d_m: f64,
    gap_m: f64,
    speed_mps: f64,
}

/// The others at one instant, for any path of one course.
pub(super) struct Interaction {
    half_lane_m: f64,
    ego_mps: f64,
    others: Vec<Other>,
}

impl Interaction {
    /// None if `selection` has none of these features.
    pub(super) fn new(selection: &Selection, lane_width_m: f64) -> Option<Self> {
        let wanted = selection[TIME_HEADWAY] || selection[TIME_TO_COLLISION] || selection[FOLLOWER];
        wanted.then(|| Self { half_lane_m: 0.5 * lane_width_m, ego_mps: 0.0, others: Vec::new() })
    }

    /// Looks at all others at `time_s`.
    pub(super) fn at<F: Fn(usize, f64) -> ForecastPoint>(
        &mut self,
        time_s: f64,
        course: &Course,
        surroundings: &Surroundings<F>,
    ) {
        self.others.clear();
        let (way_m, ego_mps, _) = course.at(time_s);
        self.ego_mps = ego_mps;
        for (vehicle, half_lengths_m) in surroundings.half_lengths_m.iter().enumerate() {
            let ForecastPoint { ahead_m, d_m, speed_mps } = (surroundings.at)(vehicle, time_s);
            let along_m = ahead_m - way_m;
            if along_m.abs() < RANGE_M {
                let gap_m = (along_m.abs() - half_lengths_m).max(MIN_GAP_M);
                self.others.push(Other { along_m, d_m, gap_m, speed_mps });
            }
        }
    }

    /// Adds what holds for a path that is at `d_m` now.
    pub(super) fn add(&self, d_m: f64, sums: &mut [f64; FEATURES]) {
        let in_way = || self.others.iter().filter(|other| (other.d_m - d_m).abs() < self.half_lane_m);
        let nearest = |a: &Other, b: &Other| a.gap_m.total_cmp(&b.gap_m);
        if let Some(leader) = in_way().filter(|other| other.along_m >= 0.0).min_by(|a, b| nearest(a, b)) {
            sums[TIME_HEADWAY] += libm::exp(-leader.gap_m / (self.ego_mps.max(MIN_GAP_M) * HEADWAY_SCALE_S));
            let closing_mps = (self.ego_mps - leader.speed_mps).max(0.0);
            sums[TIME_TO_COLLISION] += (closing_mps / leader.gap_m).min(MAX_CLOSING_PER_S);
        }
        if let Some(follower) = in_way().filter(|other| other.along_m < 0.0).min_by(|a, b| nearest(a, b)) {
            let speed_mps = follower.speed_mps.max(0.0);
            let left_mps2 = idm_accel(follower.gap_m, speed_mps, speed_mps - self.ego_mps, &NOMINAL);
            let taken_mps2 = idm_free_accel(speed_mps, &NOMINAL) - left_mps2;
            sums[FOLLOWER] += taken_mps2.clamp(0.0, MAX_IMPOSED_MPS2);
        }
    }
}
