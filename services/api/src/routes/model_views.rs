//! Models and their versions as shown in responses.

use crate::library::versions::StoredModel;
use crate::problem::Problem;
use rotortwin_twin::model::difference::{self, Difference};
use rotortwin_twin::model::{ModelEffect, ModelVersion, Source};
use serde::Serialize;
use utoipa::ToSchema;

/// A model with all its versions and branches.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ModelHistory {
    /// Name to use in submissions.
    name: String,
    /// True if its versions are stored; otherwise it is a vehicle or a single version of the library, which would become version 0.
    begun: bool,
    /// Name of the vehicle.
    vehicle: String,
    /// Number of its rotors.
    rotors: usize,
    /// Ordered by name.
    branches: Vec<BranchView>,
    /// Ordered by number.
    versions: Vec<VersionView>,
}

/// A branch of a model.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct BranchView {
    /// `main`, or the name it was given.
    name: String,
    /// Its version.
    version: u32,
    /// Content hash of that version: the `If-Match` of the next change.
    hash: String,
}

/// One version of a model.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct VersionView {
    /// Number, from 0, over all branches.
    version: u32,
    /// `f550@v1`: the name to use in submissions.
    label: String,
    /// Content hash.
    pub(crate) hash: String,
    /// Number of the version that it was made from.
    parent: Option<u32>,
    /// Reason for the version, a note for readers.
    note: String,
    /// Number of effects and keys that differ from the parent.
    changed: Vec<String>,
    /// All its effects, in the order in which they were added.
    effects: Vec<EffectView>,
    /// When it was made, ms since 1970, UTC; absent if it is not stored yet.
    made_ms: Option<i64>,
}

/// An effect of a version.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct EffectView {
    /// Id in the catalogue.
    effect: String,
    /// Rotor, from 1, of an effect of one rotor.
    rotor: Option<usize>,
    /// Onset, s of the flight.
    onset_s: Option<f64>,
    /// `rotor-drag`, `rotor-thrust-scale#3`.
    label: String,
    /// `by-hand`, `diagnosis`.
    source: &'static str,
    /// Its values.
    parameters: Vec<ParameterView>,
    /// Natural logarithm of the Bayes factor in favour of it.
    ln_bayes_factor: Option<f64>,
    /// Posterior probability among the effects of the catalogue.
    posterior: Option<f64>,
    /// Names of the logs that it was fitted to.
    logs: Vec<String>,
    /// Errors on data that the fit did not see.
    held_out: Vec<HeldOutView>,
}

/// A value of an effect.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ParameterView {
    /// Name as in the catalogue, with its unit at the end.
    name: String,
    /// In that unit.
    value: f64,
    /// Standard deviation; absent if the value is taken as exact.
    deviation: Option<f64>,
}

/// Error on data that a fit did not see, before and after its effect was added.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct HeldOutView {
    /// Which data.
    data: String,
    /// `force`, `torque`, `voltage`.
    quantity: String,
    /// Its unit.
    unit: String,
    /// Without the effect.
    before: f64,
    /// With the effect.
    after: f64,
}

/// What differs between two versions.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct DifferenceView {
    /// Before.
    from: String,
    /// After.
    to: String,
    /// Parameters of effects that were added, removed or changed.
    parameters: Vec<ParameterChangeView>,
    /// Keys of vehicle and blades that changed.
    keys: Vec<KeyChangeView>,
}

/// One parameter of one effect.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ParameterChangeView {
    /// `rotor-drag`, `rotor-thrust-scale#3`.
    effect: String,
    /// Name in the catalogue.
    parameter: String,
    /// Absent if it is new.
    before: Option<ValueView>,
    /// Absent if it was removed.
    after: Option<ValueView>,
}

/// Value and standard deviation.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ValueView {
    value: f64,
    /// Absent if the value is taken as exact.
    deviation: Option<f64>,
}

/// One key of the vehicle or of its blades.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct KeyChangeView {
    /// `vehicle.body.mass_kg`.
    key: String,
    /// TOML; absent if it is new.
    before: Option<String>,
    /// TOML; absent if it was removed.
    after: Option<String>,
}

/// Result of an addition.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct AddedVersion {
    /// Name of the model.
    pub(crate) model: String,
    /// Branch that now points to the version.
    pub(crate) branch: String,
    /// The new version.
    pub(crate) version: VersionView,
    /// What changed since the previous version.
    pub(crate) difference: DifferenceView,
}

/// Result of an undo. No version is deleted: a branch can be made at the one left behind.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct UndoneVersion {
    /// Name of the model.
    pub(crate) model: String,
    /// Branch that was moved back.
    pub(crate) branch: String,
    /// Number of the version that it pointed to before.
    pub(crate) left: u32,
    /// Its current version.
    pub(crate) version: VersionView,
}

impl ModelHistory {
    /// # Errors
    /// 500: a branch stands nowhere.
    pub(crate) fn new(name: &str, begun: bool, model: &StoredModel) -> Result<Self, Problem> {
        let history = &model.history;
        let first = history
            .versions
            .values()
            .next()
            .ok_or_else(|| Problem::internal(&format!("the model {name} has no version")))?;
        let branches = history.branches.iter().map(|(branch, number)| {
            let version = history.versions.get(number);
            let version = version.ok_or_else(|| Problem::internal(&format!("{name}@{branch} has no version")))?;
            Ok(BranchView {
                name: branch.clone(),
                version: *number,
                hash: version.hash(),
            })
        });
        Ok(Self {
            name: name.to_owned(),
            begun,
            vehicle: first.vehicle.name.clone(),
            rotors: first.rotor_count(),
            branches: branches.collect::<Result<_, Problem>>()?,
            versions: history
                .versions
                .keys()
                .filter_map(|number| VersionView::of(name, model, *number))
                .collect(),
        })
    }
}

impl VersionView {
    /// A version of a model; `None`: it has none of this number.
    pub(crate) fn of(name: &str, model: &StoredModel, number: u32) -> Option<Self> {
        let version = model.history.versions.get(&number)?;
        let parent = model.history.parent_of(number);
        let before = parent.and_then(|parent| model.history.versions.get(&parent));
        Some(Self {
            version: number,
            label: label(name, number),
            hash: version.hash(),
            parent,
            note: version.note.clone(),
            changed: before.map_or_else(Vec::new, |before| changed(&Difference::between(before, version))),
            effects: version.effect.iter().map(EffectView::from).collect(),
            made_ms: model.made_ms.get(&number).copied(),
        })
    }
}

/// `f550@v1`.
pub(crate) fn label(name: &str, number: u32) -> String {
    format!("{name}@v{number}")
}

fn changed(difference: &Difference) -> Vec<String> {
    let effects = difference.parameters.iter().map(|change| change.effect.clone());
    let mut all: Vec<String> = effects
        .chain(difference.keys.iter().map(|change| change.key.clone()))
        .collect();
    all.dedup();
    all
}

impl From<&ModelEffect> for EffectView {
    fn from(effect: &ModelEffect) -> Self {
        let provenance = &effect.provenance;
        Self {
            effect: effect.effect.clone(),
            rotor: effect.rotor,
            onset_s: effect.onset_s,
            label: effect.label(),
            source: match provenance.source {
                Source::ByHand => "by-hand",
                Source::Diagnosis => "diagnosis",
            },
            parameters: effect
                .parameters
                .iter()
                .map(|(name, value)| ParameterView {
                    name: name.clone(),
                    value: *value,
                    deviation: effect.deviations.get(name).copied(),
                })
                .collect(),
            ln_bayes_factor: provenance.ln_bayes_factor,
            posterior: provenance.posterior,
            logs: provenance.log.iter().map(|log| log.name.clone()).collect(),
            held_out: provenance
                .held_out
                .iter()
                .map(|error| HeldOutView {
                    data: error.data.clone(),
                    quantity: error.quantity.clone(),
                    unit: error.unit.clone(),
                    before: error.before,
                    after: error.after,
                })
                .collect(),
        }
    }
}

impl DifferenceView {
    /// Between two versions under these labels.
    pub(crate) fn between(from: (String, &ModelVersion), to: (String, &ModelVersion)) -> Self {
        let Difference { parameters, keys } = Difference::between(from.1, to.1);
        let value = |value: Option<difference::Value>| {
            value.map(|value| ValueView {
                value: value.value,
                deviation: value.deviation,
            })
        };
        Self {
            from: from.0,
            to: to.0,
            parameters: parameters
                .into_iter()
                .map(|change| ParameterChangeView {
                    effect: change.effect,
                    parameter: change.parameter,
                    before: value(change.before),
                    after: value(change.after),
                })
                .collect(),
            keys: keys
                .into_iter()
                .map(|change| KeyChangeView {
                    key: change.key,
                    before: change.before,
                    after: change.after,
                })
                .collect(),
        }
    }
}
