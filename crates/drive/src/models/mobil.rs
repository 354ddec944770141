//! Lane choice: MOBIL, minimizing overall braking induced by lane changes (Kesting, Treiber and Helbing, 2007).
//!
//! A change pays if ã_c − a_c + p [(ã_n − a_n) + (ã_o − a_o)] > Δa_th and is allowed if ã_n ≥ −b_safe, where c changes, n follows
//! it afterwards, o follows it before, and a tilde marks the situation after the change. Beyond the paper, the changer itself
//! must not have to brake harder than b_safe either.
//!
//! Under symmetric rules neither side is preferred. The asymmetric rule of European roads, keep right and pass on the left, is
//!
//! - to the left, ã_c − a_c^eur + p (ã_n − a_n) > Δa_th + Δa_bias,
//! - to the right, ã_c^eur − a_c + p (ã_o − a_o) > Δa_th − Δa_bias,
//!
//! where a^eur is the acceleration in the right one of the two lanes, but no higher than in the left one as long as the leader there
//! is slower than c and faster than v_crit: it must not be passed on the right. Only the follower in the left lane counts.

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

/// Speed v_crit up to which vehicles in a lane to the left may be passed, m/s: 60 km/h, below which traffic is congested.
const CONGESTED_MPS: f64 = 60.0 / 3.6;

/// What the asymmetric rule looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeepRight {
    /// Preference Δa_bias of the right lane, m/s² (Kesting 2007: 0.3).
    pub bias_mps2: f64,
    /// Whether the change is to the left; else it is to the right.
    pub to_left: bool,
    /// Speed of the vehicle that may change, m/s.
    pub speed_mps: f64,
    /// Speed of its leader in the left one of the two lanes, m/s; infinite if there is none.
    pub left_leader_mps: f64,
}

/// The weighted gain in m/s² under symmetric rules if the change is allowed and pays, else `None`.
pub fn mobil_gain(situation: &MobilSituation, params: &MobilParams) -> Option<f64> {
    let others_mps2 = situation.new_follower.gain_mps2() + situation.old_follower.gain_mps2();
    let gain_mps2 = situation.changer.gain_mps2() + params.politeness * others_mps2;
    worthwhile(gain_mps2, situation, params)
}

/// The weighted gain in m/s², bias included, under the asymmetric rule if the change is allowed and pays, else `None`.
pub fn mobil_gain_keep_right(situation: &MobilSituation, params: &MobilParams, rule: &KeepRight) -> Option<f64> {
    let AccelChange { mut keep_mps2, mut change_mps2 } = situation.changer;
    let must_not_pass = rule.speed_mps > rule.left_leader_mps && rule.left_leader_mps > CONGESTED_MPS;
    let (left_mps2, right_mps2) =
        if rule.to_left { (change_mps2, &mut keep_mps2) } else { (keep_mps2, &mut change_mps2) };
    if must_not_pass {
        *right_mps2 = right_mps2.min(left_mps2);
    }
    let (follower, bias_mps2) =
        if rule.to_left { (situation.new_follower, -rule.bias_mps2) } else { (situation.old_follower, rule.bias_mps2) };
    let gain_mps2 = change_mps2 - keep_mps2 + params.politeness * follower.gain_mps2() + bias_mps2;
    worthwhile(gain_mps2, situation, params)
}

/// The gain, if it exceeds the threshold and the change forces nobody to brake too hard.
fn worthwhile(gain_mps2: f64, situation: &MobilSituation, params: &MobilParams) -> Option<f64> {
    let hardest_mps2 = situation.new_follower.change_mps2.min(situation.changer.change_mps2);
    let allowed = hardest_mps2 >= -params.safe_decel_mps2;
    (allowed && gain_mps2 > params.accel_gain_threshold_mps2).then_some(gain_mps2)
}

#[cfg(test)]
mod tests {
    use super::{AccelChange, KeepRight, MobilParams, MobilSituation, mobil_gain, mobil_gain_keep_right};

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
    fn decision_table_of_the_asymmetric_rule() {
        let none = AccelChange::default();
        // To the left, changer, new follower, old follower, the left leader's speed, expected gain at 25 m/s with a bias of 0.3.
        let rows = [
            // A free road: to the right by the bias alone, never to the left.
            (false, none, none, none, f64::INFINITY, Some(0.3)),
            (true, none, none, none, f64::INFINITY, None),
            // To the left the gain must exceed threshold and bias, and only the follower there counts.
            (true, change(-1.0, 0.0), none, none, f64::INFINITY, Some(0.7)),
            (true, change(-0.5, 0.0), none, none, f64::INFINITY, None),
            (true, change(-1.0, 0.0), change(0.0, -0.5), change(-1.0, 0.0), f64::INFINITY, Some(0.45)),
            // To the right the old follower, in the left lane, counts and the new one does not.
            (false, none, change(0.0, -2.0), change(-1.0, 0.0), f64::INFINITY, Some(0.8)),
            (false, change(0.0, -0.5), none, none, f64::INFINITY, None),
            // Nobody goes to the right to pass: what would be gained there does not count, the bias does.
            (false, change(-2.0, 0.5), none, none, 20.0, Some(0.3)),
            (false, change(-2.0, 0.5), none, none, 16.0, Some(2.8)),
            (false, change(-2.0, 0.5), none, none, 26.0, Some(2.8)),
            // A slower leader on the left holds back on the right as well, so that nothing is lost by the change.
            (true, change(0.5, -0.5), none, none, 20.0, None),
            // Forced braking forbids any gain.
            (false, none, change(0.0, -3.1), none, f64::INFINITY, None),
        ];
        for (to_left, changer, new_follower, old_follower, left_leader_mps, expected) in rows {
            let situation = MobilSituation { changer, new_follower, old_follower };
            let rule = KeepRight { bias_mps2: 0.3, to_left, speed_mps: 25.0, left_leader_mps };
            let gain = mobil_gain_keep_right(&situation, &PARAMS, &rule);
            let equal = gain.zip(expected).map_or(gain == expected, |(a, b)| (a - b).abs() < 1e-12);
            assert!(equal, "{gain:?}, not {expected:?}: {rule:?} {situation:?}");
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
