//! Units that a mapping may name, and which of them are consistent with the data.

use super::names;

/// What a unit measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dimension {
    One,
    Length,
    Speed,
    Angle,
    AngularRate,
    Acceleration,
    Voltage,
    Current,
    Force,
    Torque,
}

/// Standard gravity, m/s² (exact by definition).
pub(crate) const STANDARD_GRAVITY_M_S2: f64 = 9.806_65;
const DEGREE_RAD: f64 = std::f64::consts::PI / 180.0;

/// Names, factors to SI, dimensions.
const UNITS: [(&str, f64, Dimension); 32] = [
    ("1", 1.0, Dimension::One),
    ("percent", 0.01, Dimension::One),
    ("permille", 0.001, Dimension::One),
    ("u16", 1.0 / 65535.0, Dimension::One),
    ("u8", 1.0 / 255.0, Dimension::One),
    ("m", 1.0, Dimension::Length),
    ("cm", 0.01, Dimension::Length),
    ("mm", 0.001, Dimension::Length),
    ("ft", 0.3048, Dimension::Length),
    ("m/s", 1.0, Dimension::Speed),
    ("cm/s", 0.01, Dimension::Speed),
    ("mm/s", 0.001, Dimension::Speed),
    ("km/h", 1.0 / 3.6, Dimension::Speed),
    ("rad", 1.0, Dimension::Angle),
    ("deg", DEGREE_RAD, Dimension::Angle),
    ("cdeg", 0.01 * DEGREE_RAD, Dimension::Angle),
    ("rad/s", 1.0, Dimension::AngularRate),
    ("deg/s", DEGREE_RAD, Dimension::AngularRate),
    ("rpm", std::f64::consts::TAU / 60.0, Dimension::AngularRate),
    ("m/s2", 1.0, Dimension::Acceleration),
    ("g", STANDARD_GRAVITY_M_S2, Dimension::Acceleration),
    ("mg", 0.001 * STANDARD_GRAVITY_M_S2, Dimension::Acceleration),
    ("V", 1.0, Dimension::Voltage),
    ("cV", 0.01, Dimension::Voltage),
    ("mV", 0.001, Dimension::Voltage),
    ("A", 1.0, Dimension::Current),
    ("cA", 0.01, Dimension::Current),
    ("mA", 0.001, Dimension::Current),
    ("N", 1.0, Dimension::Force),
    ("gf", 0.001 * STANDARD_GRAVITY_M_S2, Dimension::Force),
    ("N.m", 1.0, Dimension::Torque),
    ("N.mm", 0.001, Dimension::Torque),
];

/// Factor to SI and dimension of a unit.
pub(crate) fn unit(name: &str) -> Option<(f64, Dimension)> {
    UNITS
        .iter()
        .find(|(known, _, _)| *known == name)
        .map(|(_, factor, dimension)| (*factor, *dimension))
}

/// All unit names, for messages.
pub(crate) fn unit_names() -> String {
    UNITS.map(|(name, _, _)| name).join(" ")
}

/// Dimension of a canonical column.
pub(crate) fn dimension(column: &str) -> Option<Dimension> {
    Some(match names::unit(column)? {
        "m" => Dimension::Length,
        "m/s" => Dimension::Speed,
        "rad" => Dimension::Angle,
        "rad/s" => Dimension::AngularRate,
        "m/s²" => Dimension::Acceleration,
        "V" => Dimension::Voltage,
        "A" => Dimension::Current,
        "N" => Dimension::Force,
        "N·m" => Dimension::Torque,
        _ => Dimension::One,
    })
}

/// Where the median of the magnitude of a quantity lies for anything that flies on batteries and rotors (20 g to 200 kg): used to
/// choose between the units that a mapping allows.
pub(crate) fn plausible_median(dimension: Dimension) -> Option<std::ops::Range<f64>> {
    match dimension {
        Dimension::Voltage => Some(2.5..120.0),
        // Hover to a free fall of some seconds; at rest 9.81.
        Dimension::Acceleration => Some(4.0..25.0),
        _ => None,
    }
}
