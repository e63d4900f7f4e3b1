//! The joint fit of a version's effects to the logs that they were found on: Gauss–Newton on the whitened residuals, nuisances of each
//! log included, without clutter.
//!
//! The diagnosis fits with clutter on every other parameter of its library, which is right for deciding and for intervals. The model
//! that is handed on has no clutter; its values are the best without.
//!
//! As everywhere here, residuals are of raw data and sensitivities of smoothed kinematics, so that noise does not shrink the values.

use rotortwin_plant::effects::{Catalogue, EffectInstance, ParameterKind};

use crate::estimation::nuisances::{BIAS_SHARE, CHARGE_DEVIATION};
use crate::log::FlightLog;
use crate::model::{ModelVersion, Source};
use crate::predict::{CHANNELS, Nuisances, PredictError, Predictor, Source as Kinematics};

/// Rounds; the last changes nothing that shows.
const ROUNDS: usize = 4;
/// Step of the differences in plausible sizes.
const STEP: f64 = 0.02;

/// A free parameter: place of its effect, name, size, accepted range.
struct Free {
    effect: usize,
    name: String,
    size: f64,
    range: (f64, f64),
}

struct OneLog {
    predictor: Predictor,
    nuisances: Nuisances,
}

impl OneLog {
    fn count(&self) -> usize {
        self.predictor.series().rotors + 1
    }

    fn size(&self, which: usize) -> f64 {
        if which + 1 < self.count() {
            BIAS_SHARE * self.predictor.nominal.hover_thrust_n
        } else {
            CHARGE_DEVIATION
        }
    }
}

fn shifted(nuisances: &Nuisances, which: usize, rotors: usize, by: f64) -> Nuisances {
    let mut moved = *nuisances;
    if which < rotors {
        moved.rotor_bias_n[which] += by;
    } else {
        moved.charge += by;
    }
    moved
}

fn nuisance(nuisances: &Nuisances, which: usize, rotors: usize) -> f64 {
    if which < rotors {
        nuisances.rotor_bias_n[which]
    } else {
        nuisances.charge
    }
}

/// The version with the effects that a diagnosis of these logs found fitted anew. Values by hand and from other logs stay.
///
/// # Errors
/// A log that cannot be held against the model, or effects that together make no vehicle.
pub fn refit(version: &ModelVersion, logs: &[FlightLog]) -> Result<ModelVersion, PredictError> {
    let catalogue = version.catalogue()?;
    let free = free_parameters(version, logs, &catalogue);
    if free.is_empty() {
        return Ok(version.clone());
    }
    let documents = version.documents();
    let mut states = logs
        .iter()
        .map(|log| {
            Ok(OneLog {
                predictor: Predictor::new(&documents, &[], &catalogue, log)?,
                nuisances: Nuisances::default(),
            })
        })
        .collect::<Result<Vec<_>, PredictError>>()?;
    let mut instances = version.instances();
    let mut cost = None;
    for _ in 0..ROUNDS {
        let (step, at) = gauss_newton(&states, &instances, &free)?;
        let before = *cost.get_or_insert(at);
        // Half steps until the cost falls.
        let mut share = 1.0;
        loop {
            let (trial, nuisances) = moved(&states, &instances, &free, &step, share);
            match total_cost(&states, &nuisances, &trial) {
                Ok(after) if after <= before => {
                    instances = trial;
                    for (state, own) in states.iter_mut().zip(nuisances) {
                        state.nuisances = own;
                    }
                    cost = Some(after);
                    break;
                }
                _ if share < 0.1 => break,
                _ => share *= 0.5,
            }
        }
        if cost.is_some_and(|after| before - after < 1e-3) {
            break;
        }
    }
    let mut fitted = version.clone();
    for (effect, instance) in fitted.effect.iter_mut().zip(&instances) {
        effect.parameters.clone_from(&instance.parameters);
    }
    Ok(fitted)
}

fn free_parameters(version: &ModelVersion, logs: &[FlightLog], catalogue: &Catalogue) -> Vec<Free> {
    let of_these = |hash: &str| logs.iter().any(|log| log.source.content_hash == hash);
    let mut free = Vec::new();
    for (place, effect) in version.effect.iter().enumerate() {
        let provenance = &effect.provenance;
        let own = provenance.source == Source::Diagnosis && provenance.log.iter().all(|log| of_these(&log.hash));
        let Some(declaration) = catalogue.find(&effect.effect).filter(|_| own) else {
            continue;
        };
        for p in declaration.parameters {
            let present = effect.parameters.contains_key(p.name);
            if present && p.kind == ParameterKind::Size && p.size > 0.0 {
                free.push(Free {
                    effect: place,
                    name: p.name.to_owned(),
                    size: p.size,
                    range: p.accepted(),
                });
            }
        }
    }
    free
}

/// Half the sum of squares of one log, priors included.
fn cost_of(state: &OneLog, nuisances: &Nuisances, instances: &[EffectInstance]) -> Result<f64, PredictError> {
    let residuals = state.predictor.residuals(nuisances, instances)?;
    let squares: f64 = residuals.whitened.iter().flatten().map(|r| r * r).sum();
    let rotors = state.count() - 1;
    let pull: f64 = (0..state.count())
        .map(|i| (nuisance(nuisances, i, rotors) / state.size(i)).powi(2))
        .sum();
    Ok(0.5 * (squares + pull))
}

fn total_cost(states: &[OneLog], nuisances: &[Nuisances], instances: &[EffectInstance]) -> Result<f64, PredictError> {
    let costs = states
        .iter()
        .zip(nuisances)
        .map(|(state, own)| cost_of(state, own, instances));
    costs.sum()
}

/// Step of all unknowns in their sizes (parameters first, then the nuisances of each log), and the cost at the present point.
fn gauss_newton(
    states: &[OneLog],
    instances: &[EffectInstance],
    free: &[Free],
) -> Result<(Vec<f64>, f64), PredictError> {
    let size = free.len() + states.iter().map(OneLog::count).sum::<usize>();
    let mut rows = vec![vec![0.0; size + 1]; size];
    let mut cost = 0.0;
    let mut offset = free.len();
    for state in states {
        let predictor = &state.predictor;
        let rotors = state.count() - 1;
        cost += cost_of(state, &state.nuisances, instances)?;
        let residual = predictor.residuals(&state.nuisances, instances)?.whitened;
        let smooth = |nuisances: &Nuisances, instances: &[EffectInstance]| {
            let set = predictor.effect_set(nuisances, instances)?;
            Ok::<_, PredictError>(predictor.predict(&set, Kinematics::Smooth, None))
        };
        let base = smooth(&state.nuisances, instances)?;
        let mut columns: Vec<(usize, [Option<Vec<f32>>; CHANNELS])> = Vec::new();
        let mut push = |place: usize, moved: crate::predict::Prediction, per: f64| {
            let column = std::array::from_fn(|channel| {
                let (a, b) = (&moved.channels[channel], &base.channels[channel]);
                if a == b {
                    return None;
                }
                predictor
                    .whitener(channel)
                    .map(|whitener| whitener.difference(a, b, per))
            });
            columns.push((place, column));
        };
        for (place, one) in free.iter().enumerate() {
            let mut trial = instances.to_vec();
            let value = trial[one.effect].parameters.get(&one.name).copied().unwrap_or(0.0);
            let mut step = STEP * one.size;
            if value + step > one.range.1 {
                step = -step;
            }
            trial[one.effect].parameters.insert(one.name.clone(), value + step);
            push(place, smooth(&state.nuisances, &trial)?, one.size / step);
        }
        for which in 0..state.count() {
            let step = if which < rotors { 0.5 } else { 0.01 };
            let trial = shifted(&state.nuisances, which, rotors, step * state.size(which));
            push(offset + which, smooth(&trial, instances)?, 1.0 / step);
        }
        for (i, one) in &columns {
            for (j, other) in &columns {
                rows[*i][*j] += (0..CHANNELS)
                    .filter_map(|c| Some(dot(one[c].as_ref()?, other[c].as_ref()?)))
                    .sum::<f64>();
            }
            rows[*i][size] += (0..CHANNELS)
                .filter_map(|c| {
                    Some(
                        one[c]
                            .as_ref()?
                            .iter()
                            .zip(&residual[c])
                            .map(|(a, r)| f64::from(*a) * r)
                            .sum::<f64>(),
                    )
                })
                .sum::<f64>();
        }
        for which in 0..state.count() {
            let i = offset + which;
            rows[i][i] += 1.0;
            rows[i][size] -= nuisance(&state.nuisances, which, rotors) / state.size(which);
        }
        offset += state.count();
    }
    for (i, row) in rows.iter_mut().enumerate().take(free.len()) {
        // A parameter that these logs do not see stays where it is.
        row[i] += 1e-6;
    }
    Ok((solve(rows), cost))
}

fn moved(
    states: &[OneLog],
    instances: &[EffectInstance],
    free: &[Free],
    step: &[f64],
    share: f64,
) -> (Vec<EffectInstance>, Vec<Nuisances>) {
    let mut trial = instances.to_vec();
    for (one, step) in free.iter().zip(step) {
        let value = trial[one.effect].parameters.entry(one.name.clone()).or_insert(0.0);
        *value = (*value + share * step * one.size).clamp(one.range.0, one.range.1);
    }
    let mut at = free.len();
    let nuisances = states
        .iter()
        .map(|state| {
            let rotors = state.count() - 1;
            let mut own = state.nuisances;
            for which in 0..state.count() {
                own = shifted(&own, which, rotors, share * step[at + which] * state.size(which));
            }
            at += state.count();
            own
        })
        .collect();
    (trial, nuisances)
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(x, y)| f64::from(*x) * f64::from(*y)).sum()
}

/// Solves a positive definite system whose right side is the last column.
fn solve(mut rows: Vec<Vec<f64>>) -> Vec<f64> {
    let n = rows.len();
    for i in 0..n {
        for j in i + 1..n {
            let factor = rows[j][i] / rows[i][i];
            if factor == 0.0 {
                continue;
            }
            let (above, below) = rows.split_at_mut(j);
            for (x, y) in below[0][i..].iter_mut().zip(&above[i][i..]) {
                *x -= factor * y;
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
