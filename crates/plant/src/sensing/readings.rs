//! The sensors and the numbers that they give.

use serde::{Deserialize, Serialize};

use crate::vector::Vector3;

/// Sensors, in the order of the bits of `SensedSample::stale_sensors`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sensor {
    /// p_F, m, NED.
    Position,
    /// ṗ_F, m/s, NED.
    Velocity,
    /// η, rad.
    Attitude,
    /// ω, rad/s, body.
    #[doc(alias = "gyro")]
    BodyRates,
    /// V_batt, V.
    BatteryVoltage,
}

/// Number of [`Sensor`]s.
pub(crate) const SENSORS: usize = 5;

impl Sensor {
    /// Every sensor, in bit order.
    pub const ALL: [Self; SENSORS] = [
        Self::Position,
        Self::Velocity,
        Self::Attitude,
        Self::BodyRates,
        Self::BatteryVoltage,
    ];

    /// Numbers that the sensor gives: 3, or 1 for the voltage.
    pub fn width(self) -> usize {
        if self == Self::BatteryVoltage { 1 } else { 3 }
    }

    pub(crate) fn index(self) -> usize {
        self as usize
    }

    pub(crate) fn stream(self) -> &'static str {
        [
            "sensor/position",
            "sensor/velocity",
            "sensor/attitude",
            "sensor/body-rates",
            "sensor/battery-voltage",
        ][self.index()]
    }
}

/// Readings of all sensors, indexed by [`Sensor`]; the voltage is the first element of its row.
pub(crate) type Readings = [Vector3; SENSORS];
