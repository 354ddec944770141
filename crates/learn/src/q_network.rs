//! A Q-network: an ensemble, how its outputs are read, and the prior under it.

use std::sync::Arc;

use lanecraft_net::{Ensemble, Workspace};

use crate::prior::Prior;
use crate::{LearnerConfig, Readout};

/// A Q-network. Cloning shares its parts.
#[derive(Clone, Debug)]
pub(crate) struct QNetwork {
    pub(crate) trained: Arc<Ensemble>,
    pub(crate) readout: Readout,
    pub(crate) prior: Option<Arc<Prior>>,
}

/// Memory of its passes.
#[derive(Clone, Debug)]
pub(crate) struct QWorkspace {
    trained: Workspace,
    prior: Option<Workspace>,
    /// One mask for each row, with a bit for each head of the ensemble.
    masks: Vec<u32>,
    output_gradient: Vec<f32>,
}

impl QNetwork {
    /// The Q-network that `config` and `seed` make of a trained ensemble of its shape.
    pub(crate) fn new(config: &LearnerConfig, seed: u64, trained: Ensemble) -> Self {
        let scale = config.prior_scale_used();
        let prior = (scale > 0.0).then(|| Arc::new(Prior::draw(trained.shape(), scale, seed)));
        Self { trained: Arc::new(trained), readout: config.readout(), prior }
    }

    /// Length of an observation.
    pub(crate) fn inputs(&self) -> usize {
        self.trained.shape().inputs
    }

    /// Number of actions.
    pub(crate) fn actions(&self) -> usize {
        self.readout.actions(self.trained.shape())
    }

    /// Number of heads.
    pub(crate) fn heads(&self) -> usize {
        self.readout.heads(self.trained.shape())
    }

    /// Whether a workspace of `self` serves `other`, too.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        self.trained.shape() == other.trained.shape()
            && self.readout == other.readout
            && self.prior.is_some() == other.prior.is_some()
    }

    /// Memory for passes over up to `capacity` rows.
    pub(crate) fn workspace(&self, capacity: usize) -> QWorkspace {
        QWorkspace {
            trained: Workspace::new(&self.trained, capacity),
            prior: self.prior.as_ref().map(|prior| Workspace::new(&prior.network, capacity)),
            masks: Vec::with_capacity(capacity),
            output_gradient: Vec::new(),
        }
    }

    /// Writes each head's estimates of the rows of `inputs` whose mask names it (head 0 in the lowest bit), head after head.
    pub(crate) fn estimates(&self, inputs: &[f32], masks: &[u32], workspace: &mut QWorkspace, to: &mut Vec<f32>) {
        let heads = self.heads();
        let streams =
            |mask: &u32| (1..self.readout.streams()).fold(*mask, |all, stream| all | mask << (stream * heads));
        workspace.masks.clear();
        workspace.masks.extend(masks.iter().map(streams));
        let outputs = self.trained.forward_masked(inputs, &workspace.masks, &mut workspace.trained);
        self.readout.estimates(outputs, self.actions(), to);
        if let (Some(prior), Some(workspace)) = (&self.prior, &mut workspace.prior) {
            prior.add(inputs, masks, workspace, to);
        }
    }

    /// Writes ∂L/∂parameters of the trained ensemble, given ∂L/∂estimates of the last pass with this workspace and these inputs.
    pub(crate) fn backward(&self, inputs: &[f32], slopes: &[f32], workspace: &mut QWorkspace, gradient: &mut [f32]) {
        let outputs = self.readout.pass_back(slopes, self.actions(), &mut workspace.output_gradient);
        self.trained.backward(inputs, outputs, &mut workspace.trained, gradient);
    }
}

impl QWorkspace {
    /// The rows of the batch that `head` saw in the last pass, in the order of its estimates.
    pub(crate) fn rows(&self, head: usize) -> &[usize] {
        self.trained.rows(head)
    }
}
