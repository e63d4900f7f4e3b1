//! Battery, and what no flight tells: centre of mass, evenness, thrust at full duty.

use super::Findings;
use crate::identify::bench::together;
use crate::identify::class;
use crate::identify::estimate::Estimate;
use crate::identify::grid::GRAVITY;
use crate::identify::{fit, slow};
use crate::model::constants::Source;

/// Deviation of the centre of mass over the arm.
const CENTRE_DEVIATION: f64 = 0.01;
/// The same where the flights were carried evenly: how well a battery is put back to its place.
const CENTRE_FLOOR: f64 = 0.004;
/// Deviation of a healthy rotor's thrust: seven healthy flights of CrazyPAD.
const EVENNESS_DEVIATION: f64 = 0.03;
/// The same where the flights were carried evenly: what a propeller changes by from day to day.
const EVENNESS_FLOOR: f64 = 0.01;
/// Deviation of the thrust at full duty, relative, if the curve only extrapolates.
const TOP_DEVIATION: f64 = 0.05;
/// Power coefficients of real vehicles, over their class's: small propellers on long arms take more.
const USUAL_POWER: std::ops::Range<f64> = 0.4..2.5;
/// Deviation of a dead zone, duty.
const DEAD_ZONE_DEVIATION: f64 = 0.01;

impl Findings<'_> {
    /// What the document assumes.
    pub(super) fn assumed(&self, values: &mut Vec<Estimate>, voltage: f64, power: f64) {
        let (centre, evenness, source) = match self.balance {
            Some(balance) => (
                balance.centre.map(|share| share.max(CENTRE_FLOOR)),
                balance
                    .of_one_rotor(self.rotors)
                    .clamp(EVENNESS_FLOOR, EVENNESS_DEVIATION),
                Source::Log,
            ),
            None => ([CENTRE_DEVIATION; 2], EVENNESS_DEVIATION, Source::Assumed),
        };
        for (axis, name) in ["centre of mass, forward", "centre of mass, to the right"]
            .into_iter()
            .enumerate()
        {
            let key = format!("body.centre_of_mass_m[{axis}]");
            let how = match self.balance {
                Some(balance) => format!(
                    "at the centre of the rotors: their thrusts balance {:.1} % of the arm from there, and a battery is put back to {:.1} %",
                    100.0 * balance.centre[axis],
                    100.0 * CENTRE_FLOOR
                ),
                None => "at the centre of the rotors, to 1 % of the arm".to_owned(),
            };
            let deviation = centre[axis] * self.request.arm_m;
            values.push(Estimate::normal(&key, name, "m", 0.0, deviation, source).how(how));
        }
        let how = match source {
            Source::Log => "the torques of roll and pitch balance with equal rotors; healthy rotors vary by up to 3 %",
            _ => "healthy rotors vary by 3 %",
        };
        values.push(
            Estimate::normal(
                "rotors.thrust_scale",
                "thrust of one rotor over the mean of all, less 1",
                "",
                0.0,
                evenness,
                source,
            )
            .how(how),
        );
        // Punches and idling are outside the duties that the curve was fitted to: its errors there look like these
        // three.
        let full = self.full_thrust(voltage);
        let current = power * full.powf(1.5) / voltage;
        let resistance = TOP_DEVIATION * voltage / (class::VOLTAGE_SLOPE * current);
        for (key, name, unit, deviation) in [
            (
                "rotors.lost_duty",
                "duty at the top that adds no thrust",
                "",
                TOP_DEVIATION / self.class.slope,
            ),
            (
                "rotors.esc_resistance_ohm",
                "resistance of ESC and motor",
                "Ω",
                resistance,
            ),
            ("rotors.dead_zone", "duty that does nothing", "", DEAD_ZONE_DEVIATION),
        ] {
            values.push(
                Estimate::normal(key, name, unit, 0.0, deviation, Source::Assumed)
                    .how("none; the thrust curve extrapolates beyond the duties that were flown"),
            );
        }
    }

    /// Thrust of a rotor at full duty by the curve, N.
    pub(super) fn full_thrust(&self, voltage: f64) -> f64 {
        let curve = &self.fitted.curve;
        curve
            .blade(curve.hover * self.request.mass_kg, voltage, self.voltage_slope.0)
            .lift(1.0, voltage)
            .max(0.01)
    }

    /// Cells, mean voltage in the air, capacity, resistance, k_P.
    pub(super) fn battery(&self, values: &mut Vec<Estimate>, notes: &mut Vec<String>) -> (u32, f64, f64, f64, f64) {
        let (mass, arm) = (self.request.mass_kg, self.request.arm_m);
        let found = slow::battery(self.grids, &self.fitted.curve);
        let parameter = |names: &[&str]| -> Option<f64> {
            names
                .iter()
                .find_map(|name| self.logs.iter().find_map(|log| log.parameters.get(*name)).copied())
                .filter(|value| *value > 0.0)
        };
        let class_cells = if mass < 0.1 {
            1
        } else if mass < 2.0 {
            4
        } else {
            6
        };
        let (cells, source) = match (
            self.request.cells,
            parameter(&["BAT1_N_CELLS", "BAT_N_CELLS"]),
            found.cells,
        ) {
            (Some(cells), ..) => (cells, Source::Entered),
            (_, Some(cells), _) if (1.0..=24.0).contains(&cells) => (cells as u32, Source::Parameter),
            (_, _, Some(cells)) => (cells, Source::Log),
            _ => (class_cells, Source::Class),
        };
        let mut counted = Estimate::normal("battery.cells", "cells in series", "", f64::from(cells), 0.0, source)
            .how(found.start_v.map_or_else(
                || "no voltage in the log".to_owned(),
                |volts| format!("{volts:.2} V at the start: {:.2} V a cell", volts / f64::from(cells)),
            ))
            .better(if source == Source::Class { "--cells" } else { "" });
        if source == Source::Class {
            // One more or one less; a battery has at least one.
            (counted.low, counted.high) = ((counted.value - 1.0).max(1.0), counted.value + 1.0);
        }
        values.push(counted);
        let nominal = 3.7 * f64::from(cells);
        let (capacity, source) = match (
            self.request.capacity_ah,
            parameter(&["BATT_CAPACITY", "BAT1_CAPACITY", "BAT_CAPACITY"]),
        ) {
            (Some(capacity), _) => (capacity, Source::Entered),
            (_, Some(milliamp_hours)) if milliamp_hours >= 50.0 => (milliamp_hours / 1000.0, Source::Parameter),
            _ => ((self.class.energy_wh_per_kg * mass / nominal).max(0.05), Source::Class),
        };
        let deviation = if source == Source::Entered {
            0.0
        } else if source == Source::Parameter {
            0.05
        } else {
            0.4
        };
        values.push(
            Estimate::log_normal("battery.capacity_ah", "capacity", "Ah", capacity, deviation, source)
                .how(if source == Source::Class {
                    "energy of batteries of such vehicles"
                } else {
                    ""
                })
                .better(if source == Source::Class {
                    "--capacity, as printed on the pack"
                } else {
                    ""
                }),
        );
        // Of the class: 12 mΩ of a cell of 5 Ah, in proportion to cells over capacity.
        let class_resistance =
            (0.012 * f64::from(cells) * 5.0 / capacity / if mass < 0.1 { 2.0 } else { 4.0 }).clamp(0.002, 1.0);
        let (resistance, resistance_deviation, source) = match found.resistance {
            Some((value, deviation)) => (value, deviation, Source::Log),
            None => (class_resistance, 0.5 * class_resistance, Source::Class),
        };
        let mut estimate = Estimate::normal(
            "battery.internal_resistance_ohm",
            "resistance",
            "Ω",
            resistance,
            resistance_deviation,
            source,
        )
        .how(if source == Source::Log {
            "voltage over current and charge"
        } else {
            "no current in the log, or it hardly varies"
        })
        .better("5 s of rest before take-off, with current and voltage");
        estimate.low = estimate.low.max(0.0);
        values.push(estimate);
        let class_power = self.class.power_coefficient(self.rotors, arm);
        let flown_power = found
            .power
            .map(|(value, deviation)| (value / mass.powf(1.5), deviation));
        let bench_power = self.bench.and_then(|bench| bench.power);
        let (power, deviation, source) = match (flown_power, bench_power) {
            (Some((flown, deviation)), bench) => {
                match bench.and_then(|(value, own)| together((flown.ln(), deviation), (value.ln(), own))) {
                    Some((value, deviation)) => (value.exp(), deviation, Source::Bench),
                    None => (flown, deviation, Source::Log),
                }
            }
            (None, Some((value, deviation))) => (value, deviation, Source::Bench),
            (None, None) => (class_power, 0.35, Source::Class),
        };
        if source == Source::Log && !USUAL_POWER.contains(&(power / class_power)) {
            notes.push(format!(
                "the rotors take {power:.1} W/N^1.5, {:.1} times what vehicles of this class with propellers as large as the arms allow take: check the mass, the \
                 arm, and the scale of the current sensor",
                power / class_power
            ));
        }
        values.push(
            Estimate::log_normal(
                "battery.power_coefficient_w_per_n15",
                "electrical power of a rotor over thrust^1.5",
                "W/N^1.5",
                power,
                deviation,
                source,
            )
            .how(match source {
                Source::Log => "voltage times current in the air",
                Source::Bench => "power over thrust of the bench, with that of the flight where it has a current",
                _ => "momentum theory and the class's efficiency",
            })
            .better(if source == Source::Class {
                "current in the log"
            } else {
                ""
            }),
        );
        let hover_n = mass * GRAVITY / self.rotors as f64;
        let hover_w = self.rotors as f64 * power * hover_n.powf(1.5);
        let (_, mean) = fit::hover_point(self.grids);
        let voltage = if mean.is_finite() && mean > 2.0 {
            mean
        } else {
            // What the twin assumes if the log has no voltage: three quarters charged, under load.
            let open = f64::from(cells) * 3.98;
            0.5 * (open + (open * open - 4.0 * resistance * hover_w).max(0.0).sqrt())
        };
        (cells, voltage, capacity, resistance, power.min(1000.0))
    }
}
