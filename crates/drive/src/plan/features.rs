//! What drivers weigh when they change lanes (Eqs. 18–20): stability, collision risk, comfort and travel efficiency of a path, and
//! five more that may be selected: jerk, peak lateral acceleration, time headway, time to collision, effect on the new follower.
//!
//! All are costs, so that a reward learned from people has negative weights. Departures from the paper: the collision feature
//! is taken on normalized distances (in meters it vanishes until the bodies overlap), and the number of samples η is that of
//! [0, t_c] (the text says of the interval of allowed durations, which would not make H_tra a measure of duration).

use serde::{Deserialize, Serialize};

use super::interaction::{INTERACTIONS, Interaction};
use super::motion::Motion;
use crate::config::{ConfigError, check_range};
use crate::predict::ForecastPoint;

/// Number of features.
pub const FEATURES: usize = 9;

/// Names of the features, in the order of every feature vector; the first four are the paper's.
pub const FEATURE_NAMES: [&str; FEATURES] = [
    "stability",
    "collision",
    "comfort",
    "travel",
    "jerk",
    "lateral-acceleration",
    "time-headway",
    "time-to-collision",
    "follower",
];

/// How many of them are the paper's.
pub const PAPER_FEATURES: usize = 4;

/// Terms of the collision sum with an exponent below this are left out, so that H_col is too small by at most e⁻⁹ ≈ 1.2e-4 for each
/// vehicle, against sums of about 0.5.
const NEGLIGIBLE_EXPONENT: f64 = -9.0;

/// Sampling step that makes H_tra = t_c²/η the printed values of Table IV (0.05 t_c), s.
const TRAVEL_STEP_S: f64 = 0.05;

/// Units of the features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FeatureUnits {
    /// rad², dimensionless, (rad/s)², s² for the paper's; m²/s⁶, m/s², dimensionless, 1/s, m/s² for the others.
    Si,
    /// As far as Table IV can be decoded: (m/s per km/h)², hundredths, (deg/s)², s²; the others as in SI.
    Table,
}

/// How the features are computed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FeatureConfig {
    /// Time between two samples of a path, s: 0.1 in the text (Table IV was made with 0.05).
    pub sample_step_s: f64,
    /// σ₁ on the squared lateral distance in units of `lateral_scale_m`: −3 (the paper has meters).
    pub sigma_lateral: f64,
    /// Unit of lateral distance, m: a lane's width.
    pub lateral_scale_m: f64,
    /// σ₂ on the squared longitudinal distance in units of `longitudinal_scale_m`: −0.5 (the paper has meters).
    pub sigma_longitudinal: f64,
    /// Unit of longitudinal distance, m.
    pub longitudinal_scale_m: f64,
    /// Units of the result.
    pub units: FeatureUnits,
}

impl Default for FeatureConfig {
    fn default() -> Self {
        Self {
            sample_step_s: 0.1,
            sigma_lateral: -3.0,
            lateral_scale_m: 3.75,
            sigma_longitudinal: -0.5,
            longitudinal_scale_m: 10.0,
            units: FeatureUnits::Si,
        }
    }
}

impl FeatureConfig {
    /// Checks every range, of the planner's own.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.validate_as([
            "planner.features.sample_step_s",
            "planner.features.sigma_lateral",
            "planner.features.lateral_scale_m",
            "planner.features.sigma_longitudinal",
            "planner.features.longitudinal_scale_m",
        ])
    }

    /// The same under other keys, in the order of the fields.
    pub fn validate_as(&self, keys: [&'static str; 5]) -> Result<(), ConfigError> {
        check_range(keys[0], self.sample_step_s, 0.01, 0.5)?;
        check_range(keys[1], self.sigma_lateral, -100.0, 0.0)?;
        check_range(keys[2], self.lateral_scale_m, 0.1, 10.0)?;
        check_range(keys[3], self.sigma_longitudinal, -100.0, 0.0)?;
        check_range(keys[4], self.longitudinal_scale_m, 0.1, 100.0)
    }

    /// Number of samples η of a path of this duration.
    pub fn samples(&self, duration_s: f64) -> u32 {
        (duration_s / self.sample_step_s).round().max(1.0) as u32
    }

    /// Factors from SI to `units`.
    fn unit_factors(&self) -> [f64; FEATURES] {
        let degrees = 180.0 / core::f64::consts::PI;
        match self.units {
            FeatureUnits::Si => [1.0; FEATURES],
            FeatureUnits::Table => [1.0 / (3.6 * 3.6), 100.0, degrees * degrees, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
        }
    }
}

/// Which features are computed.
pub type Selection = [bool; FEATURES];

/// The selection of the paper's four features.
pub const PAPER_SELECTION: Selection = [true, true, true, true, false, false, false, false, false];

/// The vehicles around a path.
pub struct Surroundings<'a, F: Fn(usize, f64) -> ForecastPoint> {
    /// For each vehicle half the sum of its length and the ego's, m.
    pub half_lengths_m: &'a [f64],
    /// Where vehicle `m` of them is at time t, `ahead_m` counted from the ego's *first* position.
    pub at: F,
}

/// H of one motion on the paper's features and those that `selection` adds; see [`features_of_set`].
pub fn features<F: Fn(usize, f64) -> ForecastPoint>(
    config: &FeatureConfig,
    selection: &Selection,
    motion: &Motion,
    others: &Surroundings<F>,
) -> [f64; FEATURES] {
    let mut result = [[0.0; FEATURES]];
    features_of_set(config, selection, std::slice::from_ref(motion), others, &mut result);
    result[0]
}

/// The features of several motions that start together.
///
/// With β = Ẏ/V and φ̇ = Ÿ/V (Eq. 16), means over the samples l = 1 … η: H_sta of β², H_com of φ̇², H_col of
/// Σ_m exp(σ₁ (ΔY/scale)² + σ₂ (ΔX/scale)²); H_tra = 0.05 s · t_c. Of the others, the mean squared jerk, the largest |Ÿ| on the
/// continuous path, and what the module `interaction` defines. Of those that need the others beside the collision risk, one
/// that is not selected is 0.
///
/// `out` has one vector for each motion. Motions of the same speed that follow each other share their work.
pub fn features_of_set<F: Fn(usize, f64) -> ForecastPoint>(
    config: &FeatureConfig,
    selection: &Selection,
    motions: &[Motion],
    others: &Surroundings<F>,
    out: &mut [[f64; FEATURES]],
) {
    debug_assert_eq!(motions.len(), out.len());
    let factors = config.unit_factors();
    let mut rest = out;
    for same_course in motions.chunk_by(|a, b| a.course() == b.course()) {
        let (sums, later) = rest.split_at_mut(same_course.len());
        let mut course = SampledCourse::new(config, same_course, others);
        for (motion, sums) in same_course.iter().zip(sums.iter_mut()) {
            *sums = course.features(motion, config.samples(motion.lateral.duration_s));
        }
        if let Some(mut interaction) = Interaction::new(selection, config.lateral_scale_m) {
            add_interaction(config, &mut interaction, same_course, others, sums);
        }
        for (sum, factor) in sums.iter_mut().flat_map(|sums| sums.iter_mut().zip(factors)) {
            *sum *= factor;
        }
        rest = later;
    }
}

/// Means of what `interaction` sees; all `motions` have the course of the first one.
fn add_interaction<F: Fn(usize, f64) -> ForecastPoint>(
    config: &FeatureConfig,
    interaction: &mut Interaction,
    motions: &[Motion],
    others: &Surroundings<F>,
    out: &mut [[f64; FEATURES]],
) {
    let course = motions[0].course();
    for sample in 1..=most_samples(config, motions) {
        let time_s = f64::from(sample) * config.sample_step_s;
        interaction.at(time_s, &course, others);
        for (motion, sums) in motions.iter().zip(out.iter_mut()) {
            if sample <= config.samples(motion.lateral.duration_s) {
                interaction.add(motion.lateral.at(time_s).0, sums);
            }
        }
    }
    for (motion, sums) in motions.iter().zip(out) {
        for sum in &mut sums[FEATURES - INTERACTIONS..] {
            *sum /= f64::from(config.samples(motion.lateral.duration_s));
        }
    }
}

/// Largest number of samples of one of `motions`.
fn most_samples(config: &FeatureConfig, motions: &[Motion]) -> u32 {
    motions.iter().map(|motion| config.samples(motion.lateral.duration_s)).max().unwrap_or(0)
}

/// What all motions of one course share, by sample: the way along the road, and the others' distances along it.
struct SampledCourse {
    /// Time (s), 1/V (s/m) and squared jerk along the road (m²/s⁶).
    instants: Vec<(f64, f64, f64)>,
    near: Vec<Near>,
    /// σ₁/scale², 1/m².
    lateral: f64,
    /// Room to work in, by sample: lateral position of the motion looked at (m), and exponents of its risk.
    d_m: Vec<f64>,
    exponents: Vec<f64>,
}

impl SampledCourse {
    /// Of `motions`, which all have the course of the first one.
    fn new<F: Fn(usize, f64) -> ForecastPoint>(
        config: &FeatureConfig,
        motions: &[Motion],
        others: &Surroundings<F>,
    ) -> Self {
        let course = motions[0].course();
        let instants: Vec<_> = (1..=most_samples(config, motions))
            .map(|sample| {
                let time_s = f64::from(sample) * config.sample_step_s;
                let (_, speed_mps, jerk) = course.at(time_s);
                (time_s, 1.0 / speed_mps, jerk * jerk)
            })
            .collect();
        let longitudinal = config.sigma_longitudinal / (config.longitudinal_scale_m * config.longitudinal_scale_m);
        let track = |vehicle: usize| {
            let point = |&(time_s, ..): &(f64, f64, f64)| {
                let ForecastPoint { ahead_m, d_m, .. } = (others.at)(vehicle, time_s);
                let along_m = ahead_m - course.at(time_s).0;
                (longitudinal * along_m * along_m, d_m)
            };
            Near::new(instants.iter().map(point).collect())
        };
        let near = (0..others.half_lengths_m.len()).filter_map(track).collect();
        let lateral = config.sigma_lateral / (config.lateral_scale_m * config.lateral_scale_m);
        let [d_m, exponents] = [(); 2].map(|()| Vec::with_capacity(instants.len()));
        Self { instants, near, lateral, d_m, exponents }
    }

    /// The features of `motion` without those of its interaction.
    fn features(&mut self, motion: &Motion, samples: u32) -> [f64; FEATURES] {
        let (mut heading, mut yaw_rate, mut jerk) = (0.0, 0.0, 0.0);
        self.d_m.resize(samples as usize, 0.0);
        for (&(time_s, per_speed, along_jerk2), at_m) in self.instants.iter().zip(&mut self.d_m) {
            let (d_m, speed, accel, lateral_jerk) = motion.lateral.at(time_s);
            heading += (speed * per_speed) * (speed * per_speed);
            yaw_rate += (accel * per_speed) * (accel * per_speed);
            jerk += lateral_jerk * lateral_jerk + along_jerk2;
            *at_m = d_m;
        }
        let count = f64::from(samples);
        let travel = TRAVEL_STEP_S * motion.lateral.duration_s;
        let peak_mps2 = motion.lateral.max_accel_mps2();
        [heading / count, self.collision() / count, yaw_rate / count, travel, jerk / count, peak_mps2, 0.0, 0.0, 0.0]
    }

    /// Sum of the potentials of all others on the path `d_m`.
    fn collision(&mut self) -> f64 {
        self.near.iter().map(|near| near.risk(self.lateral, &self.d_m, &mut self.exponents)).sum()
    }
}

/// A vehicle whose longitudinal distance lets it count in the collision sum.
struct Near {
    /// Before this sample it is too far away.
    first: usize,
    /// From then on to the last sample at which it is near: longitudinal exponent and lateral position, m.
    track: Vec<(f64, f64)>,
}

impl Near {
    /// None of a vehicle that is always too far away.
    fn new(mut track: Vec<(f64, f64)>) -> Option<Self> {
        let (first, last) = ends_of_what_counts(&track, |point| point.0)?;
        track.truncate(last + 1);
        track.drain(..first);
        Some(Self { first, track })
    }

    /// Σ exp(longitudinal exponent + `lateral` · ΔY²) over the samples of the path `d_m`; `exponents` is room to work in.
    fn risk(&self, lateral: f64, d_m: &[f64], exponents: &mut Vec<f64>) -> f64 {
        exponents.clear();
        exponents.extend(d_m.iter().skip(self.first).zip(&self.track).map(|(d_m, (along, other_d_m))| {
            let across_m = d_m - other_d_m;
            along + lateral * across_m * across_m
        }));
        let Some((first, last)) = ends_of_what_counts(exponents, |exponent| *exponent) else { return 0.0 };
        let terms = &mut exponents[first..=last];
        for term in &mut *terms {
            *term = exp_unless_negligible(*term);
        }
        terms.iter().sum()
    }
}

/// Where the first and the last of `items` stand whose exponent is not negligible.
fn ends_of_what_counts<T>(items: &[T], exponent: impl Fn(&T) -> f64) -> Option<(usize, usize)> {
    let counts = |item: &T| exponent(item) >= NEGLIGIBLE_EXPONENT;
    Some((items.iter().position(counts)?, items.iter().rposition(counts)?))
}

/// exp(`exponent`) of an exponent from [`NEGLIGIBLE_EXPONENT`] to 0 with a relative error below 1e-11, and 0 below that.
///
/// exp(x) = exp(x/256)²⁵⁶ with the Taylor polynomial of sixth degree, whose remainder (9/256)⁷/7! becomes 256 times as large. There
/// is no branch and no table, so that compilers evaluate it for several samples at once.
fn exp_unless_negligible(exponent: f64) -> f64 {
    let x = exponent / 256.0;
    let terms = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    let mut power = terms.into_iter().fold(0.0, |sum, term| sum * x + term);
    for _ in 0..8 {
        power *= power;
    }
    if exponent >= NEGLIGIBLE_EXPONENT { power } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::quintic::{LateralState, Quintic};
    use crate::predict::NOMINAL;

    const ALL: Selection = [true; FEATURES];

    fn motion(speed_mps: f64, duration_s: f64) -> Motion {
        let lateral = Quintic::new(LateralState::default(), 3.75, duration_s);
        Motion { lateral, speed_mps, speed_change_mps: 0.0 }
    }

    /// Others of the ego's length, 4.8 m, each at a constant speed in the new lane, by distance now and speed.
    fn among(config: &FeatureConfig, motion: &Motion, cars: &[(f64, f64)]) -> [f64; FEATURES] {
        let at = |m: usize, t: f64| {
            let (ahead_m, speed_mps) = cars[m];
            ForecastPoint { ahead_m: ahead_m + speed_mps * t, d_m: 3.75, speed_mps }
        };
        features(config, &ALL, motion, &Surroundings { half_lengths_m: &vec![4.8; cars.len()], at })
    }

    #[test]
    fn features_of_a_path_on_an_empty_road_are_the_integrals() {
        let config = FeatureConfig { sample_step_s: 0.01, ..FeatureConfig::default() };
        let h = among(&config, &motion(25.0, 2.5), &[]);
        // Means of the squared derivatives of Eq. 14: ∫s'² = 10/7, ∫s''² = 120/7 on the unit interval. Both integrands and their
        // first derivatives vanish or repeat at the ends, so that the rectangle rule converges fast: 1e-6 at 250 samples.
        let (f, t, v) = (3.75, 2.5, 25.0);
        let expected =
            [(f / (t * v)) * (f / (t * v)) * 10.0 / 7.0, 0.0, (f / (t * t * v)) * (f / (t * t * v)) * 120.0 / 7.0];
        for i in 0..3 {
            assert!((h[i] - expected[i]).abs() <= 1e-6 * expected[i].max(1e-3), "{i}: {} {}", h[i], expected[i]);
        }
        assert_eq!(h[3], 0.125);
        // The third derivative squared: 720, not 0 at the ends, where the rectangles miss 1/250 of it. The peak is a closed form.
        assert!((h[4] / ((f / (t * t * t)) * (f / (t * t * t)) * 720.0) - 1.0).abs() < 0.01);
        assert!((h[5] - 10.0 / 3.0_f64.sqrt() * f / (t * t)).abs() < 1e-12);
        assert_eq!(h[6..], [0.0; 3]);
    }

    #[test]
    fn collision_risk_is_the_mean_of_the_potentials() {
        // Two samples; a car 5 m ahead in the new lane at the same speed, one too far away to count.
        let config = FeatureConfig { sample_step_s: 1.0, ..FeatureConfig::default() };
        let h = among(&config, &motion(20.0, 2.0), &[(5.0, 20.0), (80.0, 20.0)]);
        // Half way the car is half a lane aside: exponents −3/4 − 1/8, then −1/8.
        let expected = 0.5 * (libm::exp(-0.875) + libm::exp(-0.125));
        assert!((h[1] - expected).abs() < 1e-12);
    }

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

    #[test]
    fn what_the_collision_sum_leaves_out_is_negligible() {
        let config = FeatureConfig::default();
        let path = motion(25.0, 4.0);
        // Passed on both sides, and one that comes near and falls back: the ends of what counts lie within the path.
        let cars = [(60.0, 5.0), (-50.0, 50.0), (44.0, 20.0), (-45.0, 28.0), (300.0, 25.0)];
        let exact_at = |time_s: f64| -> f64 {
            let across = (path.lateral.at(time_s).0 - 3.75) / 3.75;
            let along = |(ahead_m, speed_mps): (f64, f64)| (ahead_m + (speed_mps - 25.0) * time_s) / 10.0;
            cars.iter().map(|&car| libm::exp(-3.0 * across * across - 0.5 * along(car) * along(car))).sum()
        };
        let exact = (1..=40).map(|sample| exact_at(0.1 * f64::from(sample))).sum::<f64>() / 40.0;
        // At most e⁻⁹ for each vehicle that counts at some instants only.
        let left_out = exact - among(&config, &path, &cars)[1];
        assert!(left_out > 0.0 && left_out < 4.0 * libm::exp(-9.0), "{left_out} of {exact}");
    }

    #[test]
    fn table_units_are_those_decoded_from_table_iv() {
        let table_config = FeatureConfig { units: FeatureUnits::Table, ..FeatureConfig::default() };
        let [si, table] =
            [FeatureConfig::default(), table_config].map(|config| among(&config, &motion(25.0, 2.5), &[(0.0, 25.0)]));
        assert!((table[0] * 12.96 - si[0]).abs() < 1e-15);
        assert!((table[1] - 100.0 * si[1]).abs() < 1e-12);
        assert!((table[2] - si[2] * 57.295_779_513 * 57.295_779_513).abs() < 1e-7);
        assert_eq!(table[3..], si[3..]);
        // Orders of magnitude of Table IV: 2e-4 … 5e-4, 17 … 30, 0.095 … 0.14.
        assert!((1e-4..1e-3).contains(&table[0]) && (10.0..40.0).contains(&table[2]));
    }

    #[test]
    fn a_set_gives_what_each_path_gives_alone() {
        let config = FeatureConfig::default();
        let at =
            |m: usize, t: f64| ForecastPoint { ahead_m: 12.0 * m as f64 - 10.0 + 23.0 * t, d_m: 3.75, speed_mps: 23.0 };
        let others = Surroundings { half_lengths_m: &[4.8; 3], at };
        let mut motions = [1.5, 2.2, 4.0].map(|t| motion(25.0, t)).to_vec();
        motions.push(Motion { speed_change_mps: 2.0, ..motions[1] });
        motions.push(Motion { speed_change_mps: -1.0, ..motions[2] });
        let mut set = vec![[0.0; FEATURES]; motions.len()];
        features_of_set(&config, &ALL, &motions, &others, &mut set);
        for (motion, together) in motions.iter().zip(set) {
            assert_eq!(features(&config, &ALL, motion, &others), together);
        }
        assert!((0..FEATURES).all(|i| motions.iter().any(|m| features(&config, &ALL, m, &others)[i] > 0.0)));
    }

    #[test]
    fn what_is_not_selected_is_not_computed() {
        let at = |_: usize, t: f64| ForecastPoint { ahead_m: 10.0 + 20.0 * t, d_m: 3.75, speed_mps: 20.0 };
        let others = Surroundings { half_lengths_m: &[4.8], at };
        let config = FeatureConfig::default();
        let (all, paper) = [ALL, PAPER_SELECTION].map(|s| features(&config, &s, &motion(25.0, 3.0), &others)).into();
        assert_eq!(all[..PAPER_FEATURES], paper[..PAPER_FEATURES]);
        assert!(all[6] > 0.0 && all[7] > 0.0 && paper[6..] == [0.0; 3]);
    }

    #[test]
    fn a_leader_and_a_follower_count_by_gap_and_closing_speed() {
        // One sample, at the end: in the new lane, with 20 m to the leader and 10 m to the follower, both at constant distance.
        let config = FeatureConfig { sample_step_s: 0.5, ..FeatureConfig::default() };
        let short = motion(20.0, 0.5);
        let h = among(&config, &short, &[(24.8, 20.0), (-14.8, 20.0)]);
        assert!((h[6] - libm::exp(-1.0)).abs() < 1e-12 && h[7] == 0.0);
        // s* = s₀ + v T with the nominal parameters, taken relative to the gap of 10 m.
        let wanted = NOMINAL.min_gap_m + 20.0 * NOMINAL.time_headway_s;
        let expected = NOMINAL.max_accel_mps2 * (wanted / 10.0) * (wanted / 10.0);
        assert!((h[8] - expected.min(10.0)).abs() < 1e-9, "{} {expected}", h[8]);
        // Closing with 8 m/s on 16 m: half of the gap a second.
        let closing = among(&config, &short, &[(24.8, 12.0)]);
        assert!((closing[7] - 8.0 / 16.0).abs() < 1e-12);
        // Far behind nothing is taken, and a vehicle that the ego has not come in the way of does not count.
        assert!(among(&config, &short, &[(-120.0, 18.0)])[8] < 0.1);
        let early = Motion { lateral: Quintic::new(LateralState::default(), 0.1, 0.5), ..short };
        assert_eq!(among(&config, &early, &[(24.8, 12.0), (-14.8, 20.0)])[6..], [0.0; 3]);
    }
}
