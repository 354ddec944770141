//! Lanes from where vehicles drive: clusters of the lateral position.

use super::SmoothTrack;
use crate::data::read::median;

/// Width of a cell of the histogram, m.
const CELL_M: f64 = 0.1;
/// Width of the kernel that it is smoothed with, m.
const KERNEL_M: f64 = 0.4;
/// Narrowest lane, m.
const NARROWEST_M: f64 = 2.2;
/// Widest lane, m; centers further apart have an empty lane between them.
const WIDEST_M: f64 = 4.8;
/// Clusters lower than this share of the highest one are no lanes.
const LOWEST_SHARE: f64 = 0.02;
/// Lateral speed above which a vehicle is on its way between lanes, m/s.
const STEADY_MPS: f64 = 0.3;
/// Speed below which a vehicle stands, and would count for nothing but its patience, m/s.
const MOVING_MPS: f64 = 0.5;

/// Centers of the lanes from left to right, m.
pub(super) fn lane_centers_m(tracks: &[SmoothTrack]) -> Vec<f64> {
    let points = tracks.iter().flat_map(|track| &track.points);
    let steady = points.filter(|point| point.vd_mps.abs() < STEADY_MPS && point.vs_mps > MOVING_MPS);
    let positions_m: Vec<f64> = steady.map(|point| point.d_m).collect();
    let mut peaks = peaks_m(&positions_m);
    peaks.sort_by(|a, b| b.total_cmp(a));
    let center = |peak_m: f64| {
        median(positions_m.iter().copied().filter(|d_m| (d_m - peak_m).abs() < 0.5 * NARROWEST_M).collect())
    };
    with_empty_lanes(&peaks.into_iter().map(center).collect::<Vec<_>>())
}

/// Where the smoothed histogram peaks, the highest first; of peaks nearer than the narrowest lane only the higher.
fn peaks_m(positions_m: &[f64]) -> Vec<f64> {
    let (low, high) = positions_m.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), d| (l.min(*d), h.max(*d)));
    if low > high {
        return Vec::new();
    }
    let margin = (4.0 * KERNEL_M / CELL_M) as usize;
    let cells = ((high - low) / CELL_M) as usize + 1 + 2 * margin;
    let mut counts = vec![0.0; cells];
    for d_m in positions_m {
        counts[margin + ((d_m - low) / CELL_M) as usize] += 1.0;
    }
    let kernel = |distance: usize| {
        let relative = distance as f64 * CELL_M / KERNEL_M;
        libm::exp(-0.5 * relative * relative)
    };
    let kernel: Vec<f64> = (0..=margin).map(kernel).collect();
    let height = |cell: usize| {
        let reach = cell.saturating_sub(margin)..(cell + margin + 1).min(cells);
        reach.map(|other| counts[other] * kernel[cell.abs_diff(other)]).sum::<f64>()
    };
    let heights: Vec<f64> = (0..cells).map(height).collect();
    let mut peaks: Vec<usize> = (1..cells - 1)
        .filter(|&cell| heights[cell] > heights[cell - 1] && heights[cell] >= heights[cell + 1])
        .collect();
    peaks.sort_by(|&a, &b| heights[b].total_cmp(&heights[a]).then(a.cmp(&b)));
    let mut kept: Vec<usize> = Vec::new();
    for peak in peaks {
        let high_enough = kept.first().is_none_or(|&first| heights[peak] > LOWEST_SHARE * heights[first]);
        if high_enough && kept.iter().all(|other| other.abs_diff(peak) as f64 * CELL_M > NARROWEST_M) {
            kept.push(peak);
        }
    }
    kept.into_iter().map(|cell| low + (cell as f64 - margin as f64 + 0.5) * CELL_M).collect()
}

/// Puts lanes where two centers are so far apart that nobody drove between them.
fn with_empty_lanes(centers_m: &[f64]) -> Vec<f64> {
    let widths_m: Vec<f64> =
        centers_m.windows(2).map(|pair| pair[0] - pair[1]).filter(|width| *width < WIDEST_M).collect();
    let usual_m = if widths_m.is_empty() { 3.5 } else { median(widths_m) };
    let mut lanes: Vec<f64> = Vec::new();
    for &center in centers_m {
        if let Some(&last) = lanes.last() {
            let width_m = last - center;
            let count = if width_m > WIDEST_M { (width_m / usual_m).round().max(1.0) as usize } else { 1 };
            lanes.extend((1..count).map(|k| last - width_m * k as f64 / count as f64));
        }
        lanes.push(center);
    }
    lanes
}

/// The lane at `d_m`, 1 is the leftmost; lines lie in the middle between centers.
pub(super) fn lane_at(centers_m: &[f64], d_m: f64) -> u32 {
    let lines = centers_m.windows(2).filter(|pair| d_m < f64::midpoint(pair[0], pair[1]));
    1 + lines.count() as u32
}

#[cfg(test)]
mod tests {
    use super::super::Point;
    use super::*;

    #[test]
    fn clusters_become_lanes_and_an_empty_one_is_put_between() {
        let wobble = |k: u32| 0.3 * libm::sin(f64::from(k));
        let point = |d_m: f64, frame: i32| Point { frame, d_m, vs_mps: 20.0, ..Point::default() };
        let track = |center_m: f64| SmoothTrack {
            vehicle_id: 1,
            length_m: 4.0,
            width_m: 2.0,
            points: (0..200).map(|k| point(center_m + wobble(k), k as i32)).collect(),
        };
        let centers = lane_centers_m(&[track(0.0), track(3.5), track(10.5), track(3.6)]);
        assert_eq!(centers.len(), 4, "{centers:?}");
        for (center, expected) in centers.iter().zip([10.5, 7.0, 3.55, 0.0]) {
            assert!((center - expected).abs() < 0.1, "{centers:?}");
        }
        assert_eq!([12.0, 8.0, 5.2, 1.0, -9.0].map(|d_m| lane_at(&centers, d_m)), [1, 2, 3, 4, 4]);
        assert!(lane_centers_m(&[]).is_empty());
    }
}
