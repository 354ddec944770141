//! Who is ahead and behind: the slots stand in the order of the road, so that neighbors are found by looking along them.

use super::fleet::Fleet;

/// The slots of the nearest vehicles ahead and behind in a lane.
#[derive(Clone, Copy)]
pub(super) struct Around {
    pub(super) ahead: Option<usize>,
    pub(super) behind: Option<usize>,
}

impl Fleet {
    /// Whom slot `i` has ahead and behind in `lane`.
    pub(super) fn around(&self, i: usize, lane: u8) -> Around {
        Around { ahead: self.ahead(i, lane), behind: self.behind(i, lane) }
    }

    /// The nearest other vehicle ahead of slot `i` in `lane`.
    pub(super) fn ahead(&self, i: usize, lane: u8) -> Option<usize> {
        let onward = first_in(&self.lanes[i + 1..], lane).map(|offset| i + 1 + offset);
        // On a ring the last is followed by the first.
        onward.or_else(|| first_in(&self.lanes[..self.seam(i)], lane))
    }

    /// The nearest other vehicle behind slot `i` in `lane`.
    fn behind(&self, i: usize, lane: u8) -> Option<usize> {
        last_in(&self.lanes[..i], lane).or_else(|| {
            let seam = if self.is_ring() { i + 1 } else { self.len() };
            last_in(&self.lanes[seam..], lane).map(|offset| seam + offset)
        })
    }

    /// The vehicle that is the nearest ahead of a place in `lane`.
    pub(super) fn nearest_ahead(&self, s_m: f64, lane: u8) -> Option<usize> {
        let place = self.s_m.partition_point(|&other_m| other_m <= s_m);
        let onward = first_in(&self.lanes[place..], lane).map(|offset| place + offset);
        onward.or_else(|| first_in(&self.lanes[..self.seam(place)], lane))
    }

    /// The vehicle that is the nearest behind a place, or at it, in `lane`.
    pub(super) fn nearest_behind(&self, s_m: f64, lane: u8) -> Option<usize> {
        let place = self.s_m.partition_point(|&other_m| other_m <= s_m);
        last_in(&self.lanes[..place], lane).or_else(|| {
            let seam = if self.is_ring() { place } else { self.len() };
            last_in(&self.lanes[seam..], lane).map(|offset| seam + offset)
        })
    }

    /// The last vehicle of `lane` in the order.
    pub(super) fn last(&self, lane: u8) -> Option<usize> {
        last_in(&self.lanes, lane)
    }

    /// How many of the first slots lie ahead of slot `i` across the ring's end.
    fn seam(&self, i: usize) -> usize {
        if self.is_ring() { i } else { 0 }
    }

    pub(super) fn is_ring(&self) -> bool {
        self.ring_m.is_finite()
    }

    /// The slots of all vehicles within `range_m` of a place, across the ring's end, too: those further along the road first if that
    /// end lies between, else by rising position.
    pub(super) fn near(&self, s_m: f64, range_m: f64) -> impl Iterator<Item = usize> + '_ {
        let between = |from_m: f64, to_m: f64| {
            let first = self.s_m.partition_point(|&s_m| s_m < from_m);
            first..self.s_m.partition_point(|&s_m| s_m <= to_m).max(first)
        };
        let (from_m, to_m) = (s_m - range_m, s_m + range_m);
        let whole = 2.0 * range_m >= self.ring_m;
        let here = if whole { 0..self.len() } else { between(from_m, to_m) };
        let (mut before, mut beyond) = (0..0, 0..0);
        if !whole && self.is_ring() {
            before = between(from_m + self.ring_m, f64::INFINITY);
            beyond = between(f64::NEG_INFINITY, to_m - self.ring_m);
        }
        before.chain(here).chain(beyond)
    }

    /// How far `to_m` lies ahead, never behind on a ring, m. Both positions are wrapped.
    pub(super) fn ahead_m(&self, from_m: f64, to_m: f64) -> f64 {
        let ahead_m = to_m - from_m;
        if ahead_m < 0.0 && self.is_ring() { ahead_m + self.ring_m } else { ahead_m }
    }

    /// How far `to_m` lies ahead, negative behind, by the shorter way on a ring, m. Both positions are wrapped.
    pub(super) fn signed_ahead_m(&self, from_m: f64, to_m: f64) -> f64 {
        let ahead_m = to_m - from_m;
        if ahead_m > 0.5 * self.ring_m {
            ahead_m - self.ring_m
        } else if ahead_m < -0.5 * self.ring_m {
            ahead_m + self.ring_m
        } else {
            ahead_m
        }
    }

    /// Bumper-to-bumper gap from slot `i` to slot `j` ahead of it, m.
    #[inline]
    pub(super) fn gap_m(&self, i: usize, j: usize) -> f64 {
        self.ahead_m(self.s_m[i], self.s_m[j]) - self.half_length_m[i] - self.half_length_m[j]
    }
}

/// So many entries are looked at together: the nearest vehicle of a lane is rarely further away.
const TOGETHER: usize = 16;

/// A lane's bit in every entry.
fn mask(lane: u8) -> u128 {
    u128::from_le_bytes([1 << lane; TOGETHER])
}

/// The first entry of occupied lanes that has this one.
fn first_in(lanes: &[u8], lane: u8) -> Option<usize> {
    let (blocks, rest) = lanes.as_chunks::<TOGETHER>();
    for (index, block) in blocks.iter().enumerate() {
        let found = u128::from_le_bytes(*block) & mask(lane);
        if found != 0 {
            return Some(TOGETHER * index + found.trailing_zeros() as usize / 8);
        }
    }
    rest.iter().position(|lanes| lanes & (1 << lane) != 0).map(|offset| TOGETHER * blocks.len() + offset)
}

/// The last entry of occupied lanes that has this one.
fn last_in(lanes: &[u8], lane: u8) -> Option<usize> {
    let (rest, blocks) = lanes.as_rchunks::<TOGETHER>();
    for (index, block) in blocks.iter().enumerate().rev() {
        let found = u128::from_le_bytes(*block) & mask(lane);
        if found != 0 {
            return Some(rest.len() + TOGETHER * (index + 1) - 1 - found.leading_zeros() as usize / 8);
        }
    }
    rest.iter().rposition(|lanes| lanes & (1 << lane) != 0)
}

#[cfg(test)]
mod tests {
    use super::{first_in, last_in};

    #[test]
    fn the_nearest_entry_is_found_at_every_distance() {
        for length in 0..50 {
            for place in 0..length {
                let mut lanes = vec![0b1011_u8; length];
                lanes[place] |= 0b100;
                assert_eq!((first_in(&lanes, 2), last_in(&lanes, 2)), (Some(place), Some(place)));
                assert_eq!((first_in(&lanes, 0), last_in(&lanes, 0)), (Some(0), Some(length - 1)));
                assert_eq!((first_in(&lanes, 4), last_in(&lanes, 4)), (None, None));
            }
        }
    }
}
