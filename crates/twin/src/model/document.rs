//! The file of a model version: TOML that people read and edit, checked as a whole, rejected with file, line and key.
//!
//! ```toml
//! model_format = 1
//! name = "f550"
//! parent = "5f0c…"             # content hash of version 0
//! hash = "9a41…"               # content hash of this version; leave it out after editing by hand
//!
//! # Rotor drag: F_xy = −k_d (Σ Ω_i/n Ω_h) v_a,xy
//! [[effect]]
//! effect = "rotor-drag"
//! parameters = { drag_n_s_m = 0.253 }
//! deviations = { drag_n_s_m = 0.001 }
//! [effect.provenance]
//! source = "diagnosis"
//! …
//! [vehicle]                    # inline, or  [vehicle_file] path = "…", hash = "…"
//! ```
//!
//! A file without `model_format` is read as a vehicle document: version 0, named after the file. If there is a
//! `NAME.intervals.toml` next to it, as written by `rotortwin vehicle from-log`, the version holds its intervals
//! ([`ModelVersion::constant`]).

use std::fmt::Write as _;
use std::path::Path;

use rotortwin_plant::effects::{Catalogue, EffectDocument, EffectInstance};
use rotortwin_plant::error::Refusal;
use rotortwin_plant::powertrain::blades::BladeSet;
use rotortwin_plant::vehicle::model::VehicleModel;
use rotortwin_scenario::ConfigError;
use rotortwin_scenario::VehicleDocuments;
use rotortwin_scenario::toml_document::Document;
use serde::Deserialize;

use crate::log;

use super::{ConstantInterval, Correlation, ModelEffect, ModelVersion, constants};

/// The only format so far.
pub const FORMAT: u32 = 1;

/// The file as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    model_format: u32,
    name: String,
    #[serde(default)]
    note: String,
    parent: Option<String>,
    hash: Option<String>,
    #[serde(default)]
    effect: Vec<ModelEffect>,
    #[serde(default)]
    correlation: Vec<Correlation>,
    #[serde(default)]
    effect_document: Vec<EffectDocument>,
    #[serde(default)]
    constant: Vec<ConstantInterval>,
    #[serde(default)]
    wind_of_each_flight: bool,
    vehicle_file: Option<VehicleFile>,
    vehicle: Option<VehicleModel>,
    blades: Option<BladeSet>,
}

/// `[vehicle_file]`: a vehicle document instead of an inline vehicle.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct VehicleFile {
    /// Relative to the version's file.
    path: String,
    /// [`ModelVersion::vehicle_hash`] that it must have.
    hash: String,
}

impl ModelVersion {
    /// Reads the version, or the vehicle document as version 0, at `path`.
    ///
    /// # Errors
    /// Not TOML, neither of both, an unknown key or effect, a value outside of its range, a vehicle file that is missing or has
    /// changed, a content hash that does not match: one sentence with file, line and key.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        if log::is_log(path) {
            let reason = "this is a flight log; expected a vehicle document or a model version, such as config/vehicles/f550.toml";
            return Err(ConfigError::new(&path.display().to_string(), None, None, reason));
        }
        let document = Document::read(path)?;
        if document.has_key("model_format") {
            return Self::from_document(&document, path.parent().unwrap_or(Path::new("")));
        }
        if document.has_key("body") || document.has_key("rotors") {
            let stem = path
                .file_stem()
                .map_or_else(|| "model".into(), |stem| stem.to_string_lossy());
            let mut version = Self::first(plain_name(&stem), VehicleDocuments::load(path)?);
            version.constant = constants::beside(path, &version.vehicle)?;
            return Ok(version);
        }
        // Told by the parser where it is not TOML at all.
        document.parse::<toml::Table>()?;
        let reason =
            "expected a model version (with the key `model_format`) or a vehicle document (with `body` and `rotors`)";
        Err(ConfigError::new(document.name(), None, None, reason))
    }

    /// As [`ModelVersion::load`] from a text; `name` is used in errors, paths in it are relative to `directory`.
    pub fn parse(name: &str, text: &str, directory: &Path) -> Result<Self, ConfigError> {
        Self::from_document(&Document::from_text(name, text)?, directory)
    }

    fn from_document(document: &Document, directory: &Path) -> Result<Self, ConfigError> {
        let file: File = document.parse()?;
        let refuse = |key: &str, reason: String| document.refuse(Refusal::new(key, reason));
        if file.model_format != FORMAT {
            return Err(refuse(
                "model_format",
                format!(
                    "expected {FORMAT}, the only format that this program knows, got {}",
                    file.model_format
                ),
            ));
        }
        let documents = match (file.vehicle, file.blades, file.vehicle_file) {
            (Some(vehicle), Some(blades), None) => VehicleDocuments { vehicle, blades },
            (None, None, Some(reference)) => {
                let path = directory.join(&reference.path);
                document.follow("vehicle_file.path", &path)?;
                let documents = VehicleDocuments::load(&path)?;
                let found = Self::first("", documents.clone()).vehicle_hash();
                if found != reference.hash {
                    let reason = format!(
                        "expected a vehicle with the hash {}, the one at this path has {found}: it was changed",
                        reference.hash
                    );
                    return Err(refuse("vehicle_file.hash", reason));
                }
                documents
            }
            (_, _, None) => {
                return Err(refuse(
                    "vehicle",
                    "expected `[vehicle]` and `[blades]`, or `[vehicle_file]`".into(),
                ));
            }
            (_, _, Some(_)) => {
                return Err(refuse(
                    "vehicle_file",
                    "expected either `[vehicle_file]` or `[vehicle]` with `[blades]`, not both".into(),
                ));
            }
        };
        let version = Self {
            name: file.name,
            note: file.note,
            parent: file.parent,
            effect: file.effect,
            correlation: file.correlation,
            effect_document: file.effect_document,
            constant: file.constant,
            wind_of_each_flight: file.wind_of_each_flight,
            vehicle: documents.vehicle,
            blades: documents.blades,
        };
        version.check().map_err(|refusal| document.refuse(refusal))?;
        if let Some(hash) = file.hash {
            let found = version.hash();
            if found != hash {
                let reason = format!(
                    "the content has the hash {found}, so the file was changed after it was written: take this line out if that was meant"
                );
                return Err(refuse("hash", reason));
            }
        }
        Ok(version)
    }

    /// Checks every value; a refusal names the key.
    pub fn check(&self) -> Result<(), Refusal> {
        if !is_plain_name(&self.name) {
            let reason = format!(
                "expected 1 to 64 letters, digits, '-', '_' and '.' that begin with a letter or digit, got {:?}",
                self.name
            );
            return Err(Refusal::new("name", reason));
        }
        if let Some(parent) = &self.parent
            && !is_hash(parent)
        {
            return Err(Refusal::new(
                "parent",
                format!("expected a content hash of 32 hexadecimal digits, got {parent:?}"),
            ));
        }
        self.documents().check()?;
        let catalogue = self.catalogue()?;
        for (place, effect) in self.effect.iter().enumerate() {
            let under = format!("effect[{place}]");
            effect
                .check(self.rotor_count(), &catalogue)
                .map_err(|r| r.under(&under))?;
            if self.effect[..place].iter().any(|other| other.is_same_term(effect)) {
                let reason = format!("expected each effect once, {} is given twice", effect.label());
                return Err(Refusal::new(format!("{under}.effect"), reason));
            }
        }
        for (place, constant) in self.constant.iter().enumerate() {
            constant.check().map_err(|r| r.under(&format!("constant[{place}]")))?;
        }
        for (place, correlation) in self.correlation.iter().enumerate() {
            let under = format!("correlation[{place}]");
            correlation.check(&self.effect).map_err(|r| r.under(&under))?;
        }
        Ok(())
    }

    /// The file of this version, with its hash; reads back to the same version.
    pub fn to_toml(&self) -> String {
        let mut text = self.terms();
        #[derive(serde::Serialize)]
        struct Tail<'a> {
            vehicle: &'a VehicleModel,
            blades: &'a BladeSet,
        }
        let tail = toml::to_string(&Tail {
            vehicle: &self.vehicle,
            blades: &self.blades,
        });
        text.push('\n');
        text.push_str(&tail.expect("documents hold nothing that TOML cannot"));
        text
    }

    /// As [`ModelVersion::to_toml`] with the vehicle by reference; `path` as seen from the file's folder.
    pub fn to_toml_with_vehicle_file(&self, path: &str) -> String {
        let mut text = self.terms();
        put(
            &mut text,
            format_args!(
                "\n[vehicle_file]\npath = {}\nhash = {}\n",
                quoted(path),
                quoted(&self.vehicle_hash())
            ),
        );
        text
    }

    /// Everything but the vehicle.
    fn terms(&self) -> String {
        let mut out = String::new();
        let text = &mut out;
        put(
            text,
            format_args!(
                "# Model version of rotortwin: a vehicle and the effects that measurements showed to be missing.\n"
            ),
        );
        put(
            text,
            format_args!("model_format = {FORMAT}\nname = {}\n", quoted(&self.name)),
        );
        if !self.note.is_empty() {
            put(text, format_args!("note = {}\n", quoted(&self.note)));
        }
        if let Some(parent) = &self.parent {
            put(
                text,
                format_args!("parent = {} # content hash of the version before\n", quoted(parent)),
            );
        }
        put(
            text,
            format_args!(
                "hash = {} # of the content; leave it out after editing by hand\n",
                quoted(&self.hash())
            ),
        );
        if self.wind_of_each_flight {
            put(
                text,
                format_args!("wind_of_each_flight = true # fitted to each log that this version is compared with\n"),
            );
        }
        let catalogue = self.catalogue().unwrap_or_default();
        for effect in &self.effect {
            effect.write(text, &catalogue);
        }
        for correlation in &self.correlation {
            let [a, b] = &correlation.between;
            let (a, b, coefficient) = (quoted(a), quoted(b), correlation.coefficient);
            put(
                text,
                format_args!("\n[[correlation]]\nbetween = [{a}, {b}]\ncoefficient = {coefficient:?}\n"),
            );
        }
        if !self.effect_document.is_empty() {
            #[derive(serde::Serialize)]
            struct Own<'a> {
                effect_document: &'a [EffectDocument],
            }
            let own = Own {
                effect_document: &self.effect_document,
            };
            let toml = toml::to_string(&own).expect("documents hold nothing that TOML cannot");
            put(
                text,
                format_args!("\n# Effects of this model that the catalogue lacks.\n{toml}"),
            );
        }
        if !self.constant.is_empty() {
            #[derive(serde::Serialize)]
            struct Known<'a> {
                constant: &'a [ConstantInterval],
            }
            let known = Known {
                constant: &self.constant,
            };
            let toml = toml::to_string(&known).expect("intervals hold nothing that TOML cannot");
            put(
                text,
                format_args!("\n# How well the vehicle's constants are known, with 95 % intervals.\n{toml}"),
            );
        }
        out
    }
}

impl ModelEffect {
    fn check(&self, rotors: usize, catalogue: &Catalogue) -> Result<(), Refusal> {
        EffectInstance::from(self).check(catalogue, rotors)?;
        for (name, &value) in &self.parameters {
            if !value.is_finite() {
                return Err(Refusal::new(
                    format!("parameters.{name}"),
                    format!("expected a finite number, got {value}"),
                ));
            }
        }
        for (name, &deviation) in &self.deviations {
            let key = format!("deviations.{name}");
            if !self.parameters.contains_key(name) {
                let known = self.parameters.keys().cloned().collect::<Vec<_>>().join(", ");
                return Err(Refusal::new(key, format!("expected a name from `parameters`: {known}")));
            }
            if !(deviation.is_finite() && deviation >= 0.0) {
                return Err(Refusal::new(
                    key,
                    format!("expected a standard deviation of 0 or more, got {deviation}"),
                ));
            }
        }
        if let Some(onset) = self.onset_s
            && !(onset.is_finite() && onset >= 0.0)
        {
            return Err(Refusal::new(
                "onset_s",
                format!("expected a time of 0 s or later, got {onset}"),
            ));
        }
        Ok(())
    }

    fn write(&self, text: &mut String, catalogue: &Catalogue) {
        text.push('\n');
        if let Some(comment) = super::specification::comment(self, catalogue) {
            put(text, format_args!("# {comment}\n"));
        }
        put(text, format_args!("[[effect]]\neffect = {}\n", quoted(&self.effect)));
        if let Some(rotor) = self.rotor {
            put(text, format_args!("rotor = {rotor}\n"));
        }
        if let Some(onset) = self.onset_s {
            put(text, format_args!("onset_s = {onset:?}\n"));
        }
        put(text, format_args!("parameters = {}\n", inline(&self.parameters)));
        if !self.deviations.is_empty() {
            put(
                text,
                format_args!("deviations = {} # 1 sigma\n", inline(&self.deviations)),
            );
        }
        let provenance = &self.provenance;
        let source = toml::Value::try_from(provenance.source).expect("a word is TOML");
        put(
            text,
            format_args!(
                "[effect.provenance]\nsource = {source}\ntool = {}\n",
                quoted(&provenance.tool)
            ),
        );
        for (key, value) in [
            ("ln_bayes_factor", provenance.ln_bayes_factor),
            ("posterior", provenance.posterior),
        ] {
            if let Some(value) = value {
                put(text, format_args!("{key} = {value:?}\n"));
            }
        }
        if !provenance.log.is_empty() {
            let logs: Vec<String> = provenance
                .log
                .iter()
                .map(|log| format!("{{ name = {}, hash = {} }}", quoted(&log.name), quoted(&log.hash)))
                .collect();
            put(text, format_args!("log = [{}]\n", logs.join(", ")));
        }
        if !provenance.held_out.is_empty() {
            put(text, format_args!("held_out = [\n"));
            for entry in &provenance.held_out {
                put(
                    text,
                    format_args!(
                        "    {{ data = {}, quantity = {}, unit = {}, before = {:?}, after = {:?} }},\n",
                        quoted(&entry.data),
                        quoted(&entry.quantity),
                        quoted(&entry.unit),
                        entry.before,
                        entry.after
                    ),
                );
            }
            text.push_str("]\n");
        }
    }
}

impl Correlation {
    fn check(&self, effects: &[ModelEffect]) -> Result<(), Refusal> {
        for (place, key) in self.between.iter().enumerate() {
            let known = effects
                .iter()
                .flat_map(|effect| {
                    effect
                        .parameters
                        .keys()
                        .map(|name| format!("{}.{name}", effect.label()))
                })
                .collect::<Vec<_>>();
            if !known.contains(key) {
                let reason = format!(
                    "expected a parameter of an effect above, one of {}, got {key:?}",
                    known.join(", ")
                );
                return Err(Refusal::new(format!("between[{place}]"), reason));
            }
        }
        if !(-1.0..=1.0).contains(&self.coefficient) {
            return Err(Refusal::new(
                "coefficient",
                format!("expected a number from -1 to 1, got {}", self.coefficient),
            ));
        }
        Ok(())
    }
}

fn put(text: &mut String, arguments: std::fmt::Arguments<'_>) {
    text.write_fmt(arguments).expect("a String takes everything");
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// `{ a = 1.0, b = 2.0 }`; keys of the catalogue are bare, others are quoted.
fn inline(map: &std::collections::BTreeMap<String, f64>) -> String {
    let bare = |key: &str| !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_'));
    let entries: Vec<String> = map
        .iter()
        .map(|(key, value)| {
            let key = if bare(key) { key.clone() } else { quoted(key) };
            format!("{key} = {value:?}")
        })
        .collect();
    format!("{{ {} }}", entries.join(", "))
}

fn is_hash(text: &str) -> bool {
    text.len() == 32 && text.bytes().all(|b| b.is_ascii_hexdigit())
}

/// Whether a text can name a model, a branch and their files.
pub(crate) fn is_plain_name(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    name.len() <= 64 && name.starts_with(|c: char| c.is_ascii_alphanumeric()) && name.chars().all(plain)
}

/// The name with everything replaced that a name must not have.
pub(crate) fn plain_name(text: &str) -> String {
    let name: String = text
        .chars()
        .map(|c| {
            if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.') {
                c
            } else {
                '-'
            }
        })
        .take(64)
        .collect();
    let name = name.trim_start_matches(|c: char| !c.is_ascii_alphanumeric()).to_owned();
    if name.is_empty() { "model".to_owned() } else { name }
}
