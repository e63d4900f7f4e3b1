//! Parts of a flight: on the ground, taking off, in the air, landing, crash; and what happened in it.
//!
//! ```text
//! FlightLog ─▶ bins of 0.04 s (signals) ─▶ runs of flight, their ends, upsets and crashes (stages) ─▶ FlightParts
//!                                      └─▶ motors at their limit, lost rotor, estimator resets, gaps (events) ─┘
//! ```
//! Works with any log: with motor outputs alone, better with attitude, accelerometer, rates, height. A model is judged
//! in the air only ([`FlightParts::in_the_air`]): on the ground the ground carries the vehicle, near it there is ground
//! effect, and beyond 70° of tilt a multirotor's loads are no longer those of the model.
//!
//! A finding that the whole log has no flight (motors that idle, a battery without current) takes precedence: no part
//! of it is a flight then.
//!
//! Limits: a flight that begins and ends outside the log has neither take-off nor landing; a vehicle carried by hand
//! with running motors appears to fly, unless the battery current shows otherwise; without attitude a tumble shows only
//! by its impact.

mod events;
mod lost_rotor;
mod signals;
mod stages;

use serde::Serialize;

use super::FlightLog;
pub use super::event::{EventKind, FlightEvent};
use signals::Signals;

/// Most events that are listed; a motor that rattles against its limit makes thousands.
const MOST_EVENTS: usize = 200;

/// Kind of a part of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
#[schema(as = FlightPartKind)]
pub enum PartKind {
    /// Motors off or idle, the vehicle at rest or carried.
    Ground,
    /// From the first lift to clear of the ground.
    TakeOff,
    /// In the air, upright: the part on which a model is calibrated and judged.
    Air,
    /// Beyond 70° of tilt or 35 m/s², followed by further flight.
    Upset,
    /// From near the ground to motors off.
    Landing,
    /// From the loss of attitude to the end of the flight.
    Crash,
    /// The log contains no evidence.
    Unknown,
}

impl PartKind {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Ground => "on the ground",
            Self::TakeOff => "taking off",
            Self::Air => "in the air",
            Self::Upset => "upset",
            Self::Landing => "landing",
            Self::Crash => "crash",
            Self::Unknown => "not known",
        }
    }
}

/// A part of a flight.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct FlightPart {
    /// What it is.
    pub kind: PartKind,
    /// s, on the log's time.
    pub start_s: f64,
    /// s, on the log's time.
    pub end_s: f64,
    /// The evidence for it, one clause; empty if the kind is self-explanatory.
    pub why: String,
}

/// Parts of a flight, and events in it.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct FlightParts {
    /// In chronological order, without overlap.
    pub parts: Vec<FlightPart>,
    /// In chronological order.
    pub events: Vec<FlightEvent>,
    /// Number of events that are not listed.
    pub more_events: usize,
    /// Channels used to find this, in words.
    pub found_from: Vec<&'static str>,
}

/// Where the rotor of an output is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotorPlace {
    /// Motor output, from 1, as in `duty_1`.
    pub output: usize,
    /// Forward and right of the centre, any unit of length.
    pub position: [f64; 2],
}

impl FlightLog {
    /// Parts of the flight and its events.
    ///
    /// * `rotors`: where the rotor of each output is, if known: a lost rotor is then identified by the arm that sinks,
    ///   otherwise by the motor that reaches its limit first
    pub fn flight_parts(&self, rotors: Option<&[RotorPlace]>) -> FlightParts {
        let signals = Signals::of(self);
        let parts = match (self.says_no_flight(), &self.report.other_vehicle) {
            (Some(why), _) => stages::all_of(&signals, PartKind::Ground, why),
            // An aeroplane glides with its motor off: the criteria for a multirotor on the ground do not apply to it.
            (None, Some(other)) => stages::all_of(&signals, PartKind::Unknown, other),
            (None, None) => stages::parts(&signals),
        };
        let mut events = events::gaps(self);
        events.extend(events::resets(self, &parts));
        let saturated = events::saturated(&signals, &parts);
        events.extend(lost_rotor::find(&signals, &parts, rotors));
        events.extend(saturated);
        events.extend(stages::hard_landings(&signals, &parts));
        events.extend(self.happenings());
        events.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        let more_events = events.len().saturating_sub(MOST_EVENTS);
        // Events that decide about a flight are kept in any case.
        if more_events > 0 {
            let mut kept = 0;
            events.retain(|event| {
                let decides = event.kind.decides();
                kept += usize::from(!decides);
                decides || kept <= MOST_EVENTS
            });
        }
        FlightParts {
            parts,
            events,
            more_events,
            found_from: signals.sources.clone(),
        }
    }
}

impl FlightLog {
    /// Actions of autopilot and pilot within the rows; the initial mode is reported at the beginning.
    fn happenings(&self) -> Vec<FlightEvent> {
        let (Some(&from), Some(&to)) = (self.time_s.first(), self.time_s.last()) else {
            return Vec::new();
        };
        let all = &self.report.happenings;
        let before = |event: &&FlightEvent| {
            event.kind == EventKind::Mode && event.detail.starts_with("flight mode") && event.start_s < from
        };
        let at_first = all.iter().rfind(before).map(|event| FlightEvent {
            start_s: from,
            end_s: from,
            ..event.clone()
        });
        let within = all
            .iter()
            .filter(|event| event.end_s >= from && event.start_s >= from && event.start_s <= to);
        at_first.into_iter().chain(within.cloned()).collect()
    }
}

impl FlightLog {
    /// Upper limit of the motor outputs: the largest value if it is held repeatedly, otherwise 1.
    pub fn output_limit(&self) -> f64 {
        events::upper_limit(&Signals::of(self))
    }
}

impl FlightParts {
    /// Seconds in which a model may be calibrated and judged: from, to.
    pub fn in_the_air(&self) -> Vec<(f64, f64)> {
        self.of(&[PartKind::Air, PartKind::Unknown])
    }

    /// Seconds of some kinds of parts, neighbours joined.
    pub fn of(&self, kinds: &[PartKind]) -> Vec<(f64, f64)> {
        let mut found: Vec<(f64, f64)> = Vec::new();
        for part in self.parts.iter().filter(|part| kinds.contains(&part.kind)) {
            match found.last_mut() {
                Some(last) if (last.1 - part.start_s).abs() < 1e-9 => last.1 = part.end_s,
                _ => found.push((part.start_s, part.end_s)),
            }
        }
        found
    }

    /// Why nothing in the log can have been a flight, if so: it is on the ground from end to end.
    pub fn no_flight(&self) -> Option<String> {
        let ground = |part: &FlightPart| part.kind == PartKind::Ground;
        if self.parts.is_empty() || !self.parts.iter().all(ground) {
            return None;
        }
        let why = self.parts.iter().map(|part| &part.why).find(|why| !why.is_empty());
        Some(
            why.cloned()
                .unwrap_or_else(|| "on the ground from end to end".to_owned()),
        )
    }

    /// Seconds in the air.
    pub fn air_s(&self) -> f64 {
        self.in_the_air().iter().map(|(from, to)| to - from).sum()
    }

    /// Lines of the parts and of the events: times, those of the log's own clock, words.
    ///
    /// * `clock_start_s`: the log's own clock at our 0 s, where it has one
    pub fn lines(&self, clock_start_s: Option<f64>) -> (Vec<String>, Vec<String>) {
        /// More parts or events than this are counted, not listed.
        const LISTED: usize = 24;
        let time = |from: f64, to: f64| {
            if from == to {
                let own =
                    clock_start_s.map_or_else(String::new, |start| format!(" (log's clock {:.2} s)", start + from));
                return format!("{from:.2} s{own}");
            }
            let own = clock_start_s.map_or_else(String::new, |start| {
                format!(" (log's clock {:.2} to {:.2} s)", start + from, start + to)
            });
            format!("{from:.2} to {to:.2} s{own}")
        };
        let joined = |words: &str, detail: &str| {
            if detail.is_empty() {
                words.to_owned()
            } else {
                format!("{words}: {detail}")
            }
        };
        let cut = |mut lines: Vec<String>, more: usize| {
            let hidden = lines.len().saturating_sub(LISTED) + more;
            lines.truncate(LISTED);
            if hidden > 0 {
                lines.push(format!("and {hidden} more"));
            }
            lines
        };
        let parts = self
            .parts
            .iter()
            .map(|part| {
                format!(
                    "{}  {}",
                    time(part.start_s, part.end_s),
                    joined(part.kind.words(), &part.why)
                )
            })
            .collect();
        // What decides first, then by time.
        let mut order: Vec<&FlightEvent> = self.events.iter().collect();
        order.sort_by_key(|event| !event.kind.decides());
        let events = order
            .into_iter()
            .map(|event| format!("{}  {}", time(event.start_s, event.end_s), event.detail))
            .collect();
        (cut(parts, 0), cut(events, self.more_events))
    }
}

#[cfg(test)]
mod tests;
