//! Numbers that each seed draws anew, by their keys: what makes a file a distribution over scenes.
//!
//! Any number of the sections `road` and `traffic` may be given a range, without a list of them here: the keys are those of the
//! sections as they are written.

use std::collections::BTreeMap;

use lanecraft_net::random::Stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::{ScenarioError, TrafficConfig};
use crate::road::RoadConfig;

/// Numbers that are drawn: sections, and in them keys.
pub type Ranges = BTreeMap<String, Range>;

/// A uniform range, or those of the keys below.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a range, `[lower end, upper end]`, or keys with ranges")]
pub enum Range {
    /// Lower and upper end.
    Ends([f64; 2]),
    /// Ranges by key.
    Keys(Ranges),
}

/// All ranges by their dotted keys.
fn flat(ranges: &Ranges) -> BTreeMap<String, [f64; 2]> {
    let of = |(key, range): (&String, &Range)| match range {
        Range::Ends(ends) => vec![(key.clone(), *ends)],
        Range::Keys(keys) => flat(keys).into_iter().map(|(inner, ends)| (format!("{key}.{inner}"), ends)).collect(),
    };
    ranges.iter().flat_map(of).collect()
}

/// The sections that may have ranges.
#[derive(Serialize, Deserialize)]
struct Sections {
    road: RoadConfig,
    traffic: TrafficConfig,
}

/// Every range must belong to a number, and both its ends must be values of that number.
pub(super) fn check(ranges: &Ranges, road: &RoadConfig, traffic: &TrafficConfig) -> Result<(), ScenarioError> {
    for (key, [low, high]) in flat(ranges) {
        if low.is_nan() || high.is_nan() || low > high {
            return Err(ScenarioError::BadRange { key, low, high });
        }
    }
    for share in [0.0, 1.0] {
        let (road, traffic) = apply(ranges, road, traffic, |_, [low, high]| low + share * (high - low))?;
        road.validate()?;
        traffic.validate()?;
    }
    Ok(())
}

/// Both sections with their ranges drawn from `seed`, each from a stream of its own.
pub(super) fn draw(
    ranges: &Ranges,
    road: &RoadConfig,
    traffic: &TrafficConfig,
    seed: u64,
) -> Result<(RoadConfig, TrafficConfig), ScenarioError> {
    let uniform =
        |key: &str, [low, high]: [f64; 2]| Stream::new(seed, &format!("scenario.range.{key}")).range(low, high);
    let (road, traffic) = apply(ranges, road, traffic, uniform)?;
    road.validate()?;
    traffic.validate()?;
    Ok((road, traffic))
}

fn apply(
    ranges: &Ranges,
    road: &RoadConfig,
    traffic: &TrafficConfig,
    value: impl Fn(&str, [f64; 2]) -> f64,
) -> Result<(RoadConfig, TrafficConfig), ScenarioError> {
    if ranges.is_empty() {
        return Ok((road.clone(), traffic.clone()));
    }
    let sections = Sections { road: road.clone(), traffic: traffic.clone() };
    let mut table = Table::try_from(sections).expect("all sections are tables of plain values");
    for (key, ends) in flat(ranges) {
        let value = value(&key, ends);
        let mut parts = key.split('.');
        let section = parts.next().and_then(|section| table.get_mut(section));
        match section.and_then(|section| parts.try_fold(section, |at, part| at.get_mut(part))) {
            Some(Value::Float(number)) => *number = value,
            Some(Value::Integer(number)) => *number = value.round() as i64,
            _ => return Err(ScenarioError::UnknownRange { key, known: numbers(&table) }),
        }
    }
    let Sections { road, traffic } = table.try_into().map_err(ScenarioError::Parse)?;
    Ok((road, traffic))
}

/// The keys that may have ranges.
fn numbers(table: &Table) -> Vec<String> {
    let of = |(key, value): (&String, &Value)| match value {
        Value::Float(_) | Value::Integer(_) => vec![key.clone()],
        Value::Table(inner) => numbers(inner).into_iter().map(|inner| format!("{key}.{inner}")).collect(),
        _ => Vec::new(),
    };
    table.iter().flat_map(of).collect()
}
