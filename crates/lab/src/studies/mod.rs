//! Studies of the motion control and of the traffic: figures and tables that one command makes from nothing but the program.
//!
//! Every study gives the same bytes each time.

mod cells;
mod fundamental_diagram;
mod margins;
mod output;
mod pareto;
mod phase_plane;
mod platoon;
mod preventable;

pub use output::{Figure, StudyError, StudyReport, Table};

use rayon::prelude::*;

/// A study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Study {
    /// The plane of sideslip and yaw rate (Fig. 11).
    PhasePlane,
    /// What the weights q_1 and q_2 trade.
    Pareto,
    /// Which collisions a careful driver, and this one, prevents.
    Preventable,
    /// Gain and delay margins of both loops.
    Margins,
    /// A platoon of own cars.
    StringStability,
    /// Flow, speed and lane changes of the human drivers over density.
    FundamentalDiagram,
}

impl Study {
    /// All studies.
    pub const ALL: [Self; 6] = [
        Self::PhasePlane,
        Self::Pareto,
        Self::Preventable,
        Self::Margins,
        Self::StringStability,
        Self::FundamentalDiagram,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::PhasePlane => "phase-plane",
            Self::Pareto => "pareto",
            Self::Preventable => "preventable",
            Self::Margins => "margins",
            Self::StringStability => "string-stability",
            Self::FundamentalDiagram => "fundamental-diagram",
        }
    }

    /// Runs it.
    pub fn run(self) -> Result<StudyReport, StudyError> {
        match self {
            Self::PhasePlane => phase_plane::run(),
            Self::Pareto => pareto::run(),
            Self::Preventable => preventable::run(),
            Self::Margins => margins::run(),
            Self::StringStability => platoon::run(),
            Self::FundamentalDiagram => fundamental_diagram::run(),
        }
    }
}

/// `job` for each of `items` on all threads, in their order.
fn in_parallel<T: Sync, U: Send>(
    items: &[T],
    job: impl Fn(&T) -> Result<U, StudyError> + Sync + Send,
) -> Result<Vec<U>, StudyError> {
    items.par_iter().map(job).collect()
}
