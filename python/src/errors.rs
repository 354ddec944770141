//! From this crate's errors to the package's exceptions.

use std::error::Error;

use lanecraft_lab::gym::GymError;
use pyo3::PyErr;

pyo3::import_exception!(gymnasium.error, ResetNeeded);
pyo3::import_exception!(gymnasium.error, ClosedEnvironmentError);
pyo3::import_exception!(lanecraft.errors, ActionError);
pyo3::import_exception!(lanecraft.errors, ConfigError);
pyo3::import_exception!(lanecraft.errors, SnapshotError);

/// The error with all its causes, in one line.
pub(crate) fn message(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(inner) = cause {
        let more = inner.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        cause = inner.source();
    }
    text
}

/// A configuration that cannot be used.
pub(crate) fn config(error: &dyn Error) -> PyErr {
    ConfigError::new_err(message(error))
}

/// A step, a reset or a snapshot that cannot be.
pub(crate) fn gym(error: &GymError) -> PyErr {
    let text = message(error);
    let mut innermost = error;
    while let GymError::At { source, .. } = innermost {
        innermost = source;
    }
    match innermost {
        GymError::Over => ResetNeeded::new_err(text),
        GymError::Env(_) | GymError::Scenario(_) => ConfigError::new_err(text),
        GymError::Snapshot(_) | GymError::OtherTask => SnapshotError::new_err(text),
        GymError::Threads(_) => pyo3::exceptions::PyRuntimeError::new_err(text),
        _ => ActionError::new_err(text),
    }
}
