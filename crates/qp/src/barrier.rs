//! The inequalities of one stage in the interior point, side by side, their slacks eliminated in closed form
//! (docs/qp.md, Eqs. 14 to 17).

// Indices as in the equations.
#![allow(clippy::needless_range_loop)]

use crate::linalg::larger;

/// How often the slack of a start is improved; it need not be exact.
const REFINEMENTS: u32 = 2;

/// x > 0 with a x² + b x = c, for a, c > 0.
fn positive_root(a: f64, b: f64, c: f64) -> f64 {
    let root = (b * b + 4.0 * a * c).sqrt();
    if b > 0.0 { 2.0 * c / (b + root) } else { (root - b) / (2.0 * a) }
}

/// What a positive number and its step look like to all barriers.
#[derive(Clone, Copy, Debug)]
struct Positive<const M: usize> {
    value: [f64; M],
    inverse: [f64; M],
    change: [f64; M],
}

impl<const M: usize> Positive<M> {
    fn new(value: f64) -> Self {
        Self { value: [value; M], inverse: [1.0; M], change: [0.0; M] }
    }

    fn invert(&mut self) {
        for i in 0..M {
            self.inverse[i] = 1.0 / self.value[i];
        }
    }

    /// By how much the step must be divided so that the numbers stay positive, if that is more than `limit`.
    fn shortening(&self, mut limit: [f64; M]) -> [f64; M] {
        for i in 0..M {
            limit[i] = larger(-self.change[i] * self.inverse[i], limit[i]);
        }
        limit
    }

    fn advance(&mut self, step: f64) {
        for i in 0..M {
            self.value[i] += step * self.change[i];
        }
    }
}

/// M constraints `sign` (value) + t = `bound` + s with t, s > 0, and the multipliers λ of t and v of s. Without slack if not
/// `SOFT`. One whose bound is infinite takes part in everything with `present` = 0, which leaves it as it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Barriers<const M: usize, const SOFT: bool> {
    present: [f64; M],
    sign: [f64; M],
    bound: [f64; M],
    l1_weight: [f64; M],
    l2_weight: [f64; M],
    distance: Positive<M>,
    multiplier: Positive<M>,
    slack: Positive<M>,
    slack_multiplier: Positive<M>,
    /// Products of the predictor's changes, which the corrector takes back.
    cross: [[f64; M]; 2],
    /// λ/t, and the compliance 1 / (λ/t + w2 + v/s) of the slack.
    stiffness: [f64; M],
    compliance: [f64; M],
    /// Of the value, in the Newton system.
    weight: [f64; M],
    /// Residuals of (14): (target - λ t) / t, that of the slack, that of the multipliers, and that of the constraint.
    aim: [f64; M],
    slack_aim: [f64; M],
    dual: [f64; M],
    off: [f64; M],
}

impl<const M: usize, const SOFT: bool> Barriers<M, SOFT> {
    /// Barriers that are not there.
    pub(crate) fn none() -> Self {
        Self {
            present: [0.0; M],
            sign: [1.0; M],
            bound: [0.0; M],
            l1_weight: [0.0; M],
            l2_weight: [1.0; M],
            distance: Positive::new(1.0),
            multiplier: Positive::new(0.0),
            slack: Positive::new(1.0),
            slack_multiplier: Positive::new(0.0),
            cross: [[0.0; M]; 2],
            stiffness: [0.0; M],
            compliance: [0.0; M],
            weight: [0.0; M],
            aim: [0.0; M],
            slack_aim: [0.0; M],
            dual: [0.0; M],
            off: [0.0; M],
        }
    }

    /// Sets constraint `i` up at a value, centered: λ t = v s = `gap`, and if it is soft, nearly λ + v = w1 + w2 s. A hard one
    /// must be kept by the value.
    pub(crate) fn set(&mut self, i: usize, (sign, bound): (f64, f64), (l1, l2): (f64, f64), (value, gap): (f64, f64)) {
        if bound == f64::INFINITY {
            return;
        }
        let violation = sign * value - bound;
        let (mut slack, mut distance) = (1.0, -violation);
        if SOFT {
            // The smaller x of s and t, which differ by the violation, solves w2 x² + (b - gap / (x + |violation|)) x = gap.
            let b = l1 + l2 * violation.max(0.0);
            let mut x = positive_root(l2, b, gap);
            for _ in 0..REFINEMENTS {
                x = positive_root(l2, b - gap / (x + violation.abs()), gap);
            }
            (slack, distance) = if violation > 0.0 { (x + violation, x) } else { (x, x - violation) };
            (self.l1_weight[i], self.l2_weight[i]) = (l1, l2);
            self.slack_multiplier.value[i] = gap / slack;
        }
        (self.present[i], self.sign[i], self.bound[i]) = (1.0, sign, bound);
        (self.slack.value[i], self.distance.value[i], self.multiplier.value[i]) = (slack, distance, gap / distance);
    }

    /// Products that are to vanish: one for each constraint, and one for each slack.
    pub(crate) fn count(&self) -> f64 {
        self.present.iter().sum::<f64>() * if SOFT { 2.0 } else { 1.0 }
    }

    /// Sum of λ t + s v after a step along the direction.
    pub(crate) fn gap_after(&self, step: f64) -> f64 {
        let after = |p: &Positive<M>, i: usize| p.value[i] + step * p.change[i];
        let mut gap = 0.0;
        for i in 0..M {
            gap += after(&self.multiplier, i) * after(&self.distance, i);
            if SOFT {
                gap += after(&self.slack, i) * after(&self.slack_multiplier, i);
            }
        }
        gap
    }

    /// What the corrector is to take back of the present direction.
    pub(crate) fn keep_cross(&mut self) {
        for i in 0..M {
            self.cross[0][i] = self.distance.change[i] * self.multiplier.change[i];
            self.cross[1][i] = self.slack.change[i] * self.slack_multiplier.change[i];
        }
    }

    /// Everything that this iterate fixes for all directions; returns the weights of the values in the Newton system.
    pub(crate) fn linearize(&mut self, values: &[f64; M]) -> [f64; M] {
        self.cross = [[0.0; M]; 2];
        self.distance.invert();
        self.multiplier.invert();
        for i in 0..M {
            self.stiffness[i] = self.multiplier.value[i] * self.distance.inverse[i];
            self.off[i] = self.sign[i] * values[i] + self.distance.value[i] - self.bound[i];
        }
        self.weight = self.stiffness;
        if SOFT {
            self.linearize_slacks();
        }
        for i in 0..M {
            self.off[i] *= self.present[i];
        }
        self.weight
    }

    fn linearize_slacks(&mut self) {
        self.slack.invert();
        self.slack_multiplier.invert();
        for i in 0..M {
            let slack_stiffness = self.l2_weight[i] + self.slack_multiplier.value[i] * self.slack.inverse[i];
            self.compliance[i] = 1.0 / (self.stiffness[i] + slack_stiffness);
            self.weight[i] *= slack_stiffness * self.compliance[i];
            self.off[i] -= self.slack.value[i];
            let owed = self.l1_weight[i] + self.l2_weight[i] * self.slack.value[i];
            self.dual[i] = self.present[i] * (owed - self.multiplier.value[i] - self.slack_multiplier.value[i]);
        }
    }

    /// The linear terms that stand beside the weights in the Newton system, for the values themselves (not their changes).
    pub(crate) fn pull(&mut self, values: &[f64; M], target: f64) -> [f64; M] {
        let mut pull = [0.0; M];
        for i in 0..M {
            self.aim[i] =
                (self.present[i] * target - self.cross[0][i]) * self.distance.inverse[i] - self.multiplier.value[i];
            let mut push =
                self.multiplier.value[i] + self.aim[i] + self.weight[i] * (self.off[i] - self.sign[i] * values[i]);
            if SOFT {
                let toward = (self.present[i] * target - self.cross[1][i]) * self.slack.inverse[i];
                self.slack_aim[i] = self.aim[i] + toward - self.slack_multiplier.value[i] - self.dual[i];
                push -= self.stiffness[i] * self.compliance[i] * self.slack_aim[i];
            }
            pull[i] = self.sign[i] * push;
        }
        pull
    }

    /// The direction that belongs to these changes of the values, after [`Self::pull`]; returns by how much the step must be
    /// divided so that all four numbers stay positive, if that is more than `limit`.
    pub(crate) fn aim_at(&mut self, changes: &[f64; M], limit: [f64; M]) -> [f64; M] {
        for i in 0..M {
            let change = self.present[i] * self.sign[i] * changes[i] + self.off[i];
            let slack = (self.slack_aim[i] + self.stiffness[i] * change) * self.compliance[i];
            self.distance.change[i] = slack - change;
            self.multiplier.change[i] = self.aim[i] - self.stiffness[i] * self.distance.change[i];
            if SOFT {
                self.slack.change[i] = slack;
                self.slack_multiplier.change[i] = self.l2_weight[i] * slack + self.dual[i] - self.multiplier.change[i];
            }
        }
        let limit = self.multiplier.shortening(self.distance.shortening(limit));
        if SOFT { self.slack_multiplier.shortening(self.slack.shortening(limit)) } else { limit }
    }

    pub(crate) fn advance(&mut self, step: f64) {
        self.distance.advance(step);
        self.multiplier.advance(step);
        if SOFT {
            self.slack.advance(step);
            self.slack_multiplier.advance(step);
        }
    }

    /// Sign, multiplier and stiffness λ/t of constraint `i`.
    pub(crate) fn pressure(&self, i: usize) -> (f64, f64, f64) {
        let multiplier = self.multiplier.value[i];
        (self.sign[i], multiplier, multiplier / self.distance.value[i])
    }
}
