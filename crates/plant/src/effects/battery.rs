//! The battery: resistance, relaxation, capacity, charge, and the sensor at its terminals.

use super::prelude::*;

/// Row 36 of the catalogue.
pub(super) static RESISTANCE: EffectDeclaration = EffectDeclaration {
    id: "internal-resistance",
    name: "Internal resistance of the battery",
    catalogue_number: Some(36),
    class: EffectClass::Physics,
    equation: "V = V_oc − (R + d) I",
    places: &[Place::Battery],
    channels: &[VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "added_ohm",
        "d",
        "Ω",
        "added to R_in of the pack",
        (-0.008, 0.08),
        0.015,
        0.015,
    )
    .correcting("battery.internal_resistance_ohm", CorrectionScale::Difference)],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::by(Strategy::BatteryState(AtBattery::Inside)).requiring(&[Requirement::BatteryVoltage]),
    excited_by: "changes of the current",
    confused_with: &["charge-offset", "battery-rc", "cold-battery"],
    source: "§3.2",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.internal_resistance_ohm += d)),
};

/// Row 37 of the catalogue.
pub(super) static RC: EffectDeclaration = EffectDeclaration {
    id: "battery-rc",
    name: "Relaxation of the battery (Thevenin)",
    catalogue_number: Some(37),
    class: EffectClass::Physics,
    equation: "v₁' = (R₁ I − v₁)/T₁,   V = V_oc − R I − v₁",
    places: &[Place::Battery],
    channels: &[VOLTAGE],
    parameters: &[
        ParameterDeclaration::size(
            "resistance_ohm",
            "R₁",
            "Ω",
            "resistance of the pair",
            (0.0, 0.04),
            0.012,
            0.012,
        ),
        ParameterDeclaration::shape("time_s", "T₁", "s", "time constant of the pair", (2.0, 60.0), 15.0),
    ],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::by(Strategy::BatteryState(AtBattery::Inside)).requiring(&[Requirement::BatteryVoltage]),
    excited_by: "steps of the current, the first seconds after take-off",
    confused_with: &["internal-resistance", "battery-capacity"],
    source: "Fig. 1 of the paper, order 1",
    build: Build::BuiltIn(|setup| {
        Changes::<2>::boxed(setup, |c, [r, t], _| {
            c.rc_resistance_ohm += r;
            c.rc_time_s = *t;
        })
    }),
};

/// Row 38 of the catalogue.
pub(super) static CAPACITY: EffectDeclaration = EffectDeclaration {
    id: "battery-capacity",
    name: "Capacity of the battery",
    catalogue_number: Some(38),
    class: EffectClass::Physics,
    equation: "SoC' = −I/(3600 Q (1 + d))",
    places: &[Place::Battery],
    channels: &[VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "share",
        "d",
        "",
        "relative error of the capacity",
        (-0.4, 0.2),
        0.2,
        -0.2,
    )
    .correcting("battery.capacity_ah", CorrectionScale::Share)],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::by(Strategy::BatteryState(AtBattery::Inside)).requiring(&[Requirement::BatteryVoltage]),
    excited_by: "a long discharge",
    confused_with: &["battery-rc", "charge-offset"],
    source: "§3.1; ageing −10 to −30 %",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.capacity_ah *= 1.0 + d)),
};

/// Row 40 of the catalogue.
pub(super) static CHARGE: EffectDeclaration = EffectDeclaration {
    id: "charge-offset",
    name: "Charge at the start",
    catalogue_number: Some(40),
    class: EffectClass::Nuisance,
    equation: "V_oc(SoC₀ + d)",
    places: &[Place::Battery],
    channels: &[VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "charge",
        "d",
        "",
        "added to the charge at the start, fraction",
        (-0.5, 0.5),
        0.25,
        0.2,
    )],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::by(Strategy::Nuisance),
    excited_by: "always; the resting voltage before take-off fixes it",
    confused_with: &["internal-resistance"],
    source: "Eq. 7",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.charge_offset += d)),
};

/// Row 41 of the catalogue.
pub(super) static GAIN: EffectDeclaration = EffectDeclaration {
    id: "voltage-gain",
    name: "Gain of the voltage sensor",
    catalogue_number: Some(41),
    class: EffectClass::SensorFault,
    equation: "V_m = (1 + g) V",
    places: &[Place::Reading],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "share",
        "g",
        "",
        "relative error of the sensor",
        (-0.05, 0.05),
        0.02,
        0.02,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::by(Strategy::BatteryState(AtBattery::Sensor)).requiring(&[Requirement::BatteryVoltage]),
    excited_by: "a wide range of voltage",
    confused_with: &["voltage-offset", "air-density", "dead-zone"],
    source: "ArduPilot BATT_VOLT_MULT",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [g], _| c.voltage_gain += g)),
};

/// Row 41 of the catalogue.
pub(super) static OFFSET: EffectDeclaration = EffectDeclaration {
    id: "voltage-offset",
    name: "Offset of the voltage sensor",
    catalogue_number: Some(41),
    class: EffectClass::SensorFault,
    equation: "V_m = V + o",
    places: &[Place::Reading],
    channels: &[FORCE, MOMENT, VOLTAGE],
    parameters: &[ParameterDeclaration::size(
        "offset_v",
        "o",
        "V",
        "constant error of the sensor",
        (-1.0, 1.0),
        0.3,
        0.3,
    )],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::by(Strategy::BatteryState(AtBattery::Sensor)).requiring(&[Requirement::BatteryVoltage]),
    excited_by: "a wide range of voltage",
    confused_with: &["voltage-gain", "air-density", "dead-zone"],
    source: "ArduPilot BATT_VOLT_MULT",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [o], _| c.voltage_offset_v += o)),
};
