//! Data, training, baselines, evaluation, statistics and reports.

pub mod config;
pub mod metrics;
pub mod report;
pub mod stats;
pub mod trace_file;
pub mod run_dir;
//! TODO
pub mod data;
