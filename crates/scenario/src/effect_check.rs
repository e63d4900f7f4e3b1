//! Checks effects of a scenario against each other and the flight: an effect that can have no influence is rejected.

use crate::scenario_document::ScenarioDocument;
use rotortwin_plant::effects::{Catalogue, Constants, EffectInstance, EffectSet, Requirement, Strategy, Wiring};
use rotortwin_plant::error::Refusal;
use rotortwin_plant::vehicle::mismatch::Size;
use rotortwin_plant::vehicle::model::VehicleModel;
use rotortwin_plant::{STEP_RATE_HZ, nearest_step};

/// Above this many rotor radii, ground effect adds less than a ten-thousandth of the thrust.
const GROUND_REACH_RADII: f64 = 25.0;
/// Number of times on the trajectory at which the height is checked.
const LOOKS: u32 = 2000;

/// Checks every `[[effect]]` of the scenario; errors refer to keys `effect[i]…`.
pub(crate) fn check(document: &ScenarioDocument, vehicle: &VehicleModel, catalogue: &Catalogue) -> Result<(), Refusal> {
    if document.effect.is_empty() {
        return match &document.ground {
            Some(ground) if ground.contact.is_none() => {
                let reason = "the ground cannot have an effect: the scenario has no effect that depends on it, and no `[ground.contact]`";
                Err(Refusal::new("ground", reason))
            }
            _ => Ok(()),
        };
    }
    let nominal = Constants::nominal(vehicle);
    for (i, instance) in document.effect.iter().enumerate() {
        check_one(instance, document, &nominal, Size::of(vehicle), catalogue)
            .map_err(|r| r.under(&format!("effect[{i}]")))?;
    }
    EffectSet::new(catalogue, &document.effect, &nominal, document.seed).map_err(|r| r.under("effect"))?;
    Ok(())
}

fn check_one(
    instance: &EffectInstance,
    document: &ScenarioDocument,
    nominal: &Constants,
    size: Size,
    catalogue: &Catalogue,
) -> Result<(), Refusal> {
    let declaration = instance.check(catalogue, nominal.rotor_count)?;
    let cannot = |key: &str, why: String| Err(Refusal::new(key, format!("this effect cannot have an effect: {why}")));
    if let Some(onset) = instance.onset_s
        && nearest_step(onset) >= document.duration_steps()
    {
        let end = document.duration_steps() as f64 / STEP_RATE_HZ;
        return cannot(
            "onset_s",
            format!("it sets in at {onset} s, the flight ends at {end} s"),
        );
    }
    if !declaration.needs.is_empty() {
        let drag = nominal.linear_drag_kg_s + document.mismatch.magnitudes(size).linear_drag_kg_s;
        let there = document
            .effect
            .iter()
            .any(|e| declaration.needs.contains(&e.effect.as_str()));
        if drag == 0.0 && !there {
            let names = declaration.needs.join(", ");
            return cannot(
                "effect",
                format!("no air force acts on this vehicle; add one of {names}"),
            );
        }
    }
    if let Strategy::Wiring(Wiring::Pair { partner: name }) = declaration.search.strategy
        && let Some(place) = declaration.parameter_index(name)
    {
        let partner = instance.values(declaration)[place];
        let number = partner as usize;
        let good =
            partner.fract() == 0.0 && (1..=nominal.rotor_count).contains(&number) && Some(number) != instance.rotor;
        if !good {
            let reason = format!(
                "expected the number of another rotor, 1 to {}, got {partner}",
                nominal.rotor_count
            );
            return Err(Refusal::new(format!("parameters.{name}"), reason));
        }
    }
    if declaration.catalogue_number.is_some() && declaration.search.requires.contains(&Requirement::HeightAboveGround) {
        let Some(ground) = &document.ground else {
            return cannot("effect", "no ground is in reach; give `ground.down_m`".into());
        };
        let reach = GROUND_REACH_RADII * nominal.rotor_radius_m;
        let height = |look: u32| {
            let time = document.duration_s * f64::from(look) / f64::from(LOOKS);
            ground.down_m - document.trajectory.pose(time).0[2]
        };
        let lowest = (0..=LOOKS).map(height).fold(f64::INFINITY, f64::min);
        if lowest > reach {
            let why = format!("the trajectory stays {lowest:.1} m over the ground, it reaches {reach:.1} m");
            return cannot("effect", why);
        }
    }
    Ok(())
}
