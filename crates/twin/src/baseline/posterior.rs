//! Likelihood of a trim under the spread of healthy flights, and the evidence of a candidate.
//!
//! The deviation z of ln thrust of n rotors from the healthy mean is split into a common part c (mean of z) and a rest
//! d. With spreads s_c and s_d estimated from K flights (K − 1 and (K − 1)(n − 1) degrees of freedom), and the mean
//! itself uncertain by 1/K, both are Student's t:
//!
//! ```text
//! ln p = −(ν_c + 1)/2 ln(1 + n c²/(ν_c S_c²)) − (ν_d + n − 1)/2 ln(1 + |d|²/(ν_d S_d²)),   S² = s² (1 + 1/K)
//! ```
//! up to a constant. A candidate's parameters have normal priors; the evidence is Laplace's about the mode,
//! which iteratively reweighted least squares find.

use std::convert::Infallible;

use crate::estimation::least_squares::{Control, LeastSquares, Unknown, minimise};
use crate::estimation::normal::Normal;

/// Least spread, relative: no two flights are known to be more alike.
const LEAST_SPREAD: f64 = 0.005;
/// Iterations of the reweighted least squares.
const CONTROL: Control = Control {
    steps: 30,
    dampings: 12,
    damping: 0.0,
    least_fall: 1e-12,
    least_share: 0.0,
};
/// Step of the differences in prior deviations.
const STEP: f64 = 0.01;

/// Spread of healthy flights.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread {
    rotors: f64,
    flights: f64,
    /// Variance of √n c and of each dimension of d.
    common: f64,
    rest: f64,
}

/// Mode, deviations and evidence of a candidate.
#[derive(Debug, Clone)]
pub(super) struct Weighed {
    pub(super) values: Vec<f64>,
    pub(super) deviations: Vec<f64>,
    pub(super) log_evidence: f64,
}

/// n c², |d|².
fn parts(z: &[f64]) -> (f64, f64) {
    let n = z.len() as f64;
    let mean = z.iter().sum::<f64>() / n;
    (n * mean * mean, z.iter().map(|x| (x - mean) * (x - mean)).sum())
}

impl Spread {
    /// From deviations from their mean.
    pub(super) fn of(deviations: &[Vec<f64>]) -> Self {
        let (flights, rotors) = (deviations.len() as f64, deviations[0].len() as f64);
        let (mut common, mut rest) = (0.0, 0.0);
        for one in deviations {
            let (c, d) = parts(one);
            common += c;
            rest += d;
        }
        let least = LEAST_SPREAD * LEAST_SPREAD;
        Self {
            rotors,
            flights,
            common: (common / (flights - 1.0)).max(rotors * least),
            rest: (rest / ((flights - 1.0) * (rotors - 1.0))).max(least),
        }
    }

    /// With an additional relative deviation of each rotor and of the factor common to all.
    pub(super) fn wider(self, deviation: f64) -> Self {
        let variance = deviation * deviation;
        Self {
            common: self.common + self.rotors * variance,
            rest: self.rest + variance,
            ..self
        }
    }

    /// The same spread, known from this many flights.
    pub(super) fn of_flights(self, flights: usize) -> Self {
        Self {
            flights: flights as f64,
            ..self
        }
    }

    /// Standard deviations of the common factor and of a rotor relative to it.
    pub(super) fn relative(&self) -> [f64; 2] {
        [(self.common / self.rotors).sqrt(), self.rest.sqrt()]
    }

    /// ν S² and exponent of both parts.
    fn scales(&self) -> [(f64, f64); 2] {
        let wide = 1.0 + 1.0 / self.flights;
        let (own, rest) = (self.flights - 1.0, (self.flights - 1.0) * (self.rotors - 1.0));
        [
            (own * self.common * wide, own + 1.0),
            (rest * self.rest * wide, rest + self.rotors - 1.0),
        ]
    }

    pub(super) fn log_likelihood(&self, z: &[f64]) -> f64 {
        let (c, d) = parts(z);
        let [(scale_c, power_c), (scale_d, power_d)] = self.scales();
        -0.5 * power_c * (1.0 + c / scale_c).ln() - 0.5 * power_d * (1.0 + d / scale_d).ln()
    }

    /// Precisions of both parts at a residual, as of the normal distribution with the same gradient there.
    fn precisions(&self, z: &[f64]) -> (f64, f64) {
        let (c, d) = parts(z);
        let [(scale_c, power_c), (scale_d, power_d)] = self.scales();
        (power_c / (scale_c + c), power_d / (scale_d + d))
    }
}

/// aᵀ W b with W of the precisions of both parts.
fn product(a: &[f64], b: &[f64], (common, rest): (f64, f64)) -> f64 {
    let n = a.len() as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let inner: f64 = a.iter().zip(b).map(|(x, y)| (x - mean_a) * (y - mean_b)).sum();
    common * n * mean_a * mean_b + rest * inner
}

/// A candidate on the data; its parameters in prior deviations.
struct Explanation<'a> {
    data: &'a [f64],
    spread: &'a Spread,
    sizes: &'a [f64],
    signature: &'a dyn Fn(&[f64]) -> Vec<f64>,
}

impl Explanation<'_> {
    fn values(&self, at: &[f64]) -> Vec<f64> {
        at.iter().zip(self.sizes).map(|(x, s)| x * s).collect()
    }

    fn residual(&self, at: &[f64]) -> Vec<f64> {
        let explained = (self.signature)(&self.values(at));
        self.data.iter().zip(explained).map(|(z, m)| z - m).collect()
    }
}

impl LeastSquares for Explanation<'_> {
    type Error = Infallible;

    /// −2 ln p.
    fn cost(&mut self, at: &[f64]) -> Result<f64, Infallible> {
        Ok(-2.0 * self.spread.log_likelihood(&self.residual(at)))
    }

    /// With the weights of the normal distribution whose gradient is the same at this residual.
    fn linearise(&mut self, at: &[f64]) -> Result<Normal, Infallible> {
        let r = self.residual(at);
        let weights = self.spread.precisions(&r);
        let count = at.len();
        let columns: Vec<Vec<f64>> = (0..count)
            .map(|j| {
                let mut moved = at.to_vec();
                moved[j] += STEP;
                let there = self.residual(&moved);
                r.iter().zip(there).map(|(a, b)| (a - b) / STEP).collect()
            })
            .collect();
        let mut normal = Normal::zero(count);
        normal.square_sum = self.cost(at)?;
        for i in 0..count {
            normal.gradient[i] = product(&columns[i], &r, weights);
            for j in 0..count {
                *normal.matrix.at_mut(i, j) = product(&columns[i], &columns[j], weights);
            }
        }
        Ok(normal)
    }
}

/// Fits a candidate whose parameters have prior deviations `sizes`.
pub(super) fn weigh(data: &[f64], spread: &Spread, sizes: &[f64], signature: &dyn Fn(&[f64]) -> Vec<f64>) -> Weighed {
    let mut explanation = Explanation {
        data,
        spread,
        sizes,
        signature,
    };
    let unknowns = vec![Unknown::unit(f64::INFINITY); sizes.len()];
    let Ok(minimum) = minimise(&mut explanation, &unknowns, &vec![0.0; sizes.len()], &CONTROL);
    let at = &minimum.at;
    let log_posterior = spread.log_likelihood(&explanation.residual(at)) - 0.5 * at.iter().map(|x| x * x).sum::<f64>();
    let (log_determinant, deviations) = match minimum.precision(&unknowns).cholesky() {
        Some(factor) => {
            let covariance = factor.inverse();
            let deviation = |(i, size): (usize, &f64)| covariance.at(i, i).max(0.0).sqrt() * size;
            (
                factor.log_determinant(),
                sizes.iter().enumerate().map(deviation).collect(),
            )
        }
        // Non-finite numbers show up as missing evidence.
        None => (f64::INFINITY, vec![f64::INFINITY; sizes.len()]),
    };
    Weighed {
        values: explanation.values(at),
        deviations,
        log_evidence: log_posterior - 0.5 * log_determinant,
    }
}
