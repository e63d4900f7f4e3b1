//! The motion of a pass: the vehicle's motion from readings with latencies and errors removed.

use std::sync::Arc;

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::Vector3;
use rotortwin_plant::effects::{EffectSet, Hooks, Moment, Readings};

use super::{Plant, Source, When, sensors_may_err};
use crate::predict::series::{Drive, Kinematics, Vectors, shifted};
use crate::predict::vectors::rotation;

/// Maximum number of fixed-point steps to invert an effect's arbitrary change of the readings, and the change below
/// which it has converged.
const FIXED_POINT_STEPS: usize = 12;
const FIXED: f64 = 1e-9;

/// Sets a sample; the vector stays shared until the first one that differs.
fn set(shared: &mut Vectors, k: usize, value: Vector3) {
    if shared[k] != value {
        Arc::make_mut(shared)[k] = value;
    }
}

/// True if no reading is another one by more than nothing.
fn is_near(a: &Readings, b: &Readings) -> bool {
    let near = |a: Vector3, b: Vector3| (0..3).all(|i| (a[i] - b[i]).abs() < FIXED);
    near(a.position_ned, b.position_ned)
        && near(a.velocity_ned, b.velocity_ned)
        && near(a.attitude, b.attitude)
        && near(a.body_rates, b.body_rates)
        && near(a.specific_force, b.specific_force)
}

impl Plant {
    /// The true motion behind the readings: latencies undone, sensor errors inverted; except those of the
    /// accelerometer, which [`Self::imu`] computes if there is a model's force.
    pub(super) fn motion(&self, effects: &EffectSet, source: Source) -> Kinematics {
        let measured = match source {
            Source::Raw => self.series.whole(),
            Source::Smooth => &self.series.smooth,
        };
        let c = effects.constants();
        let at = |x: &Vectors, latency: f64| self.undelayed(x, latency);
        let mut motion = Kinematics {
            position: at(&measured.position, c.position_latency_s),
            velocity: at(&measured.velocity, c.velocity_latency_s),
            attitude: at(&measured.attitude, c.attitude_latency_s),
            rates: at(&measured.rates, c.imu_latency_s),
            angular_acceleration: at(&measured.angular_acceleration, c.imu_latency_s),
            accel: at(&measured.accel, c.imu_latency_s),
            // The noise of a reading must not re-enter through its own prediction: a load that pulls with its mass
            // times the accelerometer's reading would add its share of the noise, and lose to any rival that does not.
            driving_accel: at(&self.series.smooth.driving_accel, c.imu_latency_s),
            observed_rates: at(&self.series.whole().rates, c.imu_latency_s),
            ned_from_body: Vec::new().into(),
        };
        let turned = |attitude: &Vectors| {
            if Arc::ptr_eq(attitude, &measured.attitude) {
                Arc::clone(&measured.ned_from_body)
            } else {
                Arc::new(attitude.iter().map(|&attitude| rotation(attitude)).collect())
            }
        };
        motion.ned_from_body = turned(&motion.attitude);
        if sensors_may_err(effects) {
            self.undo_errors(effects.clone(), &mut motion);
            motion.ned_from_body = turned(&motion.attitude);
        }
        motion
    }

    /// Takes the errors of the sensors off the readings.
    fn undo_errors(&self, mut effects: EffectSet, motion: &mut Kinematics) {
        let mut c = *effects.constants();
        let nothing = [0.0; MAX_ROTORS];
        let n = self.series.rotors;
        let turning = self.undelayed(&self.series.smooth.angular_acceleration, c.imu_latency_s);
        for k in 0..self.series.len {
            if effects.begin(self.series.time(k)) {
                c = *effects.constants();
            }
            let read = Readings {
                position_ned: motion.position[k],
                velocity_ned: motion.velocity[k],
                attitude: motion.attitude[k],
                body_rates: motion.rates[k],
                specific_force: motion.driving_accel[k],
                battery_voltage: 0.0,
            };
            let mut truth = read;
            if effects.hooks().uses(Hooks::READINGS) {
                let still = self.moment(When::Sample(k), motion, &c, &nothing[..n], &nothing[..n], &nothing[..n]);
                for _ in 0..FIXED_POINT_STEPS {
                    let before = truth;
                    let mut again = truth;
                    c.corrupt(&mut again, turning[k]);
                    // The rotors' thrust comes later in the chain; the specific force gives their sum.
                    let each = (-c.mass_kg * truth.specific_force[2] / n as f64).max(0.0);
                    let thrust = [each; MAX_ROTORS];
                    let at = Moment {
                        rotor_thrust: &thrust[..n],
                        ..still
                    };
                    effects.readings(&at, &mut again);
                    for i in 0..3 {
                        truth.position_ned[i] += read.position_ned[i] - again.position_ned[i];
                        truth.velocity_ned[i] += read.velocity_ned[i] - again.velocity_ned[i];
                        truth.attitude[i] += read.attitude[i] - again.attitude[i];
                        truth.body_rates[i] += read.body_rates[i] - again.body_rates[i];
                        truth.specific_force[i] += read.specific_force[i] - again.specific_force[i];
                    }
                    if is_near(&before, &truth) {
                        break;
                    }
                }
            } else {
                c.restore(&mut truth, turning[k]);
            }
            let too_much = |observed: Vector3, read: Vector3, truth: Vector3| {
                [0, 1, 2].map(|i| observed[i] + (truth[i] - read[i]))
            };
            let observed = too_much(motion.observed_rates[k], read.body_rates, truth.body_rates);
            if self.series.drive == Drive::None {
                // Without a model's force; with one, `imu` computes the accelerometer's errors.
                let accel = too_much(motion.accel[k], read.specific_force, truth.specific_force);
                set(&mut motion.accel, k, accel);
            }
            set(&mut motion.position, k, truth.position_ned);
            set(&mut motion.velocity, k, truth.velocity_ned);
            set(&mut motion.attitude, k, truth.attitude);
            set(&mut motion.rates, k, truth.body_rates);
            set(&mut motion.observed_rates, k, observed);
            set(&mut motion.driving_accel, k, truth.specific_force);
        }
    }

    /// A signal that is read late, at its own times.
    fn undelayed(&self, x: &Vectors, latency_s: f64) -> Vectors {
        if latency_s == 0.0 {
            Arc::clone(x)
        } else {
            Arc::new(shifted(x, latency_s, self.series.step_s))
        }
    }
}
