//! Small dense symmetric matrices: Cholesky factor, solution, inverse, determinant. No library: a hundred unknowns, same bits everywhere.

/// A square matrix, rows first.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Matrix {
    /// Number of rows.
    pub size: usize,
    /// Entries, rows first.
    pub entries: Vec<f64>,
}

impl Matrix {
    /// All zero.
    pub(crate) fn zero(size: usize) -> Self {
        Self {
            size,
            entries: vec![0.0; size * size],
        }
    }

    /// Entry (row, column).
    #[inline]
    pub(crate) fn at(&self, row: usize, column: usize) -> f64 {
        self.entries[row * self.size + column]
    }

    /// Entry (row, column) for writing.
    #[inline]
    pub(crate) fn at_mut(&mut self, row: usize, column: usize) -> &mut f64 {
        &mut self.entries[row * self.size + column]
    }

    /// Rows and columns of `index` only.
    pub(crate) fn part(&self, index: &[usize]) -> Self {
        let mut part = Self::zero(index.len());
        for (a, &i) in index.iter().enumerate() {
            for (b, &j) in index.iter().enumerate() {
                *part.at_mut(a, b) = self.at(i, j);
            }
        }
        part
    }

    /// M x.
    pub(crate) fn times(&self, x: &[f64]) -> Vec<f64> {
        self.entries
            .chunks_exact(self.size.max(1))
            .map(|row| dot(row, x))
            .collect()
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
        let n = self.size;
        let mut l = self.entries.clone();
        for i in 0..n {
            for j in 0..=i {
                let (head, tail) = l.split_at_mut(i * n);
                let own = &tail[..n];
                let sum = if i == j {
                    dot(&own[..j], &own[..j])
                } else {
                    dot(&own[..j], &head[j * n..j * n + j])
                };
                let rest = own[j] - sum;
                if i == j {
                    if rest.is_nan() || rest <= least * own[j] {
                        return None;
                    }
                    tail[j] = rest.sqrt();
                } else {
                    tail[j] = rest / head[j * n + j];
                }
            }
        }
        Some(Cholesky { size: n, l })
    }
}

/// Lower factor of a positive definite matrix.
#[derive(Debug, Clone)]
pub(crate) struct Cholesky {
    size: usize,
    l: Vec<f64>,
}

impl Cholesky {
    /// M⁻¹ b.
    pub(crate) fn solve(&self, b: &[f64]) -> Vec<f64> {
        let n = self.size;
        let mut x = b.to_vec();
        for i in 0..n {
            x[i] = (x[i] - dot(&self.l[i * n..i * n + i], &x[..i])) / self.l[i * n + i];
        }
        for i in (0..n).rev() {
            x[i] /= self.l[i * n + i];
            let value = x[i];
            for (j, x) in x[..i].iter_mut().enumerate() {
                *x -= self.l[i * n + j] * value;
            }
        }
        x
    }

    /// ln det M.
    pub(crate) fn log_determinant(&self) -> f64 {
        (0..self.size).map(|i| 2.0 * self.l[i * self.size + i].ln()).sum()
    }

    /// M⁻¹.
    pub(crate) fn inverse(&self) -> Matrix {
        let n = self.size;
        // L⁻¹ by forward substitution, stored by columns of L⁻¹ = rows here, so that M⁻¹ = L⁻ᵀ L⁻¹ is a sum of rows.
        let mut inverse = vec![0.0; n * n];
        for i in 0..n {
            let per = 1.0 / self.l[i * n + i];
            let (done, rest) = inverse.split_at_mut(i * n);
            let row = &mut rest[..n];
            row[i] = per;
            for j in 0..i {
                let factor = -self.l[i * n + j] * per;
                if factor != 0.0 {
                    for k in 0..=j {
                        row[k] += factor * done[j * n + k];
                    }
                }
            }
        }
        let mut out = Matrix::zero(n);
        for i in 0..n {
            let row = &inverse[i * n..i * n + i + 1];
            for (a, &x) in row.iter().enumerate() {
                if x != 0.0 {
                    for (b, &y) in row[..=a].iter().enumerate() {
                        out.entries[a * n + b] += x * y;
                    }
                }
            }
        }
        for a in 0..n {
            for b in 0..a {
                out.entries[b * n + a] = out.entries[a * n + b];
            }
        }
        out
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
