//! Paths in documents: they lead to other files of the library, never outside.

use crate::problem::Problem;
use std::path::{Component, Path};

/// Keys of a scenario that contain file paths.
pub(super) const PATHS: [&str; 3] = ["vehicle", "fdi", "effect_files"];

/// The value of a setting `key=value` with a path key must lead to a file of the library.
pub(super) fn stays_inside(setting: &str) -> Result<(), Problem> {
    let Some((key, value)) = setting.split_once('=') else {
        return Ok(());
    };
    let first = key
        .split('.')
        .next()
        .unwrap_or_default()
        .trim()
        .trim_matches(['"', '\'']);
    if !PATHS.contains(&first) {
        return Ok(());
    }
    // Parsed as the scenario does: a TOML value, or a bare word.
    let value = value.trim();
    match toml::from_str::<toml::Table>(&format!("value = {value}")) {
        Ok(table) => table.values().try_for_each(every_path_inside),
        Err(_) => inside(value),
    }
}

pub(super) fn every_path_inside(value: &toml::Value) -> Result<(), Problem> {
    match value {
        toml::Value::String(text) => inside(text),
        toml::Value::Array(values) => values.iter().try_for_each(every_path_inside),
        toml::Value::Table(table) => table.values().try_for_each(every_path_inside),
        _ => Ok(()),
    }
}

/// Relative to `scenarios/`, and not out of the library.
fn inside(path: &str) -> Result<(), Problem> {
    let mut depth = 1_i32; // scenarios/
    let mut inside = !path.contains('\\');
    for part in Path::new(path).components() {
        match part {
            Component::ParentDir => depth -= 1,
            Component::Normal(_) => depth += 1,
            Component::CurDir => {}
            Component::RootDir | Component::Prefix(_) => inside = false,
        }
        inside &= depth >= 0;
    }
    if inside {
        return Ok(());
    }
    Err(Problem::unprocessable(format!(
        "'{path}' is outside the library; expected a path such as ../vehicles/f550.toml"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_paths_stay_in_the_library() {
        for good in [
            "vehicle=../vehicles/f550.toml",
            "fdi.network='../classifiers/a.json'",
            "seed=3",
            "name='/x'",
        ] {
            assert_eq!(stays_inside(good), Ok(()), "{good}");
        }
        for bad in [
            "vehicle=/etc/passwd",
            "vehicle='../../secret.toml'",
            "fdi.network=\"..\\\\..\\\\x\"",
            "effect_files=['a.toml', '../../../x.toml']",
            "fdi={network='/x'}",
            "vehicle=../vehicles/../../x",
        ] {
            let refusal = stays_inside(bad).expect_err(bad);
            assert_eq!(refusal.status, 422, "{bad}");
        }
    }
}
