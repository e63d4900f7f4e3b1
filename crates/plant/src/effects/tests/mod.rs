//! Tests of the effects, and the instant at which they are asked.

mod by_hand;
mod rules;

use super::*;
use crate::testing::vehicle;

/// F550: hover thrust 1.55 · 9.81/6 = 2.53425 N.
pub(crate) fn f550() -> Constants {
    Constants::nominal(&vehicle("f550"))
}

/// Thrusts, speed ratios, their rates, and duties of an instant.
pub(crate) struct Rotors {
    pub(crate) thrust: [f64; 6],
    pub(crate) ratio: [f64; 6],
    pub(crate) rate: [f64; 6],
    pub(crate) duty: [f64; 6],
}

impl Rotors {
    /// Six rotors with distinct thrusts around hover.
    pub(crate) fn distinct(constants: &Constants) -> Self {
        let thrust = [2.0, 2.2, 2.4, 2.6, 2.8, 3.0];
        Self {
            thrust,
            ratio: thrust.map(|f: f64| (f / constants.hover_thrust_n).sqrt()),
            rate: [0.5, -0.4, 0.3, -0.2, 0.1, 0.6],
            duty: [0.31, 0.33, 0.35, 0.40, 0.42, 0.44],
        }
    }
}

/// An instant of fast flight close to the ground: every effect of the catalogue has something to act on.
pub(crate) fn instant<'a>(constants: &'a Constants, rotors: &'a Rotors) -> Moment<'a> {
    Moment {
        time_s: 1.0,
        step_s: 0.0025,
        position_ned: [3.0, -2.0, -2.8],
        velocity_ned: [4.0, 1.0, 3.6],
        air_velocity_body: [4.0, 1.0, 3.6],
        body_rates: [0.3, -0.2, 0.5],
        angular_acceleration: [2.0, -1.0, 0.5],
        specific_force: [0.4, -0.3, -9.0],
        ned_from_body: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        height_above_ground: 0.3,
        rotor_thrust: &rotors.thrust,
        rotor_speed_ratio: &rotors.ratio,
        rotor_speed_rate: &rotors.rate,
        duty: &rotors.duty,
        battery_voltage: 15.5,
        battery_current: 10.0,
        constants,
    }
}

/// Values of a declaration: all 0 or typical shapes, with some set.
pub(crate) fn values(declaration: &EffectDeclaration, set: &[(usize, f64)]) -> Vec<f64> {
    let mut values: Vec<f64> = declaration
        .parameters
        .iter()
        .map(ParameterDeclaration::default_value)
        .collect();
    for &(index, value) in set {
        values[index] = value;
    }
    values
}

/// The effect with these values, on rotor 1.
pub(crate) fn build(declaration: &EffectDeclaration, values: &[f64], nominal: &Constants) -> Box<dyn ActiveEffect> {
    declaration.build(&Setup {
        values,
        rotor: 0,
        nominal,
        seed: 1,
        index: 0,
    })
}

/// Everything that the hooks of an effect change after some steps at one instant: constants, wind, duties, lifts, thrusts, wrench,
/// readings.
pub(crate) fn response(effect: &mut Box<dyn ActiveEffect>) -> Vec<f64> {
    let nominal = f550();
    let mut constants = nominal;
    let rotors = Rotors::distinct(&nominal);
    for _ in 0..20 {
        constants = nominal;
        effect.constants(&mut constants);
        let at = instant(&constants, &rotors);
        effect.wrench(&at, &mut constants.rotor_wrench(&rotors.thrust));
        effect.advance(&at, 0.0025);
    }
    let at = instant(&constants, &rotors);
    let mut out = Vec::new();
    let (mut wind, mut duty, mut lift, mut thrust) = ([0.0; 3], rotors.duty, rotors.thrust, rotors.thrust);
    effect.wind(&at, &mut wind);
    effect.command(&at, &mut duty);
    effect.static_lift(&at, &mut lift);
    effect.rotor_thrust(&at, &mut thrust);
    let mut wrench = constants.rotor_wrench(&thrust);
    wrench.drag_body = [-1.0, -0.25, -0.1];
    effect.wrench(&at, &mut wrench);
    let wrench = constants.closed(&wrench, at.air_velocity_body, at.body_rates);
    let mut readings = Readings {
        position_ned: at.position_ned,
        velocity_ned: at.velocity_ned,
        attitude: [0.1, -0.05, 0.4],
        body_rates: at.body_rates,
        specific_force: at.specific_force,
        battery_voltage: at.battery_voltage,
    };
    effect.readings(&at, &mut readings);
    constants.corrupt(&mut readings, at.angular_acceleration);
    out.extend(wind);
    out.extend(duty.map(|u| constants.effective_duty(u)));
    out.extend(lift);
    out.extend(thrust);
    out.extend((0..6).map(|i| constants.thrust_rate(lift[i], 2.5)));
    out.extend(wrench.force_body);
    out.extend(wrench.torque_body);
    out.extend([readings.position_ned, readings.velocity_ned, readings.attitude].concat());
    out.extend([readings.body_rates, readings.specific_force].concat());
    out.push(readings.battery_voltage);
    numbers(&serde_json::to_value(constants).unwrap(), &mut out);
    out
}

fn numbers(value: &serde_json::Value, out: &mut Vec<f64>) {
    match value {
        serde_json::Value::Number(n) => out.push(n.as_f64().unwrap()),
        serde_json::Value::Array(items) => items.iter().for_each(|item| numbers(item, out)),
        serde_json::Value::Object(map) => map.values().for_each(|item| numbers(item, out)),
        _ => {}
    }
}
