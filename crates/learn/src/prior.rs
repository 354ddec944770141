//! Randomized prior functions (Osband, Aslanides and Cassirer, 2018): `Q_k = f_k + β p_k` for each head k of a bootstrapped network, where
//! `p_k` is a network drawn once and never trained and β is `prior_scale`.
//!
//! Where there are data, `f_k` learns what the prior leaves wrong; where there are none, the heads stay as different as their
//! priors, so that they disagree about what they have not seen. The prior is part of Q everywhere: acting, targets, vote.
//!
//! `p_k` shares nothing with other heads: it has the layers of the trained network, core and head, for itself. The same
//! seed draws the same prior, so that checkpoints hold none; saved policies hold its weights.

use lanecraft_net::random::Stream;
use lanecraft_net::{Ensemble, NetShape, Workspace};

/// The priors of all heads with their scale.
#[derive(Clone, Debug)]
pub(crate) struct Prior {
    pub(crate) network: Ensemble,
    pub(crate) scale: f64,
}

impl Prior {
    /// The prior that `seed` draws for a trained network of this shape, which must be valid.
    pub(crate) fn draw(trained: &NetShape, scale: f64, seed: u64) -> Self {
        let network = Ensemble::new(Self::shape(trained), &mut Stream::new(seed, "learn.prior"))
            .expect("as valid as the trained network's");
        Self { network, scale }
    }

    /// The shape of the prior of a trained network: as deep and wide, without shared layers.
    pub(crate) fn shape(trained: &NetShape) -> NetShape {
        NetShape { core: Vec::new(), head: [trained.core.as_slice(), &trained.head].concat(), ..trained.clone() }
    }

    /// Adds β p to the estimates of a pass over the same inputs with the same masks.
    pub(crate) fn add(&self, inputs: &[f32], masks: &[u32], workspace: &mut Workspace, estimates: &mut [f32]) {
        let (scale, prior) = (self.scale as f32, self.network.forward_masked(inputs, masks, workspace));
        estimates.iter_mut().zip(prior).for_each(|(estimate, prior)| *estimate += scale * prior);
    }
}
