//! How far forecasts are off, vehicle by vehicle, every predictor on the same scenes.

use std::collections::BTreeMap;

use lanecraft_drive::config::ConfigError;
use lanecraft_drive::predict::{FORECAST_STEP_S, Forecast, Forecaster, PredictionConfig, Predictor};
use serde::Serialize;

use super::film::{Film, SCENE_S};
use crate::metrics::Interval;
use crate::stats::{StatsError, mean_interval, paired_difference};

/// Times at which forecasts are judged, s.
pub const JUDGED_S: [f64; 4] = [0.5, 1.0, 2.0, 3.0];
/// Scenes between two forecasts that are judged.
const EVERY: usize = 5;
/// Scenes that a predictor may watch before it is judged.
const WATCHED: usize = 20;

/// Mean displacement error of each predictor at each time, for one vehicle.
type Means = [[f64; JUDGED_S.len()]; Predictor::ALL.len()];

/// Errors of all predictors on vehicles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Errors {
    /// One for each vehicle that was in sight for long enough.
    vehicles: Vec<Means>,
    forecasts: u64,
}

impl Errors {
    /// The errors on `film`; `config` has the weights of the recurrent network.
    ///
    /// # Errors
    /// If the weights were not loaded.
    pub fn on(film: &Film, config: &PredictionConfig) -> Result<Self, ConfigError> {
        let forecaster = |predictor| Forecaster::new(&PredictionConfig { predictor, ..config.clone() }, SCENE_S);
        let mut forecasters = Predictor::ALL.into_iter().map(forecaster).collect::<Result<Vec<_>, _>>()?;
        let mut forecast = Forecast::default();
        let mut sums: BTreeMap<u32, (Means, u32)> = BTreeMap::new();
        for (index, scene) in film.scenes.iter().enumerate() {
            for (predictor, forecaster) in forecasters.iter_mut().enumerate() {
                if index % EVERY == 0 && index >= WATCHED {
                    forecaster.forecast(scene, &mut forecast);
                    add(film, index, &forecast, predictor, &mut sums);
                }
                forecaster.remember(scene);
            }
        }
        let forecasts = sums.values().map(|(_, count)| u64::from(*count)).sum();
        let mean = |(sums, count): (Means, u32)| sums.map(|sums| sums.map(|sum| sum / f64::from(count)));
        Ok(Self { vehicles: sums.into_values().map(mean).collect(), forecasts })
    }

    /// Takes in those on other films.
    pub fn extend(&mut self, other: Self) {
        self.vehicles.extend(other.vehicles);
        self.forecasts += other.forecasts;
    }

    /// Number of vehicles.
    pub fn vehicles(&self) -> usize {
        self.vehicles.len()
    }

    /// Number of forecasts.
    pub fn forecasts(&self) -> u64 {
        self.forecasts
    }

    /// A row for each predictor and time.
    ///
    /// # Errors
    /// If there are fewer than two vehicles.
    pub fn rows(&self) -> Result<Vec<ErrorRow>, StatsError> {
        let of = |predictor: Predictor, time: usize| -> Vec<f64> {
            self.vehicles.iter().map(|means| means[predictor as usize][time]).collect()
        };
        let mut rows = Vec::new();
        for predictor in Predictor::ALL {
            for (time, horizon_s) in JUDGED_S.into_iter().enumerate() {
                let own = of(predictor, time);
                rows.push(ErrorRow {
                    predictor: predictor.name(),
                    horizon_s,
                    error_m: mean_interval(&own)?,
                    behind_lstm_m: paired_difference(&own, &of(Predictor::Lstm, time))?,
                });
            }
        }
        Ok(rows)
    }
}

/// Adds the errors of one predictor's forecasts of one scene.
fn add(film: &Film, index: usize, forecast: &Forecast, predictor: usize, sums: &mut BTreeMap<u32, (Means, u32)>) {
    for (row, neighbor) in film.scenes[index].neighbors.iter().enumerate().filter(|(_, n)| film.counts(n)) {
        let errors_m = JUDGED_S.map(|time_s| {
            let later = index + (time_s / SCENE_S).round() as usize;
            let (ahead_m, left_m) = film.displacement_m((index, neighbor), later)?;
            let point = forecast.track(row)[(time_s / FORECAST_STEP_S).round() as usize];
            let (off_ahead_m, off_left_m) =
                (point.ahead_m - neighbor.ahead_m - ahead_m, point.d_m - neighbor.d_m - left_m);
            Some(libm::hypot(off_ahead_m, off_left_m))
        });
        // All times are judged on the same forecasts.
        let [Some(a), Some(b), Some(c), Some(d)] = errors_m else { continue };
        let (sums, count) = sums.entry(neighbor.id.0).or_default();
        sums[predictor].iter_mut().zip([a, b, c, d]).for_each(|(sum, error_m)| *sum += error_m);
        *count += u32::from(predictor == 0);
    }
}

/// How far one predictor is off after one time: means over vehicles with 95 % intervals.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorRow {
    /// Which.
    pub predictor: &'static str,
    /// After how long, s.
    pub horizon_s: f64,
    /// Distance between forecast and truth, m.
    pub error_m: Interval,
    /// How much further off than the recurrent network, vehicle by vehicle, m.
    pub behind_lstm_m: Interval,
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use lanecraft_drive::road::{LaneIndex, Road, RoadConfig, Topology};
    use lanecraft_drive::scene::{Neighbor, VehicleId};

    use super::*;
    use crate::predictor::film::onlooker;

    #[test]
    fn a_car_that_accelerates_is_seen_by_the_one_predictor_and_missed_by_the_other() {
        let road = RoadConfig { topology: Topology::Open, ..RoadConfig::default() };
        let road = Arc::new(Road::new(road).unwrap());
        let scene = |index: i32| {
            let time_s = 0.1 * f64::from(index);
            let car = |id: u32, accel_mps2: f64| Neighbor {
                accel_mps2,
                speed_mps: 20.0 + accel_mps2 * time_s,
                ..Neighbor::car(
                    VehicleId(id),
                    LaneIndex(0),
                    0.0,
                    100.0 * f64::from(id) + 20.0 * time_s + 0.5 * accel_mps2 * time_s * time_s,
                    20.0,
                )
            };
            onlooker(&road, vec![car(1, 0.0), car(2, 1.0)])
        };
        let film = Film::standing("here".into(), (0..81).map(scene).collect());
        let errors = Errors::on(&film, &PredictionConfig::default()).unwrap();
        // From 2 s to 5 s every half second, three seconds ahead of each.
        assert_eq!((errors.vehicles(), errors.forecasts()), (2, 14));
        for row in errors.rows().unwrap() {
            let missed_m = 0.25 * row.horizon_s * row.horizon_s;
            let expected_m = match row.predictor {
                "constant-velocity" => missed_m,
                "constant-acceleration" => 0.0,
                _ => continue,
            };
            assert!((row.error_m.mean - expected_m).abs() < 1e-9, "{row:?}");
        }
    }
}
