//! Evidence of every candidate about the present point, held-out scores, and what the flight cannot show.

use rotortwin_plant::effects::ParameterDeclaration;

use super::evidence::{Normal, Opened, Posterior, open, square_sum_change, sure_size};
use super::fit::Problem;
use super::library::Library;
use super::result::{FittedParameter, NotTestable, Ranked};
use crate::predict::PredictError;

/// Normal quantile of a two-sided 95 % interval.
pub(crate) const QUANTILE_95: f64 = 1.959_963_984_540_054;

/// A candidate with its evidence.
#[derive(Debug, Clone)]
pub(crate) struct Scored {
    pub(crate) candidate: usize,
    pub(crate) opened: Opened,
}

/// Columns of a candidate with their place in the problem, spikes and slabs.
pub(crate) fn priors(problem: &Problem, candidate: usize) -> (Vec<usize>, Vec<f64>, Vec<f64>) {
    let columns = problem.library.columns_of(candidate);
    let offset = problem.nuisances();
    let places = columns.iter().map(|j| offset + j).collect();
    let spikes = columns.iter().map(|&j| problem.library.columns[j].spike).collect();
    let slabs = vec![1.0; columns.len()];
    (places, spikes, slabs)
}

/// Every candidate that is not active, best first.
pub(crate) fn score(problem: &Problem, posterior: &Posterior) -> Vec<Scored> {
    let mut scored: Vec<Scored> = (0..problem.library.candidates.len())
        .filter(|&c| problem.active.iter().all(|a| a.candidate != c))
        .filter(|&c| !problem.library.columns_of(c).is_empty())
        .filter_map(|candidate| {
            let (places, spikes, slabs) = priors(problem, candidate);
            let offset = vec![0.0; places.len()];
            open(posterior, &places, &spikes, &spikes, &slabs, &offset).map(|opened| Scored { candidate, opened })
        })
        .collect();
    scored.sort_by(|a, b| b.opened.log_bayes_factor.total_cmp(&a.opened.log_bayes_factor));
    scored
}

/// Parameters of a candidate from values and deviations in its own units.
pub(crate) fn parameters(
    library: &Library,
    candidate: usize,
    values: &[f64],
    deviations: &[f64],
) -> Vec<FittedParameter> {
    parameters_of(&library.candidates[candidate].parameters, values, deviations)
}

/// The same of parameters as they are declared.
pub(crate) fn parameters_of(
    declared: &[ParameterDeclaration],
    values: &[f64],
    deviations: &[f64],
) -> Vec<FittedParameter> {
    declared
        .iter()
        .zip(values)
        .zip(deviations)
        .map(|((p, &value), &deviation)| FittedParameter {
            name: p.name.to_owned(),
            symbol: p.symbol.to_owned(),
            unit: p.unit.to_owned(),
            value,
            deviation,
            interval_95: QUANTILE_95 * deviation,
            plausible: value + 2.0 * deviation >= p.plausible_low && value - 2.0 * deviation <= p.plausible_high,
        })
        .collect()
}

/// The table of all candidates; held-out scores for the leading ones.
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
    Ok(rows)
}

/// The mean of all parameters once some have moved to their opened estimate: m + C_·A C_AA⁻¹ (θ_A − m_A).
pub(crate) fn opened_mean(posterior: &Posterior, places: &[usize], opened: &Opened) -> Vec<f64> {
    let mut mean = posterior.mean.clone();
    let Some(factor) = posterior.covariance.part(places).cholesky() else {
        return mean;
    };
    let shift: Vec<f64> = places
        .iter()
        .zip(&opened.estimate)
        .map(|(&i, e)| e - posterior.mean[i])
        .collect();
    let solved = factor.solve(&shift);
    for (i, m) in mean.iter_mut().enumerate() {
        *m += places
            .iter()
            .zip(&solved)
            .map(|(&j, s)| posterior.covariance.at(i, j) * s)
            .sum::<f64>();
    }
    mean
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
            if !super::linear::is_size(&problem.library, one.candidate, column.parameter) {
                continue;
            }
            let p = &candidate.parameters[column.parameter];
            let least = sure_size(one.opened.information.at(a, a), column.spike, threshold);
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
