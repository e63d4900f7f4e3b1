//! Actions of the autopilot and the pilot in a log: changes of the flight mode, arming, changes of parameters, sticks.
//!
//! | source | modes | parameters | sticks |
//! |---|---|---|---|
//! | PX4 ULog | `vehicle_status` | `P` after the first of its name | `manual_control_setpoint` |
//! | ArduPilot DataFlash | `MODE`, `EV` 10 and 11 | `PARM` after the first of its name | `RCIN` |
//! | MAVLink telemetry | `HEARTBEAT` | `PARAM_VALUE` | `RC_CHANNELS`, `RC_CHANNELS_RAW` |
//! | Betaflight, INAV | – | – | `rcCommand` |
//!
//! They explain what a model cannot: a changed gain, a pilot input. Nothing is computed from them.

use super::event::{EventKind, FlightEvent};
use super::outputs::motor_of;
use super::sources::{MOST_CHANGES, ParameterChange, RawStream, SourceLog};

/// A stick beyond this share of its travel is an input.
const INPUT: f64 = 0.25;
/// … for at least this long; two closer together than the other value are one, s.
const LEAST_S: f64 = 0.3;
const NEAR_S: f64 = 1.0;
/// More inputs than this are one line: the pilot flies by hand.
const MOST_INPUTS: usize = 12;
/// Parameters that change together are one event, s; more names than this are counted.
const TOGETHER_S: f64 = 1.0;
const MOST_NAMES: usize = 3;

/// What happened, in the order of time.
///
/// * `start_s`: of our 0 s, on the clock of the streams
pub(crate) fn of(log: &SourceLog, start_s: f64) -> Vec<FlightEvent> {
    let mut found = modes(log);
    found.extend(arming(log));
    found.extend(parameters(&log.parameter_changes));
    found.extend(motors_off(log));
    found.extend(sticks(log));
    for event in &mut found {
        event.start_s -= start_s;
        event.end_s -= start_s;
    }
    found.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    // A mode that flickers from sample to sample is reported with its first ten thousand changes.
    found.truncate(MOST_CHANGES);
    found
}

fn event(kind: EventKind, start_s: f64, end_s: f64, detail: String) -> FlightEvent {
    FlightEvent {
        kind,
        start_s,
        end_s,
        output: None,
        detail,
    }
}

fn field<'a>(stream: &'a RawStream, names: &[&str]) -> Option<&'a [f64]> {
    let of = |name: &&str| stream.fields.iter().find(|(field, _)| field == name);
    names.iter().find_map(of).map(|(_, values)| values.as_slice())
}

fn stream<'a>(log: &'a SourceLog, name: &str) -> Option<&'a RawStream> {
    log.streams
        .iter()
        .find(|stream| stream.name == name && stream.instance == 0 && stream.time_s.len() > 1)
}

/// Times and values of a column where it changes; the first is no change.
fn changes(stream: &RawStream, values: &[f64]) -> Vec<(f64, f64)> {
    let mut before = None;
    let mut found = Vec::new();
    for (time, value) in stream.time_s.iter().zip(values).filter(|(_, value)| value.is_finite()) {
        if before.is_some_and(|before: f64| before != *value) {
            found.push((*time, *value));
        }
        before = Some(*value);
    }
    found
}

fn modes(log: &SourceLog) -> Vec<FlightEvent> {
    type Words = fn(f64) -> String;
    let is_px4 = stream(log, "HEARTBEAT")
        .and_then(|heartbeat| field(heartbeat, &["autopilot"]))
        .is_some_and(|autopilot| autopilot.first() == Some(&12.0));
    let of_heartbeat: Words = if is_px4 { of_px4_custom } else { of_copter };
    let places: [(&str, &[&str], Words); 3] = [
        ("vehicle_status", &["nav_state"], of_px4),
        ("MODE", &["ModeNum", "Mode"], of_copter),
        ("HEARTBEAT", &["custom_mode"], of_heartbeat),
    ];
    for (name, fields, words) in places {
        // A log of a single mode has a single message of it.
        let Some(stream) = log
            .streams
            .iter()
            .find(|stream| stream.name == name && stream.instance == 0)
        else {
            continue;
        };
        let Some(values) = field(stream, fields) else { continue };
        let first = stream
            .time_s
            .first()
            .zip(values.first())
            .map(|(time, mode)| (*time, *mode));
        let all = first.into_iter().chain(changes(stream, values));
        return all
            .map(|(time, mode)| event(EventKind::Mode, time, time, format!("flight mode {}", words(mode))))
            .collect();
    }
    Vec::new()
}

/// PX4's `nav_state`.
fn of_px4(mode: f64) -> String {
    let name = match mode as i64 {
        0 => "Manual",
        1 => "Altitude",
        2 => "Position",
        3 => "Mission",
        4 => "Hold",
        5 => "Return",
        6 => "Position slow",
        10 => "Acro",
        12 => "Descend",
        13 => "Termination",
        14 => "Offboard",
        15 => "Stabilized",
        17 => "Takeoff",
        18 => "Land",
        19 => "Follow target",
        20 => "Precision landing",
        21 => "Orbit",
        other => return format!("number {other} of PX4"),
    };
    name.to_owned()
}

/// PX4's `custom_mode` of a heartbeat: main mode in the third byte, that of AUTO in the fourth.
fn of_px4_custom(mode: f64) -> String {
    let bits = mode as u64;
    let name = match (bits >> 16 & 0xff, bits >> 24 & 0xff) {
        (1, _) => "Manual",
        (2, _) => "Altitude",
        (3, _) => "Position",
        (4, 2) => "Takeoff",
        (4, 3) => "Hold",
        (4, 4) => "Mission",
        (4, 5) => "Return",
        (4, 6) => "Land",
        (5, _) => "Acro",
        (6, _) => "Offboard",
        (7, _) => "Stabilized",
        (main, sub) => return format!("number {main}.{sub} of PX4"),
    };
    name.to_owned()
}

/// ArduCopter's modes.
fn of_copter(mode: f64) -> String {
    let name = match mode as i64 {
        0 => "Stabilize",
        1 => "Acro",
        2 => "Alt Hold",
        3 => "Auto",
        4 => "Guided",
        5 => "Loiter",
        6 => "RTL",
        7 => "Circle",
        9 => "Land",
        11 => "Drift",
        13 => "Sport",
        14 => "Flip",
        15 => "Autotune",
        16 => "Pos Hold",
        17 => "Brake",
        18 => "Throw",
        20 => "Guided without GPS",
        21 => "Smart RTL",
        22 => "Flow Hold",
        23 => "Follow",
        24 => "Zigzag",
        25 => "System identification",
        26 => "Autorotate",
        27 => "Auto RTL",
        28 => "Turtle",
        other => return format!("number {other} of ArduCopter"),
    };
    name.to_owned()
}

fn arming(log: &SourceLog) -> Vec<FlightEvent> {
    let armed_event = |time: f64, armed: bool| {
        let words = if armed { "armed" } else { "disarmed" };
        event(EventKind::Mode, time, time, words.to_owned())
    };
    let by_state = |name: &str, names: &[&str], armed: fn(f64) -> bool| -> Option<Vec<FlightEvent>> {
        let stream = stream(log, name)?;
        let states: Vec<f64> = field(stream, names)?
            .iter()
            .map(|state| f64::from(u8::from(armed(*state))))
            .collect();
        let changed = changes(stream, &states);
        Some(
            changed
                .into_iter()
                .map(|(time, state)| armed_event(time, state == 1.0))
                .collect(),
        )
    };
    if let Some(found) = by_state("vehicle_status", &["arming_state"], |state| state == 2.0) {
        return found;
    }
    if let Some(found) = by_state("HEARTBEAT", &["base_mode"], |mode| mode as u32 & 128 != 0) {
        return found;
    }
    let events = log.streams.iter().find(|stream| stream.name == "EV");
    let numbers = events.and_then(|events| Some((events, field(events, &["Id"])?)));
    numbers.map_or_else(Vec::new, |(events, numbers)| {
        let of = |(time, number): (&f64, &f64)| match *number as i64 {
            10 => Some(armed_event(*time, true)),
            11 => Some(armed_event(*time, false)),
            _ => None,
        };
        events.time_s.iter().zip(numbers).filter_map(of).collect()
    })
}

fn parameters(changes: &[ParameterChange]) -> Vec<FlightEvent> {
    let mut found = Vec::new();
    for together in changes.chunk_by(|a, b| b.time_s - a.time_s < TOGETHER_S) {
        let names: Vec<String> = together
            .iter()
            .take(MOST_NAMES)
            .map(|change| format!("{} from {} to {}", change.name, change.before, change.after))
            .collect();
        let more = together.len() - names.len();
        let more = if more > 0 {
            format!(" and {more} more")
        } else {
            String::new()
        };
        found.push(event(
            EventKind::Parameter,
            together[0].time_s,
            together[together.len() - 1].time_s,
            format!("parameters changed: {}{more}", names.join(", ")),
        ));
    }
    found
}

/// Motors that a change of `SERVOn_FUNCTION` takes away while the autopilot runs, until another gives them back: how a fault is made in flight by
/// telemetry.
fn motors_off(log: &SourceLog) -> Vec<FlightEvent> {
    let last_s = log.streams.iter().filter_map(|stream| stream.time_s.last()).copied();
    let end_s = last_s.fold(f64::NEG_INFINITY, f64::max);
    let mut found: Vec<FlightEvent> = Vec::new();
    for change in &log.parameter_changes {
        if !(change.name.starts_with("SERVO") && change.name.ends_with("_FUNCTION")) {
            continue;
        }
        match (motor_of(change.before), motor_of(change.after)) {
            (Some(motor), None) => found.push(FlightEvent {
                output: Some(motor),
                ..event(
                    EventKind::MotorOff,
                    change.time_s,
                    end_s.max(change.time_s),
                    format!(
                        "motor {motor} is switched off: {} from {} to {}",
                        change.name, change.before, change.after
                    ),
                )
            }),
            (None, Some(motor)) => {
                if let Some(off) = found.iter_mut().rfind(|event| event.output == Some(motor)) {
                    off.end_s = change.time_s;
                }
            }
            _ => {}
        }
    }
    found
}

/// Roll, pitch and yaw of a pilot's sticks, −1 to 1.
fn stick_positions(log: &SourceLog) -> Option<(&RawStream, [Vec<f64>; 3])> {
    let scaled = |values: &[f64], middle: f64, travel: f64| -> Vec<f64> {
        // 0 and all bits set: no such channel.
        let of = |value: &f64| (*value > 0.0 && *value < 3000.0).then_some((value - middle) / travel);
        values.iter().map(|value| of(value).unwrap_or(0.0)).collect()
    };
    if let Some(stream) = stream(log, "manual_control_setpoint") {
        let of = |names: &[&str]| field(stream, names).map(<[f64]>::to_vec);
        return Some((stream, [of(&["roll", "y"])?, of(&["pitch", "x"])?, of(&["yaw", "r"])?]));
    }
    for (name, channels) in [
        (
            "RCIN",
            [["C1", "Ch1", "Chan1"], ["C2", "Ch2", "Chan2"], ["C4", "Ch4", "Chan4"]],
        ),
        (
            "RC_CHANNELS",
            [["chan1_raw", "", ""], ["chan2_raw", "", ""], ["chan4_raw", "", ""]],
        ),
        (
            "RC_CHANNELS_RAW",
            [["chan1_raw", "", ""], ["chan2_raw", "", ""], ["chan4_raw", "", ""]],
        ),
    ] {
        let Some(stream) = stream(log, name) else { continue };
        let of = |names: &[&str]| field(stream, names).map(|values| scaled(values, 1500.0, 400.0));
        return Some((stream, [of(&channels[0])?, of(&channels[1])?, of(&channels[2])?]));
    }
    let stream = stream(log, "main")?;
    let of = |name: &str| field(stream, &[name]).map(|values| values.iter().map(|value| value / 500.0).collect());
    Some((stream, [of("rcCommand[0]")?, of("rcCommand[1]")?, of("rcCommand[2]")?]))
}

fn sticks(log: &SourceLog) -> Vec<FlightEvent> {
    let Some((stream, axes)) = stick_positions(log) else {
        return Vec::new();
    };
    // Begin, end, and the farthest position of each axis.
    let mut inputs: Vec<(f64, f64, [f64; 3])> = Vec::new();
    for (row, time) in stream.time_s.iter().enumerate() {
        let at = [0, 1, 2].map(|axis| axes[axis].get(row).copied().filter(|at| at.is_finite()).unwrap_or(0.0));
        if at.iter().all(|at| at.abs() < INPUT) {
            continue;
        }
        match inputs.last_mut() {
            Some((_, end, farthest)) if time - *end < NEAR_S => {
                *end = *time;
                for (far, at) in farthest.iter_mut().zip(at) {
                    if at.abs() > far.abs() {
                        *far = at;
                    }
                }
            }
            _ => inputs.push((*time, *time, at)),
        }
    }
    inputs.retain(|(from, to, _)| to - from >= LEAST_S);
    if inputs.len() > MOST_INPUTS {
        let used: f64 = inputs.iter().map(|(from, to, _)| to - from).sum();
        let (from, to) = (inputs[0].0, inputs[inputs.len() - 1].1);
        let words = format!(
            "the pilot's sticks are beyond a quarter of their travel {} times, {used:.0} s in all",
            inputs.len()
        );
        return vec![event(EventKind::Pilot, from, to, words)];
    }
    let words = |farthest: [f64; 3]| {
        let named = ["roll", "pitch", "yaw"].into_iter().zip(farthest);
        let told: Vec<String> = named
            .filter(|(_, at)| at.abs() >= INPUT)
            .map(|(axis, at)| format!("{axis} {:+.0} %", 100.0 * at.clamp(-1.0, 1.0)))
            .collect();
        format!("the pilot's sticks: {}", told.join(", "))
    };
    inputs
        .into_iter()
        .map(|(from, to, farthest)| event(EventKind::Pilot, from, to, words(farthest)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(name: &str, time_s: Vec<f64>, fields: &[(&str, Vec<f64>)]) -> RawStream {
        RawStream {
            name: name.to_owned(),
            time_s,
            fields: fields
                .iter()
                .map(|(name, values)| ((*name).to_owned(), values.clone()))
                .collect(),
            ..RawStream::default()
        }
    }

    fn events_of(log: &SourceLog) -> Vec<(EventKind, f64, String)> {
        of(log, 100.0)
            .into_iter()
            .map(|e| (e.kind, e.start_s, e.detail))
            .collect()
    }

    #[test]
    fn val_modes_and_arming_of_px4() {
        let time: Vec<f64> = (0..6).map(|k| 100.0 + f64::from(k)).collect();
        let log = SourceLog {
            streams: vec![raw(
                "vehicle_status",
                time,
                &[
                    ("nav_state", vec![2.0, 2.0, 3.0, 3.0, 5.0, 5.0]),
                    ("arming_state", vec![1.0, 2.0, 2.0, 2.0, 2.0, 1.0]),
                ],
            )],
            ..SourceLog::default()
        };
        let found: Vec<String> = events_of(&log)
            .into_iter()
            .map(|(_, at, words)| format!("{at} {words}"))
            .collect();
        let expected = [
            "0 flight mode Position",
            "1 armed",
            "2 flight mode Mission",
            "4 flight mode Return",
            "5 disarmed",
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn val_modes_of_a_heartbeat_are_the_autopilots_own() {
        let with = |autopilot: f64, mode: f64| SourceLog {
            streams: vec![raw(
                "HEARTBEAT",
                vec![100.0, 101.0],
                &[
                    ("custom_mode", vec![mode; 2]),
                    ("autopilot", vec![autopilot; 2]),
                    ("base_mode", vec![81.0, 209.0]),
                ],
            )],
            ..SourceLog::default()
        };
        assert_eq!(events_of(&with(3.0, 5.0))[0].2, "flight mode Loiter");
        assert_eq!(
            events_of(&with(12.0, f64::from(4 << 16 | 5 << 24)))[0].2,
            "flight mode Return"
        );
        assert_eq!(events_of(&with(3.0, 5.0))[1].2, "armed");
    }

    #[test]
    fn val_parameters_that_change_together_are_one_event() {
        let change = |time_s: f64, name: &str| ParameterChange {
            time_s,
            name: name.to_owned(),
            before: 0.1,
            after: 0.2,
        };
        let changes = ["A", "B", "C", "D", "E"].map(|name| change(103.0, name));
        let log = SourceLog {
            parameter_changes: [&changes[..], &[change(110.0, "F")]].concat(),
            ..SourceLog::default()
        };
        let found = events_of(&log);
        assert_eq!(found.len(), 2);
        assert_eq!(
            found[0].2,
            "parameters changed: A from 0.1 to 0.2, B from 0.1 to 0.2, C from 0.1 to 0.2 and 2 more"
        );
        assert_eq!(found[1].1, 10.0);
    }

    /// Motor 4 of a hexarotor appeared to stand still because of telemetry: its frame was blamed.
    #[test]
    fn val_a_motor_that_a_parameter_takes_away_is_told() {
        let change = |time_s: f64, name: &str, before: f64, after: f64| ParameterChange {
            time_s,
            name: name.to_owned(),
            before,
            after,
        };
        let log = SourceLog {
            streams: vec![raw("RCOU", vec![100.0, 130.0], &[])],
            parameter_changes: vec![
                change(117.0, "SERVO4_FUNCTION", 36.0, 1.0),
                change(118.0, "SERVO9_FUNCTION", 7.0, 0.0),
                change(119.0, "SERVO2_FUNCTION", 34.0, 0.0),
                change(121.0, "SERVO2_FUNCTION", 0.0, 34.0),
            ],
            ..SourceLog::default()
        };
        let off: Vec<(Option<usize>, f64, f64)> = of(&log, 100.0)
            .into_iter()
            .filter(|event| event.kind == EventKind::MotorOff)
            .map(|event| (event.output, event.start_s, event.end_s))
            .collect();
        assert_eq!(off, [(Some(4), 17.0, 30.0), (Some(2), 19.0, 21.0)]);
    }

    #[test]
    fn val_sticks_are_told_by_how_far_they_go_and_many_are_one_line() {
        let time: Vec<f64> = (0..600).map(|k| 100.0 + 0.1 * f64::from(k)).collect();
        let rows = |of: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|t| of(t - 100.0)).collect() };
        let log = |roll: Vec<f64>| SourceLog {
            streams: vec![raw(
                "RCIN",
                time.clone(),
                &[
                    ("C1", roll),
                    ("C2", vec![1500.0; 600]),
                    ("C3", vec![1900.0; 600]),
                    ("C4", vec![0.0; 600]),
                ],
            )],
            ..SourceLog::default()
        };
        let one = events_of(&log(rows(&|t| if (10.0..12.0).contains(&t) { 1820.0 } else { 1500.0 })));
        assert_eq!(
            one,
            [(EventKind::Pilot, one[0].1, "the pilot's sticks: roll +80 %".to_owned())]
        );
        assert!((one[0].1 - 10.0).abs() < 0.11);
        let many = events_of(&log(rows(&|t| if t.rem_euclid(3.0) < 1.0 { 1820.0 } else { 1500.0 })));
        assert!(many.len() == 1 && many[0].2.contains("20 times"), "{many:?}");
    }
}
