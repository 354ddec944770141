//! The optimizer Adam (Kingma and Ba, 2015, Algorithm 1) in one pass over parameters, moments and gradient.
//!
//! The learning rate is an argument of each step, so that a schedule belongs to the caller. β₁ᵗ and β₂ᵗ come from the step
//! number alone, and 1 − β is formed in f64: in f32, 1 − 0.999 is off by 5·10⁻⁵ of its value.

/// Decay of the first moment (Kingma and Ba, 2015).
const BETA_1: f64 = 0.9;
/// Decay of the second moment.
const BETA_2: f64 = 0.999;
/// Keeps the denominator from zero.
const EPSILON: f32 = 1e-8;
/// Moments below this become zero. They move no weight, but where a unit is silent they would decay into subnormal numbers,
/// with which processors calculate a hundred times more slowly.
const NEGLIGIBLE: f32 = 1e-30;

/// First and second moments of a parameter vector and the number of steps taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    first: Vec<f32>,
    second: Vec<f32>,
    steps: u64,
}

impl Adam {
    /// Zero moments for `count` parameters.
    pub fn new(count: usize) -> Self {
        Self { first: vec![0.0; count], second: vec![0.0; count], steps: 0 }
    }

    /// Moments that were saved by [`Self::first_moment`], [`Self::second_moment`] and [`Self::steps`]; both of one length.
    pub fn from_moments(first: Vec<f32>, second: Vec<f32>, steps: u64) -> Self {
        debug_assert_eq!(first.len(), second.len());
        Self { first, second, steps }
    }

    /// Running mean of the gradient, one value for each parameter.
    pub fn first_moment(&self) -> &[f32] {
        &self.first
    }

    /// Running mean of the squared gradient, one value for each parameter.
    pub fn second_moment(&self) -> &[f32] {
        &self.second
    }

    /// Steps taken.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// One step against `gradient` (as long as `parameters`).
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32], learning_rate: f64) {
        self.step_on(pulp::Arch::new(), parameters, gradient, learning_rate);
    }

    /// A step with the vectors of `arch`.
    pub(crate) fn step_on(&mut self, arch: pulp::Arch, parameters: &mut [f32], gradient: &[f32], learning_rate: f64) {
        debug_assert!(parameters.len() == gradient.len() && parameters.len() == self.first.len());
        self.steps += 1;
        let t = self.steps as f64;
        let step = (learning_rate / (1.0 - libm::pow(BETA_1, t))) as f32;
        let correction = (1.0 / (1.0 - libm::pow(BETA_2, t)).sqrt()) as f32;
        let (keep_1, keep_2) = (BETA_1 as f32, BETA_2 as f32);
        let (take_1, take_2) = ((1.0 - BETA_1) as f32, (1.0 - BETA_2) as f32);
        let (first, second) = (&mut self.first, &mut self.second);
        arch.dispatch(
            #[inline(always)]
            || {
                for (((p, m), v), g) in parameters.iter_mut().zip(first).zip(second).zip(gradient) {
                    *m = without_negligible(keep_1 * *m + take_1 * g);
                    *v = without_negligible(keep_2 * *v + take_2 * g * g);
                    *p -= step * *m / (v.sqrt() * correction + EPSILON);
                }
            },
        );
    }
}

// Must be inlined into the loop that `pulp` compiles for the processor's instruction set.
#[allow(clippy::inline_always)]
#[inline(always)]
fn without_negligible(moment: f32) -> f32 {
    // Written so that NaN stays NaN.
    if moment.abs() < NEGLIGIBLE { 0.0 } else { moment }
}

#[cfg(test)]
mod tests {
    use super::Adam;
    use crate::kernel::archs;
    use crate::random::Stream;

    #[test]
    fn every_vector_width_gives_the_same_bits() {
        let mut stream = Stream::new(1, "adam");
        let mut draw = || (0..101).map(|_| stream.normal() as f32).collect::<Vec<_>>();
        let (start, gradients) = (draw(), [draw(), draw(), draw()]);
        let after = archs().into_iter().map(|arch| {
            let (mut parameters, mut adam) = (start.clone(), Adam::new(101));
            for gradient in &gradients {
                adam.step_on(arch, &mut parameters, gradient, 1e-3);
            }
            (parameters, adam)
        });
        let after: Vec<_> = after.collect();
        assert!(after.iter().all(|other| *other == after[0]));
    }

    #[test]
    fn moments_of_silent_units_reach_zero() {
        let (mut parameters, mut adam) = (vec![1.0_f32], Adam::new(1));
        adam.step(&mut parameters, &[1e-6], 1e-3);
        for _ in 0..50_000 {
            adam.step(&mut parameters, &[0.0], 1e-3);
        }
        assert_eq!((adam.first_moment()[0], adam.second_moment()[0]), (0.0, 0.0));
    }

    #[test]
    fn the_first_step_has_the_size_of_the_learning_rate() {
        // With bias correction the first step is η·g/(|g| + ε), whatever the size of the gradient.
        let mut parameters = vec![1.0_f32, 1.0, 1.0];
        Adam::new(3).step(&mut parameters, &[1e-3, -50.0, 0.0], 0.01);
        for (p, expected) in parameters.iter().zip([0.99, 1.01, 1.0]) {
            assert!((p - expected).abs() < 1e-6, "{p}");
        }
    }

    #[test]
    fn a_quadratic_is_minimized() {
        let mut parameters = vec![3.0_f32, -2.0];
        let mut adam = Adam::new(2);
        for _ in 0..2000 {
            let gradient = [parameters[0] - 1.0, 10.0 * (parameters[1] - 0.5)];
            adam.step(&mut parameters, &gradient, 0.01);
        }
        assert!((parameters[0] - 1.0).abs() < 1e-3 && (parameters[1] - 0.5).abs() < 1e-3);
    }

    #[test]
    fn saved_moments_continue_with_the_same_bits() {
        let mut parameters = vec![0.3_f32; 40];
        let gradient: Vec<f32> = (0..40u8).map(|i| f32::from(i) - 20.0).collect();
        let mut adam = Adam::new(40);
        adam.step(&mut parameters, &gradient, 1e-3);
        let mut resumed = Adam::from_moments(adam.first_moment().to_vec(), adam.second_moment().to_vec(), adam.steps());
        let mut copy = parameters.clone();
        adam.step(&mut parameters, &gradient, 1e-3);
        resumed.step(&mut copy, &gradient, 1e-3);
        assert_eq!(parameters, copy);
        assert_eq!(adam, resumed);
    }
}
