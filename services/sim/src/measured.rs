//! Steps of a run's telemetry as input of a session of the detectors.

use rotortwin_fdi_session::{Chunk, Sample};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_store::own_detector::Seen;

/// Counts the steps of a run.
#[derive(Debug, Default)]
pub(crate) struct Measured {
    step: u64,
}

impl Measured {
    /// The next step.
    pub(crate) fn next(&mut self, seen: &Seen) -> Chunk {
        let narrow = |values: [f64; 3]| values.map(|value| value as f32);
        let mut duty = [0.0; MAX_ROTORS];
        for (to, from) in duty.iter_mut().zip(&seen.duty) {
            *to = *from as f32;
        }
        let chunk = Chunk {
            first_step: self.step,
            after_gap: true,
            samples: vec![Sample {
                // The detectors do not use it.
                position_ned_m: [0.0; 3],
                velocity_ned_m_s: narrow(seen.velocity_ned_m_s),
                attitude_rad: narrow(seen.attitude_rad),
                body_rates_rad_s: narrow(seen.body_rates_rad_s),
                duty,
                battery_voltage_v: seen.battery_voltage_v as f32,
                time_s: None,
            }],
        };
        self.step += 1;
        chunk
    }
}
