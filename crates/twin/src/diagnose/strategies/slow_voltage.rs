//! Fit of the slow voltage, in means of 0.1 s: charge at the start, and the parameters of effects that show in the voltage.
//!
//! The open-circuit voltage is a chart with kinks: a step that overshoots one is shortened, and minima are searched over the charge.

use crate::estimation::columns::CHARGE_DEVIATION;
use crate::estimation::dense::{Matrix, dot};

/// Charges tried.
pub(crate) const CHARGES: usize = 25;

/// Most Gauss–Newton steps of a fit, and how many of these move the effect alone.
const MOST_STEPS: usize = 12;

const STEPS_ALONE: usize = 1;

const STEPS_AT_CHARGE: usize = 3;

const SECTIONS: usize = 10;

/// Smallest part of a step that is tried, and smallest gain of ln posterior for which a fit continues.
const LEAST_SHARE: f64 = 0.04;

const LEAST_GAIN: f64 = 0.1;

/// Step of the differences in an effect's parameters, plausible sizes.
pub(crate) const EFFECT_STEP: f64 = 0.01;

/// Means of the voltage at a charge and sizes of the effect; `None` if these yield an invalid vehicle.
pub(crate) type Predict<'a> = dyn Fn(f64, &[f64]) -> Option<Vec<f64>> + 'a;

/// Fit of the slow voltage: charge, and the parameters of the moving effects.
pub(crate) struct Fit<'a> {
    pub(crate) predict: &'a Predict<'a>,
    pub(crate) measured: &'a [f64],
    pub(crate) weight: f64,
    /// What the other channels say of the effects: their mean, and the inverse of its covariance.
    pub(crate) estimate: &'a [f64],
    pub(crate) prior: &'a Matrix,
}

/// A point of a fit.
pub(crate) struct Point {
    pub(crate) charge: f64,
    pub(crate) theta: Vec<f64>,
    /// Negative ln posterior.
    pub(crate) value: f64,
    predicted: Vec<f64>,
}

impl Fit<'_> {
    fn at(&self, charge: f64, theta: Vec<f64>) -> Option<Point> {
        let predicted = (self.predict)(charge, &theta)?;
        let misfit: f64 = self
            .measured
            .iter()
            .zip(&predicted)
            .map(|(m, p)| (m - p) * (m - p))
            .sum();
        let off = self.off(&theta);
        let value =
            0.5 * (self.weight * misfit + dot(&off, &self.prior.times(&off)) + (charge / CHARGE_DEVIATION).powi(2));
        Some(Point {
            charge,
            theta,
            value,
            predicted,
        })
    }

    fn off(&self, theta: &[f64]) -> Vec<f64> {
        theta.iter().zip(self.estimate).map(|(t, e)| t - e).collect()
    }

    /// The lowest point within one cell of `charge`: the effect alone first, then both.
    pub(crate) fn descend(&self, charge: f64, theta: Vec<f64>) -> Option<Point> {
        let cell = 1.0 / CHARGES as f64;
        let mut point = self.at(charge, theta)?;
        for iteration in 0..MOST_STEPS {
            let alone = iteration < STEPS_ALONE;
            let Some(move_by) = self.step(&point, alone)? else {
                break;
            };
            // The chart has kinks: where a step overshoots one, a part of it descends.
            let mut share = 1.0;
            let next = loop {
                let at = (point.charge + share * move_by[0]).clamp(charge - cell, charge + cell);
                let mut theta = point.theta.clone();
                for (t, m) in theta.iter_mut().zip(&move_by[1..]) {
                    *t = (*t + share * m.clamp(-1.0, 1.0)).clamp(-4.0, 4.0);
                }
                let next = self.at(at, theta)?;
                if next.value < point.value {
                    break Some(next);
                }
                share *= 0.35;
                if share < LEAST_SHARE {
                    break None;
                }
            };
            let Some(next) = next else {
                if alone {
                    continue;
                }
                break;
            };
            let gain = point.value - next.value;
            point = next;
            if gain < LEAST_GAIN && !alone {
                break;
            }
        }
        Some(point)
    }

    /// The lowest point at a charge, from an effect nearby.
    fn at_charge(&self, charge: f64, theta: &[f64]) -> Option<Point> {
        let mut point = self.at(charge, theta.to_vec())?;
        for _ in 0..STEPS_AT_CHARGE {
            let Some(move_by) = self.step(&point, true)? else { break };
            let theta = point.theta.iter().zip(&move_by[1..]);
            let next = self.at(
                charge,
                theta.map(|(t, m)| (t + m.clamp(-1.0, 1.0)).clamp(-4.0, 4.0)).collect(),
            )?;
            let gain = point.value - next.value;
            if gain <= 0.0 {
                break;
            }
            point = next;
            if gain < LEAST_GAIN {
                break;
            }
        }
        Some(point)
    }

    /// The lowest point about a minimum, searched over the charge: a descent along both stops at a kink of the chart that lies across its
    /// valley. Every quarter of a cell, then a golden section, then a descent again.
    pub(crate) fn searched(&self, about: &Point) -> Option<Point> {
        let quarter = 0.25 / CHARGES as f64;
        let mut best = self.at_charge(about.charge, &about.theta)?;
        for side in [-1.0, 1.0] {
            let mut theta = about.theta.clone();
            for i in 1..=4 {
                let point = self.at_charge(about.charge + side * quarter * f64::from(i), &theta)?;
                theta.clone_from(&point.theta);
                if point.value < best.value {
                    best = point;
                }
            }
        }
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let (mut low, mut high) = (best.charge - quarter, best.charge + quarter);
        let inner = |low: f64, high: f64| (high - golden * (high - low), low + golden * (high - low));
        let (a, b) = inner(low, high);
        let (mut left, mut right) = (self.at_charge(a, &best.theta)?, self.at_charge(b, &best.theta)?);
        for _ in 0..SECTIONS {
            if left.value < right.value {
                high = right.charge;
                right = left;
                left = self.at_charge(inner(low, high).0, &right.theta)?;
            } else {
                low = left.charge;
                left = right;
                right = self.at_charge(inner(low, high).1, &left.theta)?;
            }
        }
        for point in [left, right] {
            if point.value < best.value {
                best = point;
            }
        }
        self.descend(best.charge, best.theta)
    }

    /// The Gauss–Newton step from a point, charge first; `alone` leaves the charge where it is.
    fn step(&self, point: &Point, alone: bool) -> Option<Option<Vec<f64>>> {
        const CHARGE_STEP: f64 = 1e-3;
        let slope = |high: &[f64], low: &[f64], by: f64| -> Vec<f64> {
            high.iter().zip(low).map(|(h, l)| (h - l) / by).collect()
        };
        // Both sides of where the charge is, which may be a kink.
        let mut jacobian = vec![if alone {
            vec![0.0; point.predicted.len()]
        } else {
            slope(
                &(self.predict)(point.charge + CHARGE_STEP, &point.theta)?,
                &(self.predict)(point.charge - CHARGE_STEP, &point.theta)?,
                2.0 * CHARGE_STEP,
            )
        }];
        for a in 0..point.theta.len() {
            let mut next = point.theta.clone();
            next[a] += EFFECT_STEP;
            jacobian.push(slope(
                &(self.predict)(point.charge, &next)?,
                &point.predicted,
                EFFECT_STEP,
            ));
        }
        let residual: Vec<f64> = self.measured.iter().zip(&point.predicted).map(|(m, p)| m - p).collect();
        let size = jacobian.len();
        let mut h = Matrix::zero(size);
        let mut g = vec![0.0; size];
        for a in 0..size {
            g[a] = self.weight * dot(&jacobian[a], &residual);
            for b in 0..size {
                *h.at_mut(a, b) = self.weight * dot(&jacobian[a], &jacobian[b]);
            }
        }
        let pull = self.prior.times(&self.off(&point.theta));
        for a in 1..size {
            g[a] -= pull[a - 1];
            for b in 1..size {
                *h.at_mut(a, b) += self.prior.at(a - 1, b - 1);
            }
        }
        let stiffness = CHARGE_DEVIATION.powi(-2);
        *h.at_mut(0, 0) += stiffness;
        g[0] -= point.charge * stiffness;
        if alone {
            g[0] = 0.0;
        }
        Some(h.cholesky().map(|factor| factor.solve(&g)))
    }
}
