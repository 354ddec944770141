//! What the decision layer sees: a fixed number of values of the scene, scaled to about one and always within finite bounds.
//!
//! The paper gives the state as raw positions and differences in meters, with an absolute X that grows without bound; that form is
//! kept for the preset `paper`. The default drops X and adds what makes the state Markov: lanes that exist, the phase of a lane
//! change, the allowed changes and the traffic further ahead (departure 7 in `docs/deviations.md`). The third form is an occupancy
//! grid for convolutional networks. `docs/observations.md` lists every value of every form.

mod features;
mod grid;
mod raw;

use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, check_range};
use crate::road::{LaneIndex, Side};
use crate::scene::Scene;

/// Which values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObservationForm {
    /// Scaled features of six slots, the ego and the traffic ahead.
    Features,
    /// `[Y, X, V]` of the ego and the six differences, in meters, as printed.
    Raw,
    /// Occupancy grid around the ego: channels × lanes × cells along the road.
    Grid,
}

/// The observation's parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObservationConfig {
    /// Which values.
    pub form: ObservationForm,
    /// Vehicles further away than this leave their slot empty; the grid reaches as far, m.
    pub range_m: f64,
    /// Length of a cell of the grid, m.
    pub cell_length_m: f64,
    /// Lanes of the grid to the left of the ego's, and as many to its right.
    pub lanes_each_side: u8,
}

impl Default for ObservationConfig {
    fn default() -> Self {
        Self { form: ObservationForm::Features, range_m: 100.0, cell_length_m: 5.0, lanes_each_side: 1 }
    }
}

impl ObservationConfig {
    /// Checks every range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_range("observation.range_m", self.range_m, 10.0, 200.0)?;
        check_range("observation.cell_length_m", self.cell_length_m, 1.0, 50.0)?;
        check_range("observation.lanes_each_side", f64::from(self.lanes_each_side), 0.0, 7.0)
    }

    /// The sizes of its axes: one number for a list, three (channels, lanes, cells) for the grid. Values are row-major.
    pub fn shape(&self) -> Vec<usize> {
        match self.form {
            ObservationForm::Features | ObservationForm::Raw => vec![self.size()],
            ObservationForm::Grid => vec![grid::CHANNELS, grid::lanes(self), grid::cells(self)],
        }
    }

    /// Number of values.
    pub fn size(&self) -> usize {
        match self.form {
            ObservationForm::Features => features::SIZE,
            ObservationForm::Raw => raw::SIZE,
            ObservationForm::Grid => grid::CHANNELS * grid::lanes(self) * grid::cells(self),
        }
    }

    /// The lowest and the highest value that each place can have, in the order of the values.
    pub fn bounds(&self) -> (Vec<f32>, Vec<f32>) {
        (0..self.size()).map(|place| self.bound(place)).unzip()
    }

    fn bound(&self, place: usize) -> (f32, f32) {
        match self.form {
            ObservationForm::Features => features::bound(place),
            ObservationForm::Raw => raw::bound(place, self.range_m),
            ObservationForm::Grid => grid::bound(place / (grid::lanes(self) * grid::cells(self))),
        }
    }
}

/// Front and rear in the left, the own and the right lane.
const SLOTS: usize = 6;
const LANES_SEEN: usize = 3;
/// Speed differences are divided by this, m/s.
const SPEED_SCALE_MPS: f64 = 10.0;
/// Accelerations are divided by this, m/s².
const ACCEL_SCALE_MPS2: f64 = 3.0;
/// The speed that is seen as 0, m/s.
const MIDDLE_SPEED_MPS: f64 = 25.0;
/// The time since the last lane change is seen up to this, s.
const MEMORY_S: f64 = 10.0;

/// What the scene does not hold: where the ego is in its own lane change and what it may do next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Situation {
    /// Elapsed share of the lane change under way, 0 while keeping.
    pub progress: f64,
    /// Time since the last lane change ended, s.
    pub since_change_s: f64,
    /// Whether a change to the left and to the right is allowed now.
    pub allowed: [bool; 2],
    /// Distance driven since the start, m (only the raw form shows it).
    pub driven_m: f64,
}

/// Writes the observation into `out`, whose length is [`ObservationConfig::size`].
///
/// Values that leave their bounds are clipped: the bounds are so wide that this takes a car off the road or noise of many
/// standard deviations.
pub fn observe(config: &ObservationConfig, scene: &Scene, situation: &Situation, out: &mut [f32]) {
    debug_assert_eq!(out.len(), config.size());
    match config.form {
        ObservationForm::Features => features::write(config, scene, situation, &mut Writer { out, at: 0 }),
        ObservationForm::Raw => raw::write(config, scene, situation, &mut Writer { out, at: 0 }),
        ObservationForm::Grid => grid::write(config, scene, situation, out),
    }
    for (place, value) in out.iter_mut().enumerate() {
        let (low, high) = config.bound(place);
        *value = value.clamp(low, high);
    }
}

struct Writer<'a> {
    out: &'a mut [f32],
    at: usize,
}

impl Writer<'_> {
    fn push(&mut self, values: &[f64]) {
        for &value in values {
            self.out[self.at] = value as f32;
            self.at += 1;
        }
    }
}

/// Left, own and right lane, where they exist.
fn lanes_seen(scene: &Scene) -> [Option<LaneIndex>; LANES_SEEN] {
    let beside = |side| scene.beside(scene.ego_lane, side);
    [beside(Side::Left), Some(scene.ego_lane), beside(Side::Right)]
}

fn flag(value: bool) -> f64 {
    f64::from(u8::from(value))
}

#[cfg(test)]
mod tests;
