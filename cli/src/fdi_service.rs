//! `rotortwin fdi-log` and `rotortwin fdi-service`: the detectors on flights that somebody else flies.

use crate::output::{bad_input, failed, line};
use rotortwin_page::Report;
use rotortwin_process::LinkAddress;
use rotortwin_runner::grid::Grid;
use rotortwin_scenario::Detectors;
use rotortwin_twin::log::{FlightLog, ReadOptions};
use rotortwin_twin::model::ModelStore;
use rotortwin_verdicts::detectors::DetectorChoice;
use rotortwin_verdicts::log::{LogReport, NotJudgedView, judge};
use rotortwin_verdicts::view::{ObstacleView, Obstruction, SequentialView, VerdictKind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Which detectors.
#[derive(Debug, clap::Args)]
pub struct DetectorArgs {
    /// What the detectors take for healthy: a vehicle, MODEL, MODEL@BRANCH, MODEL@v2, or a version file, with what the detectors can hold of its
    /// effects
    #[arg(long, alias = "vehicle", value_name = "MODEL")]
    model: String,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    models: PathBuf,
    /// Classifier, a file or a name; without one the network gives no verdict
    #[arg(long, value_name = "CLASSIFIER", value_parser = crate::named::classifier())]
    classifier: Option<PathBuf>,
    /// A key of the [fdi] table of scenarios, such as calibration_end_s=5; by default as the classifier was trained
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl DetectorArgs {
    /// The detectors, and what they cannot hold of the model.
    pub fn detectors(&self) -> Result<(Detectors, Option<String>), String> {
        let choice = DetectorChoice {
            store: &ModelStore::new(&self.models),
            model: &self.model,
            classifier: self.classifier.as_deref(),
            settings: &self.set,
        };
        choice.detectors()
    }
}

/// Arguments of `rotortwin fdi-log`.
#[derive(Debug, clap::Args)]
pub struct LogArgs {
    /// Flight logs of any source, or run folders; LOG@35:65 takes only these seconds, LOG@NAME a segment
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    #[command(flatten)]
    detectors: DetectorArgs,
    /// Print the whole report as JSON; of several logs a list
    #[arg(long)]
    json: bool,
    /// With --json: every window of the sequential detector, too
    #[arg(long, requires = "json")]
    windows: bool,
    /// Write a page that stands alone into this file
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Cells of the log's table, at most: what a server takes from strangers
    #[arg(long, value_name = "N", hide = true)]
    most_cells: Option<usize>,
}

/// Judges logs; exit code 2 if one is none or lacks what every detector needs.
pub fn judge_logs(args: &LogArgs) -> ExitCode {
    let (detectors, note) = match args.detectors.detectors() {
        Ok(detectors) => detectors,
        Err(sentence) => return bad_input(sentence),
    };
    let options = ReadOptions {
        most_cells: args.most_cells,
        ..ReadOptions::default()
    };
    let mut reports = Vec::with_capacity(args.logs.len());
    for path in &args.logs {
        let judged = FlightLog::read_part_with(path, &options).and_then(|log| {
            judge(&log, &detectors, args.windows).map_err(|refusal| format!("{}: {refusal}", path.display()))
        });
        match judged {
            Ok(mut report) => {
                report.notes.extend(note.clone());
                reports.push(report);
            }
            Err(sentence) => return bad_input(sentence),
        }
    }
    if let Some(path) = &args.report
        && let Err(error) = std::fs::write(path, page_of(&args.logs, &reports))
    {
        return failed(format!("{}: cannot be written: {error}", path.display()));
    }
    if args.json {
        let text = match reports.as_slice() {
            [report] => serde_json::to_string_pretty(report),
            several => serde_json::to_string_pretty(&judged(&args.logs, several)),
        };
        match text {
            Ok(text) => line(&text),
            Err(error) => return failed(error),
        }
    } else {
        if let [_, _, ..] = reports.as_slice() {
            line(&format!("{}\n", overview(&args.logs, &reports)));
        }
        for (path, report) in args.logs.iter().zip(&reports) {
            if reports.len() > 1 {
                line(&format!("{}\n", path.display()));
            }
            if report.final_window.is_some() || !report.not_judged.is_empty() {
                line(&text_of(report));
            }
            if reports.len() > 1 {
                line("");
            }
        }
    }
    let refusals: Vec<String> = args
        .logs
        .iter()
        .zip(&reports)
        .filter_map(|(path, report)| refusal_of(path, report))
        .collect();
    if refusals.is_empty() {
        ExitCode::SUCCESS
    } else {
        bad_input(refusals.join("\n"))
    }
}

/// One log of several.
#[derive(serde::Serialize)]
struct JudgedLog<'a> {
    file: String,
    report: &'a LogReport,
}

fn judged<'a>(paths: &[PathBuf], reports: &'a [LogReport]) -> Vec<JudgedLog<'a>> {
    let files = paths.iter().map(|path| path.display().to_string());
    files
        .zip(reports)
        .map(|(file, report)| JudgedLog { file, report })
        .collect()
}

/// The logs on a page.
fn page_of(paths: &[PathBuf], reports: &[LogReport]) -> String {
    let logs = judged(paths, reports);
    let words = logs.iter().map(|log| format!("{}\n{}", log.file, text_of(log.report)));
    let names: Vec<&str> = logs.iter().map(|log| log.file.as_str()).collect();
    let page = Report {
        kind: "judged",
        title: &format!("Detectors · {}", names.join(", ")),
        summary: &words.collect::<Vec<_>>().join("\n\n"),
        program: rotortwin_twin::model::TOOL,
        data: &logs,
    };
    page.render().expect("text and numbers are JSON")
}

/// Why no detector can say anything of a log.
fn refusal_of(path: &Path, report: &LogReport) -> Option<String> {
    if let Some(lack) = report.lacks.iter().find(|lack| lack.prevents_verdicts) {
        return Some(format!(
            "{}: the log lacks {}, which rules out {}",
            path.display(),
            lack.columns.join(", "),
            lack.rules_out
        ));
    }
    let complete = |time: &NotJudgedView| time.obstacle.reason != Obstruction::Gap;
    (report.final_window.is_none() && !report.not_judged.iter().any(complete)).then(|| {
        format!(
            "{}: no step has a value in every channel that the detectors need; expected rows that hold velocity, attitude, body rates, \
             duties and voltage together",
            path.display()
        )
    })
}

/// One line a log.
fn overview(paths: &[PathBuf], reports: &[LogReport]) -> Grid {
    let mut table = Grid::new(["log", "judged", "alarms", "last verdict of each stretch"]).numbers([1, 2]);
    for (path, report) in paths.iter().zip(reports) {
        let verdicts: Vec<String> = report
            .stretches
            .iter()
            .map(|stretch| verdict_text(&stretch.sequential))
            .collect();
        table.add_row([
            path.file_name()
                .map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            format!("{:.0} of {:.0} s", report.decided_s, report.log.duration_s),
            report.counts[2].alarms.to_string(),
            if verdicts.is_empty() {
                "none".to_owned()
            } else {
                verdicts.join("; ")
            },
        ]);
    }
    table
}

fn text_of(report: &LogReport) -> String {
    let detectors = &report.detectors;
    let mut text = format!(
        "Log          {} rows, {:.2} s at {:.1} Hz\nVehicle      {} ({} rotors), classifier {}\nCalibration  {} s in the air; what is damaged by \
         then counts as healthy\nSteps        {} taken, {} lost, {} rejected\nJudged       {:.1} of {:.1} s\n\n",
        report.log.rows,
        report.log.duration_s,
        report.log.rate_hz,
        detectors.vehicle,
        detectors.rotor_count,
        detectors.classifier.as_deref().unwrap_or("none"),
        detectors.calibration_end_s,
        report.steps,
        report.lost_steps,
        report.rejected_steps,
        report.decided_s,
        report.log.duration_s
    );
    if report.log.start_s > 0.01 {
        text.truncate(text.trim_end().len());
        text += &format!(
            "\nTimes        from the first row, which is {:.2} s of the log\n\n",
            report.log.start_s
        );
    }
    if let Some(smallest) = report
        .final_window
        .as_ref()
        .and_then(|window| smallest_text(&window.smallest_loss))
    {
        text.truncate(text.trim_end().len());
        text += &format!("\n{smallest}\n\n");
    }
    let mut timeline = Grid::new(["time", "sequential detector", "probability"]).numbers([2]);
    let mut row = |time: String, view: &SequentialView, obstacle: Option<&ObstacleView>| {
        timeline.add_row([
            time,
            obstacle.map_or_else(
                || verdict_text(view),
                |obstacle| format!("cannot judge: {}", short(obstacle.reason)),
            ),
            obstacle.map_or_else(|| format!("{:.4}", view.probability), |_| "–".to_owned()),
        ]);
    };
    for change in &report.timeline {
        row(
            format!("{:.3} s", change.time_s),
            &change.sequential,
            change.cannot_judge.as_ref(),
        );
    }
    match report.stretches.as_slice() {
        [] => {}
        [last] => row("at the end".to_owned(), &last.sequential, None),
        stretches => {
            for stretch in stretches {
                row(
                    format!("{:.0}–{:.0} s", stretch.from_s, stretch.to_s),
                    &stretch.sequential,
                    None,
                );
            }
        }
    }
    text += &format!("{timeline}\n\n");
    if !report.not_judged.is_empty() {
        let mut rest = Grid::new(["not judged", "s", "why"]).numbers([1]);
        for time in &report.not_judged {
            rest.add_row([
                format!("{:.2}–{:.2} s", time.from_s, time.to_s),
                format!("{:.2}", time.to_s - time.from_s),
                time.obstacle.why.clone(),
            ]);
        }
        if report.not_judged_left_out > 0 {
            rest.add_row([
                String::new(),
                String::new(),
                format!("and {} more times", report.not_judged_left_out),
            ]);
        }
        text += &format!("{rest}\n\n");
    }
    let mut counts = Grid::new(["detector", "windows", "healthy", "alarmed", "alarms", "first alarm"]).numbers_from(1);
    for count in &report.counts {
        counts.add_row([
            count.detector.clone(),
            count.decided.to_string(),
            count.healthy.to_string(),
            count.alarmed.to_string(),
            count.alarms.to_string(),
            count
                .first_alarm_s
                .map_or("–".to_owned(), |time_s| format!("{time_s:.3} s")),
        ]);
    }
    text += &format!("{counts}\n");
    for lack in &report.lacks {
        text += &format!("\nNot said     {}", lack.rules_out);
    }
    for suspicion in &report.suspicions {
        text += &format!("\nSuspicious   {}", suspicion.finding);
    }
    for note in &report.notes {
        text += &format!("\nNote         {note}");
    }
    text.trim_end().to_owned()
}

/// What would be seen at the end of the log.
fn smallest_text(smallest: &[f32]) -> Option<String> {
    let of = |sign: f32| (0..smallest.len()).max_by(|a, b| (sign * smallest[*a]).total_cmp(&(sign * smallest[*b])));
    let (least, most) = (of(-1.0)?, of(1.0)?);
    Some(format!(
        "Would see    a loss from {:.1} % of its thrust on (rotor {}) to {:.1} % (rotor {}), within 10 s at the end",
        100.0 * smallest[least],
        least + 1,
        100.0 * smallest[most],
        most + 1
    ))
}

/// The reason in a few words; all of them stand in the table of what was not judged.
fn short(reason: Obstruction) -> &'static str {
    match reason {
        Obstruction::OnGround => "on the ground",
        Obstruction::TakeOff => "taking off",
        Obstruction::Landing => "landing",
        Obstruction::Upset => "upset",
        Obstruction::Crash => "crash",
        Obstruction::Gap => "no values",
        Obstruction::Calibration => "calibrating",
        Obstruction::Unexplained => "the model does not explain the motion",
        Obstruction::LoadChanged => "a load was dropped or taken up",
        Obstruction::Unclear => "what was found has no clear explanation",
        Obstruction::ImpossibleLoss => "a loss beyond 100 % would explain the motion",
    }
}

/// A verdict in words, as a line of a terminal has it.
pub fn verdict_text(view: &SequentialView) -> String {
    let losses = || -> Vec<String> {
        view.thrust_loss
            .iter()
            .map(|loss| {
                format!(
                    "rotor {} lost {:.1} % [{:.1}, {:.1}]",
                    loss.rotor,
                    100.0 * loss.share,
                    100.0 * loss.share_low,
                    100.0 * loss.share_high
                )
            })
            .collect()
    };
    match view.verdict.verdict {
        VerdictKind::NotReady => "calibrating".to_owned(),
        VerdictKind::Healthy => "healthy".to_owned(),
        VerdictKind::Unknown => "unknown fault".to_owned(),
        VerdictKind::CannotJudge => "cannot judge".to_owned(),
        VerdictKind::Ambiguous => {
            let sets: Vec<String> = view
                .hypotheses
                .iter()
                .map(|set| set.iter().map(u32::to_string).collect::<Vec<_>>().join("+"))
                .collect();
            format!("ambiguous: rotors {}", sets.join(" or "))
        }
        VerdictKind::Faulty | VerdictKind::FaultyPair => losses().join(", "),
    }
}

/// Arguments of `rotortwin fdi-service`.
#[derive(Debug, clap::Args)]
pub struct ServiceArgs {
    /// Where measurements come from: zenoh:listen=ENDPOINT or zenoh:connect=ENDPOINT
    #[arg(long, value_name = "LINK")]
    pub link: LinkAddress,
    /// Which detectors.
    #[command(flatten)]
    pub detectors: DetectorArgs,
    /// Name of the session, part of its topics
    #[arg(long, value_name = "NAME", default_value = "default")]
    pub session: String,
}
