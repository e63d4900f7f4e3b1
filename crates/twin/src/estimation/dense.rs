//! Symmetric matrices of a size known at run time: nalgebra's, reduced to what the twin needs of them.
//!
//! Loops of nalgebra without `std` run in one thread and in one order, so that the bits are the same on any number of cores.

use nalgebra::{DMatrix, DVectorView, Dyn};

/// A symmetric matrix.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Matrix(DMatrix<f64>);

impl Matrix {
    /// All zero.
    pub(crate) fn zero(size: usize) -> Self {
        Self(DMatrix::zeros(size, size))
    }

    /// Number of rows.
    pub(crate) fn size(&self) -> usize {
        self.0.nrows()
    }

    /// Entry (row, column).
    #[inline]
    pub(crate) fn at(&self, row: usize, column: usize) -> f64 {
        self.0[(row, column)]
    }

    /// Entry (row, column) for writing.
    #[inline]
    pub(crate) fn at_mut(&mut self, row: usize, column: usize) -> &mut f64 {
        &mut self.0[(row, column)]
    }

    /// A row, which is a column as well.
    pub(crate) fn row(&self, row: usize) -> &[f64] {
        let n = self.size();
        &self.0.as_slice()[row * n..(row + 1) * n]
    }

    /// Rows and columns of `index` only.
    pub(crate) fn part(&self, index: &[usize]) -> Self {
        let n = index.len();
        Self(DMatrix::from_fn(n, n, |a, b| self.at(index[a], index[b])))
    }

    /// M x.
    pub(crate) fn times(&self, x: &[f64]) -> Vec<f64> {
        (&self.0 * DVectorView::from_slice(x, x.len())).as_slice().to_vec()
    }

    /// Adds another one of the same size.
    pub(crate) fn add(&mut self, other: &Self) {
        self.0 += &other.0;
    }

    /// Plus numbers on the diagonal.
    #[must_use]
    pub(crate) fn plus_diagonal(mut self, diagonal: &[f64]) -> Self {
        for (i, d) in diagonal.iter().enumerate() {
            *self.at_mut(i, i) += d;
        }
        self
    }

    /// The lower factor L of M = L Lᵀ; `None` if M is not positive definite.
    pub(crate) fn cholesky(&self) -> Option<Cholesky> {
        self.cholesky_above(0.0)
    }

    /// The same; `None` also where a pivot is not above `least` of its diagonal.
    pub(crate) fn cholesky_above(&self, least: f64) -> Option<Cholesky> {
        let factor = nalgebra::Cholesky::new(self.0.clone())?;
        let lower = factor.l_dirty();
        let sound = (0..self.size()).all(|i| lower[(i, i)] * lower[(i, i)] > least * self.at(i, i));
        sound.then_some(Cholesky(factor))
    }
}

/// Lower factor of a positive definite matrix.
#[derive(Debug, Clone)]
pub(crate) struct Cholesky(nalgebra::Cholesky<f64, Dyn>);

impl Cholesky {
    /// M⁻¹ b.
    pub(crate) fn solve(&self, b: &[f64]) -> Vec<f64> {
        self.0.solve(&DVectorView::from_slice(b, b.len())).as_slice().to_vec()
    }

    /// ln det M.
    pub(crate) fn log_determinant(&self) -> f64 {
        self.0.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum()
    }

    /// M⁻¹.
    pub(crate) fn inverse(&self) -> Matrix {
        Matrix(self.0.inverse())
    }
}

/// Scalar product in four chains.
#[inline]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a4, ar) = a.as_chunks::<4>();
    let (b4, br) = b.as_chunks::<4>();
    for (x, y) in a4.iter().zip(b4) {
        for i in 0..4 {
            sums[i] += x[i] * y[i];
        }
    }
    let rest: f64 = ar.iter().zip(br).map(|(x, y)| x * y).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_inverse_and_solution_of_a_hilbert_like_matrix() {
        let n = 7;
        let mut m = Matrix::zero(n);
        for i in 0..n {
            for j in 0..n {
                *m.at_mut(i, j) = 1.0 / (1.0 + i as f64 + j as f64) + if i == j { 0.1 } else { 0.0 };
            }
        }
        let factor = m.cholesky().unwrap();
        let inverse = factor.inverse();
        let b: Vec<f64> = (0..n).map(|i| i as f64 - 2.0).collect();
        let (x, y) = (factor.solve(&b), inverse.times(&b));
        for i in 0..n {
            assert!((x[i] - y[i]).abs() < 1e-10, "{x:?} {y:?}");
            // Rounding of a matrix of condition 20.
            assert!((m.times(&x)[i] - b[i]).abs() < 1e-10);
        }
        *m.at_mut(3, 3) = -1.0;
        assert!(m.cholesky().is_none());
    }
}
