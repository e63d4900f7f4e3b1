//! Motor outputs that are logged too slowly for roll and pitch: what cannot be determined then, and the autopilot
//! setting that would help.
//!
//! PX4 and ArduPilot log their outputs at 10 Hz by default. Between two samples an attitude controller moves its motors
//! up and down again, so the torque to which the vehicle responded is not in the log: a fit then makes the vehicle too
//! sluggish, by any factor.

use super::filters::Band;
use crate::log::{FlightLog, SensorRate, SourceKind};

/// Samples of the outputs in a period of the fastest motion that roll and pitch are compared in.
const SAMPLES: f64 = 3.0;
/// Advice for a vehicle that does not fit its log, at the end of a note; with slow outputs it leads astray.
pub(super) const ADVICE: &str = ": check mass, arm, frame and the order of the outputs before all else";

/// Outputs that are too slow.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slow {
    hz: f64,
    /// What roll and pitch are compared up to, Hz.
    band_hz: f64,
    kind: SourceKind,
}

impl Slow {
    /// Those of a log, if they are too slow for the band that its rows are compared in ([`Band::of_torque`]).
    pub(super) fn of(log: &FlightLog, step_s: f64, fast: bool) -> Option<Self> {
        let rate = log.duty_rate().filter(SensorRate::is_slower)?;
        let slow = Self {
            hz: rate.source_hz,
            band_hz: Band::of_torque(step_s, fast).high_hz,
            kind: log.source.kind,
        };
        (slow.hz < SAMPLES * slow.band_hz).then_some(slow)
    }

    /// The slowest of the logs.
    pub(super) fn slowest(logs: impl Iterator<Item = Self>) -> Option<Self> {
        logs.min_by(|a, b| a.hz.total_cmp(&b.hz))
    }

    /// Puts this before all other notes, and removes those that blame something else instead.
    pub(super) fn tell(&self, notes: &mut Vec<String>) {
        for note in notes.iter_mut() {
            if let Some(fact) = note.strip_suffix(ADVICE) {
                *note = format!("{fact}: the motor outputs are too slow to tell");
            }
        }
        notes.insert(
            0,
            format!(
                "motor outputs come at {:.1} Hz, and motion of roll and pitch up to {:.0} Hz requires {:.0} Hz: inertia and motor lag cannot be known from this log, nor is an \
                 impossible value a sign of a wrong mass, arm, frame or order of the outputs; {}",
                self.hz,
                self.band_hz,
                SAMPLES * self.band_hz,
                self.kind.faster_outputs()
            ),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_slow_outputs_are_told_with_a_setting_and_blame_nothing_else() {
        let impossible =
            "inertia, roll: a radius of gyration of 2.21 arms, which is impossible; the class default is written";
        for (kind, word) in [
            (SourceKind::Px4Ulog, "SDLOG_PROFILE"),
            (SourceKind::ArdupilotDataflash, "RCOU"),
            (SourceKind::Csv, "as fast as the gyroscope"),
        ] {
            let mut notes = vec!["another".to_owned(), format!("{impossible}{ADVICE}")];
            let slow = Slow {
                hz: 10.0,
                band_hz: 10.0,
                kind,
            };
            slow.tell(&mut notes);
            assert!(notes[0].contains("10.0 Hz") && notes[0].contains("30 Hz"), "{notes:?}");
            assert!(notes[0].contains(word), "{notes:?}");
            assert_eq!(notes[1], "another");
            assert_eq!(
                notes[2],
                format!("{impossible}: the motor outputs are too slow to tell")
            );
        }
    }
}
