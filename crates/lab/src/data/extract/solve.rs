//! Small least-squares problems.

/// The solution of A x = b for symmetric, positive definite A of N × N, by Cholesky's method; A is loaded by a billionth of its trace, so
/// that a direction that the data do not determine stays near zero.
pub(super) fn solve<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> [f64; N] {
    let load = 1e-9 * (0..N).map(|i| a[i][i]).sum::<f64>() / N as f64 + f64::MIN_POSITIVE;
    for i in 0..N {
        a[i][i] += load;
        for j in 0..=i {
            let sum = a[i][j] - (0..j).map(|k| a[i][k] * a[j][k]).sum::<f64>();
            a[i][j] = if i == j { sum.max(f64::MIN_POSITIVE).sqrt() } else { sum / a[j][j] };
        }
    }
    for i in 0..N {
        b[i] = (b[i] - (0..i).map(|k| a[i][k] * b[k]).sum::<f64>()) / a[i][i];
    }
    for i in (0..N).rev() {
        b[i] = (b[i] - (i + 1..N).map(|k| a[k][i] * b[k]).sum::<f64>()) / a[i][i];
    }
    b
}
