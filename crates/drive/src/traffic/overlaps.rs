//! Whether human-driven vehicles touch: counted in every step, to prove that they never do.
//!
//! Each vehicle is held against the next in the order, the one after that and so on, until all are out of reach. This is done block by
//! block with boxes that are large enough for any motion in the step; only a block with boxes that meet is looked at closely.

use std::ops::Range;

use pulp::{Arch, NullaryFnOnce};

use super::collision::touch_in_step;
use super::fleet::Fleet;

/// Slots that are looked at together.
const BLOCK: usize = 64;
/// Values that are compared together.
const WIDTH: usize = 8;

/// How far a vehicle may have been from its place within the last step, m.
#[derive(Clone, Copy)]
struct Slack {
    along_m: f64,
    aside_m: f64,
}

struct CountOverlaps<'a>(&'a Fleet);

// What it calls must be inlined into what `pulp` compiles for the processor's instruction set.
#[allow(clippy::inline_always)]
impl NullaryFnOnce for CountOverlaps<'_> {
    type Output = u32;

    #[inline(always)]
    fn call(self) -> u32 {
        let slack = self.0.slack();
        let mut overlaps = self.0.overlaps_at_seam(slack);
        for first in (0..self.0.len()).step_by(BLOCK) {
            overlaps += self.0.overlaps_of_block(first, slack);
        }
        overlaps
    }
}

impl Fleet {
    /// Pairs of vehicles that touched in the last step.
    pub(super) fn count_overlaps(&self, arch: Arch) -> u32 {
        arch.dispatch(CountOverlaps(self))
    }

    /// How far from its place at the end of the last step any vehicle was touched at most, m.
    pub(super) fn reach_m(&self) -> f64 {
        self.longest_half_m + self.slack().along_m
    }

    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn slack(&self) -> Slack {
        Slack { along_m: largest(&self.moved_m), aside_m: 2.0 * largest(&self.moved_left_m) }
    }

    /// Pairs of a vehicle of this block with one further along the road.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn overlaps_of_block(&self, first: usize, slack: Slack) -> u32 {
        let mut overlaps = 0;
        for offset in 1..self.len() - first {
            let block = first..(first + BLOCK).min(self.len() - offset);
            let (near, meet) = self.boxes_meet(block.clone(), offset, slack);
            if meet {
                let pairs = block.map(|i| (i, i + offset));
                overlaps += pairs.filter(|&(i, j)| self.touch(i, j, self.s_m[j] - self.s_m[i])).count() as u32;
            }
            if !near {
                break;
            }
        }
        overlaps
    }

    /// Whether any of these vehicles is near the one so many slots ahead of it, and whether any could have touched it.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn boxes_meet(&self, block: Range<usize>, offset: usize, slack: Slack) -> (bool, bool) {
        let ahead = block.start + offset..block.end + offset;
        let count = block.len();
        let (s_m, ahead_s_m) = (&self.s_m[block.clone()][..count], &self.s_m[ahead.clone()][..count]);
        let (d_m, ahead_d_m) = (&self.d_m[block.clone()][..count], &self.d_m[ahead.clone()][..count]);
        let half_m = &self.half_length_m[block.clone()][..count];
        let (wide_m, ahead_wide_m) = (&self.half_width_m[block][..count], &self.half_width_m[ahead][..count]);
        let farthest_m = self.longest_half_m + slack.along_m;
        let (mut nears, mut meets) = (0_u64, 0_u64);
        for i in 0..count {
            let near = ahead_s_m[i] - s_m[i] < half_m[i] + farthest_m;
            let beside = (ahead_d_m[i] - d_m[i]).abs() < wide_m[i] + ahead_wide_m[i] + slack.aside_m;
            nears |= u64::from(near);
            meets |= u64::from(near & beside);
        }
        (nears != 0, meets != 0)
    }

    /// On a ring the last vehicles are followed by the first.
    fn overlaps_at_seam(&self, slack: Slack) -> u32 {
        let farthest_m = self.longest_half_m + slack.along_m;
        let mut overlaps = 0;
        for i in (0..self.len()).rev() {
            let mut alone = true;
            for j in 0..i {
                let ahead_m = self.s_m[j] - self.s_m[i] + self.ring_m;
                if ahead_m >= self.longest_half_m + farthest_m {
                    break;
                }
                alone = false;
                overlaps += u32::from(self.touch(i, j, ahead_m));
            }
            if alone {
                break;
            }
        }
        overlaps
    }

    /// Whether the vehicles of two slots touched in the last step; `ahead_m`: how far `j` is ahead of `i` after it.
    fn touch(&self, i: usize, j: usize, ahead_m: f64) -> bool {
        let end_m = (ahead_m, self.d_m[j] - self.d_m[i]);
        let moved_m = (self.moved_m[j] - self.moved_m[i], self.moved_left_m[j] - self.moved_left_m[i]);
        let reach_m = (self.half_length_m[i] + self.half_length_m[j], self.half_width_m[i] + self.half_width_m[j]);
        touch_in_step(end_m, moved_m, reach_m)
    }
}

/// The largest absolute value.
#[allow(clippy::inline_always)]
#[inline(always)]
fn largest(values: &[f64]) -> f64 {
    let (blocks, rest) = values.as_chunks::<WIDTH>();
    let mut most = [0.0; WIDTH];
    for block in blocks {
        for (most, value) in most.iter_mut().zip(block) {
            *most = if value.abs() > *most { value.abs() } else { *most };
        }
    }
    most.iter().chain(rest).fold(0.0, |most: f64, value| most.max(value.abs()))
}
