//! Jx and Jy.

use super::{Findings, as_far_as_excited, whose_in_all};
use crate::identify::agreement::Compared;
use crate::identify::class;
use crate::identify::estimate::Estimate;
use crate::identify::excitation::Excitation;
use crate::identify::fit::{Fitted, GAIN};
use crate::identify::plausible::{GYRATION_OVER_ARM, gyration_over_arm, has_possible_gyration};
use crate::identify::slow_outputs::ADVICE;
use crate::model::constants::Source;

impl Findings<'_> {
    /// Jx, Jy and the deviations of their logarithms; `is_its_frame`: the motion does not contradict the frame.
    pub(super) fn inertia(
        &self,
        is_its_frame: bool,
        values: &mut Vec<Estimate>,
        notes: &mut Vec<String>,
    ) -> [(f64, f64); 2] {
        let (mass, arm) = (self.request.mass_kg, self.request.arm_m);
        let fitted = self.fitted;
        let of_class = |axis: usize, why: String| {
            let value = self.class.inertia_ratio[axis] * mass * arm * arm;
            (value, class::INERTIA_LOG_DEVIATION, Source::Class, why)
        };
        [0, 1].map(|axis| {
            let (key, name) = [
                ("body.inertia_body_kg_m2[0]", "inertia, roll"),
                ("body.inertia_body_kg_m2[1]", "inertia, pitch"),
            ][axis];
            // α = gain · (lever in arms) · T/m, hence J = m l/gain.
            let flown = mass * arm / fitted.gain[axis];
            let i = GAIN[axis];
            let of_its_class = self.class.inertia_ratio[axis] * mass * arm * arm;
            let source = whose_in_all(
                fitted.data_deviation[i],
                (fitted.covariance[(i, i)].sqrt(), class::INERTIA_LOG_DEVIATION),
                (flown / of_its_class).ln() / class::INERTIA_LOG_DEVIATION,
            );
            let gyration = gyration_over_arm(fitted.gain[axis], arm);
            let uneven = if fitted.uneven[i] {
                "; parts of the flight differ, and the interval covers them"
            } else {
                ""
            };
            let (value, deviation, source, how) = if !is_its_frame {
                of_class(axis, "the motion contradicts the frame, so its torques determine no inertia".to_owned())
            } else if self.slow_outputs {
                of_class(axis, "the motor outputs come too slowly to determine it".to_owned())
            } else if !has_possible_gyration(fitted.gain[axis], arm) {
                let impossible = format!(
                    "the flight indicates {flown:.3e} kg·m², a radius of gyration of {gyration:.2} arms, which is impossible for {mass} kg on arms of {arm} m \
                     (possible: {} to {} arms)",
                    GYRATION_OVER_ARM.start(),
                    GYRATION_OVER_ARM.end()
                );
                notes.push(format!(
                    "{name}: {impossible}; the class default is written{ADVICE}"
                ));
                of_class(axis, impossible)
            } else if source == Source::Class {
                let ratio = self.class.inertia_ratio[axis];
                of_class(axis, format!("{ratio:.2} m l²: not determined by the flight"))
            } else {
                let how = format!(
                    "prediction error over {} parts, {:.3} m l²{uneven}",
                    fitted.parts,
                    flown / (mass * arm * arm)
                );
                let (deviation, source) = as_far_as_excited(
                    self.excitation.rate[axis],
                    (fitted.covariance[(i, i)].sqrt(), class::INERTIA_LOG_DEVIATION),
                    source,
                );
                let by_itself =
                    |part: &Fitted| ((mass * arm / part.gain[axis]).ln(), part.covariance[(i, i)].sqrt());
                let excited = |excitation: &Excitation| excitation.rate[axis];
                let halves = self.by_halves(by_itself, excited);
                let cannot_be = |value: &f64| !has_possible_gyration(mass * arm / value.exp(), arm);
                let compared = Compared {
                    name,
                    impossible: halves.iter().flatten().map(|(value, _)| *value).find(cannot_be),
                    whole: flown.ln(),
                    class: of_its_class.ln(),
                    class_deviation: class::INERTIA_LOG_DEVIATION,
                    halves,
                    flights: self.by_flight(by_itself, excited),
                    score: self.halves.and_then(|halves| halves.acceleration(axis)),
                    shown: &|logarithm| format!("{:.3e} kg·m²", logarithm.exp()),
                };
                let (deviation, source) = compared.checked((deviation, source), notes);
                (flown, deviation, source, how)
            };
            let mut estimate = Estimate::log_normal(key, name, "kg·m²", value, deviation, source);
            if source == Source::Class {
                // Towers of stacked rotors and batteries exceed every flat vehicle of the class: a published X8 has
                // 0.78 arms.
                estimate.high = estimate.high.max(mass * (GYRATION_OVER_ARM.end() * arm).powi(2));
            }
            values.push(
                estimate
                    .how(how)
                    .better("20 s of roll and pitch doublets, logged at 200 Hz or more"),
            );
            (value, deviation)
        })
    }
}
