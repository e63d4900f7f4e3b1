//! Result for the history of a vehicle: each rotor with its bias, its loss over the flights, and a recommended action.

use super::journal::{Event, FlightEntry, History, LossEntry};
use super::trend::{
    self, Flight, LEAST_BEFORE, LEAST_FLIGHTS, LEAST_LOSS, Named, REFERENCE_FLIGHTS, Shape, Signatures,
};
use rotortwin_flight_core::fdi::student_t::{two_sided_critical_value, two_sided_p_value};
use serde::Serialize;

/// A rotor stands out if its commanded thrust exceeds the model's by this fraction, beyond the common component.
pub const OUTSTANDING_BIAS: f64 = 0.10;
/// Maximum number of flights averaged for the present bias.
const PRESENT_FLIGHTS: usize = 3;

/// A share with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Share {
    /// Fraction.
    pub share: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Recommended action for a rotor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// None.
    Ok,
    /// Inspect its propeller, for the reasons given.
    Inspect,
    /// There are reasons, but it has been inspected since.
    Acknowledged,
    /// Fewer than [`LEAST_BEFORE`] + 1 flights since its propeller was replaced: too few to detect a change.
    TooFewFlights,
}

/// Course of a loss over the flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Course {
    /// Gradual.
    Trend,
    /// Sudden.
    Step,
}

/// A loss over the flights that is significant against the spread between them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LossOverFlights {
    /// Its course.
    pub course: Course,
    /// First flight with it, from 1; for a trend the first one evaluated.
    pub from_flight: usize,
    /// For a step that is over: the last flight with it, from 1.
    pub until_flight: Option<usize>,
    /// Number of flights evaluated.
    pub flights: usize,
    /// Fraction of the thrust lost over them.
    pub lost: Share,
    /// For a trend: fraction lost per flight.
    pub per_flight: Option<Share>,
    /// Posterior that this rotor has lost thrust.
    pub posterior: f64,
    /// Two-sided p of no loss, corrected for the rotors and shapes tried.
    pub p: f64,
}

/// The loss of a rotor in one flight relative to the first ones since a propeller replacement, if it alone had changed; negative: a gain.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlightLoss {
    /// From 1.
    pub flight: usize,
    /// Fraction; the interval is from the spread between flights.
    #[serde(flatten)]
    pub loss: Share,
}

/// A rotor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RotorView {
    /// From 1.
    pub rotor: usize,
    /// Recommended action.
    pub status: Status,
    /// Reasons, one sentence each.
    pub reasons: Vec<String>,
    /// First flight since its propeller was replaced, from 1.
    pub since_flight: usize,
    /// Commanded thrust over the model's, minus 1 and the common component: mean of up to three last flights.
    pub bias: Option<Share>,
    /// Its loss over the flights.
    pub loss: Option<LossOverFlights>,
    /// Flight by flight, since the last propeller replacement of any rotor.
    pub course: Vec<FlightLoss>,
}

/// A flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlightView {
    /// From 1.
    pub flight: usize,
    /// Its log.
    pub log: String,
    /// Hash of its file.
    pub log_hash: String,
    /// UTC, if known.
    pub date: Option<String>,
    /// Evaluated seconds in the air.
    pub air_s: f64,
    /// Commanded thrust of all rotors over the model's in hover, minus 1: battery, air, mass, tilt.
    pub common_bias: f64,
    /// Bias of each rotor beyond that.
    pub bias: Vec<f64>,
    /// Losses within the flight.
    pub losses: Vec<LossEntry>,
    /// Suspect rotors, from 1, of an ambiguous verdict.
    pub suspects: Vec<usize>,
    /// Smallest detectable loss within the flight.
    pub smallest_loss: Vec<f64>,
}

/// A maintenance event.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MaintenanceView {
    /// `acknowledge` or `reset`.
    pub event: &'static str,
    /// From 1.
    pub rotor: usize,
    /// Flights before it.
    pub after_flight: usize,
    /// Who.
    pub by: String,
    /// When, UTC.
    pub date: String,
    /// Findings or work done.
    pub note: String,
}

/// The evaluated history of a vehicle.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FleetView {
    /// The vehicle.
    pub vehicle: String,
    /// Reference model of the biases.
    pub model: String,
    /// Content hash of its version.
    pub model_hash: String,
    /// Ordered by date, otherwise by entry.
    pub by_date: bool,
    /// Spread of rotors between flights beyond the common component, 1 σ, fraction of thrust; none while unknown.
    pub spread: Option<f64>,
    /// Change of the common component per flight, if it exceeds the spread.
    pub common_per_flight: Option<Share>,
    /// Something has changed in one of these rotors, from 1, which cannot be distinguished.
    pub suspects: Vec<usize>,
    /// The rotors.
    pub rotors: Vec<RotorView>,
    /// The flights.
    pub flights: Vec<FlightView>,
    /// Maintenance events.
    pub maintenance: Vec<MaintenanceView>,
}

/// 1 − e⁻ˣ with its interval.
fn lost(x: f64, half_width: f64) -> Share {
    let share = |x: f64| 1.0 - (-x).exp();
    Share {
        share: share(x),
        low: share(x - half_width),
        high: share(x + half_width),
    }
}

fn without_common(values: &[f64]) -> (f64, Vec<f64>) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (mean, values.iter().map(|x| x - mean).collect())
}

fn percent(share: &Share) -> String {
    format!(
        "{:.1} % [{:.1}, {:.1}]",
        100.0 * share.share,
        100.0 * share.low,
        100.0 * share.high
    )
}

/// Positions of events among the flights.
struct Places {
    /// Flights before the last replacement of each rotor's propeller.
    reset: Vec<usize>,
    /// Flights before the last acknowledgement of each rotor since then.
    acknowledged: Vec<Option<usize>>,
}

/// Builds the view.
pub fn view(history: &History) -> FleetView {
    let rotors = history.rotor_count();
    let signatures = Signatures::of(&history.vehicle.signatures);
    let entries: Vec<&FlightEntry> = history.flights().collect();
    let mut places = Places {
        reset: vec![0; rotors],
        acknowledged: vec![None; rotors],
    };
    let mut maintenance = Vec::new();
    let mut flights: Vec<Flight> = Vec::new();
    let mut mount = 0;
    for event in &history.events {
        let (word, entry) = match event {
            Event::Vehicle(_) => continue,
            Event::Flight(entry) => {
                flights.push(Flight {
                    asked: entry.asked.clone(),
                    mount,
                });
                continue;
            }
            Event::Acknowledge(entry) => {
                places.acknowledged[entry.rotor - 1] = Some(flights.len());
                ("acknowledge", entry)
            }
            Event::Reset(entry) => {
                places.reset[entry.rotor - 1] = flights.len();
                places.acknowledged[entry.rotor - 1] = None;
                mount += 1;
                ("reset", entry)
            }
        };
        maintenance.push(MaintenanceView {
            event: word,
            rotor: entry.rotor,
            after_flight: flights.len(),
            by: entry.by.clone(),
            date: entry.date.clone(),
            note: entry.note.clone(),
        });
    }
    let whole = trend::assess(&flights, &signatures);
    let mut suspects: Vec<usize> = Vec::new();
    let views = (0..rotors)
        .map(|rotor| {
            let begin = places.reset[rotor];
            let window = &flights[begin..];
            let found = trend::assess(window, &signatures);
            // An ambiguous change concerns the rotors whose history it is.
            if found.suspects.contains(&rotor) {
                suspects.push(rotor + 1);
            }
            rotor_view(
                rotor,
                begin,
                &flights,
                &entries,
                &found,
                places.acknowledged[rotor],
                &signatures,
            )
        })
        .collect();
    FleetView {
        vehicle: history.vehicle.name.clone(),
        model: history.vehicle.model.clone(),
        model_hash: history.vehicle.model_hash.clone(),
        by_date: history.by_date,
        spread: (whole.freedom > 0.0).then_some(whole.spread),
        common_per_flight: common_per_flight(&flights),
        suspects,
        rotors: views,
        flights: entries
            .iter()
            .enumerate()
            .map(|(k, entry)| flight_view(k, entry))
            .collect(),
        maintenance,
    }
}

fn flight_view(k: usize, entry: &FlightEntry) -> FlightView {
    let (common, own) = without_common(&entry.asked);
    FlightView {
        flight: k + 1,
        log: entry.log.clone(),
        log_hash: entry.log_hash.clone(),
        date: entry.date.clone(),
        air_s: entry.air_s,
        common_bias: common.exp_m1(),
        bias: own.iter().map(|x| x.exp_m1()).collect(),
        losses: entry.losses.clone(),
        suspects: entry.suspects.clone(),
        smallest_loss: entry.smallest_loss.clone(),
    }
}

/// Slope of the common component, if it exceeds the spread at the level of all claims.
fn common_per_flight(flights: &[Flight]) -> Option<Share> {
    if flights.len() < LEAST_FLIGHTS {
        return None;
    }
    let count = flights.len() as f64;
    let common: Vec<f64> = flights.iter().map(|f| without_common(&f.asked).0).collect();
    let mean = common.iter().sum::<f64>() / count;
    let middle = (count - 1.0) / 2.0;
    let place = |t: usize| t as f64 - middle;
    let weight: f64 = (0..flights.len()).map(|t| place(t) * place(t)).sum();
    let slope = common
        .iter()
        .enumerate()
        .map(|(t, c)| place(t) * (c - mean))
        .sum::<f64>()
        / weight;
    let rest: f64 = common
        .iter()
        .enumerate()
        .map(|(t, c)| (c - mean - slope * place(t)).powi(2))
        .sum();
    let freedom = count - 2.0;
    let known_to = (rest / freedom / weight).sqrt().max(1e-9);
    if two_sided_p_value(slope / known_to, freedom) > trend::FALSE_CLAIMS {
        return None;
    }
    let half = two_sided_critical_value(0.05, freedom)? * known_to;
    Some(Share {
        share: slope.exp_m1(),
        low: (slope - half).exp_m1(),
        high: (slope + half).exp_m1(),
    })
}

fn loss_view(named: &Named, begin: usize, count: usize, trials: usize) -> LossOverFlights {
    let span = (count - 1) as f64;
    let (course, from, until_flight) = match named.shape {
        Shape::Ramp => (Course::Trend, begin, None),
        Shape::Step(at) => (Course::Step, begin + at, None),
        Shape::Episode(from, end) => (Course::Step, begin + from, Some(begin + end)),
    };
    LossOverFlights {
        course,
        from_flight: from + 1,
        until_flight,
        flights: count,
        lost: lost(named.total, named.half_width),
        per_flight: (course == Course::Trend).then(|| lost(named.total / span, named.half_width / span)),
        posterior: named.posterior,
        p: (named.p * trials as f64).min(1.0),
    }
}

fn rotor_view(
    rotor: usize,
    begin: usize,
    flights: &[Flight],
    entries: &[&FlightEntry],
    found: &trend::Finding,
    acknowledged: Option<usize>,
    signatures: &Signatures,
) -> RotorView {
    let window = &flights[begin..];
    let named = found.named.iter().find(|one| one.rotor == rotor);
    let trials = flights.first().map_or(1, |f| f.asked.len()) * (window.len().saturating_sub(LEAST_BEFORE) + 1);
    let loss = named.map(|one| loss_view(one, begin, window.len(), trials));
    let own: Vec<f64> = window.iter().map(|f| without_common(&f.asked).1[rotor]).collect();
    let bias = present_bias(&own, found);
    // Each reason, and whether it was known at the time of the inspection.
    let mut reasons: Vec<(String, bool)> = Vec::new();
    let seen = |flight: usize| acknowledged.is_some_and(|place| flight < place);
    if let (Some(loss), Some(named)) = (&loss, named) {
        reasons.push(over_flights(loss, named, begin, window.len(), acknowledged));
    }
    // An acknowledged step must not hide later changes.
    if let (Some(Shape::Step(at)), Some(place)) = (named.map(|one| one.shape), acknowledged)
        && begin + at < place
    {
        let after = &flights[begin + at..];
        let again = trend::assess(after, signatures);
        if let Some(one) = again.named.iter().find(|one| one.rotor == rotor) {
            let loss = loss_view(one, begin + at, after.len(), trials);
            reasons.push(over_flights(&loss, one, begin + at, after.len(), acknowledged));
        }
    }
    if found.suspects.contains(&rotor) {
        let all: Vec<String> = found.suspects.iter().map(|i| (i + 1).to_string()).collect();
        reasons.push((
            format!(
                "thrust was lost over the flights, and these do not show by which of rotors {}",
                all.join(", ")
            ),
            acknowledged.is_some_and(|place| place == flights.len()),
        ));
    }
    for (k, entry) in entries.iter().enumerate().skip(begin) {
        for found in entry.losses.iter().filter(|found| found.rotor == rotor + 1) {
            let share = Share {
                share: found.share,
                low: found.low,
                high: found.high,
            };
            reasons.push((format!("lost {} within flight {}", percent(&share), k + 1), seen(k)));
        }
        if entry.suspects.contains(&(rotor + 1)) {
            let all: Vec<String> = entry.suspects.iter().map(ToString::to_string).collect();
            reasons.push((
                format!(
                    "something happened within flight {}, and it may have been this rotor ({} are in question)",
                    k + 1,
                    all.join(", ")
                ),
                seen(k),
            ));
        }
    }
    if let Some(bias) = bias.filter(|bias| bias.low > OUTSTANDING_BIAS) {
        reasons.push((
            format!(
                "needs {} more thrust command than the model, apart from what all rotors have in common: the propeller, or a centre of mass that differs from the model",
                percent(&bias)
            ),
            acknowledged.is_some(),
        ));
    }
    let status = match (reasons.is_empty(), reasons.iter().all(|(_, seen)| *seen)) {
        (true, _) if window.len() <= LEAST_BEFORE => Status::TooFewFlights,
        (true, _) => Status::Ok,
        (false, true) => Status::Acknowledged,
        (false, false) => Status::Inspect,
    };
    RotorView {
        rotor: rotor + 1,
        status,
        reasons: reasons.into_iter().map(|(words, _)| words).collect(),
        since_flight: begin + 1,
        bias,
        loss,
        course: course_of(rotor, flights, found, signatures),
    }
}

/// The loss over the flights as a reason, and whether it was known at the inspection: a trend counts as new after another [`LEAST_LOSS`].
fn over_flights(
    loss: &LossOverFlights,
    named: &Named,
    begin: usize,
    count: usize,
    acknowledged: Option<usize>,
) -> (String, bool) {
    match loss.per_flight {
        Some(rate) => {
            let since = acknowledged.map(|place| (begin + count - place) as f64);
            let grown = since.map(|flights| lost(named.total * flights / (count - 1) as f64, 0.0).share);
            let more = match (grown, since) {
                (Some(grown), Some(since)) if grown >= LEAST_LOSS => {
                    format!(
                        "; {:.1} % of it in the {since:.0} flights since it was acknowledged",
                        100.0 * grown
                    )
                }
                _ => String::new(),
            };
            (
                format!(
                    "loses {} of its thrust per flight, {} over {} flights{more}",
                    percent(&rate),
                    percent(&loss.lost),
                    loss.flights
                ),
                grown.is_some_and(|grown| grown < LEAST_LOSS),
            )
        }
        None => (
            match loss.until_flight {
                Some(last) => format!(
                    "had {} less thrust from flight {} to {last} and has it back since; if it has a new propeller, `rotortwin fleet reset` says so",
                    percent(&loss.lost),
                    loss.from_flight
                ),
                None => format!(
                    "has had {} less thrust since flight {}",
                    percent(&loss.lost),
                    loss.from_flight
                ),
            },
            acknowledged.is_some_and(|place| loss.until_flight.unwrap_or(loss.from_flight) <= place),
        ),
    }
}

/// Mean of the last flights with an interval from the spread.
fn present_bias(own: &[f64], found: &trend::Finding) -> Option<Share> {
    let last = &own[own.len().saturating_sub(PRESENT_FLIGHTS)..];
    if last.is_empty() {
        return None;
    }
    let mean = last.iter().sum::<f64>() / last.len() as f64;
    let half = two_sided_critical_value(0.05, found.freedom).unwrap_or(f64::INFINITY) * found.spread
        / (last.len() as f64).sqrt();
    let share = |x: f64| x.exp_m1();
    let half = if found.freedom < 1.0 { f64::INFINITY } else { half };
    half.is_finite().then(|| Share {
        share: share(mean),
        low: share(mean - half),
        high: share(mean + half),
    })
}

/// Since the last propeller replacement of any rotor: a new one changes the commands of the others.
fn course_of(rotor: usize, flights: &[Flight], found: &trend::Finding, signatures: &Signatures) -> Vec<FlightLoss> {
    let mount = flights.last().map(|flight| flight.mount);
    let begin = flights
        .iter()
        .position(|flight| Some(flight.mount) == mount)
        .unwrap_or(0);
    let window = &flights[begin..];
    if found.freedom < 1.0 || window.len() <= REFERENCE_FLIGHTS {
        return Vec::new();
    }
    let reference = &window[..REFERENCE_FLIGHTS];
    let rotors = window[0].asked.len();
    let mean: Vec<f64> = (0..rotors)
        .map(|i| reference.iter().map(|f| f.asked[i]).sum::<f64>() / reference.len() as f64)
        .collect();
    let wide = two_sided_critical_value(0.05, found.freedom).unwrap_or(f64::INFINITY);
    let half = wide * found.spread * signatures.per_spread(rotor) * (1.0 + 1.0 / reference.len() as f64).sqrt();
    window
        .iter()
        .enumerate()
        .map(|(k, flight)| {
            let change: Vec<f64> = flight.asked.iter().zip(&mean).map(|(a, m)| a - m).collect();
            FlightLoss {
                flight: begin + k + 1,
                loss: lost(signatures.loss(rotor, &change), half),
            }
        })
        .collect()
}
