//! Reads one TOML document with errors that name file, line and key.
//!
//! serde reports *what* is wrong, the spanned tree of the same text *where*; this module combines the two. Public, because
//! the model versions of the twin are documents of the same kind.

use std::ops::Range;
use std::path::{Component, Path, PathBuf};

use serde::de::DeserializeOwned;
use toml::de::{DeArray, DeTable, DeValue};

use crate::error::ConfigError;
use rotortwin_plant::error::Refusal;

/// Larger documents are rejected without reading: a vehicle or scenario takes a few kilobytes.
pub const MAX_DOCUMENT_BYTES: u64 = 1 << 20;

/// Documents with more of `[`, `{` and `.` are rejected without reading. Each may begin a table, which takes a kilobyte or two in memory for two
/// bytes of the text; as each is one of a number with a fraction as well, the largest classifier must stay below.
pub const MOST_OPENINGS: usize = 100_000;

/// Maximum number of keys or entries of one table or list tried one by one to locate a serde error.
const MAX_SUSPECTS: usize = 256;

/// Maximum size of all texts tried to locate one serde error, each suspect being a text of its own: 131 suspects in a document of 8 kB, one in a
/// document of a mebibyte. Where there are more, the error is that of the table or list that holds them.
const MAX_TRIED_BYTES: usize = 1 << 20;

/// Maximum number of parts of a key that an override sets: the reader of TOML goes no deeper.
const MAX_KEY_PARTS: usize = 80;

/// A TOML text and the name that errors use for it.
#[derive(Debug, Clone)]
pub struct Document {
    name: String,
    text: String,
    /// False if the text is not what the user wrote, so that line numbers would mislead.
    as_written: bool,
}

impl Document {
    /// A text that errors refer to as `name`; rejected if larger than a mebibyte.
    pub fn from_text(name: impl Into<String>, text: impl Into<String>) -> Result<Self, ConfigError> {
        let (name, text) = (name.into(), text.into());
        if let Some(reason) = too_much(&text) {
            return Err(ConfigError::new(&name, None, None, reason));
        }
        Ok(Self {
            name,
            text,
            as_written: true,
        })
    }

    /// The text of a modified document: errors name no line of it.
    pub(crate) fn rewritten(name: &str, text: String) -> Result<Self, ConfigError> {
        Ok(Self {
            as_written: false,
            ..Self::from_text(name, text)?
        })
    }

    /// Reads the file at `path`.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let name = plain(path);
        let refuse = |reason: String| ConfigError::new(&name, None, None, reason);
        let metadata = std::fs::metadata(path).map_err(|e| refuse(unreadable(&e)))?;
        if !metadata.is_file() {
            return Err(refuse("expected a TOML file, this is not a regular file".into()));
        }
        if metadata.len() > MAX_DOCUMENT_BYTES {
            return Err(refuse(too_large(metadata.len())));
        }
        let text = std::fs::read_to_string(path).map_err(|e| refuse(unreadable(&e)))?;
        Self::from_text(name, text)
    }

    /// The document with keys set by `key=value` texts; see [`crate::Scenario::load_with`].
    pub(crate) fn with_overrides(self, overrides: &[&str]) -> Result<Self, ConfigError> {
        if overrides.is_empty() {
            return Ok(self);
        }
        if let Some(reason) = too_much(&overrides.join("\n")) {
            return Err(ConfigError::new(&self.name, None, None, format!("overrides: {reason}")));
        }
        let mut table: toml::Table = self.parse()?;
        for text in overrides {
            let refuse = |reason: &str| ConfigError::new(&self.name, None, None, format!("{reason}, got `{text}`"));
            let (key, value) = text
                .split_once('=')
                .ok_or_else(|| refuse("expected an override key=value"))?;
            let value = format!("v = {value}")
                .parse::<toml::Table>()
                .ok()
                .and_then(|mut parsed| parsed.remove("v"))
                .unwrap_or_else(|| toml::Value::String(value.trim().to_owned()));
            let (holder, last) = key
                .trim()
                .rsplit_once('.')
                .map_or((None, key.trim()), |(h, l)| (Some(h), l));
            if key.split('.').count() > MAX_KEY_PARTS {
                return Err(refuse(&format!("expected a key of at most {MAX_KEY_PARTS} parts")));
            }
            let mut target = &mut table;
            for part in holder.iter().flat_map(|h| h.split('.')) {
                let within = match part.strip_suffix(']').and_then(|part| part.split_once('[')) {
                    // As errors and axes of campaigns write it; an entry that is not there is not made.
                    Some((name, index)) => {
                        let index = index.parse::<usize>().ok();
                        let entries = target.get_mut(name).and_then(toml::Value::as_array_mut);
                        let entry = entries.zip(index).and_then(|(entries, index)| entries.get_mut(index));
                        entry.ok_or_else(|| {
                            refuse(&format!(
                                "expected an entry that the document has, `{name}[0]` is the first"
                            ))
                        })?
                    }
                    None => target
                        .entry(part)
                        .or_insert_with(|| toml::Value::Table(toml::Table::new())),
                };
                target = within
                    .as_table_mut()
                    .ok_or_else(|| refuse("expected a key within tables"))?;
            }
            target.insert(last.to_owned(), value);
        }
        let Some(text) = to_text(&toml::Value::Table(table)) else {
            let reason =
                format!("expected a document of at most {MAX_DOCUMENT_BYTES} bytes, with these overrides it is larger");
            return Err(ConfigError::new(&self.name, None, None, reason));
        };
        Ok(Self {
            name: self.name,
            text,
            as_written: false,
        })
    }

    /// Reads the document at `path`, the value of `key`; failures point to the key.
    pub fn follow(&self, key: &str, path: &Path) -> Result<Self, ConfigError> {
        if path.is_file() {
            return Self::read(path);
        }
        Err(self.refuse(Refusal::new(key, no_file("TOML", path))))
    }

    /// Deserialises the document as `T`; unknown keys, missing keys and wrong types are errors.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        toml::from_str(&self.text).map_err(|error| self.explain::<T>(&error))
    }

    /// Adds file and line to a rejected value.
    pub fn refuse(&self, refusal: Refusal) -> ConfigError {
        let line = self
            .span_of(&refusal.key)
            .filter(|_| self.as_written)
            .map(|span| self.line_at(span.start));
        let key = (!refusal.key.is_empty()).then_some(refusal.key);
        ConfigError::new(&self.name, line, key, refusal.reason)
    }

    /// Whether the document is a TOML table with this top-level key.
    pub fn has_key(&self, key: &str) -> bool {
        DeTable::parse(&self.text).is_ok_and(|root| root.get_ref().iter().any(|(name, _)| name.get_ref() == key))
    }

    /// Name used in errors.
    pub fn name(&self) -> &str {
        &self.name
    }

    fn line_at(&self, offset: usize) -> usize {
        1 + self.text.as_bytes()[..offset.min(self.text.len())]
            .iter()
            .filter(|&&byte| byte == b'\n')
            .count()
    }

    /// Position of the longest existing prefix of the dotted path `key`.
    fn span_of(&self, key: &str) -> Option<Range<usize>> {
        let root = DeTable::parse(&self.text).ok()?;
        let mut found = None;
        let mut table = Some(root.get_ref());
        let mut array = None;
        for part in key.split(['.', '[']) {
            if let Some(index) = part.strip_suffix(']') {
                let index = index.parse::<usize>().ok();
                let Some(value) = array
                    .take()
                    .zip(index)
                    .and_then(|(a, i): (&DeArray<'_>, usize)| a.get(i))
                else {
                    break;
                };
                found = Some(value.span());
                (table, array) = (value.get_ref().as_table(), value.get_ref().as_array());
            } else {
                let Some((name, value)) = table
                    .take()
                    .and_then(|t| t.iter().find(|(name, _)| name.get_ref() == part))
                else {
                    break;
                };
                found = Some(name.span());
                (table, array) = (value.get_ref().as_table(), value.get_ref().as_array());
            }
        }
        found
    }

    /// Converts a serde error into a [`ConfigError`].
    fn explain<T: DeserializeOwned>(&self, error: &toml::de::Error) -> ConfigError {
        let message = error.message();
        let span = error.span();
        let mut line = span.as_ref().map(|s| self.line_at(s.start));
        let Ok(root) = DeTable::parse(&self.text) else {
            let found = span
                .and_then(|s| self.text.get(s))
                .filter(|t| !t.is_empty() && !t.contains('\n') && t.len() < 40);
            let found = found.map_or(String::new(), |text| format!(" at `{text}`"));
            let reason = format!("expected valid TOML: {}{found}", one_line(message));
            return ConfigError::new(&self.name, line, None, reason);
        };
        let mut path = Vec::new();
        let (mut holder, mut depth) = (root.get_ref(), 0);
        if let Some(span) = &span {
            (holder, depth) = descend(holder, span, &mut path);
        }
        let (named, reason) = reword(message);
        let mut key = join(&path);
        if let Some(name) = named {
            if let Some((present, _)) = holder.iter().find(|(present, _)| present.get_ref() == name) {
                line = Some(self.line_at(present.span().start));
            } else if depth == 0 {
                line = None;
            }
            path.truncate(depth);
            if path.last() != Some(&name.to_owned()) {
                path.push(name.to_owned());
            }
            key = join(&path);
        } else if path.len() == depth {
            // serde buffers tables with a `kind` and loses the positions of their values.
            self.search::<T>(&mut path, message);
            key = join(&path);
            line = self.span_of(&key).map(|found| self.line_at(found.start)).or(line);
        }
        let line = line.filter(|_| self.as_written);
        ConfigError::new(&self.name, line, (!key.is_empty()).then_some(key), reason)
    }

    /// Extends `path` to the value whose removal changes the error.
    fn search<T: DeserializeOwned>(&self, path: &mut Vec<String>, message: &str) {
        let whole_list = message.starts_with("invalid length");
        let Ok(root) = self.text.parse::<toml::Table>() else {
            return;
        };
        let mut root = toml::Value::Table(root);
        let mut left = MAX_TRIED_BYTES / self.text.len().max(1);
        loop {
            let Some(holder) = at(&mut root, path) else { return };
            let parts: Vec<String> = match holder {
                // The `kind` determines what else is expected: check it last.
                toml::Value::Table(table) => {
                    let (kind, mut keys): (Vec<_>, Vec<_>) = table.keys().cloned().partition(|key| key == "kind");
                    keys.extend(kind);
                    keys
                }
                toml::Value::Array(items) if !whole_list => (0..items.len()).map(|i| format!("[{i}]")).collect(),
                _ => return,
            };
            if parts.len() > left.min(MAX_SUSPECTS) {
                return;
            }
            left -= parts.len();
            let culprit = parts.into_iter().find(|part| {
                let mut changed = root.clone();
                remove(at(&mut changed, path), part);
                T::deserialize(changed).map_or_else(|error| error.message() != message, |_| true)
            });
            match culprit {
                Some(part) => path.push(part),
                None => return,
            }
        }
    }
}

/// Why a text is refused before anything looks into it: it would take too much time or memory to read.
pub fn too_much(text: &str) -> Option<String> {
    if text.len() as u64 > MAX_DOCUMENT_BYTES {
        return Some(too_large(text.len() as u64));
    }
    let openings = text.bytes().filter(|byte| matches!(byte, b'[' | b'{' | b'.')).count();
    (openings > MOST_OPENINGS).then(|| {
        format!("expected a document with at most {MOST_OPENINGS} of `[`, `{{` and `.`, this one has {openings}")
    })
}

/// A table that was read, as a text; `None` if that would be larger than a document may be.
///
/// It can be many times as long as what was read: `{ a = {}, b = {} }` under a long key repeats that in the header of each table, and `1e300`
/// has 301 digits. So its length is estimated first.
pub fn to_text(table: &toml::Value) -> Option<String> {
    if unfolded_bytes(table, 0) as u64 > MAX_DOCUMENT_BYTES {
        return None;
    }
    toml::to_string(table).ok().filter(|text| too_much(text).is_none())
}

/// Length of the headers of all tables and of all floating-point numbers, which may be longer than in the text that was read.
///
/// * `above`: length of the header of the table that holds the value
fn unfolded_bytes(value: &toml::Value, above: usize) -> usize {
    match value {
        toml::Value::Table(table) => table
            .iter()
            .map(|(key, value)| unfolded_bytes(value, above + key.len() + 1))
            .fold(above, usize::saturating_add),
        toml::Value::Array(items) => items
            .iter()
            .map(|item| unfolded_bytes(item, above))
            .fold(0, usize::saturating_add),
        toml::Value::Float(number) => number.to_string().len(),
        _ => 0,
    }
}

/// Dotted path of keys and `[index]` parts.
pub(crate) fn join(path: &[String]) -> String {
    path.join(".").replace(".[", "[")
}

/// The number of an `[index]` part.
pub(crate) fn index(part: &str) -> Option<usize> {
    part.strip_prefix('[')?.strip_suffix(']')?.parse().ok()
}

/// The value at a path of keys and `[index]` parts.
pub(crate) fn at<'a>(root: &'a mut toml::Value, path: &[String]) -> Option<&'a mut toml::Value> {
    path.iter().try_fold(root, |value, part| match index(part) {
        Some(i) => value.as_array_mut()?.get_mut(i),
        None => value.as_table_mut()?.get_mut(part),
    })
}

fn remove(holder: Option<&mut toml::Value>, part: &str) {
    match (holder, index(part)) {
        (Some(toml::Value::Array(items)), Some(i)) if i < items.len() => drop(items.remove(i)),
        (Some(toml::Value::Table(table)), None) => drop(table.remove(part)),
        _ => {}
    }
}

/// The path as text, without detours such as `scenarios/../vehicles`.
pub(crate) fn plain(path: &Path) -> String {
    let mut parts = Vec::new();
    for part in path.components() {
        match (part, parts.last()) {
            (Component::ParentDir, Some(Component::Normal(_))) => drop(parts.pop()),
            (Component::CurDir, _) => {}
            _ => parts.push(part),
        }
    }
    if parts.is_empty() {
        // The folder one is in.
        return path.display().to_string();
    }
    parts.iter().collect::<PathBuf>().display().to_string()
}

/// Why `path` is not a file of a kind: missing, or a folder.
pub(crate) fn no_file(kind: &str, path: &Path) -> String {
    let found = if path.is_dir() {
        format!("{} is a folder", plain(path))
    } else if path.exists() {
        format!("{} is not a regular file", plain(path))
    } else {
        format!("found none at {}", plain(path))
    };
    format!("expected the path of a {kind} file, {found}")
}

fn too_large(bytes: u64) -> String {
    format!("expected a document of at most {MAX_DOCUMENT_BYTES} bytes, this one has {bytes}")
}

fn unreadable(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "file not found; expected a TOML file".into(),
        std::io::ErrorKind::InvalidData => "expected UTF-8 text".into(),
        _ => format!("expected a readable TOML file: {error}"),
    }
}

fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Walks to the innermost table that contains `span`, noting the keys on the way; returns that table and the length of its
/// path.
fn descend<'a, 'i>(
    mut table: &'a DeTable<'i>,
    span: &Range<usize>,
    path: &mut Vec<String>,
) -> (&'a DeTable<'i>, usize) {
    'next: loop {
        let depth = path.len();
        for (key, value) in table {
            let whole = key.span().start..value.span().end.max(key.span().end);
            let here = value.span() == *span || (whole.start <= span.start && span.end <= whole.end);
            let value = value.get_ref();
            if here {
                path.push(key.get_ref().to_string());
                match value {
                    DeValue::Table(inner) => {
                        table = inner;
                        continue 'next;
                    }
                    DeValue::Array(items) => {
                        for (i, item) in items.iter().enumerate() {
                            if item.span().start <= span.start && span.end <= item.span().end {
                                path.push(format!("[{i}]"));
                                if let DeValue::Table(inner) = item.get_ref() {
                                    table = inner;
                                    continue 'next;
                                }
                            }
                        }
                    }
                    _ => {}
                }
                return (table, depth);
            }
            // `[header]` tables: the span of the value is that of the header, their keys lie outside it.
            if let DeValue::Table(inner) = value
                && holds(inner, span)
            {
                path.push(key.get_ref().to_string());
                table = inner;
                continue 'next;
            }
            if let DeValue::Array(items) = value {
                for (i, item) in items.iter().enumerate() {
                    if let DeValue::Table(inner) = item.get_ref()
                        && (holds(inner, span) || item.span() == *span)
                    {
                        path.extend([key.get_ref().to_string(), format!("[{i}]")]);
                        table = inner;
                        continue 'next;
                    }
                }
            }
        }
        return (table, depth);
    }
}

fn holds(table: &DeTable<'_>, span: &Range<usize>) -> bool {
    table.iter().any(|(key, value)| {
        let inside = |s: Range<usize>| s.start <= span.start && span.end <= s.end;
        inside(key.span())
            || inside(value.span())
            || matches!(value.get_ref(), DeValue::Table(inner) if holds(inner, span))
            || matches!(value.get_ref(), DeValue::Array(items) if items.iter().any(|item|
                matches!(item.get_ref(), DeValue::Table(inner) if holds(inner, span))))
    })
}

/// The key that a message of serde names, if any, and the message in the wording of [`ConfigError`], without the names of Rust's types.
pub fn reword(message: &str) -> (Option<&str>, String) {
    let quoted = message.split('`').nth(1);
    if message.starts_with("unknown field") {
        let expected: Vec<&str> = message.split('`').skip(3).step_by(2).collect();
        let hint = quoted.and_then(|name| same_stem(name, &expected));
        let reason = match (hint, expected.is_empty()) {
            (Some(hint), _) => format!("unknown key, expected `{hint}` (units are part of the names)"),
            (None, true) => "unknown key, none is expected here".into(),
            (None, false) => format!("unknown key, expected one of {}", expected.join(", ")),
        };
        return (quoted, reason);
    }
    if message.starts_with("missing field") {
        return (quoted, "missing key".into());
    }
    if let Some(rest) = message.strip_prefix("invalid type: ") {
        let (found, expected) = rest.split_once(", expected ").unwrap_or((rest, "another type"));
        return (
            None,
            format!("expected {}, got {}", plain_type(expected), one_line(found)),
        );
    }
    if let Some(rest) = message.strip_prefix("invalid length ") {
        let (found, expected) = rest.split_once(", expected ").unwrap_or((rest, "another length"));
        let expected = expected
            .split_whitespace()
            .find(|word| word.parse::<usize>().is_ok())
            .unwrap_or(expected);
        return (None, format!("expected a list of {expected}, got {found}"));
    }
    if let Some(rest) = message.strip_prefix("invalid value: ") {
        let (found, expected) = rest.split_once(", expected ").unwrap_or((rest, "another value"));
        return (
            None,
            format!("expected {}, got {}", plain_type(expected), one_line(found)),
        );
    }
    if message.starts_with("unknown variant") {
        let expected: Vec<&str> = message.split('`').skip(3).step_by(2).collect();
        let reason = format!(
            "expected one of {}, got `{}`",
            expected.join(", "),
            quoted.unwrap_or_default()
        );
        return (None, reason);
    }
    (None, one_line(message))
}

/// The expected key that equals `name` except for the unit suffix.
fn same_stem<'a>(name: &str, expected: &[&'a str]) -> Option<&'a str> {
    let stem = name.split('_').next().filter(|stem| stem.len() > 2)?;
    let shared = |candidate: &str| {
        name.split('_')
            .zip(candidate.split('_'))
            .take_while(|(a, b)| a == b)
            .count()
    };
    let best = expected.iter().copied().max_by_key(|candidate| shared(candidate))?;
    (best.split('_').next() == Some(stem)).then_some(best)
}

fn plain_type(expected: &str) -> &str {
    match expected {
        "f64" | "f32" => "a number",
        "u64" | "u32" | "u16" | "u8" | "usize" => "a whole number, 0 or more",
        "i64" | "i32" | "i16" | "i8" | "isize" => "a whole number",
        "a sequence" => "a list",
        "a boolean" => "true or false",
        "a string" => "a text",
        other if other.contains("struct ") || other.contains("enum ") || other == "a map" => "names with values",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::{Deserialize, Deserializer};
    use std::cell::Cell;

    thread_local! {
        static TRIED: Cell<usize> = const { Cell::new(0) };
    }

    /// Refuses everything with an error that names no key, and counts how often.
    struct Refused;

    impl<'de> Deserialize<'de> for Refused {
        fn deserialize<D: Deserializer<'de>>(_: D) -> Result<Self, D::Error> {
            TRIED.set(TRIED.get() + 1);
            Err(serde::de::Error::custom("no"))
        }
    }

    #[test]
    fn val_an_error_is_looked_for_only_so_long() {
        for (keys, bytes, searched) in [(100, 5_000, true), (100, 50_000, false), (300, 6_000, false)] {
            let text: String = (0..keys)
                .map(|number| format!("k{number:03}='{}'\n", "x".repeat(bytes / keys - 8)))
                .collect();
            TRIED.set(0);
            let refused = Document::from_text("text", text).and_then(|document| document.parse::<Refused>().map(drop));
            assert_eq!(refused.map_err(|error| error.reason().to_owned()), Err("no".to_owned()));
            let expected = if searched { 1 + keys } else { 1 };
            assert_eq!(TRIED.get(), expected, "{keys} keys in {bytes} bytes");
        }
    }

    fn refusal(text: &str) -> String {
        Document::from_text("text", text)
            .map(drop)
            .map_or_else(|error| error.to_string(), |()| String::new())
    }

    #[test]
    fn val_what_would_take_too_much_is_refused_before_it_is_read() {
        assert_eq!(refusal(&"#".repeat(1 << 20)), "");
        assert!(refusal(&"#".repeat((1 << 20) + 1)).contains("at most 1048576 bytes, this one has 1048577"));
        assert_eq!(refusal(&"[a]\n".repeat(MOST_OPENINGS)), "");
        let many = refusal(&format!("x{} = 1", ".a".repeat(MOST_OPENINGS + 1)));
        assert!(
            many.contains("at most 100000 of `[`, `{` and `.`, this one has 100001"),
            "{many}"
        );
    }

    #[test]
    fn val_overrides_are_refused_before_they_are_read() {
        let set = |overrides: &[&str]| {
            let document = Document::from_text("text", "a = 1\n").expect("short");
            document
                .with_overrides(overrides)
                .map(|document| document.text)
                .map_err(|error| error.to_string())
        };
        assert_eq!(set(&["b.c=2"]), Ok("a = 1\n\n[b]\nc = 2\n".to_owned()));
        let parts = |parts: usize| format!("{}=1", vec!["k"; parts].join("."));
        assert!(set(&[&parts(MAX_KEY_PARTS)]).is_ok());
        let deep = set(&[&parts(MAX_KEY_PARTS + 1)]).unwrap_err();
        assert!(deep.contains("expected a key of at most 80 parts"), "{deep}");
        let long = set(&[&format!("b={}", "x".repeat(1 << 20))]).unwrap_err();
        assert!(
            long.contains("overrides: expected a document of at most 1048576 bytes"),
            "{long}"
        );
        let tables: Vec<String> = (0..1_000).map(|number| format!("a{number}={{}}")).collect();
        let unfolded = set(&[&format!("{}={{{}}}", "k".repeat(5_000), tables.join(","))]).unwrap_err();
        assert!(unfolded.contains("with these overrides it is larger"), "{unfolded}");
    }
}
