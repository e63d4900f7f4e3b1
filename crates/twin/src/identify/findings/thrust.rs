//! Thrust over duty, over voltage and over time; lag and delay of the motors.

use super::{Findings, as_far_as_excited, whose, whose_in_all};
use crate::Z95;
use crate::identify::agreement::Compared;
use crate::identify::class;
use crate::identify::estimate::Estimate;
use crate::identify::excitation::Excitation;
use crate::identify::fit::{ALPHA, BETA, DELAY, Fitted, LAG, SLOPES};
use crate::identify::held_out::Halves;
use crate::identify::slow;
use crate::model::constants::Source;

/// Deviation of the logarithm of the thrust level if the accelerometer is correct: scale error of an ordinary one.
const LEVEL_LOG_DEVIATION: f64 = 0.01;
/// … without one, if the attitude tells how far the thrust leans from the weight that it carries on average: a flight
/// that ends lower or slower than it began; and without either: 30° of lean.
const LEVEL_BY_ATTITUDE: f64 = 0.05;
const LEVEL_BY_WEIGHT: f64 = 0.15;

impl Findings<'_> {
    /// Level, slope, dependence on voltage and time, and lag; lag and delay together, s.
    pub(super) fn thrust(&self, values: &mut Vec<Estimate>, notes: &mut Vec<String>) -> f64 {
        let fitted = self.fitted;
        let curve = &fitted.curve;
        let measured = self.grids.iter().all(|grid| grid.accel[2].is_some());
        values.push(
            Estimate::normal(
                "rotors.hover_duty",
                "mean duty in the air",
                "",
                curve.hover_duty,
                0.0,
                Source::Log,
            )
            .how(format!(
                "carries {:.3} N of each rotor",
                curve.hover * self.request.mass_kg
            )),
        );
        let level = slow::level_over_gravity(curve, self.rotors);
        if measured && (level - 1.0).abs() > 0.05 {
            notes.push(format!(
                "the mean specific force in the air is {level:.3} g: the accelerometer's scale is off by that, or the flight climbs and turns"
            ));
        }
        values.push(self.slope(measured, notes));
        values.push(self.over_voltage(notes));
        self.falls(values);
        values.push(self.level(measured, level));
        self.lag(values, notes)
    }

    /// n, the slope of ln thrust over ln duty at hover.
    fn slope(&self, measured: bool, notes: &mut Vec<String>) -> Estimate {
        let fitted = self.fitted;
        let curve = &fitted.curve;
        let slope_of = |fitted: &Fitted| {
            let c = &fitted.covariance;
            let variance = c[(ALPHA, ALPHA)] + 0.25 * c[(BETA, BETA)] - c[(ALPHA, BETA)];
            (fitted.curve.slope(), variance.max(0.0).sqrt())
        };
        let slope_variance = slope_of(fitted).1.powi(2);
        let slope_source = whose_in_all(
            fitted.data_deviation[ALPHA]
                .hypot(0.5 * fitted.data_deviation[BETA])
                .min(slope_variance.sqrt() * 2.0),
            (slope_variance.sqrt(), class::SLOPE_DEVIATION),
            (curve.slope() - self.class.slope) / class::SLOPE_DEVIATION,
        );
        let (slope_deviation, slope_source) = as_far_as_excited(
            self.excitation.lift,
            (slope_variance.sqrt(), class::SLOPE_DEVIATION),
            slope_source,
        );
        let compared = Compared {
            name: "thrust slope",
            whole: curve.slope(),
            class: self.class.slope,
            class_deviation: class::SLOPE_DEVIATION,
            halves: self.by_halves(slope_of, |excitation| excitation.lift),
            flights: self.by_flight(slope_of, |excitation| excitation.lift),
            impossible: None,
            score: self.halves.and_then(Halves::lift),
            shown: &|slope| format!("n = {slope:.2}"),
        };
        let (slope_deviation, slope_source) = match (self.bench, self.impossible_slope) {
            (None, None) => compared.checked((slope_deviation, slope_source), notes),
            _ => (slope_deviation, slope_source),
        };
        let impossible = self.impossible_slope.map(|slope| {
            format!(
                "the flight indicates n = {slope:.2}, which no propeller has ({} to {})",
                SLOPES.start(),
                SLOPES.end()
            )
        });
        if let Some(impossible) = &impossible {
            notes.push(format!(
                "thrust slope: {impossible}; the class default is written: {}; check that the vehicle flies in this log, that the outputs are those of its \
                 motors, and their range",
                if measured {
                    "the vertical force does not follow the motors as in a flight"
                } else {
                    "no accelerometer says how the thrust follows the motors"
                }
            ));
        }
        let (slope_deviation, slope_source, slope_how) = match (self.bench, impossible) {
            (Some(bench), _) if bench.alone => (
                bench.slope_deviation,
                Source::Bench,
                format!(
                    "shape of the thrust curve by the bench ({:.2}), level by the flight, which hardly moves",
                    bench.slope
                ),
            ),
            (Some(bench), _) => (
                slope_deviation.min(bench.slope_deviation),
                Source::Bench,
                format!(
                    "shape of the thrust curve by the bench ({:.2}) and the flight, by their variances; level by the flight",
                    bench.slope
                ),
            ),
            (None, Some(impossible)) => (class::SLOPE_DEVIATION, Source::Class, impossible),
            (None, None) => (
                slope_deviation,
                slope_source,
                "thrust curve: hover level, this slope, and its bend".to_owned(),
            ),
        };
        let mut estimate = Estimate::normal(
            "rotors.thrust_slope",
            "n = d ln thrust/d ln duty at hover",
            "",
            curve.slope(),
            slope_deviation,
            slope_source,
        )
        .how(slope_how)
        .better("10 s of throttle pulses; a thrust stand");
        // No rotor's thrust falls with its duty.
        estimate.low = estimate.low.max(0.0);
        estimate
    }

    /// s, the slope of ln thrust over ln voltage.
    fn over_voltage(&self, notes: &mut Vec<String>) -> Estimate {
        let (s, deviation, source) = self.voltage_slope;
        let of_the_bench = self.bench.is_some_and(|bench| bench.exponent.is_some());
        let mut of_voltage = Estimate::normal(
            "rotors.voltage_slope",
            "d ln thrust/d ln voltage",
            "",
            s,
            deviation,
            if of_the_bench { Source::Bench } else { source },
        );
        // The value is that of the document, which has Eq. 19: T ∝ V − V₀, V₀ ≥ 0.
        of_voltage.value = s.max(1.0);
        of_voltage.high = of_voltage.high.max(of_voltage.value);
        if of_voltage.value > s + Z95 * deviation {
            notes.push(format!(
                "thrust over voltage: the flight says V^{s:.2} ± {:.2}, as where an ESC holds the speed or the autopilot makes up for the battery; a vehicle document holds V^1 at \
                 least, so `improve` on the flight has an exponent of the voltage to add",
                Z95 * deviation
            ));
        }
        of_voltage
            .how(match source {
                _ if of_the_bench => "voltages of the bench, combined with the flight by their variances",
                _ if !self.has_voltage => "no voltage in the log",
                Source::Log => "slow drift of thrust over voltage; anything else that drifts with time is in it",
                Source::LogAndClass => "slow drift of thrust over voltage, combined with the class by their variances",
                _ => "the voltage hardly varies",
            })
            .better("a flight over most of the charge, with voltage")
    }

    /// Thrust of a rotor at the mean duty.
    ///
    /// * `measured`: the logs have an accelerometer · `level`: mean specific force over gravity
    fn level(&self, measured: bool, level: f64) -> Estimate {
        let leans = self.grids.iter().all(|grid| grid.attitude.is_some());
        let (level_deviation, level_source, level_how) = match (measured, leans) {
            (true, _) => (
                LEVEL_LOG_DEVIATION.hypot(level.max(0.5).ln()),
                Source::Log,
                "mean specific force in the air; as good as the accelerometer's scale, and relative to the mass entered",
            ),
            (false, true) => (
                LEVEL_BY_ATTITUDE,
                Source::Log,
                "weight over the cosine of the tilt, mean in the air: no accelerometer in the log; relative to the mass entered",
            ),
            (false, false) => (
                LEVEL_BY_WEIGHT,
                Source::Assumed,
                "the weight: neither accelerometer nor attitude in the log, level flight is assumed; relative to the mass entered",
            ),
        };
        Estimate::log_normal(
            "rotors.thrust_level",
            "thrust of a rotor at the mean duty",
            "N",
            self.fitted.curve.hover * self.request.mass_kg,
            level_deviation,
            level_source,
        )
        .how(level_how)
    }

    /// Lag and delay of the motors; their sum, s.
    fn lag(&self, values: &mut Vec<Estimate>, notes: &mut Vec<String>) -> f64 {
        if self.slow_outputs {
            return self.lag_of_the_class(values);
        }
        let fitted = self.fitted;
        let covariance = &fitted.covariance;
        let lag_deviation = covariance[(LAG, LAG)].sqrt();
        let lag_source = whose_in_all(
            fitted.data_deviation[LAG],
            (lag_deviation, class::LAG_LOG_DEVIATION),
            (fitted.lag_s / self.class.lag_s).ln() / class::LAG_LOG_DEVIATION,
        );
        // Roll and pitch determine it; the one that is predicted better counts.
        let turns = |excitation: &Excitation| excitation.rate[0] || excitation.rate[1];
        let lag_of = |fitted: &Fitted| (fitted.lag_s.ln(), fitted.covariance[(LAG, LAG)].sqrt());
        let scores = [0, 1].map(|axis| self.halves.and_then(|halves| halves.acceleration(axis)));
        let compared = Compared {
            name: "motor lag",
            whole: fitted.lag_s.ln(),
            class: self.class.lag_s.ln(),
            class_deviation: class::LAG_LOG_DEVIATION,
            halves: self.by_halves(lag_of, turns),
            flights: self.by_flight(lag_of, turns),
            impossible: None,
            score: scores
                .into_iter()
                .flatten()
                .max_by(|a, b| a.calibrated.total_cmp(&b.calibrated)),
            shown: &|logarithm| format!("{:.1} ms", 1e3 * logarithm.exp()),
        };
        let (lag_deviation, lag_source) = compared.checked((lag_deviation, lag_source), notes);
        values.push(
            Estimate::log_normal(
                "motor.lag_s",
                "motor lag, τ",
                "s",
                fitted.lag_s,
                lag_deviation,
                lag_source,
            )
            .how("first order, on the thrust")
            .better("doublets at 200 Hz or more"),
        );
        values.push(
            Estimate::normal(
                "motor.delay_s",
                "delay of the command, d",
                "s",
                fitted.delay_s,
                covariance[(DELAY, DELAY)].sqrt(),
                whose(fitted.data_deviation[DELAY], class::DELAY_DEVIATION_S),
            )
            .how("apart from the lag only above about 200 Hz"),
        );
        let sum = fitted.lag_s + fitted.delay_s;
        let variance = (fitted.lag_s * lag_deviation).powi(2)
            + covariance[(DELAY, DELAY)]
            + 2.0 * fitted.lag_s * covariance[(LAG, DELAY)];
        let mut both = Estimate::normal(
            "rotors.thrust_lag_s",
            "lag and delay together",
            "s",
            sum,
            variance.max(0.0).sqrt(),
            lag_source,
        )
        .how("the vehicle document has no delay: τ + d; the interval begins where that of τ does");
        // A delay has a different effect: without it the lag is τ.
        both.low = both.low.min(fitted.lag_s / (Z95 * lag_deviation).exp());
        values.push(both);
        sum
    }

    /// The same if the outputs come too slowly to determine either.
    fn lag_of_the_class(&self, values: &mut Vec<Estimate>) -> f64 {
        const HOW: &str = "the motor outputs come too slowly to determine it";
        let class = &self.class;
        let both = class.lag_s + class.delay_s;
        let lag = Estimate::log_normal(
            "motor.lag_s",
            "motor lag, τ",
            "s",
            class.lag_s,
            class::LAG_LOG_DEVIATION,
            Source::Class,
        );
        let delay = Estimate::normal(
            "motor.delay_s",
            "delay of the command, d",
            "s",
            class.delay_s,
            class::DELAY_DEVIATION_S,
            Source::Class,
        );
        let together = Estimate::normal(
            "rotors.thrust_lag_s",
            "lag and delay together",
            "s",
            both,
            (class.lag_s * class::LAG_LOG_DEVIATION).hypot(class::DELAY_DEVIATION_S),
            Source::Class,
        );
        // A delay has a different effect: without it the lag is τ.
        let low = together.low.min(lag.low);
        values.extend([
            lag.how(HOW).better("doublets at 200 Hz or more"),
            delay.how(HOW),
            Estimate { low, ..together }
                .how("the vehicle document has no delay: τ + d; the interval begins where that of τ does"),
        ]);
        both
    }

    /// Decline of the thrust over time, log by log.
    pub(super) fn falls(&self, values: &mut Vec<Estimate>) {
        for grid in self.grids {
            let Some(fall) = slow::fall(grid, &self.fitted.curve) else {
                continue;
            };
            values.push(
                Estimate::normal(
                    "flight.thrust_fall_per_s",
                    &format!("fall of the thrust with time in {}", grid.name),
                    "1/s",
                    fall.per_s,
                    fall.deviation,
                    Source::Log,
                )
                .how("most likely the supply, whose voltage is not in the log; half of the flight predicts the other; no value of the vehicle")
                .better("voltage in the log"),
            );
        }
    }
}
