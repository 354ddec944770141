//! Whether human-driven vehicles touch: counted in every step, to prove that they never do.

use super::collision::touch_in_step;
use super::fleet::Fleet;

impl Fleet {
    /// Pairs of vehicles that touched in the last step.
    pub(super) fn count_overlaps(&self) -> u32 {
        let farthest_m = self.reach_m();
        let count = self.len();
        let mut overlaps = 0;
        for i in 0..count {
            let reach_m = self.half_length_m[i] + farthest_m;
            // On a ring the last is followed by the first; on an open road those are behind, which ends the search as well.
            for j in (i + 1..count).chain(0..i) {
                let ahead_m = self.ahead_m(self.s_m[i], self.s_m[j]);
                if !(0.0..reach_m).contains(&ahead_m) {
                    break;
                }
                overlaps += u32::from(self.touch(i, j, ahead_m));
            }
        }
        overlaps
    }

    /// How far from its place at the end of the last step any vehicle was touched at most, m.
    pub(super) fn reach_m(&self) -> f64 {
        let longest_m = self.half_length_m.iter().copied().fold(0.0, f64::max);
        longest_m + self.moved_m.iter().copied().fold(0.0, f64::max)
    }

    /// Whether the vehicles of two slots touched in the last step; `ahead_m`: how far `j` is ahead of `i` after it.
    fn touch(&self, i: usize, j: usize, ahead_m: f64) -> bool {
        let end_m = (ahead_m, self.d_m[j] - self.d_m[i]);
        let moved_m = (self.moved_m[j] - self.moved_m[i], self.moved_left_m[j] - self.moved_left_m[i]);
        let reach_m = (self.half_length_m[i] + self.half_length_m[j], self.half_width_m[i] + self.half_width_m[j]);
        touch_in_step(end_m, moved_m, reach_m)
    }
}
