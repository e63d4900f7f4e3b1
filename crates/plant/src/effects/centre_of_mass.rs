//! Centre of mass that is not where the vehicle document has it.

use super::prelude::*;

/// Row 18 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "centre-of-mass",
    name: "Centre of mass",
    catalogue_number: Some(18),
    class: EffectClass::Physics,
    equation: "M = Σ (l_i − c) × f_i n_i",
    places: &[Place::MassProperties],
    channels: &[MOMENT],
    parameters: &[
        ParameterDeclaration::size("forward_m", "c_x", "m", "offset forward", (-0.02, 0.02), 0.008, 0.008)
            .correcting("body.centre_of_mass_m[0]", CorrectionScale::Whole),
        ParameterDeclaration::size(
            "right_m",
            "c_y",
            "m",
            "offset to the right",
            (-0.02, 0.02),
            0.008,
            -0.005,
        )
        .correcting("body.centre_of_mass_m[1]", CorrectionScale::Whole),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR.in_trim(TrimChange::Balance),
    excited_by: "always",
    confused_with: &["rotor-thrust-scale", "rotor-interference"],
    source: "Eq. 6",
    build: Build::BuiltIn(|setup| {
        Changes::<2>::boxed(setup, |c, [x, y], _| {
            c.centre_of_mass_m[0] += x;
            c.centre_of_mass_m[1] += y;
        })
    }),
};
