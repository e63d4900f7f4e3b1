//! Drag-to-lift ratio of one rotor: a propeller of another pitch or make, or a blade whose tip is chipped.
//!
//! The rotor gives the thrust of the model and another drag torque with it:
//!
//! ```text
//! M_z,i = s_i (c_D/c_L) (1 + d) f_i,   s_i = ±1: sense of rotation
//! ```
//!
//! A tangential tilt t_a of the same rotor turns the vehicle in proportion to the same thrust, l_i t_a f_i, and pushes it sideways with
//! t_a f_i as well. So the yaw torque alone, without an accelerometer or beside a level that is off by t_a f_i/(m g), does not
//! distinguish the two: d (c_D/c_L) = s_i l_i t_a, 0.1 of a usual ratio being a third of a degree. The force does.
//!
//! Not in it: the power that another drag torque draws from the battery.

use super::prelude::*;

/// Row 62 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "rotor-moment-ratio",
    name: "Drag-to-lift ratio of one rotor",
    catalogue_number: Some(62),
    class: EffectClass::Physics,
    equation: "c_D,i/c_L,i → (1 + d) c_D,i/c_L,i",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[ParameterDeclaration::size(
        "share",
        "d",
        "",
        "relative error of the rotor's c_D/c_L",
        (-0.4, 0.4),
        0.1,
        0.1,
    )],
    per_rotor: true,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "yaw and manoeuvres",
    confused_with: &["rotor-tilt-tangential", "moment-ratio", "reversed-spin"],
    source: "Eq. 36, with a ratio of its own for each rotor",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], i| c.moment_ratio_m[i] *= 1.0 + d)),
};
