//! Spectra of the accelerometer and the gyroscope in the air, and the speeds at which the rotors turned.
//!
//! Amplitude spectral density by the method of Welch (1967): segments of about a second with half of each overlapping the next, without
//! their mean, under a Hann window; the mean of their periodograms. With values x of a segment of N samples at f_s, window w:
//!
//! ```text
//! S(f) = 2 |Σ w_k x_k exp(−2πi f k / f_s)|² / (f_s Σ w_k²)      density = √S, unit of x per √Hz
//! ```
//! White noise of deviation σ is flat at σ √(2/f_s); a vibration of amplitude A is a peak of area A²/2 under S.
//!
//! A log holds nothing above half of its rate, nor of that of a slower source; a rotor that turns faster shows at a mirrored frequency. A
//! damaged or unbalanced rotor shakes at its own speed.

use rotortwin_page::rounded;
use serde::Serialize;
use utoipa::ToSchema;

use crate::log::flight_parts::FlightParts;
use crate::log::{FlightLog, names};

/// Length of a segment, s.
const SEGMENT_S: f64 = 1.0;
/// Samples of a segment, at least and at most.
const SAMPLES: [usize; 2] = [64, 1024];
/// Segments, at most: those of a long flight are taken evenly over it.
const MOST_SEGMENTS: usize = 400;
/// Rows further apart than this many steps belong to different segments.
const BREAK_STEPS: f64 = 1.5;
/// Fewest samples of a rotor's speed from which it is determined.
const FEWEST_SPEEDS: usize = 50;

/// Vibration of a vehicle in the air.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Vibration {
    /// Frequencies of the spectra, Hz.
    pub frequency_hz: Vec<f64>,
    /// Specific force along body x, y, z: m/s² per √Hz; `null` above the bandwidth of its source.
    pub accelerometer: Option<[Vec<Option<f64>>; 3]>,
    /// Body rates p, q, r: rad/s per √Hz; `null` above the bandwidth of its source.
    pub gyroscope: Option<[Vec<Option<f64>>; 3]>,
    /// Speeds of the rotors, if the speed controllers report them.
    pub rotors: Vec<RotorSpeed>,
    /// Seconds of flight over which the spectra are averaged.
    pub seconds: f64,
    /// Limits of the spectra, one sentence each.
    pub notes: Vec<String>,
}

/// Revolutions per second of one rotor in the air.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct RotorSpeed {
    /// From 1.
    pub rotor: usize,
    /// 5th percentile, Hz.
    pub low_hz: f64,
    /// Median, Hz.
    pub median_hz: f64,
    /// 95th percentile, Hz.
    pub high_hz: f64,
}

impl Vibration {
    /// Of a log; `None` where it has neither sensor, or no second of flight without gaps.
    pub fn of(log: &FlightLog, parts: &FlightParts) -> Option<Self> {
        let rate_hz = log.sample_rate_hz();
        let length = segment_length(rate_hz)?;
        let air = parts.in_the_air();
        let starts = segments(&log.time_s, &air, length, 1.0 / rate_hz);
        let mut notes = Vec::new();
        let mut spectra = |title: &str, columns: [&str; 3]| {
            let values = log.vector(columns)?;
            let highest = values_hold(log, title, columns[0], rate_hz, &mut notes);
            let all = values.map(|values| density(values, &starts, length, rate_hz));
            let [Some(x), Some(y), Some(z)] = all else { return None };
            let cut = |density: Vec<f64>| -> Vec<Option<f64>> {
                let frequency = |bin: usize| bin as f64 * rate_hz / length as f64;
                (1..density.len())
                    .map(|bin| rounded(density[bin]).filter(|_| frequency(bin) <= highest))
                    .collect()
            };
            Some([cut(x), cut(y), cut(z)])
        };
        let accelerometer = spectra("accelerometer", names::ACCEL);
        let gyroscope = spectra("gyroscope", names::RATES);
        if accelerometer.is_none() && gyroscope.is_none() {
            return None;
        }
        let rotors = rotor_speeds(log, &air);
        if let Some(fastest) = rotors
            .iter()
            .map(|rotor| rotor.median_hz)
            .reduce(f64::max)
            .filter(|fastest| *fastest > 0.5 * rate_hz)
        {
            notes.push(format!(
                "The rotors turn with up to {fastest:.0} Hz and the log has {rate_hz:.0} rows per second: above {:.0} Hz it holds nothing, and what \
                 shakes faster shows at a mirrored frequency.",
                0.5 * rate_hz
            ));
        }
        if rotors.is_empty() {
            notes.push(
                "The log has no rotor speeds (telemetry of the speed controllers): which peak belongs to which rotor is not known.".to_owned(),
            );
        }
        Some(Self {
            frequency_hz: (1..=length / 2)
                .map(|bin| bin as f64 * rate_hz / length as f64)
                .collect(),
            accelerometer,
            gyroscope,
            rotors,
            seconds: covered(&starts, length) as f64 / rate_hz,
            notes,
        })
    }
}

/// Samples of a segment: a power of two of about [`SEGMENT_S`].
fn segment_length(rate_hz: f64) -> Option<usize> {
    let samples = (rate_hz * SEGMENT_S) as usize;
    (samples > 0).then(|| samples.next_power_of_two().clamp(SAMPLES[0], SAMPLES[1]))
}

/// Highest frequency that a sensor's columns hold, Hz; a sentence where that is less than half of the log's rate.
fn values_hold(log: &FlightLog, title: &str, column: &str, rate_hz: f64, notes: &mut Vec<String>) -> f64 {
    match log.source_rate(column).filter(|rate| rate.is_slower()) {
        Some(rate) => {
            let highest = 0.5 * rate.source_hz;
            notes.push(format!(
                "The {title} gave {:.0} values per second: its spectrum ends at {highest:.0} Hz.",
                rate.source_hz
            ));
            highest
        }
        None => 0.5 * rate_hz,
    }
}

/// First rows of the segments: in the air, without a gap, half overlapping.
fn segments(time_s: &[f64], air: &[(f64, f64)], length: usize, step_s: f64) -> Vec<usize> {
    let mut starts = Vec::new();
    for (from, to) in air {
        let (mut first, end) = (
            time_s.partition_point(|time| time < from),
            time_s.partition_point(|time| time <= to),
        );
        while first + length <= end {
            let rows = &time_s[first..first + length];
            match rows
                .windows(2)
                .rposition(|pair| pair[1] - pair[0] > BREAK_STEPS * step_s)
            {
                Some(gap) => first += gap + 1,
                None => {
                    starts.push(first);
                    first += length / 2;
                }
            }
        }
    }
    let keep = starts.len().div_ceil(MOST_SEGMENTS).max(1);
    starts.into_iter().step_by(keep).collect()
}

/// Rows in at least one segment.
fn covered(starts: &[usize], length: usize) -> usize {
    let mut end = 0;
    let mut rows = 0;
    for start in starts {
        rows += start + length - end.max(*start);
        end = start + length;
    }
    rows
}

/// √S at the frequencies from 0 to half of the rate; `None` without a segment that has all its values.
fn density(values: &[f64], starts: &[usize], length: usize, rate_hz: f64) -> Option<Vec<f64>> {
    let window: Vec<f64> = (0..length)
        .map(|k| 0.5 - 0.5 * (std::f64::consts::TAU * k as f64 / length as f64).cos())
        .collect();
    let energy: f64 = window.iter().map(|weight| weight * weight).sum();
    let (mut power, mut count) = (vec![0.0; length / 2 + 1], 0);
    for segment in starts.iter().map(|start| &values[*start..start + length]) {
        let mean = segment.iter().sum::<f64>() / length as f64;
        if !mean.is_finite() {
            continue;
        }
        let mut transform: Vec<[f64; 2]> = segment
            .iter()
            .zip(&window)
            .map(|(value, weight)| [weight * (value - mean), 0.0])
            .collect();
        fourier(&mut transform);
        for (power, [real, imaginary]) in power.iter_mut().zip(&transform) {
            *power += real * real + imaginary * imaginary;
        }
        count += 1;
    }
    (count > 0).then(|| {
        let scale = 2.0 / (rate_hz * energy * f64::from(count));
        power.into_iter().map(|power| (scale * power).sqrt()).collect()
    })
}

/// Discrete Fourier transform in place, of a power of two of complex values (Cooley and Tukey 1965).
fn fourier(values: &mut [[f64; 2]]) {
    let length = values.len();
    let bits = length.trailing_zeros();
    for place in 1..length {
        let other = place.reverse_bits() >> (usize::BITS - bits);
        if other > place {
            values.swap(place, other);
        }
    }
    let mut half = 1;
    while half < length {
        for first in 0..half {
            let (sine, cosine) = (-std::f64::consts::PI * first as f64 / half as f64).sin_cos();
            for place in (first..length).step_by(2 * half) {
                let [a, b] = values[place + half];
                let turned = [a * cosine - b * sine, a * sine + b * cosine];
                let [c, d] = values[place];
                values[place] = [c + turned[0], d + turned[1]];
                values[place + half] = [c - turned[0], d - turned[1]];
            }
        }
        half *= 2;
    }
}

/// The speed of each rotor in the air, if the log contains it.
fn rotor_speeds(log: &FlightLog, air: &[(f64, f64)]) -> Vec<RotorSpeed> {
    let flies = |time: f64| air.iter().any(|(from, to)| (*from..=*to).contains(&time));
    (1..=log.rotor_count())
        .filter_map(|rotor| {
            let speed = log.column(&names::rotor_speed(rotor))?;
            let mut turns: Vec<f64> = log
                .time_s
                .iter()
                .zip(speed)
                .filter(|(time, speed)| speed.is_finite() && **speed > 0.0 && flies(**time))
                .map(|(_, speed)| speed / std::f64::consts::TAU)
                .collect();
            turns.sort_by(f64::total_cmp);
            let at = |share: f64| turns[(share * (turns.len() - 1) as f64).round() as usize];
            (turns.len() >= FEWEST_SPEEDS).then(|| RotorSpeed {
                rotor,
                low_hz: at(0.05),
                median_hz: at(0.5),
                high_hz: at(0.95),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uniform numbers of variance 1.
    fn noise(count: usize) -> Vec<f64> {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            12_f64.sqrt() * ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
        };
        (0..count).map(|_| next()).collect()
    }

    #[test]
    fn val_a_vibration_in_white_noise_has_the_density_and_area_of_the_definition() {
        let (rate_hz, length, amplitude) = (400.0, 512, 3.0);
        let values: Vec<f64> = noise(40_000)
            .into_iter()
            .enumerate()
            .map(|(k, noise)| {
                9.81 + 0.2 * noise + amplitude * (std::f64::consts::TAU * 87.3 * k as f64 / rate_hz).sin()
            })
            .collect();
        let starts: Vec<usize> = (0..150).map(|k| k * length / 2).collect();
        let density = density(&values, &starts, length, rate_hz).expect("segments");
        let width = rate_hz / length as f64;
        let power = |from: f64, to: f64| -> f64 {
            density
                .iter()
                .enumerate()
                .filter(|(bin, _)| (from..to).contains(&(*bin as f64 * width)))
                .map(|(_, density)| density * density * width)
                .sum()
        };
        let peak = power(84.0, 91.0);
        assert!((peak / (0.5 * amplitude * amplitude) - 1.0).abs() < 0.02, "{peak}");
        let floor = (power(120.0, 190.0) / 70.0).sqrt();
        assert!((floor / (0.2 * (2.0 / rate_hz).sqrt()) - 1.0).abs() < 0.03, "{floor}");
        let highest = density
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .expect("bins");
        assert!((highest.0 as f64 * width - 87.3).abs() <= width);
    }

    #[test]
    fn val_the_transform_is_the_sum_that_defines_it() {
        let values = noise(64);
        let mut fast: Vec<[f64; 2]> = values.iter().map(|value| [*value, 0.0]).collect();
        fourier(&mut fast);
        for (bin, [real, imaginary]) in fast.iter().enumerate() {
            let angle = |k: usize| -std::f64::consts::TAU * (bin * k) as f64 / 64.0;
            let sum =
                |part: fn(f64) -> f64| -> f64 { values.iter().enumerate().map(|(k, x)| x * part(angle(k))).sum() };
            assert!((real - sum(f64::cos)).abs() < 1e-10 && (imaginary - sum(f64::sin)).abs() < 1e-10);
        }
    }

    #[test]
    fn prop_segments_are_in_the_air_and_without_gaps() {
        let step = 0.01;
        let time: Vec<f64> = (0..6000)
            .map(|row| step * f64::from(row) + if row >= 3100 { 2.0 } else { 0.0 })
            .collect();
        let starts = segments(&time, &[(5.0, 25.0), (28.0, 50.0)], 128, step);
        assert!(!starts.is_empty());
        for start in &starts {
            let (from, to) = (time[*start], time[start + 127]);
            assert!((to - from - 127.0 * step).abs() < 1e-9, "{from} {to}");
            assert!((5.0..=25.0).contains(&from) && to <= 25.0 || from >= 28.0 && to <= 50.0);
        }
        assert!(covered(&starts, 128) <= 4200);
    }
}
