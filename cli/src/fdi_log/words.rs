//! Text output of `fdi-log` for a log: verdicts over time, what was not evaluated, counts.

use rotortwin_runner::grid::Grid;
use rotortwin_runner::log_verdict::judged::{AgainstHealthy, JudgedLog};
use rotortwin_verdicts::log::LogReport;
use rotortwin_verdicts::view::{IntervalView, LoadView, ObstacleView, Obstruction, SequentialView, VerdictKind};
use std::path::Path;

/// Most changes of the verdict that are printed: the first and the last ones.
const MOST_CHANGES: usize = 40;

/// File name of a log, with the selected part.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// One line per log.
pub(super) fn overview(logs: &[JudgedLog]) -> Grid {
    let compared = logs.iter().any(|log| log.against.is_some());
    let mut header = vec!["log", "judged", "alarms", "last verdict of each stretch"];
    header.extend(compared.then_some("against the healthy flights"));
    let mut table = Grid::new(header).numbers([1, 2]);
    for log in logs {
        let report = &log.report;
        let verdicts: Vec<String> = report
            .stretches
            .iter()
            .map(|stretch| stretch.sequential.sentence.clone())
            .collect();
        let mut cells = vec![
            file_name(Path::new(&log.file)),
            format!("{:.0} of {:.0} s", report.decided_s, report.log.duration_s),
            report.counts[2].alarms.to_string(),
            if verdicts.is_empty() {
                "none".to_owned()
            } else {
                verdicts.join("; ")
            },
        ];
        if compared {
            let word = log.against.as_ref().map_or("–", AgainstHealthy::word);
            cells.push(word.to_owned());
        }
        table.add_row(cells);
    }
    table
}

/// One log. `against`: commanded thrust of its rotors compared with healthy flights.
pub(super) fn text_of(report: &LogReport, against: Option<&AgainstHealthy>) -> String {
    let mut text = headline(report, against);
    text += &format!("{}\n\n", timeline(report));
    text += &not_judged(report);
    text += &counts(report);
    for load in &report.loads {
        text += &format!("\nLoad         {}", load_text(load));
    }
    for lack in &report.lacks {
        text += &format!("\nNot said     {}", lack.rules_out);
    }
    for suspicion in &report.suspicions {
        text += &format!("\nSuspicious   {}", suspicion.finding);
    }
    let is_told = |note: &String| against.is_some_and(|against| against.sentence == *note);
    for note in report.notes.iter().filter(|note| !is_told(note)) {
        text += &format!("\nNote         {note}");
    }
    text.trim_end().to_owned()
}

/// The verdict, and what it stands on.
fn headline(report: &LogReport, against: Option<&AgainstHealthy>) -> String {
    let detectors = &report.detectors;
    let names_a_fault = report.stretches.iter().any(|stretch| {
        let said = stretch.sequential.verdict.verdict;
        !matches!(
            said,
            VerdictKind::Healthy | VerdictKind::NotReady | VerdictKind::CannotJudge
        )
    });
    // Healthy within the flight is not healthy where the vehicle has changed since the healthy flights.
    let verdict = match against.filter(|against| against.is_changed() && !names_a_fault) {
        Some(against) => format!(
            "{} since the healthy flights; within this flight: {}",
            against.word(),
            report.sentence
        ),
        None => report.sentence.clone(),
    };
    let mut text = format!(
        "Verdict      {}\n{}Log          {} rows, {:.2} s at {:.1} Hz\nVehicle      {} ({} rotors), classifier {}\nCalibration  {} s in the air; what is damaged by \
         then counts as healthy\nSteps        {} taken, {} lost, {} rejected\nJudged       {:.1} of {:.1} s\n\n",
        verdict,
        against.map_or_else(String::new, |against| format!("Flights      {}\n", against.sentence)),
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
    if let Some(detectable) = &report.detectable {
        text.truncate(text.trim_end().len());
        text += &format!("\nDetectable   {detectable}\n\n");
    }
    text
}

/// Changes of the verdict, and the last one of each stretch.
fn timeline(report: &LogReport) -> Grid {
    let mut timeline = Grid::new(["time", "verdict", "probability"]).numbers([2]);
    let cells = |time: String, view: &SequentialView, obstacle: Option<&ObstacleView>| {
        [
            time,
            obstacle.map_or_else(
                || view.sentence.clone(),
                |obstacle| format!("cannot judge: {}", short(obstacle.reason)),
            ),
            if obstacle.is_some() || view.verdict.verdict == VerdictKind::NotReady {
                "–".to_owned()
            } else {
                format!("{:.4}", view.probability)
            },
        ]
    };
    let left_out = report.timeline.len().saturating_sub(MOST_CHANGES);
    let shown_first = if left_out > 0 { MOST_CHANGES / 2 } else { 0 };
    for (place, change) in report.timeline.iter().enumerate() {
        if left_out > 0 && place == shown_first {
            let rest = format!("and {left_out} more changes, which --json has");
            timeline.add_row(["…".to_owned(), rest, String::new()]);
        }
        if left_out == 0 || !(shown_first..shown_first + left_out).contains(&place) {
            let time = format!("{:.3} s", change.time_s);
            timeline.add_row(cells(time, &change.sequential, change.cannot_judge.as_ref()));
        }
    }
    match report.stretches.as_slice() {
        [] => {}
        [last] => {
            let when = match report.unjudged_after(last) {
                Some(_) => "the last",
                None => "at the end",
            };
            timeline.add_row(cells(when.to_owned(), &last.sequential, None));
        }
        stretches => {
            for stretch in stretches {
                let when = format!("{:.0}–{:.0} s", stretch.from_s, stretch.to_s);
                timeline.add_row(cells(when, &stretch.sequential, None));
            }
        }
    }
    timeline
}

/// Times that could not be judged; empty: none.
fn not_judged(report: &LogReport) -> String {
    if report.not_judged.is_empty() {
        return String::new();
    }
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
    format!("{rest}\n\n")
}

/// Windows and alarms of each detector that decided at all; empty: none did.
fn counts(report: &LogReport) -> String {
    let mut counts = Grid::new(["detector", "windows", "healthy", "alarmed", "alarms", "first alarm"]).numbers_from(1);
    for count in report.counts.iter().filter(|count| count.decided > 0) {
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
    if report.counts.iter().any(|count| count.decided > 0) {
        format!("{counts}\n")
    } else {
        String::new()
    }
}

/// The reason in a few words; details are in the table of what was not evaluated.
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
        Obstruction::LoadChanged => "a load was dropped or picked up",
        Obstruction::Unclear => "the evidence has no clear explanation",
        Obstruction::ImpossibleLoss => "a loss beyond 100 % would explain the motion",
    }
}

/// `128 g [123, 133] dropped at 24.06 s (1.00), named 3.1 s later; rotors are judged with it from then on`.
fn load_text(load: &LoadView) -> String {
    let IntervalView { value, low, high } = load.mass_kg;
    let (word, low, high) = if value < 0.0 {
        ("dropped", -high, -low)
    } else {
        ("taken up", low, high)
    };
    format!(
        "{:.0} g [{:.0}, {:.0}] {word} at {:.2} s ({:.2}), named {:.1} s later; rotors are judged with it from then on",
        1000.0 * value.abs(),
        1000.0 * low,
        1000.0 * high,
        load.time_s,
        load.probability,
        load.named_s - load.time_s
    )
}
