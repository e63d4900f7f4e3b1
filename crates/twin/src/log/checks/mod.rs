//! Checks of an accepted log: suspicious values, missing channels, delays of its columns relative to each other.

mod coverage;
mod delays;
mod ground;
pub(crate) mod kinematics;
mod turns;
mod vehicle;

pub(crate) use coverage::stands_still;
pub(crate) use ground::{idle_current, motors_change, moves_under_power};
pub use turns::TurnChanges;
pub(crate) use vehicle::LEAST_TO_CONTRADICT_HZ;

use super::findings::{Finding, FindingKind};
use super::{FlightLog, names};
use kinematics::{Fit, IDENTITY};

/// Signed axes that turn ENU into NED: north is the second, east the first, down the third turned round.
const FROM_ENU: kinematics::Axes = [(1, 1.0), (0, 1.0), (2, -1.0)];
/// FLU into FRD, and NWU into NED.
const FROM_FLU: kinematics::Axes = [(0, 1.0), (1, -1.0), (2, -1.0)];
/// Signed axes explain a motion, and others do not, when the shares of variance differ by this much.
const CLEARLY: f64 = 0.25;
/// Axes are accepted when they explain this share of the motion.
const BELIEVED: f64 = 0.5;
/// A gain further from 1 than this factor is not a calibration error, noise or a smoothing estimator, if the two sides
/// share nearly all of their motion. If they share less, an estimator that lags in gentle flight imitates more, and the
/// factor must be that of a unit.
const GAIN_TOLERANCE: f64 = 1.4;
const GAIN_TOLERANCE_LOOSE: f64 = 2.0;
/// A gain is accepted when the two sides share this much of their motion; a single one, without another that confirms
/// it, needs more.
const GAIN_BELIEVED: f64 = 0.8;
const SINGLE_GAIN_BELIEVED: f64 = 0.95;

/// Fills the parts of the report that need the whole log.
pub(crate) fn examine(log: &mut FlightLog) {
    let mut findings = Vec::new();
    coverage::thin_log(log, &mut findings);
    coverage::rows_too_far_apart(log, &mut findings);
    coverage::stuck_and_saturated(log, &mut findings);
    ground::no_flight(log, &mut findings);
    axes_units_and_clock(log, &mut findings);
    log.report.missing = coverage::missing(log);
    log.report.noise = coverage::noise(log);
    log.report.delays = delays::estimate(log);
    findings.sort_by(|a, b| a.kind.cmp(&b.kind));
    log.report.findings = findings;
}

fn push(findings: &mut Vec<Finding>, kind: FindingKind, detail: String) {
    if !findings.iter().any(|finding| finding.kind == kind) {
        findings.push(Finding { kind, detail });
    }
}

/// Axes written out: `(y, x, −z)`.
fn axes_text(axes: &kinematics::Axes) -> String {
    let parts = axes.map(|(axis, sign)| format!("{}{}", if sign < 0.0 { "−" } else { "" }, ["x", "y", "z"][axis]));
    format!("({})", parts.join(", "))
}

/// A determinant of −1 is a mirror: no frame of reference, a sign error.
fn is_proper(axes: &kinematics::Axes) -> bool {
    let swaps = (0..3).flat_map(|i| (0..i).map(move |j| (j, i)));
    let odd = swaps.filter(|(j, i)| axes[*j].0 > axes[*i].0).count() % 2 == 1;
    let minus = axes.iter().filter(|(_, sign)| *sign < 0.0).count() % 2 == 1;
    odd == minus
}

/// Axes that are clearly wrong.
fn wrong_axes(fit: &Fit) -> bool {
    fit.axes != IDENTITY && fit.explained > BELIEVED && fit.explained - fit.explained_as_is > CLEARLY
}

/// True if the velocity changes as the accelerometer says it does, times the factor of a smaller unit.
pub(crate) fn velocity_is_in_a_smaller_unit(log: &FlightLog) -> bool {
    let fit = kinematics::velocity_pairs(log).and_then(|pairs| pairs.fit());
    fit.is_some_and(|fit| fit.explained > GAIN_BELIEVED && fit.gain > GAIN_TOLERANCE_LOOSE)
}

/// The same signed axes on all axes that move.
fn same_where_moving(fit: &Fit, axes: &kinematics::Axes) -> bool {
    (0..3).all(|axis| !fit.moving[axis] || fit.axes[axis] == axes[axis])
}

fn axes_units_and_clock(log: &FlightLog, findings: &mut Vec<Finding>) {
    let rates = kinematics::rate_pairs(log).and_then(|pairs| pairs.fit());
    let velocity = kinematics::velocity_pairs(log).and_then(|pairs| pairs.fit());
    // For a force in other axes no comparison of the two adds anything.
    let velocity = velocity.filter(|fit| !force_in_world_axes(log, fit, findings));
    let position = kinematics::position_pairs(log).and_then(|pairs| pairs.fit());

    degrees_without_motion(log, findings);
    if !angles_in_degrees(log, rates.as_ref(), findings) {
        body_axes(log, rates.as_ref(), velocity.as_ref(), findings);
        gains(rates.as_ref(), velocity.as_ref(), position.as_ref(), findings);
    }
    let z_up = findings
        .iter()
        .any(|finding| matches!(finding.kind, FindingKind::BodyAxesFlu | FindingKind::UpsideDownAxes));
    world_axes(velocity.as_ref(), position.as_ref(), z_up, findings);
    lift_down(log, findings);
    for (what, fit) in [
        ("body rates and attitude", &rates),
        ("specific force and velocity", &velocity),
        ("velocity and position", &position),
    ] {
        if let Some(fit) = fit
            && fit.explained < 0.1
            && !fit.hidden
            && findings.is_empty()
        {
            push(
                findings,
                FindingKind::Inconsistent,
                format!(
                    "{what} move, but not together: {:.0} % of the motion agrees",
                    100.0 * fit.explained.max(0.0)
                ),
            );
        }
    }
}

/// An accelerometer whose readings have been rotated into the world's axes: with every tilt, gravity is then counted
/// twice, and half of the force signal is the motion.
fn force_in_world_axes(log: &FlightLog, body: &Fit, findings: &mut Vec<Finding>) -> bool {
    /// Gain of a right pair, and the share of the motion that it has in common.
    const RIGHT: std::ops::Range<f64> = 0.8..1.25;
    const SHARED: f64 = 0.85;
    let is_right = |fit: &Fit| fit.explained_as_is > SHARED && RIGHT.contains(&fit.gain) && fit.axes == IDENTITY;
    if is_right(body) || !(body.moving[0] && body.moving[1]) {
        return false;
    }
    let Some(world) = kinematics::world_force_pairs(log).and_then(|pairs| pairs.fit()) else {
        return false;
    };
    if !is_right(&world) {
        return false;
    }
    push(
        findings,
        FindingKind::SwappedAxes,
        format!(
            "the accelerometer reads along the axes of the world, not of the body: taken so, it explains {:.0} % of the change of the velocity with a gain of {:.2}; \
             as body axes {:.0} % with {:.2}; the attitude turns it back",
            100.0 * world.explained_as_is,
            world.gain,
            100.0 * body.explained_as_is.max(0.0),
            body.gain
        ),
    );
    true
}

/// Without an accelerometer: the faster the rotors turn, the more the vehicle accelerates upwards.
fn lift_down(log: &FlightLog, findings: &mut Vec<Finding>) {
    /// Correlation below which z points up: inflow and a supply that empties weaken a correlation, they do not turn it round.
    const TURNED_ROUND: f64 = -0.6;
    /// Deviations of the force, m/s², and of the duty, share of its mean, above which there is a usable climb.
    const FORCE_M_S2: f64 = 0.5;
    const DUTY: f64 = 0.03;
    if !findings.is_empty() || log.column(names::ACCEL[2]).is_some() {
        return;
    }
    let Some(pairs) = kinematics::lift_pairs(log) else {
        return;
    };
    let count = pairs.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / count;
    let (force, duty) = (mean(&|pair| pair.0), mean(&|pair| pair.1));
    let deviations = [
        mean(&|pair| (pair.0 - force).powi(2)).sqrt(),
        mean(&|pair| (pair.1 - duty).powi(2)).sqrt(),
    ];
    let correlation = mean(&|pair| (pair.0 - force) * (pair.1 - duty)) / (deviations[0] * deviations[1]);
    if deviations[0] > FORCE_M_S2 && deviations[1] > DUTY * duty && correlation < TURNED_ROUND {
        push(
            findings,
            FindingKind::Inconsistent,
            format!(
                "the faster the motors turn, the more the vehicle seems to fall (correlation {correlation:.2}): z of velocity and attitude points up; \
                 north-east-down and forward-right-down were expected (`frame` of a mapping)"
            ),
        );
    }
}

/// Ranges that no radians can have.
fn degrees_without_motion(log: &FlightLog, findings: &mut Vec<Finding>) {
    /// 2000 deg/s gyroscopes end at 35 rad/s, 4000 deg/s ones at 70.
    const FASTEST_RAD_S: f64 = 75.0;
    /// One turn, with rounding: roll does not count turns.
    const LARGEST_ROLL_RAD: f64 = 2.0 * std::f64::consts::PI + 0.01;
    let largest = |names: &[&str]| -> f64 {
        let columns = names.iter().filter_map(|name| log.column(name));
        columns
            .flatten()
            .filter(|value| value.is_finite())
            .fold(0.0, |most, value| value.abs().max(most))
    };
    let rate = largest(&names::RATES);
    if rate > FASTEST_RAD_S {
        push(
            findings,
            FindingKind::RatesInDegrees,
            format!("a body rate of {rate:.0} is beyond any gyroscope in rad/s; rad/s was expected"),
        );
    }
    let roll = largest(&names::ATTITUDE[..1]);
    if roll > LARGEST_ROLL_RAD {
        push(
            findings,
            FindingKind::AnglesInDegrees,
            format!("a roll of {roll:.1} cannot be radians; rad was expected"),
        );
    }
}

/// Small angles in degrees pass for radians; read as degrees they must fit the rates better.
fn angles_in_degrees(log: &FlightLog, rates: Option<&Fit>, findings: &mut Vec<Finding>) -> bool {
    if findings
        .iter()
        .any(|finding| finding.kind == FindingKind::AnglesInDegrees)
    {
        return true;
    }
    if rates.is_some_and(|fit| fit.explained_as_is > 0.7 && (1.0 / GAIN_TOLERANCE..GAIN_TOLERANCE).contains(&fit.gain))
    {
        return false;
    }
    let mut scaled = log.clone();
    for name in names::ATTITUDE {
        if let Some(values) = scaled.columns.get_mut(name) {
            for value in values {
                *value = value.to_radians();
            }
        }
    }
    let Some(fit) = kinematics::rate_pairs(&scaled).and_then(|pairs| pairs.fit()) else {
        return false;
    };
    let fits = fit.explained_as_is > 0.7 && (1.0 / GAIN_TOLERANCE..GAIN_TOLERANCE).contains(&fit.gain);
    if fits {
        push(
            findings,
            FindingKind::AnglesInDegrees,
            format!(
                "read as degrees the attitude follows the body rates (gain {:.2}, {:.0} % of the motion), read as radians it does not",
                fit.gain,
                100.0 * fit.explained_as_is
            ),
        );
    }
    fits
}

/// FLU, swapped axes, upside down.
fn body_axes(log: &FlightLog, rates: Option<&Fit>, velocity: Option<&Fit>, findings: &mut Vec<Finding>) {
    /// Half of gravity: a flight's mean specific force is near ±9.81 m/s².
    const HALF_GRAVITY_M_S2: f64 = 4.9;
    let means = names::ACCEL.map(|name| log.column(name).map(kinematics::mean));
    let up = means[2].is_some_and(|z| z > HALF_GRAVITY_M_S2);
    let rates_flu = rates.is_some_and(|fit| wrong_axes(fit) && same_where_moving(fit, &FROM_FLU));
    if let Some(fit) = rates.filter(|fit| wrong_axes(fit)) {
        let share = format!(
            "{:.0} % of the motion, as they are {:.0} %",
            100.0 * fit.explained,
            100.0 * fit.explained_as_is.max(0.0)
        );
        if rates_flu {
            push(
                findings,
                FindingKind::BodyAxesFlu,
                format!(
                    "the body rates fit the attitude with y and z reversed ({share}); forward-right-down was expected"
                ),
            );
        } else {
            push(
                findings,
                FindingKind::SwappedAxes,
                format!("the body rates fit the attitude as {} ({share})", axes_text(&fit.axes)),
            );
        }
    }
    if up {
        let z = means[2].unwrap_or(f64::NAN);
        // With z-up axes everywhere, attitude, velocity and accelerometer still agree with each other.
        let all_up = velocity.is_some_and(|fit| fit.explained > BELIEVED && !is_proper(&fit.axes));
        if rates_flu || all_up {
            push(
                findings,
                FindingKind::BodyAxesFlu,
                format!(
                    "the accelerometer's z reads {z:+.2} m/s² on average; forward-right-down reads −9.81 in level flight"
                ),
            );
        } else {
            push(
                findings,
                FindingKind::UpsideDownAxes,
                format!(
                    "the accelerometer's z reads {z:+.2} m/s² on average; forward-right-down reads −9.81 in level flight (z up, or mounted upside down)"
                ),
            );
        }
        if all_up {
            push(
                findings,
                FindingKind::WorldAxesEnu,
                "attitude, specific force and velocity agree only with z up in the world as well; north-east-down was expected".to_owned(),
            );
        }
    } else if let [Some(x), Some(y), Some(z)] = means
        && z.abs() < HALF_GRAVITY_M_S2
        && x.abs().max(y.abs()) > 1.5 * HALF_GRAVITY_M_S2
    {
        push(
            findings,
            FindingKind::SwappedAxes,
            format!(
                "gravity lies on the wrong axis: the accelerometer reads ({x:.2}, {y:.2}, {z:.2}) m/s² on average; (0, 0, −9.81) was expected"
            ),
        );
    }
}

/// Velocity and position in ENU or with exchanged axes.
///
/// With `z_up`, a mirror image between force and velocity only repeats the sign of the accelerometer.
fn world_axes(velocity: Option<&Fit>, position: Option<&Fit>, z_up: bool, findings: &mut Vec<Finding>) {
    let cases = [
        ("velocity", "the specific force", velocity),
        ("position", "the velocity", position),
    ];
    for (what, against, fit) in cases {
        let Some(fit) = fit.filter(|fit| wrong_axes(fit)) else {
            continue;
        };
        let enu = same_where_moving(fit, &FROM_ENU) || same_where_moving(fit, &FROM_FLU);
        let share = format!(
            "{:.0} % of the motion, as it is {:.0} %",
            100.0 * fit.explained,
            100.0 * fit.explained_as_is.max(0.0)
        );
        if enu {
            let name = if same_where_moving(fit, &FROM_ENU) {
                "east-north-up"
            } else {
                "north-west-up"
            };
            push(
                findings,
                FindingKind::WorldAxesEnu,
                format!("the {what} fits {against} as {name} ({share}); north-east-down was expected"),
            );
        } else if is_proper(&fit.axes) || !z_up {
            push(
                findings,
                FindingKind::SwappedAxes,
                format!("the {what} fits {against} as {} ({share})", axes_text(&fit.axes)),
            );
        }
    }
}

/// Gains that are not 1: degrees, other units, a wrong clock.
fn gains(rates: Option<&Fit>, velocity: Option<&Fit>, position: Option<&Fit>, findings: &mut Vec<Finding>) {
    let believed = |fit: Option<&Fit>| {
        fit.filter(|fit| fit.explained > GAIN_BELIEVED)
            .map(|fit| (fit.gain, fit.explained))
    };
    let off = |(gain, explained): (f64, f64)| {
        let tolerance = if explained > SINGLE_GAIN_BELIEVED {
            GAIN_TOLERANCE
        } else {
            GAIN_TOLERANCE_LOOSE
        };
        !(1.0 / tolerance..tolerance).contains(&gain)
    };
    let known = [
        ("attitude against body rates", believed(rates)),
        ("velocity against specific force", believed(velocity)),
        ("position against velocity", believed(position)),
    ];
    let degree = std::f64::consts::PI / 180.0;
    if let Some((gain, _)) = known[0].1
        && (0.6..1.6).contains(&(gain / degree))
    {
        push(
            findings,
            FindingKind::RatesInDegrees,
            format!(
                "the body rates are {:.1} times what the attitude says; a radian is 57.3 degrees",
                1.0 / gain
            ),
        );
        return;
    }
    let wrong = known.iter().filter(|(_, known)| known.is_some_and(off)).count();
    let gains: Vec<(&str, f64)> = known
        .iter()
        .filter_map(|(what, known)| known.map(|(gain, _)| (*what, gain)))
        .collect();
    let surest = [rates, velocity, position]
        .into_iter()
        .flatten()
        .map(|fit| fit.explained)
        .fold(0.0, f64::max);
    if wrong == 0 || (gains.len() == 1 && surest < SINGLE_GAIN_BELIEVED) {
        return;
    }
    let list = gains
        .iter()
        .map(|(what, gain)| format!("{what} {gain:.2}"))
        .collect::<Vec<_>>()
        .join(", ");
    let least = gains.iter().map(|(_, gain)| *gain).fold(f64::INFINITY, f64::min);
    let most = gains.iter().map(|(_, gain)| *gain).fold(0.0, f64::max);
    if wrong == gains.len() && most / least < GAIN_TOLERANCE * GAIN_TOLERANCE {
        let factor = (most * least).sqrt();
        push(
            findings,
            FindingKind::TimeScale,
            format!(
                "everything moves {factor:.2} times as far as its rate of change times the time stamps says ({list}): the time stamps are {factor:.2} times too short"
            ),
        );
    } else {
        let likely = likely_units(known[1].1.map(|one| one.0), known[2].1.map(|one| one.0));
        push(
            findings,
            FindingKind::ScaleMismatch,
            format!("gains that should be 1: {list}; a unit is wrong{likely}"),
        );
    }
}

/// The units that gains of velocity against specific force and of position against velocity are those of: `: the velocity seems to be in
/// mm/s and the position in mm; m/s and m were expected`.
fn likely_units(velocity: Option<f64>, position: Option<f64>) -> String {
    /// How far a gain may be from that of a unit, a factor: less than half of the way to the nearest other one.
    const NEAR: f64 = 1.04;
    /// Readings of 1 m and of 1 m/s in other units.
    const LENGTHS: [(&str, f64); 3] = [("mm", 1000.0), ("cm", 100.0), ("ft", 1.0 / 0.3048)];
    const SPEEDS: [(&str, f64); 4] = [("mm/s", 1000.0), ("cm/s", 100.0), ("km/h", 3.6), ("ft/s", 1.0 / 0.3048)];
    let named = |gain: Option<f64>, units: &[(&'static str, f64)]| {
        let near = |unit: &&(&str, f64)| gain.is_some_and(|gain| (1.0 / NEAR..NEAR).contains(&(gain / unit.1)));
        units.iter().find(near).map(|(name, _)| *name)
    };
    // Without an accelerometer nothing tells whether the velocity is right.
    let Some(gain) = velocity else {
        return String::new();
    };
    let speed = named(Some(gain), &SPEEDS);
    let length = named(position.map(|position| position * gain), &LENGTHS);
    match (speed, length) {
        (Some(speed), Some(length)) => {
            format!(": the velocity seems to be in {speed} and the position in {length}; m/s and m were expected")
        }
        (Some(speed), None) => format!(": the velocity seems to be in {speed}; m/s was expected"),
        (None, Some(length)) => format!(": the position seems to be in {length}; m was expected"),
        (None, None) => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 40 s at 500 Hz: a velocity in steps of 0.01 m/s at 16 Hz that swings by `speed`, m/s, under an accelerometer that shakes and shows no swing.
    fn hover(speed: f64) -> FlightLog {
        let rows = 20_000_u32;
        let time: Vec<f64> = (0..rows).map(|k| 0.002 * f64::from(k)).collect();
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|t| f(*t)).collect() };
        // Swaying: columns that never change are a finding of their own.
        let mut columns: Vec<(String, Vec<f64>)> = Vec::new();
        for (axis, (angle, rate)) in names::ATTITUDE.iter().zip(&names::RATES).enumerate() {
            let phase = 0.7 * axis as f64;
            columns.push(((*angle).to_owned(), of(&|t| 0.01 * (3.0 * t + phase).sin())));
            columns.push(((*rate).to_owned(), of(&|t| 0.03 * (3.0 * t + phase).cos())));
        }
        let mut state = 1_u32;
        for (name, rest) in names::ACCEL.iter().zip([0.0, 0.0, -9.81]) {
            let mut shakes = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f64::from(state >> 8) / f64::from(1_u32 << 24) - 0.5
            };
            columns.push(((*name).to_owned(), (0..rows).map(|_| rest + 9.0 * shakes()).collect()));
        }
        for (axis, name) in names::VELOCITY.iter().enumerate() {
            let swing = |t: f64| {
                let held = (16.0 * t).floor() / 16.0;
                (100.0 * speed * (2.0 * held + axis as f64).sin()).round() / 100.0
            };
            columns.push(((*name).to_owned(), of(&swing)));
        }
        FlightLog::from_columns("hover", time, columns).expect("a log")
    }

    /// Climbs and dips by motors that follow one another, without an accelerometer; `sign`: of the velocity down.
    fn climbs(sign: f64) -> FlightLog {
        let rows = 4000_u32;
        let time: Vec<f64> = (0..rows).map(|k| 0.01 * f64::from(k)).collect();
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|t| f(*t)).collect() };
        let mut columns: Vec<(String, Vec<f64>)> = Vec::new();
        for (axis, (angle, rate)) in names::ATTITUDE.iter().zip(&names::RATES).enumerate() {
            let phase = 0.7 * axis as f64;
            columns.push(((*angle).to_owned(), of(&|t| 0.02 * (3.0 * t + phase).sin())));
            columns.push(((*rate).to_owned(), of(&|t| 0.06 * (3.0 * t + phase).cos())));
        }
        // Down: −2 sin(2 t) m/s², from a lift of 1 + 2/9.81 sin(2 t).
        columns.push((names::VELOCITY[0].to_owned(), of(&|t| 0.2 * (1.3 * t).sin())));
        columns.push((names::VELOCITY[1].to_owned(), of(&|t| 0.2 * (1.7 * t).sin())));
        columns.push((names::VELOCITY[2].to_owned(), of(&|t| sign * (2.0 * t).cos())));
        for rotor in 1..=4 {
            let duty = |t: f64| 0.5 * (1.0 + 2.0 / 9.81 * (2.0 * t).sin()).sqrt() + 0.001 * f64::from(rotor);
            columns.push((format!("duty_{rotor}"), of(&duty)));
        }
        FlightLog::from_columns("climbs", time, columns).expect("a log")
    }

    /// A log in north-west-up was accepted as north-east-down: "resistance of the ESC 7.5 Ω".
    #[test]
    fn regress_z_up_shows_without_an_accelerometer() {
        assert_eq!(climbs(1.0).report.findings, []);
        let found = climbs(-1.0).report.findings;
        assert!(
            matches!(&found[..], [one] if one.kind == FindingKind::Inconsistent && one.detail.contains("points up")),
            "{found:?}"
        );
    }

    /// A quadrotor that sways by 0.2 rad, its accelerometer in the axes of the body or of the world.
    fn sways(in_world_axes: bool) -> FlightLog {
        let rows = 4000_u32;
        let time: Vec<f64> = (0..rows).map(|k| 0.01 * f64::from(k)).collect();
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|t| f(*t)).collect() };
        let angle = |axis: usize, t: f64| 0.2 * ([1.1, 0.9, 0.0][axis] * t).sin();
        // Thrust carries the weight at every tilt: ax = −g tan θ, ay = g tan φ/cos θ.
        let force = |t: f64| {
            let (roll, pitch) = (angle(0, t), angle(1, t));
            [-9.81 * pitch.tan(), 9.81 * roll.tan() / pitch.cos(), 0.0]
        };
        let mut velocity = [[0.0; 3]; 4000];
        for row in 1..rows as usize {
            let (before, after) = (force(time[row - 1]), force(time[row]));
            velocity[row] = [0, 1, 2].map(|axis| velocity[row - 1][axis] + 0.005 * (before[axis] + after[axis]));
        }
        let mut columns: Vec<(String, Vec<f64>)> = Vec::new();
        for axis in 0..3 {
            columns.push((names::ATTITUDE[axis].to_owned(), of(&|t| angle(axis, t))));
            let accel = of(&|t| match (in_world_axes, axis) {
                (true, 2) => -9.81,
                (true, _) => force(t)[axis],
                (false, 2) => -9.81 / (angle(0, t).cos() * angle(1, t).cos()),
                (false, _) => 0.01 * (2.0 * t).sin(),
            });
            columns.push((names::ACCEL[axis].to_owned(), accel));
            columns.push((
                names::VELOCITY[axis].to_owned(),
                velocity.iter().map(|v| v[axis]).collect(),
            ));
        }
        FlightLog::from_columns("sways", time, columns).expect("a log")
    }

    /// It passed every check: the twin then had an error of 164 times its noise.
    #[test]
    fn regress_an_accelerometer_in_the_axes_of_the_world_is_told() {
        let told = |log: FlightLog| {
            let mut found = log.report.findings.into_iter();
            found.any(|finding| {
                finding
                    .detail
                    .starts_with("the accelerometer reads along the axes of the world")
            })
        };
        assert!(told(sways(true)));
        assert!(!told(sways(false)), "{:?}", sways(false).report.findings);
    }

    /// A calm hover was refused: "the log is at fault … specific force and velocity move, but not together".
    #[test]
    fn regress_steps_and_vibration_of_a_calm_hover_are_no_motion() {
        let inconsistent = |log: FlightLog| {
            let found = log.report.findings;
            found.iter().any(|finding| finding.kind == FindingKind::Inconsistent)
        };
        assert!(!inconsistent(hover(0.02)));
        assert!(!inconsistent(hover(0.05)));
        // A velocity that swings by a metre a second would show in the force.
        assert!(inconsistent(hover(1.0)), "{:?}", hover(1.0).report.findings);
    }
}
