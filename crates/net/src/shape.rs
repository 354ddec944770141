//! Shapes of ensembles and the layout of their parameter vector.

use std::ops::Range;

/// An ensemble of heads on a shared core; all layers but the last of each head are rectified (`ReLU`).
///
/// The paper's bootstrapped network (Table III) is core \[128\], head \[64, 64\] and as many outputs as there are actions;
/// with one head it is exactly the network of plain deep Q-learning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetShape {
    /// Length of an input vector.
    pub inputs: usize,
    /// Widths of the shared layers, from the input on; may be empty.
    pub core: Vec<usize>,
    /// Widths of the hidden layers of each head; may be empty.
    pub head: Vec<usize>,
    /// Outputs of each head.
    pub outputs: usize,
    /// Number of heads, at most 32.
    pub heads: usize,
}

/// A shape that makes no network, or parameters that do not fit one.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ShapeError {
    /// A width of zero, or one too large to allocate in earnest.
    #[error("the network's {what} is {found}, but must be in 1..={max}")]
    Width {
        /// Which width.
        what: &'static str,
        /// The width found.
        found: usize,
        /// The largest width allowed.
        max: usize,
    },
    /// A parameter vector of the wrong length.
    #[error("the parameter vector has {found} values, but the network has {expected}")]
    Parameters {
        /// The number of parameters of the shape.
        expected: usize,
        /// The length found.
        found: usize,
    },
}

/// The largest width of a layer.
pub(crate) const MAX_WIDTH: usize = 65_536;
/// A mask of heads has 32 bits.
const MAX_HEADS: usize = 32;

pub(crate) fn check(what: &'static str, found: usize, max: usize) -> Result<(), ShapeError> {
    if (1..=max).contains(&found) { Ok(()) } else { Err(ShapeError::Width { what, found, max }) }
}

/// A named tensor inside the parameter vector.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorSlot {
    /// For example `core.0.weight` or `head.2.bias`.
    pub name: String,
    /// Weights: copies × inputs × outputs of the layer; biases: copies × outputs. Copies are 1 in the core, K in the heads.
    pub shape: Vec<usize>,
    /// Where the values lie in the parameter vector.
    pub range: Range<usize>,
}

/// One dense layer: `copies` matrices `inputs` × `outputs` one after the other, then `copies` bias vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Layer {
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
    pub(crate) copies: usize,
    pub(crate) rectified: bool,
    pub(crate) start: usize,
}

impl Layer {
    /// The weights of one copy, inputs × outputs.
    pub(crate) fn weights(&self, copy: usize) -> Range<usize> {
        let size = self.inputs * self.outputs;
        self.start + copy * size..self.start + (copy + 1) * size
    }

    /// The biases of one copy.
    pub(crate) fn biases(&self, copy: usize) -> Range<usize> {
        let start = self.start + self.copies * self.inputs * self.outputs;
        start + copy * self.outputs..start + (copy + 1) * self.outputs
    }

    fn end(&self) -> usize {
        self.biases(self.copies - 1).end
    }
}

impl NetShape {
    /// Checks that every width is at least 1 and none is absurd.
    pub fn validate(&self) -> Result<(), ShapeError> {
        check("number of inputs", self.inputs, MAX_WIDTH)?;
        check("number of outputs", self.outputs, MAX_WIDTH)?;
        check("number of heads", self.heads, MAX_HEADS)?;
        self.core.iter().try_for_each(|width| check("core layer width", *width, MAX_WIDTH))?;
        self.head.iter().try_for_each(|width| check("head layer width", *width, MAX_WIDTH))
    }

    /// Length of the parameter vector.
    pub fn parameter_count(&self) -> usize {
        self.layers().last().map_or(0, Layer::end)
    }

    /// The tensors of the parameter vector in order: for each layer its weights, then its biases.
    pub fn tensors(&self) -> Vec<TensorSlot> {
        let mut slots = Vec::new();
        for (index, layer) in self.layers().iter().enumerate() {
            let (part, number) =
                if index < self.core.len() { ("core", index) } else { ("head", index - self.core.len()) };
            let last = layer.copies - 1;
            slots.push(TensorSlot {
                name: format!("{part}.{number}.weight"),
                shape: vec![layer.copies, layer.inputs, layer.outputs],
                range: layer.weights(0).start..layer.weights(last).end,
            });
            slots.push(TensorSlot {
                name: format!("{part}.{number}.bias"),
                shape: vec![layer.copies, layer.outputs],
                range: layer.biases(0).start..layer.biases(last).end,
            });
        }
        slots
    }

    /// The layers from the input on: first the core's, then the heads'.
    pub(crate) fn layers(&self) -> Vec<Layer> {
        let mut layers: Vec<Layer> = Vec::new();
        let widths = self.core.iter().chain(&self.head).chain(std::iter::once(&self.outputs));
        for (index, &outputs) in widths.enumerate() {
            let (inputs, start) = layers.last().map_or((self.inputs, 0), |last| (last.outputs, last.end()));
            let copies = if index < self.core.len() { 1 } else { self.heads };
            let rectified = index < self.core.len() + self.head.len();
            layers.push(Layer { inputs, outputs, copies, rectified, start });
        }
        layers
    }
}
