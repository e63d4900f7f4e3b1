//! Logs of the independent simulator as an autopilot without a position writes them.

use rotortwin_blind::error::BlindError;
use rotortwin_blind::flight::{FlightPlan, Row, fly};
use rotortwin_twin::log::FlightLog;

/// Flies, and logs all but the position; `order` says which rotor drives output i.
pub(crate) fn foreign_log(name: &str, plan: &FlightPlan, order: &[usize]) -> Result<FlightLog, BlindError> {
    let (rows, _) = fly(plan)?;
    let of = |value: &dyn Fn(&Row) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
    let mut columns = Vec::new();
    for (axis, [velocity, attitude, rate, accel]) in [
        ["velocity_north_m_s", "roll_rad", "roll_rate_rad_s", "accel_x_m_s2"],
        ["velocity_east_m_s", "pitch_rad", "pitch_rate_rad_s", "accel_y_m_s2"],
        ["velocity_down_m_s", "yaw_rad", "yaw_rate_rad_s", "accel_z_m_s2"],
    ]
    .into_iter()
    .enumerate()
    {
        columns.push((velocity.to_owned(), of(&|r| r.velocity[axis])));
        columns.push((attitude.to_owned(), of(&|r| r.euler[axis])));
        columns.push((rate.to_owned(), of(&|r| r.rates[axis])));
        columns.push((accel.to_owned(), of(&|r| r.accel[axis])));
    }
    for (output, rotor) in order.iter().enumerate() {
        columns.push((format!("duty_{}", output + 1), of(&|r| r.duties[*rotor])));
    }
    columns.push(("battery_voltage_v".to_owned(), of(&|r| r.voltage)));
    Ok(FlightLog::from_columns(name, of(&|r| r.time), columns).unwrap())
}
