//! Battery voltage of a log without one, estimated from its duties.
//!
//! ```text
//!  V = (V_oc(SoC) + √(V_oc² − 4 R P))/2     P = k_P Σ f^1.5     dSoC/dt = −P/(V Q)     f: Eq. 19 of duty and V
//! ```
//! Parameters are those of the vehicle's battery. The initial charge is the one at which the thrust carries the weight in the first
//! seconds in the air:
//!
//! ```text
//!  ∫ F_z cos φ cos θ dt = m (g T − Δv_down)
//! ```
//! Limits: anything else that changes the thrust of all rotors equally in these seconds (mass, air density, earlier damage) is
//! attributed to the voltage; drag and rotor lag are neglected. After them the voltage is a prediction, wrong for a different battery.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::FdiConfig;
use rotortwin_plant::powertrain::battery::Battery;
use rotortwin_scenario::Detectors;
use rotortwin_twin::log::flight_parts::{FlightPart, FlightParts, PartKind};
use rotortwin_twin::log::running_mean;
use rotortwin_twin::log::{FlightLog, names};

/// Minimum and maximum airborne time used to estimate the charge, s.
const SHORTEST_S: f64 = 2.0;
const LONGEST_S: f64 = 10.0;
/// Averaging time of a measured voltage, s: 20 samples of the slowest common telemetry.
const MEAN_S: f64 = 10.0;
/// Search interval of the initial charge: an empty battery gives no thrust.
const CHARGES: (f64, f64) = (0.01, 1.0);
/// Number of bisections of that interval.
const HALVINGS: usize = 40;

/// One airborne step.
struct Step {
    duty: [f32; MAX_ROTORS],
    /// cos φ cos θ.
    upright: f64,
}

/// A battery discharged by the duties of a log.
#[derive(Clone)]
pub(crate) struct WorkedOutVoltage {
    battery: Battery,
    config: FdiConfig,
    rotor_count: usize,
    /// Of the steps, Hz.
    rate_hz: f64,
    state_of_charge: f64,
    voltage: f64,
    /// Initial state, and the airborne time used to estimate it, s since the log's first row.
    pub(crate) begin: Begin,
}

/// Initial state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Begin {
    pub(crate) state_of_charge: f64,
    /// Mean over that time, V.
    pub(crate) voltage_v: f64,
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
}

impl WorkedOutVoltage {
    /// Estimates the initial charge.
    ///
    /// * `parts`: of the flight   * `rate_hz`: of the requested steps
    /// * `leak`: decay rate of the downward velocity, 1/s; 0 for a measured one
    ///
    /// # Errors
    /// Half a sentence: why it cannot be found.
    pub(crate) fn of(
        log: &FlightLog,
        parts: &FlightParts,
        detectors: &Detectors,
        rate_hz: f64,
        leak: f64,
    ) -> Result<Self, String> {
        let rotor_count = detectors.vehicle().rotor_count();
        let (from_s, steps, sinking) = first_seconds(log, parts, rotor_count, rate_hz, leak)?;
        let duration_s = (steps.len() - 1) as f64 / rate_hz;
        let config = *detectors.config();
        let impulse = f64::from(config.mass) * (f64::from(config.gravity) * duration_s - sinking);
        let begun = |state_of_charge: f64| Self {
            battery: Battery::new(&detectors.vehicle().vehicle.battery),
            config,
            rotor_count,
            rate_hz,
            state_of_charge,
            voltage: 0.0,
            begin: Begin::default(),
        };
        // Impulse of the thrust at a charge relative to what carried the vehicle, and the mean voltage.
        let carried = |state_of_charge: f64| {
            let mut battery = begun(state_of_charge);
            let (mut sum, mut voltage) = (0.0, 0.0);
            for step in &steps[1..] {
                voltage += battery.step(&step.duty);
                sum += battery.force(&step.duty) * step.upright / rate_hz;
            }
            (sum / impulse, voltage / (steps.len() - 1) as f64)
        };
        let (mut low, mut high) = CHARGES;
        let (least, most) = (carried(low).0, carried(high).0);
        let words = "of the weight in the first seconds in the air: the log is of another vehicle, or it was not flying yet (LOG@a:b takes a part of the log)";
        if most < 1.0 {
            return Err(format!("a full battery would carry {:.0} % {words}", 100.0 * most));
        }
        if least > 1.0 {
            return Err(format!("an empty battery would carry {:.0} % {words}", 100.0 * least));
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if carried(middle).0 < 1.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        let state_of_charge = 0.5 * (low + high);
        Ok(Self {
            begin: Begin {
                state_of_charge,
                voltage_v: carried(state_of_charge).1,
                from_s,
                to_s: from_s + duration_s,
            },
            ..begun(state_of_charge)
        })
    }

    /// Last voltage at the terminals, V.
    pub(crate) fn now(&self) -> f32 {
        let begun = self.voltage > 0.0;
        (if begun { self.voltage } else { self.begin.voltage_v }) as f32
    }

    /// Voltage at the terminals, V, with these duties applied for one step.
    pub(crate) fn step(&mut self, duty: &[f32; MAX_ROTORS]) -> f64 {
        // The very first step has no previous voltage.
        let before = if self.voltage > 0.0 {
            self.voltage
        } else {
            self.battery.open_circuit_voltage(self.state_of_charge)
        };
        let power = self.battery.power_coefficient()
            * self
                .thrusts(duty, before)
                .iter()
                .map(|f| f64::from(*f).powf(1.5))
                .sum::<f64>();
        let output = self.battery.output(self.state_of_charge, power);
        self.voltage = output.battery_voltage;
        let charge = self.state_of_charge + self.battery.charge_rate(output.battery_current) / self.rate_hz;
        self.state_of_charge = charge.max(0.0);
        self.voltage
    }

    fn thrusts(&self, duty: &[f32; MAX_ROTORS], voltage: f64) -> [f32; MAX_ROTORS] {
        let mut thrust = [0.0; MAX_ROTORS];
        for (thrust, duty) in thrust.iter_mut().zip(duty).take(self.rotor_count) {
            *thrust = self.config.thrust_map.thrust(*duty, voltage as f32);
        }
        thrust
    }

    /// Force along the rotors' axis, N.
    fn force(&self, duty: &[f32; MAX_ROTORS]) -> f64 {
        let wrench = self
            .config
            .geometry
            .wrench_from_thrust(&self.thrusts(duty, self.voltage));
        f64::from(wrench[0]).abs()
    }
}

/// For a voltage that is slower than the log's steps, held or interpolated in between: adds the drop over the vehicle's
/// internal resistance at every step.
///
/// ```text
///  V = ⟨V⟩ − R (i − ⟨i⟩)     i = k_P Σ f^1.5/⟨V⟩     ⟨ ⟩: mean over MEAN_S     f: Eq. 19 of duty and ⟨V⟩, lagged by the rotors
/// ```
/// Only the mean of the measured voltage remains: the noise of a sample that is held for many steps would look like a
/// gust.
pub(crate) fn with_drops(log: &mut FlightLog, detectors: &Detectors, rate_hz: f64) {
    let Some(voltage) = log.column(names::BATTERY_VOLTAGE) else {
        return;
    };
    let (battery, config) = (&detectors.vehicle().vehicle.battery, detectors.config());
    let half = (0.5 * MEAN_S * rate_hz).round() as usize;
    let mut mean = running_mean(voltage, half);
    let duties = log.duties();
    let weight = 1.0 - (-1.0 / (rate_hz * f64::from(config.sequential.rotor_time_constant))).exp();
    let mut thrust = vec![f64::NAN; duties.len()];
    let current: Vec<f64> = (0..mean.len())
        .map(|step| {
            let mut power = 0.0;
            for (thrust, duty) in thrust.iter_mut().zip(&duties) {
                let asked = f64::from(config.thrust_map.thrust(duty[step] as f32, mean[step] as f32));
                if asked.is_finite() {
                    *thrust = if thrust.is_nan() { asked } else { *thrust };
                    power += battery.power_coefficient_w_per_n15 * thrust.max(0.0).powf(1.5);
                    *thrust += weight * (asked - *thrust);
                } else {
                    power = f64::NAN;
                }
            }
            power / mean[step]
        })
        .collect();
    let mean_current = running_mean(&current, half);
    for (step, voltage) in mean.iter_mut().enumerate() {
        *voltage -= battery.internal_resistance_ohm * (current[step] - mean_current[step]);
    }
    log.columns.insert(names::BATTERY_VOLTAGE.to_owned(), mean);
}

/// The first seconds in the air without a gap: when they begin, s since the first row, their steps, and the increase of
/// the downward velocity, m/s.
fn first_seconds(
    log: &FlightLog,
    parts: &FlightParts,
    rotor_count: usize,
    rate_hz: f64,
    leak: f64,
) -> Result<(f64, Vec<Step>, f64), String> {
    let start_s = log.time_s.first().copied().unwrap_or(0.0);
    let in_air = |part: &&FlightPart| {
        matches!(part.kind, PartKind::Air | PartKind::Unknown) && part.end_s - part.start_s >= SHORTEST_S
    };
    let why = || format!("it is found from {SHORTEST_S} s in the air without a gap, and the log has none");
    let part = parts.parts.iter().find(in_air).ok_or_else(why)?;
    let (from_s, to_s) = (part.start_s, part.end_s.min(part.start_s + LONGEST_S));
    let duties: Vec<String> = (1..=rotor_count).map(names::duty).collect();
    let mut columns = vec![names::VELOCITY[2], names::ATTITUDE[0], names::ATTITUDE[1]];
    columns.extend(duties.iter().map(String::as_str));
    let mut steps = Vec::new();
    let mut sinking: Option<(f64, f64)> = None;
    let mut forgotten = 0.0;
    let mut begin_s = from_s;
    let mut over = false;
    let given: Result<(), std::convert::Infallible> = log.for_each_block(&columns, rate_hz, |first, block| {
        for row in 0..block[0].len() {
            let time_s = start_s + (first + row) as f64 / rate_hz;
            if over || time_s < from_s || time_s > to_s {
                continue;
            }
            if block.iter().any(|values| values[row].is_nan()) {
                // Values that start later than the part are not a gap.
                over = !steps.is_empty();
                continue;
            }
            let mut duty = [0.0; MAX_ROTORS];
            for (rotor, slot) in duty.iter_mut().enumerate().take(rotor_count) {
                *slot = block[3 + rotor][row] as f32;
            }
            let down = block[0][row];
            sinking = Some(sinking.map_or((down, down), |(begin, _)| (begin, down)));
            forgotten += leak * down / rate_hz;
            if steps.is_empty() {
                begin_s = time_s;
            }
            steps.push(Step {
                duty,
                upright: block[1][row].cos() * block[2][row].cos(),
            });
        }
        Ok(())
    });
    match given {
        Ok(()) => {}
    }
    match sinking {
        Some((begin, end)) if steps.len() as f64 >= SHORTEST_S * rate_hz => {
            Ok((begin_s - start_s, steps, end - begin + forgotten))
        }
        _ => Err(why()),
    }
}
