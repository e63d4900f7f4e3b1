//! How exact a user says that a vehicle document is: intervals of its constants, for vehicles that no log identified.
//!
//! Without them every constant is taken as exact but for the clutter of the catalogue (0.4 % of the mass at 95 %), which is far less than
//! what a scale, a ruler and a bifilar pendulum give. A constant that is known to ± p has the prior N(0, (p/1.96)²) of its relative
//! error, as one that was identified from a log ([`crate::estimation`]).
//!
//! In: a vehicle and half widths. Out: the text of `NAME.intervals.toml`. Limits: independent of each other, normal.

use rotortwin_plant::vehicle::model::VehicleModel;
use serde::Serialize;

use super::constants::{self, ConstantInterval, Source};

/// Half widths of 95 % intervals; a constant without one stays as exact as the catalogue takes it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tolerances {
    /// Share of the mass.
    pub mass: Option<f64>,
    /// Share of each moment of inertia.
    pub inertia: Option<f64>,
    /// Share of the thrust of all rotors.
    pub thrust: Option<f64>,
    /// Share of the mean thrust by which one rotor may differ from the others.
    pub rotors: Option<f64>,
    /// Share of the ratio of torque to thrust.
    pub torque_ratio: Option<f64>,
    /// Share of the length of the arms.
    pub arms: Option<f64>,
    /// Share of the lag of the thrust.
    pub lag: Option<f64>,
    /// Share of the capacity.
    pub capacity: Option<f64>,
    /// Share of the internal resistance.
    pub resistance: Option<f64>,
    /// Place of the centre of mass, forward and to the right, m.
    pub centre_of_mass_m: Option<f64>,
}

/// `NAME.intervals.toml`.
#[derive(Serialize)]
struct File<'a> {
    vehicle: &'a str,
    logs: [String; 0],
    value: &'a [ConstantInterval],
}

impl Tolerances {
    /// The intervals of a vehicle's constants.
    pub fn intervals(&self, vehicle: &VehicleModel) -> Vec<ConstantInterval> {
        let shares = [
            (self.mass, &["body.mass_kg"][..]),
            (
                self.inertia,
                &[
                    "body.inertia_body_kg_m2[0]",
                    "body.inertia_body_kg_m2[1]",
                    "body.inertia_body_kg_m2[2]",
                ],
            ),
            (self.thrust, &["rotors.thrust_level"]),
            (self.torque_ratio, &["rotors.moment_ratio_m"]),
            (self.arms, &["rotors.arm_m"]),
            (self.lag, &["rotors.thrust_lag_s"]),
            (self.capacity, &["battery.capacity_ah"]),
            (self.resistance, &["battery.internal_resistance_ohm"]),
        ];
        let mut all = Vec::new();
        for (share, keys) in shares {
            for key in keys {
                if let (Some(share), Some((name, unit, value))) = (share, constants::named(vehicle, key)) {
                    all.push(stated(key, (name, unit), value, share * value.abs()));
                }
            }
        }
        if let Some(share) = self.rotors {
            let name = "thrust of one rotor over the mean of all, less 1";
            all.push(stated("rotors.thrust_scale", (name, ""), 0.0, share));
        }
        if let Some(distance) = self.centre_of_mass_m {
            for (axis, name) in ["centre of mass, forward", "centre of mass, to the right"]
                .into_iter()
                .enumerate()
            {
                let key = format!("body.centre_of_mass_m[{axis}]");
                all.push(stated(&key, (name, "m"), 0.0, distance));
            }
        }
        all
    }
}

/// The file of these intervals, to be written beside the document of `vehicle`.
///
/// # Panics
/// Never: names and finite numbers are TOML.
pub fn file(vehicle: &str, value: &[ConstantInterval]) -> String {
    let logs = [];
    let text = toml::to_string_pretty(&File { vehicle, logs, value }).expect("names and finite numbers are TOML");
    format!(
        "# How exact {vehicle} is, by whoever wrote it: 95 % intervals. A value that is changed there is exact from then on.\n{text}"
    )
}

fn stated(key: &str, named: (&str, &str), value: f64, half_width: f64) -> ConstantInterval {
    ConstantInterval::about(key, named, value, half_width, Source::Stated)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ModelVersion;
    use std::path::Path;

    #[test]
    fn regress_what_is_stated_is_read_beside_the_vehicle() {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let folder = tempfile::tempdir().unwrap();
        let text = std::fs::read_to_string(config.join("vehicles/f550.toml")).unwrap();
        let blades = config.join("blades").canonicalize().unwrap();
        let path = folder.path().join("own.toml");
        std::fs::write(&path, text.replace("../blades", &blades.to_string_lossy())).unwrap();
        let plain = ModelVersion::load(&path).unwrap();
        let tolerances = Tolerances {
            mass: Some(0.01),
            inertia: Some(0.05),
            rotors: Some(0.02),
            arms: Some(0.005),
            centre_of_mass_m: Some(0.002),
            ..Tolerances::default()
        };
        let values = tolerances.intervals(&plain.vehicle);
        std::fs::write(folder.path().join("own.intervals.toml"), file("own.toml", &values)).unwrap();
        let read = ModelVersion::load(&path).unwrap();
        assert_eq!(read.constant, values);
        assert_eq!(values.len(), 1 + 3 + 1 + 1 + 2);
        let mass = &values[0];
        assert!((mass.high / plain.vehicle.body.mass_kg - 1.01).abs() < 1e-12);
        // Only what an identification wrote is a guess.
        assert_eq!(read.guesses(), None);
        assert!(!read.guesses_its_chart());
    }
}
