//! Columns of a flight's Jacobian by finite differences: the change of the whitened prediction with a nuisance, a
//! parameter, a wind.
//!
//! A column is the change of the whitened prediction per plausible size, on smoothed kinematics; channels that an effect leaves alone
//! have none, and stages of the pass that it leaves alone are not run. Columns are f32: they are whitened and of order 1 to 10³.

use std::sync::Arc;

use rayon::prelude::*;
use rotortwin_plant::effects::{EffectInstance, EffectSet, Hooks};

use super::candidates::Library;
use crate::predict::{CHANNELS, Nuisances, PerChannel, PredictError, Prediction, Predictor, Source};

/// Prior deviation of a rotor's lift error over its hover thrust: uniform in ±10.756 mN (§6) on 2.534 N.
pub(crate) const BIAS_SHARE: f64 = 0.002_45;
/// No lift error goes beyond this, over hover thrust (§6: 0.00424). Long flights overrule any prior; without a bound the biases of all
/// rotors together would hide a wrong mass.
pub(crate) const LARGEST_BIAS: f64 = 0.006;
/// Prior deviation of the charge at the start, fraction.
pub(crate) const CHARGE_DEVIATION: f64 = 0.25;

/// Prior deviation of each horizontal component of the wind of a flight, m/s, and the largest: row 4 of the catalogue.
pub(crate) const WIND_DEVIATION_M_S: f64 = 3.0;
pub(crate) const LARGEST_WIND_M_S: f64 = 15.0;

/// Step of the differences in plausible sizes.
pub(crate) const STEP: f64 = 0.02;

/// Step of the wind, m/s.
const WIND_STEP_M_S: f64 = 0.2;

/// One column: nothing where a channel is not touched.
pub(crate) type Column = Arc<[Option<Vec<f32>>; CHANNELS]>;

/// An effect at work in the fit, beyond those of the model.
#[derive(Debug, Clone)]
pub(crate) struct Active {
    pub(crate) candidate: usize,
    pub(crate) values: Vec<f64>,
    pub(crate) onset_s: Option<f64>,
}

/// One log under diagnosis.
#[derive(Debug, Clone)]
pub(crate) struct LogState {
    pub(crate) predictor: Predictor,
    pub(crate) nuisances: Nuisances,
}

impl LogState {
    /// Before anything is fitted.
    pub(crate) fn new(predictor: Predictor) -> Self {
        Self {
            predictor,
            nuisances: Nuisances::default(),
        }
    }

    /// Rotor biases, the charge, and where each flight has a wind of its own its components north and east.
    pub(crate) fn nuisance_count(&self) -> usize {
        self.charge_place() + if self.predictor.has_own_wind() { 3 } else { 1 }
    }

    /// Place of the charge among the nuisances.
    pub(crate) fn charge_place(&self) -> usize {
        self.predictor.series().rotors
    }

    /// Places of the nuisances whose columns depend on where they and the effects are: the open-circuit voltage has kinks, and a wind acts
    /// through the drag.
    pub(crate) fn bent_nuisances(&self) -> std::ops::Range<usize> {
        self.charge_place()..self.nuisance_count()
    }

    /// Prior deviation of a nuisance in its own unit.
    pub(crate) fn nuisance_size(&self, which: usize) -> f64 {
        match which.checked_sub(self.charge_place()) {
            None => BIAS_SHARE * self.predictor.nominal.hover_thrust_n,
            Some(0) => CHARGE_DEVIATION,
            Some(_) => WIND_DEVIATION_M_S,
        }
    }

    pub(crate) fn nuisance(&self, which: usize) -> f64 {
        match which.checked_sub(self.charge_place()) {
            None => self.nuisances.rotor_bias_n[which],
            Some(0) => self.nuisances.charge,
            Some(wind) => self.nuisances.wind_m_s[wind - 1],
        }
    }

    pub(crate) fn set_nuisance(&mut self, which: usize, value: f64) {
        let charge = self.charge_place();
        set(&mut self.nuisances, charge, which, value);
    }

    /// Bounds of a nuisance in its own unit: no lift error goes beyond [`LARGEST_BIAS`], no battery holds less than nothing or more
    /// than it can, and nobody flies in a storm.
    pub(crate) fn nuisance_bounds(&self, which: usize) -> (f64, f64) {
        match which.checked_sub(self.charge_place()) {
            None => {
                let most = LARGEST_BIAS * self.predictor.nominal.hover_thrust_n;
                (-most, most)
            }
            Some(0) => {
                let charge = self.predictor.initial_charge();
                (-charge, 1.0 - charge)
            }
            Some(_) => (-LARGEST_WIND_M_S, LARGEST_WIND_M_S),
        }
    }

    /// As much of a step as stays within the bounds, both in prior deviations.
    pub(crate) fn nuisance_step(&self, which: usize, step: f64) -> f64 {
        let (now, size, (low, high)) = (
            self.nuisance(which),
            self.nuisance_size(which),
            self.nuisance_bounds(which),
        );
        let to = now + step * size;
        if (low..=high).contains(&to) {
            step
        } else {
            (to.clamp(low, high) - now) / size
        }
    }

    /// Moves a nuisance by a step in prior deviations, within its bounds.
    pub(crate) fn move_nuisance(&mut self, which: usize, step: f64) {
        let value = self.nuisance(which) + self.nuisance_step(which, step) * self.nuisance_size(which);
        self.set_nuisance(which, value);
    }

    /// Where the nuisances stand, in prior deviations.
    pub(crate) fn position(&self) -> Vec<f64> {
        let of = |which| self.nuisance(which) / self.nuisance_size(which);
        (0..self.nuisance_count()).map(of).collect()
    }

    /// Moves the nuisances there.
    pub(crate) fn move_to(&mut self, position: &[f64]) {
        for (which, x) in position.iter().enumerate() {
            self.set_nuisance(which, x * self.nuisance_size(which));
        }
    }
}

/// Sets the nuisance at a place, where the charge is at `charge`.
fn set(nuisances: &mut Nuisances, charge: usize, which: usize, value: f64) {
    match which.checked_sub(charge) {
        None => nuisances.rotor_bias_n[which] = value,
        Some(0) => nuisances.charge = value,
        Some(wind) => nuisances.wind_m_s[wind - 1] = value,
    }
}

/// All results, or the first refusal in their order: which thread is first must not choose the sentence.
pub(crate) fn in_order<T: Send>(
    results: impl ParallelIterator<Item = Result<T, PredictError>>,
) -> Result<Vec<T>, PredictError> {
    results.collect::<Vec<_>>().into_iter().collect()
}

/// Instances of the active effects.
pub(crate) fn instances(library: &Library, active: &[Active]) -> Vec<EffectInstance> {
    active
        .iter()
        .filter_map(|a| library.candidates[a.candidate].instance(&a.values, a.onset_s))
        .collect()
}

/// Hooks of an effect alone; all if it sets in late, because then its constants are not there at the start.
pub(crate) fn hooks_of(predictor: &Predictor, instance: &EffectInstance) -> Result<Hooks, PredictError> {
    if instance.onset_s.is_some() {
        return Ok(Hooks::VARYING_CONSTANTS);
    }
    predictor.hooks_of(instance)
}

/// Base of a linearisation on smoothed kinematics.
pub(crate) struct Base {
    pub(crate) set: EffectSet,
    pub(crate) prediction: Prediction,
}

impl LogState {
    pub(crate) fn base(&self, effects: &[EffectInstance]) -> Result<Base, PredictError> {
        let set = self.predictor.effect_set(&self.nuisances, effects)?;
        let prediction = self.predictor.predict(&set, Source::Smooth, None);
        Ok(Base { set, prediction })
    }

    /// Whitened residual at a point.
    pub(crate) fn residual(&self, effects: &[EffectInstance]) -> Result<PerChannel, PredictError> {
        let set = self.predictor.effect_set(&self.nuisances, effects)?;
        Ok(self
            .predictor
            .whitened(&self.predictor.predict(&set, Source::Raw, None)))
    }

    /// Change of the whitened prediction from `base` to the vehicle with `set`, times `per`; `hooks` are those that differ.
    pub(crate) fn column(&self, base: &Base, set: &EffectSet, hooks: Hooks, per: f64) -> Column {
        let stages = self.predictor.stages(base.set.constants(), set.constants(), hooks);
        let moved = self
            .predictor
            .predict(set, Source::Smooth, Some((&base.prediction, stages)));
        Arc::new(std::array::from_fn(|channel| {
            let (a, b) = (&moved.channels[channel], &base.prediction.channels[channel]);
            if Arc::ptr_eq(a, b) || a == b {
                return None;
            }
            self.predictor
                .whitener(channel)
                .map(|whitener| whitener.difference(a, b, per))
        }))
    }

    /// Column of a nuisance, per prior deviation.
    pub(crate) fn nuisance_column(
        &self,
        effects: &[EffectInstance],
        base: &Base,
        which: usize,
    ) -> Result<Column, PredictError> {
        let mut moved = self.nuisances;
        let size = self.nuisance_size(which);
        let (step, hooks) = match which.checked_sub(self.charge_place()) {
            None => (0.5 * size, Hooks::CONSTANTS),
            Some(0) => (0.01 * size, Hooks::CONSTANTS),
            Some(_) => (WIND_STEP_M_S, Hooks::NONE),
        };
        set(&mut moved, self.charge_place(), which, self.nuisance(which) + step);
        let set = self.predictor.effect_set(&moved, effects)?;
        Ok(self.column(base, &set, hooks, size / step))
    }

    /// Columns of all nuisances.
    pub(crate) fn nuisance_columns(
        &self,
        effects: &[EffectInstance],
        base: &Base,
    ) -> Result<Vec<Column>, PredictError> {
        let column = |which| self.nuisance_column(effects, base, which);
        in_order((0..self.nuisance_count()).into_par_iter().map(column))
    }

    /// Column of a parameter of a candidate, per plausible size, about the active effects.
    pub(crate) fn parameter_column(
        &self,
        library: &Library,
        active: &[Active],
        base: &Base,
        candidate: usize,
        parameter: usize,
    ) -> Result<Column, PredictError> {
        let entry = &library.candidates[candidate];
        let declared = &entry.parameters[parameter];
        let mut moved = active.to_vec();
        let place = match moved.iter().position(|a| a.candidate == candidate) {
            Some(place) => place,
            None => {
                moved.push(Active {
                    candidate,
                    values: entry.neutral(),
                    onset_s: None,
                });
                moved.len() - 1
            }
        };
        let now = moved[place].values[parameter];
        let (low, high) = declared.accepted();
        let mut step = STEP * declared.size;
        if now + step > high || (now == 0.0 && declared.plausible_high <= 0.0) {
            step = -step;
        }
        if now + step < low {
            step = 0.5 * (low - now);
        }
        if step == 0.0 {
            return Ok(Arc::new(std::array::from_fn(|_| None)));
        }
        let mut made = self.stepped(library, &mut moved, place, parameter, (now, step));
        if made.is_err() {
            // At the limit of valid vehicles only the other side remains.
            step = -step;
            made = self.stepped(library, &mut moved, place, parameter, (now, step));
        }
        let Some((set, hooks)) = made? else {
            return Ok(Arc::new(std::array::from_fn(|_| None)));
        };
        Ok(self.column(base, &set, hooks, declared.size / step))
    }

    /// The vehicle with one parameter of an effect at `now + step`; `None` if the effect then does nothing.
    fn stepped(
        &self,
        library: &Library,
        moved: &mut [Active],
        place: usize,
        parameter: usize,
        (now, step): (f64, f64),
    ) -> Result<Option<(EffectSet, Hooks)>, PredictError> {
        moved[place].values[parameter] = now + step;
        let entry = &library.candidates[moved[place].candidate];
        let Some(instance) = entry.instance(&moved[place].values, moved[place].onset_s) else {
            return Ok(None);
        };
        let hooks = hooks_of(&self.predictor, &instance)?;
        let set = self.predictor.effect_set(&self.nuisances, &instances(library, moved))?;
        Ok(Some((set, hooks)))
    }

    /// Column of a steady wind along an axis of NED, per 1 m/s: the influence of a gust at that moment.
    pub(crate) fn wind_column(
        &self,
        library: &Library,
        active: &[Active],
        base: &Base,
        axis: usize,
    ) -> Result<Column, PredictError> {
        let mut wind = [0.0; 3];
        wind[axis] = WIND_STEP_M_S;
        let set = self
            .predictor
            .effect_set_in_wind(&self.nuisances, &instances(library, active), wind)?;
        Ok(self.column(base, &set, Hooks::NONE, 1.0 / WIND_STEP_M_S))
    }

    /// Column by a secant: from `base` to the point with `active`, whose last effect differs, times `per`.
    pub(crate) fn secant(
        &self,
        library: &Library,
        active: &[Active],
        base: &Base,
        per: f64,
    ) -> Result<Column, PredictError> {
        let instances = instances(library, active);
        let hooks = match instances.last() {
            Some(last) => hooks_of(&self.predictor, last)?,
            None => Hooks::NONE,
        };
        let set = self.predictor.effect_set(&self.nuisances, &instances)?;
        Ok(self.column(base, &set, hooks, per))
    }
}
