//! Which predictor, with which weights.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::lstm::{FRAME_PERIOD_S, LstmForecaster, LstmModel, ModelError};
use super::{FORECAST_STEP_S, Forecast, Predictor};
use crate::config::{ConfigError, whole_multiple};
use crate::scene::Scene;

/// The forecast's section.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PredictionConfig {
    /// Which predictor planner and controllers are given. The paper has an LSTM of which it says nothing more.
    pub predictor: Predictor,
    /// Weights of the predictor `lstm`.
    pub model: ModelSource,
}

impl PredictionConfig {
    /// Checks that there are weights where they are needed, and that its instants fall on control steps.
    pub fn validate(&self, control_period_s: f64) -> Result<(), ConfigError> {
        match self.predictor {
            Predictor::Lstm => {
                self.model.loaded()?;
                stride(control_period_s)?;
            }
            Predictor::TrueFuture => {
                control_steps_per_point(control_period_s)?;
            }
            _ => {}
        }
        Ok(())
    }
}

/// Control steps between two instants that the recurrent network is told of.
fn stride(control_period_s: f64) -> Result<usize, ConfigError> {
    let frame = ("the predictor's 0.2 s", FRAME_PERIOD_S);
    Ok(whole_multiple(frame, ("env.control_period_s", control_period_s))? as usize)
}

/// Control steps between two points of a forecast.
pub(crate) fn control_steps_per_point(control_period_s: f64) -> Result<u32, ConfigError> {
    whole_multiple(("the forecast's 0.1 s", FORECAST_STEP_S), ("env.control_period_s", control_period_s))
}

/// Weights that are built in, or those of a file. This crate reads no files: whoever builds a configuration that names one loads it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub struct ModelSource {
    name: String,
    model: Option<Arc<LstmModel>>,
}

impl ModelSource {
    /// The name of the weights that are built in.
    pub const BUILT_IN: &str = "built-in";

    /// The path of the file, unless the weights are built in.
    pub fn path(&self) -> Option<&str> {
        (self.name != Self::BUILT_IN).then_some(self.name.as_str())
    }

    /// Takes the weights of the file's bytes.
    ///
    /// # Errors
    /// If they are no model.
    pub fn load(&mut self, bytes: &[u8]) -> Result<(), ModelError> {
        self.attach(Arc::new(LstmModel::from_bytes(bytes)?));
        Ok(())
    }

    /// Takes weights that are at hand.
    pub fn attach(&mut self, model: Arc<LstmModel>) {
        self.model = Some(model);
    }

    /// The weights.
    ///
    /// # Errors
    /// If they are those of a file that nobody has loaded.
    pub fn loaded(&self) -> Result<Arc<LstmModel>, ConfigError> {
        if self.path().is_none() {
            return Ok(LstmModel::built_in());
        }
        let missing = || ConfigError::NotLoaded { key: "prediction.model", name: self.name.clone() };
        self.model.clone().ok_or_else(missing)
    }
}

impl Default for ModelSource {
    fn default() -> Self {
        Self { name: Self::BUILT_IN.to_owned(), model: None }
    }
}

impl From<String> for ModelSource {
    fn from(name: String) -> Self {
        Self { name, model: None }
    }
}

impl From<ModelSource> for String {
    fn from(source: ModelSource) -> Self {
        source.name
    }
}

/// A predictor with what it remembers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Forecaster {
    /// The present scene is enough.
    OfScene(Predictor),
    /// It goes by tracks.
    OfTracks(Box<LstmForecaster>),
    /// Somebody who knows better hands it in with each scene.
    HandedIn(Forecast),
}

impl Forecaster {
    /// A predictor that has seen nothing yet and will see a scene each `period_s`.
    ///
    /// # Errors
    /// If its weights were not loaded, or its instants are no whole number of periods apart.
    pub fn new(config: &PredictionConfig, period_s: f64) -> Result<Self, ConfigError> {
        Ok(match config.predictor {
            Predictor::Lstm => Self::OfTracks(Box::new(LstmForecaster::new(config.model.loaded()?, stride(period_s)?))),
            Predictor::TrueFuture => Self::HandedIn(Forecast::default()),
            of_scene => Self::OfScene(of_scene),
        })
    }

    /// The weights, if it has any.
    pub fn model(&self) -> Option<&Arc<LstmModel>> {
        match self {
            Self::OfScene(_) | Self::HandedIn(_) => None,
            Self::OfTracks(forecaster) => Some(forecaster.model()),
        }
    }

    /// Forecasts every neighbor of `scene`, which follows on those remembered, into `forecast`, whose room is used again.
    pub fn forecast(&mut self, scene: &Scene, forecast: &mut Forecast) {
        match self {
            Self::OfScene(predictor) => predictor.forecast(scene, forecast),
            Self::OfTracks(forecaster) => {
                forecast.reset(scene.neighbors.len());
                forecaster.forecast(scene, forecast);
            }
            Self::HandedIn(known) => forecast.clone_from(known),
        }
    }

    /// The forecast that is to be handed in before each call of [`Self::forecast`], if this is one that needs it.
    pub fn handed_in_mut(&mut self) -> Option<&mut Forecast> {
        if let Self::HandedIn(known) = self { Some(known) } else { None }
    }

    /// Takes `scene` into its memory, if it has one; once for each period, after the forecasts.
    pub fn remember(&mut self, scene: &Scene) {
        if let Self::OfTracks(forecaster) = self {
            forecaster.remember(scene);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_of_a_file_must_be_loaded_before_they_are_used() {
        let mut config = PredictionConfig { model: "mine.safetensors".to_owned().into(), ..Default::default() };
        assert_eq!(config.validate(0.05), Ok(()));
        config.predictor = Predictor::Lstm;
        let message = config.validate(0.05).unwrap_err().to_string();
        assert_eq!(message, "`prediction.model` is \"mine.safetensors\", but that file has not been loaded");
        config.model.load(&LstmModel::built_in().to_bytes().unwrap()).unwrap();
        assert_eq!(config.validate(0.05), Ok(()));
        assert!(config.validate(0.03).is_err());
        assert!(config.model.load(b"nonsense").is_err());
    }
}
