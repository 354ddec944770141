//! Data, training, baselines, evaluation, statistics and reports.

pub mod baselines;
pub mod bench;
pub mod calibrate;
pub mod config;
pub mod data;
pub mod demonstrations;
pub mod evaluate;
pub mod human_reward;
pub mod irl;
pub mod judge;
pub mod maneuvers;
pub mod metrics;
pub mod pages;
pub mod policy;
pub mod profile;
pub mod progress;
pub mod quickstart;
pub mod replay;
pub mod report;
pub mod run_dir;
pub mod runs;
pub mod scenarios;
pub mod stats;
pub mod studies;
pub mod trace_file;
pub mod train;
