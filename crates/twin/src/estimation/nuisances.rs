//! What every flight has and no model knows is fitted before anything is compared: constant lift errors of the rotors, and the
//! charge at take-off. Gauss–Newton on the whitened residuals, with priors.

use crate::predict::{CHANNELS, Nuisances, PerChannel, PredictError, Predictor};

/// Prior deviation of a rotor's lift error over its hover thrust: uniform in ±10.756 mN (§6) on 2.534 N.
pub(crate) const BIAS_SHARE: f64 = 0.002_45;
/// No lift error goes beyond this, over hover thrust (§6: 0.00424). Long flights overrule any prior; without a bound the biases of all
/// rotors together would hide a wrong mass.
const LARGEST_BIAS: f64 = 0.006;
/// Prior deviation of the charge at the start, fraction.
pub(crate) const CHARGE_DEVIATION: f64 = 0.25;
/// Rounds: the voltage is not linear in the charge.
const ROUNDS: usize = 3;

/// The most probable nuisances of a log under the model of `predictor`.
///
/// # Errors
/// The model's effects together make no vehicle.
pub(crate) fn fit(predictor: &Predictor) -> Result<Nuisances, PredictError> {
    let rotors = predictor.series().rotors;
    let count = rotors + 1;
    let hover = predictor.nominal.mass_kg * predictor.nominal.gravity_m_s2 / rotors as f64;
    let deviation = |i: usize| {
        if i < rotors {
            BIAS_SHARE * hover
        } else {
            CHARGE_DEVIATION
        }
    };
    let whitened = |nuisances: &Nuisances| predictor.residuals(nuisances, &[]).map(|residuals| residuals.whitened);
    let mut best = Nuisances::default();
    for _ in 0..ROUNDS {
        let base = whitened(&best)?;
        let mut columns: Vec<PerChannel> = Vec::with_capacity(count);
        for i in 0..count {
            let step = 0.1 * deviation(i);
            let mut moved = best;
            shift(&mut moved, i, rotors, step);
            let mut column = whitened(&moved)?;
            for (column, base) in column.iter_mut().zip(&base) {
                for (value, base) in column.iter_mut().zip(base) {
                    *value = (base - *value) / step;
                }
            }
            columns.push(column);
        }
        let mut normal = vec![vec![0.0; count + 1]; count];
        for a in 0..count {
            for b in a..count {
                let product = inner(&columns[a], &columns[b]);
                normal[a][b] += product;
                if a != b {
                    normal[b][a] += product;
                }
            }
            let prior = 1.0 / (deviation(a) * deviation(a));
            normal[a][a] += prior;
            normal[a][count] = inner(&columns[a], &base) - prior * value(&best, a, rotors);
        }
        let reach = |i: usize| {
            if i < rotors {
                LARGEST_BIAS * hover
            } else {
                f64::INFINITY
            }
        };
        for (i, step) in bounded(&normal, |i, step| {
            let before = value(&best, i, rotors);
            (before + step).clamp(-reach(i), reach(i)) - before
        })
        .into_iter()
        .enumerate()
        {
            shift(&mut best, i, rotors, step);
        }
    }
    Ok(best)
}

/// Solves with steps that `limit` shortens: an unknown that would go too far is held at its limit, and the others follow.
fn bounded(normal: &[Vec<f64>], limit: impl Fn(usize, f64) -> f64) -> Vec<f64> {
    let n = normal.len();
    let mut held: Vec<Option<f64>> = vec![None; n];
    loop {
        let mut rows = normal.to_vec();
        for i in 0..n {
            for j in 0..n {
                if let Some(step) = held[j].filter(|_| held[i].is_none()) {
                    rows[i][n] -= rows[i][j] * step;
                    rows[i][j] = 0.0;
                }
            }
            if let Some(step) = held[i] {
                rows[i].fill(0.0);
                rows[i][i] = 1.0;
                rows[i][n] = step;
            }
        }
        let steps = solve(rows);
        let mut within = true;
        for (i, &step) in steps.iter().enumerate() {
            let short = limit(i, step);
            if held[i].is_none() && (short - step).abs() > 1e-12 {
                held[i] = Some(short);
                within = false;
            }
        }
        if within {
            return steps;
        }
    }
}

fn value(nuisances: &Nuisances, i: usize, rotors: usize) -> f64 {
    if i < rotors {
        nuisances.rotor_bias_n[i]
    } else {
        nuisances.charge
    }
}

fn shift(nuisances: &mut Nuisances, i: usize, rotors: usize, by: f64) {
    if i < rotors {
        nuisances.rotor_bias_n[i] += by;
    } else {
        nuisances.charge += by;
    }
}

fn inner(a: &PerChannel, b: &PerChannel) -> f64 {
    (0..CHANNELS)
        .map(|c| a[c].iter().zip(&b[c]).map(|(x, y)| x * y).sum::<f64>())
        .sum()
}

/// Solves a positive definite system whose right side is the last column.
fn solve(mut rows: Vec<Vec<f64>>) -> Vec<f64> {
    let n = rows.len();
    for i in 0..n {
        for j in i + 1..n {
            let factor = rows[j][i] / rows[i][i];
            for k in i..=n {
                rows[j][k] -= factor * rows[i][k];
            }
        }
    }
    let mut x = vec![0.0; n];
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|j| rows[i][j] * x[j]).sum();
        x[i] = (rows[i][n] - known) / rows[i][i];
    }
    x
}
