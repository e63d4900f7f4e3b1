//! Reconsideration: each effect but the last is searched for again together with the others, and one effect may replace
//! two.

use super::Pass;
use super::refinement::best_of;
use crate::diagnose::named::{Named, UNTOLD_GAP};
use crate::diagnose::state::State;
use crate::diagnose::strategies::trials::trials;
use crate::diagnose::strategies::{along, battery};
use crate::estimation::columns::Active;
use crate::estimation::gauss_newton::Fitted;
use crate::estimation::problem::Problem;
use crate::estimation::scores::score;
use crate::estimation::settle::{move_to, settled, trust};
use crate::predict::PredictError;

/// Loss of ln evidence up to which one effect does as well as two.
const AS_WELL: f64 = 1.0;

pub(crate) struct Reconsideration;

impl Pass for Reconsideration {
    fn name(&self) -> &'static str {
        "Reconsideration"
    }

    fn searches(&self) -> bool {
        true
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        if state.problem.active.len() < 2 {
            return Ok(());
        }
        let (options, began_s) = (state.options, state.began_s);
        let over = || options.is_over(began_s);
        let whole = reconsider(&mut state.problem, &mut state.named, state.threshold, &over)?
            && in_place_of_two(&mut state.problem, &mut state.named, state.threshold, &over)?;
        state.stopped |= !whole;
        Ok(())
    }
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
    let special = trials(&without, &posterior, threshold);
    let Some((fitted, mut found)) = best_of(&without, &posterior, &scored, &special, threshold)? else {
        return Ok(None);
    };
    let only = found.pop().filter(|_| found.is_empty());
    Ok(only.map(|only| (without, fitted, only)))
}

/// Reconsiders each effect but the last, now that the others are known: what was found first was found while all the
/// rest was missing, and may have been another effect that absorbed a part of the rest. The last is reconsidered, too,
/// if it came together with the effect through which it acts: with that, another one may fit equally well.
///
/// False if it was `over` before the last.
fn reconsider(
    problem: &mut Problem,
    named: &mut [Named],
    threshold: f64,
    over: &dyn Fn() -> bool,
) -> Result<bool, PredictError> {
    for place in 0..problem.active.len() {
        if over() {
            return Ok(false);
        }
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
        if bound
            || along::is_along(problem, &removed)
            || (last && !together)
            || problem.library.columns_of(removed.candidate).is_empty()
        {
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
    Ok(true)
}

/// One effect in place of two, if three or more were named. Selection is forward: a first, wrong choice stays as a
/// patch, together with the next one that corrects the patch (a gain of the voltage sensor and another capacity, for
/// thin air).
///
/// False if it was `over` before the last pair.
fn in_place_of_two(
    problem: &mut Problem,
    named: &mut Vec<Named>,
    threshold: f64,
    over: &dyn Fn() -> bool,
) -> Result<bool, PredictError> {
    let count = problem.active.len();
    if count < 3 {
        return Ok(true);
    }
    let all = battery::fit_anywhere(problem)?;
    let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
    for (a, b) in pairs {
        if over() {
            return Ok(false);
        }
        let removed = [problem.active[a].clone(), problem.active[b].clone()];
        let gone = |c: usize| removed.iter().any(|one| one.candidate == c);
        let needed = problem.active.iter().any(|other| {
            let needs = problem.library.candidates[other.candidate].declaration.needs;
            let id = |one: &Active| problem.library.candidates[one.candidate].declaration.id;
            !gone(other.candidate) && removed.iter().any(|one| needs.contains(&id(one)))
        });
        let is_bound =
            |one: &Active| problem.library.columns_of(one.candidate).is_empty() || along::is_along(problem, one);
        if needed || removed.iter().any(is_bound) {
            continue;
        }
        let Some((mut without, fitted, new)) = best_without(problem, gone, threshold)? else {
            continue;
        };
        // Without a charge that may stand wrong, the second of the two was needed.
        if gone(new.candidate) && !battery::may_stand_elsewhere(&without) {
            continue;
        }
        // The new one may need another charge than the two.
        move_to(&mut without, &fitted)?;
        let fitted = battery::fit_anywhere(&without)?;
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
        return Ok(true);
    }
    Ok(true)
}
