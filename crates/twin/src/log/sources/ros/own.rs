//! `run.mcap` of this program: the messages of `proto/rotortwin/v1/telemetry.proto`.
//!
//! Names of the columns are those of the messages: `position_ned_m.north`, `duty[0]`. Values have single precision there.

use prost::Message as _;
use rotortwin_proto::{
    BatteryTelemetry, BodyVector, CommandTelemetry, EulerAngles, NavTelemetry, NedVector, ReferenceTelemetry,
};

/// Their names begin with it.
pub(super) const PACKAGE: &str = "rotortwin.v1.";

/// Values under their names.
#[derive(Default)]
struct Values(Vec<(String, f64)>);

impl Values {
    fn one(&mut self, name: &str, value: f32) {
        self.0.push((name.to_owned(), f64::from(value)));
    }

    fn ned(&mut self, name: &str, vector: Option<NedVector>) {
        let vector = vector.unwrap_or_default();
        for (axis, value) in [("north", vector.north), ("east", vector.east), ("down", vector.down)] {
            self.one(&format!("{name}.{axis}"), value);
        }
    }

    fn body(&mut self, name: &str, vector: Option<BodyVector>) {
        let vector = vector.unwrap_or_default();
        for (axis, value) in [
            ("forward", vector.forward),
            ("right", vector.right),
            ("down", vector.down),
        ] {
            self.one(&format!("{name}.{axis}"), value);
        }
    }

    fn angles(&mut self, name: &str, angles: Option<EulerAngles>) {
        let angles = angles.unwrap_or_default();
        for (axis, value) in [
            ("roll_rad", angles.roll_rad),
            ("pitch_rad", angles.pitch_rad),
            ("yaw_rad", angles.yaw_rad),
        ] {
            self.one(&format!("{name}.{axis}"), value);
        }
    }
}

/// Names and values of a message; an error is a message that does not match its type.
pub(super) fn read(kind: &str, bytes: &[u8]) -> Result<Vec<(String, f64)>, String> {
    let mut values = Values::default();
    let damaged = |error: prost::DecodeError| format!("{} bytes: {error}", bytes.len());
    match kind.strip_prefix(PACKAGE).unwrap_or(kind) {
        "NavTelemetry" => {
            let nav = NavTelemetry::decode(bytes).map_err(damaged)?;
            values.ned("position_ned_m", nav.position_ned_m);
            values.ned("velocity_ned_m_s", nav.velocity_ned_m_s);
            values.angles("attitude", nav.attitude);
            values.body("body_rates_rad_s", nav.body_rates_rad_s);
        }
        "ReferenceTelemetry" => {
            let reference = ReferenceTelemetry::decode(bytes).map_err(damaged)?;
            values.ned("position_ned_m", reference.position_ned_m);
            values.one("yaw_rad", reference.yaw_rad);
        }
        "CommandTelemetry" => {
            let command = CommandTelemetry::decode(bytes).map_err(damaged)?;
            for (rotor, duty) in command.duty.into_iter().enumerate() {
                values.one(&format!("duty[{rotor}]"), duty);
            }
        }
        "BatteryTelemetry" => {
            let battery = BatteryTelemetry::decode(bytes).map_err(damaged)?;
            values.one("voltage_v", battery.voltage_v);
            values.one("current_a", battery.current_a);
        }
        other => return Err(format!("{other} is not read")),
    }
    Ok(values.0)
}
