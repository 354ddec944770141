//! Smoothing by local cubics (Savitzky and Golay 1964), and bringing any rate to 10 Hz.

use std::collections::BTreeMap;

use super::road::{RoadSample, RoadTrack};
use super::solve::solve;
use super::{Point, Skip, SmoothTrack};
use crate::data::traffic::FRAME_S;

/// Length of the window, s.
const WINDOW_S: f64 = 2.1;
/// What moves faster from frame to frame has not moved, but was taken for another, m/s.
const FASTEST_MPS: f64 = 90.0;
/// Coefficients of a cubic.
const TERMS: usize = 4;

/// The track smoothed, at 10 Hz, split at its gaps and jumps before; parts of one sample are left out.
pub(super) fn smooth(track: &RoadTrack, rate_hz: f64, skips: &mut BTreeMap<Skip, u64>) -> SmoothTrack {
    let jumps =
        |a: &RoadSample, b: &RoadSample| (b.s_m - a.s_m).abs().max((b.d_m - a.d_m).abs()) * rate_hz > FASTEST_MPS;
    let follows = |a: &RoadSample, b: &RoadSample| b.frame == a.frame + 1;
    let jumped =
        track.samples.windows(2).filter(|pair| follows(&pair[0], &pair[1]) && jumps(&pair[0], &pair[1])).count();
    if jumped > 0 {
        *skips.entry(Skip::Jumps).or_default() += jumped as u64;
    }
    let parts = track.samples.chunk_by(|a, b| follows(a, b) && !jumps(a, b)).filter(|part| part.len() > 1);
    let points = parts.flat_map(|part| resample(&smooth_part(part, rate_hz), part[0].frame, rate_hz)).collect();
    SmoothTrack { vehicle_id: track.vehicle_id, length_m: track.length_m, width_m: track.width_m, points }
}

/// Position, speed and acceleration along and across the road.
type Motion = [[f64; 3]; 2];

fn smooth_part(part: &[RoadSample], rate_hz: f64) -> Vec<Motion> {
    let half = ((WINDOW_S * rate_hz - 1.0) / 2.0).round().max(1.0) as usize;
    let half = half.min((part.len() - 1) / 2);
    let s = local_cubics(&part.iter().map(|sample| sample.s_m).collect::<Vec<_>>(), half, rate_hz);
    let d = local_cubics(&part.iter().map(|sample| sample.d_m).collect::<Vec<_>>(), half, rate_hz);
    s.into_iter().zip(d).map(|(s, d)| [s, d]).collect()
}

/// Value and two derivatives at each of `values` by the cubic through a window of 2 × `half` + 1 around it; at the ends the
/// outermost window serves. Three values or fewer carry a straight line.
fn local_cubics(values: &[f64], half: usize, rate_hz: f64) -> Vec<[f64; 3]> {
    // Two values are their own straight line; the window cannot be odd.
    let width = if half == 0 { values.len() } else { 2 * half + 1 };
    let terms = if width <= 3 { 2 } else { TERMS };
    let scale = 0.5 * (width - 1) as f64;
    let place = |offset: usize| (offset as f64 - scale) / scale;
    let mut normal = [[0.0; TERMS]; TERMS];
    for offset in 0..width {
        let powers = powers(place(offset));
        (0..terms).for_each(|i| (0..terms).for_each(|j| normal[i][j] += powers[i] * powers[j]));
    }
    // Unused terms stay zero.
    (terms..TERMS).for_each(|i| normal[i][i] = 1.0);
    let at = |index: usize| {
        let begin = index.saturating_sub(half).min(values.len() - width);
        // Relative to one value, so that large positions lose no digits.
        let base = values[index];
        let mut right = [0.0; TERMS];
        for offset in 0..width {
            let powers = powers(place(offset));
            (0..terms).for_each(|i| right[i] += powers[i] * (values[begin + offset] - base));
        }
        let [a, b, c, d] = solve(normal, right);
        let t = place(index - begin);
        let per_s = rate_hz / scale;
        let speed = (b + t * (2.0 * c + t * 3.0 * d)) * per_s;
        [base + a + t * (b + t * (c + t * d)), speed, (2.0 * c + 6.0 * d * t) * per_s * per_s]
    };
    (0..values.len()).map(at).collect()
}

fn powers(t: f64) -> [f64; TERMS] {
    [1.0, t, t * t, t * t * t]
}

/// The motion at the frames of 0.1 s within it: positions by Hermite's cubics, speeds and accelerations by straight lines.
fn resample(motion: &[Motion], first_frame: i32, rate_hz: f64) -> Vec<Point> {
    // A thousandth of a frame of slack lets 10 Hz map to itself.
    let per_frame = rate_hz * FRAME_S;
    let (begin, end) =
        (f64::from(first_frame) / per_frame, (f64::from(first_frame) + (motion.len() - 1) as f64) / per_frame);
    let frames = (begin - 1e-3).ceil() as i32..=(end + 1e-3).floor() as i32;
    let point = |frame: i32| {
        let place = (f64::from(frame) * per_frame - f64::from(first_frame)).max(0.0);
        let index = (place as usize).min(motion.len() - 2);
        let [s, d] =
            [0, 1].map(|way| between(motion[index][way], motion[index + 1][way], place - index as f64, 1.0 / rate_hz));
        Point { frame, s_m: s[0], d_m: d[0], vs_mps: s[1], vd_mps: d[1], as_mps2: s[2], ad_mps2: d[2], lane: 0 }
    };
    frames.map(point).collect()
}

fn between(a: [f64; 3], b: [f64; 3], t: f64, step_s: f64) -> [f64; 3] {
    let (t2, t3) = (t * t, t * t * t);
    let ends = a[0] + (b[0] - a[0]) * (3.0 * t2 - 2.0 * t3);
    let slopes = step_s * ((t3 - 2.0 * t2 + t) * a[1] + (t3 - t2) * b[1]);
    [ends + slopes, a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cubic(t_s: f64) -> [f64; 3] {
        [1000.0 + 20.0 * t_s - 0.5 * t_s * t_s + 0.1 * t_s * t_s * t_s, 20.0 - t_s + 0.3 * t_s * t_s, -1.0 + 0.6 * t_s]
    }

    fn track(rate_hz: f64, frames: std::ops::Range<i32>) -> RoadTrack {
        let sample = |frame: i32| {
            let s_m = cubic(f64::from(frame) / rate_hz)[0];
            RoadSample { frame, s_m, d_m: -s_m }
        };
        RoadTrack { vehicle_id: 1, length_m: 4.0, width_m: 2.0, samples: frames.map(sample).collect() }
    }

    #[test]
    fn a_cubic_is_its_own_smoothing_at_any_rate_and_at_its_ends() {
        for (rate_hz, frames) in [(10.0, 0..60), (10.0, 7..16), (25.0, 3..150), (5.0, 1..30)] {
            let points = smooth(&track(rate_hz, frames), rate_hz, &mut BTreeMap::new()).points;
            assert!(points.len() > 5);
            for point in points {
                let [s, v, a] = cubic(f64::from(point.frame) * FRAME_S);
                assert!((point.s_m - s).abs() < 1e-4 && (point.d_m + s).abs() < 1e-4, "{} {s}", point.s_m);
                // Between frames speeds are straight lines: at most a'' h² / 8 = 0.003 m/s off.
                assert!((point.vs_mps - v).abs() < 4e-3 && (point.as_mps2 - a).abs() < 4e-3, "{} {a}", point.as_mps2);
            }
        }
    }

    #[test]
    fn parts_between_gaps_know_nothing_of_each_other() {
        let mut gapped = track(10.0, 0..20);
        gapped.samples.retain(|sample| !(8..12).contains(&sample.frame));
        for sample in &mut gapped.samples[8..] {
            sample.s_m += 500.0;
        }
        let whole = |points: &[Point]| points.iter().all(|point| (15.0..21.0).contains(&point.vs_mps));
        let mut skips = BTreeMap::new();
        let points = smooth(&gapped, 10.0, &mut skips).points;
        assert!(points.len() == 16 && whole(&points) && skips.is_empty());
        // A jump is one, too, and is counted.
        let mut jumping = track(10.0, 0..20);
        for sample in &mut jumping.samples[8..] {
            sample.s_m += 500.0;
        }
        let points = smooth(&jumping, 10.0, &mut skips).points;
        assert!(points.len() == 20 && whole(&points) && skips[&Skip::Jumps] == 1);
    }

    #[test]
    fn white_noise_shrinks_as_the_theory_says() {
        // The weight of the middle of a window of 21 is 329/3059 (Savitzky and Golay 1964); that is also the factor of the variance.
        let mut values = vec![0.0; 101];
        values[50] = 1.0;
        assert!((local_cubics(&values, 10, 10.0)[50][0] - 329.0 / 3059.0).abs() < 1e-6);
    }
}
