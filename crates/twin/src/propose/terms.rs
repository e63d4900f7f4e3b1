//! The terms that a proposal is made of: places and expressions that share one factor.
//!
//! Simple ones first: of two that explain nearly the same, the earlier one is chosen. The measured quantity of a
//! channel is not a regressor of its own residual: the specific force contains the missing force, the angular
//! acceleration the missing torque.

use std::f64::consts::TAU;

use super::candidate::Candidate;
use super::regression::Regression;
use crate::predict::channels::{F, KA, KP, KV, M, V};

const AXES: [&str; 3] = ["x", "y", "z"];
const RATES: [&str; 3] = ["roll_rate", "pitch_rate", "yaw_rate"];
/// Speeds from which a drag may begin, m/s.
const THRESHOLDS_M_S: [f64; 5] = [1.5, 2.0, 2.5, 3.0, 4.0];
/// Lengths from which a tether may pull, m.
const SLACKS_M: [f64; 5] = [1.0, 2.0, 3.0, 4.0, 6.0];
/// Frequencies that are searched, Hz: up to the resolution of means of 0.1 s.
const FREQUENCY_STEP_HZ: f64 = 0.02;
const LOWEST_HZ: f64 = 0.1;
const HIGHEST_HZ: f64 = 4.5;
/// Share of a channel's variance that one frequency must have.
const PERIODIC_SHARE: f64 = 0.15;

/// Same expression on several axes of a place.
fn on_axes(place: &str, axes: &[usize], what: impl Fn(usize) -> String) -> Candidate {
    Candidate::new(axes.iter().map(|&axis| (format!("{place}_{}", AXES[axis]), what(axis))))
}

/// All together, horizontal, each alone.
const AXIS_SETS: [&[usize]; 5] = [&[0, 1, 2], &[0, 1], &[0], &[1], &[2]];

/// The terms that can act on the failing channels.
///
/// * `middle_s`: the middle of what is judged. Terms of the time are 0 there, because a vehicle is calibrated on the mean of its flight
pub(super) fn candidates(failing: &[usize], middle_s: f64) -> Vec<Candidate> {
    let time = format!("(time - {middle_s:.1}[s])");
    let fails = |first: usize, count: usize| failing.iter().any(|c| (first..first + count).contains(c));
    let mut found = Vec::new();
    if fails(F, 3) {
        forces(&mut found, &time);
    }
    if fails(M, 3) {
        torques(&mut found, &time);
    }
    if fails(KV, 3) || fails(KA, 3) || fails(KP, 3) {
        readings(&mut found, &time);
    }
    if fails(V, 1) {
        found.push(Candidate::new([("voltage", time.clone())]));
        found.push(Candidate::new([("voltage", format!("{time}^2"))]));
        found.push(Candidate::new([("voltage", "thrust")]));
        found.push(Candidate::new([("voltage", "airspeed")]));
    }
    found
}

fn forces(found: &mut Vec<Candidate>, time: &str) {
    let velocity = |axis: usize| format!("air_velocity_{}", AXES[axis]);
    for power in ["", " * airspeed", " * airspeed^2", " * mean_speed_ratio"] {
        for axes in AXIS_SETS {
            found.push(on_axes("force", axes, |axis| format!("{}{power}", velocity(axis))));
        }
    }
    for what in [
        "thrust",
        "thrust * airspeed",
        "thrust * airspeed^2",
        &format!("thrust * {time}"),
        &format!("thrust * {time}^2"),
        "airspeed^2",
        time,
    ] {
        found.push(Candidate::new([("force_z", what)]));
    }
    for threshold in THRESHOLDS_M_S {
        for power in ["", "^2", "^3"] {
            found.push(on_axes("force", &[0, 1, 2], |axis| {
                format!(
                    "{} / max(airspeed, 0.01[m/s]) * max(airspeed - {threshold:?}[m/s], 0){power}",
                    velocity(axis)
                )
            }));
        }
    }
    // Towards the origin, horizontally; the tilt of the vehicle is left out.
    let ahead = "(position_north * cos(yaw) + position_east * sin(yaw))";
    let right = "(position_east * cos(yaw) - position_north * sin(yaw))";
    found.push(Candidate::new([("force_x", ahead), ("force_y", right)]));
    found.push(Candidate::new([
        ("force_x", ahead),
        ("force_y", right),
        ("force_z", "position_down"),
    ]));
    found.push(Candidate::new([("force_z", "position_down")]));
    for slack in SLACKS_M {
        let taut = format!("max(1 - {slack:?}[m] / max(hypot(position_north, position_east), 0.01[m]), 0)");
        found.push(Candidate::new([
            ("force_x", format!("{ahead} * {taut}")),
            ("force_y", format!("{right} * {taut}")),
        ]));
    }
    for (a, b) in [("cos(yaw)", "-sin(yaw)"), ("sin(yaw)", "cos(yaw)")] {
        found.push(Candidate::new([("force_x", a), ("force_y", b)]));
    }
    for axis in [0, 1] {
        for what in ["sign(sin(yaw))", "sign(cos(yaw))", time] {
            found.push(on_axes("force", &[axis], |_| what.to_owned()));
        }
    }
}

fn torques(found: &mut Vec<Candidate>, time: &str) {
    for power in ["", " * airspeed", " * mean_speed_ratio"] {
        found.push(Candidate::new([
            ("torque_x", format!("air_velocity_y{power}")),
            ("torque_y", format!("-air_velocity_x{power}")),
        ]));
    }
    for axis in 0..3 {
        for of in AXES {
            found.push(on_axes("torque", &[axis], |_| format!("air_velocity_{of}")));
        }
    }
    for axes in AXIS_SETS {
        found.push(on_axes("torque", axes, |axis| RATES[axis].to_owned()));
        found.push(on_axes("torque", axes, |axis| format!("{0} * abs({0})", RATES[axis])));
    }
    for axis in 0..3 {
        for what in [
            "sign(sin(yaw))",
            "sign(cos(yaw))",
            "sin(yaw)",
            "cos(yaw)",
            "thrust",
            time,
            "roll_rate * pitch_rate",
            "roll_rate * yaw_rate",
            "pitch_rate * yaw_rate",
        ] {
            found.push(on_axes("torque", &[axis], |_| what.to_owned()));
        }
    }
}

fn readings(found: &mut Vec<Candidate>, time: &str) {
    for place in ["roll", "pitch", "yaw"] {
        for what in ["thrust", time, "sin(yaw)", "cos(yaw)"] {
            found.push(Candidate::new([(place, what)]));
        }
    }
    for axes in AXIS_SETS {
        found.push(on_axes("gyro", axes, |axis| format!("specific_force_{}", AXES[axis])));
        found.push(on_axes("accelerometer", axes, |axis| {
            format!("specific_force_{0} * abs(specific_force_{0})", AXES[axis])
        }));
    }
    for place in ["gyro", "accelerometer"] {
        for axis in 0..3 {
            for what in [time, "thrust"] {
                found.push(on_axes(place, &[axis], |_| what.to_owned()));
            }
        }
    }
    for direction in ["north", "east", "down"] {
        found.push(Candidate::new([(format!("velocity_{direction}"), time)]));
        found.push(Candidate::new([(format!("velocity_{direction}"), "airspeed")]));
    }
}

/// Sines and cosines at the strongest frequency of each failing force and torque channel.
pub(super) fn periodic(regressions: &[Regression], failing: &[usize]) -> Vec<Candidate> {
    let mut found = Vec::new();
    for (first, place) in [(F, "force"), (M, "torque")] {
        for axis in 0..3 {
            if !failing.contains(&(first + axis)) {
                continue;
            }
            let steps = ((HIGHEST_HZ - LOWEST_HZ) / FREQUENCY_STEP_HZ) as usize;
            let share = |hz: f64| {
                let (power, variance) = regressions
                    .iter()
                    .map(|regression| regression.power_at(first + axis, hz))
                    .fold((0.0, 0.0), |(p, v), (power, variance)| (p + power, v + variance));
                power / variance.max(f64::MIN_POSITIVE)
            };
            let best = (0..=steps)
                .map(|step| LOWEST_HZ + step as f64 * FREQUENCY_STEP_HZ)
                .map(|hz| (hz, share(hz)))
                .max_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((hz, share)) = best
                && share > PERIODIC_SHARE
            {
                let angular = TAU * hz;
                for wave in ["sin", "cos"] {
                    found.push(on_axes(place, &[axis], |_| format!("{wave}({angular:.4}[1/s] * time)")));
                }
            }
        }
    }
    found
}
