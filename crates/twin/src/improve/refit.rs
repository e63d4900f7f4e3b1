//! The joint fit of a version's effects to the logs that they were found on: least squares on the whitened residuals
//! ([`crate::estimation`]), nuisances of each log included, without clutter.
//!
//! The diagnosis fits with clutter on every other parameter of its library, which is right for deciding and for
//! intervals. The resulting model has no clutter; its values are the best without.
//!
//! As everywhere here, residuals are of raw data and sensitivities of smoothed kinematics, so that noise does not shrink the values.

use rotortwin_plant::effects::{Catalogue, EffectInstance, ParameterKind};

use crate::estimation::columns::{Base, Column, LogState, STEP, hooks_of};
use crate::estimation::gram::{column_product, residual_product};
use crate::estimation::least_squares::{Control, LeastSquares, Unknown, minimise};
use crate::estimation::normal::Normal;
use crate::estimation::nuisances::{self, Reach};
use crate::log::FlightLog;
use crate::model::{ModelVersion, Source};
use crate::predict::{CHANNELS, PerChannel, PredictError, Predictor};

/// The last step changes nothing that shows.
const CONTROL: Control = Control {
    steps: 4,
    dampings: 4,
    damping: 0.0,
    least_fall: 2e-3,
    least_share: 0.0,
};

/// A free parameter: place of its effect, name, size, accepted range.
struct Free {
    effect: usize,
    name: String,
    size: f64,
    range: (f64, f64),
}

/// Logs whose nuisances move, and effects whose free parameters do. Unknowns are the parameters in plausible sizes, then the nuisances
/// of each log in prior deviations.
struct Flights {
    logs: Vec<LogState>,
    effects: Vec<EffectInstance>,
    free: Vec<Free>,
    /// Whitened residuals of the point whose cost was taken last.
    residuals: Vec<PerChannel>,
}

/// The version with the effects that a diagnosis of these logs found fitted anew. Values by hand and from other logs stay. A parameter
/// that these logs do not see stays, too.
///
/// # Errors
/// A log that cannot be compared with the model, or effects that together yield an invalid configuration.
pub fn refit(version: &ModelVersion, logs: &[FlightLog]) -> Result<ModelVersion, PredictError> {
    let catalogue = version.catalogue()?;
    let free = free_parameters(version, logs, &catalogue);
    if free.is_empty() {
        return Ok(version.clone());
    }
    let documents = version.documents();
    let mut flights = Flights {
        logs: logs
            .iter()
            .map(|log| {
                let predictor = Predictor::new(&documents, &[], &catalogue, log)?;
                Ok(LogState::new(
                    predictor
                        .with_chart(version.guesses_its_chart())
                        .with_own_wind(version.wind_of_each_flight),
                ))
            })
            .collect::<Result<_, PredictError>>()?,
        effects: version.instances(),
        free,
        residuals: Vec::new(),
    };
    let (unknowns, start) = (flights.unknowns(), flights.position());
    let minimum = minimise(&mut flights, &unknowns, &start, &CONTROL)?;
    flights.move_to(&minimum.at);
    let mut fitted = version.clone();
    for (effect, instance) in fitted.effect.iter_mut().zip(&flights.effects) {
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

impl Flights {
    fn unknowns(&self) -> Vec<Unknown> {
        let own = self
            .free
            .iter()
            .map(|one| Unknown::within(one.range.0 / one.size, one.range.1 / one.size));
        let nuisances = self
            .logs
            .iter()
            .flat_map(|log| nuisances::unknowns(log, Reach::Plausible));
        own.chain(nuisances).collect()
    }

    fn value(&self, one: &Free) -> f64 {
        self.effects[one.effect]
            .parameters
            .get(&one.name)
            .copied()
            .unwrap_or(0.0)
    }

    fn position(&self) -> Vec<f64> {
        let own = self.free.iter().map(|one| self.value(one) / one.size);
        own.chain(self.logs.iter().flat_map(LogState::position)).collect()
    }

    fn move_to(&mut self, position: &[f64]) {
        let (own, mut rest) = position.split_at(self.free.len());
        for (one, x) in self.free.iter().zip(own) {
            let value = (x * one.size).clamp(one.range.0, one.range.1);
            self.effects[one.effect].parameters.insert(one.name.clone(), value);
        }
        for log in &mut self.logs {
            let mine;
            (mine, rest) = rest.split_at(log.nuisance_count());
            log.move_to(mine);
        }
    }

    /// Column of a free parameter in one log, per plausible size.
    fn column(&self, log: &LogState, base: &Base, one: &Free) -> Result<Column, PredictError> {
        let value = self.value(one);
        let step = STEP * one.size;
        let step = if value + step > one.range.1 { -step } else { step };
        let mut moved = self.effects.clone();
        moved[one.effect].parameters.insert(one.name.clone(), value + step);
        let hooks = hooks_of(&log.predictor, &moved[one.effect])?;
        let set = log.predictor.effect_set(&log.nuisances, &moved)?;
        Ok(log.column(base, &set, hooks, one.size / step))
    }
}

impl LeastSquares for Flights {
    type Error = PredictError;

    fn cost(&mut self, at: &[f64]) -> Result<f64, PredictError> {
        self.move_to(at);
        self.residuals = self
            .logs
            .iter()
            .map(|log| log.residual(&self.effects))
            .collect::<Result<_, _>>()?;
        Ok(self.residuals.iter().flatten().flatten().map(|r| r * r).sum())
    }

    fn linearise(&mut self, at: &[f64]) -> Result<Normal, PredictError> {
        if self.residuals.is_empty() {
            self.cost(at)?;
        }
        self.move_to(at);
        let weights = [1.0; CHANNELS];
        let mut normal = Normal::zero(at.len());
        let mut offset = self.free.len();
        for (log, residual) in self.logs.iter().zip(&self.residuals) {
            let base = log.base(&self.effects)?;
            let mut columns: Vec<(usize, Column)> = Vec::new();
            for (place, one) in self.free.iter().enumerate() {
                columns.push((place, self.column(log, &base, one)?));
            }
            columns.extend((offset..).zip(log.nuisance_columns(&self.effects, &base)?));
            for (n, (i, one)) in columns.iter().enumerate() {
                for (j, other) in &columns[..=n] {
                    let product = column_product(one, other, &weights);
                    *normal.matrix.at_mut(*i, *j) += product;
                    if i != j {
                        *normal.matrix.at_mut(*j, *i) += product;
                    }
                }
                normal.gradient[*i] += residual_product(one, residual, &weights);
            }
            normal.square_sum += residual.iter().flatten().map(|r| r * r).sum::<f64>();
            offset += log.nuisance_count();
        }
        Ok(normal)
    }
}
