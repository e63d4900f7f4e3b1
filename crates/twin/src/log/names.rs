//! The canonical columns of a flight log: names, units, meaning.
//!
//! State columns are the values at `time_s`; the duty of a row is in force from `time_s` to the next row (zero-order hold).

use rotortwin_flight_core::MAX_ROTORS;

/// Time since the start of the log, s. The only column that must be there.
pub const TIME: &str = "time_s";
/// Position of the centre of mass, m, NED.
pub const POSITION: [&str; 3] = ["position_north_m", "position_east_m", "position_down_m"];
/// Velocity over ground, m/s, NED.
pub const VELOCITY: [&str; 3] = ["velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"];
/// Euler angles ZYX (roll, pitch, yaw), rad, body in NED.
pub const ATTITUDE: [&str; 3] = ["roll_rad", "pitch_rad", "yaw_rad"];
/// Attitude quaternion (w, x, y, z), Hamilton, body → NED.
pub const QUATERNION: [&str; 4] = ["quat_w", "quat_x", "quat_y", "quat_z"];
/// Body rates p, q, r, rad/s, FRD.
pub const RATES: [&str; 3] = ["roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"];
/// Specific force, m/s², FRD: at rest on the ground z reads −9.81.
pub const ACCEL: [&str; 3] = ["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"];
/// Voltage at the battery's terminals, V.
pub const BATTERY_VOLTAGE: &str = "battery_voltage_v";
/// Current at the battery's terminals, A, discharge > 0.
pub const BATTERY_CURRENT: &str = "battery_current_a";
/// Height over the ground below, m.
pub const HEIGHT_ABOVE_GROUND: &str = "height_above_ground_m";
/// Set points of the controller: position (m, NED) and yaw (rad).
pub const REFERENCE: [&str; 4] = [
    "reference_north_m",
    "reference_east_m",
    "reference_down_m",
    "reference_yaw_rad",
];
/// Commanded collective thrust, N, up along −z of the body.
pub const THRUST_COMMAND: &str = "thrust_command_n";
/// Commanded torque, N·m, FRD.
pub const TORQUE_COMMAND: [&str; 3] = ["torque_x_command_nm", "torque_y_command_nm", "torque_z_command_nm"];

/// Name of the commanded duty cycle of a rotor (0…1); `rotor` counts from 1.
pub fn duty(rotor: usize) -> String {
    format!("duty_{rotor}")
}

/// Name of the measured speed of a rotor (rad/s); `rotor` counts from 1.
pub fn rotor_speed(rotor: usize) -> String {
    format!("rotor_speed_{rotor}_rad_s")
}

/// Rotor number, from 1, of a `duty_N` column.
pub fn duty_rotor(name: &str) -> Option<usize> {
    rotor_number(name.strip_prefix("duty_")?)
}

/// Rotor number, from 1, of a `rotor_speed_N_rad_s` column.
pub fn speed_rotor(name: &str) -> Option<usize> {
    rotor_number(name.strip_prefix("rotor_speed_")?.strip_suffix("_rad_s")?)
}

fn rotor_number(text: &str) -> Option<usize> {
    let plain = text.bytes().all(|byte| byte.is_ascii_digit()) && !text.starts_with('0');
    let number = text.parse().ok().filter(|_| plain)?;
    (1..=MAX_ROTORS).contains(&number).then_some(number)
}

/// True for a name of the canonical format.
pub fn is_canonical(name: &str) -> bool {
    unit(name).is_some()
}

/// Unit of a canonical column (`1` for fractions); `None` for an unknown name.
pub fn unit(name: &str) -> Option<&'static str> {
    let angle_or_length = |name: &str| if name.ends_with("_rad") { "rad" } else { "m" };
    Some(match name {
        TIME => "s",
        BATTERY_VOLTAGE => "V",
        BATTERY_CURRENT => "A",
        HEIGHT_ABOVE_GROUND => "m",
        THRUST_COMMAND => "N",
        name if POSITION.contains(&name) => "m",
        name if VELOCITY.contains(&name) => "m/s",
        name if ATTITUDE.contains(&name) => "rad",
        name if QUATERNION.contains(&name) => "1",
        name if RATES.contains(&name) => "rad/s",
        name if ACCEL.contains(&name) => "m/s²",
        name if REFERENCE.contains(&name) => angle_or_length(name),
        name if TORQUE_COMMAND.contains(&name) => "N·m",
        name if duty_rotor(name).is_some() => "1",
        name if speed_rotor(name).is_some() => "rad/s",
        _ => return None,
    })
}

/// Place of a column in a file: the canonical ones in the order of the format, the others after them by name.
pub(crate) fn order(name: &str) -> (usize, usize, String) {
    let groups: [&[&str]; 9] = [
        &POSITION,
        &VELOCITY,
        &ATTITUDE,
        &QUATERNION,
        &RATES,
        &ACCEL,
        &[BATTERY_VOLTAGE, BATTERY_CURRENT, HEIGHT_ABOVE_GROUND],
        &REFERENCE,
        &[THRUST_COMMAND, TORQUE_COMMAND[0], TORQUE_COMMAND[1], TORQUE_COMMAND[2]],
    ];
    // Duties and rotor speeds stand between the accelerometer and the battery.
    const AFTER_ACCEL: usize = 6;
    for (index, group) in groups.iter().enumerate() {
        if let Some(place) = group.iter().position(|other| *other == name) {
            let group = if index < AFTER_ACCEL { index } else { index + 2 };
            return (group, place, String::new());
        }
    }
    if let Some(rotor) = duty_rotor(name) {
        return (AFTER_ACCEL, rotor, String::new());
    }
    if let Some(rotor) = speed_rotor(name) {
        return (AFTER_ACCEL + 1, rotor, String::new());
    }
    (usize::MAX, 0, name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_rotor_columns_are_recognised_by_their_number() {
        assert_eq!(duty_rotor("duty_6"), Some(6));
        assert_eq!(speed_rotor("rotor_speed_16_rad_s"), Some(16));
        for name in [
            "duty_0",
            "duty_17",
            "duty_01",
            "duty_+1",
            "duty_",
            "duty_x",
            "duty_1_pwm",
        ] {
            assert_eq!(duty_rotor(name), None, "{name}");
        }
        assert_eq!(unit("roll_rad"), Some("rad"));
        assert_eq!(unit("motor_temperature"), None);
    }
}
