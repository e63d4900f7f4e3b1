//! A model version as the vehicle assumed by the detectors: those of its effects for which their configuration has a
//! parameter.
//!
//! The detectors know mass, principal inertia, friction of Eq. 1, rotor positions about the centre of mass, c_D/c_L, one lag and
//! one lift polynomial for all rotors. Constants of these kinds are folded into a vehicle document; every effect that
//! does not change that document is reported as ignored.

use rotortwin_plant::effects::{Catalogue, Constants, EffectInstance, EffectSet};
use rotortwin_plant::error::Refusal;
use rotortwin_plant::vehicle::model::{Layout, ListedRotor, SpinDirection};
use rotortwin_scenario::VehicleDocuments;

use super::ModelVersion;

/// A vehicle for the detectors.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorVehicle {
    /// The vehicle with the effects folded in.
    pub documents: VehicleDocuments,
    /// Effects that it holds, by label.
    pub carried: Vec<String>,
    /// Effects that it cannot hold.
    pub not_carried: Vec<String>,
}

impl ModelVersion {
    /// The version in the form that the detectors can assume.
    ///
    /// # Errors
    /// The effects together yield an invalid vehicle.
    pub fn for_detectors(&self) -> Result<DetectorVehicle, Refusal> {
        let nominal = self.documents();
        let (mut carried, mut not_carried) = (Vec::new(), Vec::new());
        let instances = self.instances();
        let catalogue = self.catalogue()?;
        for (effect, instance) in self.effect.iter().zip(&instances) {
            let alone = folded(&nominal, &catalogue, std::slice::from_ref(instance));
            // An effect that cannot act alone, such as wind without drag, has no constants of its own.
            let list = if alone.is_ok_and(|documents| documents != nominal) {
                &mut carried
            } else {
                &mut not_carried
            };
            list.push(effect.label());
        }
        Ok(DetectorVehicle {
            documents: folded(&nominal, &catalogue, &instances)?,
            carried,
            not_carried,
        })
    }
}

fn folded(
    nominal: &VehicleDocuments,
    catalogue: &Catalogue,
    instances: &[EffectInstance],
) -> Result<VehicleDocuments, Refusal> {
    let before = Constants::nominal(&nominal.vehicle);
    let set = EffectSet::new(catalogue, instances, &before, 0)?;
    let after = *set.constants();
    let mut documents = nominal.clone();
    let body = &mut documents.vehicle.body;
    body.mass_kg = after.mass_kg;
    for axis in 0..3 {
        body.inertia_body_kg_m2[axis] = after.inertia_body_kg_m2[axis][axis];
    }
    body.linear_drag_kg_s = after.linear_drag_kg_s;
    body.angular_drag_nms = after.angular_drag_nms;
    if (after.thrust_lag_up_s, after.thrust_lag_down_s) != (before.thrust_lag_up_s, before.thrust_lag_down_s) {
        documents.vehicle.rotors.thrust_lag_s = 0.5 * (after.thrust_lag_up_s + after.thrust_lag_down_s);
    }
    let moved = after.centre_of_mass_m != before.centre_of_mass_m
        || after.moment_ratio_m != before.moment_ratio_m
        || after.rotor_spin != before.rotor_spin;
    if moved {
        let rotor = (0..after.rotor_count)
            .map(|i| ListedRotor {
                number: i as u32 + 1,
                position_body_m: [0, 1, 2]
                    .map(|axis| after.rotor_position_body[i][axis] - after.centre_of_mass_m[axis]),
                spin: if after.rotor_spin[i] > 0.0 {
                    SpinDirection::Ccw
                } else {
                    SpinDirection::Cw
                },
                moment_ratio_m: after.moment_ratio_m[i],
            })
            .collect();
        documents.vehicle.rotors.layout = Layout::List { rotor };
    }
    // One polynomial serves all rotors, so only a factor that they share can be carried.
    let gains = &after.rotor_gain[..after.rotor_count];
    if gains.iter().all(|gain| *gain == gains[0]) && gains[0] != before.rotor_gain[0] {
        let name = documents.vehicle.rotors.nominal_blade.clone();
        if let Some(blade) = documents.blades.blade.get_mut(&name) {
            blade.coefficients = blade.coefficients.map(|a| a * gains[0]);
        }
    }
    documents.check()?;
    Ok(documents)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::specification::effect_by_hand;

    #[test]
    fn val_constants_are_folded_and_the_rest_is_named() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
        let first = ModelVersion::load(path).unwrap();
        let by_hand = |effect: &str, rotor, parameters: &[&str]| {
            let parameters: Vec<String> = parameters.iter().map(|&p| p.to_owned()).collect();
            effect_by_hand(effect, rotor, None, &parameters).unwrap()
        };
        let version = first.with_effects(
            [
                by_hand("mass", None, &["share=0.1"]),
                by_hand("rotor-drag", None, &["drag_n_s_m=0.25"]),
                by_hand("rotor-thrust-scale", Some(3), &["share=-0.05"]),
            ],
            "",
        );
        let vehicle = version.for_detectors().unwrap();
        assert_eq!(vehicle.carried, ["mass"]);
        assert_eq!(vehicle.not_carried, ["rotor-drag", "rotor-thrust-scale#3"]);
        // Rounding of one product.
        assert!((vehicle.documents.vehicle.body.mass_kg - 1.1 * 1.55).abs() < 1e-12);
        assert_eq!(vehicle.documents.blades, first.blades);
    }
}
