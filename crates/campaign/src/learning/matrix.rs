//! Matrix products for small dense networks, summed in a fixed order.
//!
//! Columns are padded to a multiple of [`LANES`], so that the inner loop has no remainder; padding holds zeros and stays zero. Every
//! element is Σ_p a(i,p) b(p,j) with increasing p, whatever the tiling: the result does not depend on the shape of the rest.

/// Columns computed at a time.
pub const LANES: usize = 4;

/// Rows computed at a time.
const ROWS: usize = 4;

/// `columns` rounded up to whole lanes.
pub const fn padded(columns: usize) -> usize {
    columns.div_ceil(LANES) * LANES
}

/// A matrix with padded columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix {
    rows: usize,
    columns: usize,
    stride: usize,
    values: Vec<f64>,
}

impl Matrix {
    /// All zeros.
    pub fn new(rows: usize, columns: usize) -> Self {
        let stride = padded(columns);
        Self {
            rows,
            columns,
            stride,
            values: vec![0.0; rows * stride],
        }
    }

    /// Element (i, j) is `value(i, j)`.
    pub fn from_fn(rows: usize, columns: usize, mut value: impl FnMut(usize, usize) -> f64) -> Self {
        let mut matrix = Self::new(rows, columns);
        for i in 0..rows {
            for (j, slot) in matrix.row_mut(i).iter_mut().enumerate() {
                *slot = value(i, j);
            }
        }
        matrix
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns without padding.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Row `i` without padding.
    #[inline]
    pub fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.stride..][..self.columns]
    }

    /// Row `i` without padding.
    #[inline]
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.values[i * self.stride..][..self.columns]
    }

    /// All elements with padding, for element-wise work that keeps zeros at zero.
    #[inline]
    pub fn padded_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// All elements with padding.
    #[inline]
    pub fn padded(&self) -> &[f64] {
        &self.values
    }

    /// Sets this to `other`ᵀ.
    pub fn transpose_of(&mut self, other: &Self) {
        debug_assert_eq!((self.rows, self.columns), (other.columns, other.rows));
        for i in 0..other.rows {
            for (j, value) in other.row(i).iter().enumerate() {
                self.values[j * self.stride + i] = *value;
            }
        }
    }
}

/// Layout of the left factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Left {
    /// a(i, p) is row i, column p.
    AsIs,
    /// a(i, p) is row p, column i.
    Transposed,
}

/// c = a b + c over the first `rows` rows of c and the first `inner` of the sum.
pub fn multiply_add(
    rows: usize,
    inner: usize,
    a: &Matrix,
    left: Left,
    b: &Matrix,
    c: &mut Matrix,
    pack: &mut Vec<f64>,
) {
    let (row_step, inner_step) = match left {
        Left::AsIs => (a.stride, 1),
        Left::Transposed => (1, a.stride),
    };
    let stride = b.stride;
    debug_assert_eq!(stride, c.stride);
    pack.clear();
    pack.resize(inner * ROWS, 0.0);
    let mut first = 0;
    while first < rows {
        let height = ROWS.min(rows - first);
        // Interleave the rows of this strip; missing rows of the last strip are zero.
        for (p, slots) in pack.chunks_exact_mut(ROWS).enumerate() {
            for (i, slot) in slots.iter_mut().enumerate() {
                *slot = if i < height {
                    a.values[(first + i) * row_step + p * inner_step]
                } else {
                    0.0
                };
            }
        }
        for column in (0..stride).step_by(LANES) {
            let mut sum = [[0.0; LANES]; ROWS];
            for i in 0..height {
                sum[i].copy_from_slice(&c.values[(first + i) * stride + column..][..LANES]);
            }
            for (a, b) in pack.chunks_exact(ROWS).zip(b.values.chunks_exact(stride)) {
                let b: &[f64; LANES] = b[column..].first_chunk().expect("whole lanes");
                let a: &[f64; ROWS] = a.first_chunk().expect("whole strips");
                for i in 0..ROWS {
                    for j in 0..LANES {
                        sum[i][j] += a[i] * b[j];
                    }
                }
            }
            for i in 0..height {
                c.values[(first + i) * stride + column..][..LANES].copy_from_slice(&sum[i]);
            }
        }
        first += height;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn prop_product_is_the_plain_sum_to_the_last_bit(
            rows in 1usize..20, inner in 1usize..20, columns in 1usize..20, seed in any::<u64>(), transposed in any::<bool>(),
        ) {
            let mut random = rotortwin_plant::random::RandomStream::new(seed, "matrix");
            let mut draw = |_: usize, _: usize| random.symmetric();
            let left = if transposed { Left::Transposed } else { Left::AsIs };
            let a = if transposed { Matrix::from_fn(inner, rows, &mut draw) } else { Matrix::from_fn(rows, inner, &mut draw) };
            let b = Matrix::from_fn(inner, columns, &mut draw);
            let start = Matrix::from_fn(rows, columns, &mut draw);
            let mut c = start.clone();
            multiply_add(rows, inner, &a, left, &b, &mut c, &mut Vec::new());
            for i in 0..rows {
                for j in 0..columns {
                    let mut sum = start.row(i)[j];
                    for p in 0..inner {
                        sum += (if transposed { a.row(p)[i] } else { a.row(i)[p] }) * b.row(p)[j];
                    }
                    prop_assert_eq!(c.row(i)[j].to_bits(), sum.to_bits());
                }
                prop_assert!(c.padded()[i * padded(columns) + columns..(i + 1) * padded(columns)].iter().all(|x| *x == 0.0));
            }
        }
    }
}
