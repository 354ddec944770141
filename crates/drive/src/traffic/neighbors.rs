//! Who is ahead and behind: the slots stand in the order of the road, so that neighbors are found by looking along them.

use super::fleet::Fleet;

impl Fleet {
    /// The nearest other vehicle ahead of slot `i` in `lane`.
    pub(super) fn ahead(&self, i: usize, lane: u8) -> Option<usize> {
        let occupies = |lanes: &u8| lanes & (1 << lane) != 0;
        let onward = self.lanes[i + 1..].iter().position(occupies).map(|offset| i + 1 + offset);
        // On a ring the last is followed by the first.
        onward.or_else(|| self.lanes[..self.seam(i)].iter().position(occupies))
    }

    /// The nearest other vehicle behind slot `i` in `lane`.
    pub(super) fn behind(&self, i: usize, lane: u8) -> Option<usize> {
        let occupies = |lanes: &u8| lanes & (1 << lane) != 0;
        let back = self.lanes[..i].iter().rposition(occupies);
        let seam = if self.is_ring() { i + 1 } else { self.len() };
        back.or_else(|| self.lanes[seam..].iter().rposition(occupies).map(|offset| seam + offset))
    }

    /// The vehicle that is the nearest behind a place, or at it, in `lane`.
    pub(super) fn nearest_behind(&self, s_m: f64, lane: u8) -> Option<usize> {
        let occupies = |lanes: &u8| lanes & (1 << lane) != 0;
        let place = self.s_m.partition_point(|&other_m| other_m <= s_m);
        let back = self.lanes[..place].iter().rposition(occupies);
        let seam = if self.is_ring() { place } else { self.len() };
        back.or_else(|| self.lanes[seam..].iter().rposition(occupies).map(|offset| seam + offset))
    }

    /// The vehicle that is the nearest ahead of a place in `lane`.
    pub(super) fn nearest_ahead(&self, s_m: f64, lane: u8) -> Option<usize> {
        let occupies = |lanes: &u8| lanes & (1 << lane) != 0;
        let place = self.s_m.partition_point(|&other_m| other_m <= s_m);
        let onward = self.lanes[place..].iter().position(occupies).map(|offset| place + offset);
        onward.or_else(|| self.lanes[..self.seam(place)].iter().position(occupies))
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
    pub(super) fn gap_m(&self, i: usize, j: usize) -> f64 {
        self.ahead_m(self.s_m[i], self.s_m[j]) - self.half_length_m[i] - self.half_length_m[j]
    }
}
