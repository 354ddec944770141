//! Data, training, baselines, evaluation, statistics and reports.

pub mod baselines;
pub mod config;
pub mod data;
pub mod evaluate;
pub mod metrics;
pub mod policy;
pub mod progress;
pub mod report;
pub mod run_dir;
pub mod runs;
pub mod stats;
pub mod trace_file;
pub mod train;
