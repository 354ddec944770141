//! Products of small matrices and short vectors, summed in a fixed order.

pub(crate) type Vector<const N: usize> = [f64; N];
/// Row by row.
pub(crate) type Matrix<const N: usize, const M: usize> = [[f64; M]; N];

pub(crate) fn inner<const N: usize>(a: &Vector<N>, b: &Vector<N>) -> f64 {
    let mut sum = 0.0;
    for i in 0..N {
        sum += a[i] * b[i];
    }
    sum
}

/// y + A x.
pub(crate) fn add_product<const N: usize, const M: usize>(
    mut y: Vector<N>,
    a: &Matrix<N, M>,
    x: &Vector<M>,
) -> Vector<N> {
    for i in 0..N {
        for j in 0..M {
            y[i] += a[i][j] * x[j];
        }
    }
    y
}

/// A'x.
pub(crate) fn transpose_product<const N: usize, const M: usize>(a: &Matrix<N, M>, x: &Vector<N>) -> Vector<M> {
    let mut y = [0.0; M];
    for i in 0..N {
        for j in 0..M {
            y[j] += a[i][j] * x[i];
        }
    }
    y
}

/// y + t x.
pub(crate) fn add_scaled<const N: usize>(mut y: Vector<N>, t: f64, x: &Vector<N>) -> Vector<N> {
    for i in 0..N {
        y[i] += t * x[i];
    }
    y
}

/// A B.
pub(crate) fn product<const N: usize, const L: usize, const M: usize>(
    a: &Matrix<N, L>,
    b: &Matrix<L, M>,
) -> Matrix<N, M> {
    let mut c = [[0.0; M]; N];
    for i in 0..N {
        for l in 0..L {
            for j in 0..M {
                c[i][j] += a[i][l] * b[l][j];
            }
        }
    }
    c
}

/// Inner product of slices of one length, in four interleaved sums so that they do not wait for each other.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let tail: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a4.zip(b4) {
        for i in 0..4 {
            sums[i] += x[i] * y[i];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + tail
}

/// Whether two slices hold the same bits.
pub(crate) fn same_bits(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).fold(0, |difference, (x, y)| difference | (x.to_bits() ^ y.to_bits())) == 0
}
