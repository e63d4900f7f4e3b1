//! Torque-to-thrust ratio, Jz, and the reaction to the acceleration of the rotors.

use super::{Findings, whose};
use crate::Z95;
use crate::identify::agreement::Compared;
use crate::identify::class;
use crate::identify::estimate::Estimate;
use crate::identify::grid::GRAVITY;
use crate::identify::held_out::default_yaw;
use crate::identify::plausible::MOMENT_RATIO_OVER_ARM;
use crate::identify::yaw::{EXPLAINED, Reaction, Yaw};
use crate::model::constants::Source;
use rotortwin_plant::effects::hover_rotor_speed_rad_s;

/// Deviation of ln c/Jz above which the flight is not informative about it.
const YAW_LOG_DEVIATION: f64 = 1.0;

impl Findings<'_> {
    /// c, Jz and λ.
    pub(super) fn yaw(
        &self,
        is_its_frame: bool,
        inertia: [(f64, f64); 2],
        values: &mut Vec<Estimate>,
        notes: &mut Vec<String>,
    ) -> (f64, f64, f64) {
        let (mass, arm) = (self.request.mass_kg, self.request.arm_m);
        let share = class::YAW_INERTIA_SHARE;
        let sum = inertia[0].0 + inertia[1].0;
        let inertia_variance = inertia
            .iter()
            .map(|(value, deviation)| (deviation * value / sum).powi(2))
            .sum::<f64>()
            + class::YAW_INERTIA_LOG_DEVIATION.powi(2);
        let on_the_bench = self.bench.and_then(|bench| bench.moment_ratio);
        let (ratio_before, deviation_before) =
            on_the_bench.unwrap_or((self.class.moment_ratio_m, class::MOMENT_LOG_DEVIATION));
        let (mut log_inertia, mut log_ratio) = ((share * sum).ln(), ratio_before.ln());
        let (mut inertia_deviation, mut ratio_deviation) = (inertia_variance.sqrt(), deviation_before);
        let mut ratio_source = if on_the_bench.is_some() {
            Source::Bench
        } else {
            Source::Class
        };
        let counts = self.excitation.rate[2] && is_its_frame;
        let told = self.yaw.filter(|_| counts).filter(|yaw| {
            let ratio = yaw.gain / mass * share * sum;
            let possible = MOMENT_RATIO_OVER_ARM.contains(&(ratio / arm));
            if !possible {
                notes.push(format!(
                    "yaw: the flight indicates a torque over thrust of {ratio:.2e} m, {:.3} arms, which is impossible for propellers on these arms ({} to {} \
                     arms): the class default is written",
                    ratio / arm,
                    MOMENT_RATIO_OVER_ARM.start(),
                    MOMENT_RATIO_OVER_ARM.end()
                ));
            }
            possible
        });
        // Known within a factor of seven either way: not at all.
        let told = told.filter(|yaw| {
            let determined = yaw.deviation < YAW_LOG_DEVIATION;
            if !determined {
                notes.push(
                    "yaw: c/Jz is not determined by the flight (parts of it differ by more than its size): the class default is written"
                        .to_owned(),
                );
            }
            determined
        });
        let believed = told.is_some_and(|yaw| yaw.explained >= EXPLAINED);
        let told = told.map(|yaw| self.yaw_by_halves(yaw, notes));
        let yaw_source = match told {
            Some(yaw) if believed && yaw.deviation < 0.5 * class::MOMENT_LOG_DEVIATION => Source::Log,
            _ => Source::LogAndClass,
        };
        if let Some(yaw) = told {
            if !believed {
                notes.push(format!(
                    "yaw: what the rotors do explains {:.0} % of the yaw acceleration ({} to {} Hz), and {:.0} % are needed: torque over thrust and the torque of \
                     rotor acceleration are known no better than by the class",
                    100.0 * yaw.explained.max(0.0),
                    yaw.band.low_hz,
                    yaw.band.high_hz,
                    100.0 * EXPLAINED
                ));
            }
            // ln c − ln Jz is measured; both have priors.
            let measured = (yaw.gain / mass).ln();
            let noise = yaw.deviation.powi(2);
            let (mut vc, vj) = (deviation_before.powi(2), inertia_variance);
            let apart = (measured - (log_ratio - log_inertia)).abs() / (vc + vj + noise).sqrt();
            if on_the_bench.is_some() && apart > 3.0 {
                notes.push(format!(
                    "torque over thrust is {ratio_before:.4} m on the bench, and c/Jz of the flight with the inertia is {apart:.0} deviations from it: not averaged, the flight's is \
                     taken"
                ));
                ratio_source = Source::Class;
                log_ratio = self.class.moment_ratio_m.ln();
                vc = class::MOMENT_LOG_DEVIATION.powi(2);
            }
            let innovation = measured - (log_ratio - log_inertia);
            let total = vc + vj + noise;
            log_ratio += vc / total * innovation;
            log_inertia -= vj / total * innovation;
            ratio_deviation = (vc - vc * vc / total).sqrt();
            inertia_deviation = (vj - vj * vj / total).sqrt();
            if ratio_source != Source::Bench {
                ratio_source = whose((vj + noise).sqrt(), class::MOMENT_LOG_DEVIATION);
            }
            values.push(
                Estimate::log_normal(
                    "yaw.moment_ratio_over_inertia",
                    "c/Jz",
                    "1/(kg·m)",
                    yaw.gain / mass,
                    yaw.deviation,
                    yaw_source,
                )
                .how("all that yaw determines; c and Jz cannot be separated"),
            );
        }
        // Physics: no moment of inertia exceeds the sum of the others.
        let yaw_inertia = log_inertia
            .exp()
            .min(0.999 * sum)
            .max(1.001 * (inertia[0].0 - inertia[1].0).abs());
        // Jx + Jy above the class value may come from height, which adds nothing to Jz: a published X8 has 0.36 (Jx +
        // Jy).
        let of_its_class = share * self.class.inertia_ratio.iter().sum::<f64>() * mass * arm * arm;
        let least_inertia = (yaw_inertia / (Z95 * inertia_deviation).exp()).min(of_its_class);
        let flat = Estimate::log_normal(
            "body.inertia_body_kg_m2[2]",
            "inertia, yaw",
            "kg·m²",
            yaw_inertia,
            inertia_deviation,
            Source::LogAndClass,
        );
        values.push(
            Estimate {
                low: least_inertia,
                ..flat
            }
            .how(format!("{share} (Jx + Jy), as flat bodies have"))
            .better("a bifilar pendulum"),
        );
        let ratio = log_ratio.exp();
        let reaction_s = self.reaction(
            told.filter(|_| !self.slow_outputs)
                .map(|yaw| (yaw.reaction, yaw_source)),
            (ratio, inertia_deviation),
            values,
        );
        let moment = Estimate::log_normal(
            "rotors.moment_ratio_m",
            "torque over thrust, c",
            "m",
            ratio,
            ratio_deviation,
            ratio_source,
        );
        // The flight determines c/Jz: if Jz may be smaller, so may c.
        let least = if told.is_some() && ratio_source != Source::Bench {
            moment.low.min(ratio * least_inertia / yaw_inertia)
        } else {
            moment.low
        };
        values.push(
            Estimate { low: least, ..moment }
                .how(match (ratio_source, told.is_some()) {
                    (Source::Bench, true) => {
                        "torque over thrust of the bench, and c/Jz of the flight, by their variances"
                    }
                    (Source::Bench, false) => "torque over thrust of the bench",
                    (Source::Class, _) => "not determined by the flight",
                    _ => "c/Jz of the flight times Jz",
                })
                .better("10 s of yaw steps; a thrust stand with torque"),
        );
        (ratio, yaw_inertia, reaction_s)
    }

    /// c/Jz with a deviation that its halves, and the class, do not contradict.
    pub(super) fn yaw_by_halves(&self, yaw: Yaw, notes: &mut Vec<String>) -> Yaw {
        let Some(halves) = self.halves else { return yaw };
        let both = match halves.yaw {
            [Some(first), Some(second)] if halves.excitation.iter().all(|e| e.rate[2]) => {
                let believed = [first, second].iter().all(|half| half.explained >= EXPLAINED);
                believed.then(|| [first, second].map(|half| (half.gain.ln(), half.deviation)))
            }
            _ => None,
        };
        let mass = self.request.mass_kg;
        let compared = Compared {
            name: "c/Jz",
            whole: yaw.gain.ln(),
            class: default_yaw(&self.class, self.request.arm_m).ln(),
            class_deviation: class::MOMENT_LOG_DEVIATION,
            halves: both,
            // Yaw is fitted with all flights' thrust curve and lag.
            flights: Vec::new(),
            impossible: None,
            score: halves.acceleration(2),
            shown: &|logarithm| format!("{:.3}/(kg·m)", logarithm.exp() / mass),
        };
        let (deviation, _) = compared.checked((yaw.deviation, Source::Log), notes);
        Yaw { deviation, ..yaw }
    }

    /// λ of the document, s; listed together with the inertia of a rotor that it corresponds to at hover. Needs c, m,
    /// and the deviation of ln Jz.
    ///
    /// J_r = 2 c λ f_h/Ω_h. The flight determines c λ/Jz, so that J_r is as good as Jz, whatever c is; Ω_h is that of a
    /// rotor of this thrust at the tip speed of the F550's ([`hover_rotor_speed_rad_s`]), because no log here contains
    /// it.
    pub(super) fn reaction(
        &self,
        reaction: Option<(Reaction, Source)>,
        (moment_ratio, inertia_deviation): (f64, f64),
        values: &mut Vec<Estimate>,
    ) -> f64 {
        const NAME: &str = "yaw torque of rotor acceleration, λ";
        const INERTIA: &str = "inertia of a rotor, J_r";
        const YAW_STEPS: &str = "10 s of yaw steps";
        let hover_n = self.request.mass_kg * GRAVITY / self.rotors as f64;
        let hover_speed = hover_rotor_speed_rad_s(hover_n);
        let inertia = |reaction_s: f64| 2.0 * moment_ratio * reaction_s * hover_n / hover_speed;
        let (reaction, source) = reaction.unwrap_or((Reaction::Unknown, Source::Class));
        let (reaction_s, inertia_of_a_rotor) = match reaction {
            Reaction::Seen {
                value_s,
                deviation_s,
                product_deviation,
            } => {
                let source = if deviation_s < 0.5 * class::REACTION_MOST_S {
                    source
                } else {
                    Source::LogAndClass
                };
                let seen = Estimate::normal("rotors.reaction_s", NAME, "s", value_s, deviation_s, source);
                (
                    Estimate {
                        low: seen.low.max(0.0),
                        ..seen
                    }
                    .how("Jz ṙ = c (X + λ Ẋ); it lowers the error of every other part of the flight that it was not fitted to"),
                    Estimate::log_normal(
                        "rotors.inertia_kg_m2",
                        INERTIA,
                        "kg·m²",
                        inertia(value_s),
                        product_deviation.hypot(inertia_deviation),
                        source,
                    ),
                )
            }
            Reaction::Below(_) | Reaction::Unknown => {
                let (most_s, source, how) = match reaction {
                    Reaction::Below(most_s) => (most_s, Source::Log, "none shows, and more than this would have"),
                    _ => (
                        class::REACTION_MOST_S,
                        Source::Class,
                        "unknown: not determined by this flight; vehicles have up to 0.2 s",
                    ),
                };
                let none = |key, name, unit, most| {
                    let none = Estimate::normal(key, name, unit, 0.0, 0.0, source);
                    Estimate { high: most, ..none }
                };
                (
                    none("rotors.reaction_s", NAME, "s", most_s).how(how),
                    none("rotors.inertia_kg_m2", INERTIA, "kg·m²", inertia(most_s)),
                )
            }
        };
        let value_s = reaction_s.value;
        values.push(reaction_s.better(YAW_STEPS));
        values.push(
            inertia_of_a_rotor
                .how("2 c λ f_h/Ω_h: the meaning of λ, with Ω_h by size; the document has λ")
                .better(YAW_STEPS),
        );
        value_s
    }
}
