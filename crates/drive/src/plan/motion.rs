//! Motion of a candidate: across the road a quintic, along it a speed that changes smoothly by the end.
//!
//! The paper holds the speed. Here it may end higher or lower: v = v₀ + Δ (3x² − 2x³) with x = t/t_c, from no acceleration to none,
//! so that the way is a quartic in time, as that of Werling et al. (2010) for keeping a speed.

use serde::{Deserialize, Serialize};

use super::quintic::Quintic;

/// A candidate's motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Lateral position over time.
    pub lateral: Quintic,
    /// Speed along the road at the begin, m/s.
    pub speed_mps: f64,
    /// By how much the speed at the end is higher, m/s.
    pub speed_change_mps: f64,
}

impl Motion {
    /// The motion along the road.
    pub fn course(&self) -> Course {
        // Where the speed does not change its duration does not matter, so that candidates of all durations are one course.
        let duration_s = if self.speed_change_mps == 0.0 { 1.0 } else { self.lateral.duration_s };
        Course { speed_mps: self.speed_mps, change_mps: self.speed_change_mps, duration_s }
    }
}

/// Motion along the road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    speed_mps: f64,
    change_mps: f64,
    duration_s: f64,
}

impl Course {
    /// Way from the begin (m), speed (m/s) and jerk (m/s³) at `time_s`; after the change at constant speed.
    pub fn at(&self, time_s: f64) -> (f64, f64, f64) {
        let x = (time_s / self.duration_s).clamp(0.0, 1.0);
        let (change, duration_s) = (self.change_mps, self.duration_s);
        let speed_mps = self.speed_mps + change * (x * x * (3.0 - 2.0 * x));
        let beyond_s = time_s - x * duration_s;
        let gained_m = change * (duration_s * (x * x * x * (1.0 - 0.5 * x)) + beyond_s);
        let jerk_mps3 = if x < 1.0 { change / (duration_s * duration_s) * (6.0 - 12.0 * x) } else { 0.0 };
        (self.speed_mps * time_s + gained_m, speed_mps, jerk_mps3)
    }

    /// Largest |v̇|, m/s²: at half time.
    pub fn max_accel_mps2(&self) -> f64 {
        1.5 * self.change_mps.abs() / self.duration_s
    }

    /// Speed at the end, m/s.
    pub fn end_speed_mps(&self) -> f64 {
        self.speed_mps + self.change_mps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::quintic::LateralState;

    fn motion(speed_change_mps: f64) -> Motion {
        let lateral = Quintic::new(LateralState::default(), 3.75, 4.0);
        Motion { lateral, speed_mps: 25.0, speed_change_mps }
    }

    #[test]
    fn way_speed_and_jerk_are_derivatives_of_each_other() {
        let course = motion(-3.0).course();
        let h = 1e-4;
        let mut largest = 0.0_f64;
        for k in 1..400 {
            let t = 0.01 * f64::from(k);
            let (below, here, above) = (course.at(t - h), course.at(t), course.at(t + h));
            assert!(((above.0 - below.0) / (2.0 * h) - here.1).abs() < 1e-7);
            assert!(((above.1 - 2.0 * here.1 + below.1) / (h * h) - here.2).abs() < 1e-5);
            largest = largest.max((above.1 - below.1).abs() / (2.0 * h));
        }
        assert!((largest - course.max_accel_mps2()).abs() < 1e-4);
        assert_eq!((course.at(0.0), course.end_speed_mps()), ((0.0, 25.0, -3.0 / 16.0 * 6.0), 22.0));
        // Half of the change is gained over the duration, all of it later.
        assert!((course.at(4.0).0 - (100.0 - 6.0)).abs() < 1e-12 && (course.at(5.0).0 - 116.0).abs() < 1e-12);
    }

    #[test]
    fn a_held_speed_is_one_course_for_all_durations() {
        let longer = Motion { lateral: Quintic::new(LateralState::default(), 3.75, 6.0), ..motion(0.0) };
        assert_eq!(motion(0.0).course(), longer.course());
        assert_ne!(motion(1.0).course(), Motion { speed_change_mps: 1.0, ..longer }.course());
        assert_eq!(motion(0.0).course().at(7.0), (175.0, 25.0, 0.0));
    }
}
