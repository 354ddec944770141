//! The active set: its multipliers, the Cholesky factor of its dual curvature, and the step along the dual's pieces
//! (docs/qp.md, Eqs. 9 to 12).

use serde::{Deserialize, Serialize};

use crate::linalg::{Block, LANES, dot};
use crate::responses::{Place, Responses};

/// Smallest squared pivot, relative to the diagonal. A constraint that depends on those before it would have a pivot of
/// rounding errors; with this one its multiplier runs to the next event, as it must.
const PIVOT_FLOOR: f64 = 1e-12;

/// Changed diagonals of M beyond which a new factor costs less than the changes of the old one.
const MANY_BENT: usize = 6;

/// An active constraint, `sign` (its value) <= `bound` + slack.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Active {
    pub(crate) place: Place,
    /// 1 at the upper bound, -1 at the lower one.
    pub(crate) sign: f64,
    /// The bound, times the sign.
    pub(crate) bound: f64,
    /// Largest multiplier without slack; infinite for the bounds of the input.
    pub(crate) l1_weight: f64,
    /// 1 / w2; 0 for the bounds of the input.
    pub(crate) compliance: f64,
    /// z'z, the diagonal of M without slack.
    pub(crate) curvature: f64,
    /// Whether the slack is in use.
    pub(crate) soft: bool,
    /// The multiplier, or with the slack in use what it has beyond `l1_weight`. Kept apart because the sum may round it away.
    pub(crate) amount: f64,
    /// Slope of the dual in the multiplier: violation of the constraint less its slack.
    pub(crate) slope: f64,
    /// How fast `slope` falls along the present direction.
    pub(crate) fall: f64,
    /// Whether the piece has changed since the factor was made.
    pub(crate) bent: bool,
    /// Number of the constraint among all.
    pub(crate) id: usize,
}

impl Active {
    pub(crate) fn multiplier(&self) -> f64 {
        if self.soft { self.l1_weight + self.amount } else { self.amount }
    }

    pub(crate) fn slack(&self) -> f64 {
        if self.soft { self.amount * self.compliance } else { 0.0 }
    }

    /// The same constraint with this multiplier.
    pub(crate) fn with_multiplier(self, multiplier: f64) -> Self {
        let soft = multiplier > self.l1_weight;
        Self { soft, amount: if soft { multiplier - self.l1_weight } else { multiplier }, ..self }
    }

    /// The diagonal of M.
    pub(crate) fn diagonal(&self) -> f64 {
        self.curvature + if self.soft { self.compliance } else { 0.0 }
    }

    /// The next piece boundary for multipliers moving at `rate`: distance and what happens there.
    fn event(&self, rate: f64) -> Option<(f64, Event)> {
        if self.soft {
            (rate < 0.0).then(|| (-self.amount / rate, Event::Harden))
        } else if rate < 0.0 {
            Some((-self.amount / rate, Event::Drop))
        } else {
            (rate > 0.0 && self.l1_weight < f64::INFINITY)
                .then(|| ((self.l1_weight - self.amount) / rate, Event::Soften))
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    /// The multiplier reaches 0: the constraint leaves.
    Drop,
    /// The multiplier reaches the L1 weight from below: the slack comes into use.
    Soften,
    /// The multiplier falls back to the L1 weight: the slack is 0 again.
    Harden,
}

/// How a step along the Newton direction ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Walk {
    /// At the maximum of the dual over this set.
    Full,
    /// At a change of the set or of its pieces.
    Bent,
}

/// Active constraints in the order in which they came.
#[derive(Clone, Debug)]
pub(crate) struct ActiveSet {
    pub(crate) items: Vec<Active>,
    /// Whether a constraint is in the set, by its number.
    member: Vec<bool>,
    /// Lower triangle without its diagonal, row after row, each padded with zeros to whole blocks.
    cholesky: Vec<Block>,
    /// Its diagonal, and the reciprocals.
    pivots: Vec<f64>,
    inverses: Vec<f64>,
    /// Items, from the first on, whose rows `cholesky` holds.
    factored: usize,
    direction: Vec<Block>,
}

/// An active set as it is stored.
#[derive(Serialize, Deserialize)]
pub(crate) struct SavedSet {
    items: Vec<Active>,
    cholesky: Vec<Block>,
    pivots: Vec<f64>,
    inverses: Vec<f64>,
}

impl ActiveSet {
    pub(crate) fn new(capacity: usize) -> Self {
        Self {
            items: Vec::with_capacity(capacity),
            member: vec![false; capacity],
            cholesky: vec![[0.0; LANES]; row_start(capacity)],
            pivots: vec![0.0; capacity],
            inverses: vec![0.0; capacity],
            factored: 0,
            direction: vec![[0.0; LANES]; capacity.div_ceil(LANES)],
        }
    }

    /// The set with as much of its factor as there is.
    pub(crate) fn to_saved(&self) -> SavedSet {
        SavedSet {
            items: self.items.clone(),
            cholesky: self.cholesky[..row_start(self.factored)].to_vec(),
            pivots: self.pivots[..self.factored].to_vec(),
            inverses: self.inverses[..self.factored].to_vec(),
        }
    }

    /// Takes over a set that was saved; false, and no more than an empty set, if it cannot be one of this size.
    pub(crate) fn restore(&mut self, saved: SavedSet, id: impl Fn(Place) -> Option<usize>) -> bool {
        self.clear();
        let factored = saved.pivots.len();
        let fits = factored <= saved.items.len()
            && saved.inverses.len() == factored
            && saved.cholesky.len() == row_start(factored);
        for item in saved.items {
            if !fits || id(item.place) != Some(item.id) || self.contains(item.id) {
                self.clear();
                return false;
            }
            self.push(item);
        }
        self.factored = factored;
        self.cholesky[..saved.cholesky.len()].copy_from_slice(&saved.cholesky);
        self.pivots[..factored].copy_from_slice(&saved.pivots);
        self.inverses[..factored].copy_from_slice(&saved.inverses);
        fits
    }

    pub(crate) fn clear(&mut self) {
        self.items.clear();
        self.member.fill(false);
        self.factored = 0;
    }

    pub(crate) fn forget_factor(&mut self) {
        self.factored = 0;
    }

    /// Moves all constraints this many stages earlier; those before the first stage leave.
    pub(crate) fn shift(&mut self, stages: usize, per_stage: usize) {
        self.factored = 0;
        self.member.fill(false);
        self.items.retain(|item| item.place.stage >= stages);
        for item in &mut self.items {
            item.place.stage -= stages;
            item.id -= stages * per_stage;
            self.member[item.id] = true;
        }
    }

    pub(crate) fn contains(&self, id: usize) -> bool {
        self.member[id]
    }

    pub(crate) fn push(&mut self, item: Active) {
        self.member[item.id] = true;
        self.items.push(item);
    }

    /// Brings the factor of M = Z Z' + diag(1/w2 where the slack is in use) up to date: block after block of columns, because
    /// the rows of one block do not wait for each other.
    pub(crate) fn factor<const NX: usize>(&mut self, responses: &mut Responses<NX>) {
        let count = self.items.len();
        for i in self.factored..count {
            self.write_couplings(i, responses);
        }
        for block in 0..count.div_ceil(LANES) {
            let first = block * LANES;
            for i in first.max(self.factored)..count {
                self.eliminate(i, block);
                if i < first + LANES {
                    self.set_pivot(i);
                }
            }
        }
        self.factored = count;
    }

    /// Row `i` of M left of its diagonal.
    fn write_couplings<const NX: usize>(&mut self, i: usize, responses: &mut Responses<NX>) {
        let item = &self.items[i];
        let start = row_start(i);
        let row = &mut self.cholesky[start..start + i.div_ceil(LANES)];
        row.fill([0.0; LANES]);
        for (coupling, other) in row.as_flattened_mut().iter_mut().zip(&self.items[..i]) {
            *coupling = item.sign * other.sign * responses.couple(item.place, other.place);
        }
    }

    /// Turns one block of row `i` of M into that of its factor.
    fn eliminate(&mut self, i: usize, block: usize) {
        let (done, row) = self.cholesky.split_at_mut(row_start(i));
        let columns = LANES.min(i - block * LANES);
        substitute(done, &mut row[..i.div_ceil(LANES)], (block, columns), |j| {
            // Next to a pivot of 0 stand zeros; what rounding leaves there must not be magnified.
            let usable = self.pivots[j] * self.pivots[j] > 2.0 * PIVOT_FLOOR * self.items[j].curvature;
            if usable { self.inverses[j] } else { 0.0 }
        });
    }

    fn set_pivot(&mut self, i: usize) {
        let item = &self.items[i];
        let row = row_of(&self.cholesky, i);
        let pivot = (item.diagonal() - dot(row, row)).max(PIVOT_FLOOR * item.curvature).sqrt();
        (self.pivots[i], self.inverses[i]) = (pivot, 1.0 / pivot);
    }

    /// Solves M d = right-hand side in place, for the factored set.
    pub(crate) fn solve(&self, d: &mut [Block]) {
        let count = self.items.len();
        for block in 0..count.div_ceil(LANES) {
            substitute(&self.cholesky, d, (block, LANES.min(count - block * LANES)), |j| self.inverses[j]);
        }
        for i in (0..count).rev() {
            let v = d[i / LANES][i % LANES] * self.inverses[i];
            d[i / LANES][i % LANES] = v;
            for (d, row) in d.iter_mut().zip(row_of(&self.cholesky, i)) {
                for lane in 0..LANES {
                    d[lane] -= v * row[lane];
                }
            }
        }
    }

    /// One Newton step on the dual, followed through the kinks at the L1 weights up to its maximum or the first multiplier 0.
    pub(crate) fn walk(&mut self) -> Walk {
        let mut direction = std::mem::take(&mut self.direction);
        let d = direction.as_flattened_mut();
        for (d, item) in d.iter_mut().zip(&mut self.items) {
            *d = item.slope;
            // M d is the slope itself.
            item.fall = item.slope;
        }
        self.solve(&mut direction);
        let outcome = self.follow(&direction.as_flattened()[..self.items.len()]);
        self.direction = direction;
        outcome
    }

    fn follow(&mut self, d: &[f64]) -> Walk {
        // Along d, slope and curvature of the dual are the same number until a kink is passed: the maximum is at 1.
        let mut slope: f64 = d.iter().zip(&self.items).map(|(d, item)| d * item.slope).sum();
        let mut curvature = slope;
        let mut rest = 1.0;
        let mut outcome = Walk::Full;
        while let Some((distance, i, event)) = self.next_event(d, rest) {
            self.advance(d, distance);
            slope -= curvature * distance;
            outcome = Walk::Bent;
            if event == Event::Drop {
                self.remove(i);
                self.requeue_bent();
                return outcome;
            }
            curvature += d[i] * self.bend(i, d[i], event);
            rest = if slope > 0.0 && curvature > 0.0 { slope / curvature } else { 0.0 };
        }
        self.advance(d, rest);
        self.requeue_bent();
        outcome
    }

    /// The first event nearer than `rest`, the first item at a tie.
    fn next_event(&self, d: &[f64], rest: f64) -> Option<(f64, usize, Event)> {
        let mut next = None;
        let mut nearest = rest;
        for (i, (item, &rate)) in self.items.iter().zip(d).enumerate() {
            if let Some((distance, event)) = item.event(rate)
                && distance < nearest
            {
                nearest = distance.max(0.0);
                next = Some((nearest, i, event));
            }
        }
        next
    }

    fn advance(&mut self, d: &[f64], distance: f64) {
        for (item, rate) in self.items.iter_mut().zip(d) {
            item.amount += distance * rate;
            item.slope -= distance * item.fall;
        }
    }

    /// Moves item `i` to its other piece; returns what this adds to (M d)_i.
    fn bend(&mut self, i: usize, rate: f64, event: Event) -> f64 {
        let item = &mut self.items[i];
        item.soft = event == Event::Soften;
        item.amount = if item.soft { 0.0 } else { item.l1_weight };
        item.bent = !item.bent;
        let change = if item.soft { rate * item.compliance } else { -rate * item.compliance };
        item.fall += change;
        change
    }

    pub(crate) fn remove(&mut self, i: usize) {
        self.remove_factor(i);
        let item = self.items.remove(i);
        self.member[item.id] = false;
    }

    /// Moves the items whose diagonal of M has changed to the end, where the factor is still to come.
    pub(crate) fn requeue_bent(&mut self) {
        let bent = self.items.iter().filter(|item| item.bent).count();
        if bent > MANY_BENT {
            return self.drop_bent();
        }
        let mut i = 0;
        for _ in 0..if bent > 0 { self.items.len() } else { 0 } {
            if self.items[i].bent {
                self.remove_factor(i);
                let item = self.items.remove(i);
                self.items.push(Active { bent: false, ..item });
            } else {
                i += 1;
            }
        }
    }

    /// Drops the factor from the first item on whose diagonal of M has changed.
    fn drop_bent(&mut self) {
        for i in (0..self.items.len()).rev() {
            if std::mem::take(&mut self.items[i].bent) {
                self.factored = self.factored.min(i);
            }
        }
    }

    /// Takes item `i` out of the factor: row i goes, and plane rotations of the columns bring what is left back to
    /// triangular form (Golub and Van Loan, 2013, section 6.5.4).
    fn remove_factor(&mut self, i: usize) {
        if i >= self.factored {
            return;
        }
        for column in i..self.factored - 1 {
            // The row below the diagonal has its last two entries here; what the rotation leaves of them is its pivot.
            let (a, b) = (self.entries(column + 1)[column], self.pivots[column + 1]);
            let length = (a * a + b * b).sqrt();
            let (cos, sin) = (a / length, b / length);
            (self.pivots[column], self.inverses[column]) = (length, 1.0 / length);
            for row in column + 2..self.factored {
                let entries = self.entries(row);
                let (a, b) = (entries[column], entries[column + 1]);
                (entries[column], entries[column + 1]) = (cos * a + sin * b, cos * b - sin * a);
            }
        }
        for row in i + 1..self.factored {
            // What was below the pivot's column is the pivot's row now.
            self.entries(row)[row - 1] = 0.0;
            let start = row_start(row);
            self.cholesky.copy_within(start..start + (row - 1).div_ceil(LANES), row_start(row - 1));
        }
        self.factored -= 1;
    }

    /// Row `i` of the factor, number by number.
    fn entries(&mut self, i: usize) -> &mut [f64] {
        let start = row_start(i);
        self.cholesky[start..start + i.div_ceil(LANES)].as_flattened_mut()
    }
}

/// Where row `i` of the factor begins: the sum of the blocks of `m` numbers over all m < i.
fn row_start(i: usize) -> usize {
    let last = i.saturating_sub(1);
    let full = last / LANES;
    (LANES * full / 2 + last % LANES) * (full + 1)
}

/// One block of the solution of L y = right-hand side, in place; those before it are done. `inverse` has the reciprocals of
/// the diagonal of L.
fn substitute(cholesky: &[Block], y: &mut [Block], (block, count): (usize, usize), inverse: impl Fn(usize) -> f64) {
    if count == 0 {
        return;
    }
    let first = block * LANES;
    let (before, rest) = y.split_at_mut(block);
    let mut here = rest[0];
    if block > 0 {
        for (lane, value) in here[..count].iter_mut().enumerate() {
            *value -= dot(before, row_of(cholesky, first + lane));
        }
    }
    here[0] *= inverse(first);
    for lane in 1..count {
        let row = &cholesky[row_start(first + lane) + block];
        let mut value = here[lane];
        for m in 0..lane {
            value -= here[m] * row[m];
        }
        here[lane] = value * inverse(first + lane);
    }
    rest[0] = here;
}

fn row_of(cholesky: &[Block], i: usize) -> &[Block] {
    let start = row_start(i);
    &cholesky[start..start + i.div_ceil(LANES)]
}
