//! An ensemble of network heads on a shared core (Osband et al., 2016): forward and backward pass side by side.
//!
//! Forward, layer by layer: y = max(0, W x + b), without the maximum in the last layer of each head. Backward, from
//! δ = ∂L/∂y of the last layer: ∂L/∂W = Σ x δ and ∂L/∂b = Σ δ over the batch, ∂L/∂x = Wᵀ δ where x > 0.
//! Eq. 11 divides the gradients of the heads by K, which matters in the shared core only: under Adam a constant factor on a
//! head's own gradient cancels. So the core's gradient is the sum over the heads divided by K, and heads keep their own.
//!
//! A head need not see the whole batch: the bootstrap mask of Eq. 9 leaves half of it to each head, and what a head does not
//! learn from it does not evaluate either.

use std::ops::Range;

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
    /// Rows in the batch of the last forward pass.
    batch: usize,
    /// The rows of the batch that each head sees, head after head.
    rows: Vec<usize>,
    /// Where the rows of each head begin, and where the last ones end.
    starts: Vec<usize>,
    /// Outputs of each layer: batch × outputs in the core, rows of all heads × outputs in the heads.
    activations: Vec<Vec<f32>>,
    /// What the heads' first layer reads, rows of all heads × inputs.
    gathered: Vec<f32>,
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
        let (layers, shape) = (&network.layers, &network.shape);
        let widest = layers.iter().map(|layer| layer.inputs.max(layer.outputs)).max().unwrap_or(1);
        let all = shape.heads * capacity;
        Self {
            capacity,
            batch: 0,
            rows: Vec::with_capacity(all),
            starts: Vec::with_capacity(shape.heads + 1),
            activations: layers.iter().map(|layer| vec![0.0; layer.copies * capacity * layer.outputs]).collect(),
            gathered: vec![0.0; all * layers[shape.core.len()].inputs],
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

    /// The rows of the batch that `head` saw in the last forward pass, in the order of its outputs.
    pub fn rows(&self, head: usize) -> &[usize] {
        &self.rows[self.starts[head]..self.starts[head + 1]]
    }

    /// Lists the rows of each head: those of which `sees(head, row)` holds.
    fn select(&mut self, heads: usize, batch: usize, sees: impl Fn(usize, usize) -> bool) {
        self.batch = batch;
        self.rows.clear();
        self.starts.clear();
        for head in 0..heads {
            self.starts.push(self.rows.len());
            self.rows.extend((0..batch).filter(|row| sees(head, *row)));
        }
        self.starts.push(self.rows.len());
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
        let batch = self.batch(inputs, workspace);
        workspace.select(self.shape.heads, batch, |_, _| true);
        self.run(inputs, workspace)
    }

    /// Outputs of each head for those rows alone whose mask has the head's bit set (head 0 in the lowest): the rows of head 0
    /// as listed by [`Workspace::rows`], × A, then those of head 1, and so on.
    ///
    /// # Panics
    /// As [`Self::forward`], or if there is not one mask for each row.
    pub fn forward_masked<'w>(&self, inputs: &[f32], masks: &[u32], workspace: &'w mut Workspace) -> &'w [f32] {
        let batch = self.batch(inputs, workspace);
        assert_eq!(masks.len(), batch, "one mask for each row");
        workspace.select(self.shape.heads, batch, |head, row| masks[row] >> head & 1 == 1);
        self.run(inputs, workspace)
    }

    fn run<'w>(&self, inputs: &[f32], workspace: &'w mut Workspace) -> &'w [f32] {
        let core = self.shape.core.len();
        for index in 0..core {
            self.forward_layer(index, 0, inputs, workspace);
        }
        let width = self.layers[core].inputs;
        let shared = if core == 0 { inputs } else { &workspace.activations[core - 1] };
        for (to, row) in workspace.gathered.chunks_exact_mut(width).zip(&workspace.rows) {
            to.copy_from_slice(&shared[row * width..(row + 1) * width]);
        }
        for index in core..self.layers.len() {
            for head in 0..self.shape.heads {
                self.forward_layer(index, head, inputs, workspace);
            }
        }
        &workspace.activations[self.layers.len() - 1][..workspace.rows.len() * self.shape.outputs]
    }

    fn forward_layer(&self, index: usize, copy: usize, inputs: &[f32], workspace: &mut Workspace) {
        let (layer, span) = (&self.layers[index], self.span(index, copy, workspace));
        let (before, after) = workspace.activations.split_at_mut(index);
        let x = &self.source(index, inputs, &workspace.gathered, before)[scaled(&span, layer.inputs)];
        let y = &mut after[0][scaled(&span, layer.outputs)];
        let biases = &self.parameters[layer.biases(copy)];
        for row in y.chunks_exact_mut(layer.outputs) {
            row.copy_from_slice(biases);
        }
        workspace.kernel.add_product(Matrix::new(x, span.len(), layer.inputs), self.weights(layer, copy), y);
        if layer.rectified {
            // Written so that NaN stays NaN.
            for y in y {
                *y = if *y < 0.0 { 0.0 } else { *y };
            }
        }
    }

    /// Writes ∂L/∂(parameters) into `gradient`, given `output_gradient` = ∂L/∂(outputs), laid out as the outputs of the last
    /// forward pass, which must have been with this workspace, these `inputs` and these parameters. The core's part is
    /// divided by K (Eq. 11).
    ///
    /// # Panics
    /// If a length does not fit the network or the last forward pass.
    pub fn backward(&self, inputs: &[f32], output_gradient: &[f32], workspace: &mut Workspace, gradient: &mut [f32]) {
        assert_eq!(self.batch(inputs, workspace), workspace.batch, "the batch of the last forward pass");
        assert_eq!(gradient.len(), self.parameters.len(), "one gradient value for each parameter");
        assert_eq!(output_gradient.len(), workspace.rows.len() * self.shape.outputs, "one value for each output");
        gradient.fill(0.0);
        let core = self.shape.core.len();
        let size = workspace.batch * self.layers[core].inputs;
        workspace.core_delta[..size].fill(0.0);
        for head in 0..self.shape.heads {
            let span = scaled(&self.span(core, head, workspace), self.shape.outputs);
            workspace.delta[..span.len()].copy_from_slice(&output_gradient[span]);
            for index in (core..self.layers.len()).rev() {
                self.backward_layer(index, head, inputs, workspace, gradient);
            }
            if core > 0 {
                self.add_to_core(head, workspace);
            }
        }
        let scale = 1.0 / self.shape.heads as f32;
        let shared = workspace.delta.iter_mut().zip(&workspace.core_delta[..size]);
        shared.for_each(|(delta, sum)| *delta = scale * sum);
        for index in (0..core).rev() {
            self.backward_layer(index, 0, inputs, workspace, gradient);
        }
    }

    /// Takes ∂L/∂y of a layer in `workspace.delta`, adds to the gradient of its parameters and leaves ∂L/∂(output of the
    /// layer before), with the rectifier of that layer undone, in `workspace.delta`.
    fn backward_layer(
        &self,
        index: usize,
        copy: usize,
        inputs: &[f32],
        workspace: &mut Workspace,
        gradient: &mut [f32],
    ) {
        let (layer, span) = (&self.layers[index], self.span(index, copy, workspace));
        let source = self.source(index, inputs, &workspace.gathered, &workspace.activations);
        let x = &source[scaled(&span, layer.inputs)];
        let delta = Matrix::new(&workspace.delta, span.len(), layer.outputs);
        let turned = Matrix::new(x, span.len(), layer.inputs).transposed();
        workspace.kernel.add_product(turned, delta, &mut gradient[layer.weights(copy)]);
        let bias_gradient = &mut gradient[layer.biases(copy)];
        for row in workspace.delta.chunks_exact(layer.outputs).take(span.len()) {
            bias_gradient.iter_mut().zip(row).for_each(|(sum, delta)| *sum += delta);
        }
        if index == 0 {
            return;
        }
        let next = &mut workspace.next_delta[..x.len()];
        next.fill(0.0);
        workspace.kernel.add_product(delta, self.weights(layer, copy).transposed(), next);
        next.iter_mut().zip(x).for_each(|(delta, x)| *delta = if *x > 0.0 { *delta } else { 0.0 });
        std::mem::swap(&mut workspace.delta, &mut workspace.next_delta);
    }

    /// Adds a head's ∂L/∂(output of the core) in `workspace.delta` to the rows of the batch that it saw.
    fn add_to_core(&self, head: usize, workspace: &mut Workspace) {
        let width = self.layers[self.shape.core.len()].inputs;
        let rows = &workspace.rows[workspace.starts[head]..workspace.starts[head + 1]];
        for (row, delta) in rows.iter().zip(workspace.delta.chunks_exact(width)) {
            let sums = &mut workspace.core_delta[row * width..(row + 1) * width];
            sums.iter_mut().zip(delta).for_each(|(sum, delta)| *sum += delta);
        }
    }

    /// The rows of a layer's inputs and outputs that belong to one copy.
    fn span(&self, index: usize, copy: usize, workspace: &Workspace) -> Range<usize> {
        if index < self.shape.core.len() {
            0..workspace.batch
        } else {
            workspace.starts[copy]..workspace.starts[copy + 1]
        }
    }

    /// What all copies of a layer read: the network's input, the rows gathered for the heads or the layer before.
    fn source<'a>(
        &self,
        index: usize,
        inputs: &'a [f32],
        gathered: &'a [f32],
        activations: &'a [Vec<f32>],
    ) -> &'a [f32] {
        if index == self.shape.core.len() {
            gathered
        } else if index == 0 {
            inputs
        } else {
            &activations[index - 1]
        }
    }

    fn weights(&self, layer: &Layer, copy: usize) -> Matrix<'_> {
        Matrix::new(&self.parameters[layer.weights(copy).start..], layer.inputs, layer.outputs)
    }

    fn batch(&self, inputs: &[f32], workspace: &Workspace) -> usize {
        let rows = inputs.len() / self.shape.inputs;
        assert_eq!(rows * self.shape.inputs, inputs.len(), "whole rows of {} inputs", self.shape.inputs);
        assert!((1..=workspace.capacity).contains(&rows), "{rows} rows in a workspace for {}", workspace.capacity);
        rows
    }
}

/// The values of a span of rows of `width` values.
fn scaled(rows: &Range<usize>, width: usize) -> Range<usize> {
    rows.start * width..rows.end * width
}

#[cfg(test)]
mod tests {
    use super::{Ensemble, Kernel, Workspace};
    use crate::Adam;
    use crate::kernel::archs;
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
    fn a_masked_pass_is_the_full_pass_without_the_rows_not_seen() {
        let shape = NetShape { inputs: 5, core: vec![20], head: vec![17, 9], outputs: 3, heads: 4 };
        let mut stream = Stream::new(8, "masks");
        let network = Ensemble::new(shape, &mut stream).unwrap();
        let x = random(&mut stream, 11 * 5);
        // Head 2 sees nothing, head 3 everything.
        let masks: Vec<u32> = (0..11).map(|_| 0b1000 | stream.below(4) as u32).collect();
        let sees = |head: usize, row: usize| masks[row] >> head & 1 == 1;
        let mut workspace = Workspace::new(&network, 11);
        let mut gradients = [vec![0.0; network.parameters().len()], vec![0.0; network.parameters().len()]];
        let full = network.forward(&x, &mut workspace).to_vec();
        let output_gradient = |index: usize| if sees(index / 33, index / 3 % 11) { full[index] } else { 0.0 };
        let all: Vec<f32> = (0..full.len()).map(output_gradient).collect();
        network.backward(&x, &all, &mut workspace, &mut gradients[0]);
        let masked = network.forward_masked(&x, &masks, &mut workspace).to_vec();
        assert!(workspace.rows(2).is_empty() && workspace.rows(3).len() == 11);
        let seen: Vec<f32> = (0..full.len()).filter(|i| sees(i / 33, i / 3 % 11)).map(|i| full[i]).collect();
        assert_eq!(masked, seen);
        network.backward(&x, &masked, &mut workspace, &mut gradients[1]);
        assert_eq!(gradients[0], gradients[1]);
    }

    #[test]
    fn weights_after_a_thousand_updates_have_the_same_bits_at_every_vector_width() {
        let shape = NetShape { inputs: 5, core: vec![20], head: vec![17, 9], outputs: 3, heads: 4 };
        let after = archs().into_iter().map(|arch| {
            let mut stream = Stream::new(4, "updates");
            let mut network = Ensemble::new(shape.clone(), &mut stream).unwrap();
            let mut workspace = Workspace::new(&network, 8);
            // As deep as the widest layer.
            workspace.kernel = Kernel::with_arch(20, arch);
            let (mut adam, mut gradient) =
                (Adam::new(network.parameters().len()), vec![0.0; network.parameters().len()]);
            for _ in 0..1_000 {
                let x = random(&mut stream, 8 * 5);
                let masks: Vec<u32> = (0..8).map(|_| stream.below(16) as u32).collect();
                // The loss ½ Σ (q − 1)².
                let q = network.forward_masked(&x, &masks, &mut workspace);
                let output_gradient: Vec<f32> = q.iter().map(|q| q - 1.0).collect();
                network.backward(&x, &output_gradient, &mut workspace, &mut gradient);
                adam.step_on(arch, network.parameters_mut(), &gradient, 1e-3);
            }
            network.parameters().iter().map(|weight| weight.to_bits()).collect::<Vec<_>>()
        });
        let after: Vec<_> = after.collect();
        assert!(after.iter().all(|bits| *bits == after[0]), "{:?}", archs());
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
