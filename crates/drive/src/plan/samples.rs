//! What motions that start together share when they are sampled.
//!
//! All of them are looked at at the same times t_l = l h. The vehicles around are then where they are for every motion, and the way
//! along the road is one for all motions of a course. Across the road only the coefficients differ, and of a polynomial
//! p(t) = Σ aᵢ tⁱ the weighted sum of squares
//!
//! Σ_l w_l p(t_l)² = Σ_i Σ_j aᵢ aⱼ M_{i+j},  M_k = Σ_l w_l t_lᵏ,
//!
//! needs no samples once the moments M are known. So does the mean of (ḋ/V)² with w = 1/V², whether the speed V is held or not.
//!
//! What is left by sample is done for a block of them at once with the vectors of the processor. The blocks are of one size on all
//! processors, and so is the order of the sums.

use super::features::{FeatureConfig, Surroundings};
use super::motion::{Course, Motion};
use crate::predict::ForecastPoint;

/// Samples that are looked at together: as many as the widest vectors hold.
const WIDTH: usize = 8;

/// Moments up to those of the square of a quintic's derivative, whose degree is 4.
const MOMENTS: usize = 9;

/// Factors of the collision sum with an exponent below this count as 0, so that H_col is too small by at most e⁻⁹ ≈ 1.2e-4 for each
/// vehicle, against sums of about 0.5.
const NEGLIGIBLE_EXPONENT: f64 = -9.0;

/// What all motions share.
pub(super) struct Samples {
    /// Of whole blocks.
    times_s: Vec<f64>,
    /// With the weight 1.
    moments: Moments,
    tracks: Vec<Track>,
}

/// A vehicle by sample.
pub(super) struct Track {
    /// Half the sum of its length and the ego's, m.
    pub(super) half_lengths_m: f64,
    /// How far it is ahead of where the ego begins, m.
    pub(super) ahead_m: Vec<f64>,
    pub(super) d_m: Vec<f64>,
    pub(super) speed_mps: Vec<f64>,
}

impl Samples {
    /// As many as the longest one of `motions` has.
    pub(super) fn new<F: Fn(usize, f64) -> ForecastPoint>(
        config: &FeatureConfig,
        motions: &[Motion],
        others: &Surroundings<F>,
    ) -> Self {
        let time_s = |sample: usize| sample as f64 * config.sample_step_s;
        let times_s: Vec<f64> = (1..=whole_blocks(most_samples(config, motions))).map(time_s).collect();
        let vehicles = others.half_lengths_m.iter().enumerate();
        let tracks = vehicles.map(|(vehicle, &half_lengths_m)| {
            Track::new(half_lengths_m, &times_s, |time_s| (others.at)(vehicle, time_s))
        });
        let tracks = tracks.collect();
        let moments = Moments::new(&times_s, |_| 1.0);
        Self { times_s, moments, tracks }
    }
}

impl Track {
    /// Of a vehicle that is `at` a point at each time.
    fn new(half_lengths_m: f64, times_s: &[f64], at: impl Fn(f64) -> ForecastPoint) -> Self {
        let point = |&time_s: &f64| {
            let ForecastPoint { ahead_m, d_m, speed_mps } = at(time_s);
            (ahead_m, d_m, speed_mps)
        };
        let (ahead_m, d_m, speed_mps) = times_s.iter().map(point).collect();
        Self { half_lengths_m, ahead_m, d_m, speed_mps }
    }
}

/// Largest number of samples of one of `motions`.
fn most_samples(config: &FeatureConfig, motions: &[Motion]) -> usize {
    motions.iter().map(|motion| config.samples(motion.lateral.duration_s)).max().unwrap_or(0)
}

/// So many samples and those that fill up the last block.
fn whole_blocks(samples: usize) -> usize {
    samples.next_multiple_of(WIDTH)
}

/// The ego along the road by sample.
pub(super) struct Along {
    /// Way from the begin, m.
    pub(super) way_m: Vec<f64>,
    pub(super) speed_mps: Vec<f64>,
    /// Sum of the squared jerk up to here, m²/s⁶.
    jerk: Vec<f64>,
}

impl Along {
    fn new(course: Course, times_s: &[f64]) -> Self {
        let mut jerk_sum = 0.0;
        let at = |&time_s: &f64| {
            let (way_m, speed_mps, jerk_mps3) = course.at(time_s);
            jerk_sum += jerk_mps3 * jerk_mps3;
            (way_m, speed_mps, jerk_sum)
        };
        let (way_m, speed_mps, jerk) = times_s.iter().map(at).collect();
        Self { way_m, speed_mps, jerk }
    }
}

/// What the motions of one course share.
pub(super) struct SampledCourse<'a> {
    samples: &'a Samples,
    along: Along,
    /// With the weights 1/V².
    moments: Moments,
    rows: Vec<Row<'a>>,
    /// σ₁/scale², 1/m².
    lateral: f64,
}

// Must be inlined into what `pulp` compiles for the processor's instruction set.
#[allow(clippy::inline_always)]
impl<'a> SampledCourse<'a> {
    /// Of `motions`, which all have the course of the first one.
    #[inline(always)]
    pub(super) fn new(config: &FeatureConfig, samples: &'a Samples, motions: &[Motion]) -> Self {
        let times_s = &samples.times_s[..whole_blocks(most_samples(config, motions))];
        let along = Along::new(motions[0].course(), times_s);
        Self {
            samples,
            moments: Moments::new(times_s, |sample| 1.0 / (along.speed_mps[sample] * along.speed_mps[sample])),
            rows: rows(config, &samples.tracks, &along.way_m),
            lateral: config.sigma_lateral / (config.lateral_scale_m * config.lateral_scale_m),
            along,
        }
    }

    /// The others.
    pub(super) fn tracks(&self) -> &'a [Track] {
        &self.samples.tracks
    }

    /// The ego by sample.
    pub(super) fn along(&self) -> &Along {
        &self.along
    }

    /// Lateral positions of `motion` at `count` samples into `d_m`, after its end where it ends. The last block is filled up with
    /// positions that are far from everybody.
    #[inline(always)]
    pub(super) fn place(&self, motion: &Motion, count: usize, d_m: &mut Vec<f64>) {
        d_m.resize(whole_blocks(count), 0.0);
        let Motion { lateral, .. } = motion;
        for (d_m, &time_s) in d_m.iter_mut().zip(&self.samples.times_s) {
            *d_m = lateral.position_within_m(if time_s < lateral.duration_s { time_s } else { lateral.duration_s });
        }
        d_m[count..].fill(f64::INFINITY);
    }

    /// Sums of the squares of heading (rad²), yaw rate (rad²/s²) and jerk (m²/s⁶) over `count` samples, of which the first `moving`
    /// lie within the duration of `motion`.
    #[inline(always)]
    pub(super) fn squares(&self, motion: &Motion, (count, moving): (usize, usize)) -> [f64; 3] {
        let [_, c1, c2, c3, c4, c5] = motion.lateral.coefficients;
        let speed = [c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 5.0 * c5];
        let accel = [2.0 * c2, 6.0 * c3, 12.0 * c4, 20.0 * c5];
        let jerk = [6.0 * c3, 24.0 * c4, 60.0 * c5];
        [
            self.moments.sum_of_squares(moving, speed),
            self.moments.sum_of_squares(moving, accel),
            self.samples.moments.sum_of_squares(moving, jerk) + self.along.jerk[count - 1],
        ]
    }

    /// Sum of the potentials of all others on the path `d_m`, which consists of whole blocks; `potentials` is room to work in.
    #[inline(always)]
    pub(super) fn collision(&self, d_m: &[f64], potentials: &mut Vec<f64>) -> f64 {
        potentials.clear();
        potentials.resize(d_m.len(), 0.0);
        for row in &self.rows {
            let along = &row.along[..d_m.len()];
            add_exponentials(potentials, self.lateral, (d_m, row.d_m), |sample| along[sample]);
        }
        let mut sums = [0.0; WIDTH];
        for block in potentials.as_chunks::<WIDTH>().0 {
            sums.iter_mut().zip(block).for_each(|(sum, potential)| *sum += potential);
        }
        sums.iter().sum()
    }
}

/// Vehicles that are at the same place across the road at all samples, as those that keep their lane.
struct Row<'a> {
    d_m: &'a [f64],
    /// Σ exp(σ₂ (ΔX/scale)²) of them by sample.
    along: Vec<f64>,
}

/// Of those of `tracks` that come near to the ego on its way `way_m`.
// Must be inlined into what `pulp` compiles for the processor's instruction set.
#[allow(clippy::inline_always)]
#[inline(always)]
fn rows<'a>(config: &FeatureConfig, tracks: &'a [Track], way_m: &[f64]) -> Vec<Row<'a>> {
    let longitudinal = config.sigma_longitudinal / (config.longitudinal_scale_m * config.longitudinal_scale_m);
    let mut rows: Vec<Row> = Vec::with_capacity(tracks.len());
    for Track { ahead_m, d_m, .. } in tracks {
        let (ahead_m, d_m) = (&ahead_m[..way_m.len()], &d_m[..way_m.len()]);
        let mut exponents = ahead_m.iter().zip(way_m).map(|(a, b)| longitudinal * (a - b) * (a - b));
        if exponents.all(|exponent| exponent < NEGLIGIBLE_EXPONENT) {
            continue;
        }
        let number = rows.iter().position(|row| row.d_m == d_m).unwrap_or(rows.len());
        if number == rows.len() {
            rows.push(Row { d_m, along: vec![0.0; way_m.len()] });
        }
        add_exponentials(&mut rows[number].along, longitudinal, (ahead_m, way_m), |_| 1.0);
    }
    rows
}

/// Adds `factor` · exp(`sigma` (a − b)²) to `sums` by sample.
// Must be inlined into what `pulp` compiles for the processor's instruction set.
#[allow(clippy::inline_always)]
#[inline(always)]
fn add_exponentials(sums: &mut [f64], sigma: f64, (a, b): (&[f64], &[f64]), factor: impl Fn(usize) -> f64) {
    let count = sums.len();
    let (a, b) = (&a[..count], &b[..count]);
    for sample in 0..count {
        let distance = a[sample] - b[sample];
        sums[sample] += factor(sample) * exp_unless_negligible(sigma * distance * distance);
    }
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

/// exp(`exponent`) of an exponent from [`NEGLIGIBLE_EXPONENT`] to 0 with an error below 1e-11, and 0 below that.
///
/// exp(x) = exp(x/128)¹²⁸ with the Taylor polynomial of fifth degree: the remainder (x/128)⁶/6! becomes 128 eˣ times as large, which
/// is most at x = −6. There is no branch and no table, so that compilers evaluate it for several samples at once.
// Must be inlined into what `pulp` compiles for the processor's instruction set.
#[allow(clippy::inline_always)]
#[inline(always)]
fn exp_unless_negligible(exponent: f64) -> f64 {
    let x = exponent / 128.0;
    let mut power = 1.0 + x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0)))));
    for _ in 0..7 {
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
            let error = exp_unless_negligible(exponent) - libm::exp(exponent);
            assert!(error.abs() < 1e-11, "{exponent}: {error}");
        }
        // Beyond the bound the polynomial is far off, and must not show.
        for exponent in [-9.001, -50.0, -1e4, -1e300, f64::NEG_INFINITY] {
            assert_eq!(exp_unless_negligible(exponent), 0.0);
        }
    }
}
