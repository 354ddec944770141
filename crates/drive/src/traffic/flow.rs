//! Vehicles that enter the road one after another: a Poisson process, and a queue outside for those who find no room.

use lanecraft_net::random::Stream;
use serde::{Deserialize, Serialize};

use super::World;
use crate::scenario::{Flow, Scenario, VehicleSpec};

/// A vehicle that enters drives no faster than one that is nearer ahead than this, m.
const ADAPT_WITHIN_M: f64 = 100.0;

/// A flow under way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Inflow {
    index: usize,
    flow: Flow,
    /// When the next one arrives, s.
    next_s: f64,
    /// How many have arrived, and how many of them have entered.
    arrived: u64,
    entered: u64,
}

impl Inflow {
    pub(super) fn new(scenario: &Scenario, index: usize) -> Self {
        let mut inflow = Self { index, flow: scenario.flows[index], next_s: 0.0, arrived: 0, entered: 0 };
        inflow.next_s = inflow.headway_s(scenario.seed);
        inflow
    }

    /// Time from the last arrival to the next, s: exponential.
    fn headway_s(&self, seed: u64) -> f64 {
        let mut stream = Stream::keyed(seed, "traffic.arrival", self.index as u64, self.arrived);
        -libm::log(1.0 - stream.uniform()) * 3600.0 / self.flow.inflow_veh_per_h
    }

    /// Lets the first of the queue in if it finds room.
    pub(super) fn let_in(&mut self, scenario: &Scenario, world: &mut World, dt_s: f64) {
        while self.next_s <= world.now as f64 * dt_s {
            self.arrived += 1;
            self.next_s += self.headway_s(scenario.seed);
        }
        if self.entered < self.arrived {
            let spec = self.first_of_queue(scenario, world);
            if world.has_room_for(&spec) {
                world.insert(&spec, dt_s);
                self.entered += 1;
            }
        }
    }

    fn first_of_queue(&self, scenario: &Scenario, world: &World) -> VehicleSpec {
        let (lane, s_m) = (self.flow.lane, self.flow.enter_s_m);
        let spec = scenario.draw_entering(lane, (self.index as u64) << 32 | self.entered);
        let fleet = &world.fleet;
        let leader = fleet.nearest_ahead(s_m, lane.0).filter(|&j| fleet.ahead_m(s_m, fleet.s_m[j]) < ADAPT_WITHIN_M);
        let speed_mps = leader.map_or(spec.speed_mps, |j| spec.speed_mps.min(fleet.speed_mps[j]));
        VehicleSpec { s_m, speed_mps, ..spec }
    }

    pub(super) fn digest_word(&self) -> u64 {
        self.arrived << 32 | self.entered
    }
}
