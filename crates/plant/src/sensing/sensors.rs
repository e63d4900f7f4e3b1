//! Sensors: the true state plus white Gaussian noise (Table 4), then the sensor faults of the scenario.
//!
//! The paper's sensors are the outputs of an estimator, so position, velocity, attitude and body rates are measured
//! directly; the accelerometer of Table 4 is used by no algorithm of the paper and only simulated where a flight is
//! recorded. Each sensor has its own noise stream; noise is drawn at every step, faulty or not, so a sensor fault
//! affects only its own sensor.

use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::signals::NavState;
use serde::{Deserialize, Serialize};

use crate::error::{Refusal, in_range};
use crate::random::NormalStream;
use crate::sensing::faults::{SensorFaultBank, SensorFaultPlan};
use crate::sensing::readings::{Readings, SENSORS, Sensor};
use crate::vector::Vector3;

/// `[sensors]` of a scenario: standard deviations of the noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorModel {
    /// m, each axis.
    pub position_noise_m: f64,
    /// m/s, each axis.
    pub velocity_noise_m_s: f64,
    /// rad, each angle.
    pub attitude_noise_rad: f64,
    /// rad/s, each axis.
    pub body_rates_noise_rad_s: f64,
    /// V.
    pub battery_voltage_noise_v: f64,
    /// Constant error of the voltage measurement, V; any drawn bias of `[mismatch]` comes on top.
    pub battery_voltage_bias_v: f64,
    /// m/s², each axis of the accelerometer; left out of documents while it is that of Table 4.
    #[serde(skip_serializing_if = "is_table_4_accelerometer")]
    pub accelerometer_noise_m_s2: f64,
}

/// Table 4: deviation of p̈, m/s².
const TABLE_4_ACCELEROMETER_M_S2: f64 = 0.0785;

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature is serde's")]
fn is_table_4_accelerometer(deviation: &f64) -> bool {
    *deviation == SensorModel::default().accelerometer_noise_m_s2
}

impl Default for SensorModel {
    /// Table 4; an exact voltage measurement.
    fn default() -> Self {
        Self {
            position_noise_m: 7.848e-4,
            velocity_noise_m_s: 0.0078,
            attitude_noise_rad: 5.5192e-4,
            body_rates_noise_rad_s: 0.0055,
            battery_voltage_noise_v: 0.0,
            battery_voltage_bias_v: 0.0,
            accelerometer_noise_m_s2: TABLE_4_ACCELEROMETER_M_S2,
        }
    }
}

impl SensorModel {
    /// No noise at all.
    pub fn exact() -> Self {
        Self {
            position_noise_m: 0.0,
            velocity_noise_m_s: 0.0,
            attitude_noise_rad: 0.0,
            body_rates_noise_rad_s: 0.0,
            accelerometer_noise_m_s2: 0.0,
            ..Self::default()
        }
    }

    /// Refuses deviations and errors that no sensor has.
    pub fn check(&self) -> Result<(), Refusal> {
        in_range("position_noise_m", self.position_noise_m, 0.0, 10.0, "m")?;
        in_range("velocity_noise_m_s", self.velocity_noise_m_s, 0.0, 10.0, "m/s")?;
        in_range("attitude_noise_rad", self.attitude_noise_rad, 0.0, 1.0, "rad")?;
        in_range(
            "body_rates_noise_rad_s",
            self.body_rates_noise_rad_s,
            0.0,
            10.0,
            "rad/s",
        )?;
        in_range("battery_voltage_noise_v", self.battery_voltage_noise_v, 0.0, 5.0, "V")?;
        in_range("battery_voltage_bias_v", self.battery_voltage_bias_v, -5.0, 5.0, "V")?;
        in_range(
            "accelerometer_noise_m_s2",
            self.accelerometer_noise_m_s2,
            0.0,
            100.0,
            "m/s²",
        )
    }
}

/// The accelerometer: specific force with white noise. Not one of the [`Sensor`]s: controller and detector do not have it.
#[derive(Debug, Clone)]
pub(crate) struct Accelerometer {
    deviation: f64,
    noise: NormalStream,
}

impl Accelerometer {
    pub(crate) fn new(model: &SensorModel, seed: u64) -> Self {
        Self {
            deviation: model.accelerometer_noise_m_s2,
            noise: NormalStream::new(seed, "sensor/accelerometer"),
        }
    }

    /// The reading, m/s², body; once a step.
    pub(crate) fn measure(&mut self, specific_force: Vector3) -> [f32; 3] {
        let noise = self.noise.sample3();
        [0, 1, 2].map(|i| (specific_force[i] + self.deviation * noise[i]) as f32)
    }
}

/// All sensors of one flight.
#[derive(Debug, Clone)]
pub(crate) struct SensorSuite {
    deviation: [f64; SENSORS],
    noise: [NormalStream; SENSORS],
    voltage_bias: f64,
    faults: SensorFaultBank,
}

impl SensorSuite {
    pub(crate) fn new(
        model: &SensorModel,
        extra_voltage_noise: f64,
        extra_voltage_bias: f64,
        faults: &SensorFaultPlan,
        seed: u64,
    ) -> Self {
        let voltage_noise = model.battery_voltage_noise_v;
        let voltage_noise = (voltage_noise * voltage_noise + extra_voltage_noise * extra_voltage_noise).sqrt();
        Self {
            deviation: [
                model.position_noise_m,
                model.velocity_noise_m_s,
                model.attitude_noise_rad,
                model.body_rates_noise_rad_s,
                voltage_noise,
            ],
            noise: Sensor::ALL.map(|sensor| NormalStream::new(seed, sensor.stream())),
            voltage_bias: model.battery_voltage_bias_v + extra_voltage_bias,
            faults: SensorFaultBank::new(faults, seed),
        }
    }

    /// True if any sensor fault is planned.
    pub(crate) fn has_faults(&self) -> bool {
        !self.faults.is_empty()
    }

    /// Standard deviations, indexed by [`Sensor`].
    pub(crate) fn deviations(&self) -> &[f64; SENSORS] {
        &self.deviation
    }

    /// Constant error of the voltage, V.
    pub(crate) fn voltage_bias(&self) -> f64 {
        self.voltage_bias
    }

    /// The next three standard normals of a sensor with three axes; 0 if it is exact.
    #[inline]
    fn normals(&mut self, sensor: usize) -> [f64; 3] {
        if self.deviation[sensor] > 0.0 {
            self.noise[sensor].sample3()
        } else {
            [0.0; 3]
        }
    }

    /// Puts this step's standard normals into a column: three for each sensor, one for the voltage (0 if it is exact).
    #[inline]
    pub(crate) fn noise<const L: usize>(&mut self, rows: &mut [[f64; L]; 3 * SENSORS - 2], lane: usize) {
        for sensor in 0..SENSORS - 1 {
            let normals = self.normals(sensor);
            for axis in 0..3 {
                rows[3 * sensor + axis][lane] = normals[axis];
            }
        }
        let exact = self.deviation[SENSORS - 1] <= 0.0;
        rows[3 * SENSORS - 3][lane] = if exact { 0.0 } else { self.noise[SENSORS - 1].sample() };
    }

    /// Readings of the sensors for `truth` at `step`, which must be one after the previous step; and the bit mask of
    /// stale sensors.
    #[inline]
    pub(crate) fn measure(&mut self, step: u64, truth: &Readings) -> (NavState, f32, u32) {
        let mut readings = *truth;
        for sensor in 0..SENSORS - 1 {
            let (deviation, noise) = (self.deviation[sensor], self.normals(sensor));
            for (reading, n) in readings[sensor].iter_mut().zip(noise) {
                *reading += deviation * n;
            }
        }
        let voltage = SENSORS - 1;
        readings[voltage][0] += self.voltage_bias;
        if self.deviation[voltage] > 0.0 {
            readings[voltage][0] += self.deviation[voltage] * self.noise[voltage].sample();
        }
        let stale = if self.faults.is_empty() {
            0
        } else {
            self.faults.corrupt(step, &mut readings)
        };
        let [position, velocity, attitude, body_rates, voltage] = readings.map(|row| row.map(|x| x as f32));
        let nav = NavState {
            position_ned: Vec3::from_array(position),
            velocity_ned: Vec3::from_array(velocity),
            attitude: EulerAngles {
                roll: attitude[0],
                pitch: attitude[1],
                yaw: attitude[2],
            },
            body_rates: Vec3::from_array(body_rates),
        };
        (nav, voltage[0], stale)
    }
}
