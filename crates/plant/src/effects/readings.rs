//! What the sensors say, as effects change it.

use crate::vector::Vector3;

/// Readings of the sensors.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Readings {
    /// m, NED.
    pub position_ned: Vector3,
    /// m/s, NED.
    pub velocity_ned: Vector3,
    /// Roll, pitch, yaw, rad.
    pub attitude: Vector3,
    /// Gyroscope, rad/s, body.
    pub body_rates: Vector3,
    /// Accelerometer, m/s², body.
    pub specific_force: Vector3,
    /// V.
    pub battery_voltage: f64,
}
