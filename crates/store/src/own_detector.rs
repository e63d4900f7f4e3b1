//! Detectors of the user's own: each judges a run that is complete and then appears under its own name wherever ours do.
//!
//! ```text
//! telemetry.parquet ─▶ what was measured and commanded ─▶ Detector ─▶ a verdict per step ─┬─▶ telemetry.parquet  one column more
//!                                                                                         ├─▶ run.mcap           /detectors/NAME
//!                                                                                         ├─▶ report.html        a lane, a row
//!                                                                                         └─▶ summary.json       scores
//! ```
//!
//! A detector does not act on the vehicle, so its verdicts after the flight are those it would have given during it, as
//! long as it uses nothing later than the step: [`Detector`] gets one step at a time. Scores are counted like ours:
//! [`crate::analysis`].
//!
//! The run hash is that of the flight and does not change. A detector that judges a run again replaces its earlier
//! verdicts. `summary.json` is written last: an interrupted call can be repeated.

use crate::analysis::{Said, complete, count};
use crate::error::{Result, StoreError};
use crate::files::{MCAP_FILE, REPORT_FILE, SUMMARY_FILE, TELEMETRY_FILE};
use crate::parquet::ParquetSink;
use crate::plots::Plots;
use crate::query::{TIME, TelemetryFile};
use crate::run_folder::{PartFile, write_text};
use crate::spool::{CHUNK_ROWS, Chunk, SpoolHeader};
use crate::summary::{Evaluator, OwnDetector, Score, Statement, Summary, load_summary, verdict_text};
use crate::telemetry::{Column, Kind, SENSED, telemetry_columns};
use crate::{mcap as streams, report};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::FaultVerdict;
use rotortwin_flight_core::fdi::verdict_code::{AMBIGUOUS, NOT_READY, UNKNOWN, named_rotors};
use std::path::Path;

/// Longest name of a detector, characters.
const LONGEST_NAME: usize = 40;
/// Start of the names of the columns.
const PREFIX: &str = "verdict_own_";

/// What was measured and commanded in one step, as controller and detectors saw it; never the truth.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Simulated time at the start of the step, s.
    pub time_s: f64,
    /// m, north-east-down.
    pub position_ned_m: [f64; 3],
    /// m/s, north-east-down.
    pub velocity_ned_m_s: [f64; 3],
    /// Roll, pitch, yaw, rad.
    pub attitude_rad: [f64; 3],
    /// p, q, r, rad/s, body axes.
    pub body_rates_rad_s: [f64; 3],
    /// Accelerometer, m/s², body axes.
    pub specific_force_m_s2: [f64; 3],
    /// Commanded duty cycle of each rotor, 0 to 1.
    pub duty: Vec<f64>,
    /// Voltage at the battery's terminals, V.
    pub battery_voltage_v: f64,
    /// Residuals of our observers (Eq. 32), rotor by rotor: about arm, lever and yaw axis, N m s.
    pub residuals_nms: Vec<[f64; 3]>,
    /// An evaluation window ends with this step: this verdict is scored.
    pub window_end: bool,
}

/// A detector of the user's own.
pub trait Detector {
    /// Its name in tables, at most 40 characters.
    fn name(&self) -> &str;
    /// A flight of a vehicle with this number of rotors begins.
    fn begin(&mut self, rotor_count: usize);
    /// Why it cannot judge a flight from 0 s to this time, s.
    ///
    /// # Errors
    /// In words.
    fn check(&self, _flight_s: f64) -> std::result::Result<(), String> {
        Ok(())
    }
    /// The verdict in force after this step: 0 healthy, i rotor i, 100 i + j rotors i < j, or another code of
    /// [`verdict_code`](rotortwin_flight_core::fdi::verdict_code).
    fn step(&mut self, seen: &Seen) -> i32;
    /// What it says beyond that code; asked at the end of each evaluation window.
    fn statement(&self) -> Option<Statement> {
        None
    }
}

/// A detector judges the run in this folder, which then has its verdicts and scores; returns the new summary.
///
/// # Errors
/// No complete run of this version of the program; a name that is empty, too long or one of ours; a verdict that does not exist, or outside
/// of the flight; files that cannot be read or written. Nothing is changed unless the detector has judged the whole flight.
pub fn judge(run: &Path, detector: &mut dyn Detector) -> Result<Summary> {
    judge_all(run, &mut [detector])
}

/// [`judge`] by several detectors: the run's files are read and written once.
///
/// # Errors
/// As there, of any of them.
pub fn judge_all(run: &Path, detectors: &mut [&mut dyn Detector]) -> Result<Summary> {
    let refused = |reason: String| StoreError::Judge {
        path: run.to_owned(),
        reason,
    };
    let mut summary = load_summary(run)?;
    let mut named = Vec::with_capacity(detectors.len());
    for detector in detectors.iter() {
        let name = detector.name().trim().to_owned();
        let column = column_of(&name, &summary).map_err(refused)?;
        named.push((name, column));
    }
    let path = run.join(TELEMETRY_FILE);
    if !path.is_file() {
        return Err(refused(format!(
            "there is no {TELEMETRY_FILE}; expected the folder of a run that flew at least one step"
        )));
    }
    let file = TelemetryFile::open(&path)?;
    let recorded = Recorded::of(&file).map_err(refused)?;
    for detector in detectors.iter() {
        detector.check(summary.simulated_s).map_err(refused)?;
    }

    let judged = said(&file, &path, recorded.header.rotor_count, &summary, detectors)?;
    let mut columns = Vec::with_capacity(judged.len());
    for ((name, column), judged) in named.into_iter().zip(judged) {
        let own = OwnDetector {
            name,
            column,
            scores: judged.scores,
            statements: judged.statements,
        };
        match summary.own_detectors.iter_mut().find(|known| known.name == own.name) {
            Some(known) => *known = own.clone(),
            None => summary.own_detectors.push(own.clone()),
        }
        columns.push((own, judged.verdicts));
    }

    let plots = rewrite_telemetry(run, &file, &recorded, &summary, &columns)?;
    let mcap_path = run.join(MCAP_FILE);
    if mcap_path.is_file() {
        for (own, verdicts) in &columns {
            let changes = changes(verdicts, recorded.header.step_ns);
            let part = PartFile::create(run, MCAP_FILE)?;
            let topic = format!("/detectors/{}", &own.column[PREFIX.len()..]);
            let writer = streams::with_texts(&mcap_path, part.writer()?, &topic, &own.name, &changes)?;
            part.keep(writer)?;
        }
    }
    write_text(run, REPORT_FILE, &report::render(&summary, Some(&plots), Some(&path))?)?;
    write_text(run, SUMMARY_FILE, &summary.to_json())?;
    Ok(summary)
}

/// The name of the column for a detector's verdicts.
fn column_of(name: &str, summary: &Summary) -> std::result::Result<String, String> {
    let column = format!("{PREFIX}{}", plain_name(name)?);
    match summary
        .own_detectors
        .iter()
        .find(|known| known.column == column && known.name != name)
    {
        Some(other) => Err(format!(
            "the verdicts of '{name}' would be written to column {column}, which is that of '{}'; expected a name that differs in letters or digits",
            other.name
        )),
        None => Ok(column),
    }
}

/// A detector's name in small letters and digits, with `_` for all else, for columns and files.
///
/// # Errors
/// In words: it is empty, too long or that of one of ours.
pub fn plain_name(name: &str) -> std::result::Result<String, String> {
    let length = name.chars().count();
    if length == 0 || length > LONGEST_NAME || name.chars().any(char::is_control) {
        return Err(format!(
            "a detector's name has {length} characters; expected 1 to {LONGEST_NAME} that can be printed"
        ));
    }
    let plain = in_plain_letters(name);
    let ours = |evaluator: &Evaluator| {
        plain == in_plain_letters(evaluator.title()) || evaluator.column().strip_prefix("verdict_") == Some(&plain)
    };
    if Evaluator::ALL.iter().any(ours) {
        return Err(format!("'{name}' is a detector of this program; expected another name"));
    }
    Ok(plain)
}

/// Lower case, with `_` for all but letters and digits.
fn in_plain_letters(name: &str) -> String {
    let plain = |c: char| {
        if c.is_ascii_alphanumeric() {
            c.to_ascii_lowercase()
        } else {
            '_'
        }
    };
    name.chars().map(plain).collect()
}

/// Facts of a finished run that its telemetry holds.
struct Recorded {
    header: SpoolHeader,
    /// All columns, those of other own detectors too.
    columns: Vec<Column>,
}

impl Recorded {
    fn of(file: &TelemetryFile) -> std::result::Result<Self, String> {
        let fact = |name: &str| {
            file.fact(name)
                .ok_or_else(|| format!("its telemetry lacks the fact `{name}`"))
        };
        let number = |name: &str| {
            let text = fact(name)?;
            text.parse::<u64>()
                .map_err(|error| format!("`{name}` of its telemetry is '{text}'; expected a whole number ({error})"))
        };
        let json = |name: &str| fact(name).map(ToOwned::to_owned);
        let rotor_count = usize::try_from(number("rotor_count")?).unwrap_or(usize::MAX);
        if !(1..=MAX_ROTORS).contains(&rotor_count) {
            return Err(format!(
                "its telemetry is of {rotor_count} rotors; expected 1 to {MAX_ROTORS}"
            ));
        }
        let damaged = |error: serde_json::Error| format!("a fact of its telemetry cannot be read: {error}");
        let header = SpoolHeader {
            rotor_count,
            step_ns: number("step_ns")?,
            conditions: serde_json::from_str(&json("conditions")?).map_err(damaged)?,
            sensor_faults: serde_json::from_str(&json("sensor_faults")?).map_err(damaged)?,
            rotor_positions_body_m: Vec::new(),
            hover_thrust_n: 0.0,
            dropped_loads: Vec::new(),
        };
        let mut columns = telemetry_columns(rotor_count);
        let names: Vec<&str> = file.channels().iter().map(|channel| channel.name.as_str()).collect();
        let known = columns
            .iter()
            .zip(&names)
            .take_while(|(column, name)| column.name == **name)
            .count();
        if known != columns.len() {
            return Err(format!(
                "its telemetry was written by another version of the program: {} instead of {} is column {}; fly it again to have it judged",
                names.get(known).copied().unwrap_or("nothing"),
                columns[known].name,
                known + 1
            ));
        }
        columns.extend(file.channels()[known..].iter().map(|channel| Column {
            name: channel.name.clone(),
            unit: channel.unit.clone(),
            kind: Kind::I32,
            description: channel.description.clone(),
        }));
        Ok(Self { header, columns })
    }
}

/// What one detector says of a run.
#[derive(Default)]
struct Judged {
    /// In each step.
    verdicts: Vec<i32>,
    /// One for each interval of the run.
    scores: Vec<Score>,
    /// The last one of each interval; empty if it never says anything beyond its verdicts.
    statements: Vec<Statement>,
    /// Since its last window: bit i, rotor i + 1 is or may be concerned.
    suspects: u64,
    /// Its window before was a false alarm.
    alarm: bool,
}

/// What each of the detectors says, in one pass.
fn said(
    file: &TelemetryFile,
    path: &Path,
    rotor_count: usize,
    summary: &Summary,
    detectors: &mut [&mut dyn Detector],
) -> Result<Vec<Judged>> {
    let rotors = 1..=rotor_count;
    let fixed = [TIME].into_iter().chain(SENSED).chain(["window_end"]);
    let mut names: Vec<String> = fixed.map(ToOwned::to_owned).collect();
    let duty = names.len();
    names.extend(rotors.clone().map(|rotor| format!("duty_{rotor}")));
    let residuals = names.len();
    names.extend(rotors.flat_map(|rotor| ["arm", "lever", "yaw"].map(|axis| format!("residual_{rotor}_{axis}_nms"))));
    let names: Vec<&str> = names.iter().map(String::as_str).collect();

    let intervals = &summary.intervals;
    let step_s = summary.simulated_s / summary.steps.max(1) as f64;
    let refused = |reason: String| StoreError::Judge {
        path: path.to_owned(),
        reason,
    };
    let none = || Judged {
        verdicts: Vec::with_capacity(usize::try_from(file.rows()).unwrap_or(0)),
        scores: vec![Score::default(); intervals.len()],
        ..Judged::default()
    };
    let mut all: Vec<Judged> = detectors.iter().map(|_| none()).collect();
    let mut seen = Seen::default();
    let (mut interval, mut is_first) = (0, true);
    detectors.iter_mut().for_each(|detector| detector.begin(rotor_count));
    file.for_each_block(&names, |block| -> Result<()> {
        for row in 0..block[0].len() {
            let at = |place: usize| block[place][row];
            let triple = |place: usize| [at(place), at(place + 1), at(place + 2)];
            seen.time_s = at(0);
            seen.position_ned_m = triple(1);
            seen.velocity_ned_m_s = triple(4);
            seen.attitude_rad = triple(7);
            seen.body_rates_rad_s = triple(10);
            seen.specific_force_m_s2 = triple(13);
            seen.battery_voltage_v = at(16);
            seen.window_end = at(17) > 0.5;
            seen.duty.clear();
            seen.duty.extend((0..rotor_count).map(|rotor| at(duty + rotor)));
            seen.residuals_nms.clear();
            seen.residuals_nms
                .extend((0..rotor_count).map(|rotor| triple(residuals + 3 * rotor)));
            // Half a step: ends of intervals are starts of steps, in another rounding.
            while intervals
                .get(interval)
                .is_some_and(|open| seen.time_s + 0.5 * step_s >= open.end_s)
            {
                (interval, is_first) = (interval + 1, true);
            }
            let Some(open) = intervals.get(interval) else {
                let reason = "it has rows after its last interval; expected the telemetry of the run in summary.json";
                return Err(refused(reason.to_owned()));
            };
            for (detector, judged) in detectors.iter_mut().zip(&mut all) {
                let verdict = detector.step(&seen);
                if !exists(verdict, rotor_count) {
                    return Err(refused(format!(
                        "at {} s '{}' says {verdict}; expected 0, a rotor from 1 to {rotor_count}, 100 i + j for two of them, {UNKNOWN} unknown, \
                         {NOT_READY} not ready or {AMBIGUOUS} ambiguous",
                        seen.time_s,
                        detector.name()
                    )));
                }
                judged.take(verdict, seen.window_end.then(|| detector.statement()).flatten(), interval);
                let said = Said {
                    verdict,
                    suspects: judged.suspects,
                    is_first,
                    window_end_s: seen.window_end.then_some(seen.time_s + step_s),
                };
                count(&mut judged.scores[interval], &mut judged.alarm, said, open);
            }
            is_first = false;
        }
        Ok(())
    })?;
    for judged in &mut all {
        for (score, interval) in judged.scores.iter_mut().zip(intervals) {
            complete(score, interval.windows);
        }
        if !judged.statements.is_empty() {
            judged.statements.resize(intervals.len(), Statement::default());
        }
    }
    Ok(all)
}

impl Judged {
    /// A step in an interval. As for the score, the last statement in the air stays.
    fn take(&mut self, verdict: i32, statement: Option<Statement>, interval: usize) {
        self.verdicts.push(verdict);
        let Some(statement) = statement else { return };
        self.suspects = statement
            .severity
            .suspect_rotors
            .iter()
            .fold(0, |mask, rotor| mask | 1 << (rotor - 1));
        if verdict != NOT_READY || self.statements.len() <= interval {
            self.statements.resize(interval + 1, Statement::default());
            self.statements[interval] = statement;
        }
    }
}

/// Whether there is such a verdict for a vehicle with this number of rotors.
pub fn exists(verdict: i32, rotor_count: usize) -> bool {
    FaultVerdict::of_code(verdict).is_some() && named_rotors(verdict).all(|rotor| rotor as usize <= rotor_count)
}

/// Rewrites `telemetry.parquet` with the detectors' columns; returns the data that the report plots.
fn rewrite_telemetry(
    run: &Path,
    file: &TelemetryFile,
    recorded: &Recorded,
    summary: &Summary,
    own: &[(OwnDetector, Vec<i32>)],
) -> Result<Plots> {
    let kept: Vec<Column> = recorded
        .columns
        .iter()
        .filter(|column| own.iter().all(|(own, _)| column.name != own.column))
        .cloned()
        .collect();
    let mut columns = kept.clone();
    columns.extend(own.iter().map(|(own, _)| Column {
        name: own.column.clone(),
        unit: "1".to_owned(),
        kind: Kind::I32,
        description: format!("Verdict of the detector '{}', codes as verdict_t_test", own.name),
    }));
    let part = PartFile::create(run, TELEMETRY_FILE)?;
    let mut sink = ParquetSink::new(part.writer()?, &part.target, &recorded.header, &columns, summary)?;
    let mut plots = Plots::new(&recorded.header, &columns, file.rows());
    let mut chunk = Chunk {
        first_row: 0,
        len: 0,
        columns: vec![Vec::new(); columns.len()],
    };
    let mut flush = |chunk: &mut Chunk| -> Result<()> {
        let first = usize::try_from(chunk.first_row).unwrap_or(usize::MAX);
        for ((_, verdicts), column) in own.iter().zip(&mut chunk.columns[kept.len()..]) {
            let said = &verdicts[first..first + chunk.len];
            column.extend(said.iter().map(|verdict| f64::from(*verdict)));
        }
        plots.push(chunk);
        sink.push(chunk)?;
        chunk.first_row += chunk.len as u64;
        chunk.len = 0;
        chunk.columns.iter_mut().for_each(Vec::clear);
        Ok(())
    };
    let names: Vec<&str> = kept.iter().map(|column| column.name.as_str()).collect();
    file.for_each_block(&names, |block| -> Result<()> {
        if chunk.len + block[0].len() > CHUNK_ROWS {
            flush(&mut chunk)?;
        }
        chunk.len += block[0].len();
        for (column, values) in chunk.columns.iter_mut().zip(block) {
            column.extend_from_slice(values);
        }
        Ok(())
    })?;
    if chunk.len > 0 {
        flush(&mut chunk)?;
    }
    part.keep(sink.finish()?)?;
    plots.finish();
    Ok(plots)
}

/// Simulated time of each change of the verdict, ns, and the verdict in words.
fn changes(verdicts: &[i32], step_ns: u64) -> Vec<(u64, String)> {
    let mut changes: Vec<(u64, String)> = Vec::new();
    let mut before = None;
    for (step, verdict) in verdicts.iter().enumerate() {
        if before != Some(verdict) {
            changes.push((step as u64 * step_ns, verdict_text(*verdict)));
            before = Some(verdict);
        }
    }
    changes
}

/// Times of a table are rounded: a microsecond before its step is the step.
const ROUNDED_S: f64 = 1e-6;

/// Verdicts that were said elsewhere: each holds from its time until the next one.
#[derive(Debug)]
pub struct Listed {
    name: String,
    /// Ascending times, s, and codes.
    said: Vec<(f64, i32)>,
    next: usize,
}

impl Listed {
    /// * `said`: time, s, from which the verdict holds, and its code; before the first one it is "not ready"
    ///
    /// # Errors
    /// No verdicts; a time that is NaN or before the previous one: in words, with the index from 1.
    pub fn new(name: impl Into<String>, said: Vec<(f64, i32)>) -> std::result::Result<Self, String> {
        if said.is_empty() {
            return Err("there is no verdict; expected at least one".to_owned());
        }
        if let Some(place) = said.iter().position(|(time, _)| !time.is_finite()) {
            return Err(format!(
                "time {} is {}; expected a number of seconds",
                place + 1,
                said[place].0
            ));
        }
        if let Some(place) = said.windows(2).position(|pair| pair[1].0 < pair[0].0) {
            return Err(format!(
                "time {} is {} s, after {} s; expected times that ascend",
                place + 2,
                said[place + 1].0,
                said[place].0
            ));
        }
        Ok(Self {
            name: name.into(),
            said,
            next: 0,
        })
    }
}

impl Detector for Listed {
    fn name(&self) -> &str {
        &self.name
    }

    fn begin(&mut self, _: usize) {
        self.next = 0;
    }

    fn check(&self, flight_s: f64) -> std::result::Result<(), String> {
        let outside = |time_s: f64| time_s < -ROUNDED_S || time_s > flight_s + ROUNDED_S;
        match self.said.iter().position(|(time_s, _)| outside(*time_s)) {
            Some(place) => Err(format!(
                "time {} is {} s; expected 0 to {flight_s} s, the flight",
                place + 1,
                self.said[place].0
            )),
            None => Ok(()),
        }
    }

    fn step(&mut self, seen: &Seen) -> i32 {
        while self
            .said
            .get(self.next)
            .is_some_and(|(from_s, _)| *from_s <= seen.time_s + ROUNDED_S)
        {
            self.next += 1;
        }
        self.next.checked_sub(1).map_or(NOT_READY, |last| self.said[last].1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_verdicts_that_exist() {
        for verdict in [-3, -2, -1, 0, 1, 6, 102, 106, 506] {
            assert!(exists(verdict, 6), "{verdict}");
        }
        for verdict in [-4, 7, 99, 100, 101, 107, 201, 605, 607, 10_203, i32::MAX, i32::MIN] {
            assert!(!exists(verdict, 6), "{verdict}");
        }
    }

    #[test]
    fn val_a_listed_verdict_holds_until_the_next() {
        let mut listed = Listed::new("mine", vec![(0.01, 0), (0.02, 3), (0.02, 4)]).unwrap();
        listed.begin(6);
        let mut at = |time_s: f64| {
            listed.step(&Seen {
                time_s,
                ..Seen::default()
            })
        };
        assert_eq!(
            [at(0.0), at(0.0099), at(0.0099995), at(0.0175), at(0.02), at(9.0)],
            [-2, -2, 0, 0, 4, 4]
        );
        for (said, words) in [
            (vec![], "no verdict"),
            (vec![(f64::NAN, 0)], "time 1 is NaN"),
            (vec![(1.0, 0), (0.5, 0)], "time 2 is 0.5 s, after 1 s"),
        ] {
            let error = Listed::new("mine", said).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn val_verdicts_outside_of_the_flight_are_refused() {
        let check = |time_s: f64| Listed::new("mine", vec![(0.0, 0), (time_s, 3)]).unwrap().check(60.0);
        assert_eq!(check(60.0), Ok(()));
        assert_eq!(
            check(61.0).unwrap_err(),
            "time 2 is 61 s; expected 0 to 60 s, the flight"
        );
        assert!(Listed::new("mine", vec![(-1.0, 0)]).unwrap().check(60.0).is_err());
    }

    #[test]
    fn val_names_that_cannot_be_told_apart_are_refused() {
        let mut summary = Summary::default();
        assert_eq!(column_of("Yaw rate", &summary).unwrap(), "verdict_own_yaw_rate");
        summary.own_detectors.push(OwnDetector {
            name: "Yaw rate".to_owned(),
            column: "verdict_own_yaw_rate".to_owned(),
            ..OwnDetector::default()
        });
        assert!(column_of("Yaw rate", &summary).is_ok());
        assert!(column_of("yaw-rate", &summary).unwrap_err().contains("'Yaw rate'"));
        for ours in ["t-test", "T_test", "sequential", "Sequential detector", "network"] {
            assert!(column_of(ours, &summary).unwrap_err().contains("of this program"));
        }
        for name in ["", "a\nb", &"x".repeat(41)] {
            assert!(column_of(name, &summary).unwrap_err().contains("1 to 40"));
        }
    }
}
