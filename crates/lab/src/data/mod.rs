//! Recorded traffic, read strictly: every value is checked where it enters, and an error names file, line and column.

pub mod events;
mod table;
pub mod traffic;

pub(crate) use table::Table;
pub use table::{TableError, TableErrorKind};
