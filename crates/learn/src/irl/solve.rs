//! Ways to the maximum of a concave objective.

use super::objective::{Evaluation, Objective};

/// Share of the predicted gain that a step must bring (Armijo, 1966).
const ARMIJO_SHARE: f64 = 1e-4;
/// Halvings of a step before it counts as lost in rounding.
const MAX_HALVINGS: usize = 50;

/// Where a method stopped.
pub(super) struct Found {
    pub(super) weights: Vec<f64>,
    pub(super) iterations: usize,
}

/// Newton's method from `weights`: solves curvature · step = gradient and halves the step until the objective gains.
pub(super) fn newton(objective: &Objective, mut weights: Vec<f64>, max_iterations: usize, tolerance: f64) -> Found {
    let mut at = objective.evaluate(&weights);
    // One digit below the tolerance of the verdict, which is judged for each event.
    let limit = 0.1 * tolerance;
    for iteration in 0..max_iterations {
        if at.gradient_norm() <= limit {
            return Found { weights, iterations: iteration };
        }
        let step = solve(&at.curvature, &at.gradient);
        match line_search(objective, &weights, &at, &step) {
            Some((next, next_at)) => (weights, at) = (next, next_at),
            None => return Found { weights, iterations: iteration },
        }
    }
    Found { weights, iterations: max_iterations }
}

fn line_search(
    objective: &Objective,
    weights: &[f64],
    at: &Evaluation,
    step: &[f64],
) -> Option<(Vec<f64>, Evaluation)> {
    let slope: f64 = at.gradient.iter().zip(step).map(|(g, s)| g * s).sum();
    let mut size = 1.0;
    for _ in 0..MAX_HALVINGS {
        let next: Vec<f64> = weights.iter().zip(step).map(|(w, s)| w + size * s).collect();
        let next_at = objective.evaluate(&next);
        if next_at.value > at.value && next_at.value >= at.value + ARMIJO_SHARE * size * slope {
            return Some((next, next_at));
        }
        size *= 0.5;
    }
    None
}

/// Algorithm 2: ϖ ← ϖ + ρ ∇Ω with the gradient summed over the events, E times from zero.
pub(super) fn gradient_ascent(objective: &Objective, learning_rate: f64, episodes: usize) -> Found {
    let mut weights = vec![0.0; objective.features()];
    for _ in 0..episodes {
        let gradient = objective.evaluate(&weights).gradient;
        for (w, g) in weights.iter_mut().zip(gradient) {
            *w += learning_rate * g;
        }
    }
    Found { weights, iterations: episodes }
}

/// Solves A x = b for positive semidefinite A (n × n row-major), lifting its diagonal where A is singular.
fn solve(a: &[f64], b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let largest = (0..n).map(|i| a[i * n + i]).fold(0.0, f64::max);
    let mut lift = 0.0;
    loop {
        if let Some(x) = solve_cholesky(a, b, lift) {
            return x;
        }
        lift = if lift == 0.0 { 1e-12 * if largest > 0.0 { largest } else { 1.0 } } else { 10.0 * lift };
        if !lift.is_finite() {
            // Only values that are not finite come here; the caller's gain test then refuses the step.
            return vec![0.0; n];
        }
    }
}

/// Cholesky's factorization of A + lift · I and both substitutions; `None` where a pivot is not clearly positive.
fn solve_cholesky(a: &[f64], b: &[f64], lift: f64) -> Option<Vec<f64>> {
    let n = b.len();
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
            let rest = a[i * n + j] + if i == j { lift } else { 0.0 } - known;
            if i != j {
                l[i * n + j] = rest / l[j * n + j];
            } else if rest > 1e-14 * a[i * n + i].abs() {
                l[i * n + i] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    let mut x = vec![0.0; n];
    for i in 0..n {
        let known: f64 = (0..i).map(|k| l[i * n + k] * x[k]).sum();
        x[i] = (b[i] - known) / l[i * n + i];
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|k| l[k * n + i] * x[k]).sum();
        x[i] = (x[i] - known) / l[i * n + i];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::solve;

    #[test]
    fn a_system_with_a_known_answer_is_solved() {
        // [4 2; 2 3] · [1; −2] = [0; −4].
        let x = solve(&[4.0, 2.0, 2.0, 3.0], &[0.0, -4.0]);
        assert!((x[0] - 1.0).abs() < 1e-12 && (x[1] + 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_singular_system_gives_finite_numbers() {
        assert_eq!(solve(&[0.0; 4], &[0.0; 2]), [0.0; 2]);
        let x = solve(&[1.0, 1.0, 1.0, 1.0], &[2.0, 2.0]);
        assert!((x[0] + x[1] - 2.0).abs() < 1e-3, "{x:?}");
        assert_eq!(solve(&[f64::NAN], &[1.0]), [0.0]);
    }
}
