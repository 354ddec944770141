//! The learned human reward: what was learned, how well it predicts, and how it compares with knowing less.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::html::{escape, number};
use super::plots::{weight_bars, weight_cell};
use crate::metrics::Interval;

/// A reward learned by maximum-entropy inverse reinforcement learning (Eqs. 21–24).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IrlSummary {
    /// The demonstrations, in words, for example `NGSIM I-80, 28 lane changes, one site left out in turn`.
    pub source: String,
    /// One entry for each feature, in the order of the weights.
    pub features: Vec<IrlFeature>,
    /// Mean log-likelihood of a held-out demonstration among its candidates, nats.
    pub log_likelihood: f64,
    /// The same if all candidates were equally likely.
    pub uniform_log_likelihood: f64,
    /// The same for a density over durations alone, which knows nothing of the traffic.
    pub duration_density_log_likelihood: f64,
}

/// One feature of the learned reward.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IrlFeature {
    /// Its name.
    pub name: String,
    /// Learned weight.
    pub weight: f64,
    /// The weight's 95 % interval, where one was computed.
    pub interval: Option<Interval>,
    /// Error of the predicted feature's mean relative to the demonstrated mean, where errors of opposite sign cancel (a share).
    pub ratio_of_means_error: f64,
    /// Mean absolute error relative to the demonstrated value, where they do not (a share).
    pub mean_absolute_error: f64,
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
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{} %</td><td>{} %</td></tr>",
            escape(&feature.name),
            weight_cell(feature),
            number(100.0 * feature.ratio_of_means_error, 1),
            number(100.0 * feature.mean_absolute_error, 1)
        );
    }
    table += "</tbody></table></div>\n";
    let bars = if irl.features.is_empty() { String::new() } else { weight_bars(&irl.features) };
    format!("<p class=\"note\">{}</p>\n<div class=\"grid\">\n{bars}{table}</div>\n", likelihoods(irl))
}

/// The likelihoods in a sentence that says whether the reward knows more than its baselines.
fn likelihoods(irl: &IrlSummary) -> String {
    let learned = irl.log_likelihood;
    let verdict = |baseline: f64| if learned > baseline { "better than" } else { "not better than" };
    format!(
        "Demonstrations: {}. A held-out demonstration has a mean log-likelihood of {} nats among its candidates, {} the {} of \
         equally likely candidates and {} the {} of a density over durations alone.",
        escape(&irl.source),
        number(learned, 3),
        verdict(irl.uniform_log_likelihood),
        number(irl.uniform_log_likelihood, 3),
        verdict(irl.duration_density_log_likelihood),
        number(irl.duration_density_log_likelihood, 3)
    )
}
