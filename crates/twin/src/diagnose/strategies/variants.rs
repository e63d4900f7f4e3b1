//! Columns of effects where the linear ranking about zero does not reach: secants about a point, alone or together with
//! a companion.
//!
//! The evidence of such columns A on top of the library X with posterior (m, C) under spikes is that of h = AᵀA − AᵀX C XᵀA and
//! g = Aᵀ(r − X m) with slabs of 1.

use rayon::prelude::*;
use rotortwin_plant::effects::ParameterKind;

use crate::estimation::columns::{Active, Base, Column, LogState, instances};
use crate::estimation::dense::Matrix;
use crate::estimation::gram::{column_product, residual_product};
use crate::estimation::normal::{Posterior, weigh};
use crate::estimation::problem::{Problem, in_pairs};

/// A trial: a candidate about `values` by a secant of `step` plausible sizes, alone or with a companion through which
/// it acts.
pub(crate) struct Variant {
    pub(crate) candidate: usize,
    pub(crate) values: Vec<f64>,
    pub(crate) step: f64,
    /// At its typical size.
    pub(crate) companion: Option<Active>,
}

/// Products of a variant's columns with each other, the residual and the library.
struct Products {
    own: Matrix,
    residual: Vec<f64>,
    library: Vec<Vec<f64>>,
}

/// Evidence of a variant.
pub(crate) struct Evidence {
    pub(crate) log_bayes_factor: f64,
    pub(crate) estimate: Vec<f64>,
    pub(crate) information: f64,
}

impl Products {
    fn of(problem: &Problem, l: usize, columns: &[Column]) -> Self {
        let (linear, weights) = (&problem.linear[l], &problem.weights[l]);
        let mut products = Self {
            own: Matrix::zero(columns.len()),
            residual: Vec::with_capacity(columns.len()),
            library: vec![vec![0.0; problem.size()]; columns.len()],
        };
        for (a, column) in columns.iter().enumerate() {
            products
                .residual
                .push(residual_product(column, &linear.residual, weights));
            for (b, other) in columns.iter().enumerate() {
                *products.own.at_mut(a, b) = column_product(column, other, weights);
            }
            for (i, other) in linear.columns.iter().enumerate() {
                products.library[a][problem.global(l, i)] = column_product(column, other, weights);
            }
        }
        products
    }

    fn add(&mut self, other: &Self) {
        let sum = |own: &mut [f64], more: &[f64]| own.iter_mut().zip(more).for_each(|(own, more)| *own += more);
        self.own.add(&other.own);
        sum(&mut self.residual, &other.residual);
        for (own, more) in self.library.iter_mut().zip(&other.library) {
            sum(own, more);
        }
    }

    /// See the top of this file.
    fn evidence(mut self, posterior: &Posterior) -> Option<Evidence> {
        let k = self.residual.len();
        let (h, g) = (&mut self.own, &mut self.residual);
        for a in 0..k {
            let row = &self.library[a];
            g[a] -= row.iter().zip(&posterior.mean).map(|(c, m)| c * m).sum::<f64>();
            let spread = posterior.covariance.times(row);
            for b in 0..k {
                *h.at_mut(a, b) -= self.library[b].iter().zip(&spread).map(|(c, s)| c * s).sum::<f64>();
            }
        }
        for a in 0..k {
            let diagonal = h.at_mut(a, a);
            *diagonal = diagonal.max(0.0);
        }
        let weighed = weigh(h, g, &vec![1.0; k])?;
        Some(Evidence {
            log_bayes_factor: weighed.log_evidence,
            estimate: weighed.mean,
            information: h.at(0, 0),
        })
    }
}

/// Products of every variant in one log; `None` where it yields an invalid configuration. Log by log, because the predictions that secants start from
/// are large.
fn products_in(problem: &Problem, l: usize, log: &LogState, variants: &[Variant]) -> Vec<Option<Products>> {
    let Ok(present) = log.base(&instances(&problem.library, &problem.active)) else {
        return variants.iter().map(|_| None).collect();
    };
    let mut companions: Vec<&Active> = variants.iter().filter_map(|v| v.companion.as_ref()).collect();
    companions.sort_by_key(|one| one.candidate);
    companions.dedup_by_key(|one| one.candidate);
    let beside: Vec<(usize, Option<Base>)> = companions
        .into_par_iter()
        .map(|one| {
            let mut active = problem.active.clone();
            active.push(one.clone());
            (one.candidate, log.base(&instances(&problem.library, &active)).ok())
        })
        .collect();
    variants
        .par_iter()
        .map(|variant| {
            let Some(companion) = &variant.companion else {
                let own = columns(problem, log, &present, None, variant)?;
                return Some(Products::of(problem, l, &own));
            };
            let base = beside.iter().find(|(of, _)| *of == companion.candidate)?.1.as_ref()?;
            let alone = Variant {
                candidate: companion.candidate,
                values: problem.library.candidates[companion.candidate].neutral(),
                step: variant.step,
                companion: None,
            };
            let mut own = columns(problem, log, &present, None, &alone)?;
            own.extend(columns(problem, log, base, Some(companion), variant)?);
            Some(Products::of(problem, l, &own))
        })
        .collect()
}

/// Columns of the sizes of a variant's candidate by secants about its values, with the active effects and `with`
/// present.
fn columns(
    problem: &Problem,
    log: &LogState,
    base: &Base,
    with: Option<&Active>,
    variant: &Variant,
) -> Option<Vec<Column>> {
    let parameters = &problem.library.candidates[variant.candidate].parameters;
    let mut active = problem.active.clone();
    active.extend(with.cloned());
    size_places(problem, variant.candidate)
        .into_iter()
        .map(|i| {
            let p = &parameters[i];
            let (low, high) = p.accepted();
            let mut change = variant.step * p.size;
            if change > high || change < low {
                change = -change;
            }
            let mut values = variant.values.clone();
            values[i] += change;
            let mut active = active.clone();
            active.push(Active {
                candidate: variant.candidate,
                values,
                onset_s: None,
            });
            log.secant(&problem.library, &active, base, p.size / change).ok()
        })
        .collect()
}

pub(crate) fn size_places(problem: &Problem, candidate: usize) -> Vec<usize> {
    let entry = &problem.library.candidates[candidate];
    (0..entry.columns.len())
        .filter(|&i| entry.columns[i].is_some() && entry.parameters[i].kind == ParameterKind::Size)
        .collect()
}

/// Values of a candidate at the estimate (in plausible sizes) of its sizes.
pub(crate) fn values_at(problem: &Problem, candidate: usize, base: &[f64], estimate: &[f64]) -> Vec<f64> {
    let entry = &problem.library.candidates[candidate];
    let mut values = base.to_vec();
    for (&i, e) in size_places(problem, candidate).iter().zip(estimate) {
        let size = entry.parameters[i].size;
        values[i] = entry.clamped(i, values[i] + e * size);
    }
    values
}

/// Evidence of each variant over all logs; `None` where one of them yields an invalid configuration.
pub(crate) fn weighed(problem: &Problem, posterior: &Posterior, variants: &[Variant]) -> Vec<Option<Evidence>> {
    let mut logs = in_pairs(&problem.logs, |l, log| products_in(problem, l, log, variants)).into_iter();
    let mut sums = logs.next().unwrap_or_default();
    for log in logs {
        for (sum, more) in sums.iter_mut().zip(log) {
            match (sum.as_mut(), more) {
                (Some(sum), Some(more)) => sum.add(&more),
                _ => *sum = None,
            }
        }
    }
    sums.into_iter()
        .map(|products| products.and_then(|products| products.evidence(posterior)))
        .collect()
}
