//! Lane changes of smoothed tracks.
//!
//! A lane change is where the smoothed lateral position crosses a line. It begins and ends where, outward from the crossing, the lateral
//! speed towards the new lane stays at 0.10 m/s or below for more than 0.8 s.

use std::collections::BTreeMap;

use lanecraft_drive::road::Side;

use super::{LaneChange, Point, Quality, Site, Skip, SmoothTrack};

/// Lateral speed above which the maneuver goes on, m/s.
const MOVING_MPS: f64 = 0.10;
/// Longest pause within a maneuver, frames.
const PAUSE: usize = 8;
/// Frames around a crossing without another one, and of track for the best quality.
const AROUND: i32 = 30;
/// Allowed lateral shifts, m.
const SHIFTS_M: (f64, f64) = (2.0, 5.0);
/// Farthest from the center of the lane that a maneuver may be cut off, m.
const CUT_OFF_M: f64 = 0.9;
/// Lowest mean speed, m/s.
const SLOWEST_MPS: f64 = 5.0;
/// Allowed durations, s.
const DURATIONS_S: (f64, f64) = (1.5, 12.0);
/// Shortest vehicle that is no motorcycle, m.
const SHORTEST_M: f64 = 2.5;

/// The lane changes of `site`, by vehicle and time; those dropped are counted.
pub(super) fn changes(site: &Site, index: usize, skips: &mut BTreeMap<Skip, u64>) -> Vec<LaneChange> {
    let mut found = Vec::new();
    for track in &site.tracks {
        for part in track.points.chunk_by(|a, b| b.frame == a.frame + 1) {
            let crossings: Vec<usize> = (1..part.len()).filter(|&i| part[i].lane != part[i - 1].lane).collect();
            for &crossing in &crossings {
                let others = crossings.iter().filter(|other| **other != crossing);
                let alone = others.into_iter().all(|other| other.abs_diff(crossing) as i32 > AROUND);
                match change(site, (track, part), crossing, alone) {
                    Ok(change) => found.push(LaneChange { site: index, ..change }),
                    Err(skip) => *skips.entry(skip).or_default() += 1,
                }
            }
        }
    }
    found
}

/// The lane change of `track` whose `part` without gaps crosses a line at the index `crossing`, or why there is none.
fn change(
    site: &Site,
    (track, part): (&SmoothTrack, &[Point]),
    crossing: usize,
    alone: bool,
) -> Result<LaneChange, Skip> {
    let (lane_from, lane_to) = (part[crossing - 1].lane, part[crossing].lane);
    let (side, sign) = if lane_to < lane_from { (Side::Left, 1.0) } else { (Side::Right, -1.0) };
    let refuse = |bad: bool, skip: Skip| if bad { Err(skip) } else { Ok(()) };
    refuse(lane_to.abs_diff(lane_from) > 1, Skip::JumpsLanes)?;
    refuse(track.length_m < SHORTEST_M, Skip::ShortVehicle)?;
    refuse(!alone, Skip::SecondCrossing)?;
    let moves = |i: usize| sign * part[i].vd_mps > MOVING_MPS;
    let start = last_moving((0..crossing).rev(), crossing, moves);
    let end = last_moving(crossing + 1..part.len(), crossing, moves);
    let change = LaneChange {
        site: 0,
        ego_id: track.vehicle_id,
        side,
        quality: quality(part.len(), [start, crossing, end]),
        lane_from,
        lane_to,
        crossing: part[crossing].frame,
        start: part[start].frame,
        end: part[end].frame,
        points: part.to_vec(),
    };
    refuse(change.shift_m() < SHIFTS_M.0, Skip::Wobble)?;
    refuse(change.shift_m() > SHIFTS_M.1, Skip::DoubleChange)?;
    let off_center_m = |at: usize, lane: u32| (part[at].d_m - site.lane_centers_m[lane as usize - 1]).abs();
    refuse(start == 0 && off_center_m(start, lane_from) > CUT_OFF_M, Skip::CutOff)?;
    refuse(end + 1 == part.len() && off_center_m(end, lane_to) > CUT_OFF_M, Skip::CutOff)?;
    refuse(change.mean_speed_mps() < SLOWEST_MPS, Skip::Slow)?;
    let duration_s = change.duration_s();
    refuse(!(DURATIONS_S.0..=DURATIONS_S.1).contains(&duration_s), Skip::OddDuration)?;
    Ok(change)
}

/// How much is seen of a lane change with these indices within a track of `len` points.
fn quality(len: usize, [start, crossing, end]: [usize; 3]) -> Quality {
    let last = len - 1;
    if start == 0 || end == last {
        Quality::C
    } else if crossing.min(last - crossing) < AROUND as usize {
        Quality::B
    } else {
        Quality::A
    }
}

/// The last of `outward` that moves before a pause that is too long.
fn last_moving(outward: impl Iterator<Item = usize>, crossing: usize, moves: impl Fn(usize) -> bool) -> usize {
    let mut last = crossing;
    for i in outward {
        if moves(i) {
            last = i;
        } else if i.abs_diff(last) > PAUSE {
            break;
        }
    }
    last
}
