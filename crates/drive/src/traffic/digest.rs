//! A hash of the traffic's state.

use super::World;
use super::fleet::NEVER;
use crate::scene::VehicleId;

impl World {
    /// A hash of all bits that determine what follows (FNV-1a over 64-bit words), vehicles by rising id.
    pub fn digest(&self) -> u64 {
        let mut hash = 0xCBF2_9CE4_8422_2325_u64;
        let mut add = |word: u64| hash = (hash ^ word).wrapping_mul(0x0000_0100_0000_01B3);
        add(self.now as u64);
        add(self.seed());
        self.ego.iter().flat_map(|ego| ego.digest_words(self.now)).for_each(&mut add);
        self.fleet.by_id().flat_map(|slot| self.digest_words(slot)).for_each(&mut add);
        self.script.iter().flat_map(|script| script.digest_words()).for_each(&mut add);
        hash
    }

    fn digest_words(&self, i: usize) -> [u64; 9] {
        let fleet = &self.fleet;
        let changes = fleet.lane[i] != fleet.target_lane[i];
        let (done, total) = if changes { (self.now - fleet.changed_step[i], fleet.change_steps[i]) } else { (0, 0) };
        let since = if fleet.changed_step[i] == NEVER { i64::from(u32::MAX) } else { self.now - fleet.changed_step[i] };
        let cooldown = (fleet.free_step[i] - self.now).max(0);
        let id = VehicleId(fleet.id[i]);
        let order = self.orders.iter().find(|order| order.id == id);
        [
            fleet.s_m[i].to_bits(),
            fleet.d_m[i].to_bits(),
            fleet.speed_mps[i].to_bits(),
            fleet.lateral_speed_mps[i].to_bits(),
            fleet.accel_mps2[i].to_bits(),
            u64::from(fleet.lane[i]) << 8 | u64::from(fleet.target_lane[i]),
            (done as u64) << 32 | u64::from(total),
            (cooldown as u64) << 32 | since as u64,
            order.map_or(0, |order| order.left_steps(self.now)) as u64,
        ]
    }
}
