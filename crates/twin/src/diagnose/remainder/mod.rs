//! What is left over, in the words of a user: how large, in which frequencies, since when, and what it follows.
//!
//! An error that is "real and not in the catalogue" may be an estimator's coloured noise, a vibration, a filter, a thing that happened in flight, or
//! physics. Channel by channel the residual of the model with everything that was found is described by five questions: its spectrum over that of
//! noise ([`spectrum`]), a line in it, a time at which it begins ([`since`]), a signal that it follows, and one with which its size grows ([`follow`]).
//! One half of the blocks of 5 s chooses what to say, the other has to confirm it; what it does not confirm is not said, and all sizes are those
//! of that other half.
//!
//! Limits: a description, no explanation. Errors slower than 5 s are one band; what happens on a single block has no second half.

mod follow;
mod since;
mod spectrum;
mod words;

use rotortwin_plant::effects::EffectInstance;

use crate::compare::conditions::{self, Condition};
use crate::diagnose::described::{Follows, FrequencyBand, Line, Remainder, RemainderOnset};
use crate::diagnose::result::Diagnosis;
use crate::estimation::columns::LogState;
use crate::estimation::nuisances::{self, Reach};
use crate::estimation::problem::Problem;
use crate::estimation::whiteness::{UNEXPLAINED_SCORE, assumed_fits};
use crate::predict::channels::{F, KA, KP, KV, M};
use crate::predict::{CHANNELS, NAMES, PerChannel, PredictError, UNITS};
use spectrum::Spectrum;

/// Squares over those of noise from which a channel is told, of its rows and of its means over 0.1 s.
const LOUD: f64 = 1.5;
const MEAN_S: f64 = 0.1;

/// A residual under description.
pub(super) struct Residual<'a> {
    channel: usize,
    rows: &'a [f64],
    mask: &'a [bool],
    step_s: f64,
    /// Time of the first row, s of the log.
    start_s: f64,
    /// Deviation of a mean over some rows, of noise alone.
    noise: &'a dyn Fn(usize) -> f64,
}

/// Describes what the effects of a diagnosis leave, channel by channel, strongest first.
///
/// # Errors
/// The effects without one that was not believed yield an invalid vehicle.
pub(super) fn describe(problem: &Problem, diagnosis: &Diagnosis) -> Result<Vec<Remainder>, PredictError> {
    let found = diagnosis.effects.iter().chain(&diagnosis.sensor_or_timing);
    let effects: Vec<EffectInstance> = found.map(|finding| finding.instance.clone()).collect();
    let mut all = Vec::new();
    for log in &problem.logs {
        // Without what was not believed, the biases are others.
        let about = LogState::new(log.predictor.clone());
        let fitted = nuisances::fit(&about, &effects, Reach::Plausible)?;
        let mut of_log = of_log(log, &fitted, &effects)?;
        of_log.sort_by(|a, b| b.0.total_cmp(&a.0));
        let several = problem.logs.len() > 1;
        all.extend(of_log.into_iter().map(|(_, mut one)| {
            one.sentence = words::sentence(&one, several);
            one
        }));
    }
    Ok(all)
}

fn of_log(
    log: &LogState,
    fitted: &crate::predict::Nuisances,
    effects: &[EffectInstance],
) -> Result<Vec<(f64, Remainder)>, PredictError> {
    let predictor = &log.predictor;
    let series = predictor.series();
    let residuals = predictor.residuals(fitted, effects)?;
    let whitened: PerChannel = residuals.whitened.clone();
    let scores = assumed_fits(predictor, whitened).map(|fit| fit.map_or(0.0, |fit| fit.score()));
    let signals = conditions::of(series);
    let covariances = predictor.noise().covariances(series.step_s);
    let mut found = Vec::new();
    for channel in 0..CHANNELS {
        let (rows, mask) = (&residuals.raw[channel], &residuals.mask[channel]);
        if rows.is_empty() {
            continue;
        }
        let covariance = covariances[channel];
        let one = Residual {
            channel,
            rows,
            mask,
            step_s: series.step_s,
            start_s: series.time(0),
            noise: &|count| covariance.deviation_of_mean(count).max(f64::MIN_POSITIVE),
        };
        let loud = one.excess(1).max(one.excess(one.rows_of(MEAN_S)));
        if scores[channel] < UNEXPLAINED_SCORE && loud < LOUD {
            continue;
        }
        let blocks = spectrum::whole_blocks(mask, one.rows_of(spectrum::BLOCK_S));
        let spectrum = Spectrum::of(rows, &blocks, covariance, series.step_s);
        let predicted: Vec<f64> = predictor
            .measured(channel)
            .iter()
            .zip(rows)
            .map(|(m, r)| m - r)
            .collect();
        let told = one.told(&predictor.name, spectrum.as_ref(), &signals, &predicted);
        found.push((scores[channel].max(0.0) + loud, told));
    }
    Ok(found)
}

impl Residual<'_> {
    fn rows_of(&self, seconds: f64) -> usize {
        ((seconds / self.step_s).round() as usize).max(1)
    }

    /// Means of consecutive rows that all count, with the first row of each.
    fn means(&self, seconds: f64, values: &[f64]) -> Vec<(usize, f64)> {
        let count = self.rows_of(seconds);
        let whole =
            |&start: &usize| start + count <= values.len() && self.mask[start..start + count].iter().all(|&m| m);
        let mean = |start: usize| values[start..start + count].iter().sum::<f64>() / count as f64;
        (0..values.len())
            .step_by(count)
            .filter(whole)
            .map(|start| (start, mean(start)))
            .collect()
    }

    /// Mean square of means over some rows, over that of noise.
    fn excess(&self, count: usize) -> f64 {
        let means = self.means(count as f64 * self.step_s, self.rows);
        let noise = (self.noise)(count);
        means.iter().map(|(_, mean)| mean * mean).sum::<f64>() / (means.len().max(1) as f64 * noise * noise)
    }

    fn told(&self, log: &str, spectrum: Option<&Spectrum>, signals: &[Condition], predicted: &[f64]) -> Remainder {
        let (what, unit, is_rate) = named(self.channel);
        let band = spectrum.and_then(Spectrum::range);
        // The slowest errors of a derivative are steps of the derivative, not of the column.
        let integrated = (is_rate && band.is_some_and(|band| band.low_hz > 0.0)).then_some(self.step_s);
        let (what, unit) = if integrated.is_some() {
            (what, unit)
        } else {
            (named_as_residual(self.channel), UNITS[self.channel])
        };
        let (size, noise) = match spectrum {
            Some(spectrum) => spectrum.size(band.as_ref(), integrated),
            None => (self.excess(1).sqrt() * (self.noise)(1), (self.noise)(1)),
        };
        let line = spectrum.and_then(Spectrum::line);
        let (onset, follows) = (since::onset(self), follow::mean(self, signals, predicted));
        // What follows a signal is larger where that is larger, and a size that grows once goes with the time.
        let is_told = follows.is_some() || onset.is_some_and(|one| !one.of_mean);
        let correlated = band.filter(|band| !band.flat && line.is_none());
        Remainder {
            log: log.to_owned(),
            channel: NAMES[self.channel].to_owned(),
            what: what.to_owned(),
            unit: unit.to_owned(),
            size,
            noise,
            band: band.map(|band| FrequencyBand {
                low_hz: band.low_hz,
                high_hz: band.high_hz,
                flat: band.flat,
            }),
            line: line.map(|(hz, width_hz)| Line { hz, width_hz }),
            quiet_above_hz: spectrum.and_then(Spectrum::quiet_above_hz),
            correlation_s: correlated.and_then(|band| spectrum?.correlation_s(&band, integrated)),
            onset,
            follows,
            size_follows: if is_told { None } else { follow::size(self, signals) },
            sentence: String::new(),
        }
    }
}

/// The column that a residual is an error of, its unit, and whether the residual is its rate of change.
fn named(channel: usize) -> (&'static str, &'static str, bool) {
    const COLUMNS: [(usize, [&str; 3], &str); 3] = [
        (KV, ["velocity north", "velocity east", "velocity down"], "m/s"),
        (KA, ["roll angle", "pitch angle", "yaw angle"], "rad"),
        (KP, ["position north", "position east", "position down"], "m"),
    ];
    let of = COLUMNS
        .iter()
        .find(|(first, ..)| (*first..first + 3).contains(&channel));
    of.map_or(
        (named_as_residual(channel), UNITS[channel], false),
        |(first, names, unit)| (names[channel - first], *unit, true),
    )
}

/// What a residual is, in words.
fn named_as_residual(channel: usize) -> &'static str {
    const FORCES: [&str; 3] = [
        "specific force forward",
        "specific force to the right",
        "specific force downwards",
    ];
    const TURNS: [&str; 3] = ["roll acceleration", "pitch acceleration", "yaw acceleration"];
    const VELOCITIES: [&str; 3] = [
        "rate of change of the velocity north",
        "rate of change of the velocity east",
        "rate of change of the velocity down",
    ];
    const ANGLES: [&str; 3] = [
        "rate of change of the roll angle",
        "rate of change of the pitch angle",
        "rate of change of the yaw angle",
    ];
    const POSITIONS: [&str; 3] = [
        "rate of change of the position north",
        "rate of change of the position east",
        "rate of change of the position down",
    ];
    let groups = [(F, FORCES), (M, TURNS), (KV, VELOCITIES), (KA, ANGLES), (KP, POSITIONS)];
    let of = groups.iter().find(|(first, _)| (*first..first + 3).contains(&channel));
    of.map_or("voltage", |(first, names)| names[channel - first])
}
