//! Next flight: which manoeuvre would distinguish two effects that the flights so far cannot.
//!
//! ```text
//! manoeuvres (≤ 30 s) ─▶ flown with the model as it stands ─▶ Sensitivity of the whole library ─▶ expected evidence of the pair
//!                                 (by the caller)                                                └▶ the best, as a scenario
//! ```
//! * Expected: with one effect of the pair in the data at its ordinary size, ln of the Bayes factor of that effect against the
//!   other, and against every other candidate of the library, with the clutter that the diagnosis assumes.
//! * A manoeuvre is worth its worse side: whichever of the two is the truth, it must be named.
//!
//! Limits: linear in the effects about the model; the controller is the one of the simulator, so a real vehicle flies the
//! manoeuvre differently, and its evidence differs.

pub mod evidence;
pub mod manoeuvres;

use rotortwin_plant::effects::{Catalogue, EffectInstance, ParameterKind};
use serde::Serialize;

use crate::model::ModelVersion;
use manoeuvres::feels_the_ground;

pub use evidence::{Evidence, Sensitivity};
pub use manoeuvres::{MANOEUVRES, Manoeuvre, scenario_text};

/// An effect of a pair: id, and rotor for effects of one rotor.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Rival {
    /// Id in the catalogue.
    pub effect: String,
    /// Rotor, from 1.
    pub rotor: Option<usize>,
}

impl Rival {
    /// Reads `rotor-drag` or `rotor-thrust-scale#3`; an effect of one rotor without a number means rotor 1.
    ///
    /// # Errors
    /// One sentence: an id that the catalogue does not have, or an invalid rotor.
    pub fn parse(text: &str, catalogue: &Catalogue) -> Result<Self, String> {
        let (id, rotor) = match text.split_once('#') {
            None => (text, None),
            Some((id, number)) => {
                let number = number.parse::<usize>().ok().filter(|n| *n >= 1);
                (
                    id,
                    Some(number.ok_or_else(|| format!("expected a rotor from 1 after #, got `{text}`"))?),
                )
            }
        };
        let declaration = catalogue.find(id).ok_or_else(|| {
            format!(
                "expected the id of an effect (`rotortwin effects` lists them), got `{id}`; nearest: {}",
                catalogue.nearest(id)
            )
        })?;
        let rotor = match (declaration.per_rotor, rotor) {
            (true, rotor) => Some(rotor.unwrap_or(1)),
            (false, None) => None,
            (false, Some(_)) => return Err(format!("{id} belongs to the whole vehicle, got `{text}`")),
        };
        Ok(Self {
            effect: id.to_owned(),
            rotor,
        })
    }

    /// Two effects that a flight of this model could distinguish.
    ///
    /// # Errors
    /// One sentence: as for [`Rival::parse`], a rotor that the vehicle does not have, or one effect twice.
    pub fn pair(between: &[String; 2], model: &ModelVersion, catalogue: &Catalogue) -> Result<[Self; 2], String> {
        let [first, second] = between;
        let pair = [Self::parse(first, catalogue)?, Self::parse(second, catalogue)?];
        let rotors = model.rotor_count();
        if let Some(absent) = pair
            .iter()
            .find(|rival| rival.rotor.is_some_and(|rotor| rotor > rotors))
        {
            return Err(format!(
                "expected rotors 1 to {rotors} of {}, got {}",
                model.name,
                absent.label()
            ));
        }
        if pair[0] == pair[1] {
            return Err(format!("expected two different effects, got {} twice", pair[0].label()));
        }
        Ok(pair)
    }

    /// `rotor-drag`, `rotor-thrust-scale#3`.
    pub fn label(&self) -> String {
        match self.rotor {
            Some(rotor) => format!("{}#{rotor}", self.effect),
            None => self.effect.clone(),
        }
    }

    /// The effect at its ordinary size.
    ///
    /// # Errors
    /// The catalogue does not have it.
    pub fn typical(&self, catalogue: &Catalogue) -> Result<EffectInstance, String> {
        let declaration = catalogue
            .find(&self.effect)
            .ok_or_else(|| format!("no effect `{}`", self.effect))?;
        Ok(EffectInstance {
            effect: self.effect.clone(),
            rotor: self.rotor,
            onset_s: None,
            parameters: declaration
                .parameters
                .iter()
                .filter(|p| p.kind == ParameterKind::Shape || p.typical != 0.0)
                .map(|p| (p.name.to_owned(), p.typical))
                .collect(),
        })
    }
}

/// A manoeuvre with its expected evidence.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
#[schema(as = ProposedManoeuvre)]
pub struct Proposal {
    /// Name of the manoeuvre.
    pub manoeuvre: String,
    /// In words.
    pub description: String,
    /// s.
    pub duration_s: f64,
    /// Evidence if the first effect is in the data.
    pub first: Evidence,
    /// Evidence if the second effect is in the data.
    pub second: Evidence,
}

impl Proposal {
    /// ln Bayes factor on the worse side, against the pair's other effect and all other candidates.
    pub fn worth(&self) -> f64 {
        self.first.worth().min(self.second.worth())
    }

    /// ln Bayes factor within the pair on the worse side.
    pub fn between(&self) -> f64 {
        self.first.against_other.min(self.second.against_other)
    }
}

/// All manoeuvres for a pair, best first. `sensitivities` are in the order of [`MANOEUVRES`]; `None` where the flight failed.
///
/// # Errors
/// The pair is not in the library.
pub fn propose(sensitivities: &[Option<Sensitivity>], first: &Rival, second: &Rival) -> Result<Vec<Proposal>, String> {
    let mut proposals = Vec::new();
    for (manoeuvre, sensitivity) in MANOEUVRES.iter().zip(sensitivities) {
        let Some(sensitivity) = sensitivity else { continue };
        // Nobody flies into the ground's reach for less than an effect of the ground itself.
        let at_ground = [first, second].iter().any(|rival| feels_the_ground(&rival.effect));
        if manoeuvre.ground_down_m().is_some() && !at_ground {
            continue;
        }
        proposals.push(Proposal {
            manoeuvre: manoeuvre.name.to_owned(),
            description: manoeuvre.description.to_owned(),
            duration_s: manoeuvre.duration_s,
            first: sensitivity.expected(first, second)?,
            second: sensitivity.expected(second, first)?,
        });
    }
    proposals.sort_by(|a, b| b.worth().total_cmp(&a.worth()));
    Ok(proposals)
}

/// What must be in the model for one of the pair to act at all: wind needs a drag.
pub fn companions(pair: [&Rival; 2], model: &ModelVersion, catalogue: &Catalogue) -> Vec<EffectInstance> {
    let mut found: Vec<EffectInstance> = Vec::new();
    for rival in pair {
        let Some(needs) = catalogue
            .find(&rival.effect)
            .map(|d| d.needs)
            .filter(|needs| !needs.is_empty())
        else {
            continue;
        };
        let there = |id: &str| {
            model.effect.iter().any(|e| e.effect == id)
                || found.iter().any(|e| e.effect == id)
                || pair.iter().any(|r| r.effect == id)
        };
        if needs.iter().any(|id| there(id)) {
            continue;
        }
        let companion = needs.first().map(|id| Rival {
            effect: (*id).to_owned(),
            rotor: None,
        });
        found.extend(companion.and_then(|c| c.typical(catalogue).ok()));
    }
    found
}
