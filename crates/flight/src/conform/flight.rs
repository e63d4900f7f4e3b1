//! A short flight with the controller under test: does it hold position, follow, turn?

use super::probe::{Prober, Trouble};
use super::response::wrap;
use rotortwin_plant::Simulation;

/// Length of a leg, s.
const LEG_S: f64 = 4.0;
/// Rate of the reference yaw while it turns, rad/s.
const TURN_RATE_RAD_S: f64 = 0.4;
/// Final reference yaw, rad.
const TURN_RAD: f64 = 1.2;
/// Largest distance from the reference at the end of a leg, m.
const NEAR_M: f64 = 0.25;
/// Largest yaw error at the end of a leg, rad.
const NEAR_RAD: f64 = 0.3;
/// Limits beyond which the flight is over, m and rad.
const LOST_M: f64 = 3.0;
const LOST_RAD: f64 = 1.05;

/// Legs: name, and the reference at the end, m from the first point.
const LEGS: [(&str, [f64; 3]); 5] = [
    ("hover", [0.0, 0.0, 0.0]),
    ("step of 0.5 m north", [0.5, 0.0, 0.0]),
    ("step of 0.3 m up", [0.5, 0.0, -0.3]),
    ("turn to 69° of yaw", [0.5, 0.0, -0.3]),
    ("step of 0.5 m east, turned", [0.5, 0.5, -0.3]),
];
const TURNING: usize = 3;

/// Maximum number of steps of the flight.
pub(super) const STEPS: u64 = (LEGS.len() as f64 * LEG_S * 400.0) as u64;

/// Result of the flight.
pub(super) struct Outcome {
    pub(super) flown: bool,
    /// One clause.
    pub(super) evidence: String,
}

/// Flies `simulation`, which begins in trimmed hover.
pub(super) fn fly(prober: &mut Prober<'_>, simulation: &mut Simulation) -> Result<Outcome, Trouble> {
    let start = simulation.truth().position_ned_m;
    let leg_steps = (LEG_S * 400.0) as u64;
    let mut farthest = 0.0_f64;
    for step in 0..STEPS {
        let leg = (step / leg_steps) as usize;
        let into_s = (step % leg_steps) as f64 / 400.0;
        let (name, offset) = LEGS[leg];
        let wanted: [f64; 3] = std::array::from_fn(|i| start[i] + offset[i]);
        let yaw = match leg.cmp(&TURNING) {
            std::cmp::Ordering::Less => 0.0,
            std::cmp::Ordering::Equal => (TURN_RATE_RAD_S * into_s).min(TURN_RAD),
            std::cmp::Ordering::Greater => TURN_RAD,
        };
        let sensed = simulation.sense();
        let mut frame = prober.frame(&sensed.nav, sensed.battery_voltage);
        frame.reference_position_ned_m = wanted.map(|x| x as f32);
        frame.reference_yaw_rad = yaw as f32;
        let command = prober.exchange(frame)?;
        simulation
            .advance(&command.command())
            .map_err(|error| Trouble::Plant(error.to_string()))?;
        let truth = simulation.truth();
        let away = (0..3)
            .map(|i| (truth.position_ned_m[i] - wanted[i]).powi(2))
            .sum::<f64>()
            .sqrt();
        let tilt = (truth.attitude_rad[0].cos() * truth.attitude_rad[1].cos())
            .clamp(-1.0, 1.0)
            .acos();
        let turned = wrap(truth.attitude_rad[2] - yaw).abs();
        let time_s = (step + 1) as f64 / 400.0;
        let leg_ends = (step + 1) % leg_steps == 0;
        if away > LOST_M || tilt > LOST_RAD || (leg_ends && (away > NEAR_M || turned > NEAR_RAD)) {
            return Ok(Outcome {
                flown: false,
                evidence: format!(
                    "{name}: after {time_s:.2} s of flight {away:.2} m from the reference, tilted {:.0}°, yaw {:.0}° off",
                    tilt.to_degrees(),
                    turned.to_degrees()
                ),
            });
        }
        if leg_ends {
            farthest = farthest.max(away);
        }
    }
    Ok(Outcome {
        flown: true,
        evidence: format!(
            "{:.0} s: hover, steps north, up and east, a turn of 69°; at most {farthest:.2} m from the reference at the end of each",
            LEGS.len() as f64 * LEG_S
        ),
    })
}
