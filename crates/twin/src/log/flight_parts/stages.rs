//! Ground, take-off, air, upset, landing, crash.
//!
//! A bin is on the ground if the motors' mean is low (a third of the way from its 2 % to its 90 % level) and the
//! vehicle is at rest, or if it has been that low for 3 s: a vehicle in the air would have fallen some 30 m. What lies
//! between is a run of flight, unless the vehicle does not move while its motors change, or shakes less than the
//! calmest flight: propellers off, or tied down. A vehicle that has come down and does not move is on the ground even
//! while its motors still carry most of it: an autopilot that has not noticed the landing lets them run.
//!
//! A racing quadrotor does fall for seconds with its motors idle, and its accelerometer shows it: on the ground it
//! measures the weight, in free fall it does not. It also accelerates more than in an impact: a force along the thrust
//! at high motor demand is not an impact.

use std::ops::Range;

use super::signals::{IDLES, Signals};
use super::{EventKind, FlightEvent, FlightPart, PartKind};

/// Tilt beyond which the model's loads no longer hold, rad: 70°.
const TILT_END_RAD: f64 = 1.22;
/// Tilt below which a flight continues, rad: 60°.
const TILT_GOOD_RAD: f64 = 1.05;
/// Tilt of a vehicle that has recovered from a tumble, rad: 30°.
const TILT_UPRIGHT_RAD: f64 = 0.52;
/// Specific force of an impact, m/s².
const IMPACT_M_S2: f64 = 35.0;
/// Specific forces logged at less than this, Hz, contain aliased samples of a vibration …
const ALIASED_HZ: f64 = 30.0;
/// … of which one counts as an impact only if the body responds by turning, rad/s, or leaning, rad, within this time of
/// it, s.
const RESPONSE_RATE_RAD_S: f64 = 1.5;
const RESPONSE_LEAN_RAD: f64 = 0.17;
const RESPONSE_WITHIN_S: f64 = 0.3;
/// Motors this low for this long: no flight, s.
const FALLEN_S: f64 = 3.0;
/// Motors low and the vehicle at rest for this long: on the ground, s.
const REST_S: f64 = 0.6;
/// Mean specific force of a vehicle that falls with idle motors, m/s²: well below its weight, above the drag of a fall
/// at 15 m/s.
const FALLS: f64 = 7.0;
/// Median rate above which a vehicle is neither lying nor carried by hand, rad/s.
const TURNS_RAD_S: f64 = 0.8;
/// A fall takes time to develop; what counts is after this, s.
const FALL_BEGINS_S: f64 = 0.7;
/// Thrust of racing quadrotors, over their weight; a larger force along the thrust is an impact, too.
const MOST_THRUST: f64 = 12.0 * 9.81;
/// Motors that run without carrying the vehicle: mean output from its 10 % to its 90 % level over the median …
const CHANGES: f64 = 0.25;
/// … and nothing moves, except for a tenth of the time at either end: deviation of force and rates.
const UNMOVED_FORCE: f64 = 0.4;
const UNMOVED_RATE_RAD_S: f64 = 0.05;
/// … of roll and pitch, which follow every step of even a gentle flight, rad; and of the height, m.
const UNMOVED_LEAN_RAD: f64 = 0.005;
const UNMOVED_HEIGHT_M: f64 = 0.4;
/// A vehicle on a bench with its motors running turns and shakes less than the calmest flight for as long as they run:
/// deviations of rates and force, the latter above that of a simulation without noise (rates may be quantised to 0);
/// and it stays at ground height, m.
const LIES_RATE_RAD_S: f64 = 0.015;
const LIES_FORCE: Range<f64> = 1e-3..0.2;
const LIES_HEIGHT_M: f64 = 0.5;
/// … or, if neither height nor neighbouring ground decides, commands its motors no higher than this.
const LIES_DUTY: f64 = 0.12;
/// … with its motors running for this long, s.
const LIES_RUNNING_S: f64 = 3.0;
/// Shorter runs are a motor test or a jerk of the throttle, s.
const SHORTEST_FLIGHT_S: f64 = 1.5;
/// Take-off and landing if no height is available, s.
const NEAR_GROUND_S: f64 = 3.0;
/// Their minimum and maximum duration, s.
const NEAR_GROUND_RANGE_S: Range<f64> = 1.0..15.0;
/// A vehicle has lifted off when its motors have been commanded this share of their flight level, for a second from
/// then on.
const LIFTS: f64 = 0.9;
const LIFTED_S: f64 = 1.0;
/// Height that is clear of the ground, m; half of the height reached if that is less.
const CLEAR_M: f64 = 1.0;
/// Flight for this long after an upset: it was not a crash, s.
const RECOVERED_S: f64 = 3.0;
/// Left out before and after an upset, s.
const UPSET_BEFORE_S: f64 = 0.3;
const UPSET_AFTER_S: f64 = 0.7;
/// At rest: deviations over 1 s of specific force, rates, roll and pitch.
const REST_FORCE: f64 = 0.6;
const REST_RATE_RAD_S: f64 = 0.1;
const REST_LEAN_RAD: f64 = 0.01;

/// Time after an impact in which a vehicle comes to rest, s; and the largest difference of its height afterwards, m.
const SETTLES_S: f64 = 1.0;
const RESTING_HEIGHT_M: f64 = 0.05;

/// A vehicle that lies with its motors still running: at rest for this long, s …
const LIES_S: f64 = 2.0;
/// … after it descended by this much, m, within this time, s …
const CAME_DOWN_M: f64 = 0.2;
const COMES_DOWN_S: f64 = 2.0;
/// … and touched: a force that its motors do not produce, m/s² …
const TOUCH: f64 = 3.0;
/// … and commanded less than this share of what carried it before.
const LIGHT: f64 = 0.985;
/// Gravity, and how far from it the force of calm flight is, m/s².
const WEIGHT: f64 = 9.81;
const CALM: f64 = 0.5;
/// Minimum duration of calm flight to determine what carries a vehicle, s.
const LEAST_CALM_S: f64 = 1.0;

const UNMOVED_WHY: &str = "the motors run and the vehicle does not move (no propellers, or tied down)";

/// The whole log as one kind, interrupted only where the log has a gap.
pub(super) fn all_of(signals: &Signals, kind: PartKind, why: &str) -> Vec<FlightPart> {
    let mut found = Vec::new();
    let mut from = 0;
    for bin in 1..=signals.bins() {
        if bin == signals.bins() || signals.breaks_after(bin - 1) {
            found.push(part(signals, from..bin, kind, why));
            from = bin;
        }
    }
    found
}

/// All parts, interrupted only where the log has a gap.
pub(super) fn parts(signals: &Signals) -> Vec<FlightPart> {
    let bins = signals.bins();
    if bins == 0 {
        return Vec::new();
    }
    let Some(effort) = &signals.effort else {
        return vec![part(
            signals,
            0..bins,
            PartKind::Unknown,
            "no motor output, throttle or rotor speed in the log",
        )];
    };
    let level = ground_level(effort);
    let (on_ground, unmoved) = ground(signals, effort, level);
    let mut found = Vec::new();
    let mut from = 0;
    for bin in 1..=bins {
        let same = |of: &[bool]| bin < bins && of[bin] == of[from];
        if !same(&on_ground) || !same(&unmoved) || signals.breaks_after(bin - 1) {
            if on_ground[from] {
                let why = if unmoved[from] { UNMOVED_WHY } else { "" };
                found.push(part(signals, from..bin, PartKind::Ground, why));
            } else {
                flight(signals, from..bin, &on_ground, &mut found);
            }
            from = bin;
        }
    }
    join(found)
}

/// Impacts of 35 m/s² and more in a landing.
pub(super) fn hard_landings(signals: &Signals, parts: &[FlightPart]) -> Vec<FlightEvent> {
    let Some(shock) = &signals.shock else {
        return Vec::new();
    };
    parts
        .iter()
        .filter(|part| part.kind == PartKind::Landing)
        .filter_map(|part| {
            let bins = signals.between(part.start_s, part.end_s);
            let worst = bins.max_by(|a, b| shock[*a].total_cmp(&shock[*b]))?;
            (shock[worst] > IMPACT_M_S2).then(|| FlightEvent {
                kind: EventKind::HardLanding,
                start_s: signals.start_s[worst],
                end_s: signals.end_s[worst],
                output: None,
                detail: format!("hard landing: {:.0} m/s²", shock[worst]),
            })
        })
        .collect()
}

fn part(signals: &Signals, bins: Range<usize>, kind: PartKind, why: &str) -> FlightPart {
    FlightPart {
        kind,
        start_s: signals.start_s[bins.start],
        end_s: signals.end_s[bins.end - 1],
        why: why.to_owned(),
    }
}

/// Mean output below which a vehicle is on the ground: between idling and flying; idle itself if the log has no time on
/// the ground.
fn ground_level(effort: &[f64]) -> f64 {
    /// No vehicle flies at so little.
    const IDLE: f64 = 0.03;
    /// An idling motor is commanded less than this share of its flight level.
    const IDLE_SHARE: f64 = 0.6;
    /// At this share of the range the thrust (u^1.3 to u²) is at most a quarter of the weight.
    const LEVEL: f64 = 0.35;
    let mut sorted: Vec<f64> = effort.iter().copied().filter(|value| value.is_finite()).collect();
    if sorted.is_empty() {
        return f64::INFINITY;
    }
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
    let (low, high) = (at(0.02), at(0.9));
    if at(0.995) < IDLES {
        return f64::INFINITY;
    }
    if low > IDLE_SHARE * high {
        IDLE
    } else {
        (low + LEVEL * (high - low)).max(IDLE)
    }
}

/// Bins on the ground; and those of them in which motors run without carrying the vehicle.
fn ground(signals: &Signals, effort: &[f64], level: f64) -> (Vec<bool>, Vec<bool>) {
    if level.is_infinite() {
        // No motor ever leaves idle: whatever moves the vehicle, it does not fly.
        return (vec![true; effort.len()], vec![false; effort.len()]);
    }
    let smooth = signals.smooth(effort, 0.5);
    let still = at_rest(signals);
    let low: Vec<bool> = smooth.iter().map(|value| !beyond(*value, level)).collect();
    let mut on_ground = low.clone();
    let mut from = 0;
    for bin in 1..=low.len() {
        if bin < low.len() && low[bin] == low[from] {
            continue;
        }
        if low[from] {
            let length_s = signals.end_s[bin - 1] - signals.start_s[from];
            let resting = (from..bin).filter(|bin| still[*bin]).count();
            let at_end = from == 0 || bin == low.len();
            let lies = 2 * resting > bin - from && (length_s >= REST_S || at_end);
            let down = lies || length_s >= FALLEN_S;
            if !down || falls(signals, from..bin) || turns(signals, from..bin) {
                on_ground[from..bin].fill(false);
            }
        }
        from = bin;
    }
    on_ground[lies_from(signals, &still)..].fill(true);
    for lies in lies_lightly(signals, effort, &still, &on_ground) {
        on_ground[lies].fill(true);
    }
    let unmoved = stand_still(signals, effort, &on_ground);
    for (on_ground, unmoved) in on_ground.iter_mut().zip(&unmoved) {
        *on_ground |= unmoved;
    }
    // A jerk of the throttle is not a flight.
    let mut from = 0;
    for bin in 1..=on_ground.len() {
        if bin < on_ground.len() && on_ground[bin] == on_ground[from] {
            continue;
        }
        let short = signals.end_s[bin - 1] - signals.start_s[from] < SHORTEST_FLIGHT_S;
        if !on_ground[from] && short && from > 0 && bin < on_ground.len() {
            on_ground[from..bin].fill(true);
        }
        from = bin;
    }
    (on_ground, unmoved)
}

/// The first bin from which a vehicle lies on the ground until the end of the log while its motors run on as in a
/// hover: after an impact it rests, lower than anywhere before. How much of it the ground carries is unknown. The
/// number of bins, if there is none.
fn lies_from(signals: &Signals, still: &[bool]) -> usize {
    let none = still.len();
    let (Some(shock), Some(height)) = (&signals.shock, &signals.height) else {
        return none;
    };
    let Some(blow) = shock.iter().rposition(|shock| beyond(*shock, IMPACT_M_S2)) else {
        return none;
    };
    let rest = signals.between(signals.end_s[blow] + SETTLES_S, f64::INFINITY);
    let resting = still[rest.clone()].iter().filter(|still| **still).count();
    if rest.is_empty() || 10 * resting < 9 * rest.len() {
        return none;
    }
    let lowest = |bins: &[f64]| bins.iter().copied().fold(f64::INFINITY, f64::min);
    let unmoved = deviation(height[rest.clone()].iter().copied()) < RESTING_HEIGHT_M;
    let down = lowest(&height[rest]) < lowest(&height[..blow]) + RESTING_HEIGHT_M;
    if unmoved && down { blow + 1 } else { none }
}

/// Bins in which a vehicle rests on the ground while its motors carry most of it, each run from the touch on: it
/// descended, a force other than its motors pushed it, and then it stands still, as low as anywhere before and with
/// less thrust than carried it in the calm moments of its flight. Such a landing may be soft: its impact need not reach
/// [`IMPACT_M_S2`].
fn lies_lightly(signals: &Signals, effort: &[f64], still: &[bool], on_ground: &[bool]) -> Vec<Range<usize>> {
    let (Some(shock), Some(height)) = (&signals.shock, &signals.height) else {
        return Vec::new();
    };
    let mut found = Vec::new();
    let mut from = 0;
    for bin in 1..=still.len() {
        let rests = |bin: usize| still[bin] && !on_ground[bin];
        if bin < still.len() && rests(bin) == rests(from) && !signals.breaks_after(bin - 1) {
            continue;
        }
        let run = from..bin;
        from = bin;
        if !rests(run.start) || signals.end_s[run.end - 1] - signals.start_s[run.start] < LIES_S {
            continue;
        }
        // The scatter over a second still includes the touch when the vehicle already stands.
        let start_s = signals.start_s[run.start];
        let before = signals.between(start_s - COMES_DOWN_S, start_s);
        let calm = (0..before.start).filter(|bin| !on_ground[*bin] && (shock[*bin] - WEIGHT).abs() < CALM);
        let calm: Vec<usize> = calm.collect();
        let calm_s: f64 = calm.iter().map(|bin| signals.end_s[*bin] - signals.start_s[*bin]).sum();
        let carries = usual(effort, calm.iter().copied()).filter(|_| calm_s >= LEAST_CALM_S);
        let asked = usual(effort, run.clone());
        let (Some(carries), Some(asked)) = (carries, asked) else {
            continue;
        };
        // A force that the motors produce, by the square of their command, is not a touch.
        let pushed = |bin: &usize| shock[*bin] - WEIGHT * (effort[*bin] / carries).powi(2).max(1.0) > TOUCH;
        let Some(touch) = before.clone().find(pushed) else {
            continue;
        };
        let lowest = |bins: &[f64]| bins.iter().copied().fold(f64::INFINITY, f64::min);
        let highest = height[before.start..=touch]
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        let stands = usual(height, run.clone()).unwrap_or(f64::NAN);
        let unmoved = deviation(run.clone().map(|bin| height[bin])) < RESTING_HEIGHT_M;
        let is_lowest = stands < lowest(&height[..touch]) + RESTING_HEIGHT_M;
        if unmoved && is_lowest && highest > stands + CAME_DOWN_M && asked < LIGHT * carries {
            found.push(touch..run.end);
        }
    }
    found
}

/// Whether the accelerometer shows, in bins with idle motors, that nothing carries the vehicle.
fn falls(signals: &Signals, bins: Range<usize>) -> bool {
    // If a vehicle lies tilted, one axis alone reads less than its weight.
    let Some(shock) = signals.shock.as_ref().filter(|_| signals.has_all_forces) else {
        return false;
    };
    let from_s = signals.start_s[bins.start] + FALL_BEGINS_S;
    let fall = bins.filter(|bin| signals.start_s[*bin] >= from_s && shock[*bin].is_finite());
    let mut forces: Vec<f64> = fall.map(|bin| shock[bin]).collect();
    super::super::resample::median(&mut forces).is_some_and(|force| force < FALLS)
}

/// Whether the body turns in most of some bins, which it does not do while lying or being carried.
fn turns(signals: &Signals, bins: Range<usize>) -> bool {
    let Some([roll, pitch, yaw]) = &signals.rates else {
        return false;
    };
    let rate = |bin: usize| (roll[bin].powi(2) + pitch[bin].powi(2) + yaw[bin].powi(2)).sqrt();
    let mut rates: Vec<f64> = bins.map(rate).filter(|rate| rate.is_finite()).collect();
    super::super::resample::median(&mut rates).is_some_and(|rate| rate > TURNS_RAD_S)
}

/// Runs in which motors change by much while force, rates, attitude and height do not move at all are on the ground;
/// and so are those in which motors change little and the body stays at ground height and shakes less than any vehicle
/// in flight.
fn stand_still(signals: &Signals, effort: &[f64], on_ground: &[bool]) -> Vec<bool> {
    let mut found = vec![false; on_ground.len()];
    let (Some(shock), Some(rates)) = (&signals.shock, &signals.rates) else {
        return found;
    };
    let mut from = 0;
    for bin in 1..=on_ground.len() {
        if bin < on_ground.len() && on_ground[bin] == on_ground[from] && !signals.breaks_after(bin - 1) {
            continue;
        }
        let run = from..bin;
        from = bin;
        if on_ground[run.start] {
            continue;
        }
        let mut efforts: Vec<f64> = run.clone().map(|bin| effort[bin]).filter(|e| e.is_finite()).collect();
        efforts.sort_by(f64::total_cmp);
        let (Some(last), at) = (efforts.len().checked_sub(1), |share: f64| {
            (share * efforts.len() as f64) as usize
        }) else {
            continue;
        };
        let [low, middle, high] = [0.1, 0.5, 0.9].map(|share| efforts[at(share).min(last)]);
        let unmoved = |values: &[f64], most: f64| deviation(run.clone().map(|bin| values[bin])) < most;
        if high - low > CHANGES * middle
            && unmoved(shock, UNMOVED_FORCE)
            && rates.iter().all(|rate| unmoved(rate, UNMOVED_RATE_RAD_S))
            && signals
                .lean
                .iter()
                .flatten()
                .all(|lean| unmoved(lean, UNMOVED_LEAN_RAD))
            && signals.height.iter().all(|height| unmoved(height, UNMOVED_HEIGHT_M))
            || lies(signals, run.clone(), on_ground)
        {
            found[run].fill(true);
        }
    }
    found
}

/// Whether a body lies on the ground for all of a run of its motors.
fn lies(signals: &Signals, run: Range<usize>, on_ground: &[bool]) -> bool {
    let (Some(shock), Some(rates)) = (&signals.shock, &signals.rates) else {
        return false;
    };
    let of = |values: &[f64]| deviation(run.clone().map(|bin| values[bin]));
    let turns = rates.iter().map(|rate| of(rate)).fold(0.0, f64::max);
    let length_s = signals.end_s[run.end - 1] - signals.start_s[run.start];
    if length_s < LIES_RUNNING_S || beyond(turns, LIES_RATE_RAD_S) || !LIES_FORCE.contains(&of(shock)) {
        return false;
    }
    // The ground next to the run, because the height drifts.
    let ground = signals.height.as_ref().and_then(|height| {
        let before = (0..run.start).rev().take_while(|bin| on_ground[*bin]);
        let after = (run.end..on_ground.len()).take_while(|bin| on_ground[*bin]);
        let ground = usual(height, before.take(50)).or_else(|| usual(height, after.take(50)))?;
        Some(usual(height, run.clone())? - ground)
    });
    match ground {
        Some(above) => above.abs() < LIES_HEIGHT_M,
        // A simulated hover in still air, in which the log begins and ends, is equally calm, but at a higher command.
        None => signals
            .duty
            .first()
            .and(signals.effort.as_ref())
            .and_then(|effort| usual(effort, run.clone()))
            .is_some_and(|asked| asked < LIES_DUTY),
    }
}

/// Range of the available values from their 10 % to their 90 % level: a jerk at an end does not count. 0 if there are
/// none.
fn deviation(values: impl Iterator<Item = f64>) -> f64 {
    /// Distance of these levels in a normal distribution, in standard deviations.
    const APART: f64 = 2.56;
    let mut sorted: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| {
        sorted
            .get((share * sorted.len() as f64) as usize)
            .copied()
            .unwrap_or(0.0)
    };
    (at(0.9) - at(0.1)) / APART
}

/// Above a limit; a missing value is not.
fn beyond(value: f64, most: f64) -> bool {
    value > most
}

/// Where force, rates, roll and pitch are constant for a second; true if the log has none of them.
fn at_rest(signals: &Signals) -> Vec<bool> {
    let mut still = vec![true; signals.bins()];
    let mut check = |values: &[f64], most: f64| {
        for (still, scatter) in still.iter_mut().zip(signals.scatter(values, 1.0)) {
            *still &= !beyond(scatter, most);
        }
    };
    if let Some(shock) = &signals.shock {
        check(shock, REST_FORCE);
    }
    for rate in signals.rates.iter().flatten() {
        check(rate, REST_RATE_RAD_S);
    }
    for angle in signals.lean.iter().flatten() {
        check(angle, REST_LEAN_RAD);
    }
    still
}

/// Splits a run of flight into its parts.
fn flight(signals: &Signals, run: Range<usize>, on_ground: &[bool], found: &mut Vec<FlightPart>) {
    let from_ground = run.start > 0 && on_ground[run.start - 1] && !signals.breaks_after(run.start - 1);
    let to_ground = run.end < on_ground.len() && on_ground[run.end] && !signals.breaks_after(run.end - 1);
    let upsets = upsets(signals, run.clone());
    let end_s = signals.end_s[run.end - 1];
    let crash = upsets.last().filter(|upset| {
        let after = end_s - upset.end_s;
        upset.tumbles
            && after < RECOVERED_S
            && (to_ground || run.end == signals.bins() || after < 0.5)
            && !(run.end == signals.bins() && back_upright(signals, upset))
    });
    let last = crash.map_or(run.end, |crash| {
        signals
            .between(0.0_f64.min(signals.start_s[0]), crash.start_s - UPSET_BEFORE_S)
            .end
    });
    let upright = run.start..last.clamp(run.start, run.end);
    let off = if from_ground {
        clear(signals, upright.clone(), run.start - 1, false)
    } else {
        upright.start
    };
    let down = if to_ground && crash.is_none() {
        clear(signals, upright.clone(), run.end, true)
    } else {
        upright.end
    };
    // A hop is one take-off and one landing.
    let (off, down) = if off <= down {
        (off, down)
    } else {
        ((off + down) / 2, (off + down) / 2)
    };
    let mut add = |bins: Range<usize>, kind, why: &str| {
        if !bins.is_empty() {
            found.push(part(signals, bins, kind, why));
        }
    };
    add(upright.start..off, PartKind::TakeOff, "");
    let mut at = off;
    for upset in &upsets {
        let bins = signals.between(upset.start_s - UPSET_BEFORE_S, upset.end_s + UPSET_AFTER_S);
        let (from, to) = (bins.start.clamp(at, down), bins.end.clamp(at, down));
        if from < to {
            add(at..from, PartKind::Air, "");
            add(from..to, PartKind::Upset, &upset.why());
            at = to;
        }
    }
    add(at..down, PartKind::Air, "");
    add(down..upright.end, PartKind::Landing, "");
    if let Some(crash) = crash {
        add(upright.end..run.end, PartKind::Crash, &crash.why());
    }
}

/// Whether a log ends in flight with the vehicle upright again after a tumble, and without an impact since: the log
/// then contains no crash.
fn back_upright(signals: &Signals, upset: &Upset) -> bool {
    let Some(tilt) = &signals.tilt else {
        return false;
    };
    let upright = tilt.last().is_some_and(|tilt| *tilt < TILT_UPRIGHT_RAD);
    let since = signals.between(upset.start_s, f64::INFINITY);
    let struck = |shock: &Vec<f64>| since.clone().any(|bin| beyond(shock[bin], IMPACT_M_S2));
    upright && !signals.shock.as_ref().is_some_and(struck)
}

/// Where a run is clear of the ground: the first bin after it from the left, or the first bin near it again from the right.
///
/// * `ground`: the nearest bin on the ground
fn clear(signals: &Signals, run: Range<usize>, ground: usize, backwards: bool) -> usize {
    let (start_s, end_s) = (
        signals.start_s[run.start.min(signals.bins() - 1)],
        signals.end_s[run.end.max(1) - 1],
    );
    let by_time = |seconds: f64| {
        if backwards {
            signals
                .between(signals.start_s[0], end_s - seconds)
                .end
                .clamp(run.start, run.end)
        } else {
            signals
                .between(signals.start_s[0], start_s + seconds)
                .end
                .clamp(run.start, run.end)
        }
    };
    let (least, most) = (by_time(NEAR_GROUND_RANGE_S.start), by_time(NEAR_GROUND_RANGE_S.end));
    let Some(height) = &signals.height else {
        return by_time(NEAR_GROUND_S);
    };
    let mut reached: Vec<f64> = run
        .clone()
        .map(|bin| height[bin] - height[ground])
        .filter(|h| h.is_finite())
        .collect();
    if reached.is_empty() {
        return by_time(NEAR_GROUND_S);
    }
    reached.sort_by(f64::total_cmp);
    let top = reached[(reached.len() - 1) * 4 / 5];
    if top < 0.1 {
        // The height does not follow the flight.
        return by_time(NEAR_GROUND_S);
    }
    let clear_m = CLEAR_M.min(0.5 * top);
    // Its motors may run long before it lifts off, and it may fly low for any length of time.
    let most = if backwards {
        most
    } else {
        lifted(signals, run.clone()).map_or(most, |lift| {
            most.min(by_time(signals.start_s[lift] - start_s + NEAR_GROUND_S))
                .max(least)
        })
    };
    let is_clear = |bin: &usize| height[*bin] - height[ground] > clear_m;
    if backwards {
        let last = run.clone().rev().find(is_clear).map_or(run.start, |bin| bin + 1);
        last.clamp(most, least)
    } else {
        let first = run.clone().find(is_clear).unwrap_or(run.end);
        first.clamp(least, most)
    }
}

/// Median of a signal over some bins, ignoring missing values.
fn usual(values: &[f64], bins: impl Iterator<Item = usize>) -> Option<f64> {
    let mut values: Vec<f64> = bins.map(|bin| values[bin]).filter(|value| value.is_finite()).collect();
    super::super::resample::median(&mut values)
}

/// The first bin of a run from which the motors are commanded nearly their flight level without interruption.
fn lifted(signals: &Signals, run: Range<usize>) -> Option<usize> {
    let effort = signals.effort.as_ref()?;
    let flies = LIFTS * usual(effort, run.clone())?;
    run.clone().find(|bin| {
        let from_s = signals.start_s[*bin];
        effort[*bin] > flies
            && usual(effort, signals.between(from_s, from_s + LIFTED_S)).is_some_and(|mean| mean > flies)
    })
}

/// A stretch beyond the limits of the model.
#[derive(Debug, Clone)]
struct Upset {
    start_s: f64,
    end_s: f64,
    tilt_rad: f64,
    shock: f64,
    /// Beyond 70°, not only an impact.
    tumbles: bool,
}

impl Upset {
    fn why(&self) -> String {
        let tilt = (self.tilt_rad > 0.0).then(|| format!("tilt up to {:.0}°", self.tilt_rad.to_degrees()));
        let shock = (self.shock > IMPACT_M_S2).then(|| format!("{:.0} m/s²", self.shock));
        [tilt, shock].into_iter().flatten().collect::<Vec<_>>().join(", ")
    }
}

fn upsets(signals: &Signals, run: Range<usize>) -> Vec<Upset> {
    let tilt = |bin: usize| signals.tilt.as_ref().map_or(0.0, |tilt| tilt[bin]);
    let pull = pulls(signals, run.clone());
    // A force along the thrust comes from the motors if their command is high.
    let shock = |bin: usize| {
        let (Some(shock), Some(force)) = (&signals.shock, &signals.force) else {
            return 0.0;
        };
        if force[bin] < pull(bin).min(MOST_THRUST) {
            (shock[bin].powi(2) - force[bin].powi(2)).max(0.0).sqrt()
        } else {
            shock[bin]
        }
    };
    let mut found: Vec<Upset> = Vec::new();
    for bin in run.clone() {
        let (tilt_rad, shock) = (tilt(bin), shock(bin));
        if !beyond(tilt_rad, TILT_END_RAD) && !beyond(shock, IMPACT_M_S2) {
            continue;
        }
        let (start_s, end_s) = (signals.start_s[bin], signals.end_s[bin]);
        let tumbles = tilt_rad > TILT_END_RAD || signals.tilt.is_none();
        match found.last_mut() {
            Some(last) if !recovers(signals, last.end_s, start_s) => {
                last.end_s = end_s;
                last.tilt_rad = last.tilt_rad.max(tilt_rad);
                last.shock = last.shock.max(shock);
                last.tumbles |= tumbles;
            }
            _ => found.push(Upset {
                start_s,
                end_s,
                tilt_rad,
                shock,
                tumbles,
            }),
        }
    }
    found.retain(|upset| !is_one_sample_of_a_vibration(signals, upset));
    found
}

/// Whether an upset is the force of a single sample, from an accelerometer that is logged too slowly to distinguish an
/// impact from the usual vibration, while neither rates nor attitude show one. Without these it cannot be decided, and
/// the upset stays.
fn is_one_sample_of_a_vibration(signals: &Signals, upset: &Upset) -> bool {
    let slow = (f64::MIN_POSITIVE..ALIASED_HZ).contains(&signals.shock_hz);
    // Linearly interpolated to its neighbours, a sample extends over less than two intervals.
    let alone = slow && upset.end_s - upset.start_s < 2.0 / signals.shock_hz;
    if !alone || beyond(upset.tilt_rad, TILT_END_RAD) || (signals.rates.is_none() && signals.lean.is_none()) {
        return false;
    }
    let about = signals.between(upset.start_s - RESPONSE_WITHIN_S, upset.end_s + RESPONSE_WITHIN_S);
    let turns = signals
        .rates
        .iter()
        .flatten()
        .any(|rate| about.clone().any(|bin| beyond(rate[bin].abs(), RESPONSE_RATE_RAD_S)));
    let leans = signals.lean.iter().flatten().any(|lean| {
        let values = || about.clone().map(|bin| lean[bin]).filter(|lean| lean.is_finite());
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min) > RESPONSE_LEAN_RAD
    });
    !turns && !leans
}

/// The force along the thrust that the motors can produce in a bin, m/s²: one and a half times a hover's, by the square
/// of their command now or in the last tenths of a second; 0 if the command is not above the usual.
fn pulls(signals: &Signals, run: Range<usize>) -> impl Fn(usize) -> f64 {
    const OVER_USUAL: f64 = 1.2;
    const HOVER: f64 = 1.5 * 9.81;
    const LAG_S: f64 = 0.15;
    let effort = signals.effort.clone().unwrap_or_default();
    let mut usual: Vec<f64> = run
        .filter_map(|bin| effort.get(bin))
        .copied()
        .filter(|e| e.is_finite())
        .collect();
    let usual = super::super::resample::median(&mut usual).unwrap_or(f64::INFINITY);
    let start_s = signals.start_s.clone();
    move |bin| {
        let most = (0..=bin)
            .rev()
            .take_while(|before| start_s[bin] - start_s[*before] <= LAG_S)
            .filter_map(|before| effort.get(before))
            .fold(0.0, |most: f64, effort| most.max(*effort));
        if most > OVER_USUAL * usual {
            HOVER * (most / usual).powi(2)
        } else {
            0.0
        }
    }
}

/// Whether the vehicle flies again between two upsets: a second below 60°.
fn recovers(signals: &Signals, from_s: f64, to_s: f64) -> bool {
    let upright = |bin: usize| {
        !signals
            .tilt
            .as_ref()
            .is_some_and(|tilt| beyond(tilt[bin], TILT_GOOD_RAD))
    };
    to_s - from_s > 1.0 && signals.between(from_s, to_s).all(upright)
}

/// Merges neighbours of one kind and reason.
fn join(parts: Vec<FlightPart>) -> Vec<FlightPart> {
    let mut joined: Vec<FlightPart> = Vec::new();
    for part in parts {
        match joined.last_mut() {
            Some(last)
                if last.kind == part.kind && last.why == part.why && (last.end_s - part.start_s).abs() < 1e-9 =>
            {
                last.end_s = part.end_s;
            }
            _ => joined.push(part),
        }
    }
    joined
}
