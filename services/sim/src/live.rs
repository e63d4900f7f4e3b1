//! Live samples of a flight.
//!
//! A sample is a telemetry row, taken at a fixed interval of simulated time, at most [`MOST_PER_S`] per second of wall clock: any excess is
//! dropped. The flight waits for no viewer, and sampling does not affect it.

use rotortwin_plant::STEP_NS;
use rotortwin_store::telemetry::{Column, Kind, TelemetryRow, telemetry_columns};
use rotortwin_wire::events::{LiveSample, RunEvent};
use std::time::{Duration, Instant};

/// Maximum samples per second of wall clock.
pub const MOST_PER_S: u32 = 100;
/// Allowed earliness of a sample: a real-time flight jitters.
const SLACK: Duration = Duration::from_millis(20);

/// Selects the rows to report.
pub struct LiveSampler {
    stride: u64,
    columns: Vec<Column>,
    numbers: Vec<f64>,
    next: Instant,
}

impl LiveSampler {
    /// `rate_hz` samples per second of simulated time.
    pub fn new(rate_hz: f64, rotor_count: usize) -> Self {
        let columns = telemetry_columns(rotor_count);
        Self {
            stride: (1e9 / STEP_NS as f64 / rate_hz).round().max(1.0) as u64,
            numbers: vec![0.0; columns.len()],
            columns,
            next: Instant::now(),
        }
    }

    /// The row as an event, if it is selected.
    pub fn sample(&mut self, row: &TelemetryRow, rotor_count: usize) -> Option<RunEvent> {
        if !row.step.is_multiple_of(self.stride) {
            return None;
        }
        let now = Instant::now();
        if now + SLACK < self.next {
            return None;
        }
        self.next = self.next.max(now) + Duration::from_secs(1) / MOST_PER_S;
        row.fill(rotor_count, &mut self.numbers);
        let values = self.columns.iter().zip(&self.numbers);
        Some(RunEvent::Sample(LiveSample {
            step: row.step,
            sim_time_s: row.sim_time_ns as f64 * 1e-9,
            values: values.map(|(column, value)| finite(column.kind, *value)).collect(),
        }))
    }
}

/// A value representable in JSON; for single precision the decimal number with the fewest digits.
fn finite(kind: Kind, value: f64) -> Option<f64> {
    if !value.is_finite() {
        return None;
    }
    match kind {
        Kind::F32 => (value as f32).to_string().parse().ok(),
        Kind::F64 | Kind::I32 | Kind::U64 => Some(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_fast_flight_is_sampled_at_the_rate_of_the_wall_clock() {
        let mut sampler = LiveSampler::new(100.0, 6);
        let begun = Instant::now();
        let mut taken = 0;
        for step in 0..40_000 {
            let row = TelemetryRow {
                step,
                ..TelemetryRow::default()
            };
            taken += u32::from(sampler.sample(&row, 6).is_some());
        }
        // However long it took: no more than the rate allows, plus the slack and one at the start.
        let most = (begun.elapsed() + SLACK).as_secs_f64() * f64::from(MOST_PER_S) + 2.0;
        assert!(taken >= 1 && f64::from(taken) <= most, "{taken} of at most {most}");
    }

    #[test]
    fn val_a_sample_is_the_row_in_the_order_of_the_schema() {
        let mut sampler = LiveSampler::new(400.0, 4);
        let row = TelemetryRow {
            step: 8,
            sim_time_ns: 20_000_000,
            specific_force_m_s2: [f32::NAN; 3],
            attitude_rad: [0.1, 0.0, 0.0],
            ..TelemetryRow::default()
        };
        let Some(RunEvent::Sample(sample)) = sampler.sample(&row, 4) else {
            panic!("it is taken");
        };
        let columns = telemetry_columns(4);
        let value = |name: &str| {
            sample.values[columns
                .iter()
                .position(|column| column.name == name)
                .expect("it is there")]
        };
        assert_eq!(value("roll_rad"), Some(0.1));
        assert_eq!(value("accel_x_m_s2"), None);
        assert_eq!((sample.step, value("step")), (8, Some(8.0)));
    }
}
