//! What a scenario has happen after its start: scripted events, vehicles that enter and leave, recorded vehicles.
//!
//! Everything here acts between two steps, through the same doors as anybody else: commands, insertions and removals.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::World;
use super::command::Command;
use super::fleet::{Fleet, steps};
use super::flow::Inflow;
use super::recorded::Recorded;
use super::world::Ego;
use crate::models::idm::IdmParams;
use crate::road::{LaneIndex, Topology};
use crate::scenario::{Action, Scenario, ScriptedEvent, Trigger};
use crate::scene::VehicleId;

/// On a ring the ego has reached a place while it is not further past it than this, m.
const PAST_M: f64 = 50.0;

/// What is still to happen, as a value that is copied with the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Script {
    pub(super) scenario: Arc<Scenario>,
    events: Vec<Pending>,
    inflows: Vec<Inflow>,
    recorded: Vec<Recorded>,
}

/// An event that is not over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Pending {
    event: ScriptedEvent,
    /// Its trigger has been met, but not what else it waits for.
    met: bool,
}

impl Script {
    /// The script of a scenario, if anything is to happen in it.
    pub(super) fn new(scenario: &Scenario) -> Option<Box<Self>> {
        let nothing = scenario.script.is_empty() && scenario.flows.is_empty() && scenario.recording.is_none();
        if nothing {
            return None;
        }
        let events = scenario.script.iter().map(|&event| Pending { event, met: false }).collect();
        let inflows = (0..scenario.flows.len()).map(|index| Inflow::new(scenario, index)).collect();
        let recorded = Recorded::all(scenario);
        Some(Box::new(Self { scenario: Arc::new(scenario.clone()), events, inflows, recorded }))
    }

    /// What of it a digest needs to know beside the vehicles.
    pub(super) fn digest_words(&self) -> impl Iterator<Item = u64> + '_ {
        let events = self.events.iter().map(|pending| u64::from(pending.event.vehicle) << 1 | u64::from(pending.met));
        events.chain(self.inflows.iter().map(Inflow::digest_word))
    }

    fn run(&mut self, world: &mut World, dt_s: f64) {
        self.events.retain_mut(|pending| {
            pending.met |= is_met(world, &pending.event, dt_s);
            !(pending.met && begin(world, &pending.event, dt_s))
        });
        if !self.inflows.is_empty() {
            let_out(world, self.scenario.road.config().length_m);
        }
        for inflow in &mut self.inflows {
            inflow.let_in(&self.scenario, world, dt_s);
        }
        for recorded in &mut self.recorded {
            recorded.play(&self.scenario, world, dt_s);
        }
    }
}

impl World {
    /// What the scenario has happen before the coming step.
    pub(super) fn run_script(&mut self, dt_s: f64) {
        if let Some(mut script) = self.script.take() {
            script.run(self, dt_s);
            self.script = Some(script);
        }
    }

    /// Puts the recorded vehicles that are there at the start on the road.
    pub(super) fn begin_script(&mut self) {
        if let Some(mut script) = self.script.take() {
            for recorded in &mut script.recorded {
                recorded.enter(&script.scenario, self, 0.0);
            }
            self.script = Some(script);
        }
    }
}

/// Whoever has come to the end of the road leaves it.
fn let_out(world: &mut World, end_m: f64) {
    while let Some(last) = world.fleet.len().checked_sub(1).filter(|&last| world.fleet.s_m[last] > end_m) {
        world.remove(VehicleId(world.fleet.id[last]));
    }
}

fn is_met(world: &World, event: &ScriptedEvent, dt_s: f64) -> bool {
    if let Trigger::AtTime { time_s } = event.trigger {
        // Half a step forgives the rounding of times written in decimal.
        return (world.now as f64 + 0.5) * dt_s >= time_s;
    }
    let (Some(ego), Some(slot)) = (&world.ego, world.fleet.slot(VehicleId(event.vehicle))) else { return false };
    is_met_by(world, ego, slot, event.trigger)
}

fn is_met_by(world: &World, ego: &Ego, slot: usize, trigger: Trigger) -> bool {
    let fleet = &world.fleet;
    match trigger {
        Trigger::AtTime { .. } => false,
        Trigger::EgoWithin { distance_m } => fleet.signed_ahead_m(ego.s_m(), fleet.s_m[slot]).abs() <= distance_m,
        Trigger::EgoReaches { s_m } if world.road.config().topology == Topology::Open => ego.s_m() >= s_m,
        Trigger::EgoReaches { s_m } => (0.0..PAST_M).contains(&fleet.signed_ahead_m(world.road.wrap_m(s_m), ego.s_m())),
        Trigger::TimeGap { time_gap_s } => is_close_behind(fleet, ego, slot, time_gap_s),
    }
}

fn is_close_behind(fleet: &Fleet, ego: &Ego, slot: usize, time_gap_s: f64) -> bool {
    let (ego_is_ahead, gap_m) = ego.gap_m(fleet, slot);
    !ego_is_ahead && gap_m <= time_gap_s * ego.speed_mps
}

/// Begins an event; false if it has to wait. One whose vehicle has left the road is over.
fn begin(world: &mut World, event: &ScriptedEvent, dt_s: f64) -> bool {
    let id = VehicleId(event.vehicle);
    let Some(slot) = world.fleet.slot(id) else { return true };
    match event.action {
        Action::Brake { decel_mps2, duration_s } => {
            world.command(id, Command::Brake { decel_mps2, steps: steps(duration_s, dt_s) });
            true
        }
        Action::Stop { decel_mps2 } => {
            world.command(id, Command::Brake { decel_mps2, steps: u32::MAX });
            true
        }
        Action::SetSpeed { speed_mps } => {
            let driver = IdmParams { desired_speed_mps: speed_mps, ..world.fleet.driver[slot] };
            world.fleet.set_driver(slot, driver);
            true
        }
        Action::ChangeLane { lane, courteous } => change_lane(world, slot, lane, courteous, dt_s),
    }
}

/// Into a lane that is already the own there is nothing to do; one that is not beside it has to wait.
fn change_lane(world: &mut World, slot: usize, lane: LaneIndex, courteous: bool, dt_s: f64) -> bool {
    let fleet = &world.fleet;
    if fleet.target_lane[slot] == lane.0 {
        return true;
    }
    let free = fleet.lane[slot] == fleet.target_lane[slot] && fleet.lane[slot].abs_diff(lane.0) == 1;
    let safe = free
        && world.is_safe_among_humans(slot, lane.0, fleet.around(slot, lane.0))
        && (!courteous || world.is_safe_for_ego(slot, lane.0));
    if safe {
        let pause_s = world.traffic.lane_change_cooldown_s.max(world.traffic.lane_change_duration_s);
        world.fleet.free_step[slot] = world.now + i64::from(steps(pause_s, dt_s));
        let id = VehicleId(world.fleet.id[slot]);
        world.change_lane(id, lane, dt_s);
    }
    safe
}
