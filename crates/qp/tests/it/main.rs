//! The solver from outside: second source, optimality, closed forms, warm starts, recovery.

mod common;
mod second_source;
