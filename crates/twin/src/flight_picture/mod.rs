//! A model-independent view of a flight: trajectory, parts and events, motor commands, vibration.
//!
//! Series are divided into at most [`BUCKETS`] buckets of equal numbers of rows; each has the mean of its values, and
//! motor outputs also the lowest and highest, so that no short saturation disappears. `null`: the bucket has no value.
//!
//! Frames: position north, east and up from where the log has its zero, m; attitude in degrees, ZYX. Nothing here depends on a model.

pub mod vibration;

use rotortwin_page::rounded;
use serde::Serialize;
use utoipa::ToSchema;

use crate::identify::known_rotor_places;
use crate::log::flight_parts::FlightParts;
use crate::log::{FlightLog, names};
use vibration::Vibration;

/// Buckets of a series, at most: as many as a screen shows.
pub const BUCKETS: usize = 800;

/// A flight over time.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct FlightPicture {
    /// Name of the log.
    pub name: String,
    /// First row, s.
    pub start_s: f64,
    /// Last row, s.
    pub end_s: f64,
    /// Time of the log's own clock at our 0 s, if it has one.
    pub clock_start_s: Option<f64>,
    /// Parts (on the ground, in the air, …) and events.
    pub parts: FlightParts,
    /// Middle of each bucket, s.
    pub time_s: Vec<f64>,
    /// North and east, m; absent if the log has no position.
    pub track: Option<Track>,
    /// Height above the zero of the log's position, or above the ground if the log has only that, m.
    pub height_m: Option<Vec<Option<f64>>>,
    /// Roll, pitch and yaw, degrees; yaw is unwrapped.
    pub attitude_deg: Option<[Vec<Option<f64>>; 3]>,
    /// Voltage at the battery's terminals, V.
    pub voltage_v: Option<Vec<Option<f64>>>,
    /// Command of each motor.
    pub outputs: Vec<MotorOutput>,
    /// Largest possible output, at which motors saturate.
    pub output_limit: f64,
    /// Spectra of accelerometer and gyroscope in the air; absent if the log has neither, or no flight.
    pub vibration: Option<Vibration>,
}

/// Track of the vehicle, from above.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Track {
    /// m.
    pub north_m: Vec<Option<f64>>,
    /// m.
    pub east_m: Vec<Option<f64>>,
}

/// Duty of one motor.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct MotorOutput {
    /// From 1, as in `duty_1`.
    pub output: usize,
    /// 1 is full.
    pub mean: Vec<Option<f64>>,
    /// Lowest sample.
    pub low: Vec<Option<f64>>,
    /// Highest sample.
    pub high: Vec<Option<f64>>,
}

impl FlightPicture {
    /// Draws a log.
    pub fn of(log: &FlightLog) -> Self {
        let places = known_rotor_places(log);
        let parts = log.flight_parts(places.as_deref());
        let cut = Cut::of(log.time_s.len());
        let means = |name: &str| log.column(name).map(|values| cut.means(values.iter().copied()));
        let scaled = |name: &str, by: f64| {
            log.column(name)
                .map(|values| cut.means(values.iter().map(|value| by * value)))
        };
        let attitude = match names::ATTITUDE.map(|name| log.column(name)) {
            [Some(roll), Some(pitch), Some(yaw)] => {
                let degrees = |values: &[f64]| cut.means(values.iter().map(|value| value.to_degrees()));
                Some([degrees(roll), degrees(pitch), degrees(&unwrapped(yaw))])
            }
            _ => None,
        };
        let track = means(names::POSITION[0])
            .zip(means(names::POSITION[1]))
            .map(|(north_m, east_m)| Track { north_m, east_m });
        let outputs: Vec<MotorOutput> = log
            .duties()
            .into_iter()
            .enumerate()
            .map(|(place, duty)| MotorOutput {
                output: place + 1,
                mean: cut.means(duty.iter().copied()),
                low: cut.extremes(duty, f64::min),
                high: cut.extremes(duty, f64::max),
            })
            .collect();
        Self {
            name: log.name.clone(),
            start_s: log.time_s.first().copied().unwrap_or(0.0),
            end_s: log.time_s.last().copied().unwrap_or(0.0),
            clock_start_s: log.report.clock_start_s,
            time_s: cut.middles(&log.time_s),
            track,
            height_m: scaled(names::POSITION[2], -1.0).or_else(|| means(names::HEIGHT_ABOVE_GROUND)),
            attitude_deg: attitude,
            voltage_v: means(names::BATTERY_VOLTAGE),
            output_limit: log.output_limit(),
            outputs,
            vibration: Vibration::of(log, &parts),
            parts,
        }
    }
}

/// Rows in buckets.
struct Cut {
    rows: usize,
}

impl Cut {
    fn of(rows: usize) -> Self {
        Self {
            rows: rows.div_ceil(BUCKETS).max(1),
        }
    }

    fn means(&self, values: impl IntoIterator<Item = f64>) -> Vec<Option<f64>> {
        let values: Vec<f64> = values.into_iter().collect();
        let mean = |bucket: &[f64]| {
            let known = bucket.iter().filter(|value| value.is_finite());
            rounded(known.clone().sum::<f64>() / known.count() as f64)
        };
        values.chunks(self.rows).map(mean).collect()
    }

    fn extremes(&self, values: &[f64], pick: fn(f64, f64) -> f64) -> Vec<Option<f64>> {
        let extreme = |bucket: &[f64]| {
            let known = bucket.iter().copied().filter(|value| value.is_finite());
            known.reduce(pick).and_then(rounded)
        };
        values.chunks(self.rows).map(extreme).collect()
    }

    fn middles(&self, time_s: &[f64]) -> Vec<f64> {
        let middle = |bucket: &[f64]| 0.5 * (bucket[0] + bucket[bucket.len() - 1]);
        time_s.chunks(self.rows).map(middle).collect()
    }
}

/// An angle without its jumps by a turn, rad.
fn unwrapped(angle: &[f64]) -> Vec<f64> {
    use std::f64::consts::{PI, TAU};
    let (mut turns, mut last) = (0.0, f64::NAN);
    angle
        .iter()
        .map(|&value| {
            if value.is_finite() {
                if value - last > PI {
                    turns -= TAU;
                } else if value - last < -PI {
                    turns += TAU;
                }
                last = value;
            }
            value + turns
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn prop_no_saturated_sample_disappears_in_a_bucket() {
        let mut duty: Vec<f64> = (0..40_000).map(|row| 0.5 + 0.001 * f64::from(row % 9)).collect();
        duty[12_345] = 1.0;
        duty[20_000] = f64::NAN;
        let cut = Cut::of(duty.len());
        let high = cut.extremes(&duty, f64::max);
        let mean = cut.means(duty.iter().copied());
        assert!(high.len() <= BUCKETS && high.len() == mean.len());
        assert_eq!(high[12_345 / cut.rows], Some(1.0));
        assert!(mean.iter().all(|mean| mean.is_some_and(|mean| mean < 0.53)));
    }

    #[test]
    fn val_a_heading_that_turns_goes_on_beyond_half_a_turn() {
        let turning: Vec<f64> = (0..100).map(|row| f64::from(row) * 0.1).collect();
        let logged: Vec<f64> = turning
            .iter()
            .map(|angle| (angle + PI).rem_euclid(2.0 * PI) - PI)
            .collect();
        for (angle, back) in turning.iter().zip(unwrapped(&logged)) {
            assert!((angle - back).abs() < 1e-9, "{angle} {back}");
        }
    }
}
