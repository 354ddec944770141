//! The weights of the recurrent predictor, from the bytes of a file; reading files is the caller's.

use std::sync::{Arc, OnceLock};

use lanecraft_net::tensors::{NamedTensor, TensorError, TensorFile, Values, to_bytes};
use lanecraft_net::{Lstm, LstmShape, ShapeError};
use serde::{Deserialize, Serialize};

use super::{FEATURES, OUTPUTS};

/// Version of what the network is told and says. It is raised whenever a feature or an output changes its meaning.
const MODEL_SCHEMA: u32 = 1;
/// The widest state accepted: beyond it a forecast costs more than all else.
const MAX_HIDDEN: u32 = 512;
/// Version and width, before the weights.
const HEADER: &str = "header";

/// Why a file is no model of this predictor.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// It is no file of tensors, or one is missing, unknown or of another shape.
    #[error(transparent)]
    Tensors(#[from] TensorError),
    /// It was made for other features or outputs.
    #[error("the model has version {found}, but only version {MODEL_SCHEMA} can be used")]
    Schema {
        /// Its version.
        found: u32,
    },
    /// Its state is empty, or wider than anybody needs.
    #[error("the model's state has {found} values, but must have 1 to {MAX_HIDDEN}")]
    Hidden {
        /// Width of the state.
        found: u32,
    },
    /// Its network cannot be built.
    #[error(transparent)]
    Shape(#[from] ShapeError),
}

/// A trained network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Stored", into = "Stored")]
pub struct LstmModel {
    network: Lstm,
}

/// A model inside of a snapshot.
#[derive(Serialize, Deserialize)]
struct Stored {
    hidden: usize,
    parameters: Vec<f32>,
}

impl From<LstmModel> for Stored {
    fn from(model: LstmModel) -> Self {
        Self { hidden: model.network.shape().hidden, parameters: model.network.parameters().to_vec() }
    }
}

impl TryFrom<Stored> for LstmModel {
    type Error = ShapeError;

    fn try_from(stored: Stored) -> Result<Self, ShapeError> {
        Ok(Self { network: Lstm::from_parameters(Self::shape(stored.hidden), stored.parameters)? })
    }
}

impl LstmModel {
    /// The shape of a network with a state of this width.
    pub fn shape(hidden: usize) -> LstmShape {
        LstmShape { inputs: FEATURES, hidden, outputs: OUTPUTS }
    }

    /// A model with the weights of `network`.
    ///
    /// # Errors
    /// If the network is not told the features or does not say the outputs of this predictor.
    pub fn new(network: Lstm) -> Result<Self, ShapeError> {
        let shape = Self::shape(network.shape().hidden);
        if *network.shape() == shape {
            return Ok(Self { network });
        }
        Err(ShapeError::Parameters { expected: shape.parameter_count(), found: network.parameters().len() })
    }

    /// The model that this version comes with, trained as its card says (`models/predictor.md`).
    pub fn built_in() -> Arc<Self> {
        static MODEL: OnceLock<Arc<LstmModel>> = OnceLock::new();
        let bytes = include_bytes!("../../../../../models/predictor.safetensors");
        let model = || Arc::new(Self::from_bytes(bytes).expect("the file is read in a test of this module"));
        Arc::clone(MODEL.get_or_init(model))
    }

    /// The model in the bytes of a file.
    ///
    /// # Errors
    /// If they are anything else, cut off, or of another version.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelError> {
        let mut file = TensorFile::parse(bytes)?;
        let header = file.take_u32(HEADER, &[2])?;
        if header[0] != MODEL_SCHEMA {
            return Err(ModelError::Schema { found: header[0] });
        }
        if !(1..=MAX_HIDDEN).contains(&header[1]) {
            return Err(ModelError::Hidden { found: header[1] });
        }
        let shape = Self::shape(header[1] as usize);
        let mut parameters = Vec::with_capacity(shape.parameter_count());
        for slot in shape.tensors() {
            parameters.extend(file.take_f32(&slot.name, &slot.shape)?);
        }
        file.finish()?;
        Ok(Self { network: Lstm::from_parameters(shape, parameters)? })
    }

    /// The bytes of a file. Equal models give equal bytes.
    ///
    /// # Errors
    /// If the writer of the format refuses.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModelError> {
        let shape = self.network.shape();
        let header = [MODEL_SCHEMA, shape.hidden as u32];
        let mut tensors = vec![NamedTensor { name: HEADER.to_owned(), shape: vec![2], values: Values::U32(&header) }];
        for slot in shape.tensors() {
            let values = Values::F32(&self.network.parameters()[slot.range]);
            tensors.push(NamedTensor { name: slot.name, shape: slot.shape, values });
        }
        Ok(to_bytes(&tensors)?)
    }

    /// The network.
    pub fn network(&self) -> &Lstm {
        &self.network
    }
}

#[cfg(test)]
mod tests {
    use lanecraft_net::random::Stream;

    use super::*;

    #[test]
    fn the_built_in_model_can_be_read_and_written() {
        let bytes = include_bytes!("../../../../../models/predictor.safetensors");
        assert_eq!(LstmModel::from_bytes(bytes).unwrap().to_bytes().unwrap(), bytes);
    }

    #[test]
    fn every_other_file_is_refused_with_its_reason() {
        let model = LstmModel::new(Lstm::new(LstmModel::shape(5), &mut Stream::new(1, "init")).unwrap()).unwrap();
        let bytes = model.to_bytes().unwrap();
        assert_eq!(LstmModel::from_bytes(&bytes).unwrap(), model);
        for length in 0..bytes.len() {
            assert!(LstmModel::from_bytes(&bytes[..length]).is_err());
        }
        let with_header = |header: [u32; 2]| {
            let tensor = NamedTensor { name: HEADER.to_owned(), shape: vec![2], values: Values::U32(&header) };
            LstmModel::from_bytes(&to_bytes(&[tensor]).unwrap()).unwrap_err().to_string()
        };
        assert_eq!(with_header([7, 5]), "the model has version 7, but only version 1 can be used");
        assert_eq!(with_header([1, 0]), "the model's state has 0 values, but must have 1 to 512");
        assert_eq!(with_header([1, 5]), "the tensor file has no tensor `input.weight`");
        let other = LstmShape { inputs: 3, hidden: 5, outputs: OUTPUTS };
        assert!(LstmModel::new(Lstm::new(other, &mut Stream::new(1, "init")).unwrap()).is_err());
    }
}
