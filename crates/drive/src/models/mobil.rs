//! Lane choice: MOBIL, minimizing overall braking induced by lane changes (Kesting, Treiber and Helbing, 2007).
//!
//! A change pays if ã_c − a_c + p [(ã_n − a_n) + (ã_o − a_o)] > Δa_th and is allowed if ã_n ≥ −b_safe, where c changes, n follows
//! it afterwards, o follows it before, and a tilde marks the situation after the change. Symmetric rules: neither side is
//! preferred. Beyond the paper, the changer itself must not have to brake harder than b_safe either.

/// Parameters of the lane choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MobilParams {
    /// Weight p of the others' gain.
    pub politeness: f64,
    /// Gain Δa_th below which nobody bothers to change, m/s².
    pub accel_gain_threshold_mps2: f64,
    /// Hardest braking b_safe that a change may force, m/s² (positive).
    pub safe_decel_mps2: f64,
}

/// Accelerations without and with the change, m/s².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AccelChange {
    /// If the lane is kept.
    pub keep_mps2: f64,
    /// If the lane is changed.
    pub change_mps2: f64,
}

impl AccelChange {
    fn gain_mps2(self) -> f64 {
        self.change_mps2 - self.keep_mps2
    }
}

/// What the change means to the three concerned; an absent follower has the default, which is no gain.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MobilSituation {
    /// The vehicle that may change.
    pub changer: AccelChange,
    /// Its follower in the new lane.
    pub new_follower: AccelChange,
    /// Its follower in the old lane.
    pub old_follower: AccelChange,
}

/// The weighted gain in m/s² if the change is allowed and pays, else `None`.
pub fn mobil_gain(situation: &MobilSituation, params: &MobilParams) -> Option<f64> {
    let hardest_mps2 = situation.new_follower.change_mps2.min(situation.changer.change_mps2);
    if hardest_mps2 < -params.safe_decel_mps2 {
        return None;
    }
    let others_mps2 = situation.new_follower.gain_mps2() + situation.old_follower.gain_mps2();
    let gain_mps2 = situation.changer.gain_mps2() + params.politeness * others_mps2;
    (gain_mps2 > params.accel_gain_threshold_mps2).then_some(gain_mps2)
}

#[cfg(test)]
mod tests {
    use super::{AccelChange, MobilParams, MobilSituation, mobil_gain};

    const PARAMS: MobilParams = MobilParams { politeness: 0.5, accel_gain_threshold_mps2: 0.2, safe_decel_mps2: 3.0 };

    fn change(keep_mps2: f64, change_mps2: f64) -> AccelChange {
        AccelChange { keep_mps2, change_mps2 }
    }

    #[test]
    fn decision_table() {
        let none = AccelChange::default();
        // Changer, new follower, old follower, expected gain.
        let rows = [
            (change(-1.0, 0.5), none, none, Some(1.5)),
            (change(0.0, 0.25), none, none, Some(0.25)),
            // Not above the threshold.
            (change(0.0, 0.2), none, none, None),
            // The new follower loses 2, which weighs 1.
            (change(0.0, 1.5), change(0.0, -2.0), none, Some(0.5)),
            (change(0.0, 1.0), change(0.0, -2.0), none, None),
            // The old follower's gain alone is worth a change.
            (none, none, change(-1.0, 0.0), Some(0.5)),
            // Forced braking beyond the safe deceleration forbids any gain.
            (change(-8.0, 1.0), change(0.0, -3.1), none, None),
            (change(-8.0, 1.0), change(0.0, -3.0), none, Some(7.5)),
            (change(-8.0, -3.5), none, none, None),
        ];
        for (changer, new_follower, old_follower, expected) in rows {
            let situation = MobilSituation { changer, new_follower, old_follower };
            assert_eq!(mobil_gain(&situation, &PARAMS), expected, "{situation:?}");
        }
    }

    #[test]
    fn the_way_back_gains_what_the_way_there_lost() {
        let there = MobilSituation {
            changer: change(-1.0, 0.7),
            new_follower: change(0.3, -0.4),
            old_follower: change(-0.2, 0.1),
        };
        let back = MobilSituation {
            changer: change(0.7, -1.0),
            new_follower: change(0.1, -0.2),
            old_follower: change(-0.4, 0.3),
        };
        let params = MobilParams { accel_gain_threshold_mps2: -10.0, ..PARAMS };
        let (there, back) = (mobil_gain(&there, &params), mobil_gain(&back, &params));
        assert!((there.expect("allowed") + back.expect("allowed")).abs() < 1e-15);
    }
}
