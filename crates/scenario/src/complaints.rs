//! Collects all errors of a document, where reading it stops at the first.
//!
//! The reader is run repeatedly: each time, the value that it rejected is replaced by that of a known good document, or removed.
//! Further errors then concern the user's other values. An error that the repair itself could have caused (the same key again) is not
//! listed; where no repair is possible, the list ends, and more errors may appear later. So it does when the text has been read again for
//! two mebibytes in all: a text of 20 kB never ends its list so, one of 200 kB after about ten errors. The list then says so in a last entry.

use crate::error::ConfigError;
use crate::toml_document::{Document, at, index, join, to_text};
use rotortwin_plant::error::Refusal;
use std::collections::{BTreeMap, BTreeSet};
use toml::{Table, Value};

/// Maximum length of the list.
const MOST_COMPLAINTS: usize = 50;

/// Maximum size of all readings of a text after the first, so that a long list costs half a second and not minutes: 50 errors of 20 kB, each read
/// twice (repaired, and then left out).
const MOST_REREAD_BYTES: usize = 2 << 20;

/// Maximum number of parts of a key that is repaired: no document that can be read is nested deeper, but a quoted key may hold any number of dots.
const DEEPEST_KEY: usize = 160;

/// All errors that `check` reports about a text, in the order of checking; empty if it is valid. At most 50, and fewer for a text of more than
/// 20 kB: if it is not read once more for the next, the last entry says that there may be more.
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
    // In this order: what is too large is not parsed.
    let Ok(original) = Document::from_text(name, text) else {
        return vec![first];
    };
    let Ok(table) = text.parse::<Table>() else {
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
    let mut left = MOST_REREAD_BYTES;
    while let Some(error) = next.filter(|_| found.len() < MOST_COMPLAINTS) {
        let Some(key) = error.key().filter(|_| error.file() == name) else {
            found.push(error);
            break;
        };
        let path = parts(key);
        let written = match path.len() {
            0..=DEEPEST_KEY => join(&repair.as_written(&path)),
            _ => key.to_owned(),
        };
        if !found.iter().any(|other| other.key() == Some(&written)) {
            found.push(original.refuse(Refusal::new(written, error.reason())));
        }
        if path.len() > DEEPEST_KEY || !repair.replace_or_remove(&path) {
            break;
        }
        let Some(changed) = to_text(&repair.root).filter(|changed| changed.len() <= left) else {
            found.push(unfinished(name, text));
            break;
        };
        left -= changed.len();
        next = check(&changed).err();
    }
    found
}

/// The last entry of a list that ends before the text is without errors.
fn unfinished(name: &str, text: &str) -> ConfigError {
    let reason = format!(
        "there may be more errors, found once these are mended: a document of {} bytes is not read again for each",
        text.len()
    );
    ConfigError::new(name, None, None, reason)
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
    use super::*;
    use crate::{Scenario, VehicleDocuments};
    use serde::Deserialize;
    use std::cell::Cell;
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

    /// As [`super::complaints`] of `text`, whose keys are all wrong; also the bytes that were read for it.
    fn of_wrong_keys(text: &str) -> (Vec<ConfigError>, usize) {
        let read = Cell::new(0);
        let found = complaints("text", text, "", |text| {
            read.set(read.get() + text.len());
            Document::from_text("text", text)?.parse::<Nothing>().map(drop)
        });
        (found, read.get())
    }

    /// A document without keys.
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Nothing {}

    fn wrong_keys(bytes: usize) -> String {
        let keys: Vec<String> = (0..bytes / 11).map(|number| format!("k{number:05} = 1\n")).collect();
        keys.concat()
    }

    #[test]
    fn val_a_long_text_is_read_only_so_often() {
        let (found, _) = of_wrong_keys(&wrong_keys(20_000));
        assert_eq!(found.len(), MOST_COMPLAINTS);
        assert!(found.iter().all(|error| error.key().is_some()), "{found:?}");
        for bytes in [100_000, 300_000, 1_000_000] {
            let text = wrong_keys(bytes);
            let (found, read) = of_wrong_keys(&text);
            assert!(read <= text.len() + MOST_REREAD_BYTES, "{read} bytes read of {bytes}");
            assert_eq!(
                found.len(),
                2 + MOST_REREAD_BYTES / bytes,
                "{bytes}: one error for each reading, and the last entry"
            );
            let last = found.last().expect("there are some");
            assert_eq!(last.key(), None);
            assert!(last.reason().starts_with("there may be more errors"), "{last}");
        }
    }

    #[test]
    fn val_a_text_that_is_too_large_is_not_parsed() {
        let (found, read) = of_wrong_keys(&wrong_keys(1_100_000));
        assert_eq!((found.len(), read), (1, 1_100_000));
        assert!(found[0].reason().contains("at most 1048576 bytes"), "{}", found[0]);
    }

    /// A table under a long key is written with that key: 100 kB would become 500 MB.
    #[test]
    fn val_a_text_that_would_unfold_is_not_written() {
        let tables: Vec<String> = (0..10_000).map(|number| format!("a{number}={{}}")).collect();
        let text = format!("x = 1\n{} = {{{}}}\n", "y".repeat(50_000), tables.join(","));
        let (found, read) = of_wrong_keys(&text);
        assert_eq!(read, text.len(), "once");
        let keys: Vec<Option<&str>> = found.iter().map(ConfigError::key).collect();
        assert_eq!(keys, [Some("x"), None]);
    }

    #[test]
    fn val_a_key_of_many_parts_is_told_and_not_taken_apart() {
        for part in ["a.", "[0]"] {
            let key = part.repeat(30_000);
            let (found, _) = of_wrong_keys(&format!("\"{key}\" = 1\n"));
            assert_eq!(found.len(), 1);
            assert_eq!(found[0].key(), Some(key.as_str()));
        }
    }

    #[test]
    fn val_what_is_no_toml_has_one_complaint() {
        let found = Scenario::complaints("name = ", config("scenarios"));
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].line(), Some(1));
    }
}
