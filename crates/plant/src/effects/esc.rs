//! The electronic speed controller: delay, dead zone, saturation, resistance.

use super::prelude::*;

/// Share of a row by which a delay may be mistaken where noise comes back as a command: errors of foreign loops in logs of 200 and 250 Hz
/// were up to 0.39.
const DELAY_BETWEEN_ROWS: f64 = 0.4;

/// Row 28 of the catalogue.
pub(super) static DELAY: EffectDeclaration = EffectDeclaration {
    id: "command-delay",
    name: "Delay of the command",
    catalogue_number: Some(28),
    class: EffectClass::Physics,
    equation: "u(t − d)",
    places: &[Place::Command],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "delay_s",
        "d",
        "s",
        "age of the command that acts",
        (0.0, 0.03),
        0.01,
        0.01,
    )
    .with_clutter(0.001)
    .correcting("motor.delay_s", CorrectionScale::Whole)],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::by(Strategy::Secants(&[0.5, 1.0, 1.5]))
        .requiring(&[Requirement::Command, Requirement::FrequentCommand])
        .open_between_rows(BetweenRows::OfRow(DELAY_BETWEEN_ROWS)),
    excited_by: "fast commands",
    confused_with: &["motor-time-constant", "imu-latency"],
    source: "ESC and link practice: 2 to 15 ms",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.command_delay_s += d)),
};

/// Row 29 of the catalogue.
pub(super) static DEAD_ZONE: EffectDeclaration = EffectDeclaration {
    id: "dead-zone",
    name: "Dead zone of the ESC",
    catalogue_number: Some(29),
    class: EffectClass::Physics,
    equation: "u_eff = max(u − u₀, 0)",
    places: &[Place::Command],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "duty",
        "u₀",
        "",
        "duty that does nothing, fraction",
        (0.0, 0.05),
        0.02,
        0.02,
    )
    .correcting("rotors.dead_zone", CorrectionScale::Whole)],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::Duty]),
    excited_by: "a wide range of duty",
    confused_with: &["air-density", "voltage-offset", "mass"],
    source: "§2.6",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [u], _| c.dead_zone += u)),
};

/// Row 30 of the catalogue.
pub(super) static SATURATION: EffectDeclaration = EffectDeclaration {
    id: "saturation",
    name: "Saturation of ESC and motor",
    catalogue_number: Some(30),
    class: EffectClass::Physics,
    equation: "u_eff = min(u, 1 − x)",
    places: &[Place::Command],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "lost_duty",
        "x",
        "",
        "part of the duty at its top that adds no thrust, fraction",
        (0.0, 0.3),
        0.15,
        0.15,
    )
    .correcting("rotors.lost_duty", CorrectionScale::Whole)],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::by(Strategy::Secants(&[0.5, 1.0, 2.0])).requiring(&[Requirement::Duty]),
    excited_by: "full-throttle climbs",
    confused_with: &["dead-zone", "esc-resistance"],
    source: "motor bench practice: 85 to 100 %",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [x], _| c.duty_limit -= x)),
};

/// Row 31 of the catalogue.
pub(super) static RESISTANCE: EffectDeclaration = EffectDeclaration {
    id: "esc-resistance",
    name: "Resistance of ESC and motor",
    catalogue_number: Some(31),
    class: EffectClass::Physics,
    equation: "g_i = Eq. 19(u_i, V − R I_i),   I_i = k_P f_i^1.5/V",
    places: &[Place::StaticLift],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "resistance_ohm",
        "R",
        "Ω",
        "resistance in series with each rotor",
        (0.0, 0.1),
        0.04,
        0.04,
    )
    .correcting("rotors.esc_resistance_ohm", CorrectionScale::Whole)],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.requiring(&[Requirement::Duty]),
    excited_by: "a wide range of duty",
    confused_with: &["dead-zone", "air-density"],
    source: "Eqs. 10 and 13",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [r], _| c.esc_resistance_ohm += r)),
};
