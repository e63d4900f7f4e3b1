//! Second looks at what was named: gusts instead of a further effect, effects that others have replaced or made
//! superfluous, onsets.

use super::evidence::{Posterior, open};
use super::findings::UNTOLD_GAP;
use super::fit::{Fitted, Problem, position_of};
use super::linear::Active;
use super::ranking::{Scored, priors, score};
use super::select::{Named, ONSET_GAIN, best_of};
use super::settle::{move_to, posterior_of, settled, trust};
use super::{charge, goodness, gusts, trials};
use crate::predict::PredictError;
use crate::predict::channels::{F, KV};

/// Loss of ln evidence up to which one effect does as well as two.
const AS_WELL: f64 = 1.0;

/// Whether gusts through a drag that was found explain more than any further effect would, and leave none. An onset that only the gusts
/// called for is dropped.
pub(super) fn gusts_lead(
    problem: &mut Problem,
    posterior: &Posterior,
    scored: &[Scored],
    threshold: f64,
) -> Result<bool, PredictError> {
    let fits = goodness::fits(problem, &posterior.mean);
    let mut forces = fits.iter().flat_map(|own| (F..KV).filter_map(|c| own[c]));
    if problem.active.is_empty() || !forces.any(|fit| fit.score() > goodness::UNEXPLAINED_SCORE) {
        return Ok(false);
    }
    let evidence = |scored: &[Scored]| scored.first().map_or(0.0, |s| s.opened.log_bayes_factor);
    let leads = |problem: &Problem, posterior: &Posterior| -> Result<bool, PredictError> {
        Ok(gusts::find(problem, posterior)?.is_some_and(|found| {
            found.gain > evidence(scored) && evidence(&score(problem, &found.posterior)) < threshold
        }))
    };
    if leads(problem, posterior)? {
        return Ok(true);
    }
    if problem.active.iter().all(|a| a.onset_s.is_none()) {
        return Ok(false);
    }
    let mut plain = problem.clone();
    for one in &mut plain.active {
        one.onset_s = None;
    }
    let fitted = plain.fit(&plain.active)?;
    move_to(&mut plain, &fitted)?;
    let about = posterior_of(&plain)?.0;
    let without_onset = leads(&plain, &about)?;
    if without_onset {
        *problem = plain;
    }
    Ok(without_onset)
}

/// The problem without the effects that are `gone`, and the one effect that is best in their place there, if it passes alone.
fn best_without(
    problem: &Problem,
    gone: impl Fn(usize) -> bool,
    threshold: f64,
) -> Result<Option<(Problem, Fitted, Named)>, PredictError> {
    let mut without = problem.clone();
    without.active.retain(|one| !gone(one.candidate));
    without.linearise(&|_| ())?;
    trust(&mut without);
    let (posterior, _) = settled(&mut without)?;
    let scored = score(&without, &posterior);
    let special = trials::trials(&without, &posterior, threshold);
    let Some((fitted, mut found)) = best_of(&without, &posterior, &scored, &special, threshold)? else {
        return Ok(None);
    };
    let only = found.pop().filter(|_| found.is_empty());
    Ok(only.map(|only| (without, fitted, only)))
}

/// Looks again for each effect but the last, now that the others are known: what was found first was found while all else was missing,
/// and may have been another effect that took over a part of the rest. For the last, too, if it came together with the effect through
/// which it acts: beside that another one may do as well.
pub(super) fn reconsider(problem: &mut Problem, named: &mut [Named], threshold: f64) -> Result<(), PredictError> {
    for place in 0..problem.active.len() {
        let id = |p: &Problem, a: &Active| p.library.candidates[a.candidate].declaration;
        let removed = problem.active[place].clone();
        let own = id(problem, &removed);
        let together = named.iter().any(|n| n.candidate == removed.candidate && n.together);
        let bound = problem.active.iter().any(|other| {
            let needs = id(problem, other).needs;
            other.candidate != removed.candidate
                && (needs.contains(&own.id) || (!together && own.needs.contains(&id(problem, other).id)))
        });
        let last = place + 1 == problem.active.len();
        if bound || (last && !together) || problem.library.columns_of(removed.candidate).is_empty() {
            continue;
        }
        let Some((mut without, fitted, new)) = best_without(problem, |c| c == removed.candidate, threshold)? else {
            continue;
        };
        let same = new.candidate == removed.candidate;
        if same && !together {
            continue;
        }
        let mut open = without.active.clone();
        open.push(removed.clone());
        // A clear gain: the first finding has its reasons and its rivals written down already.
        if !together && fitted.log_evidence < without.fit(&open)?.log_evidence + UNTOLD_GAP {
            continue;
        }
        if let Some(slot) = named.iter_mut().find(|n| n.candidate == removed.candidate) {
            *slot = new;
        }
        move_to(&mut without, &fitted)?;
        *problem = without;
    }
    Ok(())
}

/// One effect in place of two, where three or more were named. Selection goes forward: what it took first for something else stays as a
/// patch, with the next one to mend the patch (a gain of the voltage sensor and another capacity, for thin air).
pub(super) fn in_place_of_two(
    problem: &mut Problem,
    named: &mut Vec<Named>,
    threshold: f64,
) -> Result<(), PredictError> {
    let count = problem.active.len();
    if count < 3 {
        return Ok(());
    }
    let all = charge::fit_anywhere(problem)?;
    let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
    for (a, b) in pairs {
        let removed = [problem.active[a].clone(), problem.active[b].clone()];
        let gone = |c: usize| removed.iter().any(|one| one.candidate == c);
        let needed = problem.active.iter().any(|other| {
            let needs = problem.library.candidates[other.candidate].declaration.needs;
            let id = |one: &Active| problem.library.candidates[one.candidate].declaration.id;
            !gone(other.candidate) && removed.iter().any(|one| needs.contains(&id(one)))
        });
        if needed
            || removed
                .iter()
                .any(|one| problem.library.columns_of(one.candidate).is_empty())
        {
            continue;
        }
        let Some((mut without, fitted, new)) = best_without(problem, gone, threshold)? else {
            continue;
        };
        // Without a charge that may stand wrong, the second of the two was needed.
        if gone(new.candidate) && !charge::may_stand_elsewhere(&without) {
            continue;
        }
        // The new one may need another charge than the two.
        move_to(&mut without, &fitted)?;
        let fitted = charge::fit_anywhere(&without)?;
        // Weighed where all is known: without the two the noise of a channel may pass for larger than it is.
        let mut known = problem.clone();
        for (log, nuisances) in known.logs.iter_mut().zip(&fitted.nuisances) {
            log.nuisances.charge = nuisances.charge;
        }
        if known.fit(&fitted.active)?.log_evidence < all.log_evidence - AS_WELL {
            continue;
        }
        named.retain(|one| !gone(one.candidate));
        named.push(new);
        move_to(&mut without, &fitted)?;
        *problem = without;
        return Ok(());
    }
    Ok(())
}

/// Drops onsets that were called for only while another effect was missing.
pub(super) fn doubt_onsets(problem: &mut Problem) -> Result<(), PredictError> {
    for place in 0..problem.active.len() {
        if problem.active[place].onset_s.is_none() {
            continue;
        }
        let mut from_the_start = problem.active.clone();
        from_the_start[place].onset_s = None;
        let (with, without) = (problem.fit(&problem.active)?, problem.fit(&from_the_start)?);
        if with.log_evidence - without.log_evidence < ONSET_GAIN {
            move_to(problem, &without)?;
        }
    }
    Ok(())
}

/// The fit without an effect that a later finding has made superfluous, if there is one.
pub(super) fn superfluous(
    problem: &Problem,
    posterior: &Posterior,
    prior: &[f64],
    threshold: f64,
) -> Result<Option<Fitted>, PredictError> {
    if problem.active.len() < 2 {
        return Ok(None);
    }
    let Some((candidate, _)) = weakest(problem, posterior, prior, &[]).filter(|(_, evidence)| *evidence <= threshold)
    else {
        return Ok(None);
    };
    let others: Vec<Active> = problem
        .active
        .iter()
        .filter(|a| a.candidate != candidate)
        .cloned()
        .collect();
    let (with, without) = (problem.fit(&problem.active)?, problem.fit(&others)?);
    Ok((with.log_evidence - without.log_evidence < threshold).then_some(without))
}

/// The active effect with the least evidence, and that evidence, nats; effects that another one or `kept` acts through stay out of it.
pub(super) fn weakest(problem: &Problem, posterior: &Posterior, prior: &[f64], kept: &[&str]) -> Option<(usize, f64)> {
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
        // The posterior is about the point with the prior about 0: what the data alone say is asked for again.
        let Some(opened) = open(posterior, &places, &spikes, &now, &slabs, &at) else {
            continue;
        };
        if weakest.is_none_or(|(_, least)| opened.log_bayes_factor < least) {
            weakest = Some((active.candidate, opened.log_bayes_factor));
        }
    }
    weakest
}
