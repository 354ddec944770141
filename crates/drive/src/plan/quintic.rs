//! The lateral motion of a lane change: a polynomial of fifth degree in time (Eqs. 12–14).
//!
//! The paper writes the polynomial over the distance travelled and starts it at rest in the middle of the lane. At constant speed
//! distance and time are proportional, so time is used here; and the start is the measured lateral state, so that a change begun
//! while drifting, or broken off half-way, has no jump (Eq. 14 is the special case of a start at rest).

use serde::{Deserialize, Serialize};

/// Lateral position and its first two derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LateralState {
    /// Position to the left of the reference line, m.
    pub d_m: f64,
    /// Speed to the left, m/s.
    pub speed_mps: f64,
    /// Acceleration to the left, m/s².
    pub accel_mps2: f64,
}

/// d(t) = Σ cᵢ tⁱ on [0, `duration_s`]; before and after it stays where it begins and ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quintic {
    /// Coefficients c₀ … c₅, m/sⁱ.
    pub coefficients: [f64; 6],
    /// Duration t_c, s.
    pub duration_s: f64,
}

impl Quintic {
    /// From the state `start` to rest at `end_m` within `duration_s` (> 0).
    pub fn new(start: LateralState, end_m: f64, duration_s: f64) -> Self {
        let LateralState { d_m: d, speed_mps: v, accel_mps2: a } = start;
        let t = duration_s;
        let shift = end_m - d;
        let (vt, at2) = (v * t, a * t * t);
        let t3 = t * t * t;
        let coefficients = [
            d,
            v,
            0.5 * a,
            (20.0 * shift - 12.0 * vt - 3.0 * at2) / (2.0 * t3),
            (-30.0 * shift + 16.0 * vt + 3.0 * at2) / (2.0 * t3 * t),
            (12.0 * shift - 6.0 * vt - at2) / (2.0 * t3 * t * t),
        ];
        Self { coefficients, duration_s }
    }

    /// A path that stays where it is.
    pub fn resting_at(d_m: f64) -> Self {
        Self { coefficients: [d_m, 0.0, 0.0, 0.0, 0.0, 0.0], duration_s: 1.0 }
    }

    /// Position (m), speed (m/s), acceleration (m/s²) and jerk (m/s³) to the left at `time_s`; at rest outside of the duration.
    #[inline]
    pub fn at(&self, time_s: f64) -> (f64, f64, f64, f64) {
        let t = time_s.clamp(0.0, self.duration_s);
        let d = self.position_within_m(t);
        if t != time_s {
            return (d, 0.0, 0.0, 0.0);
        }
        let [_, c1, c2, c3, c4, c5] = self.coefficients;
        let speed = c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)));
        let accel = 2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5));
        let jerk = 6.0 * c3 + t * (24.0 * c4 + t * 60.0 * c5);
        (d, speed, accel, jerk)
    }

    /// Position at a time within the duration, m.
    // Must be inlined into what `pulp` compiles for the processor's instruction set.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub(super) fn position_within_m(&self, time_s: f64) -> f64 {
        let ([c0, c1, c2, c3, c4, c5], t) = (self.coefficients, time_s);
        c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
    }

    /// Largest |d̈| on the whole duration, m/s², from the roots of the jerk.
    pub fn max_accel_mps2(&self) -> f64 {
        self.max_of_accel_and_jerk(1.0, 0.0)
    }

    /// Largest |`accel_share` · d̈ + `jerk_share` · d⃛| on the whole duration: a cubic, whose extrema are roots of a quadratic.
    pub fn max_of_accel_and_jerk(&self, accel_share: f64, jerk_share: f64) -> f64 {
        let [_, _, c2, c3, c4, c5] = self.coefficients;
        let (a, j) = (accel_share, jerk_share);
        let cubic =
            [a * 2.0 * c2 + j * 6.0 * c3, a * 6.0 * c3 + j * 24.0 * c4, a * 12.0 * c4 + j * 60.0 * c5, a * 20.0 * c5];
        let value = |t: f64| (cubic[0] + t * (cubic[1] + t * (cubic[2] + t * cubic[3]))).abs();
        let mut largest = value(0.0).max(value(self.duration_s));
        for t in quadratic_roots([cubic[1], 2.0 * cubic[2], 3.0 * cubic[3]]).into_iter().flatten() {
            if t > 0.0 && t < self.duration_s {
                largest = largest.max(value(t));
            }
        }
        largest
    }

    /// Largest |ḋ| on the whole duration, m/s, from the roots of d̈, which lie alone between the roots of the jerk.
    pub fn max_speed_mps(&self) -> f64 {
        let [_, _, _, c3, c4, c5] = self.coefficients;
        let mut largest = self.at(0.0).1.abs().max(self.at(self.duration_s).1.abs());
        let mut low = 0.0;
        let ends = quadratic_roots([6.0 * c3, 24.0 * c4, 60.0 * c5]);
        for end in ends.into_iter().flatten().chain([self.duration_s]) {
            let high = end.clamp(low, self.duration_s);
            largest = largest.max(self.at(self.accel_root(low, high)).1.abs());
            low = high;
        }
        largest
    }

    /// Where d̈ changes its sign between `low_s` and `high_s`, by bisection; an end of the interval where it does not.
    ///
    /// The speed is flat there, so that 32 halvings leave an error below one part in 10¹⁸.
    fn accel_root(&self, mut low_s: f64, mut high_s: f64) -> f64 {
        let positive_at_low = self.at(low_s).2 > 0.0;
        for _ in 0..32 {
            let middle_s = 0.5 * (low_s + high_s);
            if (self.at(middle_s).2 > 0.0) == positive_at_low {
                low_s = middle_s;
            } else {
                high_s = middle_s;
            }
        }
        low_s
    }
}

/// Real roots of p₀ + p₁ t + p₂ t², the smaller first; a double root once.
fn quadratic_roots([p0, p1, p2]: [f64; 3]) -> [Option<f64>; 2] {
    if p2 == 0.0 {
        return [(p1 != 0.0).then(|| -p0 / p1), None];
    }
    let discriminant = p1 * p1 - 4.0 * p2 * p0;
    if discriminant < 0.0 {
        return [None, None];
    }
    // The sum of two numbers of equal sign does not cancel; the other root follows from the product of the two.
    let q = -0.5 * (p1 + discriminant.sqrt().copysign(p1));
    if q == 0.0 {
        return [Some(0.0), None];
    }
    let (r, s) = (q / p2, p0 / q);
    [Some(r.min(s)), Some(r.max(s))]
}

#[cfg(test)]
mod tests {
    use lanecraft_net::random::Stream;

    use super::*;

    fn random_start(stream: &mut Stream) -> (LateralState, f64, f64) {
        let start = LateralState {
            d_m: stream.range(-1.0, 8.0),
            speed_mps: stream.range(-1.5, 1.5),
            accel_mps2: stream.range(-2.0, 2.0),
        };
        (start, stream.range(-1.0, 8.0), stream.range(1.5, 8.0))
    }

    #[test]
    fn it_joins_the_measured_state_to_rest_in_the_lane() {
        let mut stream = Stream::new(1, "quintic");
        for _ in 0..500 {
            let (start, end_m, duration_s) = random_start(&mut stream);
            let path = Quintic::new(start, end_m, duration_s);
            let (d, v, a, _) = path.at(0.0);
            assert_eq!((d, v, a), (start.d_m, start.speed_mps, start.accel_mps2));
            let (d, v, a, _) = path.at(duration_s);
            assert!((d - end_m).abs() < 1e-9 && v.abs() < 1e-9 && a.abs() < 1e-9);
            assert_eq!(path.at(duration_s + 1.0), (path.at(duration_s).0, 0.0, 0.0, 0.0));
        }
    }

    #[test]
    fn from_rest_it_is_equation_14() {
        let (shift, duration) = (3.75, 2.5);
        let path = Quintic::new(LateralState::default(), shift, duration);
        for k in 0..=25 {
            let x = f64::from(k) / 25.0;
            let expected = shift * (10.0 * x * x * x - 15.0 * x * x * x * x + 6.0 * x * x * x * x * x);
            assert!((path.at(x * duration).0 - expected).abs() < 1e-12);
        }
        // Closed forms of its extrema: 1.875 F / t_c at half time and (10/√3) F / t_c².
        assert!((path.max_speed_mps() - 1.875 * shift / duration).abs() < 1e-12);
        assert!((path.max_accel_mps2() - 10.0 / 3.0_f64.sqrt() * shift / (duration * duration)).abs() < 1e-12);
    }

    #[test]
    fn derivatives_agree_with_finite_differences() {
        let start = LateralState { d_m: 0.2, speed_mps: -0.4, accel_mps2: 0.7 };
        let path = Quintic::new(start, 3.75, 3.0);
        let h = 1e-5;
        for k in 1..30 {
            let t = 0.1 * f64::from(k);
            let (below, here, above) = (path.at(t - h), path.at(t), path.at(t + h));
            assert!(((above.0 - below.0) / (2.0 * h) - here.1).abs() < 1e-8);
            assert!(((above.1 - below.1) / (2.0 * h) - here.2).abs() < 1e-8);
            assert!(((above.2 - below.2) / (2.0 * h) - here.3).abs() < 1e-8);
        }
    }

    #[test]
    fn extrema_by_roots_are_those_of_a_dense_sampling() {
        let mut stream = Stream::new(2, "extrema");
        for _ in 0..300 {
            let (start, end_m, duration_s) = random_start(&mut stream);
            let path = Quintic::new(start, end_m, duration_s);
            let (mut speed, mut accel, mut mixed) = (0.0_f64, 0.0_f64, 0.0_f64);
            for k in 0..=4000 {
                let (_, v, a, j) = path.at(duration_s * (f64::from(k) / 4000.0));
                speed = speed.max(v.abs());
                accel = accel.max(a.abs());
                mixed = mixed.max((0.3 * a - 0.2 * j).abs());
            }
            // Sampling misses a smooth extremum by its curvature times (duration/8000)², here below 1e-4.
            for (exact, sampled) in [
                (path.max_speed_mps(), speed),
                (path.max_accel_mps2(), accel),
                (path.max_of_accel_and_jerk(0.3, -0.2), mixed),
            ] {
                assert!(exact >= sampled - 1e-12 && exact <= sampled + 1e-4, "{exact} against {sampled}");
            }
        }
    }

    #[test]
    fn quadratic_roots_survive_cancellation() {
        assert_eq!(quadratic_roots([2.0, -3.0, 1.0]), [Some(1.0), Some(2.0)]);
        assert_eq!(quadratic_roots([1.0, 0.0, 1.0]), [None, None]);
        assert_eq!(quadratic_roots([-4.0, 2.0, 0.0]), [Some(2.0), None]);
        assert_eq!(quadratic_roots([0.0, 0.0, 0.0]), [None, None]);
        let [small, _] = quadratic_roots([1.0, -1e9, 1.0]);
        assert!((small.expect("two roots") - 1e-9).abs() < 1e-24);
    }
}
