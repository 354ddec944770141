//! One inequality of the interior point, its slack eliminated in closed form (docs/qp.md, Eqs. 14 to 17).

/// How often the slack of a start is improved; it need not be exact.
const REFINEMENTS: u32 = 2;

/// x > 0 with a x² + b x = c, for a, c > 0.
fn positive_root(a: f64, b: f64, c: f64) -> f64 {
    let root = (b * b + 4.0 * a * c).sqrt();
    if b > 0.0 { 2.0 * c / (b + root) } else { (root - b) / (2.0 * a) }
}

/// `sign` (its value) + t = `bound` + s with t, s > 0, and the multipliers λ of t and v of s. Without slack if `l2_weight` is 0;
/// not there if `bound` is infinite.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Barrier {
    sign: f64,
    bound: f64,
    l1_weight: f64,
    l2_weight: f64,
    distance: f64,
    multiplier: f64,
    slack: f64,
    slack_multiplier: f64,
    /// Present direction of the four, in this order.
    direction: [f64; 4],
    /// Products of the predictor's changes, which the corrector takes back.
    cross: [f64; 2],
    /// λ/t, 1/t, 1/s and the compliance 1 / (λ/t + w2 + v/s) of the slack.
    stiffness: f64,
    slack_compliance: f64,
    /// Of the value, in the Newton system.
    weight: f64,
    inverse_distance: f64,
    inverse_slack: f64,
}

impl Barrier {
    /// A barrier that is not there.
    pub(crate) const NONE: Self = Self {
        sign: 1.0,
        bound: f64::INFINITY,
        l1_weight: 0.0,
        l2_weight: 0.0,
        distance: 1.0,
        multiplier: 0.0,
        slack: 1.0,
        slack_multiplier: 0.0,
        direction: [0.0; 4],
        cross: [0.0; 2],
        stiffness: 0.0,
        slack_compliance: 0.0,
        weight: 0.0,
        inverse_distance: 1.0,
        inverse_slack: 1.0,
    };

    /// A soft constraint at a value of its row, centered: λ t = v s = `gap`, and nearly λ + v = w1 + w2 s.
    pub(crate) fn soft((sign, bound): (f64, f64), (l1, l2): (f64, f64), value: f64, gap: f64) -> Self {
        if bound == f64::INFINITY {
            return Self::NONE;
        }
        let violation = sign * value - bound;
        // The smaller x of s and t, which differ by the violation, solves w2 x² + (b - gap / (x + |violation|)) x = gap.
        let b = l1 + l2 * violation.max(0.0);
        let mut x = positive_root(l2, b, gap);
        for _ in 0..REFINEMENTS {
            x = positive_root(l2, b - gap / (x + violation.abs()), gap);
        }
        let (slack, distance) = if violation > 0.0 { (x + violation, x) } else { (x, x - violation) };
        Self {
            sign,
            bound,
            l1_weight: l1,
            l2_weight: l2,
            distance,
            multiplier: gap / distance,
            slack,
            slack_multiplier: gap / slack,
            ..Self::NONE
        }
    }

    /// A hard constraint at a value inside its bound.
    pub(crate) fn hard((sign, bound): (f64, f64), value: f64, gap: f64) -> Self {
        if bound == f64::INFINITY {
            return Self::NONE;
        }
        let distance = bound - sign * value;
        Self { sign, bound, distance, multiplier: gap / distance, ..Self::NONE }
    }

    pub(crate) fn is_there(&self) -> bool {
        self.bound < f64::INFINITY
    }

    pub(crate) fn is_soft(&self) -> bool {
        self.l2_weight > 0.0
    }

    /// λ t + s v.
    pub(crate) fn gap(&self) -> f64 {
        self.multiplier * self.distance + self.slack * self.slack_multiplier
    }

    /// The same after a step along the direction.
    pub(crate) fn gap_after(&self, step: f64) -> f64 {
        let [dt, dl, ds, dv] = self.direction.map(|d| step * d);
        (self.multiplier + dl) * (self.distance + dt) + (self.slack + ds) * (self.slack_multiplier + dv)
    }

    /// What the corrector is to take back of the present direction.
    pub(crate) fn keep_cross(&mut self) {
        let [dt, dl, ds, dv] = self.direction;
        self.cross = [dt * dl, ds * dv];
    }

    /// Reciprocals of this iterate; returns the weight of the constraint's value in the Newton system.
    pub(crate) fn linearize(&mut self) -> f64 {
        self.cross = [0.0; 2];
        self.inverse_distance = 1.0 / self.distance;
        self.stiffness = self.multiplier * self.inverse_distance;
        self.weight = self.stiffness;
        if !self.is_soft() {
            return self.weight;
        }
        self.inverse_slack = 1.0 / self.slack;
        let slack_stiffness = self.l2_weight + self.slack_multiplier * self.inverse_slack;
        self.slack_compliance = 1.0 / (self.stiffness + slack_stiffness);
        self.weight *= slack_stiffness * self.slack_compliance;
        self.weight
    }

    /// Right-hand sides: (target - λ t) / t, that of the slack, and `sign` value + t - s - bound.
    fn residuals(&self, value: f64, target: f64) -> (f64, f64, f64) {
        let aim = (target - self.cross[0]) * self.inverse_distance - self.multiplier;
        let off = self.sign * value + self.distance - self.bound;
        if !self.is_soft() {
            return (aim, 0.0, off);
        }
        let slack_aim = (target - self.cross[1]) * self.inverse_slack - self.slack_multiplier;
        let dual = self.l1_weight + self.l2_weight * self.slack - self.multiplier - self.slack_multiplier;
        (aim, aim + slack_aim - dual, off - self.slack)
    }

    /// The linear term that stands beside the weight in the Newton system, for the value itself (not its change).
    pub(crate) fn pull(&self, value: f64, target: f64) -> f64 {
        let (aim, slack_aim, off) = self.residuals(value, target);
        let yielded = self.stiffness * self.slack_compliance * slack_aim;
        self.sign * (self.multiplier + aim - yielded + self.weight * (off - self.sign * value))
    }

    /// The direction that belongs to a new value; returns the longest step that keeps all four positive.
    pub(crate) fn aim_at(&mut self, value: f64, new_value: f64, target: f64) -> f64 {
        let (aim, slack_aim, off) = self.residuals(value, target);
        let change = self.sign * (new_value - value) + off;
        let (mut ds, mut dv) = (0.0, 0.0);
        if self.is_soft() {
            ds = (slack_aim + self.stiffness * change) * self.slack_compliance;
            dv = self.l2_weight * ds
                + (self.l1_weight + self.l2_weight * self.slack - self.multiplier - self.slack_multiplier);
        }
        let dt = ds - change;
        let dl = aim - self.stiffness * dt;
        dv -= if self.is_soft() { dl } else { 0.0 };
        self.direction = [dt, dl, ds, dv];
        let mut step = f64::INFINITY;
        for (value, change) in
            [self.distance, self.multiplier, self.slack, self.slack_multiplier].iter().zip(self.direction)
        {
            if change < 0.0 && value + step * change < 0.0 {
                step = -value / change;
            }
        }
        step
    }

    pub(crate) fn advance(&mut self, step: f64) {
        let [dt, dl, ds, dv] = self.direction;
        self.distance += step * dt;
        self.multiplier += step * dl;
        self.slack += step * ds;
        self.slack_multiplier += step * dv;
    }

    /// Sign, multiplier and stiffness λ/t.
    pub(crate) fn pressure(&self) -> (f64, f64, f64) {
        (self.sign, self.multiplier, if self.is_there() { self.multiplier / self.distance } else { 0.0 })
    }
}
