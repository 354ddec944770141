//! Synthetic skilled drivers, since the paper's fifty are not public: a noisy choice by known weights (probability ∝ exp ϖᵀH) among the
//! candidates, driven with an error in duration and in the lateral end position.

use lanecraft_drive::plan::{
    FEATURE_NAMES, FEATURES, FeatureConfig, LateralState, Motion, Quintic, RewardModel, Surroundings, features,
};
use lanecraft_drive::predict::ForecastPoint;
use lanecraft_net::random::Stream;

use super::{Demonstration, Demonstrations, Device};
use crate::candidates::{CandidateConfig, candidates, log_probabilities, rewards};
use crate::data::events::{Track, TrackPoint};

/// How synthetic drivers behave.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntheticConfig {
    /// Known cost weights on features divided by their typical sizes; a feature with 0 is none of the driver's.
    pub cost_weights: [f64; FEATURES],
    /// Standard deviation of the lateral end position, m.
    pub end_noise_m: f64,
    /// Standard deviation of the duration driven around the one chosen, s.
    pub duration_noise_s: f64,
}

impl Default for SyntheticConfig {
    fn default() -> Self {
        Self {
            // Durations of 2.5 s with a spread of about 0.25 s at 28 m/s, as those decoded from Table IV (1.9 to 2.8 s).
            cost_weights: [4.0, 4.0, 4.0, 24.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            end_noise_m: 0.08,
            duration_noise_s: 0.05,
        }
    }
}

/// Width of the lanes, m.
const LANE_WIDTH_M: f64 = 3.75;
/// Length and width of all cars, m.
const CAR_M: (f64, f64) = (4.8, 1.9);
/// Time between two points of the ego's track, s.
const TRACK_STEP_S: f64 = 0.1;

impl SyntheticConfig {
    /// The known reward: what a perfect fit would find.
    pub fn known_reward(&self, definition: &FeatureConfig) -> RewardModel {
        // Features of a change by 3.75 m within 2.5 s at 28 m/s on an ordinarily busy road, in the units asked for.
        let lateral = Quintic::new(LateralState::default(), LANE_WIDTH_M, 2.5);
        let motion = Motion { lateral, speed_mps: 28.0, speed_change_mps: 0.0 };
        let at = |vehicle: usize, time_s: f64| {
            let (ahead_m, speed_mps) = [(12.0, 28.0), (-16.0, 28.0), (40.0, 24.0)][vehicle];
            ForecastPoint { ahead_m: ahead_m + speed_mps * time_s, d_m: LANE_WIDTH_M, speed_mps }
        };
        let others = Surroundings { half_lengths_m: &[CAR_M.0], at };
        let typical = features(definition, &[true; FEATURES], &motion, &others);
        let weighed: Vec<usize> = (0..FEATURES).filter(|index| self.cost_weights[*index] != 0.0).collect();
        RewardModel {
            features: weighed.iter().map(|&index| FEATURE_NAMES[index].to_owned()).collect(),
            definition: definition.clone(),
            mean: vec![0.0; weighed.len()],
            scale: weighed.iter().map(|&index| typical[index].max(1e-6)).collect(),
            weights: weighed.iter().map(|&index| -self.cost_weights[index]).collect(),
            source: "known weights of synthetic drivers".to_owned(),
        }
    }
}

/// `count` lane changes, each of another driver who chooses among `config`'s candidates, in traffic drawn from `seed`.
pub fn synthetic(drivers: &SyntheticConfig, config: &CandidateConfig, seed: u64, count: u32) -> Demonstrations {
    let known = drivers.known_reward(&config.definition);
    Demonstrations {
        source: "synthetic drivers with known weights".to_owned(),
        items: (0..count).map(|driver| one(drivers, config, &known, (seed, driver))).collect(),
        known_reward: Some(known),
    }
}

fn one(
    drivers: &SyntheticConfig,
    config: &CandidateConfig,
    known: &RewardModel,
    (seed, driver): (u64, u32),
) -> Demonstration {
    let mut stream = Stream::keyed(seed, "irl.synthetic", u64::from(driver), 0);
    let speed_mps = stream.range(22.0, 31.0);
    // Leader in the old lane, leader and follower in the new one: distance between centers, speed, lateral position.
    let others = [
        (stream.range(20.0, 60.0), speed_mps - stream.range(0.0, 6.0), 0.0),
        (stream.range(20.0, 90.0), speed_mps + stream.range(-2.0, 3.0), LANE_WIDTH_M),
        (-stream.range(15.0, 70.0), speed_mps + stream.range(-4.0, 2.0), LANE_WIDTH_M),
    ];
    let mut numbers = 2..;
    let mut item = Demonstration {
        id: format!("driver {driver}"),
        group: format!("driver {driver}"),
        device: Device::Model,
        start_s: 0.0,
        end_s: config.duration_max_s,
        start_d_m: 0.0,
        end_d_m: LANE_WIDTH_M,
        target_d_m: LANE_WIDTH_M,
        ego: track(1, config.duration_max_s, |t| (speed_mps * t, 0.0, speed_mps)),
        others: others
            .iter()
            .map(|&(s_m, v, d_m)| track(numbers.next().unwrap_or(2), 0.0, |t| (s_m + v * t, d_m, v)))
            .collect(),
    };
    let offered = candidates(&item, config);
    let wish = offered.motions[draw(&rewards(known, &offered.features), stream.uniform())];
    item.end_s = wish.lateral.duration_s + drivers.duration_noise_s * stream.normal();
    item.end_d_m = wish.lateral.at(wish.lateral.duration_s).0 + drivers.end_noise_m * stream.normal();
    let lateral = Quintic::new(LateralState::default(), item.end_d_m, item.end_s);
    let course = Motion { lateral, ..wish }.course();
    item.ego = track(1, item.end_s, |time_s| {
        let (way_m, speed_mps, _) = course.at(time_s);
        (way_m, lateral.at(time_s).0, speed_mps)
    });
    item
}

/// A track from 0 to at least `until_s` by (s, d, speed) at a time.
fn track(vehicle_id: u32, until_s: f64, at: impl Fn(f64) -> (f64, f64, f64)) -> Track {
    let point = |step: u32| {
        let time_s = f64::from(step) * TRACK_STEP_S;
        let (s_m, d_m, speed_mps) = at(time_s);
        TrackPoint { time_s, s_m, d_m, speed_mps }
    };
    let steps = (until_s / TRACK_STEP_S).ceil() as u32;
    Track { vehicle_id, length_m: CAR_M.0, width_m: CAR_M.1, points: (0..=steps).map(point).collect() }
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
    use super::*;

    #[test]
    fn drivers_are_the_same_for_the_same_seed_and_as_quick_as_meant() {
        let (config, paper) = (SyntheticConfig::default(), CandidateConfig::paper());
        let drivers = synthetic(&config, &paper, 7, 300);
        assert_eq!(drivers, synthetic(&config, &paper, 7, 300));
        assert_ne!(drivers, synthetic(&config, &paper, 8, 300));
        let durations: Vec<f64> = drivers.items.iter().map(Demonstration::duration_s).collect();
        let mean_s = durations.iter().sum::<f64>() / 300.0;
        let variance = durations.iter().map(|t| (t - mean_s) * (t - mean_s)).sum::<f64>() / 300.0;
        assert!((2.2..2.8).contains(&mean_s) && (0.15..0.4).contains(&variance.sqrt()), "{mean_s} {variance}");
    }

    #[test]
    fn a_draw_is_at_its_quantile() {
        assert_eq!(draw(&[0.0, 0.0], 0.4), 0);
        assert_eq!(draw(&[0.0, 0.0], 0.6), 1);
        assert_eq!(draw(&[0.0, 0.0], 1.0), 1);
    }
}
