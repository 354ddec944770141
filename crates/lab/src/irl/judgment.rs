//! What a reward predicts of drivers it has not seen, beside what is known without it.

use lanecraft_drive::plan::{FEATURE_NAMES, FEATURES, Motion, RewardModel};
use lanecraft_net::random::Stream;
use serde::{Deserialize, Serialize};

use crate::candidates::{CandidateConfig, Choice, Choices, log_probabilities, rewards};
use crate::metrics::Interval;

/// Width of the Gaussian kernel of the duration baseline, s.
const KERNEL_S: f64 = 0.8;
/// Resamplings behind an interval.
const RESAMPLES: usize = 1000;
/// Seed of the draws behind intervals.
const SEED: u64 = 1;
/// Candidates among which the nearest to the driver's end counts.
const MOST_LIKELY: usize = 3;
/// Drivers that a report shows with their candidates.
const FANS: usize = 3;
/// Bins of the calibration.
const BINS: usize = 10;

/// How well one feature of the preferred candidate meets the driver's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeatureError {
    /// Name of the feature.
    pub feature: String,
    /// |mean of ours / mean of the drivers' − 1|: the paper's figure.
    pub ratio_of_means_error: Interval,
    /// Mean of |ours / the driver's − 1| over the drivers whose feature is not 0.
    pub mean_absolute_error: Interval,
}

/// How often drivers end up where the predicted distribution of durations says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Levels of the predicted distribution.
    pub predicted: Vec<f64>,
    /// Share of the drivers whose duration lies below that level.
    pub observed: Vec<Interval>,
}

/// One candidate of a picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FanCurve {
    /// Its probability relative to the most likely one.
    pub likelihood: f64,
    /// Way along and across the road from the begin, m.
    pub points: Vec<[f64; 2]>,
}

/// A driver's path among the candidates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fan {
    /// Site or driver.
    pub group: String,
    /// What the driver did.
    pub driver: Vec<[f64; 2]>,
    /// What the reward prefers.
    pub preferred: Vec<[f64; 2]>,
    /// Candidates.
    pub candidates: Vec<FanCurve>,
}

/// How well a reward predicts drivers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Judgment {
    /// Lane changes judged.
    pub events: usize,
    /// Sites or drivers they come from.
    pub groups: usize,
    /// Errors of the features.
    pub features: Vec<FeatureError>,
    /// Mean |duration of the preferred candidate − the driver's|, s.
    pub duration_error_s: Interval,
    /// The same of the mean duration of the other drivers.
    pub constant_duration_error_s: Interval,
    /// Mean distance between the driver and the nearest of the three most likely candidates when the driver's change ended, m.
    pub end_point_error_m: Interval,
    /// The same of the candidate of constant duration and speed.
    pub constant_end_point_error_m: Interval,
    /// Mean log-likelihood of the candidate nearest to the driver's path.
    pub log_likelihood: Interval,
    /// The same if all candidates are equally likely.
    pub uniform: f64,
    /// Mean log-likelihood of that candidate's duration: summed over lateral ends and speeds, so that candidate sets can be compared.
    pub duration_log_likelihood: Interval,
    /// The same if all durations are equally likely.
    pub uniform_duration: f64,
    /// The same if the duration is drawn from a smoothed histogram of the other drivers' durations.
    pub duration_density: f64,
    /// By how much the reward knows more of durations than that histogram.
    pub gain_on_density: Interval,
    /// Whether the predicted distribution of durations is right.
    pub calibration: Calibration,
    /// Some drivers among their candidates.
    pub fans: Vec<Fan>,
}

/// What came of one driver.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Site or driver.
    pub group: String,
    preferred: [f64; FEATURES],
    driver: [f64; FEATURES],
    duration_error_s: f64,
    constant_duration_error_s: f64,
    end_point_error_m: f64,
    constant_end_point_error_m: f64,
    log_likelihood: f64,
    uniform: f64,
    /// Log-likelihood of the driver's duration.
    pub duration_log_likelihood: f64,
    uniform_duration: f64,
    duration_density: f64,
    /// Share of the predicted distribution below the driver's duration, half of that duration's own included.
    level: f64,
    fan: Fan,
}

impl Outcome {
    pub(super) fn new(model: &RewardModel, train: &Choices, item: &Choice) -> Self {
        let log_likely = log_probabilities(&rewards(model, &item.candidates.features));
        let motions = &item.candidates.motions;
        let mut order: Vec<usize> = (0..motions.len()).collect();
        // Of equals the first: the sort is stable.
        order.sort_by(|a, b| log_likely[*b].total_cmp(&log_likely[*a]));
        let best = order[0];
        let durations_s = train.config.durations_s();
        let by_duration = ByDuration::new(&durations_s, motions, &log_likely);
        let own = by_duration.index(&motions[item.chosen]);
        let driver_s = item.driver.lateral.duration_s;
        let trained_s = || train.items.iter().map(|other| other.driver.lateral.duration_s);
        let constant_s = trained_s().sum::<f64>() / train.items.len() as f64;
        let density = log_probabilities(&log_density(&trained_s().collect::<Vec<_>>(), &durations_s));
        // Offsets and changes of speed begin with 0, so that the first candidates are those without.
        let offsets = train.config.end_offsets_m.len();
        let constant = &motions[offsets * by_duration.nearest(constant_s)];
        let nearest_m = order.iter().take(MOST_LIKELY).map(|index| end_point_error_m(item, &motions[*index]));
        Self {
            group: item.group.clone(),
            preferred: item.candidates.features[best],
            driver: item.driver_features,
            duration_error_s: (motions[best].lateral.duration_s - driver_s).abs(),
            constant_duration_error_s: (constant_s - driver_s).abs(),
            end_point_error_m: nearest_m.fold(f64::INFINITY, f64::min),
            constant_end_point_error_m: end_point_error_m(item, constant),
            log_likelihood: log_likely[item.chosen],
            uniform: -libm::log(motions.len() as f64),
            duration_log_likelihood: libm::log(by_duration.probabilities[own]),
            uniform_duration: -libm::log(durations_s.len() as f64),
            duration_density: density[own],
            level: by_duration.level(own),
            fan: fan(item, &log_likely, best, &by_duration),
        }
    }
}

/// Probabilities of the durations, summed over everything else.
struct ByDuration<'a> {
    durations_s: &'a [f64],
    probabilities: Vec<f64>,
}

impl<'a> ByDuration<'a> {
    fn new(durations_s: &'a [f64], motions: &[Motion], log_likely: &[f64]) -> Self {
        let mut by = Self { durations_s, probabilities: vec![0.0; durations_s.len()] };
        for (motion, log_probability) in motions.iter().zip(log_likely) {
            let index = by.index(motion);
            by.probabilities[index] += libm::exp(*log_probability);
        }
        by
    }

    fn index(&self, motion: &Motion) -> usize {
        self.durations_s.partition_point(|duration_s| *duration_s < motion.lateral.duration_s - 1e-9)
    }

    fn nearest(&self, duration_s: f64) -> usize {
        let distance = |index: &usize| (self.durations_s[*index] - duration_s).abs();
        (0..self.durations_s.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
    }

    fn level(&self, own: usize) -> f64 {
        self.probabilities[..own].iter().sum::<f64>() + 0.5 * self.probabilities[own]
    }
}

/// How far `motion` is from where the driver was when the driver's change ended, m.
fn end_point_error_m(item: &Choice, motion: &Motion) -> f64 {
    let end_s = item.driver.lateral.duration_s;
    let (way_m, d_m) = (motion.course().at(end_s).0, motion.lateral.at(end_s).0);
    libm::hypot(way_m - item.driver_end_m.0, d_m - item.driver_end_m.1)
}

/// Log of the Gaussian kernel density of the durations `trained_s`, up to a constant.
fn log_density(trained_s: &[f64], durations_s: &[f64]) -> Vec<f64> {
    let kernel = |a_s: f64, b_s: f64| -0.5 * (a_s - b_s) * (a_s - b_s) / (KERNEL_S * KERNEL_S);
    let at = |duration_s: f64| {
        let exponents = || trained_s.iter().map(|trained_s| kernel(duration_s, *trained_s));
        let highest = exponents().fold(f64::NEG_INFINITY, f64::max);
        highest + libm::log(exponents().map(|exponent| libm::exp(exponent - highest)).sum())
    };
    durations_s.iter().map(|&duration_s| at(duration_s)).collect()
}

/// A driver among every fifth duration, with the lateral end and speed of the preferred candidate.
fn fan(item: &Choice, log_likely: &[f64], best: usize, by: &ByDuration) -> Fan {
    let motions = &item.candidates.motions;
    let start_d_m = item.driver.lateral.at(0.0).0;
    let preferred = &motions[best];
    let same_end = |motion: &Motion| {
        let end_m = |motion: &Motion| motion.lateral.at(motion.lateral.duration_s).0;
        motion.speed_change_mps == preferred.speed_change_mps && (end_m(motion) - end_m(preferred)).abs() < 1e-6
    };
    let points = |motion: &Motion| {
        let samples = 24;
        let at = |k: i32| {
            let time_s = motion.lateral.duration_s * f64::from(k) / f64::from(samples);
            [motion.course().at(time_s).0, motion.lateral.at(time_s).0 - start_d_m]
        };
        (0..=samples).map(at).collect()
    };
    let shown =
        (0..motions.len()).filter(|&index| same_end(&motions[index]) && by.index(&motions[index]).is_multiple_of(5));
    Fan {
        group: item.group.clone(),
        driver: item.driver_way.iter().map(|[_, way_m, d_m]| [*way_m, d_m - start_d_m]).collect(),
        preferred: points(preferred),
        candidates: shown
            .map(|index| FanCurve {
                likelihood: libm::exp(log_likely[index] - log_likely[best]),
                points: points(&motions[index]),
            })
            .collect(),
    }
}

impl Judgment {
    /// What `outcomes`, at least one, come to.
    pub(super) fn new(config: &CandidateConfig, outcomes: &[Outcome]) -> Self {
        let draws = Draws::new(outcomes);
        let mean = |of: &dyn Fn(&Outcome) -> f64| draws.interval(&|drawn| average(drawn, of));
        let feature = |index: usize| {
            let ratio = |drawn: &[&Outcome]| {
                relative_error(average(drawn, &|o| o.preferred[index]), average(drawn, &|o| o.driver[index]))
            };
            let absolute = |drawn: &[&Outcome]| {
                let known: Vec<&Outcome> = drawn.iter().copied().filter(|o| o.driver[index] > 0.0).collect();
                if known.is_empty() {
                    0.0
                } else {
                    average(&known, &|o| relative_error(o.preferred[index], o.driver[index]))
                }
            };
            FeatureError {
                feature: FEATURE_NAMES[index].to_owned(),
                ratio_of_means_error: draws.interval(&ratio),
                mean_absolute_error: draws.interval(&absolute),
            }
        };
        Self {
            events: outcomes.len(),
            groups: draws.groups.len(),
            features: config.indices().into_iter().map(feature).collect(),
            duration_error_s: mean(&|o| o.duration_error_s),
            constant_duration_error_s: mean(&|o| o.constant_duration_error_s),
            end_point_error_m: mean(&|o| o.end_point_error_m),
            constant_end_point_error_m: mean(&|o| o.constant_end_point_error_m),
            log_likelihood: mean(&|o| o.log_likelihood),
            uniform: mean(&|o| o.uniform).mean,
            duration_log_likelihood: mean(&|o| o.duration_log_likelihood),
            uniform_duration: mean(&|o| o.uniform_duration).mean,
            duration_density: mean(&|o| o.duration_density).mean,
            gain_on_density: mean(&|o| o.duration_log_likelihood - o.duration_density),
            calibration: calibration(&draws),
            fans: outcomes.iter().step_by((outcomes.len() / FANS).max(1)).take(FANS).map(|o| o.fan.clone()).collect(),
        }
    }
}

fn calibration(draws: &Draws) -> Calibration {
    let predicted: Vec<f64> = (1..BINS).map(|bin| bin as f64 / BINS as f64).collect();
    let below = |level: f64| draws.interval(&|drawn| average(drawn, &|o| f64::from(u8::from(o.level <= level))));
    Calibration { observed: predicted.iter().map(|level| below(*level)).collect(), predicted }
}

/// By how much the durations of the same drivers are more likely in `ours` than in `theirs`, per driver.
pub fn gain(ours: &[Outcome], theirs: &[Outcome]) -> Interval {
    let pairs: Vec<Outcome> = ours
        .iter()
        .zip(theirs)
        .map(|(a, b)| Outcome {
            duration_log_likelihood: a.duration_log_likelihood - b.duration_log_likelihood,
            ..a.clone()
        })
        .collect();
    Draws::new(&pairs).interval(&|drawn| average(drawn, &|o| o.duration_log_likelihood))
}

/// Outcomes by group, to be drawn with replacement.
struct Draws<'a> {
    all: Vec<&'a Outcome>,
    groups: Vec<Vec<&'a Outcome>>,
}

impl<'a> Draws<'a> {
    fn new(outcomes: &'a [Outcome]) -> Self {
        let mut all: Vec<&Outcome> = outcomes.iter().collect();
        all.sort_by(|a, b| a.group.cmp(&b.group));
        let groups = all.chunk_by(|a, b| a.group == b.group).map(<[_]>::to_vec).collect();
        Self { all, groups }
    }

    /// `statistic` of all, with the percentiles of its bootstrap.
    fn interval(&self, statistic: &dyn Fn(&[&Outcome]) -> f64) -> Interval {
        let drawn = |number: usize| {
            let mut stream = Stream::keyed(SEED, "irl.judgment", number as u64, 0);
            let mut sample = Vec::with_capacity(self.all.len());
            for _ in 0..self.groups.len() {
                sample.extend_from_slice(&self.groups[stream.below(self.groups.len())]);
            }
            statistic(&sample)
        };
        percentiles(statistic(&self.all), (0..RESAMPLES).map(drawn).collect())
    }
}

/// `value` with the 2.5 % and 97.5 % percentiles of `drawn`.
pub(super) fn percentiles(value: f64, mut drawn: Vec<f64>) -> Interval {
    drawn.sort_by(f64::total_cmp);
    let at = |share: f64| drawn.get((share * (drawn.len() - 1) as f64).round() as usize).copied().unwrap_or(value);
    Interval { mean: value, low: at(0.025), high: at(0.975) }
}

fn average(outcomes: &[&Outcome], of: &dyn Fn(&Outcome) -> f64) -> f64 {
    outcomes.iter().map(|outcome| of(outcome)).sum::<f64>() / outcomes.len() as f64
}

/// |ours/theirs − 1|; 0 where both are 0, as the collision risk on an empty road.
pub(super) fn relative_error(ours: f64, theirs: f64) -> f64 {
    if ours == theirs { 0.0 } else { (ours / theirs - 1.0).abs() }
}
