//! Dueling deep Q-learning (Wang et al., 2016): a stream of layers for the value of a state beside one for the advantages of its
//! actions, `Q(s, a) = V(s) + A(s, a) − 1/|A| Σ_a' A(s, a')` (their Eq. 9), trained with the targets of Double DQN, as they do.
//!
//! The mean runs over all actions, the forbidden ones, too: which are allowed is not part of the network's input, so that Q of an
//! action would otherwise change with the mask beside it. Forbidden actions are masked where they are chosen among, as everywhere.
//!
//! Each stream is a head of the ensemble with hidden layers of its own. The value is the first output of the value stream; its
//! others are read by nothing and never learn. Departure: Wang et al. scale the gradient that enters the shared layers by 1/√2, here it is
//! halved, as for any two heads (Eq. 11). Adam's steps do not depend on such a factor.

/// Adds Q to `to`, rows × A, from the outputs of both streams: those of the value stream, rows × A, then the advantages.
pub(crate) fn combine(outputs: &[f32], actions: usize, to: &mut Vec<f32>) {
    let (values, advantages) = outputs.split_at(outputs.len() / 2);
    for (value, advantages) in values.chunks_exact(actions).zip(advantages.chunks_exact(actions)) {
        let mean = advantages.iter().sum::<f32>() / actions as f32;
        to.extend(advantages.iter().map(|advantage| value[0] + (advantage - mean)));
    }
}

/// Writes ∂L/∂outputs, laid out as the outputs, from ∂L/∂Q, rows × A.
///
/// With g = ∂L/∂Q: ∂L/∂V = Σ g, and ∂L/∂A = g − mean g.
pub(crate) fn pass_back(q_gradient: &[f32], actions: usize, to: &mut Vec<f32>) {
    let size = q_gradient.len();
    to.clear();
    to.resize(2 * size, 0.0);
    let (values, advantages) = to.split_at_mut(size);
    let streams = values.chunks_exact_mut(actions).zip(advantages.chunks_exact_mut(actions));
    for ((value, advantages), gradient) in streams.zip(q_gradient.chunks_exact(actions)) {
        value[0] = gradient.iter().sum();
        let mean = value[0] / actions as f32;
        advantages.iter_mut().zip(gradient).for_each(|(to, g)| *to = g - mean);
    }
}

#[cfg(test)]
mod tests {
    use super::{combine, pass_back};

    /// Two rows of three actions: a value stream, then advantages. The value stream's outputs 1 and 2 mean nothing.
    const OUTPUTS: [f32; 12] = [2.0, 9.0, 9.0, -1.0, 9.0, 9.0, 1.0, 0.0, 5.0, 3.0, 3.0, 0.0];

    fn combined(outputs: &[f32]) -> Vec<f32> {
        let mut q = Vec::new();
        combine(outputs, 3, &mut q);
        q
    }

    #[test]
    fn the_mean_of_q_is_the_value_and_differences_are_those_of_the_advantages() {
        // Means of the advantages: 2 and 2.
        assert_eq!(combined(&OUTPUTS), [1.0, 0.0, 5.0, 0.0, 0.0, -3.0]);
    }

    #[test]
    fn the_gradient_is_that_of_central_differences() {
        // L = Σ w q is linear, so that differences are exact but for rounding.
        let weights = [0.5_f32, -1.0, 2.0, 0.25, 0.0, -3.0];
        let loss = |outputs: &[f32]| combined(outputs).iter().zip(weights).map(|(q, w)| q * w).sum::<f32>();
        let mut gradient = Vec::new();
        pass_back(&weights, 3, &mut gradient);
        for (index, analytic) in gradient.iter().enumerate() {
            let at = |shift: f32| {
                let mut moved = OUTPUTS;
                moved[index] += shift;
                loss(&moved)
            };
            let numeric = at(0.5) - at(-0.5);
            assert!((numeric - analytic).abs() < 1e-5, "output {index}: {numeric} and {analytic}");
        }
    }
}
