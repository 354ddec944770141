//! Fits of a maximum-entropy reward.

use lanecraft_learn::irl::{CandidateSet, IrlConfig, IrlVerdict, fit};
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{self, ConfigError};
use crate::parts::shaped;
use crate::task::resolved;

/// Weights of normalized and of raw features, log-likelihoods per event of the fit and of chance, gradient, iterations, convergence.
type Fitted = (Vec<f64>, Vec<f64>, (f64, f64), f64, usize, bool);

/// Settings of fits.
#[pyclass(frozen, module = "lanecraft._lanecraft")]
pub(crate) struct IrlCore {
    config: IrlConfig,
}

#[pymethods]
impl IrlCore {
    #[new]
    fn new(preset: &str, options: &Bound<'_, PyDict>) -> PyResult<Self> {
        let config = PyDict::new(options.py());
        config.set_item("irl", options)?;
        Ok(Self { config: resolved(preset, &config, None)?.irl })
    }

    /// Fits events whose candidates stand one below the other: `counts` candidates of each, and which of them was chosen.
    fn fit(
        &self,
        py: Python<'_>,
        features: PyReadonlyArray2<'_, f64>,
        counts: PyReadonlyArray1<'_, i64>,
        chosen: PyReadonlyArray1<'_, i64>,
    ) -> PyResult<Fitted> {
        let events = events(&features, &counts, &chosen)?;
        let found = py.detach(|| fit(&events, &self.config)).map_err(|error| errors::config(&error))?;
        let likelihoods = (found.log_likelihood_per_event, found.uniform_log_likelihood_per_event);
        let converged = found.verdict == IrlVerdict::Converged;
        Ok((found.normalized_weights, found.weights, likelihoods, found.gradient_norm, found.iterations, converged))
    }
}

fn events(
    features: &PyReadonlyArray2<'_, f64>,
    counts: &PyReadonlyArray1<'_, i64>,
    chosen: &PyReadonlyArray1<'_, i64>,
) -> PyResult<Vec<CandidateSet>> {
    let (features, counts, chosen) = (features.as_array(), counts.as_array(), chosen.as_array());
    shaped("chosen", &chosen, counts.shape())?;
    let mut rows = features.rows().into_iter().map(|row| row.to_vec());
    let events = counts.iter().zip(&chosen).map(|(&count, &chosen)| CandidateSet {
        features: rows.by_ref().take(usize::try_from(count).unwrap_or_default()).collect(),
        chosen: usize::try_from(chosen).unwrap_or(usize::MAX),
    });
    let events = events.collect();
    match rows.next() {
        None => Ok(events),
        Some(_) => Err(ConfigError::new_err("there are more candidates than `counts` says")),
    }
}
