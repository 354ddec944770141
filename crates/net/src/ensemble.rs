//! An ensemble of network heads on a shared core (Osband et al., 2016): forward and backward pass side by side.
//!
//! Forward, layer by layer: y = max(0, W x + b), without the maximum in the last layer of each head. Backward, from
//! δ = ∂L/∂y of the last layer: ∂L/∂W = Σ x δ and ∂L/∂b = Σ δ over the batch, ∂L/∂x = Wᵀ δ where x > 0.
//! Eq. 11 divides the gradients of the heads by K, which matters in the shared core only: under Adam a constant factor on a
//! head's own gradient cancels. So the core's gradient is the sum over the heads divided by K, and heads keep their own.

use crate::kernel::{Kernel, Matrix};
use crate::random::Stream;
use crate::shape::{Layer, NetShape, ShapeError};

/// A network: its shape and its parameters, one flat vector in the order of [`NetShape::tensors`].
#[derive(Clone, Debug)]
pub struct Ensemble {
    shape: NetShape,
    layers: Vec<Layer>,
    parameters: Vec<f32>,
}

/// All that a pass writes besides its result, allocated once for batches of up to `capacity` rows.
#[derive(Clone, Debug)]
pub struct Workspace {
    capacity: usize,
    /// For each layer: copies × rows × outputs.
    activations: Vec<Vec<f32>>,
    /// ∂L/∂y of one layer of one copy, and ∂L/∂x of the same.
    delta: Vec<f32>,
    next_delta: Vec<f32>,
    /// ∂L/∂(output of the core), summed over the heads.
    core_delta: Vec<f32>,
    kernel: Kernel,
}

impl Workspace {
    /// A workspace for `network` and any other network of the same shape, for up to `capacity` rows.
    pub fn new(network: &Ensemble, capacity: usize) -> Self {
        let layers = &network.layers;
        let widest = layers.iter().map(|layer| layer.inputs.max(layer.outputs)).max().unwrap_or(1);
        Self {
            capacity,
            activations: layers.iter().map(|layer| vec![0.0; layer.copies * capacity * layer.outputs]).collect(),
            delta: vec![0.0; capacity * widest],
            next_delta: vec![0.0; capacity * widest],
            core_delta: vec![0.0; capacity * widest],
            kernel: Kernel::new(widest.max(capacity)),
        }
    }

    /// The largest batch that fits.
    pub fn capacity(&self) -> usize {
        self.capacity
    }
}

impl Ensemble {
    /// A network with weights drawn as by He et al. (2015): normal with variance 2/inputs in rectified layers, 1/inputs in
    /// the last; biases are zero. Heads differ by their draws alone.
    pub fn new(shape: NetShape, stream: &mut Stream) -> Result<Self, ShapeError> {
        shape.validate()?;
        let layers = shape.layers();
        let mut parameters = vec![0.0; shape.parameter_count()];
        for layer in &layers {
            let gain = if layer.rectified { 2.0 } else { 1.0 };
            let deviation = (gain / layer.inputs as f64).sqrt();
            for copy in 0..layer.copies {
                for weight in &mut parameters[layer.weights(copy)] {
                    *weight = (deviation * stream.normal()) as f32;
                }
            }
        }
        Ok(Self { shape, layers, parameters })
    }

    /// A network with given parameters.
    pub fn from_parameters(shape: NetShape, parameters: Vec<f32>) -> Result<Self, ShapeError> {
        shape.validate()?;
        let (expected, found) = (shape.parameter_count(), parameters.len());
        if expected != found {
            return Err(ShapeError::Parameters { expected, found });
        }
        Ok(Self { layers: shape.layers(), shape, parameters })
    }

    /// The shape.
    pub fn shape(&self) -> &NetShape {
        &self.shape
    }

    /// The parameter vector.
    pub fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    /// The parameter vector, to be changed in place.
    pub fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }

    /// Outputs of all heads, K × B × A row-major, for `inputs`, B × inputs row-major.
    ///
    /// # Panics
    /// If `inputs` is no whole number of rows or more rows than the workspace was made for.
    pub fn forward<'w>(&self, inputs: &[f32], workspace: &'w mut Workspace) -> &'w [f32] {
        let rows = self.rows(inputs, workspace);
        for (index, layer) in self.layers.iter().enumerate() {
            let (before, after) = workspace.activations.split_at_mut(index);
            for copy in 0..layer.copies {
                let x = self.layer_input(index, copy, rows, inputs, before);
                let size = rows * layer.outputs;
                let y = &mut after[0][copy * size..(copy + 1) * size];
                let biases = &self.parameters[layer.biases(copy)];
                for row in y.chunks_exact_mut(layer.outputs) {
                    row.copy_from_slice(biases);
                }
                let weights = Matrix::row_major(&self.parameters[layer.weights(copy)], layer.outputs);
                workspace.kernel.add_product(Matrix::row_major(x, layer.inputs), weights, y);
                if layer.rectified {
                    // Written so that NaN stays NaN.
                    for y in y {
                        *y = if *y < 0.0 { 0.0 } else { *y };
                    }
                }
            }
        }
        let last = self.layers.len() - 1;
        &workspace.activations[last][..self.shape.heads * rows * self.shape.outputs]
    }

    /// Writes ∂L/∂(parameters) into `gradient`, given `output_gradient` = ∂L/∂(outputs), K × B × A, of the `inputs` that
    /// [`Self::forward`] last saw with this workspace and these parameters. The core's part is divided by K (Eq. 11).
    ///
    /// # Panics
    /// If a length does not fit the network or the last forward pass.
    pub fn backward(&self, inputs: &[f32], output_gradient: &[f32], workspace: &mut Workspace, gradient: &mut [f32]) {
        let rows = self.rows(inputs, workspace);
        assert_eq!(gradient.len(), self.parameters.len(), "one gradient value for each parameter");
        assert_eq!(output_gradient.len(), self.shape.heads * rows * self.shape.outputs, "K × B × A output gradients");
        gradient.fill(0.0);
        let core = self.shape.core.len();
        let core_width = self.layers[core].inputs;
        workspace.core_delta[..rows * core_width].fill(0.0);
        for (head, output_gradient) in output_gradient.chunks_exact(rows * self.shape.outputs).enumerate() {
            workspace.delta[..output_gradient.len()].copy_from_slice(output_gradient);
            for index in (core..self.layers.len()).rev() {
                self.backward_layer((index, head), inputs, rows, workspace, gradient);
            }
            if core == 0 {
                continue;
            }
            let shared = workspace.core_delta[..rows * core_width].iter_mut();
            shared.zip(&workspace.delta).for_each(|(sum, delta)| *sum += delta);
        }
        let scale = 1.0 / self.shape.heads as f32;
        let shared = workspace.delta.iter_mut().zip(&workspace.core_delta);
        shared.take(rows * core_width).for_each(|(delta, sum)| *delta = scale * sum);
        for index in (0..core).rev() {
            self.backward_layer((index, 0), inputs, rows, workspace, gradient);
        }
    }

    /// Takes ∂L/∂y of a layer in `workspace.delta`, adds to the gradient of its parameters and leaves ∂L/∂(output of the
    /// layer before), with the rectifier of that layer undone, in `workspace.delta`.
    fn backward_layer(
        &self,
        (index, copy): (usize, usize),
        inputs: &[f32],
        rows: usize,
        workspace: &mut Workspace,
        gradient: &mut [f32],
    ) {
        let layer = &self.layers[index];
        let x = self.layer_input(index, copy, rows, inputs, &workspace.activations);
        let delta = &workspace.delta[..rows * layer.outputs];
        let delta_matrix = Matrix::row_major(delta, layer.outputs);
        let x_matrix = Matrix::row_major(x, layer.inputs).transposed();
        workspace.kernel.add_product(x_matrix, delta_matrix, &mut gradient[layer.weights(copy)]);
        let bias_gradient = &mut gradient[layer.biases(copy)];
        for row in delta.chunks_exact(layer.outputs) {
            bias_gradient.iter_mut().zip(row).for_each(|(sum, delta)| *sum += delta);
        }
        if index == 0 {
            return;
        }
        let next = &mut workspace.next_delta[..rows * layer.inputs];
        next.fill(0.0);
        let weights = Matrix::row_major(&self.parameters[layer.weights(copy)], layer.outputs).transposed();
        workspace.kernel.add_product(delta_matrix, weights, next);
        next.iter_mut().zip(x).for_each(|(delta, x)| *delta = if *x > 0.0 { *delta } else { 0.0 });
        std::mem::swap(&mut workspace.delta, &mut workspace.next_delta);
    }

    /// What a copy of a layer reads, rows × layer inputs: the network's input, the shared core or its own head's last layer.
    fn layer_input<'a>(
        &self,
        index: usize,
        copy: usize,
        rows: usize,
        inputs: &'a [f32],
        activations: &'a [Vec<f32>],
    ) -> &'a [f32] {
        if index == 0 {
            return inputs;
        }
        let before = &self.layers[index - 1];
        let copy = if before.copies == 1 { 0 } else { copy };
        let size = rows * before.outputs;
        &activations[index - 1][copy * size..(copy + 1) * size]
    }

    fn rows(&self, inputs: &[f32], workspace: &Workspace) -> usize {
        let rows = inputs.len() / self.shape.inputs;
        assert_eq!(rows * self.shape.inputs, inputs.len(), "whole rows of {} inputs", self.shape.inputs);
        assert!((1..=workspace.capacity).contains(&rows), "{rows} rows in a workspace for {}", workspace.capacity);
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::{Ensemble, Workspace};
    use crate::random::Stream;
    use crate::shape::NetShape;

    fn shape(core: &[usize], head: &[usize], heads: usize) -> NetShape {
        NetShape { inputs: 5, core: core.to_vec(), head: head.to_vec(), outputs: 3, heads }
    }

    fn random(stream: &mut Stream, n: usize) -> Vec<f32> {
        (0..n).map(|_| stream.range(-1.0, 1.0) as f32).collect()
    }

    /// A smooth loss of the outputs, L = Σ c q + q²/2, in f64.
    fn loss(network: &Ensemble, x: &[f32], c: &[f32], workspace: &mut Workspace) -> f64 {
        let q = network.forward(x, workspace);
        q.iter().zip(c).map(|(q, c)| f64::from(*q) * f64::from(*c) + 0.5 * f64::from(*q) * f64::from(*q)).sum()
    }

    fn check_gradient(shape: NetShape, seed: u64) {
        let mut stream = Stream::new(seed, "gradient");
        let (rows, heads, core_layers) = (4, shape.heads, shape.core.len());
        let core_end = if core_layers == 0 { 0 } else { shape.tensors()[2 * core_layers - 1].range.end };
        let mut network = Ensemble::new(shape, &mut stream).unwrap();
        for parameter in network.parameters_mut() {
            *parameter += 0.05 * stream.normal() as f32;
        }
        let mut workspace = Workspace::new(&network, rows);
        let x = random(&mut stream, rows * 5);
        let c = random(&mut stream, heads * rows * 3);
        let q = network.forward(&x, &mut workspace).to_vec();
        let output_gradient: Vec<f32> = q.iter().zip(&c).map(|(q, c)| q + c).collect();
        let mut gradient = vec![0.0; network.parameters().len()];
        network.backward(&x, &output_gradient, &mut workspace, &mut gradient);
        // A step of 2⁻¹⁰ keeps rounding of the f32 sums (about 1e-6 of the loss) near 1e-3 in the quotient; a rectifier that
        // switches inside the step is the rare exception, hence the share of parameters instead of all.
        let step = 1.0 / 1024.0_f32;
        let close = (0..gradient.len()).filter(|&i| {
            let mut at = |shift: f32| {
                let mut moved = network.clone();
                moved.parameters_mut()[i] += shift;
                loss(&moved, &x, &c, &mut workspace)
            };
            let numeric = (at(step) - at(-step)) / (2.0 * f64::from(step));
            let scale = if i < core_end { heads as f64 } else { 1.0 };
            let analytic = scale * f64::from(gradient[i]);
            (numeric - analytic).abs() <= 5e-3 * (1.0 + analytic.abs())
        });
        let share = close.count() as f64 / gradient.len() as f64;
        assert!(share > 0.99, "{share} of the gradient agrees with central differences");
    }

    #[test]
    fn the_gradient_is_that_of_central_differences_with_the_core_divided_by_the_heads() {
        check_gradient(shape(&[12], &[8, 7], 6), 1);
        check_gradient(shape(&[12], &[8, 7], 1), 2);
        check_gradient(shape(&[6, 9], &[], 3), 3);
        check_gradient(shape(&[], &[8], 2), 4);
        check_gradient(shape(&[], &[], 1), 5);
    }

    #[test]
    fn a_row_has_the_same_bits_alone_and_in_a_batch() {
        let shape = NetShape { inputs: 45, core: vec![128], head: vec![64, 64], outputs: 15, heads: 6 };
        let mut stream = Stream::new(1, "rows");
        let network = Ensemble::new(shape, &mut stream).unwrap();
        let x = random(&mut stream, 64 * 45);
        let mut batch = Workspace::new(&network, 64);
        let mut single = Workspace::new(&network, 1);
        let q = network.forward(&x, &mut batch);
        for (row, x) in x.chunks_exact(45).enumerate() {
            let alone = network.forward(x, &mut single);
            for head in 0..6 {
                let start = (head * 64 + row) * 15;
                assert_eq!(&q[start..start + 15], &alone[head * 15..(head + 1) * 15]);
            }
        }
    }

    #[test]
    fn heads_differ_and_a_seed_repeats() {
        let build = |seed| Ensemble::new(shape(&[8], &[4], 2), &mut Stream::new(seed, "init")).unwrap();
        assert_eq!(build(1).parameters(), build(1).parameters());
        assert_ne!(build(1).parameters(), build(2).parameters());
        let network = build(1);
        let mut workspace = Workspace::new(&network, 1);
        let q = network.forward(&[1.0, 0.5, 0.2, 0.1, 0.3], &mut workspace);
        assert_ne!(q[..3], q[3..]);
    }

    #[test]
    fn the_printed_network_has_its_number_of_parameters() {
        // 45·128 + 128 shared, 128·64 + 64 + 64·64 + 64 + 64·15 + 15 in each of 6 heads.
        let shape = NetShape { inputs: 45, core: vec![128], head: vec![64, 64], outputs: 15, heads: 6 };
        assert_eq!(shape.parameter_count(), 5_888 + 6 * 13_391);
        assert_eq!(shape.tensors().last().unwrap().range.end, shape.parameter_count());
    }

    #[test]
    fn zero_widths_and_wrong_lengths_are_refused() {
        assert!(Ensemble::new(shape(&[0], &[4], 2), &mut Stream::new(1, "init")).is_err());
        assert!(Ensemble::new(shape(&[4], &[4], 0), &mut Stream::new(1, "init")).is_err());
        assert!(Ensemble::from_parameters(shape(&[4], &[4], 2), vec![0.0; 3]).is_err());
    }
}
