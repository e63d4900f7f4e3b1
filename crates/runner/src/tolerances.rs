//! How exact a vehicle document is, by whoever wrote it, as a file beside it.

use std::path::{Path, PathBuf};

use rotortwin_twin::model::ModelVersion;
use rotortwin_twin::model::tolerances::{Tolerances, file};

use crate::destination::{self, write_text};
use crate::failure::Failure;
use crate::text::significant;

/// Writes `NAME.intervals.toml` beside `vehicle`, and returns what it says.
///
/// # Errors
/// The vehicle cannot be read, no tolerance is given, or the file exists or cannot be written.
pub fn write_tolerances(vehicle: &Path, tolerances: &Tolerances) -> Result<String, Failure> {
    let (path, text, told) = intervals(vehicle, tolerances).map_err(Failure::Input)?;
    write_text(&path, &text).map_err(|sentence| Failure::writing(&path, sentence))?;
    Ok(told)
}

fn intervals(vehicle: &Path, tolerances: &Tolerances) -> Result<(PathBuf, String, String), String> {
    let version = ModelVersion::load(vehicle).map_err(|error| error.to_string())?;
    let values = tolerances.intervals(&version.vehicle);
    if values.is_empty() {
        return Err("no tolerance is given: expected at least one, such as mass=1%".to_owned());
    }
    let path = vehicle.with_extension("intervals.toml");
    if path.exists() {
        return Err(format!(
            "{} exists already; expected none: edit or remove it",
            path.display()
        ));
    }
    destination::writable_file(&path)?;
    let name = vehicle
        .file_name()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let mut told = format!("{}: 95 % intervals of {name}\n", path.display());
    for one in &values {
        let (low, high) = (significant(one.low), significant(one.high));
        let line = format!("  {}: {low} to {high} {}", one.name, one.unit);
        told += line.trim_end();
        told.push('\n');
    }
    told += "What loads the vehicle takes them as known; a diagnosis repeats them under \"Assumed\".\n";
    Ok((path, file(&name, &values), told))
}
