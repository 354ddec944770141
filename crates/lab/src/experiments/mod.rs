//! Experiments: which configurations are trained and judged against each other, how often, and what the paper says of the outcome.
//!
//! An experiment is a TOML file without code ([`Definition`]). Its units, one for each variant and training seed, are run one by one
//! ([`run`]); each leaves a row ([`UnitRow`]), and a row that is there is not computed again. Tables, figures and verdicts come from the rows
//! alone ([`analyze`]), so they can be made again wherever the rows are.

mod analysis;
mod definition;
mod rows;
mod run;
mod verdict;

pub use analysis::{Curves, Outcome, analyze, outcomes, overview};
pub use definition::{
    Budget, BudgetName, Claim, Definition, DefinitionError, Metric, Variant, built_in, built_in_names,
};
pub use rows::{ROWS, UnitRow, read_rows};
pub use run::{ExperimentError, curves_of, rows_of, run};
pub use verdict::Verdict;
