//! Refuses sizes and speeds that cannot be in the units of a format.

use std::path::Path;

use super::error::DataError;
use super::read::median;
use super::recording::{Recording, Sample};

/// Medians of vehicles' lengths that are believed, m.
const MEDIAN_LENGTHS_M: (f64, f64) = (2.5, 15.0);
/// Medians that are believed of the distance driven in a second over that which the speeds say.
const SPEED_RATIOS: (f64, f64) = (0.8, 1.25);
/// Distances that are enough to judge by.
const ENOUGH_RATIOS: u64 = 20;
/// Speed from which the ratio is taken, m/s: the noise of slower positions is no speed.
const FAST_MPS: f64 = 3.0;

/// Refuses `recordings` of the file at `path` whose units cannot be those of its format.
pub(super) fn check(path: &Path, recordings: &[Recording]) -> Result<(), DataError> {
    let lengths_m = recordings.iter().flat_map(|recording| &recording.vehicles).map(|vehicle| vehicle.length_m);
    let mut ratios = Vec::new();
    for recording in recordings {
        for vehicle in &recording.vehicles {
            let mut second = Second::default();
            ratios.extend(vehicle.samples.iter().filter_map(|sample| second.push(sample, recording.rate_hz)));
        }
    }
    check_medians(path, median(lengths_m.collect()), ratios.len() as u64, median(ratios))
}

/// The same by the median length and that of `count` ratios as [`Second`] gives them.
pub(super) fn check_medians(path: &Path, length_m: f64, count: u64, ratio: f64) -> Result<(), DataError> {
    let refuse = |what, measured, (min, max)| DataError::Units { path: path.to_owned(), what, measured, min, max };
    if !(MEDIAN_LENGTHS_M.0..=MEDIAN_LENGTHS_M.1).contains(&length_m) {
        return Err(refuse("the median length of a vehicle in meters", length_m, MEDIAN_LENGTHS_M));
    }
    if count >= ENOUGH_RATIOS && !(SPEED_RATIOS.0..=SPEED_RATIOS.1).contains(&ratio) {
        return Err(refuse("the speed by positions over the speed given", ratio, SPEED_RATIOS));
    }
    Ok(())
}

/// A second of a vehicle without gaps, as far as its samples have come, forward or backward in time.
#[derive(Clone, Copy, Default)]
pub(super) struct Second {
    begin: Option<Sample>,
    last_frame: i32,
    /// Frames from the first sample to the last one, below 0 if they come backward.
    frames: i32,
    speed_sum_mps: f64,
}

impl Second {
    /// Takes the next sample; where it completes a second in which the vehicle moves: the way by positions over the way by speeds.
    pub(super) fn push(&mut self, sample: &Sample, rate_hz: f64) -> Option<f64> {
        let step = sample.frame - self.last_frame;
        let follows = step.abs() == 1 && step * self.frames >= 0;
        let Some(begin) = self.begin.filter(|_| follows) else {
            let (begin, last_frame) = (Some(*sample), sample.frame);
            *self = Self { begin, last_frame, frames: 0, speed_sum_mps: sample.speed_mps };
            return None;
        };
        (self.last_frame, self.frames) = (sample.frame, self.frames + step);
        let second_s = f64::from(self.frames.abs()) / rate_hz;
        if f64::from(self.frames.abs()) < rate_hz.round().max(1.0) {
            self.speed_sum_mps += sample.speed_mps;
            return None;
        }
        let by_speed_m = self.speed_sum_mps / rate_hz;
        let by_position_m = libm::hypot(sample.x_m - begin.x_m, sample.y_m - begin.y_m);
        *self = Self::default();
        // Either may be in the wrong unit, so the faster one decides whether the vehicle moves.
        (by_speed_m.max(by_position_m) > FAST_MPS * second_s).then(|| by_position_m / by_speed_m.max(1e-3))
    }
}
