//! Running a recorded episode again, to the bit.

use std::sync::Arc;

use lanecraft_drive::env::{Config, Env, EnvError, Frame, StepError, TRACE_SCHEMA, Trace};

/// Why a trace cannot be run again.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// Its configuration cannot be read.
    #[error("the configuration in the trace cannot be read: {0}")]
    Config(#[from] toml::de::Error),
    /// Its scenario cannot be built.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// Of another format.
    #[error("the trace has schema {found}, but this program reads {TRACE_SCHEMA}")]
    Schema {
        /// Schema of the trace.
        found: u32,
    },
}

/// What came of running a trace again.
#[derive(Clone, Debug, PartialEq)]
pub enum ReplayVerdict {
    /// Every step is the same.
    Same {
        /// Steps compared.
        steps: usize,
    },
    /// Some step differs.
    Differs {
        /// The first such step, from 1.
        step: usize,
        /// Its first differing field.
        field: String,
        /// In the trace.
        recorded: String,
        /// Now.
        now: String,
    },
}

/// Runs `trace` again from its seed and its actions and compares each control step.
pub fn check(trace: &Trace) -> Result<ReplayVerdict, ReplayError> {
    if trace.header.schema != TRACE_SCHEMA {
        return Err(ReplayError::Schema { found: trace.header.schema });
    }
    let config: Config = toml::from_str(&trace.header.config_toml)?;
    let mut env = Env::new(&Arc::new(config), trace.header.scenario_seed)?;
    let mut steps = 0;
    for tick in &trace.ticks {
        let now = match env.step_recorded(tick.action) {
            Ok((_, now)) => now,
            Err(error) => return Ok(refused(steps + 1, tick.action, &error)),
        };
        for (recorded, now) in tick.frames.iter().zip(&now.frames) {
            steps += 1;
            if let Some((field, recorded, now)) = first_difference(recorded, now) {
                return Ok(ReplayVerdict::Differs { step: steps, field, recorded, now });
            }
        }
        if tick.frames.len() != now.frames.len() {
            let [recorded, now] = [&tick.frames, &now.frames].map(|frames| frames.len().to_string());
            return Ok(ReplayVerdict::Differs { step: steps + 1, field: "number of steps".to_owned(), recorded, now });
        }
    }
    Ok(ReplayVerdict::Same { steps })
}

fn refused(step: usize, action: usize, error: &StepError) -> ReplayVerdict {
    ReplayVerdict::Differs { step, field: "action".to_owned(), recorded: action.to_string(), now: error.to_string() }
}

/// The first field in which two frames differ, with both values: the ego's, then a vehicle's, then the digest of the rest.
fn first_difference(recorded: &Frame, now: &Frame) -> Option<(String, String, String)> {
    let [a, b] = [recorded, now].map(|frame| serde_json::to_value(frame).expect("frames are plain numbers"));
    let mut path = String::new();
    difference(&a, &b, &mut path).map(|(a, b)| (path, a, b))
}

fn difference(a: &serde_json::Value, b: &serde_json::Value, path: &mut String) -> Option<(String, String)> {
    use serde_json::Value::{Array, Object};
    match (a, b) {
        (Object(a), Object(b)) => a.iter().find_map(|(key, x)| {
            let len = path.len();
            path.push_str(if len > 0 { "." } else { "" });
            path.push_str(key);
            let found = difference(x, b.get(key).unwrap_or(&serde_json::Value::Null), path);
            if found.is_none() {
                path.truncate(len);
            }
            found
        }),
        (Array(a), Array(b)) if a.len() == b.len() => a.iter().zip(b).enumerate().find_map(|(index, (x, y))| {
            let len = path.len();
            path.extend(["[", &index.to_string(), "]"]);
            let found = difference(x, y, path);
            if found.is_none() {
                path.truncate(len);
            }
            found
        }),
        _ if a == b => None,
        _ => Some((a.to_string(), b.to_string())),
    }
}
