//! Properties of each flight that no model knows are fitted before any comparison: constant lift errors of the rotors,
//! the charge at take-off, and the wind where the model gives each flight one of its own. Gauss–Newton on the whitened residuals, with priors and bounds.
//!
//! One fit for all: `compare`, `diagnose` and `propose` start from the same nuisances of a flight. As everywhere in the
//! twin, residuals use raw data and sensitivities smoothed kinematics, so that noise does not shrink the values.

use rotortwin_plant::effects::EffectInstance;

use super::columns::{Column, LogState};
use super::gram::{column_product, residual_product};
use super::least_squares::{Control, LeastSquares, Unknown, minimise};
use super::normal::{Normal, not_finite};
use crate::predict::{CHANNELS, Nuisances, PerChannel, PredictError};

/// The biases are linear, and the voltage nearly so in the charge but for the kinks of the chart. A square sum that falls by less than
/// this moves no value by more than a twentieth of its deviation.
const CONTROL: Control = Control {
    steps: 6,
    dampings: 4,
    damping: 0.0,
    least_fall: 2.5e-3,
    least_share: 0.0,
};

/// How far the biases of the rotors may go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reach {
    /// As far as those of real rotors do.
    Plausible,
    /// Anywhere: how far they must go is then a measure of how wrong a model is.
    Anywhere,
}

/// The nuisances of a log as unknowns, in prior deviations.
pub(crate) fn unknowns(log: &LogState, reach: Reach) -> Vec<Unknown> {
    (0..log.nuisance_count())
        .map(|which| {
            let (low, high) = log.nuisance_bounds(which);
            let size = log.nuisance_size(which);
            match reach {
                Reach::Anywhere if which < log.charge_place() => Unknown::unit(f64::INFINITY),
                Reach::Plausible | Reach::Anywhere => Unknown {
                    deviation: 1.0,
                    low: low / size,
                    high: high / size,
                },
            }
        })
        .collect()
}

/// The most probable nuisances of a log under its model and `effects`, starting from their present values.
///
/// # Errors
/// The effects together yield an invalid vehicle.
pub(crate) fn fit(log: &LogState, effects: &[EffectInstance], reach: Reach) -> Result<Nuisances, PredictError> {
    let start = log.position();
    let mut flight = Flight {
        log: log.clone(),
        effects,
        residual: None,
        columns: Vec::new(),
    };
    let minimum = minimise(&mut flight, &unknowns(log, reach), &start, &CONTROL)?;
    flight.log.move_to(&minimum.at);
    Ok(flight.log.nuisances)
}

/// A flight whose nuisances move.
struct Flight<'a> {
    log: LogState,
    effects: &'a [EffectInstance],
    /// Whitened residual of the point whose cost was taken last.
    residual: Option<PerChannel>,
    columns: Vec<Column>,
}

impl LeastSquares for Flight<'_> {
    type Error = PredictError;

    fn cost(&mut self, at: &[f64]) -> Result<f64, PredictError> {
        self.log.move_to(at);
        let residual = self.log.residual(self.effects)?;
        let squares = residual.iter().flatten().map(|r| r * r).sum();
        self.residual = Some(residual);
        Ok(squares)
    }

    fn linearise(&mut self, at: &[f64]) -> Result<Normal, PredictError> {
        self.log.move_to(at);
        if self.columns.is_empty() {
            self.cost(at)?;
            let base = self.log.base(self.effects)?;
            self.columns = self.log.nuisance_columns(self.effects, &base)?;
        } else {
            let base = self.log.base(self.effects)?;
            for which in self.log.bent_nuisances() {
                self.columns[which] = self.log.nuisance_column(self.effects, &base, which)?;
            }
        }
        let weights = [1.0; CHANNELS];
        let mut normal = Normal::zero(self.columns.len());
        for (i, a) in self.columns.iter().enumerate() {
            for (j, b) in self.columns.iter().enumerate().take(i + 1) {
                let product = column_product(a, b, &weights);
                *normal.matrix.at_mut(i, j) = product;
                *normal.matrix.at_mut(j, i) = product;
            }
        }
        if let Some(residual) = &self.residual {
            for (g, column) in normal.gradient.iter_mut().zip(&self.columns) {
                *g = residual_product(column, residual, &weights);
            }
            normal.square_sum = residual.iter().flatten().map(|r| r * r).sum();
        }
        if normal.square_sum.is_nan() {
            return Err(not_finite());
        }
        Ok(normal)
    }
}
