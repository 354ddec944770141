//! The matrix product C += A·B on which forward and backward passes rest, with run-time choice of the vector width.
//!
//! Same bits everywhere: an element `c_ij` becomes `c_ij + ((a_i0 b_0j + a_i1 b_1j) + …)`, with a rounding after each product and
//! each sum (no fused multiply-add), whatever the width of the vectors, the number of rows or the position in the matrix.
//! Vector lanes hold neighboring columns of C, that is, independent outputs. A tile of rows × vectors of C stays in
//! registers while the depth runs, after Goto and van de Geijn (2008), at the small sizes that need no cache blocking.

// The vector operations must be inlined into the function that `pulp` compiles for the processor's instruction set.
#![allow(clippy::inline_always)]

use pulp::{Arch, Simd, WithSimd, bytemuck};

/// The widest panel of columns: four vectors of sixteen f32.
const MAX_PANEL_COLUMNS: usize = 64;

/// A view of a matrix: element (i, j) is `data[i * row_stride + j * column_stride]`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Matrix<'a> {
    data: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// A row-major matrix at the beginning of `data`; what follows it may be read, but never counts.
    pub(crate) fn new(data: &'a [f32], rows: usize, columns: usize) -> Self {
        debug_assert!(rows * columns <= data.len());
        Self { data, rows, columns, row_stride: columns, column_stride: 1 }
    }

    /// The transpose, without moving anything.
    pub(crate) fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }
}

/// Computes products with the vector width of this processor.
#[derive(Clone, Debug)]
pub(crate) struct Kernel {
    arch: Arch,
    /// One panel of B, depth × panel columns, where B cannot be read in place.
    panel: Vec<f32>,
}

impl Kernel {
    /// A kernel for products of a depth of at most `max_depth`; it allocates here and never again.
    pub(crate) fn new(max_depth: usize) -> Self {
        Self::with_arch(max_depth, Arch::new())
    }

    pub(crate) fn with_arch(max_depth: usize, arch: Arch) -> Self {
        Self { arch, panel: vec![0.0; max_depth * MAX_PANEL_COLUMNS] }
    }

    /// C += A·B with `c` row-major and dense.
    pub(crate) fn add_product(&mut self, a: Matrix<'_>, b: Matrix<'_>, c: &mut [f32]) {
        if a.rows == 0 || a.columns == 0 {
            return;
        }
        debug_assert_eq!(a.columns, b.rows);
        debug_assert_eq!(a.rows * b.columns, c.len());
        debug_assert!(a.columns * MAX_PANEL_COLUMNS <= self.panel.len());
        self.arch.dispatch(Product { a, b, c, scratch: &mut self.panel });
    }
}

struct Product<'a> {
    a: Matrix<'a>,
    b: Matrix<'a>,
    c: &'a mut [f32],
    scratch: &'a mut [f32],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // Rows × vectors of the tile: as many sums in flight as the registers of the instruction set hold.
        match S::F32_LANES {
            8 => self.columns::<S, 4, 2>(simd),
            4 | 16 => self.columns::<S, 4, 4>(simd),
            _ => self.columns::<S, 2, 16>(simd),
        }
    }
}

impl Product<'_> {
    #[inline(always)]
    fn columns<S: Simd, const ROWS: usize, const VECTORS: usize>(&mut self, simd: S) {
        let mut first = 0;
        while first < self.b.columns {
            let left = self.b.columns - first;
            if left > S::F32_LANES {
                let width = left.min(VECTORS * S::F32_LANES);
                self.panel::<S, ROWS, VECTORS>(simd, first, width);
                first += width;
            } else {
                self.panel::<S, 8, 1>(simd, first, left);
                first += left;
            }
        }
    }

    /// The columns `first..first + width` of C.
    #[inline(always)]
    fn panel<S: Simd, const ROWS: usize, const VECTORS: usize>(&mut self, simd: S, first: usize, width: usize) {
        let padded = VECTORS * S::F32_LANES;
        // A vector may reach beyond its row of B as long as it stays inside the data: those lanes are dropped.
        let end = (self.b.rows - 1) * self.b.row_stride + first + padded;
        let in_place = self.b.column_stride == 1 && end <= self.b.data.len();
        if !in_place {
            pack(self.b, first, width, &mut self.scratch[..self.b.rows * padded]);
        }
        let (panel, stride) =
            if in_place { (&self.b.data[first..], self.b.row_stride) } else { (&*self.scratch, padded) };
        let target = Target { columns: self.b.columns, first, width };
        let mut row = 0;
        while row + ROWS <= self.a.rows {
            let sums = tile::<S, ROWS, VECTORS>(simd, self.a, row, panel, stride);
            target.add(&sums, row, self.c);
            row += ROWS;
        }
        while row < self.a.rows {
            let sums = tile::<S, 1, VECTORS>(simd, self.a, row, panel, stride);
            target.add(&sums, row, self.c);
            row += 1;
        }
    }
}

/// Copies `width` columns of B from column `first` on into a panel, padded with zeros to the panel's width.
#[inline(always)]
fn pack(b: Matrix<'_>, first: usize, width: usize, panel: &mut [f32]) {
    let padded = panel.len() / b.rows;
    if b.column_stride == 1 {
        for (depth, row) in panel.chunks_exact_mut(padded).enumerate() {
            let start = depth * b.row_stride + first;
            row[..width].copy_from_slice(&b.data[start..start + width]);
            row[width..].fill(0.0);
        }
        return;
    }
    debug_assert_eq!(b.row_stride, 1);
    panel.fill(0.0);
    for column in 0..width {
        let start = (first + column) * b.column_stride;
        let source = &b.data[start..start + b.rows];
        for (row, value) in panel.chunks_exact_mut(padded).zip(source) {
            row[column] = *value;
        }
    }
}

/// `ROWS` rows of A from `row` on times a panel of `VECTORS` vectors, `stride` apart from one depth to the next.
#[inline(always)]
fn tile<S: Simd, const ROWS: usize, const VECTORS: usize>(
    simd: S,
    a: Matrix<'_>,
    row: usize,
    panel: &[f32],
    stride: usize,
) -> [[S::f32s; VECTORS]; ROWS] {
    let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
    let width = VECTORS * S::F32_LANES;
    for depth in 0..a.columns {
        let vectors = S::as_simd_f32s(&panel[depth * stride..depth * stride + width]).0;
        let start = row * a.row_stride + depth * a.column_stride;
        for (r, sums) in sums.iter_mut().enumerate() {
            let factor = simd.splat_f32s(a.data[start + r * a.row_stride]);
            for (sum, vector) in sums.iter_mut().zip(vectors) {
                *sum = simd.add_f32s(*sum, simd.mul_f32s(factor, *vector));
            }
        }
    }
    sums
}

/// Where a tile lands in C.
struct Target {
    columns: usize,
    first: usize,
    width: usize,
}

impl Target {
    #[inline(always)]
    fn add<V: pulp::bytemuck::Pod, const VECTORS: usize>(&self, sums: &[[V; VECTORS]], row: usize, c: &mut [f32]) {
        for (r, sums) in sums.iter().enumerate() {
            let start = (row + r) * self.columns + self.first;
            let sums: &[f32] = bytemuck::cast_slice(sums);
            for (c, sum) in c[start..start + self.width].iter_mut().zip(sums) {
                *c += sum;
            }
        }
    }
}

/// Every vector width that this processor has.
#[cfg(test)]
pub(crate) fn archs() -> Vec<Arch> {
    let mut archs = vec![Arch::Scalar];
    #[cfg(target_arch = "x86_64")]
    {
        archs.extend(pulp::x86::V3::try_new().map(Arch::V3));
        archs.extend(pulp::x86::V4::try_new().map(Arch::V4));
    }
    archs
}

#[cfg(test)]
mod tests {
    use super::{Kernel, Matrix, archs};
    use crate::random::Stream;

    fn random(stream: &mut Stream, n: usize) -> Vec<f32> {
        (0..n).map(|_| stream.range(-1.0, 1.0) as f32).collect()
    }

    /// The law of the module, written down: one sum from zero over the depth in order, added to C.
    fn by_definition(a: &[f32], b: &[f32], c: &mut [f32], depth: usize, columns: usize) {
        for (index, c) in c.iter_mut().enumerate() {
            let (i, j) = (index / columns, index % columns);
            *c += (0..depth).fold(0.0_f32, |sum, l| sum + a[i * depth + l] * b[l * columns + j]);
        }
    }

    fn transpose(x: &[f32], columns: usize) -> Vec<f32> {
        let rows = x.len() / columns;
        (0..x.len()).map(|i| x[(i % rows) * columns + i / rows]).collect()
    }

    #[test]
    fn every_vector_width_gives_the_bits_of_the_definition() {
        let mut stream = Stream::new(1, "kernel");
        for (rows, depth, columns) in [(1, 1, 1), (1, 45, 128), (64, 64, 15), (5, 3, 65), (64, 15, 64), (45, 64, 129)] {
            let (a, b) = (random(&mut stream, rows * depth), random(&mut stream, depth * columns));
            let start = random(&mut stream, rows * columns);
            let mut expected = start.clone();
            by_definition(&a, &b, &mut expected, depth, columns);
            // Whatever follows a matrix in memory must not show.
            let followed = [b.as_slice(), &[f32::NAN; 64]].concat();
            let (a_t, b_t) = (transpose(&a, depth), transpose(&b, columns));
            for arch in archs() {
                let mut kernel = Kernel::with_arch(depth, arch);
                let (plain_a, plain_b) = (Matrix::new(&a, rows, depth), Matrix::new(&b, depth, columns));
                let turned_a = Matrix::new(&a_t, depth, rows).transposed();
                let turned_b = Matrix::new(&b_t, columns, depth).transposed();
                let followed_b = Matrix::new(&followed, depth, columns);
                let pairs = [(plain_a, plain_b), (turned_a, plain_b), (plain_a, turned_b), (plain_a, followed_b)];
                for (a, b) in pairs {
                    let mut c = start.clone();
                    kernel.add_product(a, b, &mut c);
                    assert_eq!(c, expected, "{arch:?} {rows}×{depth}×{columns}");
                }
            }
        }
    }
}
