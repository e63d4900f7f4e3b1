//! Starts of fits: which effects they open, and where.

use crate::estimation::columns::Active;
use crate::estimation::problem::Problem;
use crate::estimation::scores::Scored;

/// A start of a fit.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    /// Effects that it opens, a companion first.
    pub(crate) open: Vec<Active>,
    /// ln Bayes factor by linear algebra.
    pub(crate) log_bayes_factor: f64,
    /// Charge offset at the start, if not the present one.
    pub(crate) charge: Option<f64>,
    /// The active effects, if they start elsewhere than where they stand.
    pub(crate) moved: Vec<Active>,
}

impl Trial {
    /// What is at work at the start of the fit.
    pub(crate) fn beside(&self, active: &[Active]) -> Vec<Active> {
        let before = if self.moved.is_empty() { active } else { &self.moved };
        before.iter().chain(&self.open).cloned().collect()
    }
}

/// Relative error of a constant below which its effect is assumed proportional to 1/(1 + d), as for an inertia or a
/// mass.
const NO_LONGER_LINEAR: f64 = -0.5;

/// The plain trial of a candidate at its linear estimate.
pub(crate) fn plain(problem: &Problem, one: &Scored) -> Trial {
    let mut start = active_at(problem, one.candidate, &one.opened.estimate);
    let entry = &problem.library.candidates[one.candidate];
    if let Some((place, _)) = entry.constant {
        let of = |j: &usize| problem.library.columns[*j];
        let columns = problem.library.columns_of(one.candidate);
        let estimate = columns
            .iter()
            .zip(&one.opened.estimate)
            .find(|(j, _)| of(j).parameter == place);
        let error = estimate.map_or(0.0, |(j, e)| e * of(j).size);
        if error < NO_LONGER_LINEAR {
            // −d = 1/(1 + d') − 1 at first order.
            start.values[place] = entry.clamped(place, error / (1.0 - error));
        }
    }
    Trial {
        open: vec![start],
        log_bayes_factor: one.opened.log_bayes_factor,
        charge: None,
        moved: Vec::new(),
    }
}

/// A candidate with all its columns at an estimate, in plausible sizes from where it does nothing.
pub(crate) fn active_at(problem: &Problem, candidate: usize, estimate: &[f64]) -> Active {
    let entry = &problem.library.candidates[candidate];
    let mut values = entry.neutral();
    for (&j, e) in problem.library.columns_of(candidate).iter().zip(estimate) {
        let column = &problem.library.columns[j];
        let value = values[column.parameter] + e * column.size;
        values[column.parameter] = entry.clamped(column.parameter, value);
    }
    Active {
        candidate,
        values,
        onset_s: None,
    }
}
