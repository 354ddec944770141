//! What can be wrong with a scene.

use std::fmt;

use crate::config::ConfigError;

/// Whom an error is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Party {
    /// The ego.
    Ego,
    /// A vehicle, by its index in the scene.
    Vehicle(u32),
}

impl fmt::Display for Party {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ego => write!(f, "the ego"),
            Self::Vehicle(index) => write!(f, "vehicle {index}"),
        }
    }
}

/// A scene that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScenarioError {
    /// The text is no scenario file.
    #[error("not a scenario file: {0}")]
    Parse(#[source] toml::de::Error),
    /// A value outside its range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// No vehicle at all.
    #[error("the road is empty: write `vehicles` or raise `traffic.density_veh_per_km_lane`")]
    EmptyRoad,
    /// More vehicles than fit.
    #[error(
        "{vehicles} vehicles in lane {lane} take {taken_m:.0} m with their standstill gaps, but it has {length_m} m"
    )]
    TooDense {
        /// The lane.
        lane: u8,
        /// How many.
        vehicles: usize,
        /// Room they take, m.
        taken_m: f64,
        /// Length of the lane, m.
        length_m: f64,
    },
    /// A lane that is not there.
    #[error("{who} is in lane {lane}, but the road has lanes 0 to {last}")]
    NoSuchLane {
        /// Whose lane.
        who: Party,
        /// The lane given.
        lane: u8,
        /// The road's leftmost lane.
        last: u8,
    },
    /// A lane that does not exist there.
    #[error("{who} starts at {s_m} m, where lane {lane} does not exist under all of it (see `road.lanes_open`)")]
    OffLane {
        /// Who.
        who: Party,
        /// The lane given.
        lane: u8,
        /// The position given, m.
        s_m: f64,
    },
    /// A start from which the end of the lane is too near.
    #[error(
        "{who} starts {gap_m:.2} m before the end of its lane, but could stop before it only from {required_m:.2} m"
    )]
    PastStopping {
        /// Who.
        who: Party,
        /// The distance given, m.
        gap_m: f64,
        /// The distance needed, m.
        required_m: f64,
    },
    /// Two start in the same place.
    #[error("{first} and {second} overlap at the start by {overlap_m:.2} m")]
    Overlap {
        /// The rear one.
        first: Party,
        /// The front one.
        second: Party,
        /// By how much, m.
        overlap_m: f64,
    },
    /// A start from which a collision may be unavoidable.
    #[error("{follower} starts {gap_m:.2} m behind {leader}, but could stop behind it only from {required_m:.2} m")]
    Unsafe {
        /// The rear one.
        follower: Party,
        /// The front one.
        leader: Party,
        /// The gap given, m.
        gap_m: f64,
        /// The gap needed, m.
        required_m: f64,
    },
    /// No lane has a gap for the ego.
    #[error("no gap takes the ego: the largest has {largest_m:.1} m; lower `traffic.density_veh_per_km_lane`")]
    NoRoomForEgo {
        /// The largest gap of all lanes, m.
        largest_m: f64,
    },
}
