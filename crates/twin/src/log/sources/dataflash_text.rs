//! ArduPilot DataFlash, text (`.log`): the same messages as lines `NAME, value, value, …`, described by `FMT` lines.
//!
//! The text holds scaled values (degrees, not hundredths). Lines that are no message are counted, not an error.

use super::dataflash::Gathered;
use super::{MAX_COLUMNS, Room, SourceLog};
use std::collections::BTreeMap;

/// Where a `FMT` line must be found for the file to be one.
const SEARCH_BYTES: usize = 4096;

pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(SEARCH_BYTES)];
    head.starts_with(b"FMT,") || head.windows(5).any(|window| window == b"\nFMT,")
}

/// Parses a text DataFlash log.
pub(super) fn parse(bytes: &[u8], mut room: Room) -> Result<SourceLog, String> {
    let text = String::from_utf8_lossy(bytes);
    let mut formats: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    let mut gathered = Gathered::new(room);
    let mut odd_lines = 0;
    for line in text.lines() {
        let mut cells = line.split(',').map(str::trim);
        let name = cells.next().unwrap_or_default();
        if name == "FMT" {
            // Type, length, name, format, labels …
            let mut cells = cells.skip(2);
            if let (Some(name), Some(_)) = (cells.next(), cells.next()) {
                room.format()?;
                let labels = cells.filter(|label| !label.is_empty());
                formats.insert(name, labels.take(MAX_COLUMNS).collect());
            }
            continue;
        }
        let Some(labels) = formats.get(name) else {
            continue;
        };
        let cells: Vec<&str> = cells.take(labels.len() + 2).collect();
        if cells.len() < labels.len() {
            odd_lines += 1;
            continue;
        }
        if name == "PARM" {
            // Newer logs have the time first.
            let at = labels.iter().position(|label| *label == "Name").unwrap_or(0);
            let value = cells.get(at + 1).and_then(|cell| cell.parse().ok());
            if let Some(value) = value {
                let time = labels.iter().position(|label| *label == "TimeUS");
                let time = time.and_then(|at| Some(("TimeUS", cells[at].parse().ok()?)));
                let values: Vec<(&str, f64)> = time.into_iter().chain([("Value", value)]).collect();
                gathered.push(name, &values, Some(cells[at]))?;
            }
            continue;
        }
        let values: Vec<(&str, f64)> = labels
            .iter()
            .zip(&cells)
            .map(|(label, cell)| (*label, cell.parse().unwrap_or(f64::NAN)))
            .collect();
        gathered.push(name, &values, None)?;
    }
    if formats.is_empty() {
        return Err("no FMT line that describes a message; a text DataFlash log was expected".to_owned());
    }
    let mut log = gathered.finish();
    if odd_lines > 0 {
        log.notes.push(format!(
            "{odd_lines} lines are shorter than their format and are left out"
        ));
    }
    Ok(log)
}
