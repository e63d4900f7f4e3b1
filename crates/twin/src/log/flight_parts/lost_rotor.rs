//! A lost rotor: a motor at its limit while the attitude runs away.
//!
//! The controller demands more and more of the rotor whose arm sinks, which it cannot give. If the rotor positions are
//! known: `S_i = max(0, s_i) · max(0, h_i)`, the sink rate of the arm `s_i = p y_i − q x_i` (unit positions) times the
//! excess `h_i = u_i/ū` over its mean of the past 10 s, both averaged over 0.4 s; an alarm above 1.0 rad/s. Healthy
//! flights stay below 0.7 (1500 s of 12 logs of multirotors). The first alarm counts, and only below 70° of tilt,
//! because the tumble that follows would point to the other rotors. What follows an impact of 25 m/s² is attributed to
//! the impact. An arm whose angular acceleration still follows the demand of its rotors has lost none: a growing
//! attitude oscillation of a sound vehicle sinks each arm in turn. If positions are unknown: the first output that
//! reaches its upper limit, alone, within 2 s before the tilt passes 60°. If another output is at its limit in the half
//! second before, or when that one has reached its own, it is a manoeuvre at full power.

use super::events::upper_limit;
use super::signals::Signals;
use super::{EventKind, FlightEvent, FlightPart, PartKind, RotorPlace};

/// Alarm of `S`, rad/s.
const ALARM_RAD_S: f64 = 1.0;
/// Tilt up to which an alarm counts, rad: 70°.
const UPRIGHT_RAD: f64 = 1.22;
/// Specific force that turns a vehicle over by itself, m/s².
const IMPACT_M_S2: f64 = 25.0;
/// Averages of sink rate and excess, s.
const MEAN_S: f64 = 0.4;
/// What an excess is counted from, s.
const PAST_S: f64 = 10.0;
/// An arm responds to its rotors if their correlation reaches this at the best lag within this time, s …
const RESPONSE_CORRELATION: f64 = 0.8;
const RESPONSE_LAG_S: f64 = 0.25;
/// … over this long after the alarm, and not less, s …
const RESPONSE_WINDOW_S: f64 = 1.2;
const LEAST_RESPONSE_WINDOW_S: f64 = 0.8;
/// … with a gain that is this share of the gain before, if that correlates at least this well.
const GAIN_SHARE: f64 = 0.6;
const CORRELATED: f64 = 0.3;
/// Rotors nearer than this share of the arm are on one axis.
const SAME_ARM: f64 = 0.05;
/// The attitude has run away, rad: 60°.
const AWAY_RAD: f64 = 1.05;
/// How long before that the motor reaches its limit, s.
const BEFORE_S: f64 = 2.0;
/// … for at least this long, s.
const LEAST_S: f64 = 0.12;
/// … by this much more than the mean of the others …
const ALONE: f64 = 0.15;
/// … none of which is at its limit for this long before, and until the first has been there for [`LEAST_S`], s.
const NONE_BEFORE_S: f64 = 0.5;

pub(super) fn find(signals: &Signals, parts: &[FlightPart], places: Option<&[RotorPlace]>) -> Vec<FlightEvent> {
    // In the order of the outputs; not used unless it is known of all.
    let places: Option<Vec<[f64; 2]>> = places.and_then(|places| {
        let of = |output: &usize| {
            places
                .iter()
                .find(|place| place.output == *output)
                .map(|place| place.position)
        };
        signals.outputs.iter().map(of).collect()
    });
    parts
        .iter()
        .enumerate()
        .filter(|(_, part)| matches!(part.kind, PartKind::Crash | PartKind::Upset))
        .filter_map(|(index, part)| {
            let begin_s = flight_begin(parts, index);
            match &places {
                Some(places) if signals.rates.is_some() => by_sinking_arm(signals, part, begin_s, places),
                _ => by_limit(signals, part, begin_s),
            }
        })
        .collect()
}

/// Begin of the flight that a part belongs to, s.
fn flight_begin(parts: &[FlightPart], index: usize) -> f64 {
    parts[..index]
        .iter()
        .rev()
        .take_while(|part| part.kind != PartKind::Ground)
        .last()
        .map_or(parts[index].start_s, |part| part.start_s)
}

/// Bin in which the tilt passes 60°, for good or at least once.
fn runs_away(signals: &Signals, part: &FlightPart) -> Option<usize> {
    let tilt = signals.tilt.as_ref()?;
    signals
        .between(part.start_s - 1.0, part.end_s)
        .find(|bin| tilt[*bin] > AWAY_RAD)
}

/// An impact in the second before a bin.
fn struck(signals: &Signals, bin: usize) -> bool {
    let before = signals.between(signals.start_s[bin] - 1.0, signals.end_s[bin]);
    signals
        .shock
        .as_ref()
        .is_some_and(|shock| before.into_iter().any(|bin| shock[bin] > IMPACT_M_S2))
}

fn by_limit(signals: &Signals, part: &FlightPart, begin_s: f64) -> Option<FlightEvent> {
    let away = runs_away(signals, part)?;
    let away_s = signals.start_s[away];
    let limit = upper_limit(signals) - 0.01;
    let window = signals.between((away_s - BEFORE_S).max(begin_s), away_s + MEAN_S);
    let rotors = signals.duty.len() as f64;
    // First bin of each output's stretch at the limit that reaches up to the tumble or lasts.
    let (rotor, from) = (0..signals.duty.len())
        .filter_map(|rotor| {
            let at_limit = |bin: &usize| signals.duty[rotor][*bin] > limit;
            let from = window.clone().find(at_limit)?;
            let to = (from..window.end).find(|bin| !at_limit(bin)).unwrap_or(window.end);
            let lasts = signals.end_s[to - 1] - signals.start_s[from] >= LEAST_S;
            let all: f64 = signals.duty.iter().map(|duty| duty[from]).sum();
            let others = (all - signals.duty[rotor][from]) / (rotors - 1.0);
            let about = signals.between(signals.start_s[from] - NONE_BEFORE_S, signals.start_s[from] + LEAST_S);
            let others_at_limit = (0..signals.duty.len())
                .filter(|other| *other != rotor)
                .any(|other| about.clone().any(|bin| signals.duty[other][bin] > limit));
            (lasts && signals.duty[rotor][from] - others > ALONE && !others_at_limit).then_some((rotor, from))
        })
        .min_by_key(|(_, from)| *from)?;
    let output = signals.outputs[rotor];
    let tilt = signals.tilt.as_ref()?;
    let before = signals.between(signals.start_s[from] - 1.0, signals.start_s[from]);
    let upright = !before.clone().any(|bin| tilt[bin] > AWAY_RAD);
    (upright && !struck(signals, from)).then(|| event(
        signals,
        part,
        from,
        Some(output),
        format!(
            "motor output {output} at its limit while the tilt passes {:.0}° {:.2} s later: rotor {output} lost its thrust, or most of it",
            AWAY_RAD.to_degrees(),
            away_s - signals.start_s[from]
        ),
    ))
}

fn by_sinking_arm(signals: &Signals, part: &FlightPart, begin_s: f64, places: &[[f64; 2]]) -> Option<FlightEvent> {
    let [roll_rate, pitch_rate, _] = signals.rates.as_ref()?;
    let arm = places.iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max);
    let effort = signals.effort.as_ref()?;
    let from_s = (part.start_s - BEFORE_S).max(begin_s);
    let window = signals.between(from_s, part.start_s + 1.0);
    // Averages over the past only need the bins from 11 s before on; the smoothing is centred and shifted by half its length.
    let share: Vec<Vec<f64>> = signals
        .duty
        .iter()
        .map(|duty| {
            duty.iter()
                .zip(effort)
                .map(|(duty, mean)| duty / mean.max(0.02))
                .collect()
        })
        .collect();
    let mut first: Option<(usize, usize, f64)> = None;
    for (rotor, [x, y]) in places.iter().enumerate() {
        let sink: Vec<f64> = roll_rate
            .iter()
            .zip(pitch_rate)
            .map(|(p, q)| (p * y - q * x) / arm)
            .collect();
        for bin in window.clone() {
            let now_s = signals.end_s[bin];
            let mean = |values: &[f64], from_s: f64, to_s: f64| {
                let bins = signals.between(from_s.max(begin_s), to_s);
                let count = bins.len() as f64;
                bins.map(|bin| values[bin]).sum::<f64>() / count
            };
            let sinks = mean(&sink, now_s - MEAN_S, now_s);
            let excess = mean(&share[rotor], now_s - MEAN_S, now_s)
                - mean(&share[rotor], now_s - PAST_S - MEAN_S, now_s - MEAN_S);
            let size = sinks.max(0.0) * excess.max(0.0);
            if size > ALARM_RAD_S {
                if first.is_none_or(|(_, earliest, largest)| bin < earliest || (bin == earliest && size > largest)) {
                    first = Some((rotor, bin, size));
                }
                break;
            }
        }
    }
    let (rotor, bin, size) = first?;
    let tilted = signals.tilt.as_ref().is_some_and(|tilt| tilt[bin] > UPRIGHT_RAD);
    if tilted || struck(signals, bin) || answers(signals, part, bin, (begin_s, rotor, places)) {
        return None;
    }
    let on_its_arm: Vec<usize> = (0..places.len())
        .filter(|other| {
            let [x, y] = [0, 1].map(|axis| places[*other][axis] - places[rotor][axis]);
            x.hypot(y) < SAME_ARM * arm
        })
        .map(|other| signals.outputs[other])
        .collect();
    // Two on one axis receive the same command.
    let alone = (on_its_arm.len() == 1).then_some(signals.outputs[rotor]);
    let named: Vec<String> = on_its_arm.iter().map(usize::to_string).collect();
    Some(event(
        signals,
        part,
        bin,
        alone,
        format!(
            "rotor {} lost its thrust, or most of it: its arm sinks while its motor is asked for more (sink rate times excess {size:.1} rad/s; healthy flights stay below 0.7)",
            named.join(" or ")
        ),
    ))
}

/// Whether, from an alarm on, the arm of a rotor still responds to the commands of the rotors near it.
fn answers(
    signals: &Signals,
    part: &FlightPart,
    bin: usize,
    (begin_s, rotor, places): (f64, usize, &[[f64; 2]]),
) -> bool {
    let Some([roll_rate, pitch_rate, _]) = &signals.rates else {
        return false;
    };
    let [x, y] = places[rotor];
    let arm = x.hypot(y);
    // Upwards: the opposite of its sink rate.
    let rise: Vec<f64> = roll_rate
        .iter()
        .zip(pitch_rate)
        .map(|(p, q)| (q * x - p * y) / arm)
        .collect();
    // Duties by their levers about the axis that the arm rises on.
    let asked: Vec<f64> = (0..signals.bins())
        .map(|bin| {
            let moment = |(duty, [there_x, there_y]): (&Vec<f64>, &[f64; 2])| duty[bin] * (x * there_x + y * there_y);
            signals.duty.iter().zip(places).map(moment).sum::<f64>() / (arm * arm)
        })
        .collect();
    let from_s = signals.start_s[bin] - MEAN_S;
    let blow_s = signals.shock.as_ref().and_then(|shock| {
        let after = signals.between(from_s, f64::INFINITY);
        after.into_iter().find(|bin| shock[*bin] > IMPACT_M_S2)
    });
    let to_s = (signals.start_s[bin] + RESPONSE_WINDOW_S)
        .min(part.end_s)
        .min(blow_s.map_or(f64::INFINITY, |bin| signals.start_s[bin]));
    if to_s - from_s < LEAST_RESPONSE_WINDOW_S {
        return false;
    }
    let (correlation, gain) = follows(signals, &rise, &asked, (from_s, to_s));
    let (before, gain_before) = follows(
        signals,
        &rise,
        &asked,
        ((from_s - 3.0 * PAST_S).max(begin_s), from_s - 1.0),
    );
    correlation > RESPONSE_CORRELATION && gain > 0.0 && (before < CORRELATED || gain > GAIN_SHARE * gain_before)
}

/// How the rate of change of one signal follows another within a span, s: the largest correlation of all lags, and the gain there.
fn follows(signals: &Signals, rate: &[f64], asked: &[f64], (from_s, to_s): (f64, f64)) -> (f64, f64) {
    let bins = signals.between(from_s, to_s);
    let step_s = signals.end_s[0] - signals.start_s[0];
    let lags = (RESPONSE_LAG_S / step_s).round() as usize;
    let mut best = (0.0, 0.0);
    for lag in 0..=lags {
        let pairs: Vec<(f64, f64)> = bins
            .clone()
            .filter(|bin| *bin >= lag.max(1) && bin + 1 < rate.len())
            .map(|bin| {
                let apart_s = signals.start_s[bin + 1] - signals.start_s[bin - 1];
                (asked[bin - lag], (rate[bin + 1] - rate[bin - 1]) / apart_s)
            })
            .filter(|(asked, turn)| asked.is_finite() && turn.is_finite())
            .collect();
        let count = pairs.len() as f64;
        let [sum_u, sum_a] = pairs.iter().fold([0.0, 0.0], |[u, a], pair| [u + pair.0, a + pair.1]);
        let (mean_u, mean_a) = (sum_u / count, sum_a / count);
        let [uu, ua, aa] = pairs.iter().fold([0.0; 3], |[uu, ua, aa], pair| {
            let (u, a) = (pair.0 - mean_u, pair.1 - mean_a);
            [uu + u * u, ua + u * a, aa + a * a]
        });
        let correlation = ua / (uu * aa).sqrt();
        if correlation > best.0 {
            best = (correlation, ua / uu);
        }
    }
    best
}

fn event(signals: &Signals, part: &FlightPart, bin: usize, output: Option<usize>, detail: String) -> FlightEvent {
    FlightEvent {
        kind: EventKind::LostRotor,
        start_s: signals.start_s[bin],
        end_s: part.end_s.max(signals.end_s[bin]),
        output,
        detail,
    }
}
