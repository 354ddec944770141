//! Lane changes as people drove them, from which a reward is learned: recorded, made up by known weights, or driven at the wheel.
//!
//! All three kinds come in one format (see [`file`](mod@file) and `docs/human-reward.md`), tagged with the device that made them, so that whatever is
//! learned from one kind can be learned from the others. What a driver could have done instead is not part of it: see
//! [`candidates`](crate::candidates).

pub mod file;
pub mod synthetic;

use lanecraft_drive::plan::RewardModel;
use serde::{Deserialize, Serialize};

use crate::data::events::{LaneChangeEvent, RoadKind, Track};

/// What a demonstration was made with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Device {
    /// Cameras over a road.
    Camera,
    /// A driver of known weights.
    Model,
    /// Keys, in the driving seat of this program.
    Keyboard,
    /// A gamepad, in the driving seat.
    Gamepad,
    /// A steering wheel with pedals, in the driving seat.
    Wheel,
}

/// Kind of a demonstration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Of real traffic.
    Recorded,
    /// Of drivers whose weights are known.
    Synthetic,
    /// Of a person who drives in this program.
    DrivingSeat,
}

impl Device {
    /// All devices.
    pub const ALL: [Self; 5] = [Self::Camera, Self::Model, Self::Keyboard, Self::Gamepad, Self::Wheel];

    /// The kind of what it makes.
    pub fn kind(self) -> Kind {
        match self {
            Self::Camera => Kind::Recorded,
            Self::Model => Kind::Synthetic,
            Self::Keyboard | Self::Gamepad | Self::Wheel => Kind::DrivingSeat,
        }
    }
}

/// One lane change as it was driven.
#[derive(Clone, Debug, PartialEq)]
pub struct Demonstration {
    /// Its name.
    pub id: String,
    /// What it shares with others that must not be learned from when this one is judged: its site, or its driver.
    pub group: String,
    /// What it was made with.
    pub device: Device,
    /// Begin of the change, s on the clock of the tracks.
    pub start_s: f64,
    /// End of the change, s.
    pub end_s: f64,
    /// Lateral position at the begin, to the left, m.
    pub start_d_m: f64,
    /// Lateral position at the end, m.
    pub end_d_m: f64,
    /// Center of the new lane, m.
    pub target_d_m: f64,
    /// The vehicle that changes lanes.
    pub ego: Track,
    /// All others.
    pub others: Vec<Track>,
}

impl Demonstration {
    /// How long the change took, s.
    pub fn duration_s(&self) -> f64 {
        self.end_s - self.start_s
    }

    /// Mean speed along the road during the change, m/s.
    pub fn mean_speed_mps(&self) -> f64 {
        (self.ego.position_m(self.end_s).0 - self.ego.position_m(self.start_s).0) / self.duration_s()
    }

    /// A recorded one.
    pub fn recorded(event: &LaneChangeEvent) -> Self {
        Self {
            id: event.id.clone(),
            group: event.site.clone(),
            device: Device::Camera,
            start_s: event.start_s,
            end_s: event.end_s,
            start_d_m: event.start_d_m,
            end_d_m: event.end_d_m,
            target_d_m: event.target_d_m,
            ego: event.ego.clone(),
            others: event.neighbors.clone(),
        }
    }
}

/// Lane changes of one source.
#[derive(Clone, Debug, PartialEq)]
pub struct Demonstrations {
    /// Whose they are, in words.
    pub source: String,
    /// The reward by which they were made, where it is known.
    pub known_reward: Option<RewardModel>,
    /// The lane changes.
    pub items: Vec<Demonstration>,
}

impl Demonstrations {
    /// The freeway lane changes among recorded ones, grouped by site.
    pub fn recorded(events: &[LaneChangeEvent]) -> Self {
        let freeway = events.iter().filter(|event| event.road == RoadKind::Freeway);
        Self {
            source: "recorded drivers on freeways".to_owned(),
            known_reward: None,
            items: freeway.map(Demonstration::recorded).collect(),
        }
    }

    /// What they were made with, each device once.
    pub fn devices(&self) -> Vec<Device> {
        let mut devices: Vec<Device> = self.items.iter().map(|item| item.device).collect();
        devices.sort_unstable();
        devices.dedup();
        devices
    }
}
