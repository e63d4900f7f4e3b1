//! Evidence of effects by linear algebra: every parameter of the library is always present as *clutter* (a spike, narrow prior);
//! a candidate is named by giving its own parameters a wide prior (the slab).
//!
//! With whitened residual r, Jacobian J in plausible sizes, H = JᵀJ, g = Jᵀr and the prior θ ~ N(0, P):
//!
//! ln Z = ½ gᵀ(H + P⁻¹)⁻¹g − ½ ln det(I + P H) + const
//!
//! Without the spikes a healthy flight has "missing" effects with a Bayes factor of e⁵⁰⁰: real vehicles are never exactly nominal,
//! and half a sample of delay is enough. All other parameters are integrated out once; a candidate then costs a matrix of its own
//! one to three parameters: with the posterior (m, C) under spikes, H' = C_AA⁻¹ − P_A⁻¹ and g' = C_AA⁻¹ m_A.

use super::dense::{Cholesky, Matrix};
use crate::predict::PredictError;

/// Normal matrix of a linearised problem.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    /// H = JᵀJ.
    pub matrix: Matrix,
    /// g = Jᵀr.
    pub gradient: Vec<f64>,
    /// rᵀr.
    pub square_sum: f64,
    /// Number of samples.
    pub samples: f64,
}

/// Posterior with some parameters at their spikes and the others integrated out.
#[derive(Debug, Clone)]
pub(crate) struct Posterior {
    /// m.
    pub mean: Vec<f64>,
    /// C.
    pub covariance: Matrix,
    /// ln Z up to −½ rᵀr.
    pub log_evidence: f64,
}

impl Normal {
    /// Nothing summed yet.
    pub(crate) fn zero(size: usize) -> Self {
        Self {
            matrix: Matrix::zero(size),
            gradient: vec![0.0; size],
            square_sum: 0.0,
            samples: 0.0,
        }
    }

    /// With priors that pull towards 0, when it was taken about `position`: the pull joins the gradient, its penalty the square sum.
    pub(crate) fn pulled(mut self, position: &[f64], prior: &[f64]) -> Self {
        let mut penalty = 0.0;
        for ((g, x), d) in self.gradient.iter_mut().zip(position).zip(prior) {
            *g -= x / (d * d);
            penalty += (x / d) * (x / d);
        }
        self.square_sum += penalty;
        self
    }
}

/// ln Z up to −½ rᵀr, and its parts.
pub(crate) struct Weighed {
    /// ln Z.
    pub log_evidence: f64,
    /// (H + P⁻¹)⁻¹ g.
    pub mean: Vec<f64>,
    /// H + P⁻¹.
    pub factor: Cholesky,
}

/// Share of a sum of squares that rounding may take from it: products of columns are summed in f32 over 256 rows
/// ([`super::gram`]).
const ROUNDING: f64 = 1e-6;

/// Evidence of a normal matrix under independent normal priors about 0 with these deviations. `None` if there are numbers in it that are
/// not finite.
///
/// If a model is far off, columns are so large compared with the priors that rounding can make H + P⁻¹ indefinite. What
/// rounding hides is then treated as independent noise of each parameter.
pub(crate) fn weigh(matrix: &Matrix, gradient: &[f64], deviations: &[f64]) -> Option<Weighed> {
    let precision: Vec<f64> = deviations.iter().map(|d| 1.0 / (d * d)).collect();
    let sum = matrix.clone().plus_diagonal(&precision);
    let factor = sum.cholesky().or_else(|| {
        let rounding: Vec<f64> = (0..matrix.size()).map(|i| ROUNDING * matrix.at(i, i)).collect();
        sum.plus_diagonal(&rounding).cholesky()
    })?;
    let mean = factor.solve(gradient);
    let fit: f64 = mean.iter().zip(gradient).map(|(m, g)| m * g).sum();
    let log_prior: f64 = deviations.iter().map(|d| d.ln()).sum();
    let log_evidence = 0.5 * fit - 0.5 * factor.log_determinant() - log_prior;
    log_evidence.is_finite().then_some(Weighed {
        log_evidence,
        mean,
        factor,
    })
}

impl Posterior {
    /// Under independent normal priors about 0 with these deviations. `None` if H holds numbers that are not finite.
    pub(crate) fn new(normal: &Normal, deviations: &[f64]) -> Option<Self> {
        let weighed = weigh(&normal.matrix, &normal.gradient, deviations)?;
        Some(Self {
            log_evidence: weighed.log_evidence,
            mean: weighed.mean,
            covariance: weighed.factor.inverse(),
        })
    }

    /// Holds an unknown at a value; the others follow. The evidence stays that of all unknowns free.
    pub(crate) fn hold(&mut self, which: usize, at: f64) {
        let row = self.covariance.row(which).to_vec();
        let variance = row[which];
        if variance.is_nan() || variance <= 0.0 {
            self.mean[which] = at;
            return;
        }
        let shift = (at - self.mean[which]) / variance;
        for (mean, c) in self.mean.iter_mut().zip(&row) {
            *mean += c * shift;
        }
        for (i, a) in row.iter().enumerate() {
            for (j, b) in row.iter().enumerate() {
                *self.covariance.at_mut(i, j) -= a * b / variance;
            }
        }
        self.mean[which] = at;
    }

    /// ln Z alone, without the covariance.
    pub(crate) fn log_evidence_of(normal: &Normal, deviations: &[f64]) -> Option<f64> {
        weigh(&normal.matrix, &normal.gradient, deviations).map(|weighed| weighed.log_evidence)
    }
}

/// Result of opening the prior of some parameters.
#[derive(Debug, Clone)]
pub(crate) struct Opened {
    /// ln of the Bayes factor against the spikes.
    pub log_bayes_factor: f64,
    /// Estimate in plausible sizes.
    pub estimate: Vec<f64>,
    /// Covariance of the estimate.
    pub covariance: Matrix,
    /// Information on the parameters once the others are integrated out.
    pub information: Matrix,
}

/// Opens the parameters `which` from spikes to slabs; `offset` is where they were linearised (0 for candidates).
pub(crate) fn open(
    posterior: &Posterior,
    which: &[usize],
    spikes: &[f64],
    now: &[f64],
    slabs: &[f64],
    offset: &[f64],
) -> Option<Opened> {
    let k = which.len();
    let precision = posterior.covariance.part(which).cholesky()?.inverse();
    let mean: Vec<f64> = which.iter().map(|&i| posterior.mean[i]).collect();
    let mut gradient = precision.times(&mean);
    let now: Vec<f64> = now.iter().map(|d| -1.0 / (d * d)).collect();
    let mut information = precision.plus_diagonal(&now);
    // Rounding of a parameter without information may leave a small negative number.
    for i in 0..k {
        let diagonal = information.at_mut(i, i);
        *diagonal = diagonal.max(0.0);
    }
    // About 0 instead of the point of linearisation.
    for (g, shift) in gradient.iter_mut().zip(information.times(offset)) {
        *g += shift;
    }
    let closed = weigh(&information, &gradient, spikes)?;
    let opened = weigh(&information, &gradient, slabs)?;
    Some(Opened {
        log_bayes_factor: opened.log_evidence - closed.log_evidence,
        estimate: opened.mean,
        covariance: opened.factor.inverse(),
        information,
    })
}

/// Smallest size (in plausible sizes) whose expected ln Bayes factor reaches `threshold`; infinite where the flight says nothing.
///
/// E ln BF = ½ h²t² (1/(h + 1) − 1/(h + 1/s²)) − ½ ln((1 + h)/(1 + s²h)) for information h, size t, spike s, slab 1.
pub(crate) fn minimum_size(information: f64, spike: f64, threshold: f64) -> f64 {
    let h = information;
    let gain = 0.5 * h * h * (1.0 / (h + 1.0) - 1.0 / (h + 1.0 / (spike * spike)));
    let price = 0.5 * ((1.0 + h) / (1.0 + spike * spike * h)).ln();
    if gain <= 0.0 {
        f64::INFINITY
    } else {
        ((threshold + price) / gain).sqrt()
    }
}

/// Normal quantile of 95 %.
const SURE: f64 = 1.644_853_626_951_472;

/// Size (in plausible sizes) whose ln Bayes factor reaches `threshold` in 95 of 100 flights: [`minimum_size`] does in every other one,
/// and the noise of the estimate is 1/√h.
pub(crate) fn detectable_size(information: f64, spike: f64, threshold: f64) -> f64 {
    minimum_size(information, spike, threshold) + SURE / information.sqrt()
}

/// Change of Σ squares on test data for the mean fitted on training data: negative is an improvement.
pub(crate) fn square_sum_change(test: &Normal, mean: &[f64]) -> f64 {
    let product = test.matrix.times(mean);
    mean.iter()
        .zip(&product)
        .zip(&test.gradient)
        .map(|((m, p), g)| m * (p - 2.0 * g))
        .sum()
}

/// What nothing but a model far off, or a log that holds no measurements, leads to.
pub(crate) fn not_finite() -> PredictError {
    PredictError(
        "the model is too far from this log to be fitted (the fit diverges): calibrate it first (`rotortwin vehicle from-log LOG… --mass KG \
         --arm M`), or check the log's units (`rotortwin log show`)"
            .into(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_plant::random::NormalStream;

    #[test]
    fn val_the_detectable_size_passes_in_95_of_100_draws() {
        const DRAWS: usize = 2000;
        let (h, threshold, spike) = (900.0, 10.0, 0.02);
        let size = detectable_size(h, spike, threshold);
        let mut noise = NormalStream::new(9, "sure size");
        let passed = (0..DRAWS)
            .filter(|_| {
                let single = Normal {
                    matrix: Matrix::zero(1).plus_diagonal(&[h]),
                    gradient: vec![h * size + f64::sqrt(h) * noise.sample()],
                    square_sum: 0.0,
                    samples: 1.0,
                };
                let posterior = Posterior::new(&single, &[spike]).unwrap();
                let opened = open(&posterior, &[0], &[spike], &[spike], &[1.0], &[0.0]).unwrap();
                opened.log_bayes_factor > threshold
            })
            .count();
        let share = passed as f64 / DRAWS as f64;
        // Binomial scatter of 2000 draws: 0.5 %, three of them.
        assert!((share - 0.95).abs() < 0.015, "{share}");
    }

    fn problem() -> (Vec<Vec<f64>>, Vec<f64>, Normal) {
        let n = 30;
        let wave = |a: f64, k: usize| libm::sin(a * k as f64 + a);
        let columns: Vec<Vec<f64>> = (0..4)
            .map(|j| (0..n).map(|k| wave(0.3 + 0.21 * j as f64, k) + 0.3).collect())
            .collect();
        let r: Vec<f64> = (0..n).map(|k| 1.4 * columns[2][k] + 0.5 * wave(5.1, k)).collect();
        let mut matrix = Matrix::zero(4);
        let mut gradient = vec![0.0; 4];
        for i in 0..4 {
            for j in 0..4 {
                *matrix.at_mut(i, j) = columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum();
            }
            gradient[i] = columns[i].iter().zip(&r).map(|(a, b)| a * b).sum();
        }
        let square_sum = r.iter().map(|x| x * x).sum();
        let normal = Normal {
            matrix,
            gradient,
            square_sum,
            samples: n as f64,
        };
        (columns, r, normal)
    }

    /// ln N(r; 0, I + J P Jᵀ) with the full covariance.
    fn brute_force(columns: &[Vec<f64>], r: &[f64], deviations: &[f64]) -> f64 {
        let n = r.len();
        let mut covariance = Matrix::zero(n);
        for a in 0..n {
            for b in 0..n {
                let sum: f64 = columns.iter().zip(deviations).map(|(c, d)| d * d * c[a] * c[b]).sum();
                *covariance.at_mut(a, b) = sum + if a == b { 1.0 } else { 0.0 };
            }
        }
        let factor = covariance.cholesky().unwrap();
        let x = factor.solve(r);
        -0.5 * (r.iter().zip(&x).map(|(a, b)| a * b).sum::<f64>() + factor.log_determinant())
    }

    #[test]
    fn val_evidence_equals_the_marginal_likelihood_of_the_data() {
        let (columns, r, normal) = problem();
        let spikes = [0.02; 4];
        let posterior = Posterior::new(&normal, &spikes).unwrap();
        let expected = brute_force(&columns, &r, &spikes);
        let got = posterior.log_evidence - 0.5 * normal.square_sum;
        assert!((got - expected).abs() < 1e-8, "{got} against {expected}");
        for which in [vec![2], vec![0, 2], vec![1]] {
            let mut slab = spikes.to_vec();
            for &i in &which {
                slab[i] = 1.0;
            }
            let small = vec![0.02; which.len()];
            let open = open(
                &posterior,
                &which,
                &small,
                &small,
                &vec![1.0; which.len()],
                &vec![0.0; which.len()],
            )
            .unwrap();
            let difference = brute_force(&columns, &r, &slab) - expected;
            assert!((open.log_bayes_factor - difference).abs() < 1e-7, "{which:?}");
            let full = Posterior::new(&normal, &slab).unwrap();
            for (a, &i) in which.iter().enumerate() {
                assert!((open.estimate[a] - full.mean[i]).abs() < 1e-8);
                assert!((open.covariance.at(a, a) - full.covariance.at(i, i)).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn val_minimum_size_is_where_the_expected_factor_meets_the_threshold() {
        let (_, _, normal) = problem();
        let h = normal.matrix.at(2, 2);
        let size = minimum_size(h, 0.02, 10.0);
        let single = Normal {
            matrix: normal.matrix.part(&[2]),
            gradient: vec![h * size],
            ..normal
        };
        let posterior = Posterior::new(&single, &[0.02]).unwrap();
        let open = open(&posterior, &[0], &[0.02], &[0.02], &[1.0], &[0.0]).unwrap();
        assert!((open.log_bayes_factor - 10.0).abs() < 1e-8, "{}", open.log_bayes_factor);
        assert_eq!(minimum_size(0.0, 0.02, 10.0), f64::INFINITY);
        assert_eq!(detectable_size(0.0, 0.02, 10.0), f64::INFINITY);
    }
}
