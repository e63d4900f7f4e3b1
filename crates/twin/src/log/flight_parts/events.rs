//! Motors at their limit, jumps of the estimator, gaps.

use super::super::resample::{median, wrapped};
use super::super::{FlightLog, names};
use super::signals::{BREAK_S, Signals};
use super::{EventKind, FlightEvent, FlightPart, PartKind};

/// Minimum time of an output at its limit, s.
const LEAST_S: f64 = 0.1;
/// Two such stretches closer than this are one, s.
const NEAR_S: f64 = 0.5;
/// Below its limit by no more than this.
const AT_LIMIT: f64 = 0.005;
/// A jump is weighed over this time: longer than the period of a 5 Hz estimator, whose column is a ramp, s.
const JUMP_S: f64 = 0.25;
/// Jumps that matter: m, m/s, rad.
const LEAST_JUMP: [f64; 3] = [0.7, 1.0, 0.25];
/// … and this many deviations of such differences over the whole log.
const DEVIATIONS: f64 = 8.0;
/// No multirotor changes its velocity faster, m/s².
const FASTEST: f64 = 25.0;

pub(super) fn gaps(log: &FlightLog) -> Vec<FlightEvent> {
    log.report
        .gaps
        .iter()
        .filter(|gap| gap.end_s - gap.start_s > 0.1)
        .map(|gap| FlightEvent {
            kind: EventKind::Gap,
            start_s: gap.start_s,
            end_s: gap.end_s,
            output: None,
            detail: format!("no rows for {:.2} s", gap.end_s - gap.start_s),
        })
        .collect()
}

/// Upper limit of the outputs: the largest value of all if it is held repeatedly, otherwise 1.
pub(super) fn upper_limit(signals: &Signals) -> f64 {
    let most = signals
        .duty
        .iter()
        .flatten()
        .copied()
        .filter(|value| value.is_finite())
        .fold(0.0, f64::max);
    let held = signals
        .duty
        .iter()
        .flatten()
        .filter(|value| **value > most - 0.001)
        .count();
    if most > 0.7 && held >= 5 { most } else { 1.0 }
}

/// Stretches of each output at its upper limit, in flight.
pub(super) fn saturated(signals: &Signals, parts: &[FlightPart]) -> Vec<FlightEvent> {
    let limit = upper_limit(signals);
    let mut events = Vec::new();
    for (duty, output) in signals.duty.iter().zip(&signals.outputs) {
        let mut stretches: Vec<(f64, f64, f64)> = Vec::new();
        for part in parts.iter().filter(|part| flies(part.kind)) {
            for bin in signals
                .between(part.start_s, part.end_s)
                .filter(|bin| duty[*bin] > limit - AT_LIMIT)
            {
                let (from, to) = (signals.start_s[bin], signals.end_s[bin]);
                match stretches.last_mut() {
                    Some(last) if from - last.1 < NEAR_S => {
                        last.1 = to;
                        last.2 += to - from;
                    }
                    _ => stretches.push((from, to, to - from)),
                }
            }
        }
        events.extend(stretches.into_iter().filter(|(.., at_limit)| *at_limit >= LEAST_S).map(
            |(start_s, end_s, at_limit)| FlightEvent {
                kind: EventKind::Saturated,
                start_s,
                end_s,
                output: Some(*output),
                detail: format!("motor output {output} at its limit ({limit:.2}) for {at_limit:.2} s"),
            },
        ));
    }
    events
}

/// In the air or on the way there.
pub(super) fn flies(kind: PartKind) -> bool {
    !matches!(kind, PartKind::Ground | PartKind::Unknown)
}

/// Jumps of position, velocity and heading that the vehicle did not make.
pub(super) fn resets(log: &FlightLog, parts: &[FlightPart]) -> Vec<FlightEvent> {
    // Between rows further apart than the interval over which a jump is evaluated, the motion of the vehicle is
    // unknown.
    if log.sample_rate_hz() * JUMP_S < 1.0 {
        return Vec::new();
    }
    let flight: Vec<(f64, f64)> = parts
        .iter()
        .filter(|part| flies(part.kind) && part.kind != PartKind::Crash)
        .map(|part| (part.start_s, part.end_s))
        .collect();
    let mut events = Vec::new();
    let velocity = names::VELOCITY.map(|name| log.column(name));
    for axis in 0..3 {
        if let Some(position) = log.column(names::POSITION[axis]) {
            let change = |a: usize, b: usize| position[b] - position[a] - integral(log, velocity[axis], a, b);
            let state = State {
                name: "position",
                column: names::POSITION[axis],
                unit: "m",
                least: LEAST_JUMP[0],
                change: &change,
            };
            events.extend(state.jumps(log, &flight));
        }
        if let Some(velocity) = velocity[axis] {
            let change = |a: usize, b: usize| velocity[b] - velocity[a];
            let state = State {
                name: "velocity",
                column: names::VELOCITY[axis],
                unit: "m/s",
                least: LEAST_JUMP[1] + FASTEST * JUMP_S,
                change: &change,
            };
            events.extend(state.jumps(log, &flight));
        }
    }
    if let (Some(yaw), Some(rate)) = (log.column(names::ATTITUDE[2]), log.column(names::RATES[2])) {
        let change = |a: usize, b: usize| wrapped(wrapped(yaw[b] - yaw[a]) - integral(log, Some(rate), a, b));
        let state = State {
            name: "heading",
            column: names::ATTITUDE[2],
            unit: "rad",
            least: LEAST_JUMP[2],
            change: &change,
        };
        events.extend(state.jumps(log, &flight));
    }
    events
}

/// Trapezoidal sum of a column between two rows; 0 without the column.
fn integral(log: &FlightLog, rate: Option<&[f64]>, a: usize, b: usize) -> f64 {
    let Some(rate) = rate else { return 0.0 };
    (a..b)
        .map(|row| 0.5 * (rate[row] + rate[row + 1]) * (log.time_s[row + 1] - log.time_s[row]))
        .sum()
}

/// An estimated state.
struct State<'a> {
    name: &'static str,
    column: &'static str,
    unit: &'static str,
    /// Smallest jump.
    least: f64,
    /// Change between two rows that the motion does not explain.
    change: &'a dyn Fn(usize, usize) -> f64,
}

impl State<'_> {
    fn jumps(&self, log: &FlightLog, flight: &[(f64, f64)]) -> Vec<FlightEvent> {
        let time = &log.time_s;
        let stride = ((0.5 * JUMP_S * log.sample_rate_hz()) as usize).max(1);
        let mut changes: Vec<(usize, usize, f64)> = Vec::new();
        let mut ahead = 0;
        for row in (0..time.len()).step_by(stride) {
            while ahead + 1 < time.len() && time[ahead] - time[row] < JUMP_S {
                ahead += 1;
            }
            if time[ahead] - time[row] < JUMP_S + BREAK_S {
                let change = (self.change)(row, ahead);
                if change.is_finite() {
                    changes.push((row, ahead, change));
                }
            }
        }
        let mut sizes: Vec<f64> = changes.iter().map(|(.., change)| change.abs()).collect();
        // Median of absolute values over 0.6745: the deviation of normal ones.
        let usual = median(&mut sizes).unwrap_or(0.0) / 0.6745;
        let most = self.least.max(DEVIATIONS * usual);
        let mut last_s = f64::NEG_INFINITY;
        let mut found = Vec::new();
        for (from, to, change) in changes {
            let (start_s, end_s) = (time[from], time[to]);
            let in_flight = flight.iter().any(|(a, b)| start_s >= *a && end_s <= *b);
            if in_flight && change.abs() > most && start_s > last_s {
                last_s = end_s;
                found.push(FlightEvent {
                    kind: EventKind::EstimatorReset,
                    start_s,
                    end_s,
                    output: None,
                    detail: format!(
                        "the estimator's {} jumps by {change:+.2} {} ({})",
                        self.name, self.unit, self.column
                    ),
                });
            }
        }
        found
    }
}
