//! What was seen of each vehicle lately: the short memory of the perception.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::features::{Features, features};
use super::{FEATURES, FRAMES};
use crate::scene::{Scene, VehicleId};

/// Vehicles at one instant, by their order along the road.
type Frame = Vec<(VehicleId, Features)>;

/// The tracks of all vehicles in sight, at every step for as long as the network looks back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tracks {
    /// Steps between two instants that the network is told of.
    stride: usize,
    /// The oldest first; the present is not among them until it is remembered. Each by rising id.
    frames: VecDeque<Frame>,
    #[serde(skip)]
    present: Frame,
}

impl Tracks {
    /// No tracks; the network is told of every `stride`-th step.
    pub fn new(stride: usize) -> Self {
        Self { stride, frames: VecDeque::with_capacity((FRAMES - 1) * stride + 1), present: Vec::new() }
    }

    /// Takes `scene` into the tracks, once for each step.
    pub fn remember(&mut self, scene: &Scene) {
        let full = self.frames.len() == (FRAMES - 1) * self.stride;
        let mut frame = if full { self.frames.pop_front().unwrap_or_default() } else { Frame::new() };
        features(scene, &mut frame);
        frame.sort_unstable_by_key(|(id, _)| *id);
        self.frames.push_back(frame);
    }

    /// Writes what the network is told, instants × vehicles × features with the present as the last instant, and returns the number of
    /// vehicles: those of `scene` in its order, without the ends of lanes. Where a vehicle was not in sight yet, its first instant stands.
    pub fn inputs(&mut self, scene: &Scene, inputs: &mut Vec<f32>) -> usize {
        features(scene, &mut self.present);
        let vehicles = self.present.len();
        inputs.clear();
        inputs.resize(FRAMES * vehicles * FEATURES, 0.0);
        for (row, (id, now)) in self.present.iter().enumerate() {
            let mut known = *now;
            for back in 0..FRAMES {
                known = if back == 0 { known } else { self.at(*id, back).unwrap_or(known) };
                let start = ((FRAMES - 1 - back) * vehicles + row) * FEATURES;
                inputs[start..start + FEATURES].copy_from_slice(&known);
            }
        }
        vehicles
    }

    /// A vehicle so many instants ago.
    fn at(&self, id: VehicleId, back: usize) -> Option<Features> {
        let frame = &self.frames[self.frames.len().checked_sub(back * self.stride)?];
        frame.binary_search_by_key(&id, |(id, _)| *id).ok().map(|place| frame[place].1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predict::tests::{neighbor, scene};
    use crate::scene::Neighbor;

    /// Vehicle 1 at the speed of 20 m/s and ten times `step`, and a second one from step 5 on.
    fn at_step(step: u32) -> Scene {
        let speed_mps = 20.0 + 10.0 * f64::from(step);
        let mut neighbors = vec![neighbor(10.0, speed_mps, 1)];
        if step >= 5 {
            neighbors.insert(0, Neighbor { id: VehicleId(7), ..neighbor(-40.0, speed_mps, 0) });
        }
        scene(neighbors)
    }

    /// The first feature, speed beyond 20 m/s in tens, of each instant for the vehicle in this row.
    fn speeds(inputs: &[f32], vehicles: usize, row: usize) -> Vec<f32> {
        (0..FRAMES).map(|instant| inputs[(instant * vehicles + row) * FEATURES]).collect()
    }

    #[test]
    fn the_network_is_told_of_every_stride_th_step_back_from_now() {
        let (mut tracks, mut inputs) = (Tracks::new(3), Vec::new());
        for step in 0..100 {
            let vehicles = tracks.inputs(&at_step(step), &mut inputs);
            assert_eq!(vehicles, 1 + usize::from(step >= 5));
            let expected = |first: u32| -> Vec<f32> {
                let step_at = |instant: u32| step.saturating_sub(3 * (FRAMES as u32 - 1 - instant));
                (0..FRAMES as u32).map(|instant| step_at(instant).max(first + (step - first) % 3) as f32).collect()
            };
            if step >= 5 {
                assert_eq!(speeds(&inputs, vehicles, 0), expected(5), "step {step}");
            }
            assert_eq!(speeds(&inputs, vehicles, vehicles - 1), expected(0), "step {step}");
            tracks.remember(&at_step(step));
        }
    }
}
