//! Effect of a catalogue entry on a flight of a vehicle: the flight that shows it best, simulated.

use crate::next_flight::{catalogue_of, fly, with_companions};
use rotortwin_jobs::EffectPicture as Question;
use rotortwin_plant::effects::{Catalogue, EffectClass, EffectDocument, EffectInstance};
use rotortwin_scenario::{ConfigError, effect_documents};
use rotortwin_twin::model::{ModelStore, ModelVersion};
use rotortwin_twin::next_flight::{MANOEUVRES, Manoeuvre, Rival};
use rotortwin_twin::sandbox::{EffectPicture, MovedChannel, left, moved};

/// Fixed seed, for reproducible results.
const SEED: u64 = 1;

/// The picture that a question asks for: the effect at its typical values, with those of the question.
///
/// # Errors
/// The model or an effect document cannot be used; see [`picture`].
pub fn of(question: &Question) -> Result<EffectPicture, String> {
    let found = ModelStore::new(&question.models).find(&question.model);
    let version = found.map_err(|error| error.to_string())?.version;
    let documents: Result<Vec<EffectDocument>, ConfigError> =
        question.effects.iter().map(effect_documents::load).collect();
    let version = version.with_documents(&documents.map_err(|error| error.to_string())?);
    let catalogue = catalogue_of(&version)?;
    let mut effect = Rival::parse(&question.effect, &catalogue)?.typical(&catalogue)?;
    effect.parameters.extend(question.parameters.clone());
    picture(&version, &catalogue, &effect, question.flight.as_deref())
}

/// The picture of an effect on a vehicle.
///
/// * `flight`: name of a manoeuvre; if absent, all are flown and the one that shows the effect best is used
///
/// # Errors
/// Unknown effect, parameter, rotor or manoeuvre; a vehicle that cannot fly it.
pub fn picture(
    model: &ModelVersion,
    catalogue: &Catalogue,
    effect: &EffectInstance,
    flight: Option<&str>,
) -> Result<EffectPicture, String> {
    let declaration = effect
        .check(catalogue, model.rotor_count())
        .map_err(|refusal| match refusal.key.as_str() {
            "" => refusal.reason,
            key => format!("{key}: {}", refusal.reason),
        })?;
    let rival = Rival {
        effect: effect.effect.clone(),
        rotor: effect.rotor,
    };
    let complete = with_companions(model, &rival, &rival, catalogue);
    let together_with = complete.effect[model.effect.len()..]
        .iter()
        .map(|effect| effect.label())
        .collect();
    let random = declaration.class == EffectClass::Noise;
    let mut best: Option<(&Manoeuvre, Vec<MovedChannel>)> = None;
    let mut refused = None;
    for manoeuvre in chosen(flight)? {
        match shown(manoeuvre, &complete, catalogue, effect, random) {
            Ok(channels) if best.as_ref().is_none_or(|(_, found)| size(&channels) > size(found)) => {
                best = Some((manoeuvre, channels));
            }
            Ok(_) => {}
            Err(reason) => refused = Some(reason),
        }
    }
    let (manoeuvre, channels) =
        best.ok_or_else(|| refused.unwrap_or_else(|| "no manoeuvre can be flown".to_owned()))?;
    Ok(EffectPicture {
        effect: effect.effect.clone(),
        rotor: effect.rotor,
        parameters: effect.parameters.clone(),
        together_with,
        random,
        flight: manoeuvre.name.to_owned(),
        description: manoeuvre.description.to_owned(),
        duration_s: manoeuvre.duration_s,
        channels,
    })
}

fn chosen(flight: Option<&str>) -> Result<Vec<&'static Manoeuvre>, String> {
    let Some(name) = flight else {
        return Ok(MANOEUVRES.iter().collect());
    };
    let found = MANOEUVRES.iter().find(|manoeuvre| manoeuvre.name == name);
    found.map(|manoeuvre| vec![manoeuvre]).ok_or_else(|| {
        let names: Vec<&str> = MANOEUVRES.iter().map(|manoeuvre| manoeuvre.name).collect();
        format!("unknown manoeuvre `{name}`; expected one of {}", names.join(", "))
    })
}

fn shown(
    manoeuvre: &Manoeuvre,
    model: &ModelVersion,
    catalogue: &Catalogue,
    effect: &EffectInstance,
    random: bool,
) -> Result<Vec<MovedChannel>, String> {
    let hidden = if random { std::slice::from_ref(effect) } else { &[] };
    let log = fly(manoeuvre, model, hidden, SEED)?;
    let found = if random {
        left(&log, model, catalogue)
    } else {
        moved(&log, model, catalogue, effect)
    };
    found.map_err(|error| error.to_string())
}

/// How well channels show an effect: the strongest one over its noise.
fn size(channels: &[MovedChannel]) -> f64 {
    channels.first().map_or(0.0, |channel| channel.rms / channel.noise)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_twin::log::FlightLog;
    use std::collections::BTreeMap;
    use std::path::Path;

    fn f550() -> ModelVersion {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
        ModelVersion::load(&path).unwrap()
    }

    /// Effects that no manoeuvre shows on a hexarotor above the noise, each with why: none.
    const WITHOUT_A_PICTURE: [(&str, &str); 0] = [];

    #[test]
    fn val_every_effect_of_the_catalogue_has_a_picture() {
        let (model, catalogue) = (f550(), Catalogue::built_in());
        let mut flown: BTreeMap<(String, &str), Option<FlightLog>> = BTreeMap::new();
        let mut without = Vec::new();
        for declaration in catalogue.entries() {
            let rival = Rival {
                effect: declaration.id.to_owned(),
                rotor: declaration.per_rotor.then_some(1),
            };
            let effect = rival.typical(&catalogue).unwrap();
            let complete = with_companions(&model, &rival, &rival, &catalogue);
            let random = declaration.class == EffectClass::Noise;
            // A manoeuvre that this vehicle cannot fly shows nothing; one that shows it is enough.
            let mut sizes = MANOEUVRES.iter().map(|manoeuvre| {
                if random {
                    let channels = shown(manoeuvre, &complete, &catalogue, &effect, random);
                    return channels.map_or(0.0, |channels| size(&channels));
                }
                let log = flown
                    .entry((complete.hash(), manoeuvre.name))
                    .or_insert_with(|| fly(manoeuvre, &complete, &[], SEED).ok());
                let channels = log
                    .as_ref()
                    .and_then(|log| moved(log, &complete, &catalogue, &effect).ok());
                channels.map_or(0.0, |channels| size(&channels))
            });
            let found = sizes.find(|size| *size >= 1.0);
            println!("{}: {:.1} times its noise", declaration.id, found.unwrap_or(0.0));
            if found.is_none() {
                without.push(declaration.id);
            }
        }
        assert_eq!(without, WITHOUT_A_PICTURE.map(|(effect, _)| effect));
    }

    #[test]
    fn val_rotor_drag_is_a_line_over_the_speed_with_its_slope() {
        let (model, catalogue) = (f550(), Catalogue::built_in());
        let drag = EffectInstance::new("rotor-drag", &[("drag_n_s_m", 0.25)]);
        let picture = picture(&model, &catalogue, &drag, None).unwrap();
        let forward = picture.channels.iter().find(|one| one.channel == "fx").expect("fx");
        let speed = forward
            .conditions
            .iter()
            .find(|one| one.condition == "forward_speed")
            .expect("speed");
        // a_x = −k_d/m Σ Ω_i/(n Ω_h) v_x: in manoeuvres the mean rotor speed is that of hover, or up to a quarter higher (half as much thrust again).
        let slope = (speed.does.last().unwrap() - speed.does[0]) / (speed.at.last().unwrap() - speed.at[0]);
        let of_hover = slope / (-0.25 / model.vehicle.body.mass_kg);
        assert!((0.97..1.25).contains(&of_hover), "{of_hover}");
        // The rest is due to the rotor speed.
        assert!(speed.explained > 0.7, "{}", speed.explained);
    }
}
