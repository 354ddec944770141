//! Whether what the paper says came out.

use super::definition::Metric;
use super::rows::UnitRow;
use crate::metrics::Interval;
use crate::stats::{StatsError, mean_interval};

/// The outcome of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The whole interval lies on the side of zero that the paper says.
    Reproduced,
    /// It lies on the other side, or it holds zero but not the paper's figure.
    NotReproduced,
    /// It holds both zero and the paper's figure, or there is none: these runs cannot tell.
    NotTestable,
}

impl Verdict {
    /// Of a relative change in %, where the paper has `claimed`.
    pub fn new(change: Option<Interval>, claimed: f64) -> Self {
        let Some(Interval { low, high, .. }) = change else { return Self::NotTestable };
        let holds = |value: f64| low <= value && value <= high;
        let same_side = if claimed > 0.0 { low > 0.0 } else { high < 0.0 };
        match (same_side, holds(0.0) && holds(claimed)) {
            (true, _) => Self::Reproduced,
            (false, true) => Self::NotTestable,
            (false, false) => Self::NotReproduced,
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reproduced => "reproduced",
            Self::NotReproduced => "not reproduced",
            Self::NotTestable => "not testable",
        }
    }
}

/// The lead of `rows` over `other` in a figure, seed by seed; a variant with a single row (a rule) stands for all seeds of the other. None
/// if neither has two seeds.
pub(super) fn lead(metric: Metric, rows: &[&UnitRow], other: &[&UnitRow]) -> Result<Option<Interval>, StatsError> {
    let count = rows.len().max(other.len());
    let value = |of: &[&UnitRow], index: usize| metric.of(if of.len() == 1 { of[0] } else { of[index] });
    let alike = [rows, other].iter().all(|of| of.len() == 1 || of.len() == count);
    if count < 2 || !alike || rows.is_empty() || other.is_empty() {
        return Ok(None);
    }
    let leads: Vec<f64> = (0..count).map(|index| value(rows, index) - value(other, index)).collect();
    Ok(Some(mean_interval(&leads)?))
}

/// The same relative to the mean of `other`, %; none also if that is zero.
pub(super) fn change_percent(
    metric: Metric,
    rows: &[&UnitRow],
    other: &[&UnitRow],
) -> Result<Option<Interval>, StatsError> {
    let mean = other.iter().map(|row| metric.of(row)).sum::<f64>() / other.len().max(1) as f64;
    let percent = |Interval { mean: lead, low, high }: Interval| {
        let [mean, low, high] = [lead, low, high].map(|lead| 100.0 * lead / mean);
        Interval { mean, low, high }
    };
    Ok(lead(metric, rows, other)?.filter(|_| mean > 0.0).map(percent))
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row;
    use super::*;

    #[test]
    fn a_verdict_follows_from_where_zero_and_the_claim_lie() {
        let interval = |low: f64, high: f64| Some(Interval { mean: f64::midpoint(low, high), low, high });
        for (change, claimed, verdict) in [
            (interval(-70.0, -20.0), -62.0, Verdict::Reproduced),
            (interval(-20.0, -10.0), -62.0, Verdict::Reproduced),
            (interval(10.0, 20.0), -62.0, Verdict::NotReproduced),
            (interval(-20.0, 10.0), -62.0, Verdict::NotReproduced),
            (interval(-70.0, 10.0), -62.0, Verdict::NotTestable),
            (None, -62.0, Verdict::NotTestable),
        ] {
            assert_eq!(Verdict::new(change, claimed), verdict, "{change:?}");
        }
    }

    #[test]
    fn changes_are_those_of_the_means_seed_by_seed() {
        let (ours, theirs) = ([row("a", 0, 4.0, 2), row("a", 1, 6.0, 4)], [row("b", 0, 2.0, 4), row("b", 1, 6.0, 12)]);
        let (ours, theirs): (Vec<_>, Vec<_>) = (ours.iter().collect(), theirs.iter().collect());
        let change = change_percent(Metric::Reward, &ours, &theirs).unwrap().unwrap();
        // Means 5 and 4.
        assert!((change.mean - 25.0).abs() < 1e-9 && change.low < 0.0);
        // 3 and 8 collisions of 100.
        let change = change_percent(Metric::Collisions, &ours, &theirs).unwrap().unwrap();
        assert!((change.mean + 62.5).abs() < 1e-9);
        // A rule has one row for all seeds.
        let lead = lead(Metric::Reward, &ours, &theirs[..1]).unwrap().unwrap();
        assert_eq!(lead.mean, 3.0);
        assert_eq!(change_percent(Metric::Reward, &ours[..1], &theirs[..1]).unwrap(), None);
    }

    #[test]
    fn without_a_collision_there_is_no_relative_change() {
        let (ours, theirs) = ([row("a", 0, 4.0, 1), row("a", 1, 4.0, 2)], [row("b", 0, 4.0, 0), row("b", 1, 4.0, 0)]);
        let (ours, theirs): (Vec<_>, Vec<_>) = (ours.iter().collect(), theirs.iter().collect());
        assert_eq!(change_percent(Metric::Collisions, &ours, &theirs).unwrap(), None);
    }
}
