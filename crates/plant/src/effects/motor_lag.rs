//! The lag from static lift to thrust: time constant, its asymmetry, and the quantity that lags.

use super::prelude::*;

/// Share of τ, times (h/τ)² with rows h apart, by which means of a command over the rows mistake a lag: errors of foreign loops at 500 Hz in
/// logs of 50 Hz were 0.09 to 0.24.
const LAG_BETWEEN_ROWS: f64 = 0.25;

/// Row 25 of the catalogue.
pub(super) static TIME_CONSTANT: EffectDeclaration = EffectDeclaration {
    id: "motor-time-constant",
    name: "Motor time constant",
    catalogue_number: Some(25),
    class: EffectClass::Physics,
    equation: "τ f' = g − f,   τ → τ (1 + d)",
    places: &[Place::RotorDynamics],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[
        ParameterDeclaration::size("share", "d", "", "relative error of τ", (-0.6, 1.0), 0.4, 0.4)
            .correcting_by_factors("rotors.thrust_lag_s"),
    ],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR
        .requiring(&[Requirement::Command, Requirement::FrequentCommand])
        .open_between_rows(BetweenRows::OfLag(LAG_BETWEEN_ROWS)),
    excited_by: "fast commands",
    confused_with: &["command-delay", "axial-inflow", "imu-latency"],
    source: "§6; sysid.tools (Eschmann 2024)",
    build: Build::BuiltIn(|setup| {
        Changes::<1>::boxed(setup, |c, [d], _| {
            c.thrust_lag_up_s *= 1.0 + d;
            c.thrust_lag_down_s *= 1.0 + d;
        })
    }),
};

/// Row 26 of the catalogue.
pub(super) static ASYMMETRY: EffectDeclaration = EffectDeclaration {
    id: "lag-asymmetry",
    name: "Asymmetric spin-up and spin-down",
    catalogue_number: Some(26),
    class: EffectClass::Physics,
    equation: "τ (1 − a) while f rises, τ (1 + a) while it falls",
    places: &[Place::RotorDynamics],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "share",
        "a",
        "",
        "asymmetry",
        (-0.3, 0.6),
        0.25,
        0.25,
    )],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::Command, Requirement::FrequentCommand]),
    excited_by: "fast commands",
    confused_with: &["motor-time-constant", "air-density"],
    source: "PX4 motor model: timeConstantUp, timeConstantDown",
    build: Build::BuiltIn(|setup| {
        Changes::<1>::boxed(setup, |c, [a], _| {
            c.thrust_lag_up_s *= 1.0 - a;
            c.thrust_lag_down_s *= 1.0 + a;
        })
    }),
};

/// Row 27 of the catalogue.
pub(super) static SPEED_DOMAIN: EffectDeclaration = EffectDeclaration {
    id: "speed-domain-lag",
    name: "Lag of the speed, not of the thrust",
    catalogue_number: Some(27),
    class: EffectClass::Physics,
    equation: "τ Ω' = Ω_ss − Ω,   f = c_L Ω²",
    places: &[Place::RotorDynamics],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "share",
        "s",
        "",
        "0 thrust lags, 1 speed lags",
        (0.0, 1.0),
        1.0,
        1.0,
    )],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::Command, Requirement::FrequentCommand]),
    excited_by: "large steps of the command",
    confused_with: &["lag-asymmetry", "motor-time-constant"],
    source: "Gazebo motor model",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [s], _| c.speed_domain_share += s)),
};
