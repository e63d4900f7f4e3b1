//! The list of identified values: each with its interval, its source, and what would make it better.

mod battery;
mod drag;
mod inertia;
mod thrust;
mod yaw;

use super::airframe::CONCLUSIVE_DUTY_HZ;
use super::balance::Balance;
use super::bench::About;
use super::class::Class;
use super::estimate::Estimate;
use super::excitation::Excitation;
use super::fit::Fitted;
use super::grid::Grid;
use super::held_out::Halves;
use super::yaw::Yaw;
use super::{Numbers, Request};
use crate::log::{FlightLog, SensorRate};
use crate::model::constants::Source;

/// Everything that the values are derived from.
pub(crate) struct Findings<'a> {
    pub(crate) request: &'a Request,
    pub(crate) class: Class,
    pub(crate) grids: &'a [Grid],
    pub(crate) logs: &'a [FlightLog],
    pub(crate) fitted: &'a Fitted,
    pub(crate) yaw: Option<Yaw>,
    /// The estimates from each half of the flights, if they are long enough.
    pub(crate) halves: Option<&'a Halves>,
    /// The estimate from each flight by itself, if there are several.
    pub(crate) flights: &'a [(Fitted, Excitation)],
    pub(crate) voltage_slope: (f64, f64, Source),
    pub(crate) has_voltage: bool,
    pub(crate) rotors: usize,
    /// Absent: the torques are not known well enough.
    pub(crate) balance: Option<Balance>,
    /// [`Airframe::against_the_motion`](super::Airframe::against_the_motion)
    pub(crate) against_the_motion: bool,
    pub(crate) excitation: Excitation,
    /// The motor outputs come too slowly to determine inertias, lag and the torque of the rotors' acceleration.
    pub(crate) slow_outputs: bool,
    /// Bench results, if they are of this rotor and do not contradict the flight.
    pub(crate) bench: Option<&'a About>,
    /// n that the flight indicates but no propeller has; the curve is then the class's.
    pub(crate) impossible_slope: Option<f64>,
}

/// Source of a value, by how much the log narrows the prior's deviation.
fn whose(data: f64, prior: f64) -> Source {
    if data < 0.5 * prior {
        Source::Log
    } else if data < 2.0 * prior {
        Source::LogAndClass
    } else {
        Source::Class
    }
}

/// The same for a value with the class as a prior: if the log moved it, or made it more certain than the class, it is
/// not a class default, even if the log alone, without what the class says about the other values, leaves it open.
///
/// * `data`: deviation by the log alone · `posterior`: with the class included · `prior`: the class's · `moved`: how
///   far the value is from the class's, in the class's deviations
fn whose_in_all(data: f64, (posterior, prior): (f64, f64), moved: f64) -> Source {
    /// Posterior over prior deviation of a value whose log is twice as uncertain as the class.
    const NARROWED_RATIO: f64 = 0.894;
    const MOVED: f64 = 0.5;
    match whose(data, prior) {
        Source::Class if posterior < NARROWED_RATIO * prior || moved.abs() > MOVED => Source::LogAndClass,
        source => source,
    }
}

/// Deviation and source of a value whose channel may not be excited: it is then known no better than from its class.
fn as_far_as_excited(excited: bool, (data, class): (f64, f64), source: Source) -> (f64, Source) {
    match (excited, source) {
        (true, _) | (false, Source::Class) => (data, source),
        (false, _) => (data.max(class), Source::LogAndClass),
    }
}
impl Findings<'_> {
    /// The numbers of the document and the list of values, in the order of the document.
    pub(crate) fn values(&self, notes: &mut Vec<String>) -> (Numbers, Vec<Estimate>) {
        let mut values = vec![
            Estimate::normal("body.mass_kg", "mass", "kg", self.request.mass_kg, 0.0, Source::Entered)
                .how("every force scales with it"),
            Estimate::normal("arm", "arm", "m", self.request.arm_m, 0.0, Source::Entered)
                .how("every inertia scales with it"),
        ];
        let otherwise = self.turns_otherwise();
        let is_its_frame = !self.against_the_motion && otherwise.is_none();
        notes.extend(otherwise);
        let inertia = self.inertia(is_its_frame, &mut values, notes);
        let (moment_ratio, yaw_inertia, reaction_s) = self.yaw(is_its_frame, inertia, &mut values, notes);
        let (drag, rotor_drag) = self.drag(&mut values, notes);
        let lag_s = self.thrust(&mut values, notes);
        let battery = self.battery(&mut values, notes);
        self.assumed(&mut values, battery.1, battery.4);
        let scale = self.grids.iter().find_map(|grid| grid.accel_scale);
        if let Some(scale) = scale {
            values.push(
                Estimate::normal(
                    "accelerometer.scale",
                    "accelerometer at rest over gravity",
                    "",
                    scale,
                    0.002,
                    Source::Log,
                )
                .how("mean specific force before take-off; readings were divided by it"),
            );
        } else if self.grids[0].accel[2].is_some() && !self.grids[0].accel_from_estimator {
            notes.push(
                "no rest before take-off: the accelerometer's scale is not checked (5 s of standing still would do)"
                    .to_owned(),
            );
        }
        let fitted = self.fitted;
        let numbers = Numbers {
            curve: fitted.curve,
            lag_s: lag_s.clamp(0.005, 1.0),
            inertia: [inertia[0].0, inertia[1].0, yaw_inertia],
            moment_ratio,
            reaction_s,
            drag: drag * self.request.mass_kg,
            rotor_drag: rotor_drag * self.request.mass_kg,
            voltage: battery.1,
            voltage_slope: self.voltage_slope.0,
            cells: battery.0,
            capacity: battery.2,
            resistance: battery.3,
            power_coefficient: battery.4,
        };
        (numbers, values)
    }

    /// A value and its deviation from the first and from the second half of the flights, if both excite it.
    fn by_halves(
        &self,
        value: impl Fn(&Fitted) -> (f64, f64),
        excited: impl Fn(&Excitation) -> bool,
    ) -> Option<[(f64, f64); 2]> {
        let halves = self.halves.filter(|halves| halves.excitation.iter().all(excited))?;
        Some(halves.fitted.each_ref().map(value))
    }

    /// A value and its deviation from each flight that excites it, if there are several.
    fn by_flight(
        &self,
        value: impl Fn(&Fitted) -> (f64, f64),
        excited: impl Fn(&Excitation) -> bool,
    ) -> Vec<(f64, f64)> {
        let told = self.flights.iter().filter(|(_, excitation)| excited(excitation));
        told.map(|(fitted, _)| value(fitted)).collect()
    }

    /// Whether rotors at these places would turn the vehicle far more than it turns, with its own constants and with
    /// those of the class. Checked for six or more rotors, whose orders were not searched with the motion or may be
    /// none of those searched; not for outputs at a low rate, which have no phase relation with the motion (R² of a
    /// right frame down to −20 at 10 Hz).
    fn turns_otherwise(&self) -> Option<String> {
        /// R² of a torque that is unrelated to the motion and 1.4 times its size.
        const NOTHING: f64 = -1.0;
        let is_slow = |log: &FlightLog| {
            let rate = log.duty_rate().filter(SensorRate::is_slower);
            rate.is_some_and(|rate| rate.source_hz < CONCLUSIVE_DUTY_HZ)
        };
        if self.rotors < 6 || self.logs.iter().any(is_slow) {
            return None;
        }
        let scores = [0, 1].map(|axis| self.halves.and_then(|halves| halves.acceleration(axis)));
        let told = scores.into_iter().flatten();
        let wrong: Vec<String> = told
            .filter(|score| score.calibrated.max(score.class_default) < NOTHING)
            .map(|score| format!("{} R² {:.1}", score.channel, score.calibrated.max(score.class_default)))
            .collect();
        (!wrong.is_empty()).then(|| {
            format!(
                "the motion is not that of rotors at these places ({} on seconds that were not fitted): check the frame and the order of the outputs",
                wrong.join(", ")
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// "CLASS DEFAULT" was shown next to a value half of the class's, with an interval that excludes the class's.
    #[test]
    fn regress_what_the_log_has_moved_is_no_class_default() {
        // By the log alone it is open (a ridge of inertia and lag); with the class's value for the lag it is not.
        assert_eq!(whose_in_all(0.9, (0.11, 0.3), -2.0), Source::LogAndClass);
        assert_eq!(whose_in_all(0.9, (0.28, 0.3), 0.8), Source::LogAndClass);
        assert_eq!(whose_in_all(0.9, (0.11, 0.3), 0.0), Source::LogAndClass);
        assert_eq!(whose_in_all(0.9, (0.29, 0.3), 0.2), Source::Class);
        assert_eq!(whose_in_all(0.1, (0.09, 0.3), 0.2), Source::Log);
    }
}
