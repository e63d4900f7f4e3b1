//! Trim: a flight compared with healthy flights of the same vehicle by the mean commanded thrust of each rotor.
//!
//! ```text
//! logs ─▶ thrust of the model from duties and voltage ─▶ mean of each rotor in flight ─▶ ln of it over the healthy mean
//!      ─▶ likelihood under the spread of the healthy flights ─▶ posterior of: nothing, one rotor, two, mass, a load at a place
//! ```
//! A vehicle that does not tumble has no mean torque: the command of a rotor compensates for its loss. On a quadrotor,
//! a rotor with the gain 1 + s is commanded 1/(1 + s) of its thrust and the others what they had; a load affects all of
//! them. So neither rates nor accelerometer are needed, and errors of the model that every flight has (mass, thrust
//! map, rotors that differ by 14 %) cancel.
//!
//! The healthy flights differ, too: by a common factor (battery, air) and rotor by rotor. Both spreads are estimated
//! from them, so the likelihood is Student's t. Several logs that are diagnosed together count as one flight: the
//! spread between sessions is larger than within one. Healthy flights of one day are also one session: they do not show
//! how days differ, so against a flight of another day the spread is increased by [`ANOTHER_DAY`].
//!
//! Limits: an effect that changes no mean goes unnoticed; with more than four rotors, commands are assumed to be
//! allocated by the pseudo-inverse; a common change of all rotors is called mass, whether it is air, voltage or
//! propellers.

mod posterior;

use rotortwin_plant::effects::{Constants, EffectDeclaration, ParameterDeclaration, TrimChange, catalogue};
use serde::Serialize;
use utoipa::ToSchema;

use crate::estimation::parameters::{FittedParameter, parameters_of};
use crate::log::FlightLog;
use crate::model::ModelVersion;
use crate::predict::{PredictError, Predictor, VehicleSize, allocation, mean_of};
use crate::vibration;
use crate::{LEAST_BASELINE, NAMED};

use posterior::{Spread, Weighed};

/// Prior odds of two damaged rotors against one: two together are rarer.
const PAIR_PRIOR: f64 = 0.02;
/// Relative spread of a rotor between days, about which healthy flights of a single day carry no information
/// (batteries, propellers reattached, wind).
const ANOTHER_DAY: f64 = 0.03;
/// Seconds of a day.
const DAY_S: f64 = 86_400.0;
/// Factors on the number of healthy flights for which the gain from more flights is computed.
const MORE_FLIGHTS: [usize; 2] = [2, 4];
/// Steps and largest share of the search for the smallest loss of a rotor that would be named.
const LOSS_STEPS: usize = 60;
const LOSS_STEP: f64 = 0.01;
/// Fixed-point steps of the balance with another gain; the error shrinks by the gain's change each time.
const BALANCE_STEPS: usize = 60;

/// A possible change.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = TrimChange)]
pub struct Change {
    /// Id of the effect in the catalogue; for a load, `mass` with `centre-of-mass`.
    pub effect: String,
    /// Rotor, from 1.
    pub rotor: Option<usize>,
    /// The second of two rotors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second_rotor: Option<usize>,
    /// In words.
    pub label: String,
    /// Posterior probability.
    pub posterior: f64,
    /// Its parameters.
    pub parameters: Vec<FittedParameter>,
}

/// Whether a vehicle is still that of the healthy flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// No change is the likeliest.
    NoChange,
    /// A change is likelier than none, and not certain enough to be named.
    ProbablyChanged,
    /// A change is named, or several that the flights cannot distinguish.
    Changed,
}

/// The answer.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Trim {
    /// In words.
    pub sentence: String,
    /// The named changes: the fewest that together have [`NAMED`]; empty if nothing has changed.
    pub named: Vec<Change>,
    /// All possible changes, most probable first.
    pub ranking: Vec<Change>,
    /// Posterior probability of no change.
    pub unchanged: f64,
    /// Commanded thrust of each rotor relative to that of the healthy flights, minus 1.
    pub thrust_change: Vec<f64>,
    /// Relative spread of healthy flights: common to all rotors, and additionally per rotor.
    pub spread: [f64; 2],
    /// Number of healthy flights.
    pub baseline: Vec<String>,
    /// Smallest loss of one rotor that would be named, whichever rotor it is; absent if there is none up to 60 %.
    pub smallest_loss: Option<f64>,
    /// The same with more healthy flights of the same spread.
    pub with_more: Vec<MoreFlights>,
    /// True if all healthy flights are from one day and the flight compared is from another: its spread is then
    /// assumed, not known.
    pub another_day: bool,
    /// Vibration at the speed of each rotor against the healthy flights, if the logs show it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vibration: Option<vibration::Change>,
    /// Why there is no result, one sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub no_vibration: Option<String>,
}

/// Detectable size with more healthy flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
#[schema(as = TrimMoreFlights)]
pub struct MoreFlights {
    /// Number of healthy flights.
    pub flights: usize,
    /// Smallest loss of one rotor that would be named, whichever rotor it is; absent if there is none up to 60 %.
    pub smallest_loss: Option<f64>,
}

/// What a candidate changes.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Rotor(usize),
    Pair(usize, usize),
    Mass,
    Load,
}

/// The balance of a vehicle about the healthy mean thrusts.
struct Balance<'a> {
    healthy: &'a [f64],
    constants: &'a Constants,
}

impl Balance<'_> {
    /// Part of a change of thrusts that changes force or torque, since the allocation compensates for it.
    fn seen(&self, change: &[f64]) -> Vec<f64> {
        let (mut force, mut torque) = (0.0, [0.0; 3]);
        for (i, x) in change.iter().enumerate() {
            let [rx, ry, _] = self.constants.rotor_position_body[i];
            force += x;
            torque[0] -= ry * x;
            torque[1] += rx * x;
            torque[2] += self.constants.rotor_spin[i] * self.constants.moment_ratio_m[i] * x;
        }
        self.allocated(force, torque)
    }

    /// Thrusts for an additional force and torque.
    fn allocated(&self, force: f64, torque: [f64; 3]) -> Vec<f64> {
        // About a large thrust, so that no rotor is limited at 0.
        let total: f64 = 1e3 * self.healthy.iter().sum::<f64>();
        let allocate = allocation(self.constants);
        let (with, without) = (allocate(total + force, torque), allocate(total, [0.0; 3]));
        with.iter().zip(&without).map(|(a, b)| a - b).collect()
    }

    /// Commanded thrusts if these rotors give 1 + s of theirs.
    fn with_gains(&self, gains: &[(usize, f64)]) -> Vec<f64> {
        let mut asked = self.healthy.to_vec();
        for _ in 0..BALANCE_STEPS {
            let mut missing = vec![0.0; asked.len()];
            for (rotor, s) in gains {
                missing[*rotor] = s * asked[*rotor];
            }
            asked = self
                .healthy
                .iter()
                .zip(self.seen(&missing))
                .map(|(f, x)| f - x)
                .collect();
        }
        asked
    }

    /// ln of commanded thrust over healthy thrust, rotor by rotor.
    fn signature(&self, kind: Kind, values: &[f64]) -> Vec<f64> {
        let total: f64 = self.healthy.iter().sum();
        let asked: Vec<f64> = match kind {
            Kind::Rotor(rotor) => self.with_gains(&[(rotor, values[0])]),
            Kind::Pair(first, second) => self.with_gains(&[(first, values[0]), (second, values[1])]),
            Kind::Mass => self.healthy.iter().map(|f| f * (1.0 + values[0])).collect(),
            Kind::Load => {
                let [share, forward, right] = [values[0], values[1], values[2]];
                let more = self.allocated(total * share, [-total * right, total * forward, 0.0]);
                self.healthy.iter().zip(more).map(|(f, x)| f + x).collect()
            }
        };
        asked
            .iter()
            .zip(self.healthy)
            .map(|(a, f)| (a / f).max(1e-3).ln())
            .collect()
    }
}

/// A candidate with the declared parameters that it varies.
struct Candidate {
    kind: Kind,
    /// Prior odds against one rotor.
    prior: f64,
    effect: String,
    parameters: Vec<ParameterDeclaration>,
}

fn candidates(rotors: usize, size: &VehicleSize) -> Vec<Candidate> {
    let declared = |changes: &[TrimChange]| -> Vec<&'static EffectDeclaration> {
        let all = changes.iter().flat_map(|change| {
            let entries = catalogue().iter().copied();
            entries.filter(move |entry| entry.search.trim == Some(*change))
        });
        all.collect()
    };
    let candidate = |kind: Kind, changes: &[TrimChange]| {
        let entries = declared(changes);
        Candidate {
            kind,
            prior: if matches!(kind, Kind::Pair(..)) {
                PAIR_PRIOR
            } else {
                1.0
            },
            effect: entries.iter().map(|d| d.id).collect::<Vec<_>>().join(" with "),
            parameters: entries.iter().flat_map(|d| size.parameters(d)).collect(),
        }
    };
    let mut all: Vec<Candidate> = (0..rotors)
        .map(|rotor| candidate(Kind::Rotor(rotor), &[TrimChange::RotorThrust]))
        .collect();
    for first in 0..rotors {
        let pair = |second| {
            candidate(
                Kind::Pair(first, second),
                &[TrimChange::RotorThrust, TrimChange::RotorThrust],
            )
        };
        all.extend((first + 1..rotors).map(pair));
    }
    all.push(candidate(Kind::Mass, &[TrimChange::Weight]));
    all.push(candidate(Kind::Load, &[TrimChange::Weight, TrimChange::Balance]));
    all
}

/// Compares flights with healthy flights of the same vehicle.
///
/// # Errors
/// One sentence: fewer than [`LEAST_BASELINE`] healthy flights, or a log without the inputs of the rotors.
pub fn trim(logs: &[FlightLog], healthy: &[FlightLog], model: &ModelVersion) -> Result<Trim, PredictError> {
    if healthy.len() < LEAST_BASELINE {
        return Err(PredictError(format!(
            "expected at least {LEAST_BASELINE} healthy flights as a baseline, because their spread is needed to detect a change, got {}",
            healthy.len()
        )));
    }
    if logs.is_empty() {
        return Err(PredictError("expected at least one log, got none".into()));
    }
    let documents = model.documents();
    let (instances, effects) = (model.instances(), model.catalogue()?);
    let mut nominal = None;
    let mut mean_of = |log: &FlightLog| -> Result<Vec<f64>, PredictError> {
        let predictor = Predictor::new(&documents, &instances, &effects, log)?;
        let (mean, _) = predictor.mean_thrust()?;
        if mean.iter().any(|f| f.is_nan() || *f <= 0.0) {
            return Err(PredictError(format!(
                "{}: expected every rotor to lift in the mean, got {mean:.3?} N",
                log.name
            )));
        }
        nominal.get_or_insert_with(|| (predictor.nominal, predictor.vehicle_size()));
        Ok(mean)
    };
    let baseline: Vec<Vec<f64>> = healthy.iter().map(&mut mean_of).collect::<Result<_, _>>()?;
    let flown: Vec<Vec<f64>> = logs.iter().map(&mut mean_of).collect::<Result<_, _>>()?;
    let Some((constants, size)) = nominal else {
        return Err(PredictError("expected at least one log, got none".into()));
    };
    let mut found = weigh(&flown, &baseline, is_another_day(logs, healthy), &constants, &size);
    found.baseline = healthy.iter().map(|log| log.name.clone()).collect();
    (found.smallest_loss, found.with_more) = smallest_losses(&baseline, found.another_day, &constants, &size);
    match vibration::change(logs, healthy, Some(model)) {
        Ok(change) => found.vibration = Some(change),
        Err(reason) => found.no_vibration = Some(reason.0),
    }
    Ok(found)
}

/// True if all healthy flights are of one day and a log is of another; false if a date is not known.
fn is_another_day(logs: &[FlightLog], healthy: &[FlightLog]) -> bool {
    let day = |log: &FlightLog| log.report.flown.as_ref().map(|flown| (flown.unix_s / DAY_S).floor());
    let days: Option<Vec<f64>> = healthy.iter().map(day).collect();
    days.is_some_and(|days| {
        let one = days.iter().all(|other| *other == days[0]);
        one && logs.iter().filter_map(day).any(|other| other != days[0])
    })
}

/// What one flight commanded of each rotor, and how a loss of one would change that: see [`rotor_loads`].
#[derive(Debug, Clone, PartialEq)]
pub struct RotorLoads {
    /// ln of the mean commanded thrust of each rotor over the model's hover thrust of it.
    pub asked: Vec<f64>,
    /// Standard error of that within the flight, from means over [`LOAD_PARTS`] equal parts.
    pub deviation: Vec<f64>,
    /// Seconds in the air that count.
    pub seconds: f64,
    /// For each rotor: change of `asked` per x if the rotor alone has lost the share 1 − e⁻ˣ of its thrust.
    pub signatures: Vec<Vec<f64>>,
}

/// Equal parts of a flight whose means give the error of its mean.
pub const LOAD_PARTS: usize = 8;
/// Loss for which the change of thrusts per x is computed: changes are linear in x to a thousandth there.
const SIGNATURE_LOSS: f64 = 0.05;

/// Mean commanded thrust of each rotor in a flight, by the model's thrust map from duty and voltage.
///
/// # Errors
/// One sentence: the log cannot be compared with the model, or a rotor has no lift on average.
pub fn rotor_loads(log: &FlightLog, model: &ModelVersion) -> Result<RotorLoads, PredictError> {
    let predictor = Predictor::new(&model.documents(), &model.instances(), &model.catalogue()?, log)?;
    let rows = predictor.thrust_in_flight()?;
    let constants = &predictor.nominal;
    let rotors = constants.rotor_count;
    let hover = allocation(constants)(constants.mass_kg * constants.gravity_m_s2, [0.0; 3]);
    let over_hover = |rows: &[f64]| -> Vec<f64> {
        let mean = mean_of(rows, rotors);
        mean.iter().zip(&hover).map(|(f, h)| (f / h).ln()).collect()
    };
    let steps = rows.len() / rotors;
    let asked = over_hover(&rows);
    let parts: Vec<Vec<f64>> = rows
        .chunks_exact((steps / LOAD_PARTS).max(1) * rotors)
        .take(LOAD_PARTS)
        .map(over_hover)
        .collect();
    if parts.len() < LOAD_PARTS || !parts.iter().flatten().chain(&asked).all(|x| x.is_finite()) {
        return Err(PredictError(format!(
            "{}: expected a flight with {LOAD_PARTS} parts in the air, in each of which every rotor lifts in the mean; {:.1} s are in the air",
            log.name,
            predictor.seconds_of(&rows)
        )));
    }
    let deviation: Vec<f64> = (0..rotors)
        .map(|i| {
            let mean = parts.iter().map(|p| p[i]).sum::<f64>() / LOAD_PARTS as f64;
            let squares: f64 = parts.iter().map(|p| (p[i] - mean).powi(2)).sum();
            (squares / (LOAD_PARTS * (LOAD_PARTS - 1)) as f64).sqrt()
        })
        .collect();
    let balance = Balance {
        healthy: &hover,
        constants,
    };
    let per_x = -(1.0 - SIGNATURE_LOSS).ln();
    let signature = |rotor| -> Vec<f64> {
        let change = balance.signature(Kind::Rotor(rotor), &[-SIGNATURE_LOSS]);
        change.iter().map(|d| d / per_x).collect()
    };
    Ok(RotorLoads {
        asked,
        deviation,
        seconds: predictor.seconds_of(&rows),
        signatures: (0..rotors).map(signature).collect(),
    })
}

/// Mean of logarithms, rotor by rotor.
fn log_mean(flights: &[Vec<f64>]) -> Vec<f64> {
    let count = flights.len() as f64;
    (0..flights[0].len())
        .map(|i| flights.iter().map(|f| f[i].ln()).sum::<f64>() / count)
        .collect()
}

/// Estimates from healthy flights: mean of the logarithms of each rotor's thrust, the thrust, N, and the spread.
struct Healthy {
    centre: Vec<f64>,
    thrust: Vec<f64>,
    spread: Spread,
}

impl Healthy {
    fn of(flights: &[Vec<f64>], another_day: bool) -> Self {
        let centre = log_mean(flights);
        let deviations: Vec<Vec<f64>> = flights
            .iter()
            .map(|f| f.iter().zip(&centre).map(|(f, c)| f.ln() - c).collect())
            .collect();
        let within = Spread::of(&deviations);
        Self {
            thrust: centre.iter().map(|x| x.exp()).collect(),
            centre,
            spread: if another_day { within.wider(ANOTHER_DAY) } else { within },
        }
    }

    fn balance<'a>(&'a self, constants: &'a Constants) -> Balance<'a> {
        Balance {
            healthy: &self.thrust,
            constants,
        }
    }
}

/// Smallest loss that would be named now, and with more healthy flights.
fn smallest_losses(
    baseline: &[Vec<f64>],
    another_day: bool,
    constants: &Constants,
    size: &VehicleSize,
) -> (Option<f64>, Vec<MoreFlights>) {
    let healthy = Healthy::of(baseline, another_day);
    let all = candidates(healthy.thrust.len(), size);
    let smallest = |spread: &Spread| smallest_loss(spread, &healthy.balance(constants), &all);
    let more = |times: usize| {
        let flights = times * baseline.len();
        MoreFlights {
            flights,
            smallest_loss: smallest(&healthy.spread.of_flights(flights)),
        }
    };
    (smallest(&healthy.spread), MORE_FLIGHTS.map(more).to_vec())
}

fn weigh(
    flown: &[Vec<f64>],
    baseline: &[Vec<f64>],
    another_day: bool,
    constants: &Constants,
    size: &VehicleSize,
) -> Trim {
    let healthy = Healthy::of(baseline, another_day);
    let all = candidates(healthy.thrust.len(), size);
    let data: Vec<f64> = log_mean(flown)
        .iter()
        .zip(&healthy.centre)
        .map(|(a, c)| a - c)
        .collect();
    let (unchanged, weighed) = weigh_all(&data, &healthy.spread, &healthy.balance(constants), &all);
    let mut ranking: Vec<Change> = all.iter().zip(&weighed).map(|(c, (p, w))| change(c, *p, w)).collect();
    ranking.sort_by(|a, b| b.posterior.total_cmp(&a.posterior));
    let named = named(unchanged, &ranking);
    let mut trim = Trim {
        sentence: String::new(),
        named,
        ranking,
        unchanged,
        thrust_change: data.iter().map(|x| x.exp() - 1.0).collect(),
        spread: healthy.spread.relative(),
        baseline: vec![String::new(); baseline.len()],
        smallest_loss: None,
        with_more: Vec::new(),
        another_day,
        vibration: None,
        no_vibration: None,
    };
    trim.sentence = sentence(&trim);
    trim
}

/// Posterior that nothing has changed, and each candidate's with its fit. "Nothing" has one half of the prior, the
/// candidates share the rest.
fn weigh_all(data: &[f64], spread: &Spread, balance: &Balance<'_>, all: &[Candidate]) -> (f64, Vec<(f64, Weighed)>) {
    let nothing = spread.log_likelihood(data);
    let weighed: Vec<Weighed> = all
        .iter()
        .map(|one| {
            // The whole plausible range within two deviations: a mean is one number, and a narrower prior would pull it to 0.
            let wide = |p: &ParameterDeclaration| 0.5 * p.plausible_low.abs().max(p.plausible_high.abs());
            let sizes: Vec<f64> = one.parameters.iter().map(wide).collect();
            posterior::weigh(data, spread, &sizes, &|values| balance.signature(one.kind, values))
        })
        .collect();
    let priors: f64 = all.iter().map(|one| one.prior).sum();
    let odds: Vec<f64> = weighed
        .iter()
        .zip(all)
        .map(|(w, one)| one.prior / priors * (w.log_evidence - nothing).exp())
        .collect();
    let total: f64 = 1.0 + odds.iter().sum::<f64>();
    let weighed = odds.iter().zip(weighed).map(|(o, w)| (o / total, w)).collect();
    (1.0 / total, weighed)
}

fn change(candidate: &Candidate, posterior: f64, weighed: &Weighed) -> Change {
    let (rotor, second_rotor) = match candidate.kind {
        Kind::Rotor(rotor) => (Some(rotor + 1), None),
        Kind::Pair(first, second) => (Some(first + 1), Some(second + 1)),
        _ => (None, None),
    };
    let label = match candidate.kind {
        Kind::Rotor(rotor) => format!("thrust of rotor {}", rotor + 1),
        Kind::Pair(first, second) => format!("thrust of rotors {} and {}", first + 1, second + 1),
        Kind::Mass => "mass, or the thrust of all rotors".to_owned(),
        Kind::Load => "a load at a place".to_owned(),
    };
    Change {
        effect: candidate.effect.clone(),
        rotor,
        second_rotor,
        label,
        posterior,
        parameters: parameters_of(&candidate.parameters, &weighed.values, &weighed.deviations),
    }
}

/// The fewest changes that together have [`NAMED`]; none unless "nothing has changed" is improbable.
fn named(unchanged: f64, ranking: &[Change]) -> Vec<Change> {
    if unchanged > 1.0 - NAMED {
        return Vec::new();
    }
    let mut named = Vec::new();
    let mut sum = 0.0;
    for one in ranking {
        sum += one.posterior;
        named.push(one.clone());
        if sum >= NAMED {
            break;
        }
    }
    named
}

/// Smallest loss that would be named on every rotor, everything else being as in the healthy mean.
fn smallest_loss(spread: &Spread, balance: &Balance<'_>, all: &[Candidate]) -> Option<f64> {
    let shown = |rotor: usize, loss: f64| {
        let data = balance.signature(Kind::Rotor(rotor), &[-loss]);
        weigh_all(&data, spread, balance, all).1[rotor].0 >= NAMED
    };
    let rotors = balance.healthy.len();
    let all_shown = |step: usize| (0..rotors).all(|rotor| shown(rotor, step as f64 * LOSS_STEP));
    // A larger loss shows more clearly, so bisection finds the smallest.
    let (mut hidden, mut seen) = (0, LOSS_STEPS);
    if !all_shown(seen) {
        return None;
    }
    while seen - hidden > 1 {
        let middle = usize::midpoint(hidden, seen);
        if all_shown(middle) {
            seen = middle;
        } else {
            hidden = middle;
        }
    }
    Some(seen as f64 * LOSS_STEP)
}

impl Trim {
    /// What [`Self::sentence`] says, in a word.
    pub fn outcome(&self) -> Outcome {
        match self.named.as_slice() {
            [] if self.unchanged > 0.5 => Outcome::NoChange,
            [] => Outcome::ProbablyChanged,
            _ => Outcome::Changed,
        }
    }
}

fn sentence(trim: &Trim) -> String {
    let count = trim.baseline.len();
    let told = |one: &Change| {
        let values: Vec<String> = one
            .parameters
            .iter()
            .map(|p| {
                format!("{} = {:.3} ± {:.3} {}", p.symbol, p.value, p.interval_95, p.unit)
                    .trim_end()
                    .to_owned()
            })
            .collect();
        format!("{} ({})", one.label, values.join(", "))
    };
    match trim.named.as_slice() {
        [] if trim.outcome() == Outcome::NoChange => format!(
            "Against {count} healthy flights nothing has changed for certain (probability of no change {:.0} %).",
            100.0 * trim.unchanged
        ),
        [] => {
            let likeliest = trim.ranking.first().map_or_else(String::new, |one| {
                format!(
                    "; the likeliest is {}, probability {:.0} %",
                    told(one),
                    100.0 * one.posterior
                )
            });
            format!(
                "Against {count} healthy flights something has probably changed ({:.0} %), and what is not certain enough to be named{likeliest}.",
                100.0 * (1.0 - trim.unchanged)
            )
        }
        [one] => format!(
            "Against {count} healthy flights changed: {}, probability {:.1} %.",
            told(one),
            100.0 * one.posterior
        ),
        several => format!(
            "Against {count} healthy flights something changed, and these flights cannot distinguish {}.",
            several.iter().map(told).collect::<Vec<_>>().join(" from ")
        ),
    }
}

#[cfg(test)]
mod tests;
