//! A log without velocity or attitude: the specific force along the rotors' axis takes the place of the momentum.
//!
//! Detectors compare the momentum along z_b with gravity and rotors, ṗ_z = F_z + m g_z + m (q v_x − p v_y). An
//! accelerometer in the vehicle measures a_z = F_z/m regardless of the vehicle's attitude and motion. So the detectors
//! are given a vehicle that stays level and moves along its own axis only,
//!
//! ```text
//!  ẇ = a_z + g − w/T     ⟺     m ẇ = F_z + m g − (m/T) w
//! ```
//!
//! with w as the downward velocity and m/T as the drag. w decays with T, so that a lasting turn does not make it
//! diverge. It is integrated at the log's own rate: vibration faster than the steps of the detectors does not alias
//! into w as it would into a_z. Torques need only the rates.
//!
//! What is lost: the drag along that axis, which is not a function of w. It counts as unknown, with the model's own
//! drag as its spread. Drag across it does not act along it. An offset of the accelerometer is a bias, like that of a
//! rotor.
//!
//! Limits: a sensor away from the centre of mass measures angular accelerations too, which count as gusts. There is no
//! tilt: upsets are known only as far as the parts of the flight show them, and from the body rates.

use rotortwin_flight_core::fdi::FdiConfig;
use rotortwin_twin::Z95;
use rotortwin_twin::log::{FlightLog, ImportReport, names};
use std::collections::BTreeMap;

/// T, s: slow compared with everything that is judged, and short enough for w to stay a velocity.
const FORGETS_S: f64 = 20.0;
/// Rows farther apart are not integrated over, s; the session treats longer gaps as such.
const LONGEST_STEP_S: f64 = 0.25;

/// The detectors' input for such a log.
pub(crate) struct Axial {
    /// The log with w as its downward velocity, and level.
    pub(crate) log: FlightLog,
    /// The vehicle's, with the drag of w and the uncertainty of its own drag.
    pub(crate) config: FdiConfig,
    /// Half the width of the 95 % interval of the drag along the axis, N·s/m.
    pub(crate) drag: f32,
}

impl Axial {
    /// T of the model's w, 1/s.
    pub(crate) const LEAK: f64 = 1.0 / FORGETS_S;

    /// For a log that has body rates and an accelerometer.
    pub(crate) fn of(log: &FlightLog, config: &FdiConfig) -> Option<Self> {
        let force = log.column(names::ACCEL[2])?;
        let down = speed_down(&log.time_s, force, f64::from(config.gravity));
        let still: Vec<f64> = down.iter().map(|w| if w.is_nan() { f64::NAN } else { 0.0 }).collect();
        // Nothing else of the log is used.
        let is_kept = |name: &str| {
            names::RATES.contains(&name) || name == names::BATTERY_VOLTAGE || names::duty_rotor(name).is_some()
        };
        let kept = log.columns.iter().filter(|(name, _)| is_kept(name));
        let mut columns: BTreeMap<String, Vec<f64>> =
            kept.map(|(name, values)| (name.clone(), values.clone())).collect();
        for name in names::VELOCITY[..2].iter().chain(&names::ATTITUDE) {
            columns.insert((*name).to_owned(), still.clone());
        }
        columns.insert(names::VELOCITY[2].to_owned(), down);
        let level = rows_of(log, columns);
        let mut config = *config;
        let unknown = config.sequential.drag_spread.hypot(config.linear_drag / config.mass);
        config.sequential.drag_spread = unknown;
        config.linear_drag = config.mass * Self::LEAK as f32;
        Some(Self {
            log: level,
            config,
            drag: Z95 as f32 * unknown * config.mass,
        })
    }
}

/// These columns on the rows of a log, and nothing else of it.
pub(crate) fn rows_of(log: &FlightLog, columns: BTreeMap<String, Vec<f64>>) -> FlightLog {
    FlightLog {
        name: log.name.clone(),
        source: log.source.clone(),
        time_s: log.time_s.clone(),
        columns,
        segments: Vec::new(),
        vehicle: None,
        origin: None,
        licence: None,
        parameters: BTreeMap::new(),
        report: ImportReport::default(),
    }
}

/// w by the trapezoidal rule, m/s; nothing where nothing was measured.
///
/// * `force`: along z_b, m/s²; −g in hover
fn speed_down(time_s: &[f64], force: &[f64], gravity: f64) -> Vec<f64> {
    let mut speed = 0.0;
    let mut before: Option<(f64, f64)> = None;
    time_s
        .iter()
        .zip(force)
        .map(|(time, force)| {
            if force.is_nan() {
                return f64::NAN;
            }
            let rate = force + gravity;
            if let Some((last, rate_before)) = before {
                let step = time - last;
                if step > LONGEST_STEP_S {
                    speed = 0.0;
                } else {
                    // Implicit in w, so that no step is too long.
                    let half = 0.5 * step * Axial::LEAK;
                    speed = ((1.0 - half) * speed + 0.5 * step * (rate + rate_before)) / (1.0 + half);
                }
            }
            before = Some((*time, rate));
            speed
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_speed_is_what_the_force_makes_of_it_and_forgets() {
        // ẇ = a − w/T has the solution a T (1 − e^(−t/T)).
        let time_s: Vec<f64> = (0..8000).map(|k| 0.0025 * f64::from(k)).collect();
        let speed = speed_down(&time_s, &vec![-9.81 + 2.0; time_s.len()], 9.81);
        for row in [400, 4000, 7999] {
            let wanted = 2.0 * FORGETS_S * (1.0 - (-time_s[row] / FORGETS_S).exp());
            assert!(
                (speed[row] - wanted).abs() < 1e-4 * wanted,
                "{row}: {} {wanted}",
                speed[row]
            );
        }
        let mut gap = time_s.clone();
        gap[4000..].iter_mut().for_each(|time| *time += 1.0);
        let mut force = vec![-9.81 + 2.0; gap.len()];
        force[100] = f64::NAN;
        let speed = speed_down(&gap, &force, 9.81);
        assert!(speed[100].is_nan() && speed[101].is_finite() && speed[4000] == 0.0);
    }
}
