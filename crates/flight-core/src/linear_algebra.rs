//! Small fixed-size linear algebra for construction time.
//!
//! Works in `f64` and is rounded once by the caller; nothing here runs in a control step. No allocation, no pivoting
//! beyond what four rows need.

use crate::MAX_ROTORS;

/// Rows of the reduced control effectiveness: Fz, Mx, My, Mz.
pub(crate) const WRENCH_AXES: usize = 4;

/// A row counts as dependent when the squared sine of its angle to the span of the rows before it is below this:
/// positions are given as `f32`, whose rounding alone makes about 1e-14; a real layout has 1e-2 or more.
const DEPENDENCE_LIMIT: f64 = 1e-6;

/// Pseudo-inverse F⁺ = Fᵀ(FFᵀ)⁻¹ of a 4 × `count` matrix of full row rank, stored like F (entry `[axis][column]` of the
/// result is row `column`, column `axis` of F⁺).
///
/// Rows are scaled to unit length first, so that metres, newton-metres and the small yaw row weigh alike. Fails with
/// the index of the first row that depends on the rows before it.
pub(crate) fn pseudo_inverse(
    rows: &[[f64; MAX_ROTORS]; WRENCH_AXES],
    count: usize,
) -> Result<[[f64; MAX_ROTORS]; WRENCH_AXES], usize> {
    let mut unit = *rows;
    let mut norm = [0.0; WRENCH_AXES];
    for r in 0..WRENCH_AXES {
        norm[r] = libm::sqrt(dot(&rows[r], &rows[r], count));
        // Written so that NaN fails, too.
        if !(norm[r] > 0.0 && norm[r].is_finite()) {
            return Err(r);
        }
        for k in 0..count {
            unit[r][k] /= norm[r];
        }
    }

    // Cholesky factor L of the Gram matrix G = A Aᵀ of the unit rows A; its diagonal squared is the sine of
    // DEPENDENCE_LIMIT.
    let mut l = [[0.0; WRENCH_AXES]; WRENCH_AXES];
    for j in 0..WRENCH_AXES {
        for i in j..WRENCH_AXES {
            let mut rest = dot(&unit[i], &unit[j], count);
            for k in 0..j {
                rest -= l[i][k] * l[j][k];
            }
            if i == j {
                if rest < DEPENDENCE_LIMIT {
                    return Err(j);
                }
                l[j][j] = libm::sqrt(rest);
            } else {
                l[i][j] = rest / l[j][j];
            }
        }
    }

    // Column by column: solve L Lᵀ x = a_k, then F⁺ = Aᵀ G⁻¹ diag(1/norm).
    let mut inverse = [[0.0; MAX_ROTORS]; WRENCH_AXES];
    for k in 0..count {
        let mut x = [0.0; WRENCH_AXES];
        for i in 0..WRENCH_AXES {
            x[i] = unit[i][k];
            for j in 0..i {
                x[i] -= l[i][j] * x[j];
            }
            x[i] /= l[i][i];
        }
        for i in (0..WRENCH_AXES).rev() {
            for j in i + 1..WRENCH_AXES {
                x[i] -= l[j][i] * x[j];
            }
            x[i] /= l[i][i];
        }
        for r in 0..WRENCH_AXES {
            inverse[r][k] = x[r] / norm[r];
        }
    }
    Ok(inverse)
}

fn dot(a: &[f64; MAX_ROTORS], b: &[f64; MAX_ROTORS], count: usize) -> f64 {
    let mut sum = 0.0;
    for k in 0..count {
        sum += a[k] * b[k];
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn prop_pseudo_inverse_is_a_right_inverse_in_the_row_space(
            entries in proptest::collection::vec(-1.0f64..1.0, 4 * 8),
        ) {
            let mut rows = [[0.0; MAX_ROTORS]; WRENCH_AXES];
            for (index, entry) in entries.iter().enumerate() {
                rows[index / 8][index % 8] = *entry;
            }
            if let Ok(inverse) = pseudo_inverse(&rows, 8) {
                for r in 0..WRENCH_AXES {
                    for c in 0..WRENCH_AXES {
                        let product = dot(&rows[r], &inverse[c], 8);
                        // The dependence limit allows condition numbers up to 1e3, squared by the Gram matrix: 1e6 ·
                        // 1e-16.
                        prop_assert!((product - f64::from(u8::from(r == c))).abs() < 1e-9);
                    }
                }
            }
        }
    }

    #[test]
    fn val_dependent_row_is_named() {
        let mut rows = [[0.0; MAX_ROTORS]; WRENCH_AXES];
        rows[0][..4].copy_from_slice(&[-1.0, -1.0, -1.0, -1.0]);
        rows[1][..4].copy_from_slice(&[1.0, -1.0, 0.0, 0.0]);
        rows[2][..4].copy_from_slice(&[0.0, 0.0, 1.0, -1.0]);
        rows[3][..4].copy_from_slice(&[0.5, 0.5, 0.5, 0.5]);
        assert_eq!(pseudo_inverse(&rows, 4), Err(3));
        rows[1] = [0.0; MAX_ROTORS];
        assert_eq!(pseudo_inverse(&rows, 4), Err(1));
    }
}
