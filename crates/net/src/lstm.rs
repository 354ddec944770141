//! A long short-term memory (Hochreiter and Schmidhuber, 1997, with the forget gate of Gers et al., 2000) and a linear readout of its
//! last state, forward and backward pass side by side.
//!
//! Forward, for each step: [i f g o] = W x + U h + b; i, f and o through the logistic function, g through tanh; c ← f c + i g;
//! h ← o tanh c. After the last step y = V h + v. Backward through time, from ∂L/∂y: with δc collected from later steps,
//! δc += δh o (1 − tanh² c), then δi = δc g, δf = δc c₋, δg = δc i, δo = δh tanh c, each times the slope of its gate, and
//! δh₋ = Uᵀ δ, δc₋ = δc f. What all steps have in common is one product over steps × rows: ∂L/∂W = Σ x δ, ∂L/∂U = Σ h₋ δ.

// The loops over gates must be inlined into the function that `pulp` compiles for the processor's instruction set.
#![allow(clippy::inline_always)]

use std::ops::Range;

use pulp::Arch;

use crate::activation::{logistic, tanh};
use crate::kernel::{Kernel, Matrix};
use crate::random::Stream;
use crate::shape::{MAX_WIDTH, ShapeError, TensorSlot, check};

/// Input, forget, cell and output gate, in this order.
const GATES: usize = 4;

/// Widths of a network with one recurrent layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LstmShape {
    /// Length of the input vector of a step.
    pub inputs: usize,
    /// Width of the state.
    pub hidden: usize,
    /// Outputs after the last step.
    pub outputs: usize,
}

impl LstmShape {
    /// Checks that every width is at least 1 and none is absurd.
    pub fn validate(&self) -> Result<(), ShapeError> {
        check("number of inputs", self.inputs, MAX_WIDTH)?;
        check("state's width", self.hidden, MAX_WIDTH)?;
        check("number of outputs", self.outputs, MAX_WIDTH)
    }

    /// Length of the parameter vector.
    pub fn parameter_count(&self) -> usize {
        self.parts()[4].end
    }

    /// The tensors of the parameter vector in order. Weights are inputs × outputs; the gates stand in the order input, forget, cell,
    /// output.
    pub fn tensors(&self) -> Vec<TensorSlot> {
        let gates = GATES * self.hidden;
        let shapes = [
            ("input.weight", vec![self.inputs, gates]),
            ("recurrent.weight", vec![self.hidden, gates]),
            ("gates.bias", vec![gates]),
            ("readout.weight", vec![self.hidden, self.outputs]),
            ("readout.bias", vec![self.outputs]),
        ];
        let slots = shapes.into_iter().zip(self.parts());
        slots.map(|((name, shape), range)| TensorSlot { name: name.to_owned(), shape, range }).collect()
    }

    /// Where the tensors lie: W, U, b, V, v.
    fn parts(&self) -> [Range<usize>; 5] {
        let gates = GATES * self.hidden;
        let mut end = 0;
        [self.inputs * gates, self.hidden * gates, gates, self.hidden * self.outputs, self.outputs].map(|size| {
            end += size;
            end - size..end
        })
    }
}

/// A network: its shape and its parameters, one flat vector in the order of [`LstmShape::tensors`].
#[derive(Clone, Debug, PartialEq)]
pub struct Lstm {
    shape: LstmShape,
    parameters: Vec<f32>,
}

/// All that a pass writes besides its result, allocated once for up to so many sequences of up to so many steps.
///
/// What belongs to a step is a block of batch × width, step after step.
#[derive(Clone, Debug)]
pub struct LstmWorkspace {
    capacity: usize,
    max_steps: usize,
    /// Sequences and steps of the last forward pass; none after a backward pass, which uses them up.
    last: Option<(usize, usize)>,
    /// Gates after their activations; the backward pass leaves ∂L/∂(their arguments) here.
    gates: Vec<f32>,
    /// c and h, before the first step (zero) and after each one.
    cells: Vec<f32>,
    states: Vec<f32>,
    /// tanh c after each step.
    bounded_cells: Vec<f32>,
    outputs: Vec<f32>,
    /// ∂L/∂h and ∂L/∂c of one step.
    state_delta: Vec<f32>,
    cell_delta: Vec<f32>,
    /// Uᵀ, laid out for products that read it once for each step.
    turned: Vec<f32>,
    kernel: Kernel,
    arch: Arch,
}

impl LstmWorkspace {
    /// A workspace for networks of `shape`, for up to `capacity` sequences of up to `max_steps` steps.
    pub fn new(shape: &LstmShape, capacity: usize, max_steps: usize) -> Self {
        Self::with_arch(shape, capacity, max_steps, Arch::new())
    }

    fn with_arch(shape: &LstmShape, capacity: usize, max_steps: usize, arch: Arch) -> Self {
        let zeros = |blocks: usize, width: usize| vec![0.0; blocks * capacity * width];
        let (hidden, gates) = (shape.hidden, GATES * shape.hidden);
        Self {
            capacity,
            max_steps,
            last: None,
            gates: zeros(max_steps, gates),
            cells: zeros(max_steps + 1, hidden),
            states: zeros(max_steps + 1, hidden),
            bounded_cells: zeros(max_steps, hidden),
            outputs: zeros(1, shape.outputs),
            state_delta: zeros(1, hidden),
            cell_delta: zeros(1, hidden),
            turned: vec![0.0; hidden * gates],
            kernel: Kernel::with_arch(gates.max(shape.inputs).max(shape.outputs).max(capacity * max_steps), arch),
            arch,
        }
    }

    /// The most sequences that fit.
    pub fn capacity(&self) -> usize {
        self.capacity
    }
}

impl Lstm {
    /// A network whose gates have weights uniform in ±1/√hidden, as is usual, and a bias of 1 in the forget gate, so that it remembers at
    /// first (Gers et al., 2000); the readout is zero, so that an untrained network says nothing.
    pub fn new(shape: LstmShape, stream: &mut Stream) -> Result<Self, ShapeError> {
        shape.validate()?;
        let mut parameters = vec![0.0; shape.parameter_count()];
        let [_, recurrent, bias, ..] = shape.parts();
        let bound = 1.0 / (shape.hidden as f64).sqrt();
        for weight in &mut parameters[..recurrent.end] {
            *weight = stream.range(-bound, bound) as f32;
        }
        parameters[bias][shape.hidden..2 * shape.hidden].fill(1.0);
        Ok(Self { shape, parameters })
    }

    /// A network with given parameters.
    pub fn from_parameters(shape: LstmShape, parameters: Vec<f32>) -> Result<Self, ShapeError> {
        shape.validate()?;
        let (expected, found) = (shape.parameter_count(), parameters.len());
        if expected != found {
            return Err(ShapeError::Parameters { expected, found });
        }
        Ok(Self { shape, parameters })
    }

    /// The shape.
    pub fn shape(&self) -> &LstmShape {
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

    /// Outputs, B × outputs row-major, after `steps` steps of `inputs`, steps × B × inputs.
    ///
    /// # Panics
    /// If `inputs` is no whole number of sequences of so many steps, or there are more or longer ones than the workspace was made for.
    pub fn forward<'w>(&self, inputs: &[f32], steps: usize, workspace: &'w mut LstmWorkspace) -> &'w [f32] {
        let batch = self.batch(inputs, steps, workspace);
        workspace.last = Some((batch, steps));
        let (hidden, outputs) = (self.shape.hidden, self.shape.outputs);
        let (block, gates) = (batch * hidden, GATES * hidden);
        let [input, recurrent, bias, readout, readout_bias] = self.shape.parts().map(|part| &self.parameters[part]);
        let all = &mut workspace.gates[..steps * batch * gates];
        all.chunks_exact_mut(gates).for_each(|row| row.copy_from_slice(bias));
        let x = Matrix::new(inputs, steps * batch, self.shape.inputs);
        workspace.kernel.add_product(x, Matrix::new(input, self.shape.inputs, gates), all);
        for step in 0..steps {
            let here = step * block..(step + 1) * block;
            let z = &mut workspace.gates[scaled(&here, GATES)];
            let (before, h) = workspace.states.split_at_mut(here.end);
            if step > 0 {
                let before = Matrix::new(&before[here.start..], batch, hidden);
                workspace.kernel.add_product(before, Matrix::new(recurrent, hidden, gates), z);
            }
            let (before, c) = workspace.cells.split_at_mut(here.end);
            let (before, bounded) = (&before[here.clone()], &mut workspace.bounded_cells[here]);
            // Inlined into one function for each instruction set.
            workspace.arch.dispatch(
                #[inline(always)]
                || forward_rows(hidden, z, before, (&mut c[..block], bounded, &mut h[..block])),
            );
        }
        let y = &mut workspace.outputs[..batch * outputs];
        y.chunks_exact_mut(outputs).for_each(|row| row.copy_from_slice(readout_bias));
        let h = Matrix::new(&workspace.states[steps * block..], batch, hidden);
        workspace.kernel.add_product(h, Matrix::new(readout, hidden, outputs), y);
        y
    }

    /// Writes ∂L/∂(parameters) into `gradient`, given `output_gradient` = ∂L/∂(outputs) of the last forward pass, which must have been
    /// with this workspace, these `inputs` and these parameters, and which this uses up.
    ///
    /// # Panics
    /// If a length does not fit the network or the last forward pass, or there was none.
    pub fn backward(
        &self,
        inputs: &[f32],
        output_gradient: &[f32],
        workspace: &mut LstmWorkspace,
        gradient: &mut [f32],
    ) {
        let (batch, steps) = workspace.last.take().expect("a forward pass that was not used up");
        assert_eq!(self.batch(inputs, steps, workspace), batch, "the batch of the last forward pass");
        assert_eq!(gradient.len(), self.parameters.len(), "one gradient value for each parameter");
        assert_eq!(output_gradient.len(), batch * self.shape.outputs, "one value for each output");
        gradient.fill(0.0);
        self.readout_backward(output_gradient, (batch, steps), workspace, gradient);
        let hidden = self.shape.hidden;
        let (block, gates) = (batch * hidden, GATES * hidden);
        let [input, recurrent, bias, ..] = self.shape.parts();
        turn(&self.parameters[recurrent.clone()], gates, &mut workspace.turned);
        workspace.cell_delta[..block].fill(0.0);
        for step in (0..steps).rev() {
            let here = step * block..(step + 1) * block;
            let delta = &mut workspace.gates[scaled(&here, GATES)];
            let (before, bounded) = (&workspace.cells[here.clone()], &workspace.bounded_cells[here]);
            let (dh, dc) = (&mut workspace.state_delta[..block], &mut workspace.cell_delta[..block]);
            workspace.arch.dispatch(
                #[inline(always)]
                || backward_rows(hidden, delta, (before, bounded), (dh, dc)),
            );
            if step > 0 {
                dh.fill(0.0);
                let turned = Matrix::new(&workspace.turned, gates, hidden);
                workspace.kernel.add_product(Matrix::new(delta, batch, gates), turned, dh);
            }
        }
        let deltas = &workspace.gates[..steps * batch * gates];
        let x = Matrix::new(inputs, steps * batch, self.shape.inputs).transposed();
        workspace.kernel.add_product(x, Matrix::new(deltas, steps * batch, gates), &mut gradient[input]);
        // The state before the first step is zero.
        let (later, depth) = (&deltas[GATES * block..], (steps - 1) * batch);
        let h = Matrix::new(&workspace.states[block..], depth, hidden).transposed();
        workspace.kernel.add_product(h, Matrix::new(later, depth, gates), &mut gradient[recurrent]);
        add_rows(deltas, &mut gradient[bias]);
    }

    /// The part of V and v, and ∂L/∂h of the last step.
    fn readout_backward(
        &self,
        output_gradient: &[f32],
        (batch, steps): (usize, usize),
        workspace: &mut LstmWorkspace,
        gradient: &mut [f32],
    ) {
        let (hidden, outputs, block) = (self.shape.hidden, self.shape.outputs, batch * self.shape.hidden);
        let [.., readout, readout_bias] = self.shape.parts();
        let delta = Matrix::new(output_gradient, batch, outputs);
        let h = Matrix::new(&workspace.states[steps * block..], batch, hidden).transposed();
        workspace.kernel.add_product(h, delta, &mut gradient[readout.clone()]);
        add_rows(output_gradient, &mut gradient[readout_bias]);
        let dh = &mut workspace.state_delta[..block];
        dh.fill(0.0);
        let v = Matrix::new(&self.parameters[readout], hidden, outputs).transposed();
        workspace.kernel.add_product(delta, v, dh);
    }

    fn batch(&self, inputs: &[f32], steps: usize, workspace: &LstmWorkspace) -> usize {
        let row = steps * self.shape.inputs;
        assert!((1..=workspace.max_steps).contains(&steps), "{steps} steps in a workspace for {}", workspace.max_steps);
        let batch = inputs.len() / row;
        assert_eq!(batch * row, inputs.len(), "whole sequences of {steps} × {} inputs", self.shape.inputs);
        assert!(
            (1..=workspace.capacity).contains(&batch),
            "{batch} sequences in a workspace for {}",
            workspace.capacity
        );
        batch
    }
}

/// Adds the rows of a matrix to `sum`, from the first to the last.
fn add_rows(matrix: &[f32], sum: &mut [f32]) {
    for row in matrix.chunks_exact(sum.len()) {
        sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
    }
}

/// The transpose of a matrix of rows of `columns`.
fn turn(matrix: &[f32], columns: usize, turned: &mut [f32]) {
    let rows = matrix.len() / columns;
    for (row, values) in matrix.chunks_exact(columns).enumerate() {
        for (column, value) in values.iter().enumerate() {
            turned[column * rows + row] = *value;
        }
    }
}

/// The values of a block whose rows are `width` times as wide.
fn scaled(block: &Range<usize>, width: usize) -> Range<usize> {
    width * block.start..width * block.end
}

/// One step, row by row: from the gates' arguments in `z`, which become the gates, and c before the step to c, tanh c and h after it.
#[inline(always)]
fn forward_rows(hidden: usize, z: &mut [f32], before: &[f32], (c, bounded, h): (&mut [f32], &mut [f32], &mut [f32])) {
    for (row, z) in z.chunks_exact_mut(GATES * hidden).enumerate() {
        let span = row * hidden..(row + 1) * hidden;
        let (input, rest) = z.split_at_mut(hidden);
        let (forget, rest) = rest.split_at_mut(hidden);
        let (cell, output) = rest.split_at_mut(hidden);
        let (c, bounded, h) = (&mut c[span.clone()], &mut bounded[span.clone()], &mut h[span.clone()]);
        let before = &before[span];
        for unit in 0..hidden {
            let (i, f, g, o) =
                (logistic(input[unit]), logistic(forget[unit]), tanh(cell[unit]), logistic(output[unit]));
            (input[unit], forget[unit], cell[unit], output[unit]) = (i, f, g, o);
            c[unit] = f * before[unit] + i * g;
            bounded[unit] = tanh(c[unit]);
            h[unit] = o * bounded[unit];
        }
    }
}

/// One step back, row by row: from the gates in `delta` and ∂L/∂h to ∂L/∂(the gates' arguments) in `delta`, with c before the step and
/// tanh c after it; `dc` goes from ∂L/∂c after the step to that before it.
#[inline(always)]
fn backward_rows(
    hidden: usize,
    delta: &mut [f32],
    (before, bounded): (&[f32], &[f32]),
    (dh, dc): (&mut [f32], &mut [f32]),
) {
    for (row, delta) in delta.chunks_exact_mut(GATES * hidden).enumerate() {
        let span = row * hidden..(row + 1) * hidden;
        let (before, bounded) = (&before[span.clone()], &bounded[span.clone()]);
        let (dh, dc) = (&dh[span.clone()], &mut dc[span]);
        let (input, rest) = delta.split_at_mut(hidden);
        let (forget, rest) = rest.split_at_mut(hidden);
        let (cell, output) = rest.split_at_mut(hidden);
        for unit in 0..hidden {
            let (i, f, g, o) = (input[unit], forget[unit], cell[unit], output[unit]);
            let slope = dc[unit] + dh[unit] * o * (1.0 - bounded[unit] * bounded[unit]);
            input[unit] = slope * g * i * (1.0 - i);
            forget[unit] = slope * before[unit] * f * (1.0 - f);
            cell[unit] = slope * i * (1.0 - g * g);
            output[unit] = dh[unit] * bounded[unit] * o * (1.0 - o);
            dc[unit] = slope * f;
        }
    }
}

#[cfg(test)]
mod tests;
