//! What drivers weigh when they change lanes (Eqs. 18–20): stability, collision risk, comfort and travel efficiency of a path, and
//! five more that may be selected: jerk, peak lateral acceleration, time headway, time to collision, effect on the new follower.
//!
//! All are costs, so that a reward learned from people has negative weights. Departures from the paper: the collision feature
//! is taken on normalized distances (in meters it vanishes until the bodies overlap), and the number of samples η is that of
//! [0, t_c] (the text says of the interval of allowed durations, which would not make H_tra a measure of duration).

use pulp::{Arch, NullaryFnOnce};
use serde::{Deserialize, Serialize};

use super::interaction::{interaction, interacts};
use super::motion::Motion;
use super::samples::{SampledCourse, Samples};
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
    pub fn samples(&self, duration_s: f64) -> usize {
        (duration_s / self.sample_step_s).round().max(1.0) as usize
    }

    /// Number of samples at which it still moves: the last one may come after its end, but not by rounding.
    fn moving_samples(&self, duration_s: f64) -> usize {
        self.samples(duration_s).min((duration_s / self.sample_step_s + 1e-9) as usize)
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
    features_of_set_on(Arch::new(), (config, selection), motions, others, out);
}

/// [`features_of_set`] with the vectors of `arch`.
fn features_of_set_on<F: Fn(usize, f64) -> ForecastPoint>(
    arch: Arch,
    (config, selection): (&FeatureConfig, &Selection),
    motions: &[Motion],
    others: &Surroundings<F>,
    out: &mut [[f64; FEATURES]],
) {
    let samples = Samples::new(config, motions, others);
    arch.dispatch(FeaturesOfSet { config, selection, motions, samples, out });
}

/// [`features_of_set`] once the samples are known.
struct FeaturesOfSet<'a> {
    config: &'a FeatureConfig,
    selection: &'a Selection,
    motions: &'a [Motion],
    samples: Samples,
    out: &'a mut [[f64; FEATURES]],
}

#[allow(clippy::inline_always)]
impl NullaryFnOnce for FeaturesOfSet<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { config, selection, motions, samples, out } = self;
        let mut room = Room::default();
        let mut vectors = out.iter_mut();
        for same_course in motions.chunk_by(|a, b| a.course() == b.course()) {
            let course = SampledCourse::new(config, &samples, same_course);
            for (motion, vector) in same_course.iter().zip(&mut vectors) {
                *vector = features_on_course(config, selection, motion, &course, &mut room);
            }
        }
    }
}

/// Room to work in, by sample: lateral position of the motion looked at (m), and its collision risk.
#[derive(Default)]
struct Room {
    d_m: Vec<f64>,
    risk: Vec<f64>,
}

/// H of a motion whose course is `course`.
// Must be inlined into what `pulp` compiles for the processor's instruction set.
#[allow(clippy::inline_always)]
#[inline(always)]
fn features_on_course(
    config: &FeatureConfig,
    selection: &Selection,
    motion: &Motion,
    course: &SampledCourse,
    Room { d_m, risk }: &mut Room,
) -> [f64; FEATURES] {
    let duration_s = motion.lateral.duration_s;
    let (count, moving) = (config.samples(duration_s), config.moving_samples(duration_s));
    course.place(motion, count, d_m);
    let [heading, yaw_rate, jerk] = course.squares(motion, (count, moving));
    let [headway, closing, imposed] =
        if interacts(selection) { interaction(course, &d_m[..count], config.lateral_scale_m) } else { [0.0; 3] };
    let mean = |sum: f64| sum / count as f64;
    let vector = [
        mean(heading),
        mean(course.collision(d_m, risk)),
        mean(yaw_rate),
        TRAVEL_STEP_S * duration_s,
        mean(jerk),
        motion.lateral.max_accel_mps2(),
        mean(headway),
        mean(closing),
        mean(imposed),
    ];
    let factors = config.unit_factors();
    std::array::from_fn(|index| vector[index] * factors[index])
}

#[cfg(test)]
mod tests {
    use lanecraft_net::random::Stream;

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

    /// The definition, sample by sample.
    fn reference(config: &FeatureConfig, motion: &Motion, cars: &[(f64, f64, f64)]) -> [f64; 5] {
        let eta = (motion.lateral.duration_s / config.sample_step_s).round();
        let mut h = [0.0, 0.0, 0.0, TRAVEL_STEP_S * motion.lateral.duration_s, 0.0];
        for sample in 1..=eta as u32 {
            let t = f64::from(sample) * config.sample_step_s;
            // Rounding is not to take the last sample from the path.
            let within = if t < motion.lateral.duration_s + 1e-9 { t.min(motion.lateral.duration_s) } else { t };
            let (d, speed, accel, jerk) = motion.lateral.at(within);
            let (way, v, along_jerk) = motion.course().at(t);
            h[0] += (speed / v) * (speed / v) / eta;
            h[2] += (accel / v) * (accel / v) / eta;
            h[4] += (jerk * jerk + along_jerk * along_jerk) / eta;
            for &(ahead, car_d, car_speed) in cars {
                let across = (d - car_d) / config.lateral_scale_m;
                let along = (ahead + car_speed * t - way) / config.longitudinal_scale_m;
                let exponent = config.sigma_lateral * across * across + config.sigma_longitudinal * along * along;
                h[1] += libm::exp(exponent) / eta;
            }
        }
        h
    }

    #[test]
    fn shared_sums_are_those_of_the_definition() {
        let mut stream = Stream::new(8, "features");
        for case in 0..400 {
            // One of three steps does not divide the durations, so that a last sample may come after the end.
            let sample_step_s = [0.1, 0.05, 0.3][case % 3];
            let config = FeatureConfig { sample_step_s, ..FeatureConfig::default() };
            let start = LateralState {
                d_m: stream.range(-0.5, 0.5),
                speed_mps: stream.range(-0.5, 0.5),
                accel_mps2: stream.range(-0.5, 0.5),
            };
            let duration_s = 0.1 * stream.range(15.0, 80.0).round();
            let motion = Motion {
                lateral: Quintic::new(start, 3.75, duration_s),
                speed_mps: stream.range(8.0, 35.0),
                speed_change_mps: if case % 2 == 0 { 0.0 } else { stream.range(-3.0, 3.0) },
            };
            let mut car =
                || (stream.range(-40.0, 40.0), 3.75 * stream.range(-0.5, 1.5).round(), stream.range(8.0, 35.0));
            let cars = [car(), car(), car(), car()];
            let at = |m: usize, t: f64| {
                let (ahead, d_m, speed_mps) = cars[m];
                ForecastPoint { ahead_m: ahead + speed_mps * t, d_m, speed_mps }
            };
            let others = Surroundings { half_lengths_m: &[4.8; 4], at };
            let (found, expected) = (features(&config, &ALL, &motion, &others), reference(&config, &motion, &cars));
            for index in [0, 2, 3, 4] {
                // The moments cancel by up to 1500.
                let error = found[index] / expected[index] - 1.0;
                assert!(error.abs() < 1e-10, "{index}: {} is not {}", found[index], expected[index]);
            }
            // What is left out: a factor below e⁻⁹ of each car.
            let left_out = expected[1] - found[1];
            assert!((-1e-10..4.0 * libm::exp(-9.0)).contains(&left_out), "{} is not {}", found[1], expected[1]);
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
    fn every_vector_width_gives_the_same_bits() {
        let mut archs = vec![Arch::Scalar, Arch::new()];
        #[cfg(target_arch = "x86_64")]
        archs.extend(pulp::x86::V3::try_new().map(Arch::V3));
        let at = |m: usize, t: f64| {
            let lane = (m % 3) as f64;
            ForecastPoint {
                ahead_m: 9.0 * m as f64 - 30.0 + (27.0 - lane) * t,
                d_m: 3.75 * lane,
                speed_mps: 27.0 - lane,
            }
        };
        let others = Surroundings { half_lengths_m: &[4.8; 7], at };
        let motions = [1.5, 2.2, 3.7, 4.0]
            .map(|t| [0.0, -1.5].map(|change| Motion { speed_change_mps: change, ..motion(25.0, t) }));
        let all = archs.into_iter().map(|arch| {
            let mut set = vec![[0.0; FEATURES]; 8];
            features_of_set_on(arch, (&FeatureConfig::default(), &ALL), motions.as_flattened(), &others, &mut set);
            set
        });
        let all: Vec<_> = all.collect();
        assert!(all.iter().all(|set| *set == all[0] && set.iter().all(|h| h[1] > 0.1)));
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
