//! How often the intervals of `lab::stats` hold what they estimate.
//!
//! [`QUICK`] samples each, [`RESAMPLED`] where each is resampled; with `LANECRAFT_LONG` set [`LONG`], the numbers of `docs/statistics.md`,
//! printed with `--nocapture`. A tolerance allows for the chance of few samples alone: 3.3 binomial standard errors beyond the range that
//! is asked for, which a right interval leaves once in a thousand times.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test, which prints the table of its measurements")]

use lanecraft_lab::metrics::Interval;
use lanecraft_lab::stats::{
    Aggregate, SeedScores, clopper_pearson_interval, mean_interval, rate_per_1000_km, wilson_interval,
};
use lanecraft_net::random::Stream;

type Draw = fn(&mut Stream) -> f64;

/// Where scores come from, with their mean and the mean of their middle half.
struct Law {
    name: &'static str,
    draw: Draw,
    mean: f64,
    interquartile_mean: f64,
}

const NORMAL: Law = Law { name: "normal", draw: Stream::normal, mean: 0.0, interquartile_mean: 0.0 };

fn exponential(stream: &mut Stream) -> f64 {
    -libm::log(1.0 - stream.uniform())
}

/// Both laws; the interquartile mean is of the estimator that leaves out whole values, at this number of them.
fn laws(count: usize) -> [Law; 2] {
    let mean_of_order = |k: usize| (0..=k).map(|i| 1.0 / (count - i) as f64).sum::<f64>();
    let cut = count / 4;
    let kept = cut..count - cut;
    let interquartile_mean = kept.clone().map(mean_of_order).sum::<f64>() / kept.len() as f64;
    [NORMAL, Law { name: "exponential", draw: exponential, mean: 1.0, interquartile_mean }]
}

const LONG: u64 = 3000;
const QUICK: u64 = 400;
const RESAMPLED: u64 = 100;

fn is_long() -> bool {
    std::env::var_os("LANECRAFT_LONG").is_some()
}

/// The share of samples that held the truth, of how many.
#[derive(Clone, Copy)]
struct Coverage {
    share: f64,
    trials: u64,
}

fn coverage(purpose: &str, truth: f64, interval: impl Fn(&mut Stream) -> Interval) -> Coverage {
    coverage_of(QUICK, purpose, truth, interval)
}

fn coverage_of(quick: u64, purpose: &str, truth: f64, interval: impl Fn(&mut Stream) -> Interval) -> Coverage {
    let trials = if is_long() { LONG } else { quick };
    let holds = |trial: &u64| {
        let found = interval(&mut Stream::keyed(1, purpose, *trial, 0));
        // Ends may round.
        found.low <= truth + 1e-12 && truth <= found.high + 1e-12
    };
    let share = (0..trials).filter(holds).count() as f64 / trials as f64;
    println!("| {purpose} | {:.1} % |", 100.0 * share);
    Coverage { share, trials }
}

fn assert_within(Coverage { share, trials }: Coverage, low: f64, high: f64) {
    // At its full length the claim is held as it stands.
    let slack = |p: f64| if trials < LONG { 3.3 * (p * (1.0 - p) / trials as f64).sqrt() } else { 0.0 };
    assert!((low - slack(low)..=high + slack(high)).contains(&share), "{share} is not within {low} to {high}");
}

/// Scores in which a seed has an effect of its own on all its tasks, of this share of the variance, and tasks differ by 1.
fn scores(stream: &mut Stream, draw: Draw, [seeds, tasks]: [usize; 2], shared: f64) -> SeedScores {
    let row = |stream: &mut Stream| {
        let of_seed = shared.sqrt() * draw(stream);
        (0..tasks).map(|task| task as f64 + of_seed + (1.0 - shared).sqrt() * draw(stream)).collect::<Vec<f64>>()
    };
    SeedScores::new("m", (0..seeds as u64).map(|seed| (seed, row(stream))).collect()).unwrap()
}

#[test]
fn means_over_seeds() {
    for count in [3, 5, 10, 20] {
        for law in laws(count) {
            let name = |what: &str| format!("{what}, {count} seeds, {}", law.name);
            let draw = |stream: &mut Stream| scores(stream, law.draw, [count, 1], 0.0);
            let mean = coverage(&name("mean, t"), law.mean, |s| draw(s).mean().unwrap());
            let middle = coverage(&name("interquartile mean, Tukey-McLaughlin"), law.interquartile_mean, |s| {
                draw(s).interquartile_mean().unwrap()
            });
            if law.name == NORMAL.name && count >= 10 {
                assert_within(mean, 0.93, 0.97);
                assert_within(middle, 0.93, 0.97);
            }
        }
    }
}

#[test]
fn differences_over_seeds() {
    for law in laws(10) {
        // Three tasks; half of the variance is the seed's. Equal seeds are paired, and others are not.
        let draw = |stream: &mut Stream| scores(stream, law.draw, [10, 3], 0.5);
        let by_seed = coverage(&format!("difference, 10 and 10 seeds, paired, {}", law.name), 0.0, |s| {
            draw(s).difference(&draw(s)).unwrap().0
        });
        let independent = coverage(&format!("difference, 10 and 12 seeds, Welch, {}", law.name), 0.0, |s| {
            draw(s).difference(&scores(s, law.draw, [12, 3], 0.5)).unwrap().0
        });
        // The skews of two groups cancel, so that these hold for both laws.
        assert_within(by_seed, 0.93, 0.97);
        assert_within(independent, 0.93, 0.97);
    }
}

#[test]
fn probabilities_of_improvement() {
    for (shift, truth) in [(0.0, 0.5), (1.0, 0.760_250), (2.0, 0.921_350)] {
        let covered = coverage(&format!("probability of improvement {truth:.2}, 10 and 10 seeds"), truth, |s| {
            let better = scores(s, Stream::normal, [10, 1], 0.0);
            let rows = better.seeds().iter().zip(better.seed_means()).map(|(seed, x)| (*seed, vec![x + shift]));
            let better = SeedScores::new("better", rows.collect()).unwrap();
            better.probability_of_improvement(&scores(s, Stream::normal, [10, 1], 0.0)).unwrap()
        });
        assert_within(covered, 0.93, 0.98);
    }
}

#[test]
fn profiles() {
    for (threshold, truth) in [(0.0, 0.5), (1.0, 0.158_655)] {
        // Twenty scores a seed, half of their variance its own; the share above the threshold is that of a standard normal.
        let covered = coverage(&format!("profile at {truth:.2}, 10 seeds of 20 scores"), truth, |s| {
            let drawn = scores(s, Stream::normal, [10, 20], 0.5);
            let centered = |seed: usize| (0..20).map(|task| drawn.row(seed)[task] - task as f64).collect::<Vec<_>>();
            let table = SeedScores::new("m", (0..10).map(|seed| (seed as u64, centered(seed))).collect()).unwrap();
            table.profile(&[threshold]).unwrap()[0]
        });
        assert_within(covered, 0.93, 0.97);
    }
}

#[test]
fn aggregates_over_tasks() {
    for (aggregate, name) in
        [(Aggregate::Mean, "mean"), (Aggregate::Median, "median"), (Aggregate::InterquartileMean, "interquartile mean")]
    {
        // Tasks differ by 1 and scores are symmetric, so that all aggregates aim at the middle task's mean.
        let covered = coverage_of(RESAMPLED, &format!("{name}, stratified, 3 tasks of 10 scores"), 1.0, |s| {
            scores(s, |s| 0.3 * s.normal(), [10, 3], 0.0).stratified(aggregate).unwrap()
        });
        assert_within(covered, 0.93, 0.97);
    }
    let shared = coverage_of(RESAMPLED, "mean, stratified, 3 tasks of 10 scores, seeds shared by tasks", 1.0, |s| {
        scores(s, |s| 0.3 * s.normal(), [10, 3], 0.5).stratified(Aggregate::Mean).unwrap()
    });
    assert!(shared.share < 0.9, "one policy on all tasks is not the case that these intervals are for");
}

#[test]
fn means_over_episodes() {
    let [normal, skewed] = laws(10);
    for (count, law, low) in [(10, &normal, 0.93), (100, &normal, 0.93), (100, &skewed, 0.92)] {
        let covered = coverage(&format!("mean, {count} episodes, {}", law.name), law.mean, |s| {
            mean_interval(&(0..count).map(|_| (law.draw)(s)).collect::<Vec<_>>()).unwrap()
        });
        assert_within(covered, low, 0.97);
    }
}

#[test]
fn rates() {
    type Rate = fn(usize, usize) -> Result<Interval, lanecraft_lab::stats::StatsError>;
    let intervals: [(&str, Rate, f64); 2] =
        [("Wilson", wilson_interval, 0.93), ("Clopper-Pearson", clopper_pearson_interval, 0.95)];
    for (name, interval, low) in intervals {
        for rate in [0.01, 0.05, 0.3] {
            let covered = coverage(&format!("rate {rate}, 200 episodes, {name}"), rate, |s| {
                interval((0..200).filter(|_| s.bernoulli(rate)).count(), 200).unwrap()
            });
            assert_within(covered, low, 1.0);
        }
    }
    // Arrivals at exponential distances, of 1 000 km in the mean, over 5 000 km.
    let covered = coverage("5 events per 1 000 km over 1 000 km, Poisson", 5.0, |s| {
        let mut reached_km = 0.0;
        let next = |_: &usize| {
            reached_km += 200.0 * exponential(s);
            reached_km < 1000.0
        };
        rate_per_1000_km((0..1000).take_while(next).count(), 1e6).unwrap()
    });
    assert_within(covered, 0.95, 1.0);
}
