//! What a driver could have done instead: the candidates of a demonstration, their features, and the one nearest to what was done.
//!
//! The paper's candidates differ in duration alone and hold the driver's mean speed to the driver's own end. They leave the weights
//! hardly identifiable, so that candidates may also differ in lateral end position and in speed at the end; then they begin with the
//! driver's speed and end around the center of the new lane, which is known before the driver chooses.

use lanecraft_drive::config::{ConfigError, check_range};
use lanecraft_drive::plan::{
    FEATURE_NAMES, FEATURES, FeatureConfig, LateralState, Motion, PAPER_FEATURES, Quintic, RewardModel, Selection,
    Surroundings, feature_index, features_of_set,
};
use lanecraft_drive::predict::ForecastPoint;
use lanecraft_learn::irl::CandidateSet;
use serde::{Deserialize, Serialize};

use crate::data::events::{Track, TrackPoint};
use crate::demonstrations::{Demonstration, Demonstrations, Kind};

/// Where candidates end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ends {
    /// Where the driver ended, at the driver's mean speed: the paper's.
    Driver,
    /// Around the center of the new lane and the speed at the begin.
    Lane,
}

/// Which duration a recorded driver is said to have had; other kinds of demonstrations know theirs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DriverDuration {
    /// Begin and end as recorded: while the lateral speed is above 0.1 m/s.
    Record,
    /// Begin and duration of the rest-to-rest quintic nearest to the lateral track. A slow drift before or after the change
    /// stretches it, up to the longest candidate, and durations scatter more than by the record.
    QuinticFit,
}

/// Section `[candidates]`: what drivers are taken to have chosen among, and by what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CandidateConfig {
    /// Features of the reward, some of those the planner knows. Paper: `stability`, `collision`, `comfort`, `travel`.
    pub features: Vec<String>,
    /// Where candidates end. Preset `paper`: `driver`.
    pub ends: Ends,
    /// Shortest candidate, s.
    pub duration_min_s: f64,
    /// Longest candidate, s; 20 of 34 recorded changes last longer than 4 s.
    pub duration_max_s: f64,
    /// Step of the durations, s. Paper: 0.1.
    pub duration_step_s: f64,
    /// Lateral ends as distances to the left of the end, m, the first one 0. Paper: 0 alone.
    pub end_offsets_m: Vec<f64>,
    /// Changes of speed by the end, m/s, the first one 0. Paper: 0 alone.
    pub end_speed_changes_mps: Vec<f64>,
    /// Which duration is a recorded driver's.
    pub driver_duration: DriverDuration,
    /// How features are computed.
    pub definition: FeatureConfig,
}

impl Default for CandidateConfig {
    fn default() -> Self {
        Self::paper()
    }
}

impl CandidateConfig {
    /// The paper's features and candidates, in SI units; the default, because they are what the planner chooses among by default.
    pub fn paper() -> Self {
        Self {
            features: FEATURE_NAMES[..PAPER_FEATURES].iter().map(|&name| name.to_owned()).collect(),
            ends: Ends::Driver,
            duration_min_s: 1.5,
            duration_max_s: 10.0,
            duration_step_s: 0.1,
            end_offsets_m: vec![0.0],
            end_speed_changes_mps: vec![0.0],
            driver_duration: DriverDuration::Record,
            // The lanes of the recorded freeway are 3.3 to 3.6 m wide.
            definition: FeatureConfig { lateral_scale_m: 3.5, ..FeatureConfig::default() },
        }
    }

    /// All features, and candidates over duration, lateral end and speed at the end.
    #[must_use]
    pub fn wide(self) -> Self {
        Self {
            features: FEATURE_NAMES.map(str::to_owned).to_vec(),
            ends: Ends::Lane,
            end_offsets_m: vec![0.0, -0.4, 0.4],
            end_speed_changes_mps: vec![0.0, -2.0, 2.0],
            ..self
        }
    }

    /// All candidates from `start` to around `end_m`: by change of speed, then duration, then lateral end.
    pub fn motions(&self, start: LateralState, end_m: f64, speed_mps: f64) -> Vec<Motion> {
        let mut motions = Vec::new();
        for &speed_change_mps in &self.end_speed_changes_mps {
            for duration_s in self.durations_s() {
                for offset_m in &self.end_offsets_m {
                    let lateral = Quintic::new(start, end_m + offset_m, duration_s);
                    motions.push(Motion { lateral, speed_mps, speed_change_mps });
                }
            }
        }
        motions
    }

    /// Checks every setting.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let known = |name: &String| feature_index(name).is_some();
        let mut sorted = self.features.clone();
        sorted.sort_unstable();
        sorted.dedup();
        if self.features.is_empty() || sorted.len() < self.features.len() || !self.features.iter().all(known) {
            let found = self.features.clone();
            return Err(ConfigError::BadNames { key: "candidates.features", found, known: &FEATURE_NAMES });
        }
        check_range("candidates.duration_min_s", self.duration_min_s, 0.5, 20.0)?;
        check_range("candidates.duration_max_s", self.duration_max_s, self.duration_min_s, 20.0)?;
        check_range("candidates.duration_step_s", self.duration_step_s, 0.05, 1.0)?;
        for (key, ends, largest) in [
            ("candidates.end_offsets_m", &self.end_offsets_m, 1.5),
            ("candidates.end_speed_changes_mps", &self.end_speed_changes_mps, 10.0),
        ] {
            check_range(key, ends.first().copied().unwrap_or(f64::NAN), 0.0, 0.0)?;
            ends.iter().try_for_each(|&end| check_range(key, end, -largest, largest))?;
        }
        self.definition.validate_as([
            "candidates.definition.sample_step_s",
            "candidates.definition.sigma_lateral",
            "candidates.definition.lateral_scale_m",
            "candidates.definition.sigma_longitudinal",
            "candidates.definition.longitudinal_scale_m",
        ])
    }

    /// The features of the reward as places in a vector.
    pub fn indices(&self) -> Vec<usize> {
        self.features.iter().filter_map(|name| feature_index(name)).collect()
    }

    /// The durations of the candidates, s, rising.
    pub fn durations_s(&self) -> Vec<f64> {
        let steps = |duration_s: f64| (duration_s / self.duration_step_s).round() as u32;
        let range = steps(self.duration_min_s)..=steps(self.duration_max_s);
        range.map(|step| f64::from(step) * self.duration_step_s).collect()
    }

    fn selection(&self) -> Selection {
        let mut selection = [false; FEATURES];
        self.indices().into_iter().for_each(|index| selection[index] = true);
        selection
    }
}

/// Candidates with their features.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidates {
    /// Motions from the begin of the change: by changes of speed, then durations, then lateral ends.
    pub motions: Vec<Motion>,
    /// Features of each.
    pub features: Vec<[f64; FEATURES]>,
}

/// A demonstration as a choice among candidates.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// What it shares with others that must not be in training when this one is tested.
    pub group: String,
    /// What could be chosen.
    pub candidates: Candidates,
    /// The candidate nearest to what the driver did.
    pub chosen: usize,
    /// The driver's own duration, end and change of speed, as a motion of the candidates' form.
    pub driver: Motion,
    /// Its features.
    pub driver_features: [f64; FEATURES],
    /// Where the driver was when the change ended: along the road from its begin and across the road, m.
    pub driver_end_m: (f64, f64),
    /// The driver's way by time: (s from the begin, m along from the begin, m across), for pictures.
    pub driver_way: Vec<[f64; 3]>,
}

/// Choices whose features were computed alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Choices {
    /// Whose they are, in words.
    pub source: String,
    /// How candidates and features were made.
    pub config: CandidateConfig,
    /// The choices.
    pub items: Vec<Choice>,
}

impl Choices {
    /// What the drivers of `demonstrations` chose among.
    pub fn new(demonstrations: &Demonstrations, config: &CandidateConfig) -> Self {
        let items = demonstrations.items.iter().map(|item| choice(item, config)).collect();
        Self { source: demonstrations.source.clone(), config: config.clone(), items }
    }

    /// The choices as the fit wants them, on the features of the reward.
    pub fn sets(&self) -> Vec<CandidateSet> {
        let indices = self.config.indices();
        let row = |vector: &[f64; FEATURES]| indices.iter().map(|index| vector[*index]).collect();
        let set = |item: &Choice| CandidateSet {
            features: item.candidates.features.iter().map(row).collect(),
            chosen: item.chosen,
        };
        self.items.iter().map(set).collect()
    }

    /// The group of each choice.
    pub fn labels(&self) -> Vec<&str> {
        self.items.iter().map(|item| item.group.as_str()).collect()
    }

    /// All groups, sorted.
    pub fn groups(&self) -> Vec<&str> {
        let mut groups = self.labels();
        groups.sort_unstable();
        groups.dedup();
        groups
    }

    /// The choices that `keep` picks.
    #[must_use]
    pub fn filtered(&self, keep: impl Fn(&Choice) -> bool) -> Self {
        let items = self.items.iter().filter(|item| keep(item)).cloned().collect();
        Self { items, source: self.source.clone(), config: self.config.clone() }
    }
}

/// When a change began and how long it took, s.
fn times_s(item: &Demonstration, config: &CandidateConfig) -> (f64, f64) {
    let recorded = item.device.kind() == Kind::Recorded;
    match config.driver_duration {
        DriverDuration::QuinticFit if recorded => fitted_quintic(&item.ego, config),
        DriverDuration::QuinticFit | DriverDuration::Record => (item.start_s, item.duration_s()),
    }
}

/// Speed with which all candidates of `item` begin, m/s, and where those without an offset end, m.
fn origin(item: &Demonstration, config: &CandidateConfig, start_s: f64) -> (f64, f64) {
    match config.ends {
        Ends::Driver => (item.mean_speed_mps(), item.end_d_m),
        Ends::Lane => (item.ego.state(start_s).speed_mps, item.target_d_m),
    }
}

/// What the driver of `item` could have done.
pub fn candidates(item: &Demonstration, config: &CandidateConfig) -> Candidates {
    let (start_s, _) = times_s(item, config);
    let (speed_mps, end_m) = origin(item, config, start_s);
    let start = LateralState { d_m: item.start_d_m, ..LateralState::default() };
    let motions = config.motions(start, end_m, speed_mps);
    let features = features_among(item, config, (&motions, start_s));
    Candidates { motions, features }
}

/// Features of `motions` that begin at `start_s` among the others of `item`, who do not react.
fn features_among(
    item: &Demonstration,
    config: &CandidateConfig,
    (motions, start_s): (&[Motion], f64),
) -> Vec<[f64; FEATURES]> {
    let start_m = item.ego.position_m(start_s).0;
    let half_lengths_m: Vec<f64> = item.others.iter().map(|other| 0.5 * (other.length_m + item.ego.length_m)).collect();
    let at = |other: usize, time_s: f64| {
        let TrackPoint { s_m, d_m, speed_mps, .. } = item.others[other].state(start_s + time_s);
        ForecastPoint { ahead_m: s_m - start_m, d_m, speed_mps }
    };
    let mut vectors = vec![[0.0; FEATURES]; motions.len()];
    let others = Surroundings { half_lengths_m: &half_lengths_m, at };
    features_of_set(&config.definition, &config.selection(), motions, &others, &mut vectors);
    vectors
}

/// `item` as a choice.
fn choice(item: &Demonstration, config: &CandidateConfig) -> Choice {
    let (start_s, duration_s) = times_s(item, config);
    let (speed_mps, center_m) = origin(item, config, start_s);
    let (end_s, start_m) = (start_s + duration_s, item.ego.position_m(start_s).0);
    let speed_change_mps = match config.ends {
        Ends::Driver => 0.0,
        Ends::Lane => item.ego.state(end_s).speed_mps - speed_mps,
    };
    let start = LateralState { d_m: item.start_d_m, ..LateralState::default() };
    let driver = Motion { lateral: Quintic::new(start, item.end_d_m, duration_s), speed_mps, speed_change_mps };
    let (durations_s, offsets_m) = (config.durations_s(), &config.end_offsets_m);
    let places = [
        nearest(&config.end_speed_changes_mps, speed_change_mps),
        nearest(&durations_s, duration_s),
        nearest(offsets_m, item.end_d_m - center_m),
    ];
    let at = |time_s: f64| {
        let (s_m, d_m) = item.ego.position_m(time_s);
        [time_s - start_s, s_m - start_m, d_m]
    };
    let way = item.ego.points.iter().filter(|point| (start_s..=end_s).contains(&point.time_s));
    Choice {
        group: item.group.clone(),
        candidates: candidates(item, config),
        chosen: (places[0] * durations_s.len() + places[1]) * offsets_m.len() + places[2],
        driver,
        driver_features: features_among(item, config, (&[driver], start_s))[0],
        driver_end_m: (at(end_s)[1], item.end_d_m),
        driver_way: way.map(|point| at(point.time_s)).collect(),
    }
}

/// The index of the value nearest to `wanted`, the first of two equally near.
fn nearest(values: &[f64], wanted: f64) -> usize {
    let distance = |index: usize| (values[index] - wanted).abs();
    (1..values.len()).fold(0, |best, index| if distance(index) < distance(best) { index } else { best })
}

/// Begin and duration, on the grid, of the quintic from rest to rest that fits the lateral `track` in the sense of least squares,
/// with free lateral begin and end. It must span the crossing of the line at t = 0.
fn fitted_quintic(track: &Track, config: &CandidateConfig) -> (f64, f64) {
    let mut best = (f64::INFINITY, 0.0, config.duration_min_s);
    for duration_s in config.durations_s() {
        let steps = (duration_s / config.duration_step_s).round() as u32;
        for step in 0..=steps {
            let start_s = -f64::from(step) * config.duration_step_s;
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

#[cfg(test)]
mod tests {
    use lanecraft_drive::road::Side;

    use super::*;
    use crate::data::events::{LaneChangeEvent, RoadKind};

    fn track(vehicle_id: u32, at: impl Fn(f64) -> (f64, f64)) -> Track {
        let point = |k: u32| {
            let time_s = -5.0 + 0.1 * f64::from(k);
            let (s_m, d_m) = at(time_s);
            TrackPoint { time_s, s_m, d_m, speed_mps: 15.0 + 0.2 * time_s }
        };
        Track { vehicle_id, length_m: 4.5, width_m: 1.8, points: (0..=100).map(point).collect() }
    }

    /// A change by 3.4 m to the right within 4.2 s, begun 2 s before the crossing, from 14.6 m/s on with 0.2 m/s², beside a car that
    /// keeps pace.
    fn event() -> LaneChangeEvent {
        let path = Quintic::new(LateralState { d_m: 1.0, ..LateralState::default() }, -2.4, 4.2);
        let way = |time_s: f64| time_s * (15.0 + 0.1 * time_s);
        LaneChangeEvent {
            id: "made up".into(),
            site: "here".into(),
            road: RoadKind::Freeway,
            side: Side::Right,
            start_s: -1.7,
            end_s: 1.9,
            start_d_m: 0.9,
            end_d_m: -2.3,
            target_d_m: -2.5,
            mean_speed_mps: 15.02,
            ego: track(1, |time_s| (way(time_s), path.at(time_s + 2.0).0)),
            neighbors: vec![track(2, |time_s| (way(time_s) + 8.0, -2.3))],
        }
    }

    fn made_up() -> Demonstrations {
        Demonstrations::recorded(&[event(), LaneChangeEvent { road: RoadKind::Arterial, ..event() }])
    }

    #[test]
    fn a_quintic_fitted_to_a_quintic_is_that_quintic() {
        let (start_s, duration_s) = fitted_quintic(&event().ego, &CandidateConfig::default());
        assert!((start_s + 2.0).abs() < 1e-9 && (duration_s - 4.2).abs() < 1e-9);
    }

    #[test]
    fn the_papers_candidates_share_all_but_the_duration() {
        let config = CandidateConfig { driver_duration: DriverDuration::Record, ..CandidateConfig::paper() };
        let choices = Choices::new(&made_up(), &config);
        let [item] = &choices.items[..] else { panic!("one freeway event") };
        assert_eq!((item.candidates.motions.len(), item.candidates.features.len()), (86, 86));
        assert!((item.candidates.motions[item.chosen].lateral.duration_s - 3.6).abs() < 1e-9);
        for motion in &item.candidates.motions {
            let end_m = motion.lateral.at(motion.lateral.duration_s).0;
            assert!((end_m + 2.3).abs() < 1e-9 && motion.speed_change_mps == 0.0);
            assert!((motion.speed_mps - 15.02).abs() < 1e-9, "{}", motion.speed_mps);
        }
        assert!((item.driver.lateral.duration_s - 3.6).abs() < 1e-9 && item.driver_features[1] > 0.0);
    }

    #[test]
    fn candidates_over_all_three_ends_begin_as_the_driver_and_know_nothing_of_the_end() {
        let wide = CandidateConfig { driver_duration: DriverDuration::QuinticFit, ..CandidateConfig::default().wide() };
        let choices = Choices::new(&made_up(), &wide);
        let [item] = &choices.items[..] else { panic!("one freeway event") };
        assert_eq!(item.candidates.motions.len(), 86 * 9);
        let chosen = item.candidates.motions[item.chosen];
        // 14.6 m/s at the begin of the fitted change; the speed gains 0.84 m/s, which is nearer to 0 than to 2; 0.2 m are nearer to
        // the center than to 0.4 m only by rounding, so both may be chosen.
        assert!((chosen.speed_mps - 14.6).abs() < 1e-9 && chosen.speed_change_mps == 0.0);
        assert!((item.driver.speed_change_mps - 0.84).abs() < 0.03, "{}", item.driver.speed_change_mps);
        assert!((chosen.lateral.duration_s - 4.2).abs() < 1e-9);
        let elsewhere = LaneChangeEvent { end_d_m: -2.0, ..event() };
        let other = Choices::new(&Demonstrations::recorded(&[elsewhere]), &wide);
        assert_eq!(other.items[0].candidates, item.candidates);
        assert!((other.items[0].candidates.motions[other.items[0].chosen].lateral.at(10.0).0 + 2.1).abs() < 1e-9);
    }

    #[test]
    fn a_bad_configuration_is_refused() {
        assert!(CandidateConfig::default().validate().is_ok() && CandidateConfig::paper().validate().is_ok());
        let refused = |config: CandidateConfig| config.validate().unwrap_err().to_string();
        for features in [vec![], vec!["mood".to_owned()], vec!["travel".to_owned(), "travel".to_owned()]] {
            let message = refused(CandidateConfig { features, ..CandidateConfig::default() });
            assert!(message.contains("candidates.features") && message.contains("\"stability\""), "{message}");
        }
        assert!(refused(CandidateConfig { duration_max_s: 1.0, ..CandidateConfig::default() }).contains("max_s"));
        assert!(
            refused(CandidateConfig { end_offsets_m: vec![0.4], ..CandidateConfig::default() }).contains("offsets")
        );
    }

    #[test]
    fn probabilities_sum_to_one_however_large_the_rewards() {
        let log_probabilities = log_probabilities(&[1e4, 1e4 - 1.0, -1e4]);
        let sum: f64 = log_probabilities.iter().map(|log| libm::exp(*log)).sum();
        assert!((sum - 1.0).abs() < 1e-12);
    }
}
