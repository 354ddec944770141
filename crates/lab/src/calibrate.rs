//! Human drivers' parameters from recorded traffic.
//!
//! Each follower is driven by a law of car following behind its recorded leader, and the parameters are those whose gaps come
//! nearest (Treiber and Kesting, 2013, chapter 17; `laws`). Parameters common to all drivers are judged on the sites that they
//! have not seen, each left out in turn, beside laws that know less. Drivers who were recorded for long enough have parameters of
//! their own, whose spread becomes the distributions of `[traffic]`.

mod episodes;
mod lane_changes;
mod laws;
mod output;
mod search;

use std::collections::BTreeMap;
use std::path::Path;

use lanecraft_drive::config::ConfigError;
use lanecraft_drive::models::car_following::CarFollowing;
use lanecraft_drive::scenario::{Distribution, ScenarioError, TrafficConfig};
use lanecraft_net::random::Stream;
use rayon::prelude::*;
use serde::Serialize;

pub use self::episodes::{Episode, Motion, episodes};
pub use self::lane_changes::{LaneChanges, ModelTraffic};
pub use self::laws::{Errors, Kind, Law};
use self::laws::{IDM_RANGES, IDM_START, fit_driver, fit_model, idm_params};
use crate::data::TableError;
use crate::data::traffic::{TrafficSite, read_traffic};
use crate::metrics::Interval;

/// Shortest episode, s. Textbooks ask for more, but the prepared recording is cut into scenes of 5 to 30 s: 14 episodes of two
/// sites last 15 s, and no site could be left out.
const SHORTEST_EPISODE_S: f64 = 5.0;
/// Shortest episode that a driver's own parameters are fitted to, s.
const SHORTEST_OWN_S: f64 = 10.0;
/// Resamples of drivers for the intervals of the errors.
const RESAMPLES: u64 = 1000;
/// Resamples of drivers that the common parameters are fitted to again.
const REFITS: u64 = 100;
/// Episodes that are shown.
const SHOWN: usize = 4;
/// A driver's parameter this near to an end of its range, in shares of it, was not found but stopped there.
const WALL: f64 = 0.01;

/// Why drivers could not be calibrated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// The recording cannot be read.
    #[error(transparent)]
    Data(#[from] TableError),
    /// No site has such a name.
    #[error("no site of the recording has a name that begins with `{prefix}`; its sites are {}", names.join(", "))]
    NoSites {
        /// What names were to begin with.
        prefix: String,
        /// All names.
        names: Vec<String>,
    },
    /// Too little car following.
    #[error(
        "{sites} sites with at least {SHORTEST_EPISODE_S} s behind one leader and {drivers} drivers with {SHORTEST_OWN_S} s, but it takes 2 of each"
    )]
    TooFew {
        /// Sites with episodes.
        sites: usize,
        /// Drivers with long ones.
        drivers: usize,
    },
    /// The traffic found is not valid.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The traffic found cannot be driven.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
}

/// A parameter of IDM.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Its key in `[traffic]`.
    pub key: &'static str,
    /// Common to all drivers, with the interval over resampled drivers.
    pub pooled: Interval,
    /// Of each driver with a long episode, rising; empty if it is common to all.
    pub drivers: Vec<f64>,
    /// Share of them at an end of the range searched.
    pub at_wall: f64,
    /// What the traffic is given.
    pub distribution: Distribution,
}

/// How far a law is off on sites that it has not seen, with intervals over resampled drivers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// The law.
    pub law: &'static str,
    /// Root mean square error of the gap, m.
    pub gap_rmse_m: Interval,
    /// Root mean square error of the speed, m/s.
    pub speed_rmse_mps: Interval,
    /// Root mean square error of the gap in shares of the recorded gap.
    pub relative_gap_error: Interval,
}

/// A driver's episode with what its own parameters and the common ones make of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// What was recorded.
    pub episode: Episode,
    /// The driver's own law.
    pub own: Law,
}

/// What a recording says about its drivers.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Names of all sites, by their index in the episodes.
    pub sites: Vec<String>,
    /// Number of sites with episodes.
    pub sites_used: usize,
    /// Number of drivers.
    pub drivers: usize,
    /// Number of episodes.
    pub episodes: usize,
    /// Their duration in all, s.
    pub duration_s: f64,
    /// The parameters v₀, T, s₀, a and b.
    pub parameters: Vec<Parameter>,
    /// The laws, the fitted one first.
    pub judged: Vec<Judged>,
    /// How far the drivers' own parameters are off on the episodes they were fitted to: what a perfect guess of them would reach.
    pub own_gap_rmse_m: f64,
    /// Some long episodes.
    pub shown: Vec<Shown>,
    /// The law with the common parameters.
    pub law: Law,
    /// Lane changes of the recording.
    pub lane_changes: LaneChanges,
    /// Those of the model at the recorded density: as it is by default, and with what was found.
    pub model_traffic: [ModelTraffic; 2],
    /// What was found, laid over the default.
    pub traffic: TrafficConfig,
}

/// Keys of the parameters, in the order of [`IDM_RANGES`].
const KEYS: [&str; 5] = ["desired_speed_mps", "time_headway_s", "min_gap_m", "max_accel_mps2", "comfort_decel_mps2"];

/// Which of them each driver has for itself.
const OWN: [bool; 5] = [false, true, false, true, false];

/// Calibrates the drivers of the sites in `folder` whose names begin with `prefix`.
///
/// # Errors
/// If the recording cannot be read, or has too little car following.
pub fn calibrate(folder: &Path, prefix: &str) -> Result<Calibration, CalibrateError> {
    let (sites, others): (Vec<TrafficSite>, Vec<TrafficSite>) =
        read_traffic(folder)?.into_iter().partition(|site| site.name.starts_with(prefix));
    if sites.is_empty() {
        let names = others.into_iter().map(|site| site.name).collect();
        return Err(CalibrateError::NoSites { prefix: prefix.to_owned(), names });
    }
    calibrate_sites(&sites)
}

/// Calibrates the drivers of these sites.
///
/// # Errors
/// If there is too little car following.
pub fn calibrate_sites(sites: &[TrafficSite]) -> Result<Calibration, CalibrateError> {
    let found = episodes(sites, SHORTEST_EPISODE_S);
    let mut by_site: Vec<usize> = found.iter().map(|episode| episode.site).collect();
    by_site.dedup();
    let all: Vec<&Episode> = found.iter().collect();
    let long: Vec<&Episode> = all.iter().copied().filter(|e| e.duration_s() >= SHORTEST_OWN_S).collect();
    let (drivers, long_drivers) = (by_driver(&all), by_driver(&long));
    if by_site.len() < 2 || long_drivers.len() < 2 {
        return Err(CalibrateError::TooFew { sites: by_site.len(), drivers: long_drivers.len() });
    }
    let pooled = fit_model(CarFollowing::Idm, &all, IDM_START);
    let own: Vec<[f64; 5]> =
        long_drivers.par_iter().map(|episodes| fit_driver(CarFollowing::Idm, episodes, pooled)).collect();
    let parameters = parameters(pooled, &own, &refits(pooled, &drivers));
    let traffic = traffic(&parameters);
    traffic.validate()?;
    let lane_changes = lane_changes::recorded(sites);
    Ok(Calibration {
        sites: sites.iter().map(|site| site.name.clone()).collect(),
        sites_used: by_site.len(),
        drivers: drivers.len(),
        episodes: all.len(),
        duration_s: all.iter().map(|episode| episode.duration_s()).sum(),
        judged: judge(&all, &by_site),
        own_gap_rmse_m: total(long_drivers.iter().zip(&own).map(|(episodes, p)| sum(&idm(*p), episodes))).gap_rmse_m(),
        shown: shown(&long_drivers, &own),
        law: idm(pooled),
        model_traffic: model_traffic(&lane_changes, &traffic)?,
        lane_changes,
        parameters,
        traffic,
    })
}

/// IDM with v₀, T, s₀, a and b.
fn idm(parameters: [f64; 5]) -> Law {
    Law::Model(CarFollowing::Idm, idm_params(parameters))
}

/// Evenly over the drivers, whose order has nothing to do with how well they fit.
fn shown(drivers: &[Vec<&Episode>], own: &[[f64; 5]]) -> Vec<Shown> {
    let some = drivers.iter().zip(own).step_by(drivers.len().div_ceil(SHOWN));
    some.map(|(episodes, p)| Shown { episode: episodes[0].clone(), own: idm(*p) }).collect()
}

/// The default and the calibrated traffic at the recorded density.
fn model_traffic(recorded: &LaneChanges, calibrated: &TrafficConfig) -> Result<[ModelTraffic; 2], ScenarioError> {
    let density_veh_per_km_lane = recorded.density_veh_per_km_lane.min(200.0);
    let simulate = |traffic: &TrafficConfig| {
        lane_changes::simulated(&TrafficConfig { density_veh_per_km_lane, ..traffic.clone() })
    };
    Ok([simulate(&TrafficConfig::default())?, simulate(calibrated)?])
}

/// The episodes of each driver, by site and vehicle.
fn by_driver<'a>(episodes: &[&'a Episode]) -> Vec<Vec<&'a Episode>> {
    let mut drivers: BTreeMap<(usize, u32), Vec<&Episode>> = BTreeMap::new();
    for episode in episodes {
        drivers.entry(episode.driver()).or_default().push(episode);
    }
    drivers.into_values().collect()
}

/// As many drivers drawn with replacement, by number of the resample.
fn resample<T>(drivers: &[T], number: u64) -> impl Iterator<Item = &T> {
    let mut stream = Stream::keyed(0, "calibrate.bootstrap", number, 0);
    (0..drivers.len()).map(move |_| &drivers[stream.below(drivers.len())])
}

/// The common parameters of resampled drivers.
fn refits(pooled: [f64; 5], drivers: &[Vec<&Episode>]) -> Vec<[f64; 5]> {
    let refit = |number| {
        let episodes: Vec<&Episode> = resample(drivers, number).flatten().copied().collect();
        fit_model(CarFollowing::Idm, &episodes, pooled)
    };
    (0..REFITS).into_par_iter().map(refit).collect()
}

fn parameters(pooled: [f64; 5], own: &[[f64; 5]], refits: &[[f64; 5]]) -> Vec<Parameter> {
    let sorted = |points: &[[f64; 5]], index: usize| {
        let mut values: Vec<f64> = points.iter().map(|point| point[index]).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let parameter = |(index, key)| {
        let (value, (low, high)) = (pooled[index], IDM_RANGES[index]);
        let drivers = if OWN[index] { sorted(own, index) } else { Vec::new() };
        let near = WALL * (high - low);
        let at_wall = drivers.iter().filter(|value| **value < low + near || **value > high - near).count();
        let distribution = if OWN[index] { spread(&drivers) } else { Distribution::fixed(rounded(value)) };
        Parameter {
            key,
            pooled: interval(value, &sorted(refits, index)),
            at_wall: at_wall as f64 / drivers.len().max(1) as f64,
            drivers,
            distribution,
        }
    };
    KEYS.into_iter().enumerate().map(parameter).collect()
}

/// A figure with the 95 % interval of its sorted resamples.
fn interval(mean: f64, resamples: &[f64]) -> Interval {
    Interval { mean, low: quantile(resamples, 0.025), high: quantile(resamples, 0.975) }
}

/// A quantile of sorted values, between two of them linearly; NaN of none.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    if sorted.is_empty() {
        return f64::NAN;
    }
    let at = share * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    below + (at - at.floor()) * (above - below)
}

/// The default traffic with the drivers found.
fn traffic(parameters: &[Parameter]) -> TrafficConfig {
    let found = |index: usize| parameters[index].distribution;
    TrafficConfig {
        desired_speed_mps: found(0),
        time_headway_s: found(1),
        min_gap_m: found(2),
        max_accel_mps2: found(3),
        comfort_decel_mps2: found(4),
        ..TrafficConfig::default()
    }
}

/// The spread of sorted values of drivers.
fn spread(drivers: &[f64]) -> Distribution {
    let of = |share| quantile(drivers, share);
    // The quartiles of a normal distribution lie 1.349 deviations apart; unlike its moments they care nothing for the walls.
    let sd = rounded((of(0.75) - of(0.25)) / 1.349).max(0.01);
    Distribution::Normal { mean: rounded(of(0.5)), sd, min: rounded(of(0.05)), max: rounded(of(0.95)) }
}

/// Two decimals are more than the recording tells.
fn rounded(value: f64) -> f64 {
    (100.0 * value).round() / 100.0
}

/// Every law on the sites that it has not seen.
fn judge(episodes: &[&Episode], sites: &[usize]) -> Vec<Judged> {
    let fitted = [
        ("idm, fitted", Kind::Model(CarFollowing::Idm)),
        ("enhanced-idm, fitted", Kind::Model(CarFollowing::EnhancedIdm)),
        ("constant headway, fitted", Kind::ConstantHeadway),
    ];
    let default = default_law();
    let fixed = [("idm, default", default), ("keeps its gap", Law::KeepGap)];
    let fitted = fitted.into_iter().map(|(name, kind)| judged(name, &left_out(episodes, sites, kind)));
    let fixed = fixed.into_iter().map(|(name, law)| {
        let drivers = by_driver(episodes);
        judged(name, &drivers.iter().map(|episodes| sum(&law, episodes)).collect::<Vec<_>>())
    });
    fitted.collect::<Vec<_>>().into_iter().chain(fixed).collect()
}

/// IDM with the mean of each default distribution.
fn default_law() -> Law {
    let middle = |distribution: Distribution| {
        let (low, high) = distribution.bounds();
        0.5 * (low + high)
    };
    let t = TrafficConfig::default();
    let distributions = [t.desired_speed_mps, t.time_headway_s, t.min_gap_m, t.max_accel_mps2, t.comfort_decel_mps2];
    idm(distributions.map(middle))
}

/// Errors of each driver under the law that was fitted to the other sites.
fn left_out(episodes: &[&Episode], sites: &[usize], kind: Kind) -> Vec<Errors> {
    let of_site = |site: &usize| {
        let (unseen, seen): (Vec<&Episode>, Vec<&Episode>) =
            episodes.iter().copied().partition(|episode| episode.site == *site);
        let law = kind.fit(&seen);
        by_driver(&unseen).iter().map(|episodes| sum(&law, episodes)).collect::<Vec<_>>()
    };
    sites.par_iter().flat_map_iter(of_site).collect()
}

fn sum(law: &Law, episodes: &[&Episode]) -> Errors {
    total(episodes.iter().map(|episode| law.errors(episode)))
}

fn total(errors: impl Iterator<Item = Errors>) -> Errors {
    let mut total = Errors::default();
    errors.for_each(|errors| total += errors);
    total
}

fn judged(law: &'static str, drivers: &[Errors]) -> Judged {
    let all = total(drivers.iter().copied());
    let resamples: Vec<Errors> = (0..RESAMPLES).map(|number| total(resample(drivers, number).copied())).collect();
    let figure = |of: fn(&Errors) -> f64| {
        let mut values: Vec<f64> = resamples.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        interval(of(&all), &values)
    };
    Judged {
        law,
        gap_rmse_m: figure(Errors::gap_rmse_m),
        speed_rmse_mps: figure(Errors::speed_rmse_mps),
        relative_gap_error: figure(Errors::relative_gap_error),
    }
}

#[cfg(test)]
mod tests {
    use super::laws::tests::made_up;
    use super::*;
    use crate::data::traffic::{TrafficPoint, TrafficTrack};

    /// Sites of pairs of a leader and a follower with these parameters and its own headway, each pair in a lane of its own.
    fn sites(count: usize, headways_s: &[f64]) -> Vec<TrafficSite> {
        let track = |vehicle_id, lane, motions: &[Motion]| TrafficTrack {
            vehicle_id,
            length_m: 5.0,
            points: (0..)
                .zip(motions)
                .map(|(frame, motion)| TrafficPoint { frame, lane, s_m: motion.s_m, speed_mps: motion.speed_mps })
                .collect(),
        };
        let site = |site| {
            let tracks = (0..).zip(headways_s).flat_map(|(id, &headway_s)| {
                let law = Law::Model(CarFollowing::Idm, idm_params([25.0, headway_s, 3.0, 1.8, 1.2]));
                let episode = made_up(&law, site, 7 * site as u32 + id, 12.0);
                [track(2 * id, id, &episode.leader), track(2 * id + 1, id, &episode.follower)]
            });
            TrafficSite { name: format!("site {site}"), tracks: tracks.collect() }
        };
        (0..count).map(site).collect()
    }

    #[test]
    fn known_drivers_are_found_on_sites_left_out() {
        let found = calibrate_sites(&sites(2, &[0.8, 1.2])).unwrap();
        assert_eq!((found.sites_used, found.drivers, found.episodes), (2, 4, 4));
        let [v0, headway, min_gap, ..] = &found.parameters[..] else { panic!("five parameters") };
        // The common headway lies among those of the drivers, and each has nearly its own.
        assert!((headway.pooled.mean - 1.0).abs() < 0.1 && headway.pooled.low > 0.75 && headway.pooled.high < 1.25);
        assert!((headway.drivers[0] - 0.8).abs() < 0.1 && (headway.drivers[3] - 1.2).abs() < 0.1, "{headway:?}");
        assert!((v0.pooled.mean / 25.0 - 1.0).abs() < 0.2 && (min_gap.pooled.mean - 3.0).abs() < 1.0);
        let [fitted, .., default, keeps] = &found.judged[..] else { panic!("laws") };
        let others_m = default.gap_rmse_m.mean.min(keeps.gap_rmse_m.mean);
        assert!(fitted.gap_rmse_m.mean < 0.8 * others_m, "{:?}", found.judged);
        // What is written is what was found, and can be read back.
        let text = format!("[traffic]\n{}", found.overlay_toml().split_once("[traffic]\n").unwrap().1);
        let read: BTreeMap<String, TrafficConfig> = toml::from_str(&text).unwrap();
        assert_eq!(read["traffic"], found.traffic);
        assert!(found.report().text().contains("idm, fitted"));
    }

    #[test]
    fn too_little_is_refused() {
        let message = |sites: &[TrafficSite]| calibrate_sites(sites).unwrap_err().to_string();
        assert!(message(&sites(1, &[1.0, 1.2])).starts_with("1 sites with at least 5 s"));
        assert!(message(&[]).starts_with("0 sites"));
    }

    #[test]
    fn the_recording_is_read_and_cut_into_episodes() {
        let Ok(data) = std::env::var("LANECRAFT_DATA") else {
            println!("skipped: LANECRAFT_DATA names no folder with recorded lane changes");
            return;
        };
        let folder = Path::new(&data).join("ngsim-lane-changes");
        let mut sites = read_traffic(&folder).unwrap();
        sites.retain(|site| site.name.starts_with("us101"));
        let count = |shortest_s| episodes(&sites, shortest_s).len();
        // Counted by another program over the same file.
        assert_eq!((sites.len(), count(5.0), count(10.0), count(15.0)), (11, 337, 58, 14));
        let message = calibrate(&folder, "us102").unwrap_err().to_string();
        assert!(message.contains("`us102`") && message.contains("us101-g13"), "{message}");
    }

    #[test]
    fn quantiles_lie_between_values() {
        assert_eq!([0.0, 0.25, 0.5, 1.0].map(|share| quantile(&[1.0, 2.0, 4.0], share)), [1.0, 1.5, 2.0, 4.0]);
        assert!(quantile(&[], 0.5).is_nan());
    }
}
