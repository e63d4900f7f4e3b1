//! Canonical CSV: header line, comma, `.` decimal, empty = missing.
//!
//! Read: UTF-8 with or without a byte-order mark, LF or CRLF, cells in double quotes if need be (without line breaks inside), blank
//! lines at the end. Written: shortest decimal text that reads back to the same f64.

use super::table::{RawColumn, Table};
use super::{FlightLog, LogError, MAX_COLUMNS, error, names};
use std::collections::HashSet;
use std::io::Write;
use std::path::Path;

/// What helps with a table of another program.
pub(crate) const DRAFT: &str = "a table of another program: `rotortwin log map FILE` drafts a mapping for it";

/// Cells of one line, at most one more than `most`; quotes are taken off.
fn cells(line: &str, most: usize) -> Vec<&str> {
    if !line.contains('"') {
        return line.split(',').map(str::trim).take(most + 1).collect();
    }
    let mut cells = Vec::new();
    let mut start = 0;
    let mut quoted = false;
    for (at, byte) in line.bytes().enumerate() {
        match byte {
            b'"' => quoted = !quoted,
            b',' if !quoted => {
                cells.push(unquoted(&line[start..at]));
                start = at + 1;
                if cells.len() > most {
                    return cells;
                }
            }
            _ => {}
        }
    }
    cells.push(unquoted(&line[start..]));
    cells
}

fn unquoted(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"')
        .and_then(|cell| cell.strip_suffix('"'))
        .unwrap_or(cell)
}

/// `DJIFlightRecord_2021-09-05_[19-23-47].txt`
fn is_dji_flight_record(path: &Path) -> bool {
    let name = path.file_name().and_then(std::ffi::OsStr::to_str).unwrap_or_default();
    name.starts_with("DJIFlightRecord")
}

/// Reads the table of a CSV file.
pub(crate) fn read(path: &Path, bytes: &[u8], most_cells: usize) -> Result<Table, LogError> {
    if bytes.iter().all(u8::is_ascii_whitespace) {
        return Err(LogError::format(
            path,
            "the file is empty; a header line with column names was expected",
        ));
    }
    let text = std::str::from_utf8(bytes).map_err(|bad| {
        if is_dji_flight_record(path) {
            return LogError::format(
                path,
                "a DJI flight record, which is encrypted and holds no motor outputs; a program that exports it as CSV, and a mapping for that \
                 (`rotortwin log map`), give position, velocity and attitude",
            );
        }
        let line = 1 + bytes[..bad.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        LogError::format(
            path,
            format!("line {line} is not UTF-8 text; a log in CSV or one of the binary formats that this program reads was expected"),
        )
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = text.lines().enumerate();
    let header = lines
        .by_ref()
        .map(|(_, line)| line)
        .find(|line| !line.trim().is_empty())
        .unwrap_or_default();
    let mut columns = header_columns(path, header)?;
    let most_rows = most_cells / columns.len();
    let mut rows = 0;
    let mut blank = None;
    for (index, line) in lines {
        if line.trim().is_empty() {
            blank.get_or_insert(index + 1);
            continue;
        }
        if let Some(blank) = blank {
            return Err(LogError::format(
                path,
                format!("line {blank} is blank, but rows follow it"),
            ));
        }
        rows += 1;
        if rows > most_rows {
            return Err(LogError::format(
                path,
                format!("more than {most_rows} rows of {} columns", columns.len()),
            ));
        }
        let cells = cells(line, columns.len());
        if cells.len() != columns.len() {
            let more = if cells.len() > columns.len() { "or more " } else { "" };
            return Err(LogError::format(
                path,
                format!(
                    "row {rows} has {} {more}cells; the header has {} columns ({DRAFT})",
                    cells.len(),
                    columns.len()
                ),
            ));
        }
        for (column, cell) in columns.iter_mut().zip(cells) {
            match cell {
                "" => column.values.push(f64::NAN),
                _ => match cell.parse::<f64>() {
                    Ok(value) if value.is_finite() => column.values.push(value),
                    _ => column.push_bad(cell),
                },
            }
        }
    }
    Ok(Table { columns })
}

fn header_columns(path: &Path, header: &str) -> Result<Vec<RawColumn>, LogError> {
    let names = cells(header, MAX_COLUMNS);
    if names.len() > MAX_COLUMNS {
        return Err(LogError::format(
            path,
            format!("more than {MAX_COLUMNS} columns in the header; a flight log was expected"),
        ));
    }
    let columns: Vec<RawColumn> = names.into_iter().map(RawColumn::new).collect();
    if columns.len() == 1 {
        for separator in [';', '\t'] {
            if header.contains(separator) {
                return Err(LogError::format(
                    path,
                    format!("the cells of the header are separated by {separator:?}; a comma was expected ({DRAFT})"),
                ));
            }
        }
    }
    if columns.iter().all(|column| column.name.parse::<f64>().is_ok()) {
        return Err(LogError::format(
            path,
            "the first line holds numbers; a header line with column names was expected",
        ));
    }
    let mut seen = HashSet::new();
    for (index, column) in columns.iter().enumerate() {
        if column.name.is_empty() {
            return Err(LogError::format(
                path,
                format!("column {} has no name in the header ({DRAFT})", index + 1),
            ));
        }
        if !seen.insert(&column.name) {
            return Err(LogError::column(
                path,
                &column.name,
                "duplicate column name in the header",
            ));
        }
    }
    Ok(columns)
}

impl FlightLog {
    /// Writes the log as canonical CSV.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_csv(&self, path: &Path) -> Result<(), LogError> {
        let wrap = |source| error::io(path, "cannot write the log")(source);
        let file = std::fs::File::create(path).map_err(wrap)?;
        let mut out = std::io::BufWriter::new(file);
        self.write_csv_to(&mut out).and_then(|()| out.flush()).map_err(wrap)
    }

    fn write_csv_to(&self, out: &mut impl Write) -> std::io::Result<()> {
        let columns = self.columns_in_order();
        write!(out, "{}", names::TIME)?;
        for (name, _) in &columns {
            if name.contains(',') {
                write!(out, ",\"{name}\"")?;
            } else {
                write!(out, ",{name}")?;
            }
        }
        writeln!(out)?;
        for (row, time_s) in self.time_s.iter().enumerate() {
            write!(out, "{time_s}")?;
            for (_, values) in &columns {
                match values[row] {
                    value if value.is_nan() => write!(out, ",")?,
                    value => write!(out, ",{value}")?,
                }
            }
            writeln!(out)?;
        }
        Ok(())
    }

    /// Columns for a file: canonical ones in the order of the format, then the others by name.
    pub(crate) fn columns_in_order(&self) -> Vec<(&str, &[f64])> {
        let mut columns: Vec<_> = self
            .columns
            .iter()
            .map(|(name, values)| (name.as_str(), values.as_slice()))
            .collect();
        columns.sort_by_key(|(name, _)| names::order(name));
        columns
    }
}
