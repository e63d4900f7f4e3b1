//! Errors on blocks that the fit did not see: fitted on the even blocks of 5 s, tested on the odd ones, smoothed over 0.1 s.

use rotortwin_plant::effects::{EffectClass, EffectInstance};

use super::Pass;
use super::refinement::LEFT_FACTOR;
use crate::diagnose::state::{Doubt, State};
use crate::estimation::clutter::with_clutter;
use crate::estimation::columns::{Active, LogState, instances};
use crate::estimation::gauss_newton::Fitted;
use crate::estimation::normal::not_finite;
use crate::estimation::nuisances::{self, Reach};
use crate::estimation::posterior::pulled;
use crate::estimation::problem::{Problem, in_pairs};
use crate::estimation::settle::move_to;
use crate::estimation::unseen::{BlockErrors, HeldOutError, QUANTITIES, VOLTAGE, change, kind_of};
use crate::predict::channels::{F, KV, M, V};
use crate::predict::{CHANNELS, ChannelResiduals, Nuisances, PerChannel, PredictError, Series};

/// Length of the smoothing mean, s.
const SMOOTH_S: f64 = 0.1;
/// Factor by which an error on unseen blocks rises where a fit contradicts no guess of a constant.
const CONTRADICTED: f64 = 3.0;
/// Factor on that error above which a fault of the log is rejected.
const CLEARLY: f64 = 1.1;

pub(crate) struct HeldOutCheck;

impl HeldOutCheck {
    /// True if a fit makes an error on unseen blocks so much larger that it is no evidence about a guess. Where one
    /// guess is wrong others usually are, and an error may rise a little with the right value of the first; that of the
    /// voltage, with its guesses of the battery, by more.
    pub(crate) fn contradicts_no_guess(error: &HeldOutError) -> bool {
        error.quantity != QUANTITIES[VOLTAGE].0 && error.rises() && error.after > CONTRADICTED * error.before
    }
}

impl Pass for HeldOutCheck {
    fn name(&self) -> &'static str {
        "Held-out check"
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        let even = even_fit(&state.problem)?;
        let problem = &state.problem;
        let (before, noise) = (all_errors(problem, &[], &state.plain)?, noise(problem));
        let after = all_errors(problem, &even.effects, &as_compared(&state.compared, &even.effects)?)?;
        let mut errors = changes(&before, &after, &noise);
        // Errors that would have to be implausibly large are not small, and excuse nothing.
        if state.left <= LEFT_FACTOR * state.threshold {
            let with = changes(&before, &errors_with_clutter(problem)?, &noise);
            errors = errors
                .into_iter()
                .zip(&with)
                .map(|(error, with)| error.with_small_errors(with))
                .collect();
        }
        let diagnosis = &state.diagnosis;
        let named = !diagnosis.effects.is_empty();
        // Repairing a log need not make any error of the model smaller; but a fault of the log that leaves something
        // unexplained and makes the prediction of unseen blocks clearly worse is rejected.
        let log_alone = !named && !diagnosis.sensor_or_timing.is_empty() && !diagnosis.goodness.unexplained.is_empty();
        if named || log_alone || !diagnosis.calibrate.is_empty() {
            // Fitted on half of the blocks, a chart that is a guess leads elsewhere.
            let forgiven = state.problem.logs.iter().any(|log| log.predictor.forgives_the_chart());
            let judged = |error: &&HeldOutError| !(forgiven && error.quantity == QUANTITIES[VOLTAGE].0);
            let risen = errors.iter().filter(judged).filter(|error| {
                Self::contradicts_no_guess(error)
                    || (named && error.rises())
                    || (log_alone && error.rises() && error.after > CLEARLY * error.before)
            });
            state
                .doubts
                .extend(risen.map(|error| Doubt::HeldOutRises(error.quantity.clone())));
        }
        state.diagnosis.held_out = errors;
        state.unseen_gain = gain(&state.problem, &state.plain, &even)?;
        Ok(())
    }
}

/// What was fitted on even blocks only; nuisances log by log.
struct EvenFit {
    effects: Vec<EffectInstance>,
    nuisances: Vec<Nuisances>,
}

/// The parameters fitted on even blocks only. Clutter stays at 0, as in the model that is handed on.
fn even_fit(problem: &Problem) -> Result<EvenFit, PredictError> {
    const FIXED: f64 = 1e-9;
    let mut prior = problem.deviations(&problem.active);
    for d in &mut prior {
        if *d < 1.0 {
            *d = FIXED;
        }
    }
    let (even, _) = moved_by_even(problem, &prior)?;
    Ok(EvenFit {
        effects: instances(&problem.library, &even.active),
        nuisances: even.logs.iter().map(|log| log.nuisances).collect(),
    })
}

/// Nuisances of each flight with these effects, as a comparison fits them: each flight has its own, seen or not, and those of the given model
/// are fitted in the same way. Fitted with the noise of the rates that a search ends with, they would serve the torques at the expense of the forces.
fn as_compared(logs: &[LogState], effects: &[EffectInstance]) -> Result<Vec<Nuisances>, PredictError> {
    let fitted = in_pairs(logs, |_, log| nuisances::fit(log, effects, Reach::Plausible));
    fitted.into_iter().collect()
}

/// The problem moved by one more step from the fit on all blocks, which forgets where it starts: a step on the even ones
/// with these prior deviations; and its mean.
fn moved_by_even(problem: &Problem, prior: &[f64]) -> Result<(Problem, Vec<f64>), PredictError> {
    let normal = problem.normal(|b| b % 2 == 0);
    let posterior = pulled(problem, normal, prior).ok_or_else(not_finite)?;
    let mut even = problem.clone();
    even.advance(&posterior.mean);
    Ok((even, posterior.mean))
}

/// ln of the likelihood ratio on the blocks that the fit did not see, of what was found to the given model with its
/// nuisances (`plain`): half the fall of the whitened squares, trusted channel by channel. It shows effects that are too
/// small for the errors of the quantities.
fn gain(problem: &Problem, plain: &[Nuisances], even: &EvenFit) -> Result<f64, PredictError> {
    let mut gain = 0.0;
    for (l, log) in problem.logs.iter().enumerate() {
        let with = |nuisances: &Nuisances, effects: &[EffectInstance]| {
            let moved = LogState {
                nuisances: *nuisances,
                ..log.clone()
            };
            moved.residual(effects)
        };
        let (before, after) = (with(&plain[l], &[])?, with(&even.nuisances[l], &even.effects)?);
        for b in (1..log.block_count()).step_by(2) {
            for channel in 0..CHANNELS {
                let square = |residual: &PerChannel| -> f64 {
                    let own = &residual[channel];
                    let range = log.block_range(b);
                    own.get(range).map_or(0.0, |rows| rows.iter().map(|r| r * r).sum())
                };
                gain += 0.5 * problem.weights[l][channel] * (square(&before) - square(&after));
            }
        }
    }
    Ok(gain)
}

/// Errors of the quantities, block by block.
type Blocks = Vec<[BlockErrors; QUANTITIES.len()]>;

/// Errors of the quantities on every odd block.
fn errors(problem: &Problem, log: usize, residuals: &ChannelResiduals) -> Blocks {
    let state = &problem.logs[log];
    let series: &Series = state.predictor.series();
    let rows = (SMOOTH_S / series.step_s).round().max(1.0) as usize;
    let blocks = (1..state.block_count()).step_by(2).map(|b| {
        let range = state.block_range(b);
        let mut all: [BlockErrors; QUANTITIES.len()] = Default::default();
        for channel in 0..CHANNELS {
            let Some((kind, scale)) = kind_of(&state.predictor, channel) else {
                continue;
            };
            let (raw, mask) = (&residuals.raw[channel], &residuals.mask[channel]);
            if raw.is_empty() {
                continue;
            }
            for start in range.clone().step_by(rows) {
                let end = start + rows;
                if end > range.end || !mask[start..end].iter().all(|&m| m) {
                    continue;
                }
                all[kind].push(scale * raw[start..end].iter().sum::<f64>() / rows as f64);
            }
        }
        all
    });
    blocks.collect()
}

/// What noise alone leaves of the quantities, root mean square.
fn noise(problem: &Problem) -> [f64; QUANTITIES.len()] {
    let mut sums = [(0.0, 0.0); QUANTITIES.len()];
    let mut add = |kind: usize, variance: f64| sums[kind] = (sums[kind].0 + variance, sums[kind].1 + 1.0);
    for state in &problem.logs {
        let (predictor, step_s) = (&state.predictor, state.predictor.series().step_s);
        let c = &predictor.nominal;
        let rows = (SMOOTH_S / step_s).round().max(1.0) as usize;
        let covariances = predictor.noise().covariances(step_s);
        for axis in 0..3 {
            let force = c.mass_kg * covariances[F + axis].deviation_of_mean(rows);
            let torque = c.inertia_body_kg_m2[axis][axis] * covariances[M + axis].deviation_of_mean(rows);
            let acceleration = covariances[KV + axis].deviation_of_mean(rows);
            for (kind, deviation) in [(0, force), (1, torque), (3, acceleration)] {
                add(kind, deviation * deviation);
            }
        }
        // Its lower bound is the resolution of a log, which averaging does not reduce.
        add(2, covariances[V].variance);
    }
    sums.map(|(sum, count)| f64::sqrt(sum / count))
}

/// The same of all logs, with these effects and nuisances.
fn all_errors(problem: &Problem, effects: &[EffectInstance], nuisances: &[Nuisances]) -> Result<Blocks, PredictError> {
    let mut all = Blocks::new();
    for (l, (log, nuisances)) in problem.logs.iter().zip(nuisances).enumerate() {
        all.extend(errors(problem, l, &log.predictor.residuals(nuisances, effects)?));
    }
    Ok(all)
}

/// Errors of each quantity before and after.
fn changes(before: &Blocks, after: &Blocks, noise: &[f64; QUANTITIES.len()]) -> Vec<HeldOutError> {
    let of = |all: &Blocks, kind: usize| all.iter().map(|block| block[kind].clone()).collect::<Vec<_>>();
    QUANTITIES
        .iter()
        .enumerate()
        .filter_map(|(kind, (quantity, unit))| change(quantity, unit, &of(before, kind), &of(after, kind), noise[kind]))
        .collect()
}

/// The errors with the active effects and small errors of everything that was not named, as the even blocks give them.
fn errors_with_clutter(problem: &Problem) -> Result<Blocks, PredictError> {
    let (even, mean) = moved_by_even(problem, &problem.deviations(&problem.active))?;
    let (own, mirrored) = with_clutter(&even, &mean, |_| true);
    let of = |active: &[Active]| instances(&problem.library, active);
    let (alone, own, mirrored) = (of(&even.active), of(&own), mirrored.as_deref().map(of));
    let mut all = Blocks::new();
    for (l, log) in even.logs.iter().enumerate() {
        let residuals = |effects: &[EffectInstance]| log.predictor.residuals(&log.nuisances, effects);
        let mut with = residuals(&own)?;
        if let Some(mirrored) = &mirrored {
            // Small errors add up: the change due to the mirrored ones is subtracted.
            let (alone, mirrored) = (residuals(&alone)?, residuals(mirrored)?);
            let channels = with.raw.iter_mut().zip(alone.raw.iter().zip(&mirrored.raw));
            for (with, (alone, mirrored)) in channels {
                for (with, (alone, mirrored)) in with.iter_mut().zip(alone.iter().zip(mirrored)) {
                    *with += alone - mirrored;
                }
            }
        }
        all.extend(errors(problem, l, &with));
    }
    Ok(all)
}

/// An effect without which unseen blocks are predicted as well as with it, in every quantity; `None` if there is none.
///
/// Not asked of an effect that sets in, which changes too few blocks to tell, nor of one without sizes.
pub(crate) fn unproved(problem: &Problem) -> Result<Option<(usize, Fitted)>, PredictError> {
    if problem.active.len() < 2 {
        return Ok(None);
    }
    let all = |problem: &Problem| -> Result<Blocks, PredictError> {
        let even = even_fit(problem)?;
        all_errors(problem, &even.effects, &even.nuisances)
    };
    let (with, noise) = (all(problem)?, noise(problem));
    for one in &problem.active {
        let declared = problem.library.candidates[one.candidate].declaration;
        let needed = problem.active.iter().any(|other| {
            problem.library.candidates[other.candidate]
                .declaration
                .needs
                .contains(&declared.id)
        });
        if declared.class != EffectClass::Physics
            || one.onset_s.is_some()
            || needed
            || problem.library.columns_of(one.candidate).is_empty()
        {
            continue;
        }
        let others: Vec<Active> = problem
            .active
            .iter()
            .filter(|other| other.candidate != one.candidate)
            .cloned()
            .collect();
        let fitted = problem.fit(&others)?;
        let mut without = problem.clone();
        move_to(&mut without, &fitted)?;
        let mut changes = changes(&all(&without)?, &with, &noise);
        changes.retain(|error| error.change_deviation.is_finite());
        if !changes.is_empty() && !changes.iter().any(|error| error.improves_by(1.0)) {
            return Ok(Some((one.candidate, fitted)));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_plant::random::NormalStream;

    fn blocks(noise: &mut NormalStream, scale: f64) -> Vec<BlockErrors> {
        let one = |noise: &mut NormalStream| (0..50).map(|_| scale.sqrt() * noise.sample()).collect();
        (0..9).map(|_| one(noise)).collect()
    }

    /// Errors times the root of a factor.
    fn scaled(errors: &[f64], factor: f64) -> BlockErrors {
        errors.iter().map(|x| factor.sqrt() * x).collect()
    }

    #[test]
    fn val_an_error_rises_by_more_than_chance_or_beyond_the_scatter_of_its_blocks() {
        let mut noise = NormalStream::new(5, "held out");
        let before = blocks(&mut noise, 1.0);
        let by = |factor: f64| {
            let after: Vec<BlockErrors> = before.iter().map(|one| scaled(one, factor * factor)).collect();
            change("torque", "N·m", &before, &after, 1e-3).unwrap().rises()
        };
        assert!(by(1.011) && !by(0.999) && !by(1.0));
        // The same on every block: their scatter is small, and a tenth of that is enough.
        assert!(by(1.002));
    }

    /// The level of the test: a model that is right moves the errors by something that their noise knows nothing of.
    #[test]
    fn val_a_model_that_is_right_raises_an_error_in_less_than_one_of_a_hundred_flights() {
        let mut noise = NormalStream::new(11, "level");
        let flights = 4000;
        for size in [0.02, 0.1] {
            let mut risen = 0;
            for _ in 0..flights {
                let after = blocks(&mut noise, 1.0);
                let other: Vec<f64> = (0..450).map(|k| size * libm::sin(0.3 * f64::from(k))).collect();
                let moved = |(b, one): (usize, &BlockErrors)| -> BlockErrors {
                    one.iter().zip(&other[50 * b..]).map(|(x, d)| x + d).collect()
                };
                let before: Vec<BlockErrors> = after.iter().enumerate().map(moved).collect();
                let change = change("force", "N", &before, &after, 1.0).unwrap();
                risen += usize::from(change.rise_by_chance > 2.326);
            }
            assert!(risen as f64 <= 0.013 * f64::from(flights), "{size}: {risen}");
        }
    }

    #[test]
    fn prop_a_rise_that_small_errors_of_other_constants_explain_is_none() {
        let mut noise = NormalStream::new(9, "held out");
        let before = blocks(&mut noise, 4.0);
        let all = |factor: f64| -> Vec<BlockErrors> { before.iter().map(|one| scaled(one, factor)).collect() };
        let of = |factor: f64| change("force", "N", &before, &all(factor), 1.0).unwrap();
        let risen = of(1.1);
        assert!(risen.rises() && risen.is_beyond_noise() && !risen.is_excused());
        let explained = risen.with_small_errors(&of(0.25));
        assert!(!explained.rises() && !explained.is_beyond_noise() && explained.is_excused());
        // They are of no help if it rises with them, too.
        let worse = of(1.1).with_small_errors(&of(1.05));
        assert!(worse.rises() && worse.is_beyond_noise() && !worse.is_excused());
    }

    #[test]
    fn regress_a_rise_on_the_last_block_alone_counts() {
        let mut noise = NormalStream::new(7, "held out");
        let before = blocks(&mut noise, 1.0);
        let mut after = before.clone();
        after[8] = scaled(&after[8], 1.5);
        let found = change("force", "N", &before, &after, 1e-3).unwrap();
        // However large it is, it is one deviation of the scatter.
        assert!((found.after - found.before) < 1.1 * found.change_deviation, "{found:?}");
        assert!(found.rises(), "{found:?}");
    }

    /// Errors of fast blocks are a hundred times those of a hover; their differences scatter as much as their mean, and
    /// still each block is predicted better.
    #[test]
    fn regress_an_error_that_falls_on_every_block_falls() {
        let mut noise = NormalStream::new(8, "held out");
        let after = blocks(&mut noise, 1.0);
        let raised = |factors: [f64; 9]| -> Vec<BlockErrors> {
            let raised = after.iter().zip(factors).map(|(one, factor)| scaled(one, factor));
            raised.collect()
        };
        let fall = |factors| change("force", "N", &raised(factors), &after, 1e-3).unwrap();
        let all = fall([4.0, 3.0, 300.0, 5.0, 4.0, 30.0, 3.0, 5.0, 6.0]);
        assert!(
            all.before - all.after < 3.0 * all.change_deviation && all.falls(),
            "{all:?}"
        );
        // One block in nine says nothing.
        let one = fall([1.0, 1.0, 300.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
        assert!(one.is_smaller() && !one.falls(), "{one:?}");
    }

    #[test]
    fn regress_rounding_is_no_error() {
        let mut noise = NormalStream::new(6, "held out");
        let (before, after) = (blocks(&mut noise, 1e-12), blocks(&mut noise, 1e-11));
        assert!(change("voltage", "V", &before, &after, 0.0).unwrap().rises());
        assert!(!change("voltage", "V", &before, &after, 2e-3).unwrap().rises());
    }
}
