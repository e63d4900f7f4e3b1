//! Prediction of a flight by a model: sixteen residual channels in measurement space, one step ahead, and whitened.
//!
//! ```text
//! FlightLog ─▶ series (uniform grid, raw and smoothed) ─▶ pass (actuators, body, kinematics, battery) ─▶ prediction
//!                    └▶ noise ─▶ whiten ◀──────────────────────────────────────────── residual = measured − prediction
//! ```
//! * F: accelerometer against force/mass · KV: v̇ against R a + g · M: ω̇ against J⁻¹(τ − ω × Jω) · KA: η̇ against T(η)ω ·
//!   KP: ṗ against v · V: battery voltage. Missing columns drop channels; [`Predictor::notes`] says which and why.
//! * Dynamic effects show in F and M, sensor effects in the kinematic channels, battery effects in V.
//!
//! Limits: one constant rate a log; the noise of a reading is white, or white enough after the adaptive scale of the diagnosis;
//! the thrust at the start of the log is taken as settled (the first 0.4 s carry no weight).

pub mod channels;
pub mod noise;
pub(crate) mod pass;
pub mod series;
mod supply;
pub(crate) mod vectors;
mod vehicle_size;
mod whiten;

use std::sync::Arc;

use nalgebra::{Matrix4, Vector4};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::Vector3;
use rotortwin_plant::effects::{Catalogue, Constants, EffectClass, EffectInstance, EffectSet, Hooks};
use rotortwin_plant::error::Refusal;
use rotortwin_plant::powertrain::battery::Battery;
use rotortwin_scenario::VehicleDocuments;
use supply::Readings;

pub use channels::{CHANNELS, NAMES, PerChannel, UNITS};
use channels::{F, KA, KP, KV, M, V};
pub use noise::NoiseModel;
pub use series::{Drive, Series};
pub use whiten::{Covariance, RateNoise, Whitener};

pub(crate) use pass::{Plant, Power, Prediction, Source, Stages};
pub(crate) use vehicle_size::VehicleSize;

use crate::log::FlightLog;

/// Thrust over commanded thrust below which no plausible mass, air or voltage of a vehicle explains a commanded wrench.
const COMMAND_SCALE_LOW: f64 = 0.75;
/// Largest time constant of the observer of the rates, s: if the model is wrong by an angular acceleration, the
/// predicted rates are wrong by this times that.
const RATES_SETTLE_S: f64 = 0.01;

/// Why a log cannot be compared with a model: one sentence.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PredictError(pub String);

impl From<Refusal> for PredictError {
    fn from(refusal: Refusal) -> Self {
        Self(sentence_of(&refusal))
    }
}

/// What every flight has and no model contains: constant errors of the rotors' lift, the initial charge, and, where the model says so, the
/// wind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nuisances {
    /// Added to the static lift of each rotor, N.
    pub rotor_bias_n: [f64; MAX_ROTORS],
    /// Added to the charge at the start, fraction.
    pub charge: f64,
    /// Wind of this flight beside that of the model, north and east, m/s; 0 unless the model gives each flight a wind of its own.
    pub wind_m_s: [f64; 2],
}

impl Default for Nuisances {
    fn default() -> Self {
        Self {
            rotor_bias_n: [0.0; MAX_ROTORS],
            charge: 0.0,
            wind_m_s: [0.0; 2],
        }
    }
}

/// Residuals of all channels; an unavailable channel is empty.
#[derive(Debug, Clone)]
pub struct ChannelResiduals {
    /// Measured minus predicted, in the units of [`UNITS`]; NaN where nothing was measured.
    pub raw: PerChannel,
    /// Divided by the noise, without correlation: chi² is the sum of squares. 0 where masked.
    pub whitened: PerChannel,
    /// Deviation of a single sample of `raw` from noise alone.
    pub noise_floor: [f64; CHANNELS],
    /// Samples that count.
    pub mask: [Vec<bool>; CHANNELS],
}

/// How far the resting voltage of a cell moves from the common chart, V, over this share of the charge: charts of LiPo cells in use lie
/// 20 to 40 mV apart, along most of their length.
const CHART_ERROR_V: f64 = 0.015;
const CHART_STRETCH: f64 = 0.2;

/// Lags of the thrust after which nothing is left of a command: e⁻⁶ of it.
const FORGOTTEN: f64 = 6.0;

/// Means of the voltage.
#[derive(Debug, Clone)]
pub(crate) struct CoarseVoltage {
    powers: Vec<Power>,
    /// Change of the mean powers with each of the shifts of a caller.
    slopes: Vec<(usize, Vec<f64>)>,
    stride: usize,
    places: Vec<usize>,
    /// V.
    pub(crate) measured: Vec<f64>,
    /// 1/variance of a mean, 1/V².
    pub(crate) weight: f64,
}

impl CoarseVoltage {
    /// Takes the slope of the powers with shift `which` from another base: their difference times `per`.
    pub(crate) fn slope_towards(&mut self, other: &Self, which: usize, per: f64) {
        let rise = self.powers.iter().zip(&other.powers);
        self.slopes
            .push((which, rise.map(|(a, b)| (b.mean - a.mean) * per).collect()));
    }
}

/// A model, a log, and everything needed to compare the two.
#[derive(Debug, Clone)]
pub struct Predictor {
    pub(crate) plant: Plant,
    pub(crate) nominal: Constants,
    catalogue: Catalogue,
    model: Vec<EffectInstance>,
    noise: NoiseModel,
    covariances: [Covariance; CHANNELS],
    // Shared, because fits keep copies of a log.
    whiteners: Arc<[Option<Whitener>; CHANNELS]>,
    /// Of the angular accelerations with the assumed noise, once [`Self::tune`] has replaced it.
    assumed: Option<Arc<[Option<Whitener>; 3]>>,
    rate_noise: [RateNoise; 3],
    forgives_the_chart: bool,
    has_own_wind: bool,
    /// Name of the log.
    pub name: String,
}

impl Predictor {
    /// A vehicle with the effects of its model, and a log.
    ///
    /// # Errors
    /// One sentence: the log is too short, has another number of rotors than the vehicle, or an effect of the model is
    /// not valid.
    pub fn new(
        documents: &VehicleDocuments,
        effects: &[EffectInstance],
        catalogue: &Catalogue,
        log: &FlightLog,
    ) -> Result<Self, PredictError> {
        let nominal = Constants::nominal(&documents.vehicle);
        let allocate = allocation(&nominal);
        let series = Series::new(log, nominal.rotor_count, allocate).map_err(PredictError)?;
        let readings = Readings::of(&series);
        let noise = NoiseModel::of(&series, &nominal, readings.deviation(), |accel_m_s2| {
            readings.coarse_error(&series, accel_m_s2, &nominal)
        });
        let step_s = series.step_s;
        let covariances = noise.covariances(step_s);
        let mut plant = Plant {
            blade: *documents.nominal_blade(),
            battery_model: documents.vehicle.battery.clone(),
            charge: 0.75,
            unlogged_voltage: 0.0,
            rate_gain: [0, 1, 2].map(|axis| rate_gain(covariances[channels::M + axis], series.step_s)),
            persistent_voltage: readings.persist(),
            supply: None,
            series: Arc::new(series),
        };
        plant.charge = initial_charge(&plant, &nominal);
        plant.unlogged_voltage = under_hover_load(&plant, &nominal);
        let mut predictor = Self {
            plant,
            nominal,
            catalogue: catalogue.clone(),
            model: effects.to_vec(),
            noise,
            covariances,
            whiteners: Arc::new(std::array::from_fn(|_| None)),
            assumed: None,
            forgives_the_chart: false,
            has_own_wind: false,
            rate_noise: [0, 1, 2].map(|axis| RateNoise {
                reading: noise.rates_rad_s,
                white: noise.torque_floor_rad_s2[axis] * step_s / noise.rates_rad_s,
                drift: 0.0,
            }),
            name: log.name.clone(),
        };
        let set = predictor.effect_set(&Nuisances::default(), &[])?;
        let mut first = predictor.predict(&set, Source::Raw, None);
        if let Some(scale) = predictor.command_scale(&first) {
            let series = Arc::make_mut(&mut predictor.plant.series);
            series.scale_command(scale);
            first = predictor.predict(&set, Source::Raw, None);
        }
        if noise.supply_m_s2 > 0.0 {
            let supply = supply::smoothed(predictor.series(), &readings, &predictor.nominal, &first.thrust);
            let series = Arc::make_mut(&mut predictor.plant.series);
            series.notes.push(
                "single readings of the voltage are too coarse to drive the rotors of the model: means over a second and the sag under the model's current \
                 are taken, and what they leave open counts as noise of the force"
                    .to_owned(),
            );
            predictor.plant.supply = Some(Arc::new(supply));
            first = predictor.predict(&set, Source::Raw, None);
        }
        let weight = predictor.nominal.mass_kg * predictor.nominal.gravity_m_s2;
        let flying = predictor.plant.series.flying(&first.thrust, weight);
        if !flying.iter().any(|&f| f) {
            return Err(PredictError(format!(
                "{}: expected a flight, the rotors of the model never lift the vehicle (all duties too small?)",
                log.name
            )));
        }
        let settled = predictor.settled();
        let mut whiteners: [Option<Whitener>; CHANNELS] = std::array::from_fn(|_| None);
        for channel in 0..CHANNELS {
            let measured = pass::measured_channel(predictor.series(), channel);
            if measured.is_empty() || first.channels[channel].is_empty() {
                continue;
            }
            let mask: Vec<bool> = flying
                .iter()
                .zip(&measured)
                .zip(first.channels[channel].iter())
                .enumerate()
                .map(|(k, ((&flies, m), p))| {
                    let by_thrust = matches!(channel, F..KV | M..KA | V);
                    flies
                        && m.is_finite()
                        && p.is_finite()
                        && predictor.plant.series.known(channel, k)
                        && (settled[k] || !by_thrust)
                })
                .collect();
            if mask.iter().any(|&m| m) {
                whiteners[channel] = Some(Whitener::new(covariances[channel], &mask));
            }
        }
        predictor.whiteners = Arc::new(whiteners);
        Ok(predictor)
    }

    /// The same, where slow errors of the voltage may be those of a battery's chart that nobody measured.
    pub(crate) fn with_chart(mut self, is_guess: bool) -> Self {
        if is_guess {
            self.forgive_the_chart();
        }
        self
    }

    /// The same, where each flight may have a steady wind of its own, which is fitted with its other nuisances.
    pub(crate) fn with_own_wind(mut self, has_own_wind: bool) -> Self {
        self.has_own_wind = has_own_wind;
        self
    }

    /// True if a wind is fitted to this flight.
    pub(crate) fn has_own_wind(&self) -> bool {
        self.has_own_wind
    }

    fn forgive_the_chart(&mut self) {
        let (step_s, white) = (self.plant.series.step_s, self.covariances[V].variance.sqrt());
        let cells = f64::from(self.plant.battery_model.cells);
        let current = hover_power(&self.nominal) / self.plant.unlogged_voltage.max(1.0);
        let stretch_s = CHART_STRETCH * self.plant.battery_model.capacity_ah * 3600.0 / current.max(f64::MIN_POSITIVE);
        let error = cells * CHART_ERROR_V;
        if let Some(whitener) = &mut Arc::make_mut(&mut self.whiteners)[V] {
            // The charge at the start takes up the error there.
            *whitener = whitener.with_walk(white, error * (step_s / stretch_s).sqrt(), white);
            self.forgives_the_chart = true;
        }
    }

    /// True if slow errors of the voltage say nothing, because the battery's chart is a guess.
    pub(crate) fn forgives_the_chart(&self) -> bool {
        self.forgives_the_chart
    }

    /// False for samples in a gap of the log and after it, until the rotors have forgotten what they were commanded there.
    fn settled(&self) -> Vec<bool> {
        let series = self.series();
        let lag_s = self.nominal.thrust_lag_up_s.max(self.nominal.thrust_lag_down_s);
        let rows = (FORGOTTEN * lag_s / series.step_s).ceil() as usize;
        let (mut last, mut settled) = (None, Vec::with_capacity(series.len));
        for k in 0..series.len {
            if !series.has_row(k) {
                last = Some(k);
            }
            settled.push(last.is_none_or(|last| k > last + rows));
        }
        settled
    }

    /// Factor on a commanded wrench at which the model's lift matches the accelerometer, if the command is further off
    /// than any effect of plausible size: an integrating controller flies with any thrust map, so commanded newtons are
    /// not a measurement.
    fn command_scale(&self, prediction: &Prediction) -> Option<f64> {
        let series = self.series();
        if series.drive != Drive::Wrench || !series.available.accel {
            return None;
        }
        let down = channels::F + 2;
        let mut ratios: Vec<f64> = pass::measured_channel(series, down)
            .into_iter()
            .zip(prediction.channels[down].iter())
            .filter(|(_, p)| **p < 0.0)
            .map(|(m, p)| m / p)
            .filter(|ratio| ratio.is_finite() && *ratio > 0.0)
            .collect();
        if ratios.is_empty() {
            return None;
        }
        let ratio = noise::median(&mut ratios);
        let far = !(COMMAND_SCALE_LOW..=1.0 / COMMAND_SCALE_LOW).contains(&ratio);
        far.then_some(ratio)
    }

    /// The log on its grid.
    pub fn series(&self) -> &Series {
        &self.plant.series
    }

    /// Noise of the readings.
    pub fn noise(&self) -> &NoiseModel {
        &self.noise
    }

    /// True if errors of the readings behind a channel persist over rows: a coarse voltage, or values that are held from a
    /// slower stream.
    pub(crate) fn has_persistent_errors(&self, channel: usize) -> bool {
        match channel {
            KV..M | KP..V => self.series().slow.is_held,
            V => self.plant.persistent_voltage,
            _ => false,
        }
    }

    /// Size of the vehicle, which determines what is plausible on it.
    pub(crate) fn vehicle_size(&self) -> VehicleSize {
        VehicleSize::of(&self.nominal, &self.plant.battery_model)
    }

    /// The effects of the model.
    pub(crate) fn model(&self) -> &[EffectInstance] {
        &self.model
    }

    /// The effects that may be named.
    pub fn catalogue(&self) -> &Catalogue {
        &self.catalogue
    }

    /// The same with another catalogue of effects.
    pub(crate) fn with_catalogue(&self, catalogue: &Catalogue) -> Self {
        Self {
            catalogue: catalogue.clone(),
            ..self.clone()
        }
    }

    /// True if a channel can be tested.
    pub fn has(&self, channel: usize) -> bool {
        self.whiteners[channel].is_some()
    }

    /// What was resampled or left out, and the consequences.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = self.plant.series.notes.clone();
        let have = self.plant.series.available;
        let mut missing = |there: bool, text: &str| {
            if !there {
                notes.push(text.to_owned());
            }
        };
        missing(
            have.accel,
            "no accelerometer: channels F are left out, forces are tested through the velocity",
        );
        missing(
            have.rates,
            "no body rates: channels M and KA are left out, torques are not testable",
        );
        missing(have.attitude, "no attitude: channels KV and KA are left out");
        missing(
            have.velocity,
            "no velocity: channels KV and KP are left out, aerodynamic effects are not testable",
        );
        missing(have.position, "no position: channel KP is left out");
        missing(
            !self.forgives_the_chart,
            "the battery's chart is a guess: slow errors of the voltage do not count as errors of the model",
        );
        missing(
            have.voltage,
            "no battery voltage: channel V is left out, Eq. 19 takes that of the model's battery as it empties, with the charge at the start that fits best",
        );
        notes
    }

    /// The model's effects and `extra` effects together, on a vehicle with the nuisances.
    pub(crate) fn effect_set(
        &self,
        nuisances: &Nuisances,
        extra: &[EffectInstance],
    ) -> Result<EffectSet, PredictError> {
        self.effect_set_in_wind(nuisances, extra, [0.0; 3])
    }

    /// The same in a steady wind (m/s, NED) in addition to that of the effects.
    pub(crate) fn effect_set_in_wind(
        &self,
        nuisances: &Nuisances,
        extra: &[EffectInstance],
        wind_ned_m_s: Vector3,
    ) -> Result<EffectSet, PredictError> {
        let mut vehicle = self.nominal;
        for (own, more) in vehicle.wind_ned_m_s.iter_mut().zip(wind_ned_m_s) {
            *own += more;
        }
        for (own, more) in vehicle.wind_ned_m_s.iter_mut().zip(nuisances.wind_m_s) {
            *own += more;
        }
        for (bias, own) in vehicle.rotor_bias_n.iter_mut().zip(&nuisances.rotor_bias_n) {
            *bias += own;
        }
        vehicle.charge_offset += nuisances.charge;
        // Noise is predicted by its mean, which is 0: an independent draw would only add to the error.
        let is_noise = |effect: &EffectInstance| {
            let declared = self.catalogue.find(&effect.effect);
            declared.is_some_and(|d| d.class == EffectClass::Noise)
        };
        let effects = self.model.iter().chain(extra);
        let all: Vec<EffectInstance> = effects.filter(|effect| !is_noise(effect)).cloned().collect();
        EffectSet::new(&self.catalogue, &all, &vehicle, 0).map_err(PredictError::from)
    }

    /// Hooks that an effect uses.
    pub(crate) fn hooks_of(&self, instance: &EffectInstance) -> Result<Hooks, PredictError> {
        self.catalogue
            .build(instance, &self.nominal, 0, 0)
            .map(|effect| effect.hooks())
            .map_err(PredictError::from)
    }

    pub(crate) fn predict(&self, set: &EffectSet, source: Source, base: Option<(&Prediction, Stages)>) -> Prediction {
        self.plant.run(set, source, base)
    }

    /// Mean thrust of each rotor in flight, computed by the model from the inputs, N, and the seconds that count.
    pub(crate) fn mean_thrust(&self) -> Result<(Vec<f64>, f64), PredictError> {
        let rows = self.thrust_in_flight()?;
        Ok((mean_of(&rows, self.plant.series.rotors), self.seconds_of(&rows)))
    }

    /// Thrust of each rotor at every step in flight, N, one row after the other.
    pub(crate) fn thrust_in_flight(&self) -> Result<Vec<f64>, PredictError> {
        let series = &self.plant.series;
        let set = self.effect_set(&Nuisances::default(), &[])?;
        let thrust = self.predict(&set, Source::Raw, None).thrust;
        let flying = series.flying(&thrust, self.nominal.mass_kg * self.nominal.gravity_m_s2);
        let rows = thrust.chunks(series.rotors).zip(&flying).filter(|(_, flies)| **flies);
        Ok(rows.flat_map(|(row, _)| row.iter().copied()).collect())
    }

    /// Thrust of each rotor, computed by the model from the inputs, at arbitrary times by linear interpolation between
    /// its steps, N; rotor by rotor.
    pub(crate) fn thrust_at(&self, time_s: &[f64]) -> Result<Vec<Vec<f64>>, PredictError> {
        let series = &self.plant.series;
        let set = self.effect_set(&Nuisances::default(), &[])?;
        let thrust = self.predict(&set, Source::Raw, None).thrust;
        let steps = thrust.len() / series.rotors;
        let at = |rotor: usize, time: f64| {
            let place = ((time - series.start_s) / series.step_s).clamp(0.0, (steps - 1) as f64);
            let before = (place as usize).min(steps - 2);
            let share = place - before as f64;
            let value = |k: usize| thrust[k * series.rotors + rotor];
            (1.0 - share) * value(before) + share * value(before + 1)
        };
        let rotors = 0..series.rotors;
        Ok(rotors
            .map(|rotor| time_s.iter().map(|time| at(rotor, *time)).collect())
            .collect())
    }

    /// Duration that rows of [`Self::thrust_in_flight`] represent, s.
    pub(crate) fn seconds_of(&self, rows: &[f64]) -> f64 {
        (rows.len() / self.plant.series.rotors) as f64 * self.plant.series.step_s
    }

    /// Whitened residuals of a raw prediction.
    pub(crate) fn whitened(&self, prediction: &Prediction) -> PerChannel {
        std::array::from_fn(|channel| self.whitened_channel(channel, prediction))
    }

    /// Whitened residual of one channel; empty where it is not tested.
    pub(crate) fn whitened_channel(&self, channel: usize, prediction: &Prediction) -> Vec<f64> {
        match &self.whiteners[channel] {
            None => Vec::new(),
            Some(whitener) => {
                let mut residual = self.difference(channel, prediction);
                whitener.apply(&mut residual);
                residual
            }
        }
    }

    /// Measured side of a channel; NaN where nothing was measured.
    pub(crate) fn measured(&self, channel: usize) -> Vec<f64> {
        pass::measured_channel(self.series(), channel)
    }

    fn difference(&self, channel: usize, prediction: &Prediction) -> Vec<f64> {
        let mut residual = pass::measured_channel(self.series(), channel);
        for (m, p) in residual.iter_mut().zip(prediction.channels[channel].iter()) {
            *m -= p;
        }
        residual
    }

    pub(crate) fn whitener(&self, channel: usize) -> Option<&Whitener> {
        self.whiteners[channel].as_ref()
    }

    /// Noise of the rates about an axis.
    pub(crate) fn rate_noise(&self, axis: usize) -> RateNoise {
        self.rate_noise[axis]
    }

    /// From now on, whitens the angular acceleration about an axis with the innovations of a filter of the rate.
    pub(crate) fn tune(&mut self, axis: usize, noise: RateNoise) {
        let step_s = self.plant.series.step_s;
        let own = &self.whiteners;
        self.assumed
            .get_or_insert_with(|| Arc::new(std::array::from_fn(|axis| own[channels::M + axis].clone())));
        self.rate_noise[axis] = noise;
        if let Some(whitener) = &mut Arc::make_mut(&mut self.whiteners)[channels::M + axis] {
            *whitener = whitener.with_filter(noise, step_s);
        }
    }

    /// A whitened residual with the assumed noise: what a tuned noise attributes to random torques must not count as
    /// explained.
    pub(crate) fn as_assumed(&self, channel: usize, whitened: &[f64]) -> Option<Vec<f64>> {
        let axis = channel.checked_sub(channels::M).filter(|&axis| axis < 3)?;
        let (assumed, tuned) = (self.assumed.as_ref()?[axis].as_ref()?, self.whitener(channel)?);
        let mut residual = whitened.to_vec();
        tuned.undo(&mut residual);
        assumed.apply(&mut residual);
        Some(residual)
    }

    /// The stages whose result differs between two vehicles; `hooks` are those in which their effects differ.
    pub(crate) fn stages(&self, a: &Constants, b: &Constants, hooks: Hooks) -> Stages {
        let stages = Stages::between(a, b, hooks);
        // The voltage behind the duties is then that of the battery.
        let drives = self.plant.is_unlogged() && stages.battery;
        Stages {
            actuators: stages.actuators || drives,
            body: stages.body || drives,
            ..stages
        }
    }

    /// Initial charge determined from the first second of flight, fraction.
    pub(crate) fn initial_charge(&self) -> f64 {
        self.plant.charge
    }

    /// Means of the voltage over `mean_s` and what their prediction needs.
    pub(crate) fn coarse_voltage(&self, base: &Prediction, mean_s: f64) -> CoarseVoltage {
        let series = &self.plant.series;
        let stride = ((mean_s / series.step_s).round() as usize).max(1);
        let counted = |k: usize| self.whiteners[channels::V].as_ref().is_some_and(|w| w.counts(k));
        let measured: Vec<Option<f64>> = (0..series.len)
            .step_by(stride)
            .map(|start| {
                let end = (start + stride).min(series.len);
                let whole = end - start == stride && (start..end).all(counted);
                whole.then(|| series.voltage[start..end].iter().sum::<f64>() / stride as f64)
            })
            .collect();
        let places = (0..measured.len()).filter(|&j| measured[j].is_some()).collect();
        CoarseVoltage {
            powers: self.plant.powers(&base.thrust, stride),
            slopes: Vec::new(),
            stride,
            places,
            measured: measured.into_iter().flatten().collect(),
            weight: stride as f64 / self.covariances[channels::V].variance,
        }
    }

    /// Prediction of the means of the voltage, with thrust and motion as in `base`; the powers differ from those by the
    /// shifts times their slopes.
    pub(crate) fn coarse_prediction(
        &self,
        set: &EffectSet,
        base: &Prediction,
        coarse: &CoarseVoltage,
        shifts: &[f64],
    ) -> Vec<f64> {
        let mut powers = std::borrow::Cow::Borrowed(&coarse.powers);
        for (which, slope) in &coarse.slopes {
            let shift = shifts[*which];
            if shift == 0.0 {
                continue;
            }
            for (power, rise) in powers.to_mut().iter_mut().zip(slope) {
                power.mean = (power.mean + shift * rise).max(0.0);
            }
        }
        let all = self
            .plant
            .battery_of(set.clone(), &base.motion, &base.thrust, &powers, coarse.stride);
        coarse.places.iter().map(|&j| all[j]).collect()
    }

    /// Residuals of the model with nuisances and further effects.
    ///
    /// # Errors
    /// The effects together yield an invalid vehicle.
    pub fn residuals(&self, nuisances: &Nuisances, extra: &[EffectInstance]) -> Result<ChannelResiduals, PredictError> {
        let set = self.effect_set(nuisances, extra)?;
        let prediction = self.predict(&set, Source::Raw, None);
        let whitened = self.whitened(&prediction);
        let raw = std::array::from_fn(|channel| {
            if self.has(channel) {
                self.difference(channel, &prediction)
            } else {
                Vec::new()
            }
        });
        let mask = std::array::from_fn(|channel| match &self.whiteners[channel] {
            None => Vec::new(),
            Some(whitener) => (0..whitener.len()).map(|k| whitener.counts(k)).collect(),
        });
        Ok(ChannelResiduals {
            raw,
            whitened,
            noise_floor: self.covariances.map(|c| c.variance.sqrt()),
            mask,
        })
    }
}

/// Gain of the observer of a rate: the Kalman gain of the assumed noise, and not slower than [`RATES_SETTLE_S`].
fn rate_gain(covariance: Covariance, step_s: f64) -> f64 {
    covariance.gain().max(1.0 - libm::exp(-step_s / RATES_SETTLE_S))
}

/// A rejected effect as a sentence.
fn sentence_of(refusal: &Refusal) -> String {
    format!("{}: {}", refusal.key, refusal.reason)
}

/// Mean of rows, column by column.
pub(crate) fn mean_of(rows: &[f64], columns: usize) -> Vec<f64> {
    let mut mean = vec![0.0; columns];
    for row in rows.chunks(columns) {
        for (sum, value) in mean.iter_mut().zip(row) {
            *sum += value;
        }
    }
    let count = (rows.len() / columns) as f64;
    mean.into_iter().map(|sum| sum / count).collect()
}

/// Minimum-norm allocation of (thrust, torque) to the rotors: f = Bᵀ (B Bᵀ)⁻¹ w, with w = (T, τ).
pub(crate) fn allocation(c: &Constants) -> impl Fn(f64, Vector3) -> Vec<f64> {
    let n = c.rotor_count;
    let columns: Vec<[f64; 4]> = (0..n)
        .map(|i| {
            let [x, y, _] = c.rotor_position_body[i];
            [1.0, -y, x, c.rotor_spin[i] * c.moment_ratio_m[i]]
        })
        .collect();
    let mut gram = Matrix4::zeros();
    for column in &columns {
        let column = Vector4::from(*column);
        gram += column * column.transpose();
    }
    // The geometry was checked to be controllable.
    let gram = gram.lu();
    move |thrust, torque| {
        let wrench = Vector4::new(thrust, torque[0], torque[1], torque[2]);
        let w = gram.solve(&wrench).unwrap_or_else(Vector4::zeros);
        columns
            .iter()
            .map(|column| column.iter().zip(w.iter()).map(|(a, b)| a * b).sum::<f64>().max(0.0))
            .collect()
    }
}

/// Initial voltage under the load of hovering, V: the input of Eq. 19 if no voltage was logged. With the open-circuit
/// voltage a small vehicle would lift a tenth too much.
///
/// V = (V_o + √(V_o² − 4 R P_h))/2, P_h = n k_P f_h^1.5
fn under_hover_load(plant: &Plant, nominal: &Constants) -> f64 {
    let open = Battery::new(&plant.battery_model).open_circuit_voltage(plant.charge);
    0.5 * (open + pass::root(open, nominal, hover_power(nominal)))
}

/// P_h = n k_P f_h^1.5, W.
fn hover_power(c: &Constants) -> f64 {
    let hover = c.hover_thrust_n;
    c.rotor_count as f64 * c.power_coefficient_w_per_n15 * hover * hover.sqrt()
}

/// Charge at which the resting voltage less the drop of hovering equals the voltage measured in the first second of
/// flight.
fn initial_charge(plant: &Plant, nominal: &Constants) -> f64 {
    let series = &plant.series;
    let first = ((1.0 / series.step_s) as usize).max(10).min(series.voltage.len());
    let mut begin: Vec<f64> = series.voltage[..first]
        .iter()
        .copied()
        .filter(|v| v.is_finite())
        .collect();
    if begin.is_empty() {
        return 0.75;
    }
    let voltage = noise::median(&mut begin);
    let f = nominal.hover_thrust_n;
    let power = nominal.power_coefficient_w_per_n15 * f * f.sqrt() * nominal.rotor_count as f64;
    let open = voltage + nominal.internal_resistance_ohm * power / voltage.max(1.0);
    let battery = Battery::new(&plant.battery_model);
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if battery.open_circuit_voltage(middle) < open {
            low = middle;
        } else {
            high = middle;
        }
    }
    (0.5_f64 * (low + high)).clamp(0.02, 0.98)
}
