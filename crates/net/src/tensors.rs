//! Named tensors to and from the bytes of a safetensors file; reading and writing files is the caller's.
//!
//! The format holds data only, no code. A reader checks the header's length before it parses, and names and shapes before
//! it copies, so that a damaged or hostile file is a typed error and costs no more memory than its own size.

use std::borrow::Cow;
use std::collections::BTreeSet;

use safetensors::{Dtype, SafeTensors, View};

/// The longest header accepted, 1 MiB: the format itself would allow 100 MB of entries to be parsed.
pub const MAX_HEADER_BYTES: u64 = 1 << 20;

/// Values of one tensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Values<'a> {
    /// Single-precision numbers.
    F32(&'a [f32]),
    /// Unsigned integers.
    U32(&'a [u32]),
}

/// A tensor to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedTensor<'a> {
    /// Name, unique in its file.
    pub name: String,
    /// Shape, row-major; its product is the number of values.
    pub shape: Vec<usize>,
    /// The values.
    pub values: Values<'a>,
}

/// What is wrong with a file of tensors.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TensorError {
    /// Fewer bytes than the length field takes.
    #[error("the tensor file has {found} bytes, fewer than the 8 of its length field")]
    TooShort {
        /// Bytes found.
        found: usize,
    },
    /// A header longer than allowed.
    #[error("the tensor file declares a header of {found} bytes, but at most {max} are allowed")]
    HeaderTooLong {
        /// Length declared.
        found: u64,
        /// Longest length allowed.
        max: u64,
    },
    /// The bytes are no safetensors file, or a part of one.
    #[error("the tensor file cannot be read; it may be cut off or damaged")]
    Malformed(#[source] safetensors::SafeTensorError),
    /// A tensor is not there.
    #[error("the tensor file has no tensor `{name}`")]
    Missing {
        /// Name looked for.
        name: String,
    },
    /// A tensor nobody asked for.
    #[error("the tensor file has an unknown tensor `{name}`")]
    Unknown {
        /// Name found.
        name: String,
    },
    /// The wrong shape.
    #[error("tensor `{name}` has shape {found:?}, but must have {expected:?}")]
    Shape {
        /// Name of the tensor.
        name: String,
        /// Shape required.
        expected: Vec<usize>,
        /// Shape found.
        found: Vec<usize>,
    },
    /// A tensor to be written whose shape does not hold its values.
    #[error("tensor `{name}` of shape {shape:?} was given {found} values")]
    Length {
        /// Name of the tensor.
        name: String,
        /// Its shape.
        shape: Vec<usize>,
        /// Number of values given.
        found: usize,
    },
    /// The wrong type of numbers.
    #[error("tensor `{name}` holds {found}, but must hold {expected}")]
    Type {
        /// Name of the tensor.
        name: String,
        /// Type required.
        expected: String,
        /// Type found.
        found: String,
    },
    /// A value that is infinite or not a number.
    #[error("tensor `{name}` holds {value} at index {index}, but all values must be finite")]
    NotFinite {
        /// Name of the tensor.
        name: String,
        /// Index in row-major order.
        index: usize,
        /// The value.
        value: f32,
    },
}

/// The bytes of a file with these tensors. Equal tensors give equal bytes.
pub fn to_bytes(tensors: &[NamedTensor<'_>]) -> Result<Vec<u8>, TensorError> {
    for tensor in tensors {
        let found = tensor.values.len();
        if tensor.shape.iter().product::<usize>() != found {
            return Err(TensorError::Length { name: tensor.name.clone(), shape: tensor.shape.clone(), found });
        }
    }
    let views = tensors.iter().map(|tensor| (tensor.name.as_str(), tensor));
    safetensors::serialize(views, None).map_err(TensorError::Malformed)
}

impl Values<'_> {
    fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::U32(values) => values.len(),
        }
    }
}

impl View for &NamedTensor<'_> {
    fn dtype(&self) -> Dtype {
        match self.values {
            Values::F32(_) => Dtype::F32,
            Values::U32(_) => Dtype::U32,
        }
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// The values as little-endian bytes, made when they are written, one tensor at a time.
    fn data(&self) -> Cow<'_, [u8]> {
        let mut bytes = Vec::with_capacity(self.data_len());
        match self.values {
            Values::F32(values) => values.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes())),
            Values::U32(values) => values.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes())),
        }
        Cow::Owned(bytes)
    }

    fn data_len(&self) -> usize {
        4 * self.values.len()
    }
}

/// The tensors of a file in memory, to be taken one by one.
#[derive(Debug)]
pub struct TensorFile<'a> {
    tensors: SafeTensors<'a>,
    taken: BTreeSet<String>,
}

impl<'a> TensorFile<'a> {
    /// Reads the header.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, TensorError> {
        let Some(length) = bytes.first_chunk::<8>() else {
            return Err(TensorError::TooShort { found: bytes.len() });
        };
        let found = u64::from_le_bytes(*length);
        if found > MAX_HEADER_BYTES {
            return Err(TensorError::HeaderTooLong { found, max: MAX_HEADER_BYTES });
        }
        let tensors = SafeTensors::deserialize(bytes).map_err(TensorError::Malformed)?;
        Ok(Self { tensors, taken: BTreeSet::new() })
    }

    /// Refuses a file with a tensor that was not taken.
    pub fn finish(self) -> Result<(), TensorError> {
        let mut names = self.tensors.names();
        names.sort_unstable();
        match names.into_iter().find(|name| !self.taken.contains(*name)) {
            Some(name) => Err(TensorError::Unknown { name: name.to_owned() }),
            None => Ok(()),
        }
    }

    /// The values of a tensor of finite f32 of this shape.
    pub fn take_f32(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>, TensorError> {
        let bytes = self.take(name, shape, Dtype::F32)?;
        let values: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)).collect();
        match values.iter().position(|value| !value.is_finite()) {
            Some(index) => Err(TensorError::NotFinite { name: name.to_owned(), index, value: values[index] }),
            None => Ok(values),
        }
    }

    /// The values of a tensor of u32 of this shape.
    pub fn take_u32(&mut self, name: &str, shape: &[usize]) -> Result<Vec<u32>, TensorError> {
        let bytes = self.take(name, shape, Dtype::U32)?;
        Ok(bytes.as_chunks::<4>().0.iter().map(|value| u32::from_le_bytes(*value)).collect())
    }

    fn take(&mut self, name: &str, shape: &[usize], kind: Dtype) -> Result<&'a [u8], TensorError> {
        let tensor = self.tensors.tensor(name).map_err(|_| TensorError::Missing { name: name.to_owned() })?;
        if tensor.shape() != shape {
            let (expected, found) = (shape.to_vec(), tensor.shape().to_vec());
            return Err(TensorError::Shape { name: name.to_owned(), expected, found });
        }
        if tensor.dtype() != kind {
            let (expected, found) = (format!("{kind:?}"), format!("{:?}", tensor.dtype()));
            return Err(TensorError::Type { name: name.to_owned(), expected, found });
        }
        self.taken.insert(name.to_owned());
        Ok(tensor.data())
    }
}

#[cfg(test)]
mod tests {
    use super::{NamedTensor, TensorError, TensorFile, Values, to_bytes};

    fn sample() -> Vec<u8> {
        let weight = [1.0_f32, -2.5, f32::MIN_POSITIVE, -0.0, 7.0, 1e30];
        to_bytes(&[
            NamedTensor { name: "weight".to_owned(), shape: vec![2, 3], values: Values::F32(&weight) },
            NamedTensor { name: "mask".to_owned(), shape: vec![2], values: Values::U32(&[7, u32::MAX]) },
        ])
        .unwrap()
    }

    #[test]
    fn tensors_return_bit_for_bit() {
        let bytes = sample();
        let mut file = TensorFile::parse(&bytes).unwrap();
        let weight = file.take_f32("weight", &[2, 3]).unwrap();
        assert_eq!(weight[3].to_bits(), (-0.0_f32).to_bits());
        assert_eq!(weight[5], 1e30);
        assert_eq!(file.take_u32("mask", &[2]).unwrap(), [7, u32::MAX]);
        file.finish().unwrap();
        assert_eq!(bytes, sample());
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let bytes = sample();
        let mut file = TensorFile::parse(&bytes).unwrap();
        assert!(matches!(file.take_f32("bias", &[2]), Err(TensorError::Missing { .. })));
        assert!(matches!(file.take_f32("weight", &[3, 2]), Err(TensorError::Shape { .. })));
        assert!(matches!(file.take_u32("weight", &[2, 3]), Err(TensorError::Type { .. })));
        assert!(matches!(file.finish(), Err(TensorError::Unknown { .. })));
        let tensor = NamedTensor { name: "x".to_owned(), shape: vec![3], values: Values::U32(&[1, 2]) };
        assert!(matches!(to_bytes(&[tensor]), Err(TensorError::Length { found: 2, .. })));
        let nan = [f32::NAN];
        let tensor = NamedTensor { name: "x".to_owned(), shape: vec![1], values: Values::F32(&nan) };
        let bytes = to_bytes(&[tensor]).unwrap();
        let mut file = TensorFile::parse(&bytes).unwrap();
        assert!(matches!(file.take_f32("x", &[1]), Err(TensorError::NotFinite { index: 0, .. })));
    }

    #[test]
    fn every_cut_is_refused_and_no_flipped_bit_panics() {
        let bytes = sample();
        for length in 0..bytes.len() {
            assert!(TensorFile::parse(&bytes[..length]).is_err(), "{length} of {} bytes", bytes.len());
        }
        for bit in 0..8 * bytes.len() {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            if let Ok(mut file) = TensorFile::parse(&damaged) {
                let _ = file.take_f32("weight", &[2, 3]);
                let _ = file.take_u32("mask", &[2]);
            }
        }
    }

    #[test]
    fn a_long_header_is_refused_before_it_is_parsed() {
        let mut bytes = ((1_u64 << 20) + 1).to_le_bytes().to_vec();
        bytes.resize(1 << 21, b' ');
        assert!(matches!(TensorFile::parse(&bytes), Err(TensorError::HeaderTooLong { .. })));
    }
}
