//! Human-readable output: the verdict table, the facts of a run, error messages.

use crate::nearest::with_nearest;
pub use crate::terminal::line;
use rotortwin_campaign::result_table::ResultTable;
use rotortwin_campaign::study::document::Criteria;
use rotortwin_runner::destination::{is_of_a_full_disk, with_full_disk};
use rotortwin_runner::failure::Failure;
use rotortwin_runner::grid::{Grid, fold};
use rotortwin_runner::text;
use rotortwin_store::summary::{Evaluator, Interval, RealTime, Score, Status, Summary, verdict_text};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Prints an error message and returns exit code 2: bad input. What may have been meant by a missing path is added. A full disk is no input,
/// wherever it was met: exit code 1.
pub fn bad_input(sentence: impl std::fmt::Display) -> ExitCode {
    let sentence = sentence.to_string();
    if is_of_a_full_disk(&sentence) {
        return failed(sentence);
    }
    let sentence = with_nearest(&sentence);
    eprintln!("{}", fitted(&format!("rotortwin: {sentence}")));
    ExitCode::from(rotortwin_process::EXIT_BAD_INPUT)
}

/// Prints an error message and returns exit code 1: the run failed. A full disk is named.
pub fn failed(sentence: impl std::fmt::Display) -> ExitCode {
    let sentence = with_full_disk(sentence.to_string());
    eprintln!("{}", fitted(&format!("rotortwin: {sentence}")));
    ExitCode::from(rotortwin_process::EXIT_FAILED)
}

/// Prints why a job failed, and returns the exit code.
pub fn told(failure: &Failure) -> ExitCode {
    match failure {
        Failure::Input(sentence) => bad_input(sentence),
        Failure::Failed(sentence) => failed(sentence),
    }
}

/// `FIRST..END` of an argument.
pub fn range(text: &str) -> Result<Range<u64>, String> {
    let refuse = || "expected FIRST..END, such as 0..4, with FIRST below END".to_owned();
    let (first, end) = text.split_once("..").ok_or_else(refuse)?;
    let number = |text: &str| text.parse::<u64>().map_err(|_no| refuse());
    let range = number(first)?..number(end)?;
    if range.is_empty() { Err(refuse()) } else { Ok(range) }
}

/// Ascending numbers as ranges that [`range`] reads.
pub(crate) fn ranges(numbers: &[u64]) -> String {
    let apart: Vec<String> = numbers
        .chunk_by(|a, b| a + 1 == *b)
        .filter_map(|run| Some(format!("{}..{}", run.first()?, run.last()? + 1)))
        .collect();
    apart.join(", ")
}

/// Exit code for the end of a run.
pub fn exit_code(summary: &Summary) -> ExitCode {
    match summary.status {
        Status::Done => ExitCode::SUCCESS,
        Status::Failed | Status::Canceled => ExitCode::from(rotortwin_process::EXIT_FAILED),
    }
}

/// The whole result of a run as text.
pub fn summary_text(summary: &Summary, folder: Option<&Path>) -> String {
    let mut text = String::new();
    let mut line = |content: String| {
        text.push_str(&content);
        text.push('\n');
    };
    line(headline(summary));
    if !summary.intervals.is_empty() {
        line(String::new());
        line(verdict_table(summary).to_string());
        line("correct: share of the evaluation windows of 62.5 ms; delay: end of the first correct one, from the start of the interval".to_owned());
    }
    line(String::new());
    for fact in facts(summary) {
        line(fact);
    }
    if let Some(folder) = folder {
        line(format!("Files        {}", folder.display()));
        let names = [
            "report.html",
            "figures",
            "telemetry.parquet",
            "run.mcap",
            "summary.json",
        ];
        let there = names.into_iter().filter(|name| folder.join(name).exists());
        line(format!("             {}", there.collect::<Vec<_>>().join("  ")));
    }
    fitted(&text)
}

fn headline(summary: &Summary) -> String {
    let scenario = &summary.scenario;
    let flown = format!(
        "{} · {} · {:.2} s of flight, seed {}",
        scenario.name, scenario.vehicle, summary.simulated_s, summary.seed
    );
    match (summary.status, &summary.failure) {
        (Status::Done, _) => flown,
        (Status::Canceled, _) => format!("{flown}\nCANCELED after {} steps", summary.steps),
        (Status::Failed, Some(failure)) => {
            format!("{flown}\nFAILED after {} steps: {}", summary.steps, failure.sentence)
        }
        (Status::Failed, None) => format!("{flown}\nFAILED after {} steps", summary.steps),
    }
}

/// One line per interval and evaluator.
fn verdict_table(summary: &Summary) -> Grid {
    let mut table = Grid::new([
        "interval",
        "truth",
        "evaluator",
        "verdict at end",
        "correct",
        "delay",
        "false alarms",
    ])
    .numbers_from(4);
    for (place, interval) in summary.intervals.iter().enumerate() {
        for (line, evaluator) in Evaluator::ALL.into_iter().enumerate() {
            let (times, truth) = match line {
                0 => (
                    format!("{:.2}–{:.2} s", interval.start_s, interval.end_s),
                    truth_text(interval),
                ),
                _ => (String::new(), String::new()),
            };
            let [verdict, right, first_after, alarms] = score_cells(interval, evaluator);
            table.add_row([
                times,
                truth,
                evaluator.title().to_owned(),
                verdict,
                right,
                first_after,
                alarms,
            ]);
        }
        for detector in &summary.own_detectors {
            let Some(score) = detector.scores.get(place) else {
                continue;
            };
            let verdict = match detector.statements.get(place) {
                Some(statement) if !statement.text.is_empty() => statement.text.clone(),
                _ => verdict_text(score.verdict_at_end),
            };
            let [right, first_after, alarms] = shares(interval, score);
            let none = String::new;
            table.add_row([
                none(),
                none(),
                detector.name.clone(),
                verdict,
                right,
                first_after,
                alarms,
            ]);
        }
    }
    table
}

/// Faults of the rotors, and of the sensors if any.
fn truth_text(interval: &Interval) -> String {
    match interval.sensor_faults.as_slice() {
        [] => interval.description.clone(),
        faults => format!("{}; {}", interval.description, faults.join("; ")),
    }
}

/// Verdict at the end, fraction of correct windows, delay of the first correct one, false alarms.
fn score_cells(interval: &Interval, evaluator: Evaluator) -> [String; 4] {
    let score = interval.scores.of(evaluator);
    let [right, first_after, alarms] = shares(interval, score);
    let mut verdict = if evaluator == Evaluator::Network && score.not_ready == interval.windows {
        "none loaded".to_owned()
    } else {
        verdict_text(score.verdict_at_end)
    };
    if evaluator == Evaluator::Sequential && score.not_ready < interval.windows {
        let severity = &interval.severity;
        let losses: Vec<String> = severity
            .losses
            .iter()
            .map(|loss| {
                let [low, high] = loss.interval_share.map(|end| 100.0 * end);
                format!("{:.1} % [{low:.1}, {high:.1}]", 100.0 * loss.share)
            })
            .collect();
        if !losses.is_empty() {
            verdict = format!("{verdict}, lost {}", losses.join(" and "));
        } else if !severity.suspect_rotors.is_empty() {
            let rotors: Vec<String> = severity.suspect_rotors.iter().map(u32::to_string).collect();
            verdict = format!("{verdict}: among {}", rotors.join(", "));
        }
    }
    [verdict, right, first_after, alarms]
}

/// Fraction of correct windows, delay of the first correct one, false alarms.
fn shares(interval: &Interval, score: &Score) -> [String; 3] {
    let none = || "–".to_owned();
    if score.not_ready == interval.windows {
        return [none(), none(), none()];
    }
    [
        score
            .share_right
            .map_or_else(none, |share| format!("{:.1} %", 100.0 * share)),
        score
            .isolated_after_s
            .map_or_else(none, |delay| format!("{delay:.3} s")),
        if interval.expected_verdict == 0 {
            score.false_alarm_events.to_string()
        } else {
            none()
        },
    ]
}

fn facts(summary: &Summary) -> Vec<String> {
    let mut facts = Vec::new();
    if let Some(battery) = &summary.battery {
        facts.push(format!(
            "Battery      {:.1} → {:.1} %, {:.2} → {:.2} V",
            100.0 * battery.state_of_charge_start,
            100.0 * battery.state_of_charge_end,
            battery.voltage_start_v,
            battery.voltage_end_v
        ));
    }
    if let Some(tracking) = &summary.tracking {
        facts.push(format!(
            "Tracking     {:.3} m rms, {:.3} m at worst",
            tracking.position_rms_m, tracking.position_max_m
        ));
        let lost_m = Criteria::default().lost_distance_m;
        if tracking.position_max_m > lost_m {
            facts.push(format!(
                "Lost         the vehicle left its reference by more than {lost_m:.0} m; a campaign counts such a flight as lost"
            ));
        }
    }
    let times = summary.simulated_s / summary.wall_s.max(1e-9);
    let decimals = usize::from(times < 10.0);
    let mut speed = format!(
        "Speed        {} steps in {:.2} s over {}: {} steps/s, {times:.decimals$} × real time",
        summary.steps,
        summary.wall_s,
        summary.link,
        thousands(summary.steps_per_s)
    );
    if let Some(real_time) = &summary.real_time {
        speed.push_str(&format!(
            "\nReal time    start of step late by {:.0} µs (median), {:.0} µs (99 %), {:.0} µs (worst); {} of {} deadlines missed",
            real_time.jitter_us_p50,
            real_time.jitter_us_p99,
            real_time.jitter_us_max,
            real_time.deadline_misses,
            summary.steps
        ));
    }
    if let Some(real_time) = &summary.real_time {
        speed.push_str(&late_text(real_time));
    }
    facts.push(speed);
    facts.push(format!("Run hash     {}", summary.run_hash));
    facts
}

/// Which process made a paced flight late, and why: one line each.
fn late_text(real_time: &RealTime) -> String {
    let mut text = match real_time.priority {
        Some(priority) => {
            format!("\nPriority     SCHED_FIFO {priority} and locked memory for all processes started here")
        }
        None => String::new(),
    };
    for late in &real_time.late {
        let why = match late.why.as_str() {
            "scheduler" => "waited for a processor used by other processes",
            "computing" => "spent long computing",
            _ => "neither computed nor waited for a processor, or its kernel gives no statistics",
        };
        let what = match (late.who.as_str(), late.steps) {
            ("fdi", 1) => "1 report late".to_owned(),
            ("fdi", reports) => format!("{reports} reports late"),
            (_, 1) => "1 deadline".to_owned(),
            (_, steps) => format!("{steps} deadlines"),
        };
        text.push_str(&format!(
            "\nLate         {} {why}: {what}, by {:.1} ms at worst",
            late.who, late.worst_ms
        ));
    }
    text
}

/// 123456.7 → "123 457".
fn thousands(value: f64) -> String {
    let digits = format!("{value:.0}");
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i) % 3 == 0 && digit.is_ascii_digit() {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// A table of results: names on the left, numbers on the right.
pub fn result_table(result: &ResultTable) -> Grid {
    let mut table = Grid::new(result.columns.iter().map(ToString::to_string)).numbers_from(1);
    for row in &result.rows {
        table.add_row(row.iter().map(ToString::to_string));
    }
    table
}

/// A note wrapped to the terminal width, with later lines indented.
pub fn wrapped(text: &str) -> String {
    let width = text::width().unwrap_or(100).min(100);
    format!("· {}", fold(text, width - 2).replace('\n', "\n  "))
}

/// Prints sentences for people, wrapped to the terminal width. Not for documents, which programs read.
pub fn say(text: impl std::fmt::Display) {
    println!("{}", fitted(&text.to_string()));
}

/// Prints sentences for people to the standard error, wrapped to the terminal width.
pub fn say_aside(text: impl std::fmt::Display) {
    eprintln!("{}", fitted(&text.to_string()));
}

/// A text for the terminal: long lines are wrapped between words, with a hanging indent or next to their label.
pub fn fitted(text: &str) -> String {
    match text::width() {
        Some(width) => text
            .split_inclusive('\n')
            .map(|line| fitted_line(line, width))
            .collect(),
        None => text.to_owned(),
    }
}

fn fitted_line(line: &str, width: usize) -> String {
    let (content, end) = line.strip_suffix('\n').map_or((line, ""), |content| (content, "\n"));
    if content.chars().count() <= width {
        return line.to_owned();
    }
    let indent = indent(content, width);
    let rest: String = content.chars().skip(indent).collect();
    let start: String = content.chars().take(indent).collect();
    let folded = fold(&rest, width - indent);
    format!(
        "{start}{}{end}",
        folded.replace('\n', &format!("\n{}", " ".repeat(indent)))
    )
}

/// Start of the words of a line: after its labels, each of which ends in two spaces or more, as long as room is left for the words; or after
/// leading spaces.
fn indent(line: &str, width: usize) -> usize {
    const WIDEST_LABELS: usize = 40;
    const ROOM: usize = 30;
    let letters: Vec<char> = line.chars().take(WIDEST_LABELS).collect();
    let first = letters.iter().position(|letter| *letter != ' ').unwrap_or(0);
    let starts: Vec<usize> = (first + 2..letters.len())
        .filter(|place| letters[place - 2] == ' ' && letters[place - 1] == ' ' && letters[*place] != ' ')
        .collect();
    let with_room = starts.iter().rfind(|start| *start + ROOM <= width);
    with_room.or(starts.first()).copied().unwrap_or(first)
}

/// `runs/NAME`, or the first of `runs/NAME-2`, `-3`, … that does not exist.
pub fn next_free_folder(name: &str) -> Result<PathBuf, String> {
    let base = Path::new("runs").join(name);
    (1..10_000)
        .map(|number| match number {
            1 => base.clone(),
            _ => base.with_file_name(format!("{name}-{number}")),
        })
        .find(|path| !path.exists())
        .ok_or_else(|| {
            format!(
                "{} and 9998 numbered ones exist; name a folder with --out",
                base.display()
            )
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_long_lines_go_on_beside_their_label() {
        let line = "Note         a sentence that is longer than the terminal\n";
        let folded = "Note         a sentence that is\n             longer than the\n             terminal\n";
        assert_eq!(fitted_line(line, 32), folded);
        let labels = "ok     hover        thrust over weight where sensors and reference agree\n";
        let folded = "ok     hover        thrust over weight where sensors\n                    and reference agree\n";
        assert_eq!(fitted_line(labels, 52), folded);
        assert_eq!(fitted_line("  one two three", 9), "  one two\n  three");
        assert_eq!(fitted_line("one two three\n", 8), "one two\nthree\n");
        assert_eq!(fitted_line(line, 80), line);
    }

    #[test]
    fn val_thousands_are_grouped() {
        assert_eq!(thousands(999.4), "999");
        assert_eq!(thousands(1000.0), "1 000");
        assert_eq!(thousands(1_234_567.0), "1 234 567");
    }
}
