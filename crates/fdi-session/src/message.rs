//! Chunks and answers as the messages of `proto/rotortwin/v1/fdi_service.proto`.
//!
//! Shapes (lengths of lists) are checked here, numbers by the session.

use crate::session::{Answer, Calibration, Chunk, LONGEST_CHUNK, Refusal, Sample, Window};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_proto::{FdiCalibration, FdiMeasurements, FdiVerdicts, FdiWindow};
use rotortwin_wire::convert::ConvertError;

impl Chunk {
    /// From a message for a vehicle of `rotor_count` rotors.
    ///
    /// # Errors
    /// A list does not have the length that goes with `battery_voltage_v`.
    pub fn from_message(message: &FdiMeasurements, rotor_count: usize) -> Result<Self, ConvertError> {
        let count = message.battery_voltage_v.len();
        if count > LONGEST_CHUNK {
            return Err(length(
                "FdiMeasurements.battery_voltage_v",
                count,
                LONGEST_CHUNK,
                "at most",
            ));
        }
        let lists = [
            ("FdiMeasurements.position_ned_m", message.position_ned_m.len(), 3),
            ("FdiMeasurements.velocity_ned_m_s", message.velocity_ned_m_s.len(), 3),
            ("FdiMeasurements.attitude_rad", message.attitude_rad.len(), 3),
            ("FdiMeasurements.body_rates_rad_s", message.body_rates_rad_s.len(), 3),
            ("FdiMeasurements.duty", message.duty.len(), rotor_count),
        ];
        for (field, found, each) in lists {
            if found != each * count {
                return Err(length(field, found, each * count, "for that many voltages"));
            }
        }
        let timed = !message.time_s.is_empty();
        if timed && message.time_s.len() != count {
            return Err(length("FdiMeasurements.time_s", message.time_s.len(), count, "or 0"));
        }
        let three = |values: &[f32], index: usize| [values[3 * index], values[3 * index + 1], values[3 * index + 2]];
        let sample = |index: usize| {
            let mut duty = [0.0; MAX_ROTORS];
            duty[..rotor_count].copy_from_slice(&message.duty[rotor_count * index..rotor_count * (index + 1)]);
            Sample {
                position_ned_m: three(&message.position_ned_m, index),
                velocity_ned_m_s: three(&message.velocity_ned_m_s, index),
                attitude_rad: three(&message.attitude_rad, index),
                body_rates_rad_s: three(&message.body_rates_rad_s, index),
                duty,
                battery_voltage_v: message.battery_voltage_v[index],
                time_s: message.time_s.get(index).copied(),
            }
        };
        Ok(Self {
            first_step: message.first_step,
            after_gap: message.after_gap,
            samples: (0..count).map(sample).collect(),
        })
    }

    /// The message of a vehicle of `rotor_count` rotors; without times if one of them is missing.
    pub fn to_message(&self, rotor_count: usize) -> FdiMeasurements {
        let flat = |part: fn(&Sample) -> &[f32; 3]| -> Vec<f32> {
            self.samples.iter().flat_map(|sample| *part(sample)).collect()
        };
        let duties = self.samples.iter().flat_map(|sample| &sample.duty[..rotor_count]);
        FdiMeasurements {
            first_step: self.first_step,
            after_gap: self.after_gap,
            position_ned_m: flat(|sample| &sample.position_ned_m),
            velocity_ned_m_s: flat(|sample| &sample.velocity_ned_m_s),
            attitude_rad: flat(|sample| &sample.attitude_rad),
            body_rates_rad_s: flat(|sample| &sample.body_rates_rad_s),
            duty: duties.copied().collect(),
            battery_voltage_v: self.samples.iter().map(|sample| sample.battery_voltage_v).collect(),
            time_s: self
                .samples
                .iter()
                .map(|sample| sample.time_s)
                .collect::<Option<_>>()
                .unwrap_or_default(),
        }
    }
}

fn length(field: &'static str, found: usize, expected: usize, words: &str) -> ConvertError {
    ConvertError::Length {
        field,
        found,
        expected: format!("{expected} {words}"),
    }
}

impl From<Calibration> for FdiCalibration {
    fn from(calibration: Calibration) -> Self {
        match calibration {
            Calibration::Noise => Self::Noise,
            Calibration::Disturbances => Self::Disturbances,
            Calibration::Done => Self::Done,
        }
    }
}

impl Window {
    fn to_message(&self, rotor_count: usize) -> FdiWindow {
        FdiWindow {
            report: Some(self.report.to_proto(rotor_count)),
            class_probability: self.class_probability.clone(),
            calibration: FdiCalibration::from(self.calibration).into(),
        }
    }
}

impl Answer {
    /// The message of a vehicle of `rotor_count` rotors.
    pub fn to_message(&self, rotor_count: usize) -> FdiVerdicts {
        FdiVerdicts {
            first_step: self.first_step,
            next_step: self.next_step,
            windows: self
                .windows
                .iter()
                .map(|window| window.to_message(rotor_count))
                .collect(),
            notes: self.notes.clone(),
            refusal: String::new(),
        }
    }
}

/// The message of a refusal.
///
/// * `next_step`: the step that is expected next
pub fn refusal_message(first_step: u64, next_step: u64, refusal: &dyn std::fmt::Display) -> FdiVerdicts {
    FdiVerdicts {
        first_step,
        next_step,
        refusal: refusal.to_string(),
        ..FdiVerdicts::default()
    }
}

/// Why a message is rejected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MessageRefusal {
    /// It has a wrong shape.
    #[error(transparent)]
    Shape(#[from] ConvertError),
    /// The session refuses it.
    #[error(transparent)]
    Session(#[from] Refusal),
}
