//! Low-pass filters that an autopilot applies to its inertial sensors before it logs them, as far as its parameters
//! state them.
//!
//! What is above the corner is missing from the log: vibration there is not absent, and a force there comes late and
//! small. Betaflight's and ArduPilot's accelerometer filters are second-order Butterworth sections
//! (`biquadFilterInitLPF`, `LowPassFilter2p`).

use super::{FlightLog, SourceKind};

/// Corner of a filter and the setting that states it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LowPass {
    /// −3 dB, Hz.
    pub(crate) corner_hz: f64,
    /// Parameter of the autopilot.
    pub(crate) setting: &'static str,
}

/// Parameters of a blackbox log, Hz; made from its header ([`sources`](super::sources)).
pub(crate) const BLACKBOX_ACCELEROMETER: &str = "acc_lpf_hz";
pub(crate) const BLACKBOX_GYRO: &str = "gyro_lowpass_hz";

/// Old releases of ArduPilot filter in the sensor itself, both kinds alike; 0 is the default.
const ARDUPILOT_IN_THE_SENSOR: &str = "INS_MPU6K_FILTER";

impl FlightLog {
    /// The filter of the accelerometer; `None` if none is stated.
    pub(crate) fn accelerometer_low_pass(&self) -> Option<LowPass> {
        self.low_pass("INS_ACCEL_FILTER", BLACKBOX_ACCELEROMETER)
    }

    /// The filter of the gyroscope.
    pub(crate) fn gyro_low_pass(&self) -> Option<LowPass> {
        self.low_pass("INS_GYRO_FILTER", BLACKBOX_GYRO)
    }

    fn low_pass(&self, ardupilot: &'static str, blackbox: &'static str) -> Option<LowPass> {
        let settings = match self.source.kind {
            SourceKind::ArdupilotDataflash | SourceKind::ArdupilotDataflashText => {
                [ardupilot, ARDUPILOT_IN_THE_SENSOR].to_vec()
            }
            SourceKind::Blackbox => [blackbox].to_vec(),
            _ => Vec::new(),
        };
        settings.into_iter().find_map(|setting| {
            let corner_hz = *self.parameters.get(setting)?;
            (corner_hz > 0.0).then_some(LowPass { corner_hz, setting })
        })
    }
}
