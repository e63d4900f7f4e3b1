//! Topics of a log, and the columns behind their fields.
//!
//! Topics and fields known to PX4 have PX4's names, units and frames (world NED, body FRD, quaternion w x y z from body to world), so that
//! tools for PX4 logs show them. Data without a PX4 counterpart are in `rotortwin_…`. PX4 fields without data are omitted.

use crate::query::QueryError;

/// Type of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    /// `float`
    F32,
    /// `double`
    F64,
    /// `int32_t`
    I32,
    /// `uint32_t`
    U32,
    /// `uint64_t`
    U64,
    /// `bool`
    Bool,
}
use Number::{Bool, F32, F64, I32, U32, U64};

impl Number {
    const fn text(self) -> &'static str {
        match self {
            F32 => "float",
            F64 => "double",
            I32 => "int32_t",
            U32 => "uint32_t",
            U64 => "uint64_t",
            Bool => "bool",
        }
    }

    /// Appends a value; integers saturate at the ends of their range.
    #[inline]
    pub(super) fn write(self, value: f64, out: &mut Vec<u8>) {
        match self {
            F32 => out.extend_from_slice(&(value as f32).to_le_bytes()),
            F64 => out.extend_from_slice(&value.to_le_bytes()),
            I32 => out.extend_from_slice(&(value as i32).to_le_bytes()),
            U32 => out.extend_from_slice(&(value as u32).to_le_bytes()),
            U64 => out.extend_from_slice(&(value as u64).to_le_bytes()),
            Bool => out.push(u8::from(value != 0.0)),
        }
    }
}

/// Where the values of a field come from.
enum Source {
    /// Columns, one per entry. `#` in a name stands for the rotor number: one entry per rotor.
    Columns(&'static [&'static str]),
    /// As above, padded with NaN to a fixed number of entries.
    Padded(&'static str, usize),
    /// Roll, pitch, yaw as quaternion w x y z.
    Quaternion([&'static str; 3]),
    /// A constant.
    Constant(f64),
}
use Source::{Columns, Constant, Padded, Quaternion};

type Field = (Number, &'static str, Source);

const TOPICS: [(&str, &[Field]); 13] = [
    (
        "vehicle_angular_velocity",
        &[(
            F32,
            "xyz",
            Columns(&["roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"]),
        )],
    ),
    (
        "sensor_combined",
        &[
            (
                F32,
                "gyro_rad",
                Columns(&["roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"]),
            ),
            (
                F32,
                "accelerometer_m_s2",
                Columns(&["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"]),
            ),
        ],
    ),
    (
        "vehicle_attitude",
        &[(F32, "q", Quaternion(["roll_rad", "pitch_rad", "yaw_rad"]))],
    ),
    (
        "vehicle_local_position",
        &[
            (F32, "x", Columns(&["position_north_m"])),
            (F32, "y", Columns(&["position_east_m"])),
            (F32, "z", Columns(&["position_down_m"])),
            (F32, "vx", Columns(&["velocity_north_m_s"])),
            (F32, "vy", Columns(&["velocity_east_m_s"])),
            (F32, "vz", Columns(&["velocity_down_m_s"])),
            (F32, "heading", Columns(&["yaw_rad"])),
            (Bool, "xy_valid", Constant(1.0)),
            (Bool, "z_valid", Constant(1.0)),
            (Bool, "v_xy_valid", Constant(1.0)),
            (Bool, "v_z_valid", Constant(1.0)),
        ],
    ),
    (
        "vehicle_local_position_setpoint",
        &[
            (F32, "x", Columns(&["reference_north_m"])),
            (F32, "y", Columns(&["reference_east_m"])),
            (F32, "z", Columns(&["reference_down_m"])),
            (F32, "yaw", Columns(&["reference_yaw_rad"])),
            (F32, "vx", Columns(&["reference_velocity_north_m_s"])),
            (F32, "vy", Columns(&["reference_velocity_east_m_s"])),
            (F32, "vz", Columns(&["reference_velocity_down_m_s"])),
        ],
    ),
    (
        "vehicle_attitude_setpoint",
        &[
            (F32, "roll_body", Columns(&["roll_setpoint_rad"])),
            (F32, "pitch_body", Columns(&["pitch_setpoint_rad"])),
            (F32, "yaw_body", Columns(&["yaw_setpoint_rad"])),
            (
                F32,
                "q_d",
                Quaternion(["roll_setpoint_rad", "pitch_setpoint_rad", "yaw_setpoint_rad"]),
            ),
        ],
    ),
    ("actuator_motors", &[(F32, "control", Padded("duty_#", 12))]),
    (
        "battery_status",
        &[
            (F32, "voltage_v", Columns(&["battery_voltage_v"])),
            (F32, "current_a", Columns(&["battery_current_a"])),
        ],
    ),
    (
        "vehicle_attitude_groundtruth",
        &[(
            F32,
            "q",
            Quaternion(["true_roll_rad", "true_pitch_rad", "true_yaw_rad"]),
        )],
    ),
    (
        "vehicle_angular_velocity_groundtruth",
        &[(
            F32,
            "xyz",
            Columns(&["true_roll_rate_rad_s", "true_pitch_rate_rad_s", "true_yaw_rate_rad_s"]),
        )],
    ),
    (
        "vehicle_local_position_groundtruth",
        &[
            (F32, "x", Columns(&["true_position_north_m"])),
            (F32, "y", Columns(&["true_position_east_m"])),
            (F32, "z", Columns(&["true_position_down_m"])),
            (F32, "vx", Columns(&["true_velocity_north_m_s"])),
            (F32, "vy", Columns(&["true_velocity_east_m_s"])),
            (F32, "vz", Columns(&["true_velocity_down_m_s"])),
            (F32, "heading", Columns(&["true_yaw_rad"])),
            (Bool, "xy_valid", Constant(1.0)),
            (Bool, "z_valid", Constant(1.0)),
            (Bool, "v_xy_valid", Constant(1.0)),
            (Bool, "v_z_valid", Constant(1.0)),
        ],
    ),
    (
        "rotortwin_truth",
        &[
            (U64, "step", Columns(&["step"])),
            (F64, "thrust_n", Columns(&["true_thrust_#_n"])),
            (F64, "state_of_charge", Columns(&["true_state_of_charge"])),
            (F64, "open_circuit_voltage_v", Columns(&["true_open_circuit_voltage_v"])),
            (F64, "battery_voltage_v", Columns(&["true_battery_voltage_v"])),
            (F64, "battery_current_a", Columns(&["battery_current_a"])),
            (
                F64,
                "wind_ned_m_s",
                Columns(&["wind_north_m_s", "wind_east_m_s", "wind_down_m_s"]),
            ),
            (U64, "faulty_rotors", Columns(&["faulty_rotors"])),
            (U64, "sensor_faults", Columns(&["sensor_faults"])),
            (I32, "fault_label", Columns(&["fault_label"])),
            (I32, "rotor_condition", Columns(&["rotor_condition_#"])),
        ],
    ),
    (
        "rotortwin_fdi",
        &[
            (F32, "residual_arm_nms", Columns(&["residual_#_arm_nms"])),
            (F32, "residual_lever_nms", Columns(&["residual_#_lever_nms"])),
            (F32, "residual_yaw_nms", Columns(&["residual_#_yaw_nms"])),
            (F32, "wrench_residual_fz_ns", Columns(&["wrench_residual_fz_ns"])),
            (
                F32,
                "wrench_residual_m_nms",
                Columns(&[
                    "wrench_residual_mx_nms",
                    "wrench_residual_my_nms",
                    "wrench_residual_mz_nms",
                ]),
            ),
            (I32, "verdict_t_test", Columns(&["verdict_t_test"])),
            (I32, "verdict_network", Columns(&["verdict_network"])),
            (I32, "verdict_sequential", Columns(&["verdict_sequential"])),
            (F32, "sequential_probability", Columns(&["sequential_probability"])),
            (
                F32,
                "thrust_loss_n",
                Columns(&["thrust_loss_n", "thrust_loss_low_n", "thrust_loss_high_n"]),
            ),
            (
                F32,
                "thrust_loss_share",
                Columns(&["thrust_loss_share", "thrust_loss_share_low", "thrust_loss_share_high"]),
            ),
            (
                F32,
                "second_thrust_loss_n",
                Columns(&[
                    "second_thrust_loss_n",
                    "second_thrust_loss_low_n",
                    "second_thrust_loss_high_n",
                ]),
            ),
            (
                F32,
                "second_thrust_loss_share",
                Columns(&[
                    "second_thrust_loss_share",
                    "second_thrust_loss_share_low",
                    "second_thrust_loss_share_high",
                ]),
            ),
            (I32, "hypothesis_count", Columns(&["hypothesis_count"])),
            (U32, "suspect_rotors", Columns(&["suspect_rotors"])),
            (U64, "saturated_rotors", Columns(&["saturated_rotors"])),
            (I32, "window_end", Columns(&["window_end"])),
        ],
    ),
];

/// One value of a sample.
#[derive(Clone, Copy, Debug)]
pub(super) enum Value {
    /// Value of this column.
    Column(usize),
    /// A constant.
    Constant(f64),
    /// All four components of a quaternion: columns of roll, pitch, yaw.
    Quaternion([usize; 3]),
}

/// A topic of one log.
#[derive(Debug)]
pub(super) struct Topic {
    /// `sensor_combined`.
    pub(super) name: &'static str,
    /// `name:type field;…`, the time first.
    pub(super) format: String,
    /// Values after the time.
    pub(super) values: Vec<(Number, Value)>,
}

/// The topics of a vehicle with `rotors` rotors; `place` returns the index of a column.
pub(super) fn topics(
    rotors: usize,
    place: impl Fn(&str) -> Result<usize, QueryError>,
) -> Result<Vec<Topic>, QueryError> {
    let mut topics = Vec::with_capacity(TOPICS.len());
    for (name, fields) in &TOPICS {
        let mut topic = Topic {
            name,
            format: format!("{name}:uint64_t timestamp;"),
            values: Vec::new(),
        };
        for (number, field, from) in *fields {
            let first = topic.values.len();
            let mut entries = 0;
            let mut column = |pattern: &str| -> Result<(), QueryError> {
                let rotors = if pattern.contains('#') { 1..=rotors } else { 1..=1 };
                for rotor in rotors {
                    let place = place(&pattern.replace('#', &rotor.to_string()))?;
                    topic.values.push((*number, Value::Column(place)));
                }
                Ok(())
            };
            match from {
                Columns(names) => names.iter().try_for_each(|name| column(name))?,
                Padded(name, least) => {
                    column(name)?;
                    let missing = least.saturating_sub(topic.values.len() - first);
                    topic.values.extend(vec![(*number, Value::Constant(f64::NAN)); missing]);
                }
                Quaternion([roll, pitch, yaw]) => {
                    let places = [place(roll)?, place(pitch)?, place(yaw)?];
                    topic.values.push((*number, Value::Quaternion(places)));
                    entries = 4;
                }
                Constant(value) => topic.values.push((*number, Value::Constant(*value))),
            }
            entries = entries.max(topic.values.len() - first);
            topic.format += &match entries {
                1 => format!("{} {field};", number.text()),
                _ => format!("{}[{entries}] {field};", number.text()),
            };
        }
        topics.push(topic);
    }
    Ok(topics)
}
