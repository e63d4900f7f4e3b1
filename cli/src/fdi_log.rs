//! `rotortwin fdi-log`: runs the detectors on flight logs, and scores them where the truth is known.

mod judged;
mod score;
mod series;
mod truth;
mod words;

pub use words::verdict_text;

use crate::fdi_service::DetectorArgs;
use crate::output::{bad_input, failed, fitted, line};
use judged::{AgainstHealthy, JudgedLog, ReportAlone};
use rotortwin_campaign::study::log_score::LogScore;
use rotortwin_fdi_session::Learnt;
use rotortwin_page::Report;
use rotortwin_runner::destination::writable_file;
use rotortwin_scenario::Detectors;
use rotortwin_twin::LEAST_BASELINE;
use rotortwin_twin::baseline;
use rotortwin_twin::compare::NamedModel;
use rotortwin_twin::flight_picture::FlightPicture;
use rotortwin_twin::identify::read_for;
use rotortwin_twin::log::{FlightLog, ReadOptions};
use rotortwin_twin::model::ModelVersion;
use rotortwin_twin::over_time::OverTime;
use rotortwin_verdicts::log::{LogReport, NotJudgedView, judge_after, learn};
use rotortwin_verdicts::view::Obstruction;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use truth::TruthSource;
use words::{overview, text_of};

/// Reasons that are listed for a log of which nothing was judged.
const MOST_REASONS: usize = 3;

/// Arguments of `rotortwin fdi-log`.
#[derive(Debug, clap::Args)]
pub struct LogArgs {
    /// Flight logs of any source, or run folders; LOG@35:65 takes only these seconds, LOG@NAME a segment, LOG@order:2-1-… other columns as rotors 1, 2, …
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    #[command(flatten)]
    detectors: DetectorArgs,
    /// Healthy flights of the same vehicle, from which the detectors learn deviations from the model
    #[arg(long, num_args = 1.., value_name = "LOG")]
    healthy: Vec<PathBuf>,
    /// Print the whole report as JSON; a list for several logs
    #[arg(long)]
    json: bool,
    /// With --json: also every window of all detectors
    #[arg(long, requires = "json")]
    windows: bool,
    /// With --json: also trajectory, parts, motor outputs and vibration of the flight, for plotting
    #[arg(long = "over-time", visible_alias = "flight", requires = "json")]
    flight: bool,
    /// Score the verdicts: a CSV file time_s,rotor,loss[,log], or the name of a column of the log (0 healthy, the damaged rotor, -1 several)
    #[arg(long, value_name = "FILE|COLUMN")]
    truth: Option<PathBuf>,
    /// Like --truth with the name of a column, even if a file has that name; used by the server
    #[arg(long, value_name = "COLUMN", hide = true, conflicts_with = "truth")]
    truth_column: Option<String>,
    /// Write every window of all detectors into this file, Parquet or CSV by its extension
    #[arg(long, value_name = "FILE")]
    series: Option<PathBuf>,
    /// Write a self-contained page into this file
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Maximum number of cells of the log's table; used by the server
    #[arg(long, value_name = "N", hide = true)]
    most_cells: Option<usize>,
}

/// Evaluates logs; exit code 2 if one is invalid, lacks required channels, or nothing in it could be judged.
pub fn judge_logs(args: &LogArgs) -> ExitCode {
    // Looked at before the work: nothing computed is lost.
    let mut files = [&args.series, &args.report].into_iter().flatten();
    if let Err(sentence) = files.try_for_each(|path| writable_file(path)) {
        return bad_input(sentence);
    }
    let mut logs = match judge_all(args) {
        Ok(logs) => logs,
        Err(sentence) => return bad_input(sentence),
    };
    if let Some(path) = &args.series
        && let Err(sentence) = series::write(path, &logs)
    {
        return failed(sentence);
    }
    if !args.windows {
        // Only needed for the score and the series.
        logs.iter_mut().for_each(|log| log.report.windows = Vec::new());
    }
    if let Some(path) = &args.report {
        if let Err(error) = std::fs::write(path, page_of(&logs)) {
            return failed(format!("{}: cannot be written: {error}", path.display()));
        }
        // Only needed for the page.
        logs.iter_mut().for_each(|log| log.over_time = None);
    }
    if args.json {
        match json_of(&logs) {
            Ok(text) => line(&text),
            Err(error) => return failed(error),
        }
    } else {
        print(&logs);
    }
    // The server's answer is the report, which holds the reasons.
    let of_server = args.most_cells.is_some();
    let refusals: Vec<String> = logs
        .iter()
        .filter_map(|log| {
            refusal_of(&log.file, &log.report).or_else(|| unjudged(&log.file, &log.report).filter(|_| !of_server))
        })
        .collect();
    if refusals.is_empty() {
        ExitCode::SUCCESS
    } else {
        bad_input(refusals.join("\n"))
    }
}

/// Evaluates every log.
fn judge_all(args: &LogArgs) -> Result<Vec<JudgedLog>, String> {
    let (detectors, note) = args.detectors.detectors()?;
    let rotor_count = detectors.vehicle().rotor_count();
    let source = args
        .truth
        .as_deref()
        .map(|text| TruthSource::read(text, rotor_count))
        .transpose()?
        .or_else(|| args.truth_column.clone().map(TruthSource::Column));
    let options = ReadOptions {
        most_cells: args.most_cells,
        ..ReadOptions::default()
    };
    let read_all = |paths: &[PathBuf]| -> Result<Vec<FlightLog>, String> {
        let read = |path: &PathBuf| read_for(path, &options, &detectors.vehicle().vehicle);
        paths.iter().map(read).collect()
    };
    let healthy = read_all(&args.healthy)?;
    let (learnt, learnt_notes) = learnt_from(&healthy, &detectors)?;
    let model = ModelVersion::first(detectors.vehicle().vehicle.name.as_str(), detectors.vehicle().clone());
    let every_window = args.windows || source.is_some() || args.series.is_some();
    let judged = |path: &PathBuf| {
        let log = read_for(path, &options, &detectors.vehicle().vehicle)?;
        let truth = source
            .as_ref()
            .map(|source| source.of(&log, whole(path), rotor_count))
            .transpose()?;
        let mut report = judge_after(&log, &detectors, learnt.as_ref(), every_window)
            .map_err(|refusal| format!("{}: {refusal}", path.display()))?;
        // Within a flight, damage before the calibration counts as healthy: only other flights reveal it.
        let against = against_healthy(&log, &healthy, &model);
        report
            .notes
            .splice(0..0, against.as_ref().map(|against| against.sentence.clone()));
        report.notes.extend(learnt_notes.clone());
        report.notes.extend(note.clone());
        report.flight = args.flight.then(|| FlightPicture::of(&log));
        let over_time = args.report.is_some().then(|| {
            let believed = NamedModel {
                label: report.detectors.vehicle.clone(),
                version: model.clone(),
            };
            OverTime::of(std::slice::from_ref(&log), &[believed])
        });
        Ok(JudgedLog {
            against,
            file: path.display().to_string(),
            score: truth.as_ref().map(|truth| score::score_of(&report, truth)),
            report,
            over_time,
            truth,
        })
    };
    args.logs.iter().map(judged).collect()
}

/// The commanded thrust of the rotors of a flight compared with healthy flights, if there are enough of those.
fn against_healthy(log: &FlightLog, healthy: &[FlightLog], model: &ModelVersion) -> Option<AgainstHealthy> {
    if healthy.len() < LEAST_BASELINE {
        return None;
    }
    Some(match baseline::trim(std::slice::from_ref(log), healthy, model) {
        Ok(trim) => AgainstHealthy::of(&trim),
        Err(reason) => AgainstHealthy::not_compared(reason),
    })
}

/// What healthy flights say of the vehicle, and the notes about that; nothing where there are none.
fn learnt_from(logs: &[FlightLog], detectors: &Detectors) -> Result<(Option<Learnt>, Vec<String>), String> {
    if logs.is_empty() {
        return Ok((None, Vec::new()));
    }
    let (learnt, mut notes) = learn(logs, detectors).map_err(|refusal| format!("--healthy: {refusal}"))?;
    let inertia = learnt.inertia();
    notes.insert(
        0,
        format!(
            "the detectors have learnt the vehicle from healthy flights ({}, {:.0} s in the air); inertia about roll, pitch, yaw: {:.2}, {:.2}, {:.2} of \
             the model's",
            learnt.flights, learnt.seconds, inertia[0], inertia[1], inertia[2]
        ),
    );
    Ok((Some(learnt), notes))
}

/// `LOG` of `LOG@35:65`.
fn whole(path: &Path) -> &Path {
    let part = path
        .to_str()
        .and_then(|text| text.rsplit_once('@'))
        .filter(|_| !path.exists());
    part.map_or(path, |(log, _)| Path::new(log))
}

/// A single log without a score as its report alone, otherwise objects.
fn json_of(logs: &[JudgedLog]) -> serde_json::Result<String> {
    match logs {
        [log] if log.score.is_none() => serde_json::to_string_pretty(&ReportAlone {
            report: &log.report,
            against_healthy: log.against.as_ref(),
        }),
        [log] => serde_json::to_string_pretty(log),
        several => serde_json::to_string_pretty(several),
    }
}

fn print(logs: &[JudgedLog]) {
    if logs.len() > 1 {
        line(&format!("{}\n", overview(logs)));
    }
    for log in logs {
        if logs.len() > 1 {
            line(&format!("{}\n", log.file));
        }
        if log.report.final_window.is_some() || !log.report.not_judged.is_empty() {
            line(&fitted(&text_of(&log.report, log.against.as_ref())));
        }
        if logs.len() > 1 {
            line("");
        }
    }
    if let Some(text) = score_text(logs) {
        line(&format!("\n{text}"));
    }
}

/// Accuracy of the detectors; `None` if the truth is unknown.
fn score_text(logs: &[JudgedLog]) -> Option<String> {
    let scores: Vec<&LogScore> = logs.iter().filter_map(|log| log.score.as_ref()).collect();
    let names: Vec<String> = logs.iter().map(|log| words::file_name(Path::new(&log.file))).collect();
    (!scores.is_empty()).then(|| {
        format!(
            "Against the truth, sequential detector\n{}\n\nAgainst the truth, all detectors over all logs\n{}\n\nJudged: of all windows of the log. Correct: of the judged \
             ones.",
            score::by_log(&names, &scores),
            score::by_detector(&scores)
        )
    })
}

/// The logs on a page.
fn page_of(logs: &[JudgedLog]) -> String {
    let mut words: Vec<String> = logs
        .iter()
        .map(|log| format!("{}\n{}", log.file, text_of(&log.report, log.against.as_ref())))
        .collect();
    words.extend(score_text(logs));
    let names: Vec<&str> = logs.iter().map(|log| log.file.as_str()).collect();
    let page = Report {
        kind: "judged",
        title: &format!("Detectors · {}", names.join(", ")),
        summary: &words.join("\n\n"),
        program: rotortwin_twin::model::TOOL,
        data: &logs,
    };
    page.render().expect("text and numbers are JSON")
}

/// Why no detector can evaluate a log.
fn refusal_of(file: &str, report: &LogReport) -> Option<String> {
    if let Some(lack) = report.lacks.iter().find(|lack| lack.prevents_verdicts) {
        return Some(format!(
            "{file}: the log lacks {}, which rules out {}",
            lack.columns.join(", "),
            lack.rules_out
        ));
    }
    let complete = |time: &NotJudgedView| time.obstacle.reason != Obstruction::Gap;
    (report.final_window.is_none() && !report.not_judged.iter().any(complete)).then(|| {
        format!(
            "{file}: no step has a value in every channel that the detectors need; expected rows that hold velocity and attitude (or specific force), \
             body rates, duties and voltage together"
        )
    })
}

/// That no window of a log has a verdict, and why.
fn unjudged(file: &str, report: &LogReport) -> Option<String> {
    if !report.stretches.is_empty() {
        return None;
    }
    let mut reasons: Vec<(&str, f64)> = Vec::new();
    for time in &report.not_judged {
        let (why, lasts_s) = (time.obstacle.why.as_str(), time.to_s - time.from_s);
        match reasons.iter_mut().find(|(known, _)| *known == why) {
            Some((_, sum_s)) => *sum_s += lasts_s,
            None => reasons.push((why, lasts_s)),
        }
    }
    reasons.sort_by(|a, b| b.1.total_cmp(&a.1));
    let listed: Vec<String> = reasons
        .iter()
        .take(MOST_REASONS)
        .map(|(why, sum_s)| format!("{sum_s:.1} s ({why})"))
        .collect();
    let listed = if listed.is_empty() {
        "the log is shorter than a window".to_owned()
    } else {
        listed.join(", ")
    };
    Some(format!(
        "{file}: nothing could be judged in {:.1} s: {listed}; expected more than the {} s of the calibration in the air without a gap, in a flight \
         that the model explains",
        report.log.duration_s, report.detectors.calibration_end_s
    ))
}
