//! The kinematics of a pass: consistency of the sensors with each other, KV, KA and KP.

use std::sync::Arc;

use rotortwin_plant::Vector3;
use rotortwin_plant::effects::Constants;

use super::body::{Imu, Steps};
use super::{Plant, Prediction};
use crate::predict::channels::{CHANNELS, KA, KP, KV};
use crate::predict::series::{Kinematics, Vectors, shifted};
use crate::predict::vectors::{euler_rates, times};

/// A vector of the motion.
type Part = fn(&Kinematics) -> &Vectors;

impl Plant {
    /// KV, KA, KP; those with the inputs of `base` are reused if gravity is the same.
    pub(super) fn kinematics(
        &self,
        c: &Constants,
        motion: &Kinematics,
        (steps, imu): (&Steps, &Imu),
        base: Option<&Prediction>,
        channels: &mut [Arc<Vec<f64>>; CHANNELS],
    ) {
        let s = &self.series;
        let have = s.available;
        let step = s.step_s;
        let known = |parts: &[Part]| {
            base.is_some_and(|base| parts.iter().all(|part| Arc::ptr_eq(part(&base.motion), part(motion))))
        };
        let mut put = |first: usize, rate: &[Vector3], latency: f64, mean: bool| {
            let late;
            let rate = if latency == 0.0 {
                rate
            } else {
                late = shifted(rate, -latency, step);
                &late
            };
            for i in 0..3 {
                let column = (0..s.len)
                    .map(|k| {
                        let next = if mean { (k + 1).min(s.len - 1) } else { k };
                        0.5 * (rate[k][i] + rate[next][i])
                    })
                    .collect();
                channels[first + i] = Arc::new(column);
            }
        };
        let true_accel = imu.accel_error.is_none() && base.is_some_and(|base| !base.accel_errs);
        let from_accel = have.accel && true_accel && known(&[|m| &m.accel, |m| &m.velocity, |m| &m.attitude]);
        if have.velocity && have.attitude && !from_accel {
            let force = if have.accel {
                Some(motion.accel.as_slice())
            } else {
                steps.mean.as_deref()
            };
            if let Some(force) = force {
                let error = imu.accel_error.as_ref().filter(|_| have.accel);
                let rate: Vec<Vector3> = (0..s.len)
                    .map(|k| {
                        let r = motion.ned_from_body[k];
                        let mut f = force[k];
                        if let Some(error) = error {
                            f = [f[0] - error[k][0], f[1] - error[k][1], f[2] - error[k][2]];
                        }
                        let mut a = times(&r, f);
                        a[2] += c.gravity_m_s2;
                        a
                    })
                    .collect();
                // The model's force is a step mean already.
                put(KV, &rate, c.velocity_latency_s, have.accel);
            }
        }
        let of_attitude = have.attitude && have.rates && !known(&[|m| &m.attitude, |m| &m.rates]);
        if of_attitude {
            let rate: Vec<Vector3> = (0..s.len)
                .map(|k| euler_rates(&motion.ned_from_body[k], motion.rates[k]))
                .collect();
            put(KA, &rate, c.attitude_latency_s, true);
        }
        if have.position && have.velocity && !known(&[|m| &m.velocity, |m| &m.position]) {
            put(KP, &motion.velocity, c.position_latency_s, true);
        }
        if let (true, Some(error)) = (of_attitude, &imu.attitude_error_rate) {
            let late = shifted(error, -c.attitude_latency_s, step);
            for i in 0..3 {
                let column = Arc::make_mut(&mut channels[KA + i]);
                for (rate, more) in column.iter_mut().zip(&late) {
                    *rate += more[i];
                }
            }
        }
    }
}
