//! Quantile regression deep Q-learning (QR-DQN; Dabney, Rowland, Bellemare and Munos, 2018): N numbers `θ_1 … θ_N` for each action,
//! drawn to the quantiles at `τ_i = (i − ½)/N` of its return instead of to its mean. Q is their mean, and decisions go by it.
//!
//! The target of each is every quantile of the best next action of the target network, `y_j = r + γᵏ θ⁻_j(s', argmax_a Q⁻(s', a))`
//! (their Algorithm 1), a among the actions allowed in s'. The loss is theirs (Eq. 10): with u = y_j − θ_i and Huber's loss L,
//! `Σ_i 1/N Σ_j |τ_i − 1(u < 0)| L(u)`, quadratic up to `huber_delta` (their κ).
//!
//! Departures: options of k ticks instead of steps, the mask, and everything that the learners share (Adam's rate, exploration,
//! network). Quantiles may cross; nothing orders them, as there.

use crate::loss::{clip, huber};

/// Writes the mean of the `count` quantiles of each action.
pub(crate) fn means(quantiles: &[f32], count: usize, to: &mut Vec<f32>) {
    to.clear();
    to.extend(quantiles.chunks_exact(count).map(mean));
}

/// The mean of an action's quantiles: its value.
pub(crate) fn mean(quantiles: &[f32]) -> f32 {
    quantiles.iter().sum::<f32>() / quantiles.len() as f32
}

/// The loss of one action's quantiles towards samples of its return; its derivatives go to `gradient`.
pub(crate) fn loss(quantiles: &[f32], targets: &[f32], delta: f32, gradient: &mut [f32]) -> f32 {
    let (count, samples, mut sum) = (quantiles.len() as f32, targets.len() as f32, 0.0);
    for (index, (quantile, slope)) in quantiles.iter().zip(gradient).enumerate() {
        let level = (index as f32 + 0.5) / count;
        *slope = 0.0;
        for target in targets {
            let error = quantile - target;
            // error is −u.
            let weight = if error > 0.0 { 1.0 - level } else { level };
            sum += weight * huber(error, delta);
            *slope += weight * clip(error, delta);
        }
        *slope /= samples;
    }
    sum / samples
}

#[cfg(test)]
mod tests {
    use super::{loss, mean};

    #[test]
    fn the_loss_is_that_worked_out_by_hand() {
        // τ = ¼, ¾; u = y − θ: {1, 3} − 0 = {1, 3}; {1, 3} − 2 = {−1, 1}. Huber with κ = 1: ½, 2½; ½, ½.
        // ¼·(½ + 2½)/2 + (¼·½ + ¾·½)/2 = 0.375 + 0.25.
        let mut gradient = [0.0; 2];
        assert_eq!(loss(&[0.0, 2.0], &[1.0, 3.0], 1.0, &mut gradient), 0.625);
        // −¼·(1 + 1)/2, and (¼·1 − ¾·1)/2.
        assert_eq!(gradient, [-0.25, -0.25]);
        assert_eq!(mean(&[0.0, 2.0]), 1.0);
    }

    #[test]
    fn the_gradient_is_that_of_central_differences() {
        // No error is near 0 or ±κ, where the slope jumps or bends.
        let (quantiles, targets) = ([-0.9, 0.1, 0.4, 1.3], [-2.3, 0.2, 0.75, 3.0]);
        let mut gradient = [0.0; 4];
        loss(&quantiles, &targets, 1.0, &mut gradient);
        let step = 1.0 / 64.0;
        for (index, analytic) in gradient.iter().enumerate() {
            let at = |shift: f32| {
                let mut moved = quantiles;
                moved[index] += shift;
                loss(&moved, &targets, 1.0, &mut [0.0; 4])
            };
            let numeric = (at(step) - at(-step)) / (2.0 * step);
            // The loss is of the order of 1, so rounding leaves 1e-7 · 64 / 2.
            assert!((numeric - analytic).abs() < 2e-5, "quantile {index}: {numeric} and {analytic}");
        }
    }

    #[test]
    fn descent_finds_the_quantiles_of_a_known_distribution() {
        // 100 returns spread evenly over [0, 10): the quantiles at τ are 10 τ. A small κ makes the loss that of quantile regression.
        let targets: Vec<f32> = (0..100_u8).map(|i| 0.1 * f32::from(i) + 0.05).collect();
        let (mut quantiles, mut gradient) = ([5.0_f32; 5], [0.0; 5]);
        for _ in 0..3_000 {
            loss(&quantiles, &targets, 0.05, &mut gradient);
            quantiles.iter_mut().zip(&gradient).for_each(|(quantile, slope)| *quantile -= slope);
        }
        for (index, quantile) in quantiles.iter().enumerate() {
            let expected = 2.0 * index as f32 + 1.0;
            // Half the spacing of the returns, and the round bottom of width κ.
            assert!((quantile - expected).abs() < 0.1, "quantile {index}: {quantile} for {expected}");
        }
    }
}
