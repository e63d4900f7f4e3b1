//! Effects as documents name them: `[[effect]]` of scenarios and models, and the catalogue against which they are checked.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::catalogue::catalogue;
use super::constants::Constants;
use super::declaration::{EffectDeclaration, ParameterDeclaration, ParameterKind, Setup};
use super::hooks::ActiveEffect;
use super::user::EffectDocument;
use crate::error::{Refusal, in_range};

/// Factor by which a value may exceed its plausible range.
const PLAUSIBLE_MARGIN: f64 = 10.0;

/// One `[[effect]]` of a scenario or model document.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectInstance {
    /// Id in the catalogue: `rotor-drag`.
    pub effect: String,
    /// Rotor, from 1, of an effect of one rotor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotor: Option<usize>,
    /// Onset, s; absent: present from the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub onset_s: Option<f64>,
    /// Values by the names of the declaration; absent sizes are 0, absent shapes typical.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

impl EffectInstance {
    /// The effect `id` with these parameters, on the whole vehicle, from the start.
    pub fn new(id: &str, parameters: &[(&str, f64)]) -> Self {
        Self {
            effect: id.to_owned(),
            rotor: None,
            onset_s: None,
            parameters: parameters
                .iter()
                .map(|&(name, value)| (name.to_owned(), value))
                .collect(),
        }
    }

    /// The same on one rotor, from 1.
    pub fn on_rotor(mut self, rotor: usize) -> Self {
        self.rotor = Some(rotor);
        self
    }

    /// The same from a time on, s.
    pub fn from_time(mut self, onset_s: f64) -> Self {
        self.onset_s = Some(onset_s);
        self
    }

    /// Values in the order of the declaration, defaults filled in.
    pub fn values(&self, declaration: &EffectDeclaration) -> Vec<f64> {
        let value = |p: &ParameterDeclaration| self.parameters.get(p.name).copied().unwrap_or(p.default_value());
        declaration.parameters.iter().map(value).collect()
    }

    /// Checks the instance for a vehicle with `rotor_count` rotors; the refusal's key is relative to the instance.
    pub fn check<'c>(&self, catalogue: &'c Catalogue, rotor_count: usize) -> Result<&'c EffectDeclaration, Refusal> {
        let declaration = catalogue.find(&self.effect).ok_or_else(|| {
            let near = catalogue.nearest(&self.effect);
            let reason = format!(
                "expected the id of an effect (`rotortwin effects` lists them), got `{}`; nearest: {near}",
                self.effect
            );
            Refusal::new("effect", reason)
        })?;
        match (declaration.per_rotor, self.rotor) {
            (true, Some(rotor)) if (1..=rotor_count).contains(&rotor) => {}
            (true, Some(rotor)) => {
                return Err(Refusal::new(
                    "rotor",
                    format!("expected a rotor from 1 to {rotor_count}, got {rotor}"),
                ));
            }
            (true, None) => {
                let reason = format!(
                    "expected a rotor from 1 to {rotor_count}: {} belongs to one rotor",
                    self.effect
                );
                return Err(Refusal::new("rotor", reason));
            }
            (false, Some(_)) => {
                let reason = format!("{} belongs to the whole vehicle: leave this key out", self.effect);
                return Err(Refusal::new("rotor", reason));
            }
            (false, None) => {}
        }
        if let Some(onset) = self.onset_s {
            in_range("onset_s", onset, 0.0, 1e6, "s")?;
        }
        for (name, &value) in &self.parameters {
            let Some(parameter) = declaration.parameters.iter().find(|p| p.name == name) else {
                let names = declaration
                    .parameters
                    .iter()
                    .map(|p| p.name)
                    .collect::<Vec<_>>()
                    .join(", ");
                let reason = format!("{} has no such parameter, it has {names}", self.effect);
                return Err(Refusal::new(format!("parameters.{name}"), reason));
            };
            let (low, high) = parameter.accepted();
            in_range(&format!("parameters.{name}"), value, low, high, parameter.unit)?;
        }
        let values = self.values(declaration);
        let acts = declaration
            .parameters
            .iter()
            .zip(&values)
            .any(|(p, &value)| p.kind == ParameterKind::Size && value != 0.0);
        if !acts {
            let sizes = declaration.parameters.iter().filter(|p| p.kind == ParameterKind::Size);
            let names = sizes.map(|p| p.name).collect::<Vec<_>>().join(" or ");
            let reason = format!("this effect cannot have an effect: expected a value other than 0 for {names}");
            return Err(Refusal::new("parameters", reason));
        }
        Ok(declaration)
    }
}

impl ParameterDeclaration {
    /// Values that documents may hold: plausible ones and ten times beyond, on the plausible side of 0.
    pub fn accepted(&self) -> (f64, f64) {
        let far = PLAUSIBLE_MARGIN * self.plausible_low.abs().max(self.plausible_high.abs());
        match self.kind {
            ParameterKind::Shape => {
                let low = if self.plausible_low > 0.0 {
                    self.plausible_low / PLAUSIBLE_MARGIN
                } else {
                    -far
                };
                (low, far)
            }
            ParameterKind::Size => (
                if self.plausible_low < 0.0 { -far } else { 0.0 },
                if self.plausible_high > 0.0 { far } else { 0.0 },
            ),
        }
    }
}

/// The effects that documents may name: those of this crate and those of users.
#[derive(Debug, Clone)]
pub struct Catalogue {
    entries: Vec<&'static EffectDeclaration>,
}

impl Default for Catalogue {
    fn default() -> Self {
        Self::built_in()
    }
}

impl Catalogue {
    /// The effects of this crate.
    pub fn built_in() -> Self {
        Self {
            entries: catalogue().to_vec(),
        }
    }

    /// The effects of this crate and those of users; no two with one id.
    pub fn with_documents(documents: &[EffectDocument]) -> Result<Self, Refusal> {
        let mut catalogue = Self::built_in();
        for document in documents {
            let declaration = document.declaration()?;
            if catalogue.find(declaration.id).is_some() {
                let reason = format!("two effects have the id `{}`", declaration.id);
                return Err(Refusal::new("id", reason));
            }
            catalogue.entries.push(declaration);
        }
        Ok(catalogue)
    }

    /// All entries: those of this crate in the order of the rows, then those of users.
    pub fn entries(&self) -> &[&'static EffectDeclaration] {
        &self.entries
    }

    /// The entry with this id.
    pub fn find(&self, id: &str) -> Option<&'static EffectDeclaration> {
        self.entries.iter().copied().find(|entry| entry.id == id)
    }

    /// The id most like `id`, for error messages.
    pub fn nearest(&self, id: &str) -> &'static str {
        let near = self.entries.iter().min_by_key(|entry| distance(entry.id, id));
        near.map_or("", |entry| entry.id)
    }

    /// The physics of a checked instance; `index` is its place in the list, `seed` that of the run.
    ///
    /// # Errors
    /// See [`EffectInstance::check`].
    pub fn build(
        &self,
        instance: &EffectInstance,
        nominal: &Constants,
        seed: u64,
        index: usize,
    ) -> Result<Box<dyn ActiveEffect>, Refusal> {
        let declaration = instance.check(self, nominal.rotor_count)?;
        let values = instance.values(declaration);
        Ok(declaration.build(&Setup {
            values: &values,
            rotor: instance.rotor.map_or(0, |rotor| rotor - 1),
            nominal,
            seed,
            index,
        }))
    }
}

/// Levenshtein distance in characters.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &y) in b.iter().enumerate() {
            let above = row[j + 1];
            row[j + 1] = (diagonal + usize::from(x != y)).min(above + 1).min(row[j] + 1);
            diagonal = above;
        }
    }
    row[b.len()]
}
