//! Who is ahead and behind, in every lane: one order along the road, one sweep over it in each direction.

use super::fleet::Fleet;

/// More lanes than any road has.
pub(super) const MAX_LANES: usize = 8;
/// No vehicle.
pub(super) const NONE: u32 = u32::MAX;

/// The vehicles along the road and each one's neighbors in each lane.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Neighbors {
    /// Ids by rising (position, id).
    order: Vec<u32>,
    /// Each vehicle's place in `order`.
    rank: Vec<u32>,
    /// For each vehicle and lane, the nearest vehicle ahead that occupies the lane.
    ahead: Vec<[u32; MAX_LANES]>,
    /// Likewise behind.
    behind: Vec<[u32; MAX_LANES]>,
    /// Whether the last vehicle follows the first.
    ring: bool,
}

impl Neighbors {
    pub(super) fn new(fleet: &Fleet, ring: bool) -> Self {
        let count = fleet.len();
        let mut order: Vec<u32> = (0..count as u32).collect();
        order.sort_by(|&a, &b| fleet.s_m[a as usize].total_cmp(&fleet.s_m[b as usize]).then(a.cmp(&b)));
        let none = vec![[NONE; MAX_LANES]; count];
        let mut neighbors = Self { order, rank: vec![0; count], ahead: none.clone(), behind: none, ring };
        neighbors.sweep(fleet);
        neighbors
    }

    pub(super) fn order(&self) -> &[u32] {
        &self.order
    }

    /// The nearest other vehicle ahead of `i` in `lane`.
    pub(super) fn ahead(&self, i: usize, lane: u8) -> Option<usize> {
        let found = self.ahead[i][usize::from(lane)];
        (found != NONE && found as usize != i).then_some(found as usize)
    }

    /// The nearest other vehicle behind `i` in `lane`.
    pub(super) fn behind(&self, i: usize, lane: u8) -> Option<usize> {
        let found = self.behind[i][usize::from(lane)];
        (found != NONE && found as usize != i).then_some(found as usize)
    }

    /// Restores the order after a step: those that passed the ring's end are turned to the front, the rest is nearly sorted, which
    /// insertion does in near linear time.
    pub(super) fn sort(&mut self, fleet: &Fleet) {
        let s_m = &fleet.s_m;
        let order = &mut self.order;
        if self.ring {
            // Whoever stands nearer to the start than it has moved has just passed it.
            let passed = order.iter().rev().take_while(|&&i| s_m[i as usize] < fleet.moved_m[i as usize].0).count();
            order.rotate_right(passed);
        }
        for k in 1..order.len() {
            let moving = order[k];
            let key_m = s_m[moving as usize];
            let mut place = k;
            while place > 0 {
                let before = order[place - 1];
                let before_m = s_m[before as usize];
                if before_m < key_m || (before_m == key_m && before < moving) {
                    break;
                }
                order[place] = before;
                place -= 1;
            }
            order[place] = moving;
        }
    }

    /// Finds all neighbors anew.
    pub(super) fn sweep(&mut self, fleet: &Fleet) {
        let mut seen = [NONE; MAX_LANES];
        if self.ring {
            // Ahead of the last is the first of each lane.
            self.order.iter().rev().for_each(|&id| note(&mut seen, fleet, id));
        }
        for (rank, &id) in self.order.iter().enumerate().rev() {
            self.rank[id as usize] = rank as u32;
            self.ahead[id as usize] = seen;
            note(&mut seen, fleet, id);
        }
        let mut seen = [NONE; MAX_LANES];
        if self.ring {
            self.order.iter().for_each(|&id| note(&mut seen, fleet, id));
        }
        for &id in &self.order {
            self.behind[id as usize] = seen;
            note(&mut seen, fleet, id);
        }
    }

    /// Makes `i` a neighbor in `lane`, which it has just claimed, of all between its follower and its leader there, both included.
    pub(super) fn claim(&mut self, i: usize, lane: u8, fleet: &Fleet) {
        let lane_bit = 1 << lane;
        let lane = usize::from(lane);
        let count = self.order.len();
        let start = self.rank[i] as usize;
        for step in 1..count {
            if !self.ring && step > start {
                break;
            }
            let other = self.order[(start + count - step) % count] as usize;
            self.ahead[other][lane] = i as u32;
            if fleet.lane_bits(other) & lane_bit != 0 {
                break;
            }
        }
        for step in 1..count {
            if !self.ring && start + step >= count {
                break;
            }
            let other = self.order[(start + step) % count] as usize;
            self.behind[other][lane] = i as u32;
            if fleet.lane_bits(other) & lane_bit != 0 {
                break;
            }
        }
    }
}

fn note(seen: &mut [u32; MAX_LANES], fleet: &Fleet, id: u32) {
    seen[usize::from(fleet.lane[id as usize])] = id;
    seen[usize::from(fleet.target_lane[id as usize])] = id;
}
