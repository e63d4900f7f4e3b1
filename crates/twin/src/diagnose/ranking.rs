//! The table of all candidates with held-out scores, and effects that the flight cannot show.

use super::result::{NotTestable, Ranked};
use crate::estimation::candidates::is_size;
use crate::estimation::normal::{Normal, Posterior, detectable_size, open, square_sum_change};
use crate::estimation::parameters::parameters;
use crate::estimation::problem::Problem;
use crate::estimation::scores::{Scored, opened_mean, priors};
use crate::predict::PredictError;

/// The table of all candidates; held-out scores for the leading ones. The linear fit may require a negative mass:
/// possible candidates come first.
pub(crate) fn table(problem: &Problem, scored: &[Scored]) -> Result<Vec<Ranked>, PredictError> {
    const HELD_OUT_FOR: usize = 12;
    let folds: Vec<(Normal, Normal)> = [0, 1]
        .iter()
        .map(|odd| (problem.normal(|b| b % 2 != *odd), problem.normal(|b| b % 2 == *odd)))
        .collect();
    let prior = problem.deviations(&problem.active);
    let posteriors: Vec<Posterior> = folds
        .iter()
        .filter_map(|(train, _)| Posterior::new(train, &prior))
        .collect();
    let mut rows = Vec::new();
    for (rank, one) in scored.iter().enumerate() {
        let candidate = &problem.library.candidates[one.candidate];
        let columns = problem.library.columns_of(one.candidate);
        let mut values = candidate.neutral();
        let mut deviations = vec![0.0; values.len()];
        for (a, &j) in columns.iter().enumerate() {
            let column = &problem.library.columns[j];
            values[column.parameter] += one.opened.estimate[a] * column.size;
            deviations[column.parameter] = one.opened.covariance.at(a, a).max(0.0).sqrt() * column.size;
        }
        let mut change = 0.0;
        if rank < HELD_OUT_FOR && posteriors.len() == folds.len() {
            for ((_, test), posterior) in folds.iter().zip(&posteriors) {
                let (places, spikes, slabs) = priors(problem, one.candidate);
                let offset = vec![0.0; places.len()];
                let Some(opened) = open(posterior, &places, &spikes, &spikes, &slabs, &offset) else {
                    continue;
                };
                let mean = opened_mean(posterior, &places, &opened);
                change += square_sum_change(test, &mean) - square_sum_change(test, &posterior.mean);
            }
        }
        rows.push(Ranked {
            effect: candidate.declaration.id.to_owned(),
            rotor: candidate.rotor,
            label: candidate.label(),
            equation: candidate.declaration.equation.to_owned(),
            class: candidate.declaration.class,
            parameters: parameters(&problem.library, one.candidate, &values, &deviations),
            ln_bayes_factor: one.opened.log_bayes_factor,
            held_out_chi2_change: change,
        });
    }
    // Stable: each part stays in its order.
    rows.sort_by_key(|row| !row.can_be());
    Ok(rows)
}

/// Smallest size of each size parameter that would be named in 95 of 100 such flights: the untestable ones, and all.
/// Where the shape of an effect is unknown, `worst` has the size that shows whatever the shape is.
pub(crate) fn detectable(
    problem: &Problem,
    scored: &[Scored],
    worst: &[(usize, f64)],
    threshold: f64,
) -> (Vec<NotTestable>, Vec<NotTestable>) {
    let (mut not_testable, mut all) = (Vec::new(), Vec::new());
    for one in scored {
        let candidate = &problem.library.candidates[one.candidate];
        let columns = problem.library.columns_of(one.candidate);
        for (a, &j) in columns.iter().enumerate() {
            let column = &problem.library.columns[j];
            if !is_size(&problem.library, one.candidate, column.parameter) {
                continue;
            }
            let p = &candidate.parameters[column.parameter];
            let least = detectable_size(one.opened.information.at(a, a), column.spike, threshold);
            let any_shape = worst.iter().find(|(c, _)| *c == one.candidate).map_or(0.0, |(_, w)| *w);
            let size = least.max(any_shape) * column.size;
            let row = NotTestable {
                effect: candidate.declaration.id.to_owned(),
                rotor: candidate.rotor,
                label: candidate.label(),
                parameter: p.name.to_owned(),
                unit: p.unit.to_owned(),
                plausible_size: column.size,
                minimum_size: size.is_finite().then_some(size),
                excited_by: candidate.declaration.excited_by.to_owned(),
            };
            if size > column.size {
                not_testable.push(row.clone());
            }
            all.push(row);
        }
    }
    (not_testable, all)
}
