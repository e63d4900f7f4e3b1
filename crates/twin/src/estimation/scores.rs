//! Evidence of candidates about the present point, by linear algebra: of those that are not in the model, and of those
//! that are.

use super::normal::{Opened, Posterior, open};
use super::problem::{Problem, position_of};

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

/// The active effect with the least evidence, and that evidence, nats; effects that another one or `kept` acts through stay out of it.
pub(crate) fn weakest(problem: &Problem, posterior: &Posterior, prior: &[f64], kept: &[&str]) -> Option<(usize, f64)> {
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    let mut weakest: Option<(usize, f64)> = None;
    for active in &problem.active {
        let (places, spikes, slabs) = priors(problem, active.candidate);
        // A gross error has no columns; an effect that acts through another one keeps it.
        let id = problem.library.candidates[active.candidate].declaration.id;
        let needed = problem.active.iter().any(|other| {
            let needs = problem.library.candidates[other.candidate].declaration.needs;
            other.candidate != active.candidate && needs.contains(&id)
        });
        if places.is_empty() || needed || kept.contains(&id) {
            continue;
        }
        let now: Vec<f64> = places.iter().map(|&i| prior[i]).collect();
        let at: Vec<f64> = places.iter().map(|&i| position[i]).collect();
        // The posterior is about the point with the prior about 0: the evidence of the data alone is computed again.
        let Some(opened) = open(posterior, &places, &spikes, &now, &slabs, &at) else {
            continue;
        };
        if weakest.is_none_or(|(_, least)| opened.log_bayes_factor < least) {
            weakest = Some((active.candidate, opened.log_bayes_factor));
        }
    }
    weakest
}
