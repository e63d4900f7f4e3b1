//! One scenario document flown with varying settings, as in a campaign.
//!
//! ```text
//!  base scenario ─▶ ScenarioTemplate ── table() ─▶ set_value, set_value, … ─▶ scenario() ─▶ Scenario
//! ```
//!
//! The files that a scenario names (vehicle, blades, classifier) are read once per path and cached, so that creating the scenario of
//! a flight takes less than a millisecond. Every scenario is checked as a whole, as [`Scenario::load`] does.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use crate::classifier::Classifier;
use crate::effect_documents;
use crate::error::ConfigError;
use crate::names::{Kind, meant};
use crate::scenario::Scenario;
use crate::scenario_document::ScenarioDocument;
use crate::toml_document::{Document, plain};
use rotortwin_plant::error::Refusal;
use rotortwin_plant::vehicle::model::VehicleModel;

/// A TOML file other than a scenario, with the same error reporting: file, line and key.
#[derive(Debug, Clone)]
pub struct TomlFile(Document);

impl TomlFile {
    /// Reads the file at `path`.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        Document::read(path).map(Self)
    }

    /// A text that errors refer to as `name`.
    pub fn from_text(name: &str, text: &str) -> Result<Self, ConfigError> {
        Document::from_text(name, text).map(Self)
    }

    /// Deserialises the file as `T`; unknown keys, missing keys and wrong types are errors if `T` is declared so.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        self.0.parse()
    }

    /// An error about the dotted path `key` of this file.
    pub fn refuse(&self, key: &str, reason: impl Into<String>) -> ConfigError {
        self.0.refuse(Refusal::new(key, reason))
    }
}

/// The vehicle and its blades, as read.
#[derive(Debug, Clone)]
struct VehicleFiles {
    vehicle: Document,
    blades: Document,
    rotor_count: usize,
}

/// Files read so far, by path.
#[derive(Debug, Default)]
struct Files {
    vehicles: BTreeMap<PathBuf, VehicleFiles>,
    classifiers: BTreeMap<PathBuf, Classifier>,
}

/// See the module documentation.
#[derive(Debug)]
pub struct ScenarioTemplate {
    name: String,
    directory: PathBuf,
    table: Table,
    files: Mutex<Files>,
}

impl ScenarioTemplate {
    /// Reads the scenario at `path`. It must be checked by [`ScenarioTemplate::scenario`] before it is flown.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let document = Document::read(path)?;
        // For the line number if it is not a scenario document at all.
        let _: ScenarioDocument = document.parse()?;
        Ok(Self {
            name: plain(path),
            directory: path.parent().unwrap_or(Path::new("")).to_path_buf(),
            table: document.parse()?,
            files: Mutex::default(),
        })
    }

    /// The document as written, for [`set_value`] to modify copies of.
    pub fn table(&self) -> &Table {
        &self.table
    }

    /// Folder that the paths in the document are relative to.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Checks `table`, a modified copy of [`ScenarioTemplate::table`], as a scenario. Errors name no line, as no file has this text.
    pub fn scenario(&self, table: &Table) -> Result<Scenario, ConfigError> {
        let document = self.document(table)?;
        let parsed: ScenarioDocument = document.parse()?;
        let files = self.vehicle_files(&document, &parsed.vehicle)?;
        let classifier = parsed
            .fdi
            .network
            .as_deref()
            .map(|path| self.classifier(&document, path))
            .transpose()?;
        let effects = effect_documents::named(&document, &parsed.effect_files, &self.directory)?;
        Scenario::assemble(&document, &files.vehicle, &files.blades, classifier, effects, true)
    }

    /// Rotors of the vehicle that `table` names.
    pub fn rotor_count(&self, table: &Table) -> Result<usize, ConfigError> {
        let document = self.document(table)?;
        let path = table.get("vehicle").and_then(Value::as_str).unwrap_or_default();
        Ok(self.vehicle_files(&document, path)?.rotor_count)
    }

    fn document(&self, table: &Table) -> Result<Document, ConfigError> {
        let text = toml::to_string(table)
            .map_err(|error| ConfigError::new(&self.name, None, None, format!("cannot be written as TOML: {error}")))?;
        Document::rewritten(&self.name, text)
    }

    fn vehicle_files(&self, scenario: &Document, path: &str) -> Result<VehicleFiles, ConfigError> {
        let path = meant(Kind::Vehicle, &self.directory, path);
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = files.vehicles.get(&path) {
            return Ok(known.clone());
        }
        let vehicle = scenario.follow("vehicle", &path)?;
        let parsed: VehicleModel = vehicle.parse()?;
        let beside = path.parent().unwrap_or(Path::new(""));
        let blades_path = meant(Kind::Blades, beside, &parsed.rotors.blades);
        let read = VehicleFiles {
            blades: vehicle.follow("rotors.blades", &blades_path)?,
            rotor_count: parsed.rotor_count(),
            vehicle,
        };
        files.vehicles.insert(path, read.clone());
        Ok(read)
    }

    fn classifier(&self, scenario: &Document, path: &str) -> Result<Classifier, ConfigError> {
        let path = meant(Kind::Classifier, &self.directory, path);
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = files.classifiers.get(&path) {
            return Ok(known.clone());
        }
        let read = Classifier::named(scenario, "fdi.network", &path)?;
        files.classifiers.insert(path, read.clone());
        Ok(read)
    }
}

/// One part of a dotted path.
enum Part<'a> {
    Key(&'a str),
    Index(usize),
}

/// `fault[0].rotor` → `fault`, 0, `rotor`.
fn parts(path: &str) -> Result<Vec<Part<'_>>, String> {
    let wrong =
        || format!("expected a dotted path such as `initial.state_of_charge` or `fault[0].rotor`, got `{path}`");
    let mut parts = Vec::new();
    for piece in path.split('.') {
        let (name, indices) = piece
            .split_once('[')
            .map_or((piece, None), |(name, rest)| (name, Some(rest)));
        if name.is_empty() {
            return Err(wrong());
        }
        parts.push(Part::Key(name));
        if let Some(indices) = indices {
            for index in indices.strip_suffix(']').ok_or_else(wrong)?.split("][") {
                parts.push(Part::Index(index.parse().map_err(|_not_a_number| wrong())?));
            }
        }
    }
    Ok(parts)
}

/// Sets the value at a dotted path such as `mismatch.rotor_gain` or `fault[0].rotor`; missing tables on the way are created, list
/// entries must exist. The error is a message.
pub fn set_value(table: &mut Table, path: &str, value: Value) -> Result<(), String> {
    let parts = parts(path)?;
    let (Some(Part::Key(first)), rest) = (parts.first(), &parts[1..]) else {
        return Err(format!("expected a dotted path that begins with a key, got `{path}`"));
    };
    if rest.is_empty() {
        table.insert((*first).to_owned(), value);
        return Ok(());
    }
    let mut target = table.entry(*first).or_insert_with(|| match rest[0] {
        Part::Key(_) => Value::Table(Table::new()),
        Part::Index(_) => Value::Array(Vec::new()),
    });
    for (i, part) in rest.iter().enumerate() {
        let last = i + 1 == rest.len();
        target = match part {
            Part::Key(key) => {
                let holder = target
                    .as_table_mut()
                    .ok_or_else(|| format!("`{path}`: `{key}` is used on a value that is not a table"))?;
                if last {
                    holder.insert((*key).to_owned(), value);
                    return Ok(());
                }
                holder.entry(*key).or_insert_with(|| Value::Table(Table::new()))
            }
            Part::Index(index) => {
                let list = target
                    .as_array_mut()
                    .ok_or_else(|| format!("`{path}`: [{index}] is used on a value that is not a list"))?;
                let count = list.len();
                list.get_mut(*index)
                    .ok_or_else(|| format!("`{path}`: there is no entry [{index}], the list has {count}"))?
            }
        };
    }
    *target = value;
    Ok(())
}

/// The value at a dotted path, if there is one.
pub fn value_at<'a>(table: &'a Table, path: &str) -> Option<&'a Value> {
    let parts = parts(path).ok()?;
    let mut parts = parts.into_iter();
    let Some(Part::Key(first)) = parts.next() else {
        return None;
    };
    parts.try_fold(table.get(first)?, |value, part| match part {
        Part::Key(key) => value.as_table()?.get(key),
        Part::Index(index) => value.as_array()?.get(index),
    })
}

/// Merges `overlay` into `table`: tables are merged key by key, everything else is replaced. A table with a `kind` replaces the old
/// one as a whole, because its other keys depend on the kind. Keys with dots or brackets are paths as in [`set_value`].
pub fn overlay(table: &mut Table, overlay_table: &Table) -> Result<(), String> {
    for (key, value) in overlay_table {
        if key.contains(['.', '[']) {
            set_value(table, key, value.clone())?;
            continue;
        }
        match (table.get_mut(key), value) {
            (Some(Value::Table(old)), Value::Table(new)) if !new.contains_key("kind") => overlay(old, new)?,
            _ => {
                table.insert(key.clone(), value.clone());
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(name)
    }

    #[test]
    fn val_values_are_set_where_the_path_says() {
        let mut table: Table = "a = 1\n[b]\nc = 2\n[[f]]\nr = 1\n[[f]]\nr = 2\n".parse().expect("TOML");
        set_value(&mut table, "a", Value::Integer(5)).expect("a key");
        set_value(&mut table, "b.d.e", Value::Integer(6)).expect("new tables");
        set_value(&mut table, "f[1].r", Value::Integer(7)).expect("an entry");
        assert_eq!(value_at(&table, "a"), Some(&Value::Integer(5)));
        assert_eq!(value_at(&table, "b.c"), Some(&Value::Integer(2)));
        assert_eq!(value_at(&table, "b.d.e"), Some(&Value::Integer(6)));
        assert_eq!(value_at(&table, "f[0].r"), Some(&Value::Integer(1)));
        assert_eq!(value_at(&table, "f[1].r"), Some(&Value::Integer(7)));
        for bad in ["f[2].r", "a.b", "f[x]", "", "f..r", "b[0]"] {
            assert!(set_value(&mut table, bad, Value::Integer(0)).is_err(), "{bad}");
        }
    }

    #[test]
    fn val_template_gives_the_scenario_that_loading_gives() {
        for name in ["scenarios/lag-aware-reference-flight.toml", "scenarios/waypoints.toml"] {
            let loaded = Scenario::load(config(name)).expect("a good scenario");
            let template = ScenarioTemplate::read(&config(name)).expect("a good scenario");
            let made = template.scenario(template.table()).expect("a good scenario");
            assert_eq!(made.documents(), loaded.documents());
            assert_eq!(
                template.rotor_count(template.table()),
                Ok(loaded.vehicle().rotor_count())
            );
        }
    }

    #[test]
    fn val_template_refuses_what_loading_refuses() {
        let template = ScenarioTemplate::read(&config("scenarios/hover.toml")).expect("a good scenario");
        let mut table = template.table().clone();
        set_value(&mut table, "initial.state_of_chargee", Value::Float(0.5)).expect("a path");
        let error = template.scenario(&table).expect_err("an unknown key");
        assert_eq!(error.key(), Some("initial.state_of_chargee"));
        assert_eq!(error.line(), None);
    }

    #[test]
    fn val_overlay_joins_tables_and_replaces_kinds() {
        let mut table: Table = "[t]\nkind = \"a\"\nx = 1\n[m]\ny = 1\nz = 2\n".parse().expect("TOML");
        let over: Table = "\"m.y\" = 9\n[t]\nkind = \"b\"\n[m]\nw = 3\n".parse().expect("TOML");
        overlay(&mut table, &over).expect("good paths");
        let want: Table = "[t]\nkind = \"b\"\n[m]\ny = 9\nz = 2\nw = 3\n".parse().expect("TOML");
        assert_eq!(table, want);
    }
}
