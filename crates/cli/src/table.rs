//! Results as a table for people.

use lanecraft_lab::evaluate::{PolicyEpisodes, compare};
use lanecraft_lab::text_table::text_table;

use crate::output::answer;

/// Prints the table and how the first policy compares with the others.
pub(crate) fn print_results(episodes: &[PolicyEpisodes]) -> anyhow::Result<()> {
    let results = episodes.iter().map(PolicyEpisodes::result).collect::<Result<Vec<_>, _>>()?;
    answer(&text_table(&results))?;
    compare(episodes)?.iter().try_for_each(|comparison| Ok(answer(&comparison.to_string())?))
}
