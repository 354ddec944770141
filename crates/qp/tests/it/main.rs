//! The solver from outside: second source, optimality, closed forms, warm starts, recovery, extremes.

mod closed_forms;
mod common;
mod extremes;
mod optimality;
mod oracle;
mod recovery;
mod second_source;
mod terminal;
mod time_limit;
mod warm_start;
