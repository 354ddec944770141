//! Whether what the paper says came out.

use super::definition::Metric;
use super::rows::UnitRow;
use crate::metrics::Interval;
use crate::stats::{StatsError, paired_difference, paired_ratio};

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

/// A figure of `rows` and of `other`, seed by seed; a variant with a single row (a rule) stands for all seeds of the other. None if neither
/// has two seeds, or they differ in number.
fn pairs(metric: Metric, rows: &[&UnitRow], other: &[&UnitRow]) -> Option<[Vec<f64>; 2]> {
    let count = rows.len().max(other.len());
    let spread = |of: &[&UnitRow]| match of {
        [row] => Some(vec![metric.of(row); count]),
        _ if of.len() == count => Some(of.iter().map(|row| metric.of(row)).collect()),
        _ => None,
    };
    if count < 2 { None } else { Some([spread(rows)?, spread(other)?]) }
}

/// The lead of `rows` over `other` in a figure; none where there are no pairs.
pub(super) fn lead(metric: Metric, rows: &[&UnitRow], other: &[&UnitRow]) -> Result<Option<Interval>, StatsError> {
    pairs(metric, rows, other).map(|[own, other]| paired_difference(&own, &other)).transpose()
}

/// The same relative to the mean of `other`, %; none also if that is zero.
pub(super) fn change_percent(
    metric: Metric,
    rows: &[&UnitRow],
    other: &[&UnitRow],
) -> Result<Option<Interval>, StatsError> {
    let Some([own, other]) = pairs(metric, rows, other).filter(|[_, other]| other.iter().sum::<f64>() > 0.0) else {
        return Ok(None);
    };
    let Interval { mean, low, high } = paired_ratio(&own, &other)?;
    let [mean, low, high] = [mean, low, high].map(|ratio| 100.0 * (ratio - 1.0));
    Ok(Some(Interval { mean, low, high }))
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
