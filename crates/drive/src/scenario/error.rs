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
    /// A flow, by its index in the scene.
    Flow(u32),
}

impl fmt::Display for Party {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ego => write!(f, "the ego"),
            Self::Vehicle(index) => write!(f, "vehicle {index}"),
            Self::Flow(index) => write!(f, "flow {index}"),
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
    /// A bad number of a vehicle.
    #[error("vehicle {index}: {source}")]
    Vehicle {
        /// Index of the vehicle.
        index: usize,
        /// The number.
        source: ConfigError,
    },
    /// A bad number of a flow.
    #[error("flow {index}: {source}")]
    Flow {
        /// Index of the flow.
        index: usize,
        /// The number.
        source: ConfigError,
    },
    /// A bad number of an event.
    #[error("event {index}: {source}")]
    Event {
        /// Index of the event.
        index: usize,
        /// The number.
        source: ConfigError,
    },
    /// An event of a vehicle that is not there.
    #[error("event {event}: there is no vehicle `{name}` (vehicles with a name: {})", list(known))]
    UnknownVehicle {
        /// Index of the event.
        event: usize,
        /// The name given.
        name: String,
        /// The names that exist.
        known: Vec<String>,
    },
    /// Two vehicles of one name.
    #[error("vehicle {index} is called `{name}` like one before it; names must differ")]
    SameName {
        /// Index of the second.
        index: usize,
        /// The name.
        name: String,
    },
    /// A range of something that is no number.
    #[error("`ranges.{key}`: there is no number `{key}` to draw")]
    UnknownRange {
        /// The key given, for example `traffic.truck_share`.
        key: String,
        /// The keys that exist.
        known: Vec<String>,
    },
    /// A range whose ends are reversed or no numbers.
    #[error("`ranges.{key}` is [{low}, {high}], but must go from a number to one that is not smaller")]
    BadRange {
        /// The key.
        key: String,
        /// Its lower end.
        low: f64,
        /// Its upper end.
        high: f64,
    },
    /// Vehicles that enter a road without a beginning.
    #[error("`flows` need a road with a beginning: set `road.topology = \"open\"`")]
    FlowOnRing,
    /// Something else beside recorded vehicles.
    #[error("`{key}` cannot stand beside `recording`: recorded vehicles would drive through them")]
    BesideRecording {
        /// What stands there.
        key: &'static str,
    },
    /// A scene that was to be built without its recording.
    #[error("the scene needs the recording `{file}`: drive it with `lanecraft scenario run`")]
    NoRecording {
        /// Its file.
        file: String,
    },
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

fn list(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

impl Party {
    /// The key of one of its numbers.
    fn key(self, number: &str) -> String {
        match self {
            Self::Ego => format!("ego.{number}"),
            Self::Vehicle(index) => format!("vehicles.{index}.{number}"),
            Self::Flow(index) => format!("flows.{index}.{number}"),
        }
    }
}

impl ScenarioError {
    /// The dotted key in the file that is to blame, with indices from 0: `vehicles.1.s_m`. Empty if there is none.
    pub fn key(&self) -> String {
        let within = |list: &str, index: usize, source: &ConfigError| {
            let last = source.key().split_once('.').map_or("", |(_, rest)| rest);
            format!("{list}.{index}.{last}")
        };
        match self {
            Self::Parse(_) => String::new(),
            Self::Config(source) => source.key().to_owned(),
            Self::Vehicle { index, source } => within("vehicles", *index, source),
            Self::Flow { index, source } => within("flows", *index, source),
            Self::Event { index, source } => within("events", *index, source),
            Self::UnknownVehicle { event, .. } => format!("events.{event}.vehicle"),
            Self::SameName { index, .. } => format!("vehicles.{index}.name"),
            Self::UnknownRange { key, .. } | Self::BadRange { key, .. } => format!("ranges.{key}"),
            Self::FlowOnRing => "flows".to_owned(),
            Self::BesideRecording { key } => (*key).to_owned(),
            Self::NoRecording { .. } => "recording.file".to_owned(),
            Self::EmptyRoad | Self::TooDense { .. } | Self::NoRoomForEgo { .. } => {
                "traffic.density_veh_per_km_lane".to_owned()
            }
            Self::NoSuchLane { who, .. } => who.key("lane"),
            Self::OffLane { who, .. } | Self::PastStopping { who, .. } => who.key("s_m"),
            Self::Overlap { second, .. } => second.key("s_m"),
            Self::Unsafe { follower, .. } => follower.key("s_m"),
        }
    }
}
