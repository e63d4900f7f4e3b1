//! Columns of a canonical file (CSV, Parquet) corrected by a mapping: exchanged, with other signs, units or axes.
//!
//! ```toml
//! source = "canonical"
//! [[column]]
//! to = "rates"
//! from = "file:pitch_rate_rad_s,roll_rate_rad_s,yaw_rate_rad_s"   # columns of the file; `file` is its one topic
//! unit = "deg/s"
//! ```
//! Every row reads the original file, whatever other rows write; columns that no row writes are unchanged. A result
//! that is not canonical is rejected as for any file.

use super::assemble::{chosen_unit, scale, turn};
use super::mapping::{Frame, MappingFile, Row, Target};
use super::names;
use super::table::{RawColumn, Table};

/// The only topic of a canonical file.
const TOPIC: &str = "file";

/// Puts columns where the mapping says; notes what was done, one line per row. The error is the reason without the
/// file's name.
pub(crate) fn remap(table: &mut Table, mapping: &MappingFile) -> Result<Vec<String>, String> {
    let file = table.columns.clone();
    let mut done = Vec::new();
    for row in &mapping.rows {
        for column in written(row, &file)? {
            table.columns.retain(|other| other.name != column.name);
            table.columns.push(column);
        }
        let unit = row.unit.list().join(" or ");
        let factor = row.factor.map_or_else(String::new, |factor| format!(", × {factor}"));
        let frame = row
            .frame
            .map_or_else(String::new, |frame| format!(", from {} axes", frame.name()));
        done.push(format!("{} ← {}, in {unit}{frame}{factor}", row.to, row.from));
    }
    Ok(done)
}

/// The columns that a row writes.
fn written(row: &Row, file: &[RawColumn]) -> Result<Vec<RawColumn>, String> {
    let place = row.place().filter(|place| place.topic == TOPIC);
    let place = place.ok_or_else(|| format!("from = \"{}\": expected \"{TOPIC}:column,column\"", row.from))?;
    if row.low.is_some() || row.high.is_some() || row.order.is_some() || row.valid.is_some() {
        return Err(format!(
            "'{}': low, high, order and valid are for the logs of autopilots; name the columns in the order of the rotors",
            row.to
        ));
    }
    if row.frame == Some(Frame::Geodetic) {
        return Err(format!("'{}': a canonical file has no latitudes", row.to));
    }
    let mut columns = place
        .fields
        .iter()
        .map(|field| file.iter().find(|column| column.name == *field).cloned())
        .zip(&place.fields)
        .map(|(column, field)| {
            column.ok_or_else(|| format!("from names {field}, a column that the file does not have"))
        })
        .collect::<Result<Vec<_>, _>>()?;
    let names: Vec<String> = match Target::of(&row.to) {
        Target::Columns(names, _) => names.into_iter().map(str::to_owned).collect(),
        Target::Duty => (1..=columns.len()).map(names::duty).collect(),
        Target::RotorSpeed => (1..=columns.len()).map(names::rotor_speed).collect(),
        Target::Own(name) => vec![name],
    };
    if names.len() != columns.len() {
        return Err(format!(
            "'{}' is {} columns, from names {}",
            row.to,
            names.len(),
            columns.len()
        ));
    }
    let mut values: Vec<Vec<f64>> = columns
        .iter_mut()
        .map(|column| std::mem::take(&mut column.values))
        .collect();
    let (_, factor) = chosen_unit(row, &values)?;
    scale(&mut values, factor * row.factor.unwrap_or(1.0));
    if let Some(frame) = row.frame {
        turn(&row.to, frame, &mut values);
    }
    for ((column, name), values) in columns.iter_mut().zip(names).zip(values) {
        column.name = name;
        column.values = values;
    }
    Ok(columns)
}
