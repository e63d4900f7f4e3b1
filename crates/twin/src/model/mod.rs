//! Model versions: a vehicle, the effects that were found missing, and where each of them comes from.
//!
//! ```text
//! vehicle document ─▶ version 0 ─ add effect ─▶ version 1 ─ add effect ─▶ version 2 …      (store)
//!                         │                        │
//!                         └──── differences ───────┘                                     (difference)
//! ```
//!
//! A [`ModelVersion`] is one small self-contained TOML file ([`document`]): vehicle and blades, each effect with
//! parameters, deviations and provenance (which log, which tool, what evidence), and the hash of its parent. It is what
//! comparison, diagnosis, simulator and detector use as "the model". A plain vehicle document is version 0 of itself.
//!
//! A version is identified by its **content hash**: XXH3-128 of the canonical form, the JSON of [`ModelVersion`] with keys in
//! declaration order and numbers in their shortest exact form. Comments, layout and the order of keys in the file do not count;
//! every value does, and so does the parent. It detects change; it is no signature against forgery.
//!
//! Limits: parameters are normal about their value ([`ModelEffect::deviations`], [`Correlation`]); nothing else about their
//! distribution is kept. Nuisances of a flight (rotor biases, charge at take-off, its wind) belong to the log and are not part of a version;
//! that there is a wind to fit is ([`ModelVersion::wind_of_each_flight`]).

pub mod constants;
pub mod detector;
pub mod difference;
pub mod document;
mod flight;
pub mod specification;
pub mod store;
pub mod tolerances;

use std::collections::BTreeMap;

use crate::content_hash::content_hash;
use rotortwin_plant::effects::{Catalogue, EffectDeclaration, EffectDocument, EffectInstance};
use rotortwin_plant::error::Refusal;
use rotortwin_plant::powertrain::blades::BladeSet;
use rotortwin_plant::vehicle::model::VehicleModel;
use rotortwin_scenario::VehicleDocuments;
use serde::{Deserialize, Serialize};

pub use constants::ConstantInterval;
pub use difference::Difference;
pub use store::{ModelStore, StoreError};

/// One version of a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelVersion {
    /// Name of the model: letters, digits, `-`, `_` and `.`.
    pub name: String,
    /// Why this version exists, for people.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// Content hash of the version from which this one was made; absent in version 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<String>,
    /// Effects, in the order in which they were added.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effect: Vec<ModelEffect>,
    /// Correlations of parameters that are far from independent.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub correlation: Vec<Correlation>,
    /// Effects of users that [`ModelVersion::effect`] may name besides those of the catalogue.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effect_document: Vec<EffectDocument>,
    /// How well the constants of the vehicle are known, where that was estimated; a constant without an entry is taken as exact.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub constant: Vec<ConstantInterval>,
    /// Each flight has a steady wind of its own, which is fitted to its log as its charge is; a flight that is simulated has that of its
    /// scenario.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub wind_of_each_flight: bool,
    /// The nominal vehicle.
    pub vehicle: VehicleModel,
    /// The blades of its rotors.
    pub blades: BladeSet,
}

/// `[[effect]]` of a version: the keys of a scenario's `[[effect]]`, with deviations and provenance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelEffect {
    /// Identifier in the catalogue, such as `rotor-drag`.
    pub effect: String,
    /// Rotor, from 1, of an effect of one rotor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotor: Option<usize>,
    /// When the effect begins, s of the flight; from the start if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub onset_s: Option<f64>,
    /// Values by name, in the units of the catalogue.
    pub parameters: BTreeMap<String, f64>,
    /// Standard deviations (1 sigma) by name; a parameter without one is taken as exact.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub deviations: BTreeMap<String, f64>,
    /// Where the values come from.
    pub provenance: Provenance,
}

/// Where an effect comes from. Without dates: the same find gives the same hash.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// How it came into the model.
    pub source: Source,
    /// Program and version that wrote it, such as `rotortwin 0.1.0`.
    pub tool: String,
    /// Natural logarithm of the Bayes factor in favour of the effect.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ln_bayes_factor: Option<f64>,
    /// Posterior probability among the effects of the catalogue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posterior: Option<f64>,
    /// Logs that it was fitted on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub log: Vec<LogReference>,
    /// Errors on data that the fit did not see.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub held_out: Vec<HeldOut>,
}

/// How an effect came into a version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// Somebody gave the values.
    ByHand,
    /// A diagnosis of logs gave them.
    Diagnosis,
}

/// A log, by name and content.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LogReference {
    /// File name, without its folder.
    pub name: String,
    /// Content hash.
    pub hash: String,
}

/// Root-mean-square error of a group of channels on held-out data, before and after the effect was added.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldOut {
    /// Which data, such as `odd blocks` or the name of another log.
    pub data: String,
    /// What is measured, such as `force`.
    pub quantity: String,
    /// Its unit.
    pub unit: String,
    /// Without the effect.
    pub before: f64,
    /// With the effect.
    pub after: f64,
}

/// Correlation coefficient of two parameters, each written `effect.parameter` or `effect#rotor.parameter`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Correlation {
    /// The two parameters.
    pub between: [String; 2],
    /// From −1 to 1.
    pub coefficient: f64,
}

/// Name of this program in provenances.
pub const TOOL: &str = concat!("rotortwin ", env!("CARGO_PKG_VERSION"));

impl Provenance {
    /// Values that somebody gave.
    pub fn by_hand() -> Self {
        Self {
            source: Source::ByHand,
            tool: TOOL.to_owned(),
            ln_bayes_factor: None,
            posterior: None,
            log: Vec::new(),
            held_out: Vec::new(),
        }
    }
}

impl ModelEffect {
    /// `rotor-drag`, or `rotor-thrust-scale#3` for an effect of rotor 3.
    pub fn label(&self) -> String {
        match self.rotor {
            Some(rotor) => format!("{}#{rotor}", self.effect),
            None => self.effect.clone(),
        }
    }

    /// Whether both mean the same term of the model.
    pub fn is_same_term(&self, other: &Self) -> bool {
        self.effect == other.effect && self.rotor == other.rotor
    }
}

impl ModelVersion {
    /// Version 0: only a vehicle.
    pub fn first(name: impl Into<String>, documents: VehicleDocuments) -> Self {
        Self {
            name: name.into(),
            note: String::new(),
            parent: None,
            effect: Vec::new(),
            correlation: Vec::new(),
            effect_document: Vec::new(),
            constant: Vec::new(),
            wind_of_each_flight: false,
            vehicle: documents.vehicle,
            blades: documents.blades,
        }
    }

    /// Content hash: 32 hexadecimal digits.
    pub fn hash(&self) -> String {
        let json = serde_json::to_vec(self).expect("text and finite numbers are JSON");
        content_hash(&json)
    }

    /// Hash of vehicle and blades alone, the `model_hash` of run summaries.
    pub fn vehicle_hash(&self) -> String {
        let json = serde_json::to_vec(&(&self.vehicle, &self.blades)).expect("text and finite numbers are JSON");
        content_hash(&json)
    }

    /// Vehicle and blades.
    pub fn documents(&self) -> VehicleDocuments {
        VehicleDocuments {
            vehicle: self.vehicle.clone(),
            blades: self.blades.clone(),
        }
    }

    /// The effects as the catalogue builds them.
    pub fn instances(&self) -> Vec<EffectInstance> {
        self.effect.iter().map(EffectInstance::from).collect()
    }

    /// The effects that the version may name: those of the catalogue and its own.
    ///
    /// # Errors
    /// A document is not valid, or two effects have one id; the key is that of the version's file.
    pub fn catalogue(&self) -> Result<Catalogue, Refusal> {
        Catalogue::with_documents(&self.effect_document).map_err(|refusal| refusal.under("effect_document"))
    }

    /// The version with effects of users that may be named from now on; one that is there already is replaced.
    #[must_use]
    pub fn with_documents(&self, documents: &[EffectDocument]) -> Self {
        let mut next = self.clone();
        for document in documents {
            match next.effect_document.iter_mut().find(|known| known.id == document.id) {
                Some(known) => known.clone_from(document),
                None => next.effect_document.push(document.clone()),
            }
        }
        next
    }

    /// The version with a wind of its own for each flight that it is compared with, in place of one that it may have for all.
    #[must_use]
    pub fn with_own_winds(&self) -> Self {
        let catalogue = Catalogue::default();
        let is_wind = |id: &str| {
            catalogue
                .find(id)
                .is_some_and(|declared| declared.search.is_steady_wind)
        };
        let mut next = self.clone();
        next.effect.retain(|effect| !is_wind(&effect.effect));
        next.correlation
            .retain(|one| !one.between.iter().any(|key| key.split('.').next().is_some_and(is_wind)));
        next.wind_of_each_flight = true;
        next
    }

    /// True for a vehicle that `vehicle from-log` wrote and whose intervals are not with it: its guesses pass for exact values.
    pub fn lacks_intervals(&self) -> bool {
        self.constant.is_empty() && self.vehicle.description.ends_with(constants::FROM_LOG)
    }

    /// True if the battery's open-circuit voltage over the charge is the common chart, as in every vehicle that was identified from a
    /// log; its intervals list the capacity.
    pub fn guesses_its_chart(&self) -> bool {
        let is_capacity =
            |one: &ConstantInterval| one.key == "battery.capacity_ah" && one.source != constants::Source::Stated;
        self.constant.iter().any(is_capacity)
    }

    /// Says which constants are guesses of the vehicle's class; `None` if there are none.
    pub fn guesses(&self) -> Option<String> {
        if self.lacks_intervals() {
            return Some(format!(
                "{0}: this vehicle was identified from a log, and the intervals of its constants ({0}.intervals.toml) are missing from its folder: all are taken \
                 as exact, even guesses of its class",
                self.name
            ));
        }
        let guessed = self.constant.iter().filter(|c| c.source == constants::Source::Class);
        let names: Vec<&str> = guessed.map(|c| c.name.as_str()).collect();
        (!names.is_empty()).then(|| {
            format!(
                "{}: guessed from vehicles of this class, not measured: {}",
                self.name,
                names.join("; ")
            )
        })
    }

    /// Number of rotors.
    pub fn rotor_count(&self) -> usize {
        self.vehicle.rotor_count()
    }

    /// The version that follows when `effects` are added: terms that exist already take the new values, others go to the end.
    pub fn with_effects(&self, effects: impl IntoIterator<Item = ModelEffect>, note: impl Into<String>) -> Self {
        let mut next = self.clone();
        next.parent = Some(self.hash());
        next.note = note.into();
        for effect in effects {
            let label = effect.label();
            // Correlations with the old values say nothing about the new ones.
            next.correlation
                .retain(|c| !c.between.iter().any(|key| key.starts_with(&format!("{label}."))));
            match next.effect.iter_mut().find(|present| present.is_same_term(&effect)) {
                Some(present) => *present = effect,
                None => next.effect.push(effect),
            }
        }
        next
    }
}

/// The steady wind of a catalogue: what a wind of each flight's own takes the place of.
pub(crate) fn steady_wind(catalogue: &Catalogue) -> Option<&'static EffectDeclaration> {
    catalogue
        .entries()
        .iter()
        .copied()
        .find(|declared| declared.search.is_steady_wind)
}
