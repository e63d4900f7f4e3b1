//! The pilot: cascaded PID with the gains of Table 5, tilt and acceleration limits, inverse thrust map at a fixed 15.6 V.
//!
//! It gets the same noisy measurements as the log (before any sensor fault: those are faults of the log), because a log
//! whose noise differs from the controller's would give the analysis information that no real log has.

use crate::script::Reference;
use crate::vehicle::Vehicle;
use nalgebra::{Matrix4, Vector3, Vector4};

/// Proportional, integral, derivative of Table 5: position and yaw, roll and pitch.
const OUTER: [f64; 3] = [4.98, 2.08, 3.90];
const INNER: [f64; 3] = [242.0, 720.0, 27.0];
/// Largest tilt of the commanded thrust, rad.
const TILT_LIMIT: f64 = 0.70;
/// Largest commanded vertical accelerations, m/s²: up, where full throttle is the limit of most vehicles, and down.
const CLIMB_LIMIT: f64 = 40.0;
const DROP_LIMIT: f64 = 4.5;
/// Largest commanded angular acceleration, rad/s²: roll, pitch, yaw.
const ANGULAR_LIMIT: [f64; 3] = [60.0, 60.0, 6.0];
/// Largest integral of the position error, m s, and of the attitude error, rad s.
const INTEGRAL_LIMIT: [f64; 2] = [3.0, 0.1];
/// The voltage that the inverse thrust map assumes, V, and its knots.
const MAP_VOLTAGE: f64 = 15.6;
const MAP_KNOTS: usize = 2000;

/// What the pilot sees at one step.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// m, NED.
    pub position: Vector3<f64>,
    /// m/s, NED.
    pub velocity: Vector3<f64>,
    /// Roll, pitch, yaw, rad.
    pub euler: Vector3<f64>,
    /// rad/s, body.
    pub rates: Vector3<f64>,
}

/// The pilot and its integrators.
#[derive(Debug, Clone)]
pub struct Pilot {
    mass: f64,
    gravity: f64,
    inertia: [f64; 3],
    /// Rotor thrusts from total thrust and torques, one row per rotor.
    allocation: Vec<Vector4<f64>>,
    /// Static thrust at equidistant duties.
    map: Vec<f64>,
    position_integral: Vector3<f64>,
    attitude_integral: Vector3<f64>,
    last_yaw_rate: f64,
    step: f64,
}

impl Pilot {
    /// A pilot for the nominal vehicle.
    pub fn new(vehicle: &Vehicle, step: f64) -> Option<Self> {
        let effects: Vec<Vector4<f64>> = vehicle
            .rotors
            .iter()
            .map(|rotor| {
                let yaw = rotor.yaw_sign * rotor.moment_ratio;
                Vector4::new(1.0, -rotor.position.y, rotor.position.x, yaw)
            })
            .collect();
        // Least thrusts that give the wrench: Fᵀ (F Fᵀ)⁻¹.
        let gram: Matrix4<f64> = effects.iter().map(|effect| effect * effect.transpose()).sum();
        let inverse = gram.try_inverse()?;
        Some(Self {
            mass: vehicle.mass,
            gravity: vehicle.gravity,
            inertia: vehicle.inertia,
            allocation: effects.iter().map(|effect| inverse * effect).collect(),
            map: (0..=MAP_KNOTS)
                .map(|k| vehicle.static_thrust(k as f64 / MAP_KNOTS as f64, MAP_VOLTAGE))
                .collect(),
            position_integral: Vector3::zeros(),
            attitude_integral: Vector3::zeros(),
            last_yaw_rate: 0.0,
            step,
        })
    }

    /// Duty that gives a thrust at the assumed voltage.
    pub fn duty(&self, thrust: f64) -> f64 {
        let above = self.map.partition_point(|&knot| knot < thrust);
        if above == 0 {
            return 0.0;
        }
        if above > MAP_KNOTS {
            return 1.0;
        }
        let (low, high) = (self.map[above - 1], self.map[above]);
        (above as f64 - 1.0 + (thrust - low) / (high - low)) / MAP_KNOTS as f64
    }

    /// Duties for the next step.
    pub fn command(&mut self, seen: &Seen, reference: &Reference, duties: &mut [f64]) {
        let error = reference.position - seen.position;
        let limit = INTEGRAL_LIMIT[0];
        self.position_integral = (self.position_integral + self.step * error).map(|x| x.clamp(-limit, limit));
        let mut wanted = reference.acceleration
            + OUTER[0] * error
            + OUTER[1] * self.position_integral
            + OUTER[2] * (reference.velocity - seen.velocity);
        wanted.z = wanted.z.clamp(-CLIMB_LIMIT, DROP_LIMIT);
        // Thrust per mass along the body's up axis, NED.
        let mut up = wanted - Vector3::new(0.0, 0.0, self.gravity);
        let level = up.x.hypot(up.y);
        let most = -up.z * TILT_LIMIT.tan();
        if level > most {
            up.x *= most / level;
            up.y *= most / level;
        }
        let (sin_yaw, cos_yaw) = libm::sincos(seen.euler.z);
        let forward = cos_yaw * up.x + sin_yaw * up.y;
        let right = -sin_yaw * up.x + cos_yaw * up.y;
        let pitch = -libm::atan2(forward, -up.z);
        let roll = libm::asin((right / up.norm()).clamp(-1.0, 1.0));

        let turn = std::f64::consts::TAU;
        let yaw_error = reference.yaw - seen.euler.z;
        let yaw_error = yaw_error - turn * (yaw_error / turn).round();
        let attitude_error = Vector3::new(roll - seen.euler.x, pitch - seen.euler.y, yaw_error);
        let limit = INTEGRAL_LIMIT[1];
        self.attitude_integral.x = (self.attitude_integral.x + self.step * attitude_error.x).clamp(-limit, limit);
        self.attitude_integral.y = (self.attitude_integral.y + self.step * attitude_error.y).clamp(-limit, limit);
        self.attitude_integral.z = (self.attitude_integral.z + self.step * attitude_error.z).clamp(-1.0, 1.0);
        let yaw_forward = (reference.yaw_rate - self.last_yaw_rate) / self.step;
        self.last_yaw_rate = reference.yaw_rate;
        let angular = [
            INNER[0] * attitude_error.x + INNER[1] * self.attitude_integral.x - INNER[2] * seen.rates.x,
            INNER[0] * attitude_error.y + INNER[1] * self.attitude_integral.y - INNER[2] * seen.rates.y,
            yaw_forward
                + OUTER[0] * attitude_error.z
                + OUTER[1] * self.attitude_integral.z
                + OUTER[2] * (reference.yaw_rate - seen.rates.z),
        ];
        let thrust = self.mass * up.norm();
        let torque: [f64; 3] =
            std::array::from_fn(|k| self.inertia[k] * angular[k].clamp(-ANGULAR_LIMIT[k], ANGULAR_LIMIT[k]));
        let turning = |row: &Vector4<f64>| row[1] * torque[0] + row[2] * torque[1] + row[3] * torque[2];
        // Where a rotor cannot give both, the attitude goes first: a vehicle that cannot turn is lost.
        let most = self.map[MAP_KNOTS];
        let room = self.allocation.iter().map(|row| (most - turning(row)) / row[0]);
        let thrust = room.fold(thrust, f64::min);
        for (duty, row) in duties.iter_mut().zip(&self.allocation) {
            *duty = self.duty(row[0] * thrust + turning(row));
        }
    }
}
