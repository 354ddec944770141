//! Lane changes from which a reward is learned: each with its candidates and the one the driver took.
//!
//! Recorded drivers: candidates of 1.5 … 10 s by 0.1 s, all with the driver's own lateral shift, begin and mean speed, among the
//! recorded traffic, which does not react. Synthetic drivers, since the paper's fifty are not public: a noisy choice by hidden
//! weights (probability ∝ exp ϖᵀH), driven with an error in duration and in the lateral end position.

use lanecraft_drive::plan::{
    FEATURE_NAMES, FEATURES, FeatureConfig, LateralState, Quintic, RewardModel, features, features_of_set,
};
use lanecraft_learn::irl::CandidateSet;
use lanecraft_net::random::Stream;
use serde::{Deserialize, Serialize};

use crate::data::events::{LaneChangeEvent, RoadKind, Track};

/// Candidate durations are whole multiples of this, s.
const DURATION_STEP_S: f64 = 0.1;

/// One lane change of one driver.
#[derive(Clone, Debug, PartialEq)]
pub struct Demonstration {
    /// What it shares with others that must not be in training when this one is tested: its site, or its driver.
    pub group: String,
    /// Durations of the candidates, s, rising.
    pub durations_s: Vec<f64>,
    /// Features of the candidates.
    pub features: Vec<[f64; FEATURES]>,
    /// The candidate nearest to what the driver did.
    pub chosen: usize,
    /// The driver's duration, s.
    pub driver_duration_s: f64,
    /// Features of what the driver did.
    pub driver_features: [f64; FEATURES],
}

/// Lane changes whose features were computed alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Demonstrations {
    /// Whose they are, in words.
    pub source: String,
    /// How the features were computed.
    pub definition: FeatureConfig,
    /// The lane changes.
    pub items: Vec<Demonstration>,
}

impl Demonstrations {
    /// The choices, as the fit wants them.
    pub fn candidate_sets(&self) -> Vec<CandidateSet> {
        let set = |item: &Demonstration| CandidateSet {
            features: item.features.iter().map(|vector| vector.to_vec()).collect(),
            chosen: item.chosen,
        };
        self.items.iter().map(set).collect()
    }

    /// The lane changes that `keep` picks.
    #[must_use]
    pub fn filtered(&self, keep: impl Fn(&Demonstration) -> bool) -> Self {
        let items = self.items.iter().filter(|item| keep(item)).cloned().collect();
        Self { items, source: self.source.clone(), definition: self.definition.clone() }
    }

    /// All groups, sorted.
    pub fn groups(&self) -> Vec<&str> {
        let mut groups: Vec<&str> = self.items.iter().map(|item| item.group.as_str()).collect();
        groups.sort_unstable();
        groups.dedup();
        groups
    }
}

/// Which duration a recorded driver is said to have had.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DriverDuration {
    /// Begin and end as recorded: while the lateral speed is above 0.1 m/s.
    Record,
    /// Begin and duration of the rest-to-rest quintic nearest to the lateral track. A slow drift before or after the change
    /// stretches it, up to the longest candidate, and durations scatter more than by the record.
    QuinticFit,
}

/// How recorded lane changes become demonstrations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecordedConfig {
    /// How features are computed.
    pub features: FeatureConfig,
    /// Shortest candidate, s.
    pub duration_min_s: f64,
    /// Longest candidate, s.
    pub duration_max_s: f64,
    /// Which duration is the driver's.
    pub driver_duration: DriverDuration,
}

impl Default for RecordedConfig {
    fn default() -> Self {
        Self {
            // The lanes of the recorded freeway are 3.3 to 3.6 m wide.
            features: FeatureConfig { lateral_scale_m: 3.5, ..FeatureConfig::default() },
            duration_min_s: 1.5,
            duration_max_s: 10.0,
            driver_duration: DriverDuration::Record,
        }
    }
}

/// The recorded freeway lane changes, grouped by site. What a driver did is represented by the candidate nearest in duration.
pub fn recorded(events: &[LaneChangeEvent], config: &RecordedConfig) -> Demonstrations {
    let freeway = events.iter().filter(|event| event.road == RoadKind::Freeway);
    Demonstrations {
        source: "recorded drivers on freeways (NGSIM)".to_owned(),
        definition: config.features.clone(),
        items: freeway.map(|event| recorded_one(event, config)).collect(),
    }
}

fn recorded_one(event: &LaneChangeEvent, config: &RecordedConfig) -> Demonstration {
    let (start_s, driver_duration_s) = match config.driver_duration {
        DriverDuration::Record => (event.start_s, event.end_s - event.start_s),
        DriverDuration::QuinticFit => fitted_quintic(&event.ego, config),
    };
    let start = LateralState { d_m: event.start_d_m, ..LateralState::default() };
    let durations_s = durations(config.duration_min_s, config.duration_max_s);
    let paths: Vec<Quintic> = durations_s.iter().map(|&t| Quintic::new(start, event.end_d_m, t)).collect();
    let start_s_m = event.ego.position_m(start_s).0;
    let position_m = |neighbor: usize, time_s: f64| {
        let (s_m, d_m) = event.neighbors[neighbor].position_m(start_s + time_s);
        (s_m - start_s_m, d_m)
    };
    let mut vectors = vec![[0.0; FEATURES]; paths.len()];
    let motion = (paths.as_slice(), event.mean_speed_mps);
    features_of_set(&config.features, motion, event.neighbors.len(), position_m, &mut vectors);
    let chosen = nearest(&durations_s, driver_duration_s);
    let driver_features = vectors[chosen];
    Demonstration {
        group: event.site.clone(),
        durations_s,
        features: vectors,
        chosen,
        driver_duration_s,
        driver_features,
    }
}

/// Durations from `min_s` to `max_s` on the grid.
fn durations(min_s: f64, max_s: f64) -> Vec<f64> {
    let steps = |duration_s: f64| (duration_s / DURATION_STEP_S).round() as u32;
    (steps(min_s)..=steps(max_s)).map(|step| f64::from(step) * DURATION_STEP_S).collect()
}

/// The index of the duration nearest to `duration_s`, the shorter of two equally near.
fn nearest(durations_s: &[f64], duration_s: f64) -> usize {
    let distance = |index: usize| (durations_s[index] - duration_s).abs();
    (1..durations_s.len()).fold(0, |best, index| if distance(index) < distance(best) { index } else { best })
}

/// Begin and duration, on the grid, of the quintic from rest to rest that fits the lateral `track` in the sense of least squares,
/// with free lateral begin and end. It must span the crossing of the line at t = 0.
fn fitted_quintic(track: &Track, config: &RecordedConfig) -> (f64, f64) {
    let mut best = (f64::INFINITY, 0.0, config.duration_min_s);
    for duration_s in durations(config.duration_min_s, config.duration_max_s) {
        let steps = (duration_s / DURATION_STEP_S).round() as u32;
        for step in 0..=steps {
            let start_s = -f64::from(step) * DURATION_STEP_S;
            let residual = fit_residual(track, start_s, duration_s);
            if residual < best.0 {
                best = (residual, start_s, duration_s);
            }
        }
    }
    (best.1, best.2)
}

/// Sum of squares left by the best a + b · (shape of Eq. 14 from `start_s` within `duration_s`).
fn fit_residual(track: &Track, start_s: f64, duration_s: f64) -> f64 {
    let shape = |time_s: f64| {
        let x = ((time_s - start_s) / duration_s).clamp(0.0, 1.0);
        x * x * x * (10.0 + x * (6.0 * x - 15.0))
    };
    let n = track.points.len() as f64;
    let (mut mean_x, mut mean_y) = (0.0, 0.0);
    for point in &track.points {
        mean_x += shape(point.time_s) / n;
        mean_y += point.d_m / n;
    }
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for point in &track.points {
        let (x, y) = (shape(point.time_s) - mean_x, point.d_m - mean_y);
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    if xx > 0.0 { yy - xy * xy / xx } else { yy }
}

/// How synthetic drivers behave.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SyntheticConfig {
    /// How features are computed.
    pub features: FeatureConfig,
    /// Hidden cost weights of (stability, collision, comfort, travel) on features divided by their typical sizes.
    pub cost_weights: [f64; FEATURES],
    /// Standard deviation of the lateral end position, m.
    pub end_noise_m: f64,
    /// Standard deviation of the duration driven around the one chosen, s.
    pub duration_noise_s: f64,
}

impl Default for SyntheticConfig {
    fn default() -> Self {
        Self {
            features: FeatureConfig::default(),
            // Durations of 2.5 s with a spread of about 0.25 s at 28 m/s, as those decoded from Table IV (1.9 to 2.8 s).
            cost_weights: [4.0, 4.0, 4.0, 24.0],
            end_noise_m: 0.08,
            duration_noise_s: 0.05,
        }
    }
}

impl SyntheticConfig {
    /// The hidden reward: what a perfect fit would find.
    pub fn hidden_reward(&self) -> RewardModel {
        // Features of a change by 3.75 m within 2.5 s at 28 m/s on an ordinarily busy road, in the units asked for.
        let path = Quintic::new(LateralState::default(), LANE_WIDTH_M, 2.5);
        let mut scale = features(&self.features, &path, 28.0, 1, |_, time_s| (12.0 + 28.0 * time_s, LANE_WIDTH_M));
        scale[1] = scale[1].max(1e-6);
        RewardModel {
            features: FEATURE_NAMES.map(str::to_owned),
            definition: self.features.clone(),
            mean: [0.0; FEATURES],
            scale,
            weights: self.cost_weights.map(|weight| -weight),
            source: "hidden weights of synthetic drivers".to_owned(),
        }
    }
}

/// Width of the lanes of synthetic drivers, m.
const LANE_WIDTH_M: f64 = 3.75;
/// Shortest and longest candidates of synthetic drivers, s.
const SYNTHETIC_DURATIONS_S: (f64, f64) = (1.5, 4.0);

/// `count` lane changes, each of another synthetic driver, in traffic drawn from `seed`.
pub fn synthetic(config: &SyntheticConfig, seed: u64, count: u32) -> Demonstrations {
    let hidden = config.hidden_reward();
    Demonstrations {
        source: "synthetic drivers with known weights".to_owned(),
        definition: config.features.clone(),
        items: (0..count).map(|driver| synthetic_one(config, &hidden, (seed, driver))).collect(),
    }
}

fn synthetic_one(config: &SyntheticConfig, hidden: &RewardModel, (seed, driver): (u64, u32)) -> Demonstration {
    let mut stream = Stream::keyed(seed, "irl.synthetic", u64::from(driver), 0);
    let speed_mps = stream.range(22.0, 31.0);
    // Leader in the old lane, leader and follower in the new one: distance between centers, speed, lateral position.
    let others = [
        (stream.range(20.0, 60.0), speed_mps - stream.range(0.0, 6.0), 0.0),
        (stream.range(20.0, 90.0), speed_mps + stream.range(-2.0, 3.0), LANE_WIDTH_M),
        (-stream.range(15.0, 70.0), speed_mps + stream.range(-4.0, 2.0), LANE_WIDTH_M),
    ];
    let position_m = |m: usize, time_s: f64| (others[m].0 + others[m].1 * time_s, others[m].2);
    let durations_s = durations(SYNTHETIC_DURATIONS_S.0, SYNTHETIC_DURATIONS_S.1);
    let path = |end_m: f64, duration_s: f64| Quintic::new(LateralState::default(), end_m, duration_s);
    let paths: Vec<Quintic> = durations_s.iter().map(|&t| path(LANE_WIDTH_M, t)).collect();
    let mut vectors = vec![[0.0; FEATURES]; paths.len()];
    features_of_set(&config.features, (&paths, speed_mps), others.len(), position_m, &mut vectors);
    let wish_s = durations_s[draw(&rewards(hidden, &vectors), stream.uniform())];
    let driver_duration_s = wish_s + config.duration_noise_s * stream.normal();
    let driven = path(LANE_WIDTH_M + config.end_noise_m * stream.normal(), driver_duration_s);
    Demonstration {
        group: format!("driver {driver}"),
        chosen: nearest(&durations_s, driver_duration_s),
        driver_features: features(&config.features, &driven, speed_mps, others.len(), position_m),
        durations_s,
        features: vectors,
        driver_duration_s,
    }
}

/// The reward of each candidate.
pub fn rewards(model: &RewardModel, candidates: &[[f64; FEATURES]]) -> Vec<f64> {
    candidates.iter().map(|vector| model.reward(vector)).collect()
}

/// log P of each candidate under P ∝ exp(reward).
pub fn log_probabilities(rewards: &[f64]) -> Vec<f64> {
    let highest = rewards.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = rewards.iter().map(|reward| libm::exp(reward - highest)).sum();
    let log_sum = highest + libm::log(sum);
    rewards.iter().map(|reward| reward - log_sum).collect()
}

/// The candidate at `quantile` of the distribution P ∝ exp(reward).
fn draw(rewards: &[f64], quantile: f64) -> usize {
    let mut below = 0.0;
    for (index, log_probability) in log_probabilities(rewards).into_iter().enumerate() {
        below += libm::exp(log_probability);
        if quantile < below {
            return index;
        }
    }
    rewards.len() - 1
}

#[cfg(test)]
mod tests {
    use lanecraft_drive::road::Side;

    use super::*;
    use crate::data::events::TrackPoint;

    fn track(vehicle_id: u32, at: impl Fn(f64) -> (f64, f64)) -> Track {
        let point = |k: u32| {
            let time_s = -5.0 + 0.1 * f64::from(k);
            let (s_m, d_m) = at(time_s);
            TrackPoint { time_s, s_m, d_m, speed_mps: 15.0 }
        };
        Track { vehicle_id, length_m: 4.5, width_m: 1.8, points: (0..=100).map(point).collect() }
    }

    /// A change by 3.4 m to the right within 4.2 s, begun 2 s before the crossing, at 15 m/s, beside a car that keeps pace.
    fn event() -> LaneChangeEvent {
        let path = Quintic::new(LateralState { d_m: 1.0, ..LateralState::default() }, -2.4, 4.2);
        LaneChangeEvent {
            id: "made up".into(),
            site: "here".into(),
            road: RoadKind::Freeway,
            side: Side::Right,
            start_s: -1.7,
            end_s: 1.9,
            start_d_m: 0.9,
            end_d_m: -2.3,
            mean_speed_mps: 15.0,
            ego: track(1, |time_s| (15.0 * time_s, path.at(time_s + 2.0).0)),
            neighbors: vec![track(2, |time_s| (15.0 * time_s + 8.0, -2.3))],
        }
    }

    #[test]
    fn a_quintic_fitted_to_a_quintic_is_that_quintic() {
        let (start_s, duration_s) = fitted_quintic(&event().ego, &RecordedConfig::default());
        assert!((start_s + 2.0).abs() < 1e-9 && (duration_s - 4.2).abs() < 1e-9);
    }

    #[test]
    fn candidates_of_a_recorded_driver_share_all_but_the_duration() {
        let config = RecordedConfig::default();
        let demonstrations = recorded(&[event(), LaneChangeEvent { road: RoadKind::Arterial, ..event() }], &config);
        let [item] = &demonstrations.items[..] else { panic!("one freeway event") };
        assert_eq!((item.durations_s.len(), item.features.len()), (86, 86));
        assert!((item.durations_s[item.chosen] - 3.6).abs() < 1e-9);
        for (duration_s, vector) in item.durations_s.iter().zip(&item.features) {
            let path = Quintic::new(LateralState { d_m: 0.9, ..LateralState::default() }, -2.3, *duration_s);
            let expected = features(&config.features, &path, 15.0, 1, |_, time_s| (8.0 + 15.0 * time_s, -2.3));
            for i in 0..FEATURES {
                assert!((vector[i] - expected[i]).abs() < 1e-9 * expected[i].max(1.0));
            }
        }
    }

    #[test]
    fn synthetic_drivers_are_the_same_for_the_same_seed_and_as_quick_as_meant() {
        let config = SyntheticConfig::default();
        let drivers = synthetic(&config, 7, 300);
        assert_eq!(drivers, synthetic(&config, 7, 300));
        assert_ne!(drivers, synthetic(&config, 8, 300));
        assert_eq!(drivers.groups().len(), 300);
        let durations: Vec<f64> = drivers.items.iter().map(|item| item.driver_duration_s).collect();
        let mean_s = durations.iter().sum::<f64>() / 300.0;
        let variance = durations.iter().map(|t| (t - mean_s) * (t - mean_s)).sum::<f64>() / 300.0;
        assert!((2.2..2.8).contains(&mean_s) && (0.15..0.4).contains(&variance.sqrt()), "{mean_s} {variance}");
    }

    #[test]
    fn probabilities_sum_to_one_however_large_the_rewards() {
        let log_probabilities = log_probabilities(&[1e4, 1e4 - 1.0, -1e4]);
        let sum: f64 = log_probabilities.iter().map(|log| libm::exp(*log)).sum();
        assert!((sum - 1.0).abs() < 1e-12);
        assert_eq!(draw(&[0.0, 0.0], 0.4), 0);
        assert_eq!(draw(&[0.0, 0.0], 0.6), 1);
        assert_eq!(draw(&[0.0, 0.0], 1.0), 1);
    }
}
