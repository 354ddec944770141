//! Recorded traffic, read strictly: every value is checked where it enters, and an error names file, line and column.

mod collect;
mod commonroad;
mod decimal;
mod error;
pub mod events;
pub mod extract;
mod highd;
pub mod inspect;
mod ngsim;
pub mod read;
pub mod recording;
mod table;
pub mod traffic;
mod units;

pub use error::{DataError, XmlErrorKind};
pub(crate) use table::{Table, content};
pub use table::{TableError, TableErrorKind};
