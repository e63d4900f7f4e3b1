//! Collects all errors of a document, where reading it stops at the first.
//!
//! The reader is run repeatedly: each time, the value that it rejected is replaced by that of a known good document, or removed.
//! Further errors then concern the user's other values. An error that the repair itself could have caused (the same key again) is not
//! listed; where no repair is possible, the list ends, and more errors may appear later.

use crate::error::ConfigError;
use crate::toml_document::{Document, at, index, join};
use rotortwin_plant::error::Refusal;
use std::collections::{BTreeMap, BTreeSet};
use toml::{Table, Value};

/// Maximum length of the list.
const MOST_COMPLAINTS: usize = 50;

/// All errors that `check` reports about a text, in the order of checking; empty if it is valid.
///
/// `name` is the name of the text in the errors of `check`; `good` is a document of the same kind that provides replacement values.
pub fn complaints(
    name: &str,
    text: &str,
    good: &str,
    check: impl Fn(&str) -> Result<(), ConfigError>,
) -> Vec<ConfigError> {
    let Err(first) = check(text) else {
        return Vec::new();
    };
    let (Ok(original), Ok(table)) = (Document::from_text(name, text), text.parse::<Table>()) else {
        return vec![first];
    };
    let mut repair = Repair {
        root: Value::Table(table),
        good: Value::Table(good.parse().unwrap_or_default()),
        left_out: BTreeMap::new(),
        repaired: BTreeSet::new(),
    };
    let mut found: Vec<ConfigError> = Vec::new();
    let mut next = Some(first);
    while let Some(error) = next.filter(|_| found.len() < MOST_COMPLAINTS) {
        let Some(key) = error.key().filter(|_| error.file() == name) else {
            found.push(error);
            break;
        };
        let path = parts(key);
        let written = join(&repair.as_written(&path));
        if !found.iter().any(|other| other.key() == Some(&written)) {
            found.push(original.refuse(Refusal::new(written, error.reason())));
        }
        if !repair.replace_or_remove(&path) {
            break;
        }
        let Ok(changed) = toml::to_string(&repair.root) else {
            break;
        };
        next = check(&changed).err();
    }
    found
}

/// A document under repair.
struct Repair {
    root: Value,
    good: Value,
    /// Removed list entries, by the list's path: indices as the user wrote them.
    left_out: BTreeMap<String, BTreeSet<usize>>,
    /// Paths already repaired; if rejected again, the table or list that contains them is removed.
    repaired: BTreeSet<String>,
}

impl Repair {
    /// Repairs the value at a path; `false` if that is impossible.
    fn replace_or_remove(&mut self, path: &[String]) -> bool {
        for length in (1..=path.len()).rev() {
            let (holder, last) = (&path[..length - 1], &path[length - 1]);
            if !self.repaired.insert(join(&self.as_written(&path[..length]))) {
                continue;
            }
            let replacement = at(&mut self.good, &path[..length]).cloned();
            let here = at(&mut self.root, &path[..length]).cloned();
            if let Some(replacement) = replacement
                && Some(&replacement) != here.as_ref()
                && index(last).is_none()
                && let Some(Value::Table(table)) = at(&mut self.root, holder)
            {
                table.insert(last.clone(), replacement);
                // If it is rejected again, it is removed.
                return true;
            }
            if here.is_some() && self.leave_out(holder, last) {
                return true;
            }
        }
        false
    }

    fn leave_out(&mut self, holder: &[String], last: &str) -> bool {
        let list = join(&self.as_written(holder));
        let as_written = index(last).map(|i| self.index_as_written(&list, i));
        match (at(&mut self.root, holder), index(last)) {
            (Some(Value::Table(table)), None) => table.remove(last).is_some(),
            (Some(Value::Array(items)), Some(i)) if i < items.len() => {
                items.remove(i);
                self.left_out.entry(list).or_default().extend(as_written);
                true
            }
            _ => false,
        }
    }

    /// Maps a path in the modified document to the user's original.
    fn as_written(&self, path: &[String]) -> Vec<String> {
        let mut written: Vec<String> = Vec::with_capacity(path.len());
        for part in path {
            let part = match index(part) {
                Some(i) => format!("[{}]", self.index_as_written(&join(&written), i)),
                None => part.clone(),
            };
            written.push(part);
        }
        written
    }

    fn index_as_written(&self, list: &str, index: usize) -> usize {
        let none = BTreeSet::new();
        let left_out = self.left_out.get(list).unwrap_or(&none);
        (0..).filter(|i| !left_out.contains(i)).nth(index).unwrap_or(index)
    }
}

/// `fault[0].rotor` as `fault`, `[0]`, `rotor`.
fn parts(key: &str) -> Vec<String> {
    key.replace('[', ".[")
        .split('.')
        .filter(|part| !part.is_empty())
        .map(str::to_owned)
        .collect()
}

#[cfg(test)]
mod tests {
    use crate::{Scenario, VehicleDocuments};
    use std::path::Path;

    fn config(path: &str) -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
    }

    fn of_scenario(text: &str) -> Vec<(Option<usize>, String)> {
        Scenario::complaints(text, config("scenarios"))
            .iter()
            .map(|error| (error.line(), error.key().unwrap_or_default().to_owned()))
            .collect()
    }

    #[test]
    fn val_good_documents_have_no_complaint() {
        let text = std::fs::read_to_string(config("scenarios/reference-flight.toml")).expect("readable");
        assert_eq!(of_scenario(&text), []);
        let text = std::fs::read_to_string(config("vehicles/octo-x.toml")).expect("readable");
        assert_eq!(VehicleDocuments::complaints(&text, config("vehicles")), []);
    }

    #[test]
    fn val_every_mistake_of_a_scenario_is_told_with_its_line() {
        let text = "name = \"wrong\"\n\
            description = \"five mistakes\"\n\
            vehicle = \"../vehicles/f550.toml\"\n\
            duration_s = -3.0\n\
            colour = \"red\"\n\
            [trajectory]\n\
            kind = \"hover\"\n\
            position_ned_m = [0.0, 0.0, 0.0]\n\
            [initial]\n\
            state_of_charge = 3.0\n\
            [[fault]]\n\
            time_s = 5.0\n\
            rotor = 1\n\
            blade = \"none-such\"\n\
            [[fault]]\n\
            time_s = 6.0\n\
            rotor = 17\n\
            blade = \"b\"\n";
        let mut found = of_scenario(text);
        found.sort();
        let expected = [
            (Some(4), "duration_s"),
            (Some(5), "colour"),
            (Some(10), "initial.state_of_charge"),
            (Some(14), "fault[0].blade"),
            (Some(17), "fault[1].rotor"),
        ];
        assert_eq!(found, expected.map(|(line, key)| (line, key.to_owned())));
    }

    #[test]
    fn val_every_mistake_of_a_vehicle_is_told() {
        let text = std::fs::read_to_string(config("vehicles/f550.toml")).expect("readable");
        let text = text
            .replacen("mass_kg = ", "mass_kg = -", 1)
            .replacen("resistance_ohm = ", "resistance_ohm = -", 1);
        let found = VehicleDocuments::complaints(&text, config("vehicles"));
        let keys: Vec<&str> = found.iter().filter_map(|error| error.key()).collect();
        assert_eq!(keys.len(), 2, "{found:?}");
        assert!(keys.iter().any(|key| key.ends_with("mass_kg")), "{keys:?}");
        assert!(keys.iter().any(|key| key.ends_with("resistance_ohm")), "{keys:?}");
    }

    #[test]
    fn val_what_is_no_toml_has_one_complaint() {
        let found = Scenario::complaints("name = ", config("scenarios"));
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].line(), Some(1));
    }
}
