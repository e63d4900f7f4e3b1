//! Thrust of one rotor: a damaged or foreign blade, a worn motor, or what propellers and motors differ by as they are sold.
//!
//! A loss is damage only where it is larger than that. At one duty, thrust goes about with the square of the motor's speed constant, so 1 %
//! of that makes 2 % of thrust; the smallest damage of the paper's Table 1 loses 3.1 %. A rotor that gives more than the model is no damaged one.

use super::declaration::Tolerance;
use super::prelude::*;

const TOLERANCE: Tolerance = Tolerance {
    usual: 0.02,
    within: "no more than propellers and motors of one batch differ by",
    below: "a damaged or worn blade, or another propeller or motor",
    above: "more than the model has: another propeller or motor, no damage",
    // The clutter of this size.
    condition: "the interval holds if the other rotors are as even as the model takes them, 0.1 % unless its document says more",
};

/// Row 23 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "rotor-thrust-scale",
    name: "Thrust of one rotor",
    catalogue_number: Some(23),
    class: EffectClass::Physics,
    equation: "f_i → (1 + s) f_i",
    places: &[Place::StaticLift],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "share",
        "s",
        "",
        "relative error of the static lift",
        (-0.3, 0.1),
        0.05,
        -0.05,
    )
    .correcting("rotors.thrust_scale", CorrectionScale::Whole)
    .with_tolerance(TOLERANCE)],
    per_rotor: true,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.in_trim(TrimChange::RotorThrust),
    excited_by: "always",
    confused_with: &["centre-of-mass", "rotor-lift-bias"],
    source: "Table 1, blades b, c, d; Eq. 19",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [s], i| c.rotor_gain[i] *= 1.0 + s)),
};
