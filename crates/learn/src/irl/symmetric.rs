//! Eigenvalues of small symmetric matrices, by Jacobi's rotations (Golub and Van Loan, Matrix Computations, section 8.5).

/// Sweeps at most; convergence is quadratic, so that a handful is enough.
const MAX_SWEEPS: usize = 30;

/// Eigenvalues of the symmetric `a` (n × n row-major), in no order.
pub(super) fn eigenvalues(mut a: Vec<f64>, n: usize) -> Vec<f64> {
    let size: f64 = a.iter().map(|x| x * x).sum();
    for _ in 0..MAX_SWEEPS {
        let off: f64 = (0..n).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| a[i * n + j] * a[i * n + j]).sum();
        if off <= 1e-30 * size {
            break;
        }
        for p in 0..n {
            for q in p + 1..n {
                rotate(&mut a, n, (p, q));
            }
        }
    }
    (0..n).map(|i| a[i * n + i]).collect()
}

/// Turns the plane of the axes p and q so that their off-diagonal element vanishes.
fn rotate(a: &mut [f64], n: usize, (p, q): (usize, usize)) {
    let apq = a[p * n + q];
    if apq == 0.0 {
        return;
    }
    let tau = (a[q * n + q] - a[p * n + p]) / (2.0 * apq);
    let t = tau.signum() / (tau.abs() + (1.0 + tau * tau).sqrt());
    let c = 1.0 / (1.0 + t * t).sqrt();
    let s = t * c;
    for k in 0..n {
        let (x, y) = (a[k * n + p], a[k * n + q]);
        (a[k * n + p], a[k * n + q]) = (c * x - s * y, s * x + c * y);
    }
    for k in 0..n {
        let (x, y) = (a[p * n + k], a[q * n + k]);
        (a[p * n + k], a[q * n + k]) = (c * x - s * y, s * x + c * y);
    }
}

#[cfg(test)]
mod tests {
    use lanecraft_net::random::Stream;

    use super::eigenvalues;

    #[test]
    fn a_matrix_with_known_eigenvalues_gives_them() {
        // 2 on the diagonal, −1 beside it: 2 − 2 cos(kπ/(n+1)).
        let n = 9;
        let element = |i: usize, j: usize| {
            if i == j {
                2.0
            } else if i.abs_diff(j) == 1 {
                -1.0
            } else {
                0.0
            }
        };
        let a = (0..n * n).map(|k| element(k / n, k % n)).collect();
        let mut found = eigenvalues(a, n);
        found.sort_by(f64::total_cmp);
        for (k, value) in found.iter().enumerate() {
            let angle = (k as f64 + 1.0) * core::f64::consts::PI / (n as f64 + 1.0);
            assert!((value - (2.0 - 2.0 * libm::cos(angle))).abs() < 1e-12);
        }
    }

    #[test]
    fn trace_and_norm_are_kept() {
        let mut stream = Stream::new(1, "symmetric");
        let n = 6;
        let mut a = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                a[i * n + j] = stream.normal();
                a[j * n + i] = a[i * n + j];
            }
        }
        let trace: f64 = (0..n).map(|i| a[i * n + i]).sum();
        let squares: f64 = a.iter().map(|x| x * x).sum();
        let found = eigenvalues(a, n);
        assert!((found.iter().sum::<f64>() - trace).abs() < 1e-12);
        assert!((found.iter().map(|x| x * x).sum::<f64>() - squares).abs() < 1e-11);
    }
}
