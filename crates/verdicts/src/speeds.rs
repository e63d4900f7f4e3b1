//! A log with measured rotor speeds but without duties or a battery voltage: the thrust follows from the speeds.
//!
//! ```text
//!  f_i = c Ω_i²      Σ_i ∫ f_i cos φ cos θ dt = m (g T − Δv_down)      c: over the first seconds in the air
//! ```
//! The detectors get the duties for which f_i is the static lift of the vehicle's map at one voltage, and rotors
//! without a lag: neither the battery nor the lag nor the shape of the thrust curve matters any more.
//!
//! What is lost: a motor that turns too slowly for its command is not detected, as its lower speed explains its lower
//! thrust. What is judged is a propeller's lift at its speed.

use rotortwin_flight_core::fdi::{FdiConfig, NominalThrust};
use rotortwin_plant::powertrain::battery::Battery;
use rotortwin_scenario::Detectors;
use rotortwin_twin::log::flight_parts::{FlightPart, FlightParts, PartKind};
use rotortwin_twin::log::{FlightLog, GAP_FACTOR, names};

/// Minimum and maximum time in the air used to estimate c, s.
const SHORTEST_S: f64 = 2.0;
const LONGEST_S: f64 = 10.0;
/// Slower telemetry misses the controller's changes of a rotor, Hz.
const SLOWEST_HZ: f64 = 20.0;
/// Smallest lag that the detectors accept, s: shorter than any of their steps.
const NO_LAG_S: f32 = 0.001;

/// The detectors' input for such a log.
pub(crate) struct BySpeed {
    /// With duties and a voltage that are equivalent to the speeds.
    pub(crate) log: FlightLog,
    /// The vehicle's, without a lag.
    pub(crate) config: FdiConfig,
    /// Sum of the thrusts over the sum of the squared speeds, N·s².
    pub(crate) lift_coefficient: f64,
}

impl BySpeed {
    /// For a log that has the speed of every rotor, and needs it.
    ///
    /// * `motion`: the log whose velocity and attitude the detectors use
    pub(crate) fn of(
        log: &FlightLog,
        motion: &FlightLog,
        config: &FdiConfig,
        parts: &FlightParts,
        detectors: &Detectors,
    ) -> Option<Self> {
        let rotor_count = detectors.vehicle().rotor_count();
        let speeds: Vec<&[f64]> = (1..=rotor_count)
            .map(|rotor| {
                let name = names::rotor_speed(rotor);
                let rate = log.source_rate(&name);
                if rate.is_some_and(|rate| rate.source_hz < SLOWEST_HZ) {
                    return None;
                }
                log.column(&name)
            })
            .collect::<Option<_>>()?;
        let lift_coefficient = lift_coefficient(log, motion, config, parts, &speeds)?;
        let voltage = Battery::new(&detectors.vehicle().vehicle.battery).open_circuit_voltage(1.0);
        let mut standing = motion.clone();
        for (rotor, speed) in speeds.iter().enumerate() {
            let duty = speed.iter().map(|speed| {
                let thrust = (lift_coefficient * speed * speed) as f32;
                // The map takes no NaN, and a row without a speed has no duty.
                if thrust.is_finite() {
                    f64::from(config.thrust_map.duty(thrust, voltage as f32))
                } else {
                    f64::NAN
                }
            });
            standing.columns.insert(names::duty(rotor + 1), duty.collect());
        }
        standing
            .columns
            .insert(names::BATTERY_VOLTAGE.to_owned(), vec![voltage; log.time_s.len()]);
        let mut config = *config;
        config.nominal_thrust = NominalThrust::Static;
        config.sequential.rotor_time_constant = NO_LAG_S;
        Some(Self {
            log: standing,
            config,
            lift_coefficient,
        })
    }
}

/// c of the first seconds in the air without a gap.
fn lift_coefficient(
    log: &FlightLog,
    motion: &FlightLog,
    config: &FdiConfig,
    parts: &FlightParts,
    speeds: &[&[f64]],
) -> Option<f64> {
    let in_air = |part: &&FlightPart| {
        matches!(part.kind, PartKind::Air | PartKind::Unknown) && part.end_s - part.start_s >= SHORTEST_S
    };
    let part = parts.parts.iter().find(in_air)?;
    let (down, roll, pitch) = (
        motion.column(names::VELOCITY[2])?,
        motion.column(names::ATTITUDE[0])?,
        motion.column(names::ATTITUDE[1])?,
    );
    let gap_s = GAP_FACTOR / log.sample_rate_hz();
    let (mut lifting, mut carried, mut taken_s) = (0.0, 0.0, 0.0);
    let rows = log.time_s.partition_point(|time| *time < part.start_s)..log.time_s.len();
    for row in rows.skip(1) {
        let step_s = log.time_s[row] - log.time_s[row - 1];
        if log.time_s[row] > part.end_s || taken_s >= LONGEST_S {
            break;
        }
        let squares: f64 = speeds.iter().map(|speed| speed[row] * speed[row]).sum();
        let pull = squares * roll[row].cos() * pitch[row].cos();
        let weight = f64::from(config.gravity) * step_s - (down[row] - down[row - 1]);
        if step_s > gap_s || !pull.is_finite() || !weight.is_finite() {
            continue;
        }
        lifting += pull * step_s;
        carried += f64::from(config.mass) * weight;
        taken_s += step_s;
    }
    (taken_s >= SHORTEST_S && lifting > 0.0 && carried > 0.0).then(|| carried / lifting)
}
