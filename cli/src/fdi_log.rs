//! `rotortwin fdi-log`: runs the detectors on flight logs, and scores them where the truth is known.

mod score;
mod series;
mod words;

use crate::fdi_service::DetectorArgs;
use crate::output::{bad_input, failed, fitted, line, told};
use rotortwin_campaign::study::log_score::LogScore;
use rotortwin_jobs::LogVerdict;
use rotortwin_page::Report;
use rotortwin_runner::destination::writable_file;
use rotortwin_runner::log_verdict::judged::{JudgedLog, json_of};
use rotortwin_runner::log_verdict::{self, truth};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use words::{overview, text_of};

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
    /// Write every window of all detectors into this file, Parquet or CSV by its extension
    #[arg(long, value_name = "FILE")]
    series: Option<PathBuf>,
    /// Write a self-contained page into this file
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

impl LogArgs {
    /// The question that they ask.
    fn question(&self) -> Result<LogVerdict, String> {
        Ok(LogVerdict {
            logs: self.logs.clone(),
            model: self.detectors.model().to_owned(),
            models: self.detectors.models().to_owned(),
            classifier: self.detectors.classifier().map(Path::to_owned),
            settings: self.detectors.settings().to_vec(),
            healthy: self.healthy.clone(),
            truth: self.truth.as_deref().map(truth::named).transpose()?,
            windows: self.windows || self.series.is_some(),
            flight: self.flight,
            over_time: self.report.is_some(),
            most_cells: None,
        })
    }
}

/// Evaluates logs; exit code 2 if one is invalid, lacks required channels, or nothing in it could be judged.
pub fn judge_logs(args: &LogArgs) -> ExitCode {
    // Looked at before the work: nothing computed is lost.
    let mut files = [&args.series, &args.report].into_iter().flatten();
    if let Err(sentence) = files.try_for_each(|path| writable_file(path)) {
        return bad_input(sentence);
    }
    let question = match args.question() {
        Ok(question) => question,
        Err(sentence) => return bad_input(sentence),
    };
    let mut logs = match log_verdict::judge(&question) {
        Ok(logs) => logs,
        Err(failure) => return told(&failure),
    };
    if let Some(path) = &args.series
        && let Err(sentence) = series::write(path, &logs)
    {
        return failed(sentence);
    }
    if !args.windows {
        // Only needed for the series.
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
    let refusals: Vec<String> = logs
        .iter()
        .filter_map(|log| log.refusal().or_else(|| log.unjudged()))
        .collect();
    if refusals.is_empty() {
        ExitCode::SUCCESS
    } else {
        bad_input(refusals.join("\n"))
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
