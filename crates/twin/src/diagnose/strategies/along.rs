//! Effects that one mistake brings along with another: opened at once, as one by one they may lose to an effect that resembles all of them. An
//! inertia that is too large on all axes looks like a mass, as long as the other axes stand against each one's own correction.

use super::start::{Trial, active_at};
use crate::estimation::columns::Active;
use crate::estimation::normal::{Posterior, open};
use crate::estimation::problem::Problem;
use crate::estimation::scores::priors;

/// The mistake that an active effect is of, by the id of the effect that is in question: itself, or the one that brings it along.
pub(crate) fn mistake(problem: &Problem, of: &Active) -> &'static str {
    let declaration = |a: &Active| problem.library.candidates[a.candidate].declaration;
    let own = declaration(of).id;
    let mut all = problem.active.iter().map(declaration);
    all.find(|other| other.search.along.contains(&own))
        .map_or(own, |other| other.id)
}

/// True if other active effects are of the same mistake: they were weighed together, and one by one is no question.
pub(crate) fn is_along(problem: &Problem, of: &Active) -> bool {
    let own = mistake(problem, of);
    let mut others = problem.active.iter().filter(|other| other.candidate != of.candidate);
    others.any(|other| mistake(problem, other) == own)
}

/// Each candidate with the first, with the first two, … of those that its effect declares, all at their linear estimate.
pub(crate) fn starts(problem: &Problem, posterior: &Posterior) -> Vec<Trial> {
    let mut starts = Vec::new();
    for (candidate, entry) in problem.library.candidates.iter().enumerate() {
        // The candidate in question is the last of a trial.
        let mut group = vec![candidate];
        for id in entry.declaration.search.along {
            let mut all = problem.library.candidates.iter();
            group.splice(..0, all.position(|c| c.declaration.id == *id && c.rotor == entry.rotor));
            starts.extend(start(problem, posterior, &group));
        }
    }
    starts
}

/// The trial that opens these; `None` if it is no group, or one of them is at work already.
fn start(problem: &Problem, posterior: &Posterior, group: &[usize]) -> Option<Trial> {
    let at_work = |c: &usize| problem.active.iter().any(|a| a.candidate == *c);
    if group.len() < 2 || group.iter().any(at_work) {
        return None;
    }
    let (mut places, mut spikes, mut slabs, mut counts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for &candidate in group {
        let own = priors(problem, candidate);
        counts.push(own.0.len());
        places.extend(own.0);
        spikes.extend(own.1);
        slabs.extend(own.2);
    }
    let opened = open(posterior, &places, &spikes, &spikes, &slabs, &vec![0.0; places.len()])?;
    let mut estimate = opened.estimate.as_slice();
    let mut at_its_estimate = |(&candidate, count): (&usize, usize)| -> Active {
        let (own, rest) = estimate.split_at(count);
        estimate = rest;
        active_at(problem, candidate, own)
    };
    Some(Trial {
        open: group.iter().zip(counts).map(&mut at_its_estimate).collect(),
        log_bayes_factor: opened.log_bayes_factor,
        charge: None,
        moved: Vec::new(),
    })
}
