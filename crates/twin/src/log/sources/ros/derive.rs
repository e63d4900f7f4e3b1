//! Corrections of columns for the axes and signs of a type.
//!
//! | type | derived |
//! |---|---|
//! | `nav_msgs/Odometry` | `world_velocity`: the twist is that of the body (child frame), the mapping wants the world's |
//! | `px4_msgs/VehicleOdometry` | the same where `velocity_frame` says body |
//! | `sensor_msgs/Imu` | no attitude where its covariance says that there is none |
//! | `sensor_msgs/BatteryState` | `discharge`: the current is negative where it discharges |
//! | all | a quaternion of zeros is none |
//!
//! Not all publishers keep to the child frame: the twist is taken as the world's if the changes of the position clearly
//! agree better with that.

use super::super::RawStream;
use super::cdr::Plan;
use crate::log::resample::median;

/// Quaternions shorter than this say nothing.
const SHORT: f64 = 0.5;
/// Position's changes are taken over at least this long, s.
const WINDOW_S: f64 = 0.1;
/// The twist is the world's if that leaves less than this share of the squares.
const CLEARER: f64 = 0.3;
/// Fewest windows for a decision.
const FEWEST: usize = 20;
/// Body velocity in `px4_msgs/VehicleOdometry`.
const BODY_FRAME: f64 = 3.0;

fn place(stream: &RawStream, name: &str) -> Option<usize> {
    stream.fields.iter().position(|(field, _)| field == name)
}

fn places<const N: usize>(stream: &RawStream, prefix: &str, names: [&str; N]) -> Option<[usize; N]> {
    let mut found = [0; N];
    for (slot, name) in found.iter_mut().zip(names) {
        *slot = place(stream, &format!("{prefix}{name}"))?;
    }
    Some(found)
}

fn columns<const N: usize>(stream: &RawStream, places: [usize; N]) -> [&[f64]; N] {
    places.map(|place| stream.fields[place].1.as_slice())
}

pub(super) fn derive(stream: &mut RawStream, plan: &Plan, notes: &mut Vec<String>) {
    no_quaternion_of_zeros(stream);
    match stream.kind.as_str() {
        "nav_msgs/Odometry" => {
            let quaternion = places(stream, "pose.pose.orientation.", ["w", "x", "y", "z"]);
            let position = places(stream, "pose.pose.position.", ["x", "y", "z"]);
            let twist = places(stream, "twist.twist.linear.", ["x", "y", "z"]);
            if let (Some(quaternion), Some(position), Some(twist)) = (quaternion, position, twist) {
                world_velocity(stream, quaternion, position, twist, notes);
            }
        }
        "px4_msgs/VehicleOdometry" => {
            let in_the_body = place(stream, "velocity_frame")
                .is_some_and(|frame| stream.fields[frame].1.first() == Some(&BODY_FRAME));
            let quaternion = places(stream, "q", ["[0]", "[1]", "[2]", "[3]"]);
            let velocity =
                places(stream, "velocity", ["[0]", "[1]", "[2]"]).or_else(|| places(stream, "v", ["x", "y", "z"]));
            if let (Some(quaternion), Some(velocity)) = (quaternion, velocity) {
                let quaternion = columns(stream, quaternion);
                let velocity = columns(stream, velocity);
                let world = if in_the_body {
                    turned(quaternion, velocity)
                } else {
                    velocity.map(<[f64]>::to_vec)
                };
                push(stream, world);
            }
        }
        "sensor_msgs/Imu" => {
            let unknown = place(stream, "orientation_covariance[0]")
                .is_some_and(|covariance| stream.fields[covariance].1.first() == Some(&-1.0));
            if unknown {
                stream.fields.retain(|(name, _)| !name.starts_with("orientation."));
            }
        }
        "sensor_msgs/BatteryState" => discharge(stream, notes),
        "geometry_msgs/TwistStamped" | "geometry_msgs/TwistWithCovarianceStamped" => {
            let frame = plan.text("header.frame_id").unwrap_or("");
            if frame.contains("base") || frame.contains("body") {
                notes.push(format!(
                    "{}: a velocity in the frame '{frame}', the body's, and no attitude in the same message: left out",
                    stream.name
                ));
                stream.fields.retain(|(name, _)| !name.contains("linear."));
            }
        }
        "actuator_msgs/Actuators" | "mav_msgs/Actuators" => {
            let normalised = stream.fields.iter().any(|(name, _)| name.starts_with("normalized["));
            let speeds = stream.fields.iter().any(|(name, _)| name.contains("velocit"));
            if speeds && !normalised {
                notes.push(format!(
                    "{}: rotor speeds that were asked for, and no duties; where they are to count as duties, say what is full: to = \"duty\", from = \
                     \"{}:velocity[]\", high = FULL in a mapping",
                    stream.name, stream.kind
                ));
            }
        }
        _ => {}
    }
}

/// Attitudes that are not there are zeros in many messages.
fn no_quaternion_of_zeros(stream: &mut RawStream) {
    for prefix in [
        "pose.pose.orientation.",
        "pose.orientation.",
        "orientation.",
        "transform.rotation.",
    ] {
        if let Some(places) = places(stream, prefix, ["w", "x", "y", "z"]) {
            clear_short(stream, places);
        }
    }
    if let Some(places) = places(stream, "q", ["[0]", "[1]", "[2]", "[3]"]) {
        clear_short(stream, places);
    }
}

fn clear_short(stream: &mut RawStream, places: [usize; 4]) {
    let parts = columns(stream, places);
    let short: Vec<usize> = (0..stream.time_s.len())
        .filter(|sample| parts.iter().map(|part| part[*sample] * part[*sample]).sum::<f64>() < SHORT * SHORT)
        .collect();
    for place in places {
        for sample in &short {
            stream.fields[place].1[*sample] = f64::NAN;
        }
    }
}

/// Vectors of the body in the world's axes: q v q⁻¹.
fn turned([w, x, y, z]: [&[f64]; 4], body: [&[f64]; 3]) -> [Vec<f64>; 3] {
    let mut world = [const { Vec::new() }; 3];
    for sample in 0..w.len() {
        let length = [w, x, y, z]
            .iter()
            .map(|part| part[sample] * part[sample])
            .sum::<f64>()
            .sqrt();
        let [w, x, y, z] = [w, x, y, z].map(|part| part[sample] / length);
        let [a, b, c] = body.map(|axis| axis[sample]);
        world[0].push((1.0 - 2.0 * (y * y + z * z)) * a + 2.0 * (x * y - w * z) * b + 2.0 * (x * z + w * y) * c);
        world[1].push(2.0 * (x * y + w * z) * a + (1.0 - 2.0 * (x * x + z * z)) * b + 2.0 * (y * z - w * x) * c);
        world[2].push(2.0 * (x * z - w * y) * a + 2.0 * (y * z + w * x) * b + (1.0 - 2.0 * (x * x + y * y)) * c);
    }
    world
}

fn push(stream: &mut RawStream, world: [Vec<f64>; 3]) {
    for (axis, values) in ["x", "y", "z"].into_iter().zip(world) {
        stream.fields.push((format!("world_velocity.{axis}"), values));
    }
}

/// Squares of the position's changes that a velocity leaves unexplained; `None`: too few windows.
fn unexplained(time_s: &[f64], position: [&[f64]; 3], velocity: [&[f64]; 3]) -> Option<f64> {
    let (mut squares, mut windows, mut from) = (0.0, 0_usize, 0);
    for to in 1..time_s.len() {
        let took = time_s[to] - time_s[from];
        if took < WINDOW_S {
            continue;
        }
        let axis = |axis: usize| {
            let flown: f64 = (from..to)
                .map(|k| 0.5 * (velocity[axis][k] + velocity[axis][k + 1]) * (time_s[k + 1] - time_s[k]))
                .sum();
            ((position[axis][to] - position[axis][from] - flown) / took).powi(2)
        };
        let error: f64 = (0..3).map(axis).sum();
        // A jump of the estimator or a gap says nothing of axes.
        if error.is_finite() && took < 10.0 * WINDOW_S && error < 1e4 {
            squares += error;
            windows += 1;
        }
        from = to;
    }
    (windows >= FEWEST).then_some(squares)
}

fn world_velocity(
    stream: &mut RawStream,
    quaternion: [usize; 4],
    position: [usize; 3],
    twist: [usize; 3],
    notes: &mut Vec<String>,
) {
    let position = columns(stream, position);
    let as_sent = columns(stream, twist);
    let of_the_body = turned(columns(stream, quaternion), as_sent);
    let by_child = unexplained(
        &stream.time_s,
        position,
        [&of_the_body[0], &of_the_body[1], &of_the_body[2]],
    );
    let by_world = unexplained(&stream.time_s, position, as_sent);
    let is_the_worlds = matches!((by_child, by_world), (Some(body), Some(world)) if world < CLEARER * body);
    let world = if is_the_worlds {
        notes.push(format!(
            "{}: the twist should be in the body's axes, but the position changes as if it were in the world's: taken as that",
            stream.name
        ));
        as_sent.map(<[f64]>::to_vec)
    } else {
        of_the_body
    };
    push(stream, world);
}

/// Discharge > 0. Drivers that do not follow the sign convention of the message are recognised by their median.
fn discharge(stream: &mut RawStream, notes: &mut Vec<String>) {
    let Some(place) = place(stream, "current") else { return };
    let current = &stream.fields[place].1;
    let mut finite: Vec<f64> = current.iter().copied().filter(|value| value.is_finite()).collect();
    let against = median(&mut finite).is_some_and(|middle| middle > 0.0);
    if against {
        notes.push(format!(
            "{}: the current is positive, though the message has it negative while it discharges: taken as discharge",
            stream.name
        ));
    }
    let sign = if against { 1.0 } else { -1.0 };
    let values = current.iter().map(|value| sign * value).collect();
    stream.fields.push(("discharge".to_owned(), values));
}
