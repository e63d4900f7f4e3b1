//! Least squares with priors and bounds: the iteration that all small fits of the twin share.
//!
//! Minimises
//!
//! ```text
//! c(x) = |r(x)|² + Σ (xᵢ/dᵢ)²,   lowᵢ ≤ xᵢ ≤ highᵢ
//! ```
//! by Gauss–Newton steps (A + λ diag A) δ = g − P⁻¹x with A = H + P⁻¹, H = JᵀJ, g = Jᵀr and P = diag d². An unknown whose step would leave
//! its bounds is held there, and the others follow. A step that does not lower the cost is tried again with more damping λ
//! (Marquardt 1963). A system with a pivot that is nothing but rounding is never solved without damping.
//!
//! Limits: a local minimum near the start. For evidence with spikes and slabs see [`super::normal`]; for the fit of
//! effects together with the clutter of a whole library, [`super::gauss_newton`].

use super::dense::Matrix;
use super::normal::Normal;

/// Least pivot over its diagonal: below, an unknown is known from the others but for rounding.
const LEAST_PIVOT: f64 = 1e-14;
/// Damping after the first step that raised the cost, where there was none: half of a step.
const FIRST_DAMPING: f64 = 1.0;
/// Factors on the damping after a step that raised the cost, and after one that lowered it.
const MORE: f64 = 6.0;
const LESS: f64 = 0.2;
/// Damping of a system that cannot be solved without.
const SINGULAR_DAMPING: f64 = 1e-6;
/// Least damping of an iteration that began with some.
const LEAST_DAMPING: f64 = 1e-12;

/// What is known of an unknown beforehand.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Unknown {
    /// Deviation of its normal prior about 0; infinite without one.
    pub(crate) deviation: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

impl Unknown {
    /// No prior, within bounds.
    pub(crate) fn within(low: f64, high: f64) -> Self {
        Self {
            deviation: f64::INFINITY,
            low,
            high,
        }
    }

    /// A normal prior of deviation 1, within ±`reach`.
    pub(crate) fn unit(reach: f64) -> Self {
        Self {
            deviation: 1.0,
            low: -reach,
            high: reach,
        }
    }

    fn precision(&self) -> f64 {
        1.0 / (self.deviation * self.deviation)
    }
}

/// When an iteration ends, and how it begins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Control {
    /// Most steps.
    pub(crate) steps: usize,
    /// Most dampings that are tried for one step.
    pub(crate) dampings: usize,
    /// Damping at the start: 0 for a problem that is nearly linear.
    pub(crate) damping: f64,
    /// A step that would lower, or has lowered, the cost by no more than this is the last …
    pub(crate) least_fall: f64,
    /// … or by no more than this share of the cost.
    pub(crate) least_share: f64,
}

/// What is minimised, without the priors.
pub(crate) trait LeastSquares {
    /// Why a point cannot be evaluated.
    type Error;

    /// rᵀr at a point, or its counterpart: twice the negative logarithm of a likelihood. A point that cannot be
    /// evaluated is avoided.
    fn cost(&mut self, at: &[f64]) -> Result<f64, Self::Error>;

    /// JᵀJ, Jᵀr and the cost about a point: always one whose cost was taken just before, but for the first.
    fn linearise(&mut self, at: &[f64]) -> Result<Normal, Self::Error>;
}

/// Where the iteration ended.
#[derive(Debug, Clone)]
pub(crate) struct Minimum {
    pub(crate) at: Vec<f64>,
    /// About the last point that was linearised: the end, or a step of no account before it.
    pub(crate) normal: Normal,
}

impl Minimum {
    /// H + P⁻¹.
    pub(crate) fn precision(&self, unknowns: &[Unknown]) -> Matrix {
        with_priors(&self.normal, unknowns)
    }

    /// (H + P⁻¹)⁻¹; `None` if the data and the priors do not determine all unknowns.
    pub(crate) fn covariance(&self, unknowns: &[Unknown]) -> Option<Matrix> {
        Some(self.precision(unknowns).cholesky_above(LEAST_PIVOT)?.inverse())
    }
}

/// H + P⁻¹.
fn with_priors(normal: &Normal, unknowns: &[Unknown]) -> Matrix {
    let precision: Vec<f64> = unknowns.iter().map(Unknown::precision).collect();
    normal.matrix.clone().plus_diagonal(&precision)
}

/// Σ (xᵢ/dᵢ)².
fn penalty(unknowns: &[Unknown], at: &[f64]) -> f64 {
    at.iter().zip(unknowns).map(|(x, u)| x * x * u.precision()).sum()
}

/// Minimises from `start`.
///
/// # Errors
/// The start cannot be evaluated.
pub(crate) fn minimise<P: LeastSquares>(
    problem: &mut P,
    unknowns: &[Unknown],
    start: &[f64],
    control: &Control,
) -> Result<Minimum, P::Error> {
    let mut at: Vec<f64> = within(start, unknowns);
    let mut normal = problem.linearise(&at)?;
    let mut damping = control.damping;
    for _ in 0..control.steps {
        let here = normal.square_sum + penalty(unknowns, &at);
        let negligible = control.least_fall.max(control.least_share * here);
        let matrix = with_priors(&normal, unknowns);
        let gradient: Vec<f64> = (0..at.len())
            .map(|i| normal.gradient[i] - at[i] * unknowns[i].precision())
            .collect();
        let mut lower = None;
        for _ in 0..control.dampings {
            let Some(step) = bounded_step(&matrix, &gradient, unknowns, &at, damping) else {
                damping = (10.0 * damping).max(SINGULAR_DAMPING);
                continue;
            };
            let promised: f64 = step
                .iter()
                .zip(matrix.times(&step))
                .zip(&gradient)
                .map(|((s, as_), g)| s * (2.0 * g - as_))
                .sum();
            if promised <= negligible {
                break;
            }
            let moved: Vec<f64> = at.iter().zip(&step).map(|(x, s)| x + s).collect();
            let trial = within(&moved, unknowns);
            let cost = problem.cost(&trial).map(|cost| cost + penalty(unknowns, &trial));
            if let Ok(cost) = cost
                && cost < here
            {
                lower = Some((trial, here - cost));
                break;
            }
            damping = if damping == 0.0 { FIRST_DAMPING } else { MORE * damping };
        }
        let Some((trial, fall)) = lower else { break };
        at = trial;
        damping = if control.damping == 0.0 {
            0.0
        } else {
            (LESS * damping).max(LEAST_DAMPING)
        };
        if fall <= negligible {
            break;
        }
        normal = problem.linearise(&at)?;
    }
    Ok(Minimum { at, normal })
}

/// Every unknown pulled into its bounds.
fn within(at: &[f64], unknowns: &[Unknown]) -> Vec<f64> {
    at.iter().zip(unknowns).map(|(x, u)| x.clamp(u.low, u.high)).collect()
}

/// The damped step within the bounds; `None` where a pivot is nothing but rounding. What the data do not touch stays where it is.
fn bounded_step(matrix: &Matrix, gradient: &[f64], unknowns: &[Unknown], at: &[f64], damping: f64) -> Option<Vec<f64>> {
    let n = at.len();
    let mut held: Vec<Option<f64>> = (0..n).map(|i| (matrix.at(i, i) <= 0.0).then_some(0.0)).collect();
    loop {
        let free: Vec<usize> = (0..n).filter(|&i| held[i].is_none()).collect();
        let right: Vec<f64> = free
            .iter()
            .map(|&i| {
                let taken: f64 = (0..n).filter_map(|j| Some(matrix.at(i, j) * held[j]?)).sum();
                gradient[i] - taken
            })
            .collect();
        let more: Vec<f64> = free.iter().map(|&i| damping * matrix.at(i, i)).collect();
        let factor = matrix.part(&free).plus_diagonal(&more).cholesky_above(LEAST_PIVOT)?;
        let mut step: Vec<f64> = held.iter().map(|step| step.unwrap_or(0.0)).collect();
        let mut inside = true;
        for (&i, solved) in free.iter().zip(factor.solve(&right)) {
            let to = (at[i] + solved).clamp(unknowns[i].low, unknowns[i].high);
            step[i] = solved;
            if (to - at[i] - solved).abs() > 1e-9 * solved.abs() {
                held[i] = Some(to - at[i]);
                inside = false;
            }
        }
        if inside {
            return Some(step);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y = model(x) with numbers for the slopes.
    struct Curve<'a> {
        x: &'a [f64],
        y: &'a [f64],
        model: fn(&[f64], f64) -> f64,
    }

    impl LeastSquares for Curve<'_> {
        type Error = String;

        fn cost(&mut self, at: &[f64]) -> Result<f64, String> {
            let cost: f64 = self
                .x
                .iter()
                .zip(self.y)
                .map(|(x, y)| (y - (self.model)(at, *x)).powi(2))
                .sum();
            if cost.is_finite() {
                Ok(cost)
            } else {
                Err("not finite".into())
            }
        }

        fn linearise(&mut self, at: &[f64]) -> Result<Normal, String> {
            let n = at.len();
            let mut normal = Normal {
                matrix: Matrix::zero(n),
                gradient: vec![0.0; n],
                square_sum: self.cost(at)?,
                samples: self.x.len() as f64,
            };
            for (x, y) in self.x.iter().zip(self.y) {
                let slope: Vec<f64> = (0..n)
                    .map(|i| {
                        let mut moved = at.to_vec();
                        moved[i] += 1e-7;
                        ((self.model)(&moved, *x) - (self.model)(at, *x)) / 1e-7
                    })
                    .collect();
                for i in 0..n {
                    normal.gradient[i] += slope[i] * (y - (self.model)(at, *x));
                    for j in 0..n {
                        *normal.matrix.at_mut(i, j) += slope[i] * slope[j];
                    }
                }
            }
            Ok(normal)
        }
    }

    const LINEAR: Control = Control {
        steps: 20,
        dampings: 12,
        damping: 0.0,
        least_fall: 1e-14,
        least_share: 0.0,
    };

    fn line(at: &[f64], x: f64) -> f64 {
        at[0] + at[1] * x
    }

    fn data() -> (Vec<f64>, Vec<f64>) {
        let x: Vec<f64> = (0..20).map(|k| 0.1 * f64::from(k)).collect();
        let y = x.iter().map(|x| 2.0 + 0.5 * x + 0.01 * libm::sin(40.0 * x)).collect();
        (x, y)
    }

    #[test]
    fn val_a_prior_pulls_as_the_posterior_of_normal_noise_says() {
        let (x, y) = data();
        let mut problem = Curve {
            x: &x,
            y: &y,
            model: line,
        };
        let unknowns = [Unknown::unit(f64::INFINITY), Unknown::within(-9.0, 9.0)];
        let minimum = minimise(&mut problem, &unknowns, &[0.0, 0.0], &LINEAR).unwrap();
        // (XᵀX + diag(1, 0))⁻¹ Xᵀy, by hand.
        let (n, sx) = (x.len() as f64 + 1.0, x.iter().sum::<f64>());
        let sxx: f64 = x.iter().map(|x| x * x).sum();
        let sy: f64 = y.iter().sum();
        let sxy: f64 = x.iter().zip(&y).map(|(x, y)| x * y).sum();
        let det = n * sxx - sx * sx;
        let expected = [(sxx * sy - sx * sxy) / det, (n * sxy - sx * sy) / det];
        for i in 0..2 {
            assert!((minimum.at[i] - expected[i]).abs() < 1e-6, "{:?}", minimum.at);
        }
        let covariance = minimum.covariance(&unknowns).unwrap();
        assert!((covariance.at(1, 1) - n / det).abs() < 1e-6);
    }

    #[test]
    fn val_the_others_follow_an_unknown_that_is_held_at_its_bound() {
        let (x, y) = data();
        let mut problem = Curve {
            x: &x,
            y: &y,
            model: line,
        };
        let unknowns = [Unknown::within(-1.0, 1.5), Unknown::within(-9.0, 9.0)];
        let minimum = minimise(&mut problem, &unknowns, &[0.0, 0.0], &LINEAR).unwrap();
        let sxx: f64 = x.iter().map(|x| x * x).sum();
        let slope = x.iter().zip(&y).map(|(x, y)| x * (y - 1.5)).sum::<f64>() / sxx;
        assert!(
            minimum.at[0] == 1.5 && (minimum.at[1] - slope).abs() < 1e-6,
            "{:?}",
            minimum.at
        );
    }

    #[test]
    fn val_damping_finds_a_rate_that_plain_steps_overshoot() {
        let x: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k)).collect();
        let y: Vec<f64> = x.iter().map(|x| 3.0 * libm::exp(-2.0 * x)).collect();
        let mut problem = Curve {
            x: &x,
            y: &y,
            model: |at, x| at[0] * libm::exp(-at[1] * x),
        };
        let free = [Unknown::within(-50.0, 50.0); 2];
        let control = Control { steps: 60, ..LINEAR };
        let minimum = minimise(&mut problem, &free, &[1.0, 9.0], &control).unwrap();
        assert!(
            (minimum.at[0] - 3.0).abs() < 1e-4 && (minimum.at[1] - 2.0).abs() < 1e-4,
            "{:?}",
            minimum.at
        );
    }

    #[test]
    fn val_unknowns_that_the_data_cannot_tell_apart_have_no_covariance() {
        let (x, y) = data();
        let mut problem = Curve {
            x: &x,
            y: &y,
            model: |at, _| at[0] + at[1],
        };
        let free = [Unknown::within(-9.0, 9.0); 2];
        let minimum = minimise(&mut problem, &free, &[0.0, 0.0], &LINEAR).unwrap();
        assert!(minimum.covariance(&free).is_none());
        let mean = y.iter().sum::<f64>() / y.len() as f64;
        assert!((minimum.at[0] + minimum.at[1] - mean).abs() < 1e-4, "{:?}", minimum.at);
        // With a prior on one they are determined.
        let pulled = [Unknown::unit(9.0), free[1]];
        assert!(minimum.covariance(&pulled).is_some());
    }
}
