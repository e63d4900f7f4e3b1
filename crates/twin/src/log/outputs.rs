//! Which outputs of an autopilot drive rotors.
//!
//! An autopilot logs all of its outputs: motors, a camera's tilt, a buzzer, and unconnected ones. Where
//! `SERVOn_FUNCTION` gives the function of each, that decides, and the rotors are in the order of their motor numbers.
//! PX4's `actuator_motors` holds motors only, as many as `CA_ROTOR_COUNT` says. A blackbox's `motor[n]` are all motors;
//! its servos have a name of their own. Otherwise rotors are the outputs that move and follow the collective: low on
//! the ground, up in the air, or up by as much as the others whenever those go up. An output that is switched now and
//! then and otherwise constant is not a rotor; and if there are more than `MAV_TYPE` says (2 four, 13 six, 14 eight),
//! the first ones are taken.
//!
//! Outputs of an aeroplane, a rover or a boat are never rotors of a multirotor ([`other_vehicle`]).

use std::collections::BTreeMap;

use super::resample::median;
use super::sources::SourceLog;

/// An output that varies less than this is not a motor.
const MOVES: f64 = 0.01;
/// Fewest rotors of a multirotor.
const FEWEST: usize = 3;
/// Mean on the ground over the mean in the air of a rotor, at most.
const GROUND_SHARE: f64 = 0.6;
/// … or its rise from there over that of the middle output, at least: throttle chops by a pilot may be taken for
/// ground, and motors that idle in the air rise by less than 1/[`GROUND_SHARE`].
const RISES_LIKE_OTHERS: f64 = 0.5;
/// Mean in the air over that of the middle output: a rotor is not far from it.
const LIKE_OTHERS: std::ops::Range<f64> = 0.35..2.0;

/// Outputs that drive rotors, from 0, in the order of the rotors, and why the others do not.
pub(super) struct Rotors {
    pub(super) outputs: Vec<usize>,
    pub(super) why: &'static str,
}

/// Whether a field of a log contains motors according to its name: `motor[]` of a blackbox.
pub(super) fn are_motors(field: &str) -> bool {
    field.rsplit(':').next() == Some("motor[]")
}

/// All of some outputs, because the log states that each drives a rotor.
pub(super) fn all(count: usize) -> Rotors {
    Rotors {
        outputs: (0..count).collect(),
        why: "",
    }
}

/// `duties`: by output, then sample.
pub(super) fn rotors(duties: &[Vec<f64>], parameters: &BTreeMap<String, f64>) -> Rotors {
    let functions = by_function(duties.len(), parameters);
    if functions.len() >= FEWEST {
        return Rotors {
            outputs: functions,
            why: "SERVOn_FUNCTION is not that of a motor, or of one that a lower output drives, too",
        };
    }
    if let Some(count) = by_count(duties, parameters) {
        return Rotors {
            outputs: (0..count).collect(),
            why: "CA_ROTOR_COUNT says that there are no more motors",
        };
    }
    let moving: Vec<usize> = (0..duties.len()).filter(|output| moves(&duties[*output])).collect();
    let moving = without_switched(duties, moving);
    if moving.len() < FEWEST {
        return Rotors {
            outputs: (0..duties.len()).collect(),
            why: "",
        };
    }
    let following = even(following(duties, &moving));
    if let Some(count) = by_type(&following, parameters) {
        return Rotors {
            outputs: (0..count).collect(),
            why: "MAV_TYPE says that there are no more motors",
        };
    }
    Rotors {
        outputs: if following.len() < FEWEST { moving } else { following },
        why: "it does not move, or not with the collective: no rotor",
    }
}

/// Motor, from 1, of a `SERVOn_FUNCTION`: 33 to 40 are motors 1 to 8, 82 to 85 motors 9 to 12.
pub(crate) fn motor_of(function: f64) -> Option<usize> {
    match function as usize {
        function @ 33..=40 => Some(function - 32),
        function @ 82..=85 => Some(function - 73),
        _ => None,
    }
}

fn by_function(count: usize, parameters: &BTreeMap<String, f64>) -> Vec<usize> {
    let mut motors: Vec<(usize, usize)> = (0..count)
        .filter_map(|output| {
            let function = *parameters.get(&format!("SERVO{}_FUNCTION", output + 1))?;
            Some((motor_of(function)?, output))
        })
        .collect();
    motors.sort_unstable();
    // Outputs with one function carry one signal: they are one rotor.
    motors.dedup_by_key(|(motor, _)| *motor);
    motors.into_iter().map(|(_, output)| output).collect()
}

/// `CA_ROTOR_COUNT` of a multirotor, if exactly that many outputs hold numbers: the others of such a message are not
/// motors. A vehicle has this even if a motor stands still or is at its limit throughout (propellers off, carried by
/// hand).
fn by_count(duties: &[Vec<f64>], parameters: &BTreeMap<String, f64>) -> Option<usize> {
    const MULTIROTOR: i64 = 0;
    let count = *parameters.get("CA_ROTOR_COUNT")? as usize;
    let multirotor = parameters
        .get("CA_AIRFRAME")
        .is_none_or(|airframe| *airframe as i64 == MULTIROTOR);
    let has_numbers = |duty: &Vec<f64>| duty.iter().any(|value| value.is_finite());
    let motors_only = duties
        .iter()
        .enumerate()
        .all(|(output, duty)| has_numbers(duty) == (output < count));
    (multirotor && motors_only && (FEWEST..=duties.len()).contains(&count)).then_some(count)
}

/// Rotors of the vehicle that `MAV_TYPE` names, if the first outputs of that number follow the collective and others do
/// as well. Not if the number of the airframe gives another count: a parameter that was left at its default names a
/// quadrotor.
fn by_type(following: &[usize], parameters: &BTreeMap<String, f64>) -> Option<usize> {
    let count = match *parameters.get("MAV_TYPE")? as i64 {
        2 => 4,
        13 => 6,
        14 => 8,
        _ => return None,
    };
    // PX4's airframes: 4000 to 5999 have four rotors, 6000 to 7999 and 11000 six, 8000 to 9999 and 12000 eight.
    let airframe = match parameters.get("SYS_AUTOSTART").map_or(0, |number| *number as i64) / 1000 {
        4 | 5 => 4,
        6 | 7 | 11 => 6,
        8 | 9 | 12 => 8,
        _ => count,
    };
    let rotors = parameters.get("CA_ROTOR_COUNT").map_or(0, |number| *number as usize);
    let first = following.iter().take(count).copied().eq(0..count);
    (airframe == count && (rotors == 0 || rotors == count) && first && following.len() > count).then_some(count)
}

/// The kind of vehicle that the log states, if it is not a multirotor: one clause.
///
/// PX4 by `MAV_TYPE`, unless its status says that it flies on rotors (an old default of the parameter was an
/// aeroplane); ArduPilot by the functions of its servos, if none of them is a motor of a multirotor.
pub(super) fn other_vehicle(log: &SourceLog) -> Option<String> {
    let rotary = |stream: &super::sources::RawStream| {
        let said = |field: &str, wanted: f64| {
            let values = stream.fields.iter().find(|(name, _)| name == field);
            values.is_some_and(|(_, values)| values.contains(&wanted))
        };
        said("vehicle_type", 1.0) || said("is_rotary_wing", 1.0)
    };
    let status = log.streams.iter().find(|stream| stream.is_called("vehicle_status", 0));
    let kind = log.parameters.get("MAV_TYPE").copied().unwrap_or(0.0) as i64;
    let named = match kind {
        1 => Some("an aeroplane"),
        10 => Some("a rover"),
        11 => Some("a boat"),
        12 => Some("a submarine"),
        _ => None,
    };
    if let Some(name) = named {
        return (!status.is_some_and(rotary)).then(|| format!("{name} (MAV_TYPE {kind}), not a multirotor"));
    }
    let function = |output: usize| log.parameters.get(&format!("SERVO{output}_FUNCTION"));
    let functions: Vec<(usize, i64)> = (1..=32)
        .filter_map(|output| Some((output, *function(output)? as i64)))
        .collect();
    if functions
        .iter()
        .any(|(_, function)| matches!(function, 33..=40 | 82..=85))
    {
        return None;
    }
    let first = |name: &str, of: fn(i64) -> bool| {
        let (output, function) = functions.iter().find(|(_, function)| of(*function))?;
        Some(format!("{name} (SERVO{output}_FUNCTION {function}), not a multirotor"))
    };
    // Aileron, elevator, rudder, flaperons, elevons, V-tail; steering on the ground, throttle left and right.
    first("an aeroplane", |function| {
        matches!(function, 4 | 19 | 24 | 25 | 77..=80)
    })
    .or_else(|| first("a rover or boat", |function| matches!(function, 26 | 73 | 74)))
}

/// Outputs without those that are switched occasionally: those with less than a hundredth of the changes of the third
/// busiest. The command of a motor changes from sample to sample in the air, that of a gripper or of an idle servo does
/// not.
fn without_switched(duties: &[Vec<f64>], moving: Vec<usize>) -> Vec<usize> {
    const SHARE: f64 = 0.01;
    let changes = |output: &usize| {
        let values = duties[*output].iter().filter(|value| value.is_finite());
        values.clone().zip(values.skip(1)).filter(|(a, b)| a != b).count() as f64
    };
    let mut counts: Vec<f64> = moving.iter().map(changes).collect();
    counts.sort_by(|a, b| b.total_cmp(a));
    let Some(busy) = counts.get(FEWEST - 1) else {
        return moving;
    };
    moving
        .into_iter()
        .filter(|output| changes(output) > SHARE * busy)
        .collect()
}

fn moves(duty: &[f64]) -> bool {
    let finite = duty.iter().copied().filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    high - low > MOVES && high > 2.0 * MOVES
}

/// Of the outputs that vary, those that follow the middle one from the ground into the air.
fn following(duties: &[Vec<f64>], moving: &[usize]) -> Vec<usize> {
    let samples = moving.iter().map(|output| duties[*output].len()).min().unwrap_or(0);
    let middle: Vec<f64> = (0..samples)
        .map(|sample| {
            let mut values: Vec<f64> = moving.iter().map(|output| duties[*output][sample]).collect();
            values.retain(|value| value.is_finite());
            median(&mut values).unwrap_or(f64::NAN)
        })
        .collect();
    let mut sorted: Vec<f64> = middle.iter().copied().filter(|value| value.is_finite()).collect();
    if sorted.is_empty() {
        return Vec::new();
    }
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
    let (low, high) = (at(0.02), at(0.9));
    let level = 0.5 * (low + high);
    let has_ground = low < 0.45 * high;
    let mean = |output: usize, in_the_air: bool| {
        let values = (0..samples)
            .filter(|sample| !has_ground || (middle[*sample] > level) == in_the_air)
            .map(|sample| duties[output][sample])
            .filter(|value| value.is_finite());
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
        sum / count
    };
    let mut air: Vec<f64> = moving.iter().map(|output| mean(*output, true)).collect();
    let air_of = air.clone();
    let usual = median(&mut air).unwrap_or(f64::NAN);
    let low_of: Vec<f64> = moving.iter().map(|output| mean(*output, false)).collect();
    let mut rises: Vec<f64> = air_of.iter().zip(&low_of).map(|(air, low)| air - low).collect();
    let usual_rise = median(&mut rises).unwrap_or(f64::NAN);
    moving
        .iter()
        .zip(air_of.iter().zip(&low_of))
        .filter(|(_, (air, low))| {
            let rises = **air - **low > RISES_LIKE_OTHERS * usual_rise;
            let follows = !has_ground || **low < GROUND_SHARE * **air || rises;
            follows && LIKE_OTHERS.contains(&(**air / usual))
        })
        .map(|(output, _)| *output)
        .collect()
}

/// Five or seven outputs that follow the collective are four or six rotors and something that copies the throttle: the
/// first ones, if the numbering confirms it.
fn even(following: Vec<usize>) -> Vec<usize> {
    let rotors = following.len() - following.len() % 2;
    let first = following.iter().take(rotors).copied().eq(0..rotors);
    if following.len() > rotors && rotors >= 4 && first {
        following[..rotors].to_vec()
    } else {
        following
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 10 s on the ground, 20 s in the air, at 10 Hz.
    fn flown(low: f64, high: f64) -> Vec<f64> {
        (0..300)
            .map(|k| if k < 100 { low } else { high + 0.02 * f64::from(k % 7) })
            .collect()
    }

    #[test]
    fn val_outputs_that_follow_the_collective_are_rotors() {
        let camera: Vec<f64> = (0..300).map(|k| 0.5 + 0.1 * f64::from(k % 11) / 11.0).collect();
        let still = vec![0.5; 300];
        let duties = [
            flown(0.0, 0.5),
            flown(0.0, 0.55),
            still.clone(),
            flown(0.05, 0.45),
            camera,
            flown(0.0, 0.5),
            still,
        ];
        let found = rotors(&duties, &BTreeMap::new());
        assert_eq!(found.outputs, [0, 1, 3, 5]);
    }

    #[test]
    fn regress_an_output_that_copies_the_throttle_is_no_fifth_rotor() {
        let mut duties = vec![flown(0.0, 0.5); 4];
        duties.extend([vec![0.5; 300], flown(0.0, 0.47)]);
        assert_eq!(rotors(&duties, &BTreeMap::new()).outputs, [0, 1, 2, 3]);
    }

    #[test]
    fn val_parameters_give_the_order_of_the_motors() {
        let parameters: BTreeMap<String, f64> = [(1, 36.0), (2, 35.0), (3, 34.0), (4, 33.0), (5, 7.0)]
            .into_iter()
            .map(|(output, function)| (format!("SERVO{output}_FUNCTION"), function))
            .collect();
        let found = rotors(&vec![flown(0.0, 0.5); 6], &parameters);
        assert_eq!(found.outputs, [3, 2, 1, 0]);
    }

    /// Motor 2 on two outputs, as for a spare connector: a quadrotor, not five rotors.
    #[test]
    fn regress_a_motor_on_two_outputs_is_one_rotor() {
        let parameters: BTreeMap<String, f64> = [33.0, 34.0, 35.0, 36.0, 34.0]
            .into_iter()
            .enumerate()
            .map(|(output, function)| (format!("SERVO{}_FUNCTION", output + 1), function))
            .collect();
        let found = rotors(&vec![flown(0.0, 0.5); 5], &parameters);
        assert_eq!(found.outputs, [0, 1, 2, 3]);
    }

    #[test]
    fn regress_a_message_of_motors_only_loses_none_that_does_not_follow() {
        // Carried by hand: the third motor is at its limit throughout, the others follow.
        let mut duties = vec![flown(0.0, 0.5), flown(0.0, 0.6), vec![1.0; 300], flown(0.0, 0.4)];
        duties.extend(vec![vec![f64::NAN; 300]; 8]);
        let parameters = |count: f64, airframe: f64| {
            BTreeMap::from([
                ("CA_ROTOR_COUNT".to_owned(), count),
                ("CA_AIRFRAME".to_owned(), airframe),
            ])
        };
        assert_eq!(rotors(&duties, &parameters(4.0, 0.0)).outputs, [0, 1, 2, 3]);
        // Not where the count contradicts the outputs, nor where one of the motors may push forwards.
        assert_eq!(rotors(&duties, &parameters(6.0, 0.0)).outputs, [0, 1, 3]);
        assert_eq!(rotors(&duties, &parameters(4.0, 2.0)).outputs, [0, 1, 3]);
    }

    /// A pilot who chops the throttle: what looks like ground is flight, in which one motor stays at more of its usual output than the others.
    /// It was taken for no rotor, and the quadrotor for a tricopter without a flight.
    #[test]
    fn regress_a_motor_that_is_asked_for_more_in_a_throttle_chop_is_a_rotor() {
        let chopped = |low: f64, high: f64| -> Vec<f64> {
            (0..300)
                .map(|k| {
                    if k % 10 < 2 {
                        low
                    } else {
                        high + 0.02 * f64::from(k % 7)
                    }
                })
                .collect()
        };
        let mut duties = vec![chopped(0.1, 0.28); 3];
        duties.push(chopped(0.22, 0.29));
        // A camera's tilt, as in the air as in the chops.
        duties.push((0..300).map(|k| 0.3 + 0.1 * f64::from(k % 11) / 11.0).collect());
        assert_eq!(rotors(&duties, &BTreeMap::new()).outputs, [0, 1, 2, 3]);
    }

    #[test]
    fn val_the_motors_of_a_blackbox_are_motors_by_their_name() {
        assert!(are_motors("main:motor[]") && are_motors("motor[]"));
        assert!(!are_motors("main:servo[]") && !are_motors("actuator_outputs:output[]"));
        assert_eq!(all(4).outputs, [0, 1, 2, 3]);
    }

    /// Auxiliary outputs that stand at their middle from arming on were rotors 5 and 6 of a quadrotor, and ten of a hexarotor's log.
    #[test]
    fn regress_an_output_that_is_switched_at_arming_is_no_rotor() {
        let armed: Vec<f64> = (0..300).map(|k| if k < 90 { 0.0 } else { 0.5 }).collect();
        let mut duties = vec![flown(0.0, 0.5); 4];
        duties.extend(vec![armed; 8]);
        assert_eq!(rotors(&duties, &BTreeMap::new()).outputs, [0, 1, 2, 3]);
    }

    #[test]
    fn val_the_type_of_the_vehicle_bounds_its_rotors_unless_its_airframe_says_otherwise() {
        let duties = vec![flown(0.0, 0.5); 6];
        let of = |kind: f64, airframe: f64| {
            let parameters = BTreeMap::from([("MAV_TYPE".to_owned(), kind), ("SYS_AUTOSTART".to_owned(), airframe)]);
            rotors(&duties, &parameters).outputs.len()
        };
        assert_eq!(of(2.0, 4001.0), 4);
        assert_eq!(of(2.0, 3010.0), 4);
        assert_eq!(of(2.0, 6001.0), 6);
        assert_eq!(of(13.0, 6001.0), 6);
        assert_eq!(of(14.0, 8001.0), 6);
    }

    #[test]
    fn val_what_is_no_multirotor_is_said_by_its_parameters() {
        let with = |parameters: &[(&str, f64)]| SourceLog {
            parameters: parameters
                .iter()
                .map(|(name, value)| ((*name).to_owned(), *value))
                .collect(),
            ..SourceLog::default()
        };
        let mut plane = with(&[("MAV_TYPE", 1.0)]);
        assert_eq!(
            other_vehicle(&plane).as_deref(),
            Some("an aeroplane (MAV_TYPE 1), not a multirotor")
        );
        plane.streams.push(crate::log::sources::RawStream {
            name: "vehicle_status".to_owned(),
            fields: vec![("is_rotary_wing".to_owned(), vec![1.0, 1.0])],
            ..Default::default()
        });
        assert_eq!(other_vehicle(&plane), None);
        assert_eq!(other_vehicle(&with(&[("MAV_TYPE", 2.0)])), None);
        let servos = [
            ("SERVO1_FUNCTION", 4.0),
            ("SERVO2_FUNCTION", 19.0),
            ("SERVO3_FUNCTION", 70.0),
        ];
        assert_eq!(
            other_vehicle(&with(&servos)).as_deref(),
            Some("an aeroplane (SERVO1_FUNCTION 4), not a multirotor")
        );
        // A quadplane has motors, too; a multirotor may have a servo.
        let motors = [("SERVO1_FUNCTION", 4.0), ("SERVO5_FUNCTION", 33.0)];
        assert_eq!(other_vehicle(&with(&motors)), None);
        assert_eq!(other_vehicle(&with(&[("SERVO9_FUNCTION", 7.0)])), None);
    }

    #[test]
    fn val_a_log_without_flight_keeps_all_outputs() {
        assert_eq!(rotors(&vec![vec![0.0; 50]; 4], &BTreeMap::new()).outputs, [0, 1, 2, 3]);
    }
}
