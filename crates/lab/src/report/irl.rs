//! The learned human reward: what was learned, how well it predicts, and how it compares with knowing less.

use std::fmt::Write as _;

use super::html::{escape, number};
use super::plots::{weight_bars, weight_cell};
use crate::metrics::Interval;
use crate::studies::Figure;

/// A reward learned by maximum-entropy inverse reinforcement learning (Eqs. 21–24).
#[derive(Clone, Debug, PartialEq)]
pub struct IrlSummary {
    /// The demonstrations, in words, for example `NGSIM I-80, 28 lane changes, one site left out in turn`.
    pub source: String,
    /// One entry for each feature, in the order of the weights.
    pub features: Vec<IrlFeature>,
    /// Mean log-likelihood of the duration of a held-out demonstration, nats.
    pub log_likelihood: f64,
    /// The same if all durations were equally likely.
    pub uniform_log_likelihood: f64,
    /// The same for a density over durations alone, which knows nothing of the traffic.
    pub duration_density_log_likelihood: f64,
    /// Mean error of the preferred duration, and of a constant one, s.
    pub duration_errors_s: [f64; 2],
    /// Calibration, and drivers among their candidates.
    pub figures: Vec<Figure>,
}

/// One feature of the learned reward.
#[derive(Clone, Debug, PartialEq)]
pub struct IrlFeature {
    /// Its name.
    pub name: String,
    /// Learned weight.
    pub weight: f64,
    /// The weight's 95 % interval, where one was computed.
    pub interval: Option<Interval>,
    /// Error of the predicted feature's mean relative to the demonstrated mean, where errors of opposite sign cancel (a share).
    pub ratio_of_means_error: Interval,
    /// Mean absolute error relative to the demonstrated value, where they do not (a share).
    pub mean_absolute_error: Interval,
}

/// The section's content.
pub(super) fn learned_reward(irl: &IrlSummary) -> String {
    let mut table = String::from(
        "<div class=\"card scroll\"><table><thead><tr><th scope=\"col\">Feature</th><th scope=\"col\">Weight</th>\
         <th scope=\"col\">Error of the means<small>signs cancel</small></th>\
         <th scope=\"col\">Mean absolute error<small>signs do not</small></th></tr></thead><tbody>\n",
    );
    for feature in &irl.features {
        let _ = writeln!(
            table,
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(&feature.name),
            weight_cell(feature),
            percent(feature.ratio_of_means_error),
            percent(feature.mean_absolute_error)
        );
    }
    table += "</tbody></table></div>\n";
    let bars = if irl.features.is_empty() { String::new() } else { weight_bars(&irl.features) };
    let figures: String = irl.figures.iter().map(Figure::html).collect();
    format!("<p class=\"note\">{}</p>\n<div class=\"grid\">\n{bars}{table}{figures}</div>\n", likelihoods(irl))
}

/// A share with its interval below, in percent.
fn percent(share: Interval) -> String {
    let [mean, low, high] = [share.mean, share.low, share.high].map(|x| number(100.0 * x, 1));
    format!("{mean} %<small>{low} to {high}</small>")
}

/// The likelihoods in a sentence that says whether the reward knows more than its baselines.
fn likelihoods(irl: &IrlSummary) -> String {
    let learned = irl.log_likelihood;
    let verdict = |baseline: f64| if learned > baseline { "better than" } else { "not better than" };
    let [ours_s, constant_s] = irl.duration_errors_s;
    format!(
        "Demonstrations: {}. The duration of a held-out demonstration has a mean log-likelihood of {} nats, {} the {} of \
         equally likely durations and {} the {} of a density over durations alone. The preferred duration is wrong by {} s in the mean, a \
         constant one by {} s. How far the weights can be told apart, and what they are worth, is said by <code>lanecraft irl judge</code>.",
        escape(&irl.source),
        number(learned, 3),
        verdict(irl.uniform_log_likelihood),
        number(irl.uniform_log_likelihood, 3),
        verdict(irl.duration_density_log_likelihood),
        number(irl.duration_density_log_likelihood, 3),
        number(ours_s, 2),
        number(constant_s, 2)
    )
}
