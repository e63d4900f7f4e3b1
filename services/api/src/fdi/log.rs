//! A whole flight log before the detectors: verdicts over time, the last word, and what the log lacks.
//!
//! ```text
//!  file ─▶ twin::log ─▶ 400 Hz ─▶ runs of complete steps ─▶ FdiSession ─▶ LogReport
//! ```
//! Behind `POST /api/v1/fdi/reports` and `rotortwin fdi-log`. A log that has 400 Hz goes in as it is, bit for bit; another one is resampled
//! as `rotortwin log import --rate 400` does (duties held, the rest along straight lines), which takes noise away: the report says so.
//! Steps without a value in a channel that the detectors need are lost steps; what a session does at a gap is done here.

use super::answers::{ChangeView, DetectorsView, WindowView};
use rotortwin_fdi::service::session::LONGEST_CHUNK;
use rotortwin_fdi::service::{Chunk, FdiSession, Sample, Window};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::STEP_RATE_HZ;
use rotortwin_scenario::Detectors;
use rotortwin_twin::log::{FlightLog, ReadOptions, names};
use serde::Serialize;
use std::path::Path;
use utoipa::ToSchema;

/// Longest log, s: at 400 Hz, 5.8 million steps.
pub const LONGEST_S: f64 = 4.0 * 3600.0;
/// Changes of the verdict that a report lists.
const LONGEST_TIMELINE: usize = 1000;
/// A median rate nearer to 400 Hz than this is 400 Hz.
const SAME_RATE_HZ: f64 = 0.5;

/// A group of channels that the log lacks, and what cannot be said without it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct Lack {
    /// Its columns.
    pub columns: Vec<String>,
    /// What is ruled out.
    pub rules_out: String,
    /// Without it no detector can run.
    pub prevents_verdicts: bool,
}

/// What the import found suspicious.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct Suspicion {
    /// One sentence.
    pub finding: String,
    /// Verdicts mean nothing before it is resolved.
    pub blocks: bool,
}

/// The log as it was read.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct LogView {
    /// Hash (XXH3-128) of the file.
    pub content_hash: String,
    /// Rows.
    pub rows: usize,
    /// From the first row to the last, s.
    pub duration_s: f64,
    /// Median rate, Hz.
    pub rate_hz: f64,
    /// Intervals without rows.
    pub gaps: usize,
}

/// What one detector said over the log, in windows.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct DetectorCount {
    /// `t_test`, `network` or `sequential`.
    pub detector: String,
    /// With a verdict.
    pub decided: u64,
    /// Verdict healthy.
    pub healthy: u64,
    /// Any other verdict.
    pub alarmed: u64,
    /// How often an alarm began: on a healthy flight, false alarms.
    pub alarms: u64,
    /// End of the first window with an alarm, s since the log's first row.
    pub first_alarm_s: Option<f64>,
}

/// What the detectors say of a log.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct LogReport {
    /// The log.
    pub log: LogView,
    /// The detectors in effect.
    pub detectors: DetectorsView,
    /// Rate that the detectors ran at, Hz.
    pub judged_rate_hz: f64,
    /// The log has another rate and was resampled.
    pub resampled: bool,
    /// Steps that were judged.
    pub steps: u64,
    /// Steps at which a channel had no value.
    pub lost_steps: u64,
    /// Steps with values that no flight can have.
    pub rejected_steps: u64,
    /// Time that the sequential detector had a verdict for, s; false alarms count against it.
    pub decided_s: f64,
    /// The last window; absent if there is none.
    pub final_window: Option<WindowView>,
    /// Verdicts of the sequential detector, each time that it changed; times since the log's first row.
    pub timeline: Vec<ChangeView>,
    /// Changes that the timeline leaves out.
    pub timeline_left_out: u64,
    /// What each detector said, counted.
    pub counts: Vec<DetectorCount>,
    /// What the log lacks.
    pub lacks: Vec<Lack>,
    /// What looks wrong about the log.
    pub suspicions: Vec<Suspicion>,
    /// What else a reader must know.
    pub notes: Vec<String>,
}

/// Why a log cannot be judged: one sentence.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct LogRefusal(String);

/// Reads a log and judges it.
///
/// * `most_cells`: of a table; for files of strangers
///
/// # Errors
/// One sentence: the file is no log, it belongs to another vehicle, it is too long.
pub fn judge_file(path: &Path, detectors: &Detectors, most_cells: Option<usize>) -> Result<LogReport, LogRefusal> {
    let options = ReadOptions {
        most_cells,
        ..ReadOptions::default()
    };
    let log = FlightLog::read_with(path, &options).map_err(|error| LogRefusal(error.to_string()))?;
    judge(&log, detectors)
}

/// Channels that the detectors need: what for, and their columns.
fn needed(rotor_count: usize) -> Vec<(&'static str, Vec<String>)> {
    let owned = |names: [&str; 3]| names.map(str::to_owned).to_vec();
    vec![
        (
            "the momentum of the vehicle, and so every residual",
            owned(names::VELOCITY),
        ),
        (
            "the direction of thrust and weight, and so every residual",
            owned(names::ATTITUDE),
        ),
        ("the angular momentum, and so every residual", owned(names::RATES)),
        (
            "the thrust that was commanded",
            (1..=rotor_count).map(names::duty).collect(),
        ),
        (
            "the thrust that a rotor gives at a duty, which falls with the voltage",
            vec![names::BATTERY_VOLTAGE.to_owned()],
        ),
    ]
}

/// What the log lacks.
fn lacks(log: &FlightLog, detectors: &Detectors) -> Vec<Lack> {
    let has = |name: &String| {
        log.column(name)
            .is_some_and(|values| values.iter().any(|value| !value.is_nan()))
    };
    let mut lacks: Vec<Lack> = needed(detectors.vehicle().rotor_count())
        .into_iter()
        .filter_map(|(what_for, columns)| {
            let columns: Vec<String> = columns.into_iter().filter(|name| !has(name)).collect();
            (!columns.is_empty()).then(|| Lack {
                columns,
                rules_out: format!("all verdicts: they tell {what_for}"),
                prevents_verdicts: true,
            })
        })
        .collect();
    if detectors.classifier().is_none() {
        lacks.push(Lack {
            columns: Vec::new(),
            rules_out: "verdicts of the network: no classifier was named".to_owned(),
            prevents_verdicts: false,
        });
    }
    lacks
}

/// Judges a log that was read.
///
/// # Errors
/// One sentence: it belongs to another vehicle, or is too long.
pub fn judge(log: &FlightLog, detectors: &Detectors) -> Result<LogReport, LogRefusal> {
    let rotor_count = detectors.vehicle().rotor_count();
    let duties = log.duties().len();
    if duties > 0 && duties != rotor_count {
        return Err(LogRefusal(format!(
            "the log has the duties of {duties} rotors, expected the {rotor_count} of the vehicle '{}'",
            detectors.vehicle().vehicle.name
        )));
    }
    if log.duration_s() > LONGEST_S {
        return Err(LogRefusal(format!(
            "the log lasts {:.0} s, expected {LONGEST_S} s at most; judge parts of it",
            log.duration_s()
        )));
    }
    let lacks = lacks(log, detectors);
    let rate_hz = log.sample_rate_hz();
    let resampled = (rate_hz - STEP_RATE_HZ).abs() > SAME_RATE_HZ;
    let mut judge = Judge::new(detectors);
    if !lacks.iter().any(|lack| lack.prevents_verdicts) {
        judge.run(log, rotor_count);
    }
    let mut notes = judge.notes;
    if resampled {
        notes.insert(0, format!(
            "the log has {rate_hz:.1} Hz and was resampled to 400 Hz (duties held, the rest along straight lines): the detectors were made for \
             400 Hz, their delays and false alarms on this log are not those of docs/figures.md"
        ));
    }
    let suspicions = log
        .report
        .findings
        .iter()
        .cloned()
        .chain(log.check_against_vehicle(&detectors.vehicle().vehicle));
    Ok(LogReport {
        log: LogView {
            content_hash: log.source.content_hash.clone(),
            rows: log.time_s.len(),
            duration_s: log.duration_s(),
            rate_hz,
            gaps: log.report.gaps.len(),
        },
        detectors: detectors.into(),
        judged_rate_hz: STEP_RATE_HZ,
        resampled,
        steps: judge.session.samples(),
        lost_steps: judge.lost,
        rejected_steps: judge.session.rejected_samples(),
        decided_s: judge.counts[2].decided as f64 * f64::from(judge.session.window_samples()) / STEP_RATE_HZ,
        final_window: judge.session.last().map(WindowView::from),
        timeline: judge.timeline,
        timeline_left_out: judge.left_out,
        counts: judge.counts.to_vec(),
        lacks,
        suspicions: suspicions
            .map(|finding| Suspicion {
                finding: finding.to_string(),
                blocks: finding.blocks(),
            })
            .collect(),
        notes,
    })
}

/// Feeds a session and counts what it says.
struct Judge {
    session: FdiSession,
    chunk: Chunk,
    lost: u64,
    timeline: Vec<ChangeView>,
    left_out: u64,
    last_code: Option<i32>,
    counts: [DetectorCount; 3],
    alarmed: [bool; 3],
    notes: Vec<String>,
}

impl Judge {
    fn new(detectors: &Detectors) -> Self {
        let count = |detector: &str| DetectorCount {
            detector: detector.to_owned(),
            decided: 0,
            healthy: 0,
            alarmed: 0,
            alarms: 0,
            first_alarm_s: None,
        };
        Self {
            session: FdiSession::new(*detectors.config(), 1).expect("the detectors were checked"),
            chunk: Chunk::default(),
            lost: 0,
            timeline: Vec::new(),
            left_out: 0,
            last_code: None,
            counts: [count("t_test"), count("network"), count("sequential")],
            alarmed: [false; 3],
            notes: Vec::new(),
        }
    }

    fn run(&mut self, log: &FlightLog, rotor_count: usize) {
        let duties: Vec<String> = (1..=rotor_count).map(names::duty).collect();
        let mut columns: Vec<&str> = [names::VELOCITY, names::ATTITUDE, names::RATES].concat();
        columns.push(names::BATTERY_VOLTAGE);
        columns.extend(duties.iter().map(String::as_str));
        let given: Result<(), std::convert::Infallible> = log.for_each_block(&columns, STEP_RATE_HZ, |first, block| {
            for row in 0..block[0].len() {
                self.row(first + row, block, row, rotor_count);
            }
            Ok(())
        });
        match given {
            Ok(()) => self.flush(),
        }
    }

    fn row(&mut self, step: usize, block: &[Vec<f64>], row: usize, rotor_count: usize) {
        if block.iter().any(|values| values[row].is_nan()) {
            self.lost += 1;
            self.flush();
            return;
        }
        let number = |column: usize| block[column][row] as f32;
        let three = |first: usize| [number(first), number(first + 1), number(first + 2)];
        let mut duty = [0.0; MAX_ROTORS];
        for (rotor, slot) in duty.iter_mut().enumerate().take(rotor_count) {
            *slot = number(10 + rotor);
        }
        if self.chunk.samples.is_empty() {
            self.chunk.first_step = step as u64;
        }
        self.chunk.samples.push(Sample {
            // The detectors do not use it.
            position_ned_m: [0.0; 3],
            velocity_ned_m_s: three(0),
            attitude_rad: three(3),
            body_rates_rad_s: three(6),
            duty,
            battery_voltage_v: number(9),
            time_s: None,
        });
        if self.chunk.samples.len() == LONGEST_CHUNK {
            self.flush();
        }
    }

    fn flush(&mut self) {
        if self.chunk.samples.is_empty() {
            return;
        }
        self.chunk.after_gap = true;
        match self.session.feed(&self.chunk) {
            Ok(answer) => {
                self.notes.extend(answer.notes);
                for window in &answer.windows {
                    self.count(window);
                }
            }
            // A number beyond f32: what cannot be taken is lost, and said.
            Err(refusal) => {
                self.lost += self.chunk.samples.len() as u64;
                self.notes
                    .push(format!("{} steps were left out: {refusal}", self.chunk.samples.len()));
            }
        }
        self.chunk.samples.clear();
    }

    fn count(&mut self, window: &Window) {
        let report = &window.report;
        let origin = self.session.origin().unwrap_or(0);
        // Since the log's first row, which may lie before the first complete step.
        let time_s = (report.stamp.step as f64) / STEP_RATE_HZ;
        for (index, code) in [report.t_test, report.network, report.sequential]
            .into_iter()
            .enumerate()
        {
            let count = &mut self.counts[index];
            let alarm = !matches!(code, -2 | 0);
            count.decided += u64::from(code != -2);
            count.healthy += u64::from(code == 0);
            count.alarmed += u64::from(alarm);
            if alarm && !self.alarmed[index] {
                count.alarms += 1;
                count.first_alarm_s.get_or_insert(time_s);
            }
            self.alarmed[index] = alarm;
        }
        if self.last_code != Some(report.sequential) {
            self.last_code = Some(report.sequential);
            if self.timeline.len() < LONGEST_TIMELINE {
                let mut change = ChangeView::of(window);
                change.time_s += origin as f64 / STEP_RATE_HZ;
                self.timeline.push(change);
            } else {
                self.left_out += 1;
            }
        }
    }
}
