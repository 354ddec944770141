//! Products of small matrices and short vectors, summed in a fixed order.

// As in the recursion that they serve: the compiler alone inlines them in one program and not in another.
#![allow(clippy::inline_always)]

pub(crate) type Vector<const N: usize> = [f64; N];
/// Row by row.
pub(crate) type Matrix<const N: usize, const M: usize> = [[f64; M]; N];

#[inline(always)]
pub(crate) fn inner<const N: usize>(a: &Vector<N>, b: &Vector<N>) -> f64 {
    // Adding to -0 changes nothing, so that the first additions vanish.
    let mut sums = [-0.0; 2];
    for i in 0..N {
        sums[i % 2] += a[i] * b[i];
    }
    sums[0] + sums[1]
}

/// y + A x.
#[inline(always)]
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
#[inline(always)]
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
#[inline(always)]
pub(crate) fn add_scaled<const N: usize>(mut y: Vector<N>, t: f64, x: &Vector<N>) -> Vector<N> {
    for i in 0..N {
        y[i] += t * x[i];
    }
    y
}

/// A B.
#[inline(always)]
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

/// Numbers in a block of the longer vectors, which are padded with zeros to whole blocks.
pub(crate) const LANES: usize = 8;
pub(crate) type Block = [f64; LANES];

/// Inner product over the common blocks, in interleaved sums so that they do not wait for each other.
pub(crate) fn dot(a: &[Block], b: &[Block]) -> f64 {
    let mut sums = [0.0; LANES];
    for (x, y) in a.iter().zip(b) {
        for i in 0..LANES {
            sums[i] += x[i] * y[i];
        }
    }
    ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7]))
}

/// y + t x over the blocks of x, in place.
pub(crate) fn add_scaled_blocks(y: &mut [Block], t: f64, x: &[Block]) {
    for (y, x) in y.iter_mut().zip(x) {
        for i in 0..LANES {
            y[i] += t * x[i];
        }
    }
}

/// The larger number; `b` if one is not a number. One instruction, which `f64::max` is not.
pub(crate) fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The smaller number; `b` if one is not a number.
pub(crate) fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}
