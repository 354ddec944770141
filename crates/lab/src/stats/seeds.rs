//! Scores of a method over training seeds and tasks, and what can be said of the method from them.
//!
//! **The unit.** Episodes of one trained policy share its training, so they say little of the next training. In [`SeedScores::mean`],
//! [`SeedScores::interquartile_mean`], [`SeedScores::difference`], [`SeedScores::profile`] and [`SeedScores::probability_of_improvement`]
//! the seed is therefore the unit: its scores are first averaged over its tasks. The intervals speak of further trainings that are judged
//! on these tasks.
//!
//! [`SeedScores::stratified`] and [`SeedScores::improvement_over_tasks`] are those of Agarwal et al. (2021), for the case they treat:
//! every score is a training of its own on its task. If one policy is judged on all tasks, its scores move together, and intervals from
//! resampling each task alone are too narrow; `docs/statistics.md` has by how much.

use serde::{Deserialize, Serialize};

use super::bootstrap::expanded_percentile;
use super::means::{interquartile_mean, interquartile_mean_interval, mean, t_interval, welch_difference};
use super::rank::{superiority, superiority_interval};
use super::{StatsError, require};
use crate::metrics::Interval;

/// Scores of one method: a row for each training seed, in it one score for each task (a scenario, or a group of scenarios).
#[derive(Clone, Debug, PartialEq)]
pub struct SeedScores {
    method: String,
    seeds: Vec<u64>,
    rows: Vec<Vec<f64>>,
}

/// How two methods' seeds were compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pairing {
    /// Both have the same seeds: Student's t over the differences of each seed.
    BySeed,
    /// Their seeds differ: Welch's t over both groups of seeds.
    Independent,
}

/// What one number is made of all scores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aggregate {
    /// Mean over tasks of each task's mean.
    Mean,
    /// Median over tasks of each task's mean.
    Median,
    /// Interquartile mean of all scores, whatever their task.
    InterquartileMean,
}

impl SeedScores {
    /// The scores of `method`: for each seed, its scores on the same tasks in the same order.
    ///
    /// # Errors
    /// If there is no seed or no task, two seeds are equal, rows differ in length, or a score is not finite.
    pub fn new(method: impl Into<String>, of_seeds: Vec<(u64, Vec<f64>)>) -> Result<Self, StatsError> {
        let (seeds, rows): (Vec<u64>, Vec<Vec<f64>>) = of_seeds.into_iter().unzip();
        let tasks = rows.first().map_or(0, Vec::len);
        require(&[seeds.len(), tasks], 1)?;
        for (index, row) in rows.iter().enumerate() {
            if row.len() != tasks {
                return Err(StatsError::Unpaired { first: tasks, second: row.len() });
            }
            if let Some((_, value)) = row.iter().enumerate().find(|(_, x)| !x.is_finite()) {
                return Err(StatsError::NotFinite { index, value: *value });
            }
            if seeds[..index].contains(&seeds[index]) {
                return Err(StatsError::SameSeed { seed: seeds[index] });
            }
        }
        Ok(Self { method: method.into(), seeds, rows })
    }

    /// The method's name.
    pub fn method(&self) -> &str {
        &self.method
    }

    /// The training seeds.
    pub fn seeds(&self) -> &[u64] {
        &self.seeds
    }

    /// Number of tasks.
    pub fn tasks(&self) -> usize {
        self.rows[0].len()
    }

    /// The scores of the seed at this place, one for each task.
    pub fn row(&self, place: usize) -> &[f64] {
        &self.rows[place]
    }

    /// The mean score of each seed over its tasks.
    pub fn seed_means(&self) -> Vec<f64> {
        self.rows.iter().map(|row| mean(row)).collect()
    }

    /// The mean over seeds with Student's t interval. For 2 seeds or more; 10 make it useful.
    ///
    /// # Errors
    /// If there is only one seed.
    pub fn mean(&self) -> Result<Interval, StatsError> {
        t_interval(&self.seed_means())
    }

    /// The interquartile mean over seeds (Agarwal et al., 2021) with the interval of Tukey and McLaughlin (1963), which covers at small
    /// numbers of seeds where the percentile bootstrap does not ([`interquartile_mean_interval`]). For 5 seeds or more.
    ///
    /// # Errors
    /// If there is only one seed.
    pub fn interquartile_mean(&self) -> Result<Interval, StatsError> {
        interquartile_mean_interval(&self.seed_means())
    }

    /// This method's mean over seeds minus `other`'s on the same tasks, with its t interval, and how it was made. With the same seeds the
    /// differences of each seed count, which is sharper where a seed does both methods good.
    ///
    /// # Errors
    /// If the numbers of tasks differ, or a method has only one seed.
    pub fn difference(&self, other: &Self) -> Result<(Interval, Pairing), StatsError> {
        self.same_tasks(other)?;
        let means = self.seed_means();
        let of_other = |seed: &u64| other.seeds.iter().position(|s| s == seed).map(|row| mean(&other.rows[row]));
        let paired: Option<Vec<f64>> = self.seeds.iter().map(of_other).collect();
        match paired.filter(|_| self.seeds.len() == other.seeds.len()) {
            Some(others) => {
                let differences: Vec<f64> = means.iter().zip(&others).map(|(a, b)| a - b).collect();
                Ok((t_interval(&differences)?, Pairing::BySeed))
            }
            None => Ok((welch_difference(&means, &other.seed_means())?, Pairing::Independent)),
        }
    }

    /// This method's mean over seeds minus the mean of `scores` on the same tasks, of a policy that was not trained, such as a rule;
    /// Student's t over seeds.
    ///
    /// # Errors
    /// If the numbers of tasks differ, or there is only one seed.
    pub fn difference_from_fixed(&self, scores: &[f64]) -> Result<Interval, StatsError> {
        if scores.len() != self.tasks() {
            return Err(StatsError::Unpaired { first: self.tasks(), second: scores.len() });
        }
        let fixed = mean(scores);
        t_interval(&self.seed_means().iter().map(|mean| mean - fixed).collect::<Vec<_>>())
    }

    /// The probability that a new seed of this method scores higher over all tasks than one of `other`, ties counted half (Mann and
    /// Whitney, 1947), with Newcombe's interval (2006). For 2 seeds each or more; useful from 5.
    ///
    /// # Errors
    /// If the numbers of tasks differ, or a method has only one seed.
    pub fn probability_of_improvement(&self, other: &Self) -> Result<Interval, StatsError> {
        self.same_tasks(other)?;
        let sizes = [self.seeds.len(), other.seeds.len()];
        require(&sizes, 2)?;
        Ok(superiority_interval(superiority(&self.seed_means(), &other.seed_means()), sizes))
    }

    /// The probability of improvement as Agarwal et al. (2021) define it: that of each task, averaged over tasks. Newcombe's interval
    /// (2006) is that of one task, and so at least as wide as it need be, also if the scores of a seed move together.
    ///
    /// # Errors
    /// If the numbers of tasks differ, or a method has only one seed.
    pub fn improvement_over_tasks(&self, other: &Self) -> Result<Interval, StatsError> {
        self.same_tasks(other)?;
        let sizes = [self.seeds.len(), other.seeds.len()];
        require(&sizes, 2)?;
        let of_task = |task: usize| superiority(&self.task(task), &other.task(task));
        let estimate = mean(&(0..self.tasks()).map(of_task).collect::<Vec<_>>());
        Ok(superiority_interval(estimate, sizes))
    }

    /// The share of each seed's scores that exceed `threshold`.
    pub fn shares_above(&self, threshold: f64) -> Vec<f64> {
        let share = |row: &Vec<f64>| row.iter().filter(|x| **x > threshold).count() as f64 / row.len() as f64;
        self.rows.iter().map(share).collect()
    }

    /// The performance profile (Agarwal et al., 2021): for each threshold the share of all scores above it, with a pointwise interval.
    /// That is Student's t over the shares of the seeds, taken on the logit (delta method), which covers better than resampled seeds and
    /// stays within 0 and 1; where all scores or none lie above, it has no width. For 5 seeds or more.
    ///
    /// # Errors
    /// If there is only one seed.
    pub fn profile(&self, thresholds: &[f64]) -> Result<Vec<Interval>, StatsError> {
        thresholds.iter().map(|threshold| Ok(on_the_logit(t_interval(&self.shares_above(*threshold))?))).collect()
    }

    /// An aggregate of all scores with the stratified bootstrap's interval (Agarwal et al., 2021), each task's scores resampled by
    /// themselves; every score must be a training of its own. The ends are expanded for small numbers (Hesterberg, 2015), which the
    /// percentiles of the source are not. For 5 seeds a task or more.
    ///
    /// # Errors
    /// If there is only one seed.
    pub fn stratified(&self, aggregate: Aggregate) -> Result<Interval, StatsError> {
        let (count, tasks) = (self.seeds.len(), self.tasks());
        require(&[count], 2)?;
        let by_task: Vec<Vec<f64>> = (0..tasks).map(|task| self.task(task)).collect();
        let resampled = |draw: &mut dyn FnMut() -> usize| {
            let scores = by_task.iter().map(|of_task| (0..count).map(|_| of_task[draw()]).collect());
            aggregate.of(&scores.collect::<Vec<_>>())
        };
        // The median's spread is that of one or two tasks, so its variance is known as badly as theirs.
        let known_from = if aggregate == Aggregate::Median { 1 } else { tasks };
        Ok(expanded_percentile(aggregate.of(&by_task), [known_from, count], resampled))
    }

    /// All seeds' scores on one task.
    fn task(&self, task: usize) -> Vec<f64> {
        self.rows.iter().map(|row| row[task]).collect()
    }

    fn same_tasks(&self, other: &Self) -> Result<(), StatsError> {
        if self.tasks() == other.tasks() {
            return Ok(());
        }
        Err(StatsError::Unpaired { first: self.tasks(), second: other.tasks() })
    }
}

impl Aggregate {
    /// The aggregate of scores by task.
    fn of(self, by_task: &[Vec<f64>]) -> f64 {
        let mut means: Vec<f64> = by_task.iter().map(|of_task| mean(of_task)).collect();
        match self {
            Self::Mean => mean(&means),
            Self::Median => {
                means.sort_by(f64::total_cmp);
                let middle = means.len() / 2;
                f64::midpoint(means[middle], means[(means.len() - 1) / 2])
            }
            Self::InterquartileMean => interquartile_mean(&by_task.concat()),
        }
    }
}

/// An interval around a share, its half-width carried over to the logit and its ends back.
fn on_the_logit(share: Interval) -> Interval {
    let p = share.mean;
    if p <= 0.0 || p >= 1.0 {
        return Interval { mean: p, low: p, high: p };
    }
    let (logit, half) = (libm::log(p / (1.0 - p)), (share.high - p) / (p * (1.0 - p)));
    let back = |x: f64| 1.0 / (1.0 + libm::exp(-x));
    Interval { mean: p, low: back(logit - half), high: back(logit + half) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::close;

    fn scores(of_seeds: &[(u64, &[f64])]) -> SeedScores {
        SeedScores::new("m", of_seeds.iter().map(|(seed, row)| (*seed, row.to_vec())).collect()).unwrap()
    }

    #[test]
    fn a_seed_counts_once_however_many_tasks_it_has() {
        let few = scores(&[(0, &[1.0]), (1, &[2.0]), (2, &[4.0])]);
        let many = scores(&[(0, &[0.0, 2.0, 1.0]), (1, &[2.0; 3]), (2, &[3.0, 5.0, 4.0])]);
        assert_eq!(few.mean(), many.mean());
        assert_eq!(few.interquartile_mean(), many.interquartile_mean());
    }

    #[test]
    fn equal_seeds_are_paired_in_any_order_and_others_are_not() {
        let one = scores(&[(0, &[1.0]), (1, &[5.0]), (2, &[9.0])]);
        let two = scores(&[(2, &[8.0]), (0, &[0.5]), (1, &[3.0])]);
        let (paired, how) = one.difference(&two).unwrap();
        assert_eq!((how, paired), (Pairing::BySeed, t_interval(&[0.5, 2.0, 1.0]).unwrap()));
        let other = scores(&[(7, &[8.0]), (0, &[0.5]), (1, &[3.0])]);
        let (wide, how) = one.difference(&other).unwrap();
        assert_eq!(how, Pairing::Independent);
        close(wide.mean, paired.mean, 1e-12);
        assert!(wide.high - wide.low > paired.high - paired.low);
    }

    #[test]
    fn aggregates_are_those_of_their_names() {
        let table = scores(&[(0, &[0.0, 10.0, 20.0]), (1, &[2.0, 10.0, 60.0])]);
        let of = |aggregate| table.stratified(aggregate).unwrap().mean;
        close(of(Aggregate::Mean), 17.0, 1e-12);
        close(of(Aggregate::Median), 10.0, 1e-12);
        // Of 0, 2, 10, 10, 20, 60 one is left out at each end.
        close(of(Aggregate::InterquartileMean), 10.5, 1e-12);
    }

    #[test]
    fn scores_of_one_task_resample_within_it() {
        // Each task is constant, so resampling within tasks leaves no spread, however far apart the tasks are.
        let table = scores(&[(0, &[1.0, 100.0]), (1, &[1.0, 100.0])]);
        let interval = table.stratified(Aggregate::Mean).unwrap();
        assert_eq!((interval.low, interval.high), (50.5, 50.5));
    }

    #[test]
    fn a_profile_falls_from_one_to_zero_within_its_band() {
        let rows: Vec<(u64, Vec<f64>)> = (0..6_u8).map(|i| (i.into(), vec![f64::from(i), f64::from(i % 4)])).collect();
        let table = SeedScores::new("m", rows).unwrap();
        let profile = table.profile(&[-1.0, 1.5, 2.5, 9.0]).unwrap();
        assert_eq!((profile[0].mean, profile[3].mean), (1.0, 0.0));
        assert!(profile.is_sorted_by(|a, b| a.mean >= b.mean));
        assert!(profile.iter().all(|i| i.low <= i.mean && i.mean <= i.high));
        close(profile[1].mean, 6.0 / 12.0, 1e-12);
    }

    #[test]
    fn improvement_is_averaged_over_tasks() {
        let one = scores(&[(0, &[3.0, 0.0]), (1, &[4.0, 0.0])]);
        let two = scores(&[(0, &[1.0, 5.0]), (1, &[2.0, 6.0])]);
        assert_eq!(one.improvement_over_tasks(&two).unwrap().mean, 0.5);
        assert_eq!(one.probability_of_improvement(&two).unwrap().mean, 0.0);
        close(one.difference_from_fixed(&[1.0, 1.0]).unwrap().mean, 0.75, 1e-12);
    }

    #[test]
    fn wrong_input_is_refused() {
        let new = |rows: &[(u64, &[f64])]| {
            SeedScores::new("m", rows.iter().map(|(seed, row)| (*seed, row.to_vec())).collect())
        };
        assert_eq!(new(&[]), Err(StatsError::TooFew { count: 0, min: 1 }));
        assert_eq!(new(&[(0, &[])]), Err(StatsError::TooFew { count: 0, min: 1 }));
        assert_eq!(new(&[(4, &[1.0]), (4, &[2.0])]), Err(StatsError::SameSeed { seed: 4 }));
        assert_eq!(new(&[(0, &[1.0, 2.0]), (1, &[1.0])]), Err(StatsError::Unpaired { first: 2, second: 1 }));
        assert!(matches!(new(&[(0, &[f64::INFINITY])]), Err(StatsError::NotFinite { .. })));
        let one = new(&[(0, &[1.0])]).unwrap();
        assert_eq!(one.mean(), Err(StatsError::TooFew { count: 1, min: 2 }));
        assert!(one.profile(&[0.0]).is_err() && one.stratified(Aggregate::Mean).is_err());
        assert!(one.difference(&one).is_err() && one.probability_of_improvement(&one).is_err());
        assert!(one.difference_from_fixed(&[]).is_err());
    }
}
