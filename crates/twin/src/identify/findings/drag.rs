//! Drag of the body and of the rotors.

use super::Findings;
use crate::Z95;
use crate::identify::class;
use crate::identify::estimate::Estimate;
use crate::identify::slow::{self, Drag};
use crate::model::constants::Source;

/// The manoeuvre from which the drag could be identified.
const STRAIGHT_RUN: &str = "a straight run at 4 m/s or more, there and back, with velocity in the log";

/// The drag of climbs must surely be below this share of the drag along the body for the difference to be attributed to
/// the rotors. A thrust curve fitted to the same flight can absorb half of a drag that acts along all axes.
const MOST_CLIMB_DRAG_SHARE: f64 = 0.3;

impl Findings<'_> {
    /// k/m of the body, along all axes, and k_d/m of the rotors, across theirs, 1/s.
    pub(super) fn drag(&self, values: &mut Vec<Estimate>, notes: &mut Vec<String>) -> (f64, f64) {
        let mass = self.request.mass_kg;
        let one = match slow::drag(self.grids) {
            Drag::Measured(k, deviation) => {
                if let Some((up, up_deviation)) = slow::drag_in_climbs(self.grids, &self.fitted.curve)
                    && up + Z95 * up_deviation < MOST_CLIMB_DRAG_SHARE * k
                {
                    let body = up.max(0.0);
                    let estimate = |key, name, value: f64, deviation: f64| {
                        let normal = Estimate::normal(key, name, "kg/s", value * mass, deviation * mass, Source::Log);
                        Estimate {
                            low: normal.low.max(0.0),
                            ..normal
                        }
                    };
                    values.push(
                        estimate("body.linear_drag_kg_s", "drag, k", body, up_deviation)
                            .how(format!("lift over the speed of climb, below 1 Hz; k/m = {up:.3} 1/s")),
                    );
                    values.push(
                        estimate(
                            "rotors.drag_kg_s",
                            "drag of the rotors, k_d",
                            k - body,
                            deviation.hypot(up_deviation),
                        )
                        .how(format!(
                            "force along the body over speed, below 1 Hz, of {k:.3} 1/s, less that"
                        )),
                    );
                    return (body, k - body);
                }
                values.push(
                    Estimate::normal(
                        "body.linear_drag_kg_s",
                        "drag, k",
                        "kg/s",
                        k * mass,
                        deviation * mass,
                        Source::Log,
                    )
                    .how(format!("force along the body over speed, below 1 Hz; k/m = {k:.3} 1/s")),
                );
                k
            }
            Drag::Weak(k, deviation, reason) if k.max(0.0) + Z95 * deviation < self.class.drag_per_s => {
                let (value, most) = (k.max(0.0), k.max(0.0) + Z95 * deviation);
                notes.push(format!(
                    "drag is less than that of its class: {reason}, and k/m is below {most:.3} 1/s, where the class has {:.3} 1/s",
                    self.class.drag_per_s
                ));
                let estimate = Estimate::normal(
                    "body.linear_drag_kg_s",
                    "drag, k",
                    "kg/s",
                    value * mass,
                    deviation * mass,
                    Source::Log,
                );
                values.push(
                    Estimate {
                        low: estimate.low.max(0.0),
                        ..estimate
                    }
                    .how(format!("{reason}: an upper bound; k/m is below {most:.3} 1/s"))
                    .better(STRAIGHT_RUN),
                );
                value
            }
            Drag::Weak(_, _, reason) | Drag::Untold(reason) => {
                notes.push(format!(
                    "drag is not determined: {reason}; the class default is written"
                ));
                let k = self.class.drag_per_s;
                values.push(
                    Estimate::log_normal(
                        "body.linear_drag_kg_s",
                        "drag, k",
                        "kg/s",
                        k * mass,
                        class::DRAG_LOG_DEVIATION,
                        Source::Class,
                    )
                    .how(reason)
                    .better(STRAIGHT_RUN),
                );
                k
            }
        };
        (one, 0.0)
    }
}
