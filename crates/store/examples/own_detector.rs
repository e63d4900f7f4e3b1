//! A detector of one's own in Rust: `cargo run --release -p rotortwin-store --example own_detector -- runs/hover-1`.
//!
//! It names the rotor whose duty is furthest above the mean of all, once that has lasted for 0.2 s. In Python: docs/own-detector.md.

use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, NOT_READY};
use rotortwin_store::own_detector::{Detector, Seen, judge};
use std::path::PathBuf;
use std::process::ExitCode;

/// What a healthy rotor's duty differs from the mean of all, learnt in the first 5 s; then a rotor that needs more.
#[derive(Debug, Default)]
struct Duties {
    usual: Vec<f64>,
    steps: u32,
    smooth: Vec<f64>,
}

/// Steps of the calibration: 5 s at 400 Hz.
const CALIBRATION: u32 = 2000;
/// Time constant of the smoothing, steps: 0.2 s.
const SMOOTHING: f64 = 80.0;
/// Excess of duty from which a rotor is named, of 1.
const EXCESS: f64 = 0.01;

impl Detector for Duties {
    fn name(&self) -> &str {
        "duty excess"
    }

    fn begin(&mut self, rotor_count: usize) {
        *self = Self {
            usual: vec![0.0; rotor_count],
            steps: 0,
            smooth: vec![0.0; rotor_count],
        };
    }

    fn step(&mut self, seen: &Seen) -> i32 {
        let mean = seen.duty.iter().sum::<f64>() / seen.duty.len() as f64;
        self.steps += 1;
        if self.steps <= CALIBRATION {
            for (usual, duty) in self.usual.iter_mut().zip(&seen.duty) {
                *usual += (duty - mean) / f64::from(CALIBRATION);
            }
            return NOT_READY;
        }
        let mut named = (HEALTHY, EXCESS);
        for (rotor, duty) in seen.duty.iter().enumerate() {
            self.smooth[rotor] += (duty - mean - self.usual[rotor] - self.smooth[rotor]) / SMOOTHING;
            if self.smooth[rotor] > named.1 {
                named = (i32::try_from(rotor + 1).unwrap_or(HEALTHY), self.smooth[rotor]);
            }
        }
        named.0
    }
}

fn main() -> ExitCode {
    let Some(run) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("own_detector: expected a run folder");
        return ExitCode::from(2);
    };
    match judge(&run, &mut Duties::default()) {
        Ok(summary) => {
            for (interval, score) in summary.intervals.iter().zip(&summary.own_detectors[0].scores) {
                let share = score
                    .share_right
                    .map_or("–".to_owned(), |share| format!("{:.1} %", 100.0 * share));
                println!("{}: {share} of the windows right", interval.description);
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("own_detector: {error}");
            ExitCode::from(2)
        }
    }
}
