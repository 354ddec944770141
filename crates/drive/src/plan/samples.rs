//! What motions that start together share when they are sampled.
//!
//! All of them are looked at at the same times t_l = l h. The vehicles around are then where they are for every motion, and the way
//! along the road is one for all motions of a course. Across the road only the coefficients differ, and of a polynomial
//! p(t) = Σ aᵢ tⁱ the weighted sum of squares
//!
//! Σ_l w_l p(t_l)² = Σ_i Σ_j aᵢ aⱼ M_{i+j},  M_k = Σ_l w_l t_lᵏ,
//!
//! needs no samples once the moments M are known. So does the mean of (ḋ/V)² with w = 1/V², whether the speed V is held or not.

use super::features::{FeatureConfig, Surroundings};
use super::motion::Motion;
use crate::predict::ForecastPoint;

/// Moments up to those of the square of a quintic's derivative, whose degree is 4.
const MOMENTS: usize = 9;

/// Factors of the collision sum with an exponent below this count as 0, so that H_col is too small by at most e⁻⁹ ≈ 1.2e-4 for each
/// vehicle, against sums of about 0.5.
const NEGLIGIBLE_EXPONENT: f64 = -9.0;

/// What all motions share.
pub(super) struct Samples {
    times_s: Vec<f64>,
    /// With the weight 1.
    moments: Moments,
    tracks: Vec<Track>,
}

/// A vehicle at the sample times.
pub(super) struct Track {
    /// Half the sum of its length and the ego's, m.
    pub(super) half_lengths_m: f64,
    pub(super) points: Vec<ForecastPoint>,
}

impl Samples {
    /// As many as the longest one of `motions` has.
    pub(super) fn new<F: Fn(usize, f64) -> ForecastPoint>(
        config: &FeatureConfig,
        motions: &[Motion],
        others: &Surroundings<F>,
    ) -> Self {
        let time_s = |sample: usize| sample as f64 * config.sample_step_s;
        let times_s: Vec<f64> = (1..=most_samples(config, motions)).map(time_s).collect();
        let track = |(vehicle, &half_lengths_m)| Track {
            half_lengths_m,
            points: times_s.iter().map(|&time_s| (others.at)(vehicle, time_s)).collect(),
        };
        let tracks = others.half_lengths_m.iter().enumerate().map(track).collect();
        let moments = Moments::new(&times_s, |_| 1.0);
        Self { times_s, moments, tracks }
    }
}

/// Largest number of samples of one of `motions`.
fn most_samples(config: &FeatureConfig, motions: &[Motion]) -> usize {
    motions.iter().map(|motion| config.samples(motion.lateral.duration_s)).max().unwrap_or(0)
}

/// The ego along the road at one sample.
pub(super) struct Along {
    /// Way from the begin, m.
    pub(super) way_m: f64,
    pub(super) speed_mps: f64,
    /// Sum of the squared jerk up to here, m²/s⁶.
    jerk: f64,
}

/// What the motions of one course share.
pub(super) struct SampledCourse<'a> {
    samples: &'a Samples,
    along: Vec<Along>,
    /// With the weights 1/V².
    moments: Moments,
    rows: Vec<Row>,
    /// σ₁/scale², 1/m².
    lateral: f64,
}

impl<'a> SampledCourse<'a> {
    /// Of `motions`, which all have the course of the first one.
    pub(super) fn new(config: &FeatureConfig, samples: &'a Samples, motions: &[Motion]) -> Self {
        let course = motions[0].course();
        let times_s = &samples.times_s[..most_samples(config, motions)];
        let mut jerk_sum = 0.0;
        let at = |&time_s: &f64| {
            let (way_m, speed_mps, jerk) = course.at(time_s);
            jerk_sum += jerk * jerk;
            Along { way_m, speed_mps, jerk: jerk_sum }
        };
        let along: Vec<Along> = times_s.iter().map(at).collect();
        Self {
            samples,
            moments: Moments::new(times_s, |sample| 1.0 / (along[sample].speed_mps * along[sample].speed_mps)),
            rows: rows(config, &samples.tracks, &along),
            lateral: config.sigma_lateral / (config.lateral_scale_m * config.lateral_scale_m),
            along,
        }
    }

    /// The others.
    pub(super) fn tracks(&self) -> &'a [Track] {
        &self.samples.tracks
    }

    /// The ego by sample.
    pub(super) fn along(&self) -> &[Along] {
        &self.along
    }

    /// Lateral positions of `motion` at `count` samples, of which the first `moving` lie within its duration, into `d_m`.
    pub(super) fn place(&self, motion: &Motion, (count, moving): (usize, usize), d_m: &mut Vec<f64>) {
        d_m.clear();
        d_m.extend(self.samples.times_s[..moving].iter().map(|&time_s| motion.lateral.position_within_m(time_s)));
        d_m.resize(count, motion.lateral.position_within_m(motion.lateral.duration_s));
    }

    /// Sums of the squares of heading (rad²), yaw rate (rad²/s²) and jerk (m²/s⁶) over the same samples.
    pub(super) fn squares(&self, motion: &Motion, (count, moving): (usize, usize)) -> [f64; 3] {
        let [_, c1, c2, c3, c4, c5] = motion.lateral.coefficients;
        let speed = [c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 5.0 * c5];
        let accel = [2.0 * c2, 6.0 * c3, 12.0 * c4, 20.0 * c5];
        let jerk = [6.0 * c3, 24.0 * c4, 60.0 * c5];
        [
            self.moments.sum_of_squares(moving, speed),
            self.moments.sum_of_squares(moving, accel),
            self.samples.moments.sum_of_squares(moving, jerk) + self.along[count - 1].jerk,
        ]
    }

    /// Sum of the potentials of all others on the path `d_m`; `potentials` is room to work in.
    pub(super) fn collision(&self, d_m: &[f64], potentials: &mut Vec<f64>) -> f64 {
        potentials.clear();
        potentials.resize(d_m.len(), 0.0);
        for row in &self.rows {
            for ((sum, d_m), (row_d_m, along)) in potentials.iter_mut().zip(d_m).zip(row.d_m.iter().zip(&row.along)) {
                let across_m = d_m - row_d_m;
                *sum += along * exp_unless_negligible(self.lateral * across_m * across_m);
            }
        }
        potentials.iter().sum()
    }
}

/// Vehicles that are at the same place across the road at all samples, as those that keep their lane.
struct Row {
    d_m: Vec<f64>,
    /// Σ exp(σ₂ (ΔX/scale)²) of them by sample.
    along: Vec<f64>,
}

/// Of those of `tracks` that come near to the ego on its way `along`.
fn rows(config: &FeatureConfig, tracks: &[Track], along: &[Along]) -> Vec<Row> {
    let longitudinal = config.sigma_longitudinal / (config.longitudinal_scale_m * config.longitudinal_scale_m);
    let mut rows: Vec<Row> = Vec::with_capacity(tracks.len());
    for Track { points, .. } in tracks {
        let factor = |(point, at): (&ForecastPoint, &Along)| {
            let along_m = point.ahead_m - at.way_m;
            exp_unless_negligible(longitudinal * along_m * along_m)
        };
        let factors: Vec<f64> = points.iter().zip(along).map(factor).collect();
        let d_m = || points[..along.len()].iter().map(|point| point.d_m);
        if let Some(row) = rows.iter_mut().find(|row| row.d_m.iter().copied().eq(d_m())) {
            row.along.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += factor);
        } else if factors.iter().any(|&factor| factor > 0.0) {
            rows.push(Row { d_m: d_m().collect(), along: factors });
        }
    }
    rows
}

/// Σ_l w_l t_lᵏ over the first samples, k = 0, 1, …, by their number.
struct Moments(Vec<[f64; MOMENTS]>);

impl Moments {
    /// Of times (s) with the weights `weight`.
    fn new(times_s: &[f64], weight: impl Fn(usize) -> f64) -> Self {
        let mut sums = [0.0; MOMENTS];
        let mut all = Vec::with_capacity(times_s.len() + 1);
        all.push(sums);
        for (sample, time_s) in times_s.iter().enumerate() {
            let mut power = weight(sample);
            for sum in &mut sums {
                *sum += power;
                power *= time_s;
            }
            all.push(sums);
        }
        Self(all)
    }

    /// Σ w_l p(t_l)² over the first `count` samples of p(t) = Σ aᵢ tⁱ.
    ///
    /// The polynomials of a change from rest to rest cancel to 1/1500 of their terms, which leaves 12 digits.
    fn sum_of_squares<const N: usize>(&self, count: usize, a: [f64; N]) -> f64 {
        let moments = &self.0[count];
        (0..N).map(|i| a[i] * (0..N).map(|j| a[j] * moments[i + j]).sum::<f64>()).sum()
    }
}

/// exp(`exponent`) of an exponent from [`NEGLIGIBLE_EXPONENT`] to 0 with a relative error below 1e-11, and 0 below that.
///
/// exp(x) = exp(x/256)²⁵⁶ with the Taylor polynomial of sixth degree, whose remainder (9/256)⁷/7! becomes 256 times as large. There
/// is no branch and no table, so that compilers evaluate it for several samples at once.
fn exp_unless_negligible(exponent: f64) -> f64 {
    let x = exponent / 256.0;
    let terms = [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    let mut power = terms.into_iter().fold(1.0 / 720.0, |sum, term| sum * x + term);
    for _ in 0..8 {
        power *= power;
    }
    if exponent >= NEGLIGIBLE_EXPONENT { power } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_that_of_libm_down_to_what_is_negligible() {
        for k in 0..=9000 {
            let exponent = -0.001 * f64::from(k);
            let ratio = exp_unless_negligible(exponent) / libm::exp(exponent);
            assert!((ratio - 1.0).abs() < 1e-11, "{exponent}: {ratio}");
        }
        // Beyond the bound the polynomial is far off, and must not show.
        for exponent in [-9.001, -50.0, -1e4, -1e300, f64::NEG_INFINITY] {
            assert_eq!(exp_unless_negligible(exponent), 0.0);
        }
    }
}
