//! The true damage, from a side file or a column of the log itself.
//!
//! A side file is CSV with the columns `time_s,rotor,loss` and, for several logs, `log`: from `time_s` on (the log's time, as in `LOG@35:65`)
//! the rotor has lost this fraction of its thrust; 0 is healed, a negative value a gain, empty "unknown size". A healthy log has one row
//! with rotor 0.
//!
//! A column contains 0 (healthy), the damaged rotor from 1, or −1 (several) in each row; an accompanying mask `faulty_rotors`, with rotor 1
//! in bit 0, specifies them. The telemetry of a run has both, as `fault_label`.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::verdict_code::UNKNOWN;
use rotortwin_jobs::LogTruth;
use rotortwin_twin::log::FlightLog;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Mask of the damaged rotors for a label column.
const MASK_COLUMN: &str = "faulty_rotors";

/// Damaged rotors from a given time on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Damage {
    /// From this time of the log on, s.
    pub from_s: f64,
    /// Damaged rotors: bit 0 is rotor 1. 0 for several unspecified rotors, see `several`.
    pub rotors: u32,
    /// Several rotors are damaged, which the log does not specify.
    pub several: bool,
    /// Fractional thrust loss of each; NaN if unknown.
    pub loss: [f64; MAX_ROTORS],
}

impl Damage {
    /// 0 healthy, the rotor from 1, −1 several.
    pub fn label(&self) -> i32 {
        match self.rotors.count_ones() {
            _ if self.several => UNKNOWN,
            0 => 0,
            1 => i32::try_from(self.rotors.trailing_zeros() + 1).expect("at most 16 rotors"),
            _ => UNKNOWN,
        }
    }

    /// Largest fractional loss; NaN if one is unknown.
    pub fn worst(&self) -> f64 {
        let damaged = (0..MAX_ROTORS).filter(|rotor| self.rotors >> rotor & 1 == 1);
        let losses = damaged.map(|rotor| self.loss[rotor]);
        losses.fold(0.0, |worst: f64, loss| {
            if worst.is_nan() || loss.is_nan() {
                f64::NAN
            } else {
                worst.max(loss)
            }
        })
    }
}

/// Damage over the time of one log, earliest first; healthy before the first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Truth(Vec<Damage>);

impl Truth {
    /// Damage at a time of the log.
    pub fn at(&self, time_s: f64) -> Damage {
        let after = self.0.partition_point(|damage| damage.from_s <= time_s);
        after
            .checked_sub(1)
            .map_or_else(Damage::default, |last| self.0[last].clone())
    }

    /// Whether a rotor is damaged at any time in an interval.
    pub fn touches(&self, from_s: f64, to_s: f64) -> bool {
        let within = |damage: &&Damage| damage.from_s >= from_s && damage.from_s < to_s;
        self.at(from_s).label() != 0 || self.0.iter().filter(within).any(|damage| damage.label() != 0)
    }

    /// Whether the damage is constant over an interval.
    pub fn stands_still(&self, from_s: f64, to_s: f64) -> bool {
        !self
            .0
            .iter()
            .any(|damage| damage.from_s > from_s && damage.from_s < to_s)
    }

    /// First damage, s of the log's time.
    pub fn onset_s(&self) -> Option<f64> {
        self.0
            .iter()
            .find(|damage| damage.label() != 0)
            .map(|damage| damage.from_s)
    }

    fn of_column(log: &FlightLog, name: &str, labels: &[f64], rotor_count: usize) -> Result<Self, String> {
        let masks = log.column(MASK_COLUMN);
        let mut damages: Vec<Damage> = Vec::new();
        for (row, (time_s, label)) in log.time_s.iter().zip(labels).enumerate() {
            let whole = label.fract() == 0.0 && *label >= -1.0 && *label <= rotor_count as f64;
            if !whole {
                return Err(format!(
                    "{}: `{name}` is {label} at {time_s} s, expected 0 (healthy), a rotor from 1 to {rotor_count}, or -1 (several)",
                    log.name
                ));
            }
            let mut damage = Damage {
                from_s: *time_s,
                several: *label < 0.0,
                ..Damage::default()
            };
            if *label > 0.0 {
                damage.rotors = 1 << (*label as u32 - 1);
            } else if let Some(mask) = masks.map(|masks| masks[row]).filter(|mask| *mask > 0.0 && *label < 0.0) {
                damage.rotors = mask as u32;
                damage.several = false;
            }
            damage.loss = std::array::from_fn(|rotor| if damage.rotors >> rotor & 1 == 1 { f64::NAN } else { 0.0 });
            let same = damages
                .last()
                .is_some_and(|last| (last.rotors, last.several) == (damage.rotors, damage.several));
            if !same {
                damages.push(damage);
            }
        }
        Ok(Self(damages))
    }
}

/// Source of the truth, read.
pub(super) enum TruthSource {
    /// Rows of a side file.
    Rows {
        /// Its name.
        place: String,
        /// Its rows.
        rows: Vec<Row>,
    },
    /// A column of each log.
    Column(String),
}

/// A file if one with this name exists, otherwise the name of a column.
///
/// # Errors
/// It can be neither.
pub fn named(text: &Path) -> Result<LogTruth, String> {
    if text.exists() {
        return Ok(LogTruth::File(text.to_path_buf()));
    }
    match text.to_str().filter(|name| !name.contains(['/', '.'])) {
        Some(name) => Ok(LogTruth::Column(name.to_owned())),
        None => Err(format!(
            "{}: file not found; expected a CSV file with the columns time_s,rotor,loss, or the name of a column of the log",
            text.display()
        )),
    }
}

/// One row of a side file.
#[derive(Clone, Debug, PartialEq, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Row {
    /// File name of the log, with or without extension; required for several logs.
    #[serde(default)]
    log: String,
    time_s: f64,
    rotor: usize,
    loss: Option<f64>,
}

impl TruthSource {
    /// Reads it.
    ///
    /// # Errors
    /// An invalid row; the message names the file and the row.
    pub(super) fn read(truth: &LogTruth, rotor_count: usize) -> Result<Self, String> {
        match truth {
            LogTruth::Column(name) => Ok(Self::Column(name.clone())),
            LogTruth::Rows(text) => Self::of_rows("the truth", text.as_bytes(), rotor_count),
            LogTruth::File(path) => {
                let place = path.display().to_string();
                let file = File::open(path).map_err(|error| format!("{place}: cannot be read: {error}"))?;
                Self::of_rows(&place, file, rotor_count)
            }
        }
    }

    fn of_rows(place: &str, text: impl Read, rotor_count: usize) -> Result<Self, String> {
        let refused = |error: &dyn std::fmt::Display| {
            format!("{place}: {error}; expected the columns time_s,rotor,loss and, for several logs, log")
        };
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(text);
        let mut rows = Vec::new();
        for (index, row) in reader.deserialize::<Row>().enumerate() {
            let row = row.map_err(|error| refused(&error))?;
            let number = index + 1;
            if row.rotor > rotor_count {
                return Err(format!(
                    "{place}: row {number} names rotor {}, expected 1 to {rotor_count}, or 0 for a healthy log",
                    row.rotor
                ));
            }
            if !row.time_s.is_finite() || row.loss.is_some_and(|loss| !(-1.0..=1.0).contains(&loss)) {
                return Err(format!(
                    "{place}: row {number}: expected a time in seconds and a loss from -1 to 1 (0.1 is 10 % of the rotor's thrust) or none"
                ));
            }
            rows.push(row);
        }
        Ok(Self::Rows {
            place: place.to_owned(),
            rows,
        })
    }

    /// The truth of one log.
    ///
    /// * `name`: the log as named, without its part
    ///
    /// # Errors
    /// There is none.
    pub(super) fn of(&self, log: &FlightLog, name: &Path, rotor_count: usize) -> Result<Truth, String> {
        match self {
            Self::Column(column) => {
                let labels = log.column(column).ok_or_else(|| {
                    let own = &log.report.unknown_columns;
                    let has = if own.is_empty() {
                        "none".to_owned()
                    } else {
                        own.join(", ")
                    };
                    format!(
                        "{}: no column `{column}` with the truth; columns that are not flight data: {has}",
                        name.display()
                    )
                })?;
                Truth::of_column(log, column, labels, rotor_count)
            }
            Self::Rows { place, rows } => {
                let of_this = |row: &&Row| row.log.is_empty() || names(&row.log, name);
                let mut rows: Vec<&Row> = rows.iter().filter(of_this).collect();
                if rows.is_empty() {
                    return Err(format!(
                        "{place}: no row for the log {}; a healthy log has one with rotor 0",
                        name.display()
                    ));
                }
                rows.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
                let mut damages = vec![Damage {
                    from_s: f64::NEG_INFINITY,
                    ..Damage::default()
                }];
                for row in rows.into_iter().filter(|row| row.rotor > 0) {
                    let mut damage = damages.last().expect("the first is there").clone();
                    let rotor = row.rotor - 1;
                    damage.loss[rotor] = row.loss.unwrap_or(f64::NAN);
                    damage.rotors &= !(1 << rotor);
                    damage.rotors |= u32::from(row.loss != Some(0.0)) << rotor;
                    if damage.from_s == row.time_s {
                        damages.pop();
                    }
                    damage.from_s = row.time_s;
                    damages.push(damage);
                }
                Ok(Truth(damages))
            }
        }
    }
}

/// Whether a row's name matches a log: same path, file name, or file name without extension.
fn names(row: &str, log: &Path) -> bool {
    let row = Path::new(row);
    row == log
        || log.file_name().is_some_and(|name| name == row.as_os_str())
        || log.file_stem().is_some_and(|stem| stem == row.as_os_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log() -> FlightLog {
        let time_s = vec![0.0, 1.0, 2.0, 3.0];
        let columns = [
            ("fault".to_owned(), vec![0.0, 0.0, 3.0, -1.0]),
            (MASK_COLUMN.to_owned(), vec![0.0, 0.0, 4.0, 5.0]),
        ];
        FlightLog::from_columns("flight", time_s, columns).expect("a log")
    }

    fn source(text: &str) -> Result<TruthSource, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("truth.csv");
        std::fs::write(&file, text).expect("writable");
        TruthSource::read(&named(&file)?, 6)
    }

    #[test]
    fn val_rows_of_a_side_file_hold_until_the_next() {
        let source = source("log,time_s,rotor,loss\nflight.ulg,30,3,0.1\nflight,20,1,\nflight,40,3,0\nother,0,0,0\n")
            .expect("truth");
        let truth = source.of(&log(), Path::new("logs/flight.ulg"), 6).expect("its rows");
        let labels = [10.0, 25.0, 35.0, 45.0].map(|time_s| truth.at(time_s).label());
        assert_eq!(labels, [0, 1, UNKNOWN, 1]);
        assert_eq!(truth.at(35.0).rotors, 0b101);
        assert_eq!(truth.at(35.0).loss[2], 0.1);
        assert!(truth.at(35.0).worst().is_nan());
        assert_eq!(truth.onset_s(), Some(20.0));
        assert!(truth.touches(19.9, 20.1) && !truth.touches(19.0, 19.9));
        let healthy = source.of(&log(), Path::new("other.bin"), 6).expect("its row");
        assert_eq!(healthy.onset_s(), None);
        let none = source.of(&log(), Path::new("third.bin"), 6).expect_err("no row");
        assert!(none.contains("no row for the log third.bin"), "{none}");
    }

    #[test]
    fn val_a_column_of_the_log_and_the_mask_beside_it() {
        let source = TruthSource::Column("fault".to_owned());
        let truth = source.of(&log(), Path::new("flight"), 6).expect("its column");
        let labels = [0.5, 2.5, 3.5].map(|time_s| truth.at(time_s).label());
        assert_eq!(labels, [0, 3, UNKNOWN]);
        assert_eq!(truth.at(3.5).rotors, 0b101);
        let refusal = source.of(&log(), Path::new("flight"), 2).expect_err("rotor 3 of 2");
        assert!(refusal.contains("`fault` is 3 at 2 s"), "{refusal}");
        let refusal = TruthSource::Column("label".to_owned())
            .of(&log(), Path::new("flight"), 6)
            .expect_err("no column");
        assert!(
            refusal.contains("no column `label`") && refusal.contains("fault"),
            "{refusal}"
        );
    }

    #[test]
    fn val_rows_in_a_request_are_read_as_a_file_is() {
        let read = |text: &str| TruthSource::read(&LogTruth::Rows(text.to_owned()), 6);
        let truth = read("time_s,rotor,loss\n20,1,0.1\n").and_then(|source| source.of(&log(), Path::new("x"), 6));
        assert_eq!(truth.expect("its row").onset_s(), Some(20.0));
        let refusal = read("time_s,rotor,loss\n20,9,0.1\n").err().expect("refused");
        assert!(refusal.starts_with("the truth: row 1 names rotor 9"), "{refusal}");
        assert_eq!(
            named(Path::new("fault_label")),
            Ok(LogTruth::Column("fault_label".to_owned()))
        );
        assert!(named(Path::new("none.csv")).is_err_and(|refusal| refusal.contains("file not found")));
    }

    #[test]
    fn val_bad_rows_are_refused_with_their_number() {
        let refusal = |text| source(text).err().expect("refused");
        assert!(refusal("time_s,rotor,loss\n1,7,0.1\n").contains("row 1 names rotor 7, expected 1 to 6"));
        assert!(refusal("time_s,rotor,loss\n1,2,30\n").contains("a loss from -1 to 1"));
        assert!(refusal("time,rotor,loss\n1,2,0.3\n").contains("expected the columns time_s,rotor,loss"));
        assert!(refusal("time_s,rotor,loss\n1,two,0.3\n").contains("expected the columns"));
    }
}
