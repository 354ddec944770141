//! What written vehicles do apart from driving on, and when.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{ScenarioError, VehicleStart};
use crate::config::{ConfigError, check_range};
use crate::road::LaneIndex;

/// Something that a vehicle does once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// Name of the vehicle.
    pub vehicle: String,
    /// When it begins.
    pub trigger: Trigger,
    /// What it does.
    pub action: Action,
}

/// When an event begins.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Trigger {
    /// At a time.
    AtTime {
        /// Time since the start, s.
        time_s: f64,
    },
    /// When the ego is near the vehicle, ahead or behind.
    EgoWithin {
        /// Distance between their centers along the road, m.
        distance_m: f64,
    },
    /// When the ego reaches a place; on a ring, each time round counts.
    EgoReaches {
        /// The place, m.
        s_m: f64,
    },
    /// When the ego comes up behind the vehicle, in whatever lane.
    TimeGap {
        /// Time that the ego takes for the distance between the bumpers, s.
        time_gap_s: f64,
    },
}

/// What a vehicle does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Action {
    /// Brakes for a while, no harder than it can, then drives on.
    Brake {
        /// Deceleration, m/s² (positive).
        decel_mps2: f64,
        /// How long, s.
        duration_s: f64,
    },
    /// Brakes to a standstill and stays there: a breakdown.
    Stop {
        /// Deceleration, m/s² (positive).
        decel_mps2: f64,
    },
    /// Wants to drive at another speed from now on.
    SetSpeed {
        /// The new desired speed, m/s.
        speed_mps: f64,
    },
    /// Changes into a lane beside its own, as soon as that is safe among the human drivers; it asks neither whether it pays nor,
    /// unless it is `courteous`, what it does to the ego.
    ChangeLane {
        /// The lane, from the right, starting at 0.
        lane: LaneIndex,
        /// Whether the distances to the ego must be safe, too.
        #[serde(default)]
        courteous: bool,
    },
}

/// An event with the vehicle's index in place of its name.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScriptedEvent {
    /// Index of the vehicle.
    pub vehicle: u32,
    /// When it begins.
    pub trigger: Trigger,
    /// What it does.
    pub action: Action,
}

impl Event {
    fn validate(&self, lanes: u8) -> Result<(), ConfigError> {
        match self.trigger {
            Trigger::AtTime { time_s } => check_range("events.trigger.time_s", time_s, 0.0, 3600.0)?,
            Trigger::EgoWithin { distance_m } => check_range("events.trigger.distance_m", distance_m, 0.0, 500.0)?,
            Trigger::EgoReaches { s_m } => check_range("events.trigger.s_m", s_m, -1e5, 1e5)?,
            Trigger::TimeGap { time_gap_s } => check_range("events.trigger.time_gap_s", time_gap_s, 0.0, 60.0)?,
        }
        match self.action {
            Action::Brake { decel_mps2, duration_s } => {
                check_range("events.action.decel_mps2", decel_mps2, 0.1, 12.0)?;
                check_range("events.action.duration_s", duration_s, 0.1, 600.0)
            }
            Action::Stop { decel_mps2 } => check_range("events.action.decel_mps2", decel_mps2, 0.1, 12.0),
            Action::SetSpeed { speed_mps } => check_range("events.action.speed_mps", speed_mps, 1.0, 60.0),
            Action::ChangeLane { lane, .. } => {
                check_range("events.action.lane", f64::from(lane.0), 0.0, f64::from(lanes.max(1) - 1))
            }
        }
    }
}

/// Every event must be about a vehicle that has its name alone, and its numbers must be possible.
pub(super) fn check(events: &[Event], vehicles: &[VehicleStart], lanes: u8) -> Result<(), ScenarioError> {
    for (index, vehicle) in vehicles.iter().enumerate() {
        if !vehicle.name.is_empty() && vehicles[..index].iter().any(|other| other.name == vehicle.name) {
            return Err(ScenarioError::SameName { index, name: vehicle.name.clone() });
        }
    }
    for (index, event) in events.iter().enumerate() {
        if position(event, vehicles).is_none() {
            let names = vehicles.iter().map(|vehicle| vehicle.name.clone()).filter(|name| !name.is_empty());
            let known = names.collect();
            return Err(ScenarioError::UnknownVehicle { event: index, name: event.vehicle.clone(), known });
        }
        event.validate(lanes).map_err(|source| ScenarioError::Event { index, source })?;
    }
    Ok(())
}

/// The events with indices in place of names; [`check`] has found every name.
pub(super) fn resolve(events: &[Event], vehicles: &[VehicleStart]) -> Vec<ScriptedEvent> {
    let resolved = |event: &Event| {
        let vehicle = position(event, vehicles)? as u32;
        Some(ScriptedEvent { vehicle, trigger: event.trigger, action: event.action })
    };
    events.iter().filter_map(resolved).collect()
}

fn position(event: &Event, vehicles: &[VehicleStart]) -> Option<usize> {
    vehicles.iter().position(|vehicle| !vehicle.name.is_empty() && vehicle.name == event.vehicle)
}
