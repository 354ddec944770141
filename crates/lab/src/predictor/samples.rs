//! What the network learns from: what it was told of a vehicle, and how far the vehicle then moved off the plain forecast.

use lanecraft_drive::predict::lstm::{FEATURES, FRAME_PERIOD_S, FRAMES, OUTPUTS, Tracks, correction};
use lanecraft_drive::predict::{FORECAST_STEP_S, Forecast, Predictor};

use super::film::{Film, SCENE_S};

/// Times at which the forecast is held against the truth, s.
pub(super) const HORIZONS_S: [f64; 7] = [0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0];
/// Scenes between two samples of a film.
const EVERY: usize = 5;
/// Values that the network is told.
pub(super) const TOLD: usize = FRAMES * FEATURES;

/// One sample.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sample {
    /// Instants × features.
    pub(super) told: [f32; TOLD],
    /// How far the vehicle was off the plain forecast at each horizon, along and to the left, m; `None` where it was out of sight.
    pub(super) off_m: [Option<[f32; 2]>; HORIZONS_S.len()],
}

/// A sample of each vehicle of `film` twice a second, if it is in sight for a second or more after.
pub(super) fn samples(film: &Film) -> Vec<Sample> {
    let mut tracks = Tracks::new((FRAME_PERIOD_S / SCENE_S).round() as usize);
    let (mut told, mut forecast, mut samples) = (Vec::new(), Forecast::default(), Vec::new());
    for (index, scene) in film.scenes.iter().enumerate() {
        if index % EVERY == 0 {
            let vehicles = tracks.inputs(scene, &mut told);
            Predictor::ConstantVelocity.forecast(scene, &mut forecast);
            for (row, neighbor) in scene.neighbors.iter().enumerate().filter(|(_, neighbor)| film.counts(neighbor)) {
                let plain = forecast.track(row);
                let off_m = HORIZONS_S.map(|horizon_s| {
                    let (ahead_m, left_m) =
                        film.displacement_m((index, neighbor), index + (horizon_s / SCENE_S).round() as usize)?;
                    let point = plain[(horizon_s / FORECAST_STEP_S).round() as usize];
                    Some(
                        [ahead_m - (point.ahead_m - neighbor.ahead_m), left_m - (point.d_m - neighbor.d_m)]
                            .map(|off| off as f32),
                    )
                });
                if off_m[1].is_some() {
                    let mut own = [0.0; TOLD];
                    for (instant, own) in own.chunks_exact_mut(FEATURES).enumerate() {
                        let start = (instant * vehicles + row) * FEATURES;
                        own.copy_from_slice(&told[start..start + FEATURES]);
                    }
                    samples.push(Sample { told: own, off_m });
                }
            }
        }
        tracks.remember(scene);
    }
    samples
}

/// What each output adds to the forecast at each horizon, m: half of the outputs, the same along and across.
pub(super) fn effects() -> [[f32; OUTPUTS / 2]; HORIZONS_S.len()] {
    let mut effects = [[0.0; OUTPUTS / 2]; HORIZONS_S.len()];
    for output in 0..OUTPUTS / 2 {
        let mut said = [0.0; OUTPUTS / 2];
        said[output] = 1.0;
        let moved: Vec<(f64, f64)> = correction(&said).collect();
        for (effects, horizon_s) in effects.iter_mut().zip(HORIZONS_S) {
            effects[output] = moved[(horizon_s / FORECAST_STEP_S).round() as usize].0 as f32;
        }
    }
    effects
}
