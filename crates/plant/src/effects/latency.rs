//! Latencies: readings that are older than their time stamp.

use super::prelude::*;

/// Row 48 of the catalogue.
pub(super) static OF_IMU: EffectDeclaration = EffectDeclaration {
    id: "imu-latency",
    name: "Latency of the IMU",
    catalogue_number: Some(48),
    class: EffectClass::TimingFault,
    equation: "(a, ω)(t − d)",
    places: &[Place::Timing],
    channels: &[FORCE, MOMENT, VELOCITY, ATTITUDE],
    parameters: &[
        ParameterDeclaration::size("delay_s", "d", "s", "age of the reading", (0.0, 0.03), 0.006, 0.006)
            .with_clutter(0.001),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::by(Strategy::Secants(&[0.5, 1.0, 1.5])).requiring(&[Requirement::FrequentCommand]),
    excited_by: "fast motion",
    confused_with: &["command-delay", "attitude-latency", "motor-time-constant"],
    source: "filters and buses: 2 to 10 ms",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.imu_latency_s += d)),
};

/// Row 49 of the catalogue.
pub(super) static OF_ATTITUDE: EffectDeclaration = EffectDeclaration {
    id: "attitude-latency",
    name: "Latency of the attitude",
    catalogue_number: Some(49),
    class: EffectClass::TimingFault,
    equation: "η(t − d)",
    places: &[Place::Timing],
    channels: &[VELOCITY, ATTITUDE],
    parameters: &[
        ParameterDeclaration::size("delay_s", "d", "s", "age of the reading", (0.0, 0.06), 0.012, 0.012)
            .with_clutter(0.001),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "body rates",
    confused_with: &["imu-latency"],
    source: "estimators: 5 to 20 ms",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.attitude_latency_s += d)),
};

/// Row 50 of the catalogue.
pub(super) static OF_VELOCITY: EffectDeclaration = EffectDeclaration {
    id: "velocity-latency",
    name: "Latency of the velocity",
    catalogue_number: Some(50),
    class: EffectClass::TimingFault,
    equation: "v(t − d)",
    places: &[Place::Timing],
    channels: &[VELOCITY, POSITION],
    parameters: &[
        ParameterDeclaration::size("delay_s", "d", "s", "age of the reading", (0.0, 0.4), 0.08, 0.08)
            .with_clutter(0.001),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "acceleration",
    confused_with: &["position-latency"],
    source: "PX4 EKF2_GPS_DELAY: 50 to 200 ms",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.velocity_latency_s += d)),
};

/// Row 51 of the catalogue.
pub(super) static OF_POSITION: EffectDeclaration = EffectDeclaration {
    id: "position-latency",
    name: "Latency of the position",
    catalogue_number: Some(51),
    class: EffectClass::TimingFault,
    equation: "p(t − d)",
    places: &[Place::Timing],
    channels: &[POSITION],
    parameters: &[
        ParameterDeclaration::size("delay_s", "d", "s", "age of the reading", (0.0, 0.4), 0.08, 0.08)
            .with_clutter(0.001),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::LINEAR,
    excited_by: "speed",
    confused_with: &["velocity-latency"],
    source: "GNSS receivers: 50 to 200 ms",
    build: Build::BuiltIn(|setup| Changes::<1>::boxed(setup, |c, [d], _| c.position_latency_s += d)),
};
