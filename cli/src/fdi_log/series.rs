//! Every window of every detector as a table: Parquet, or CSV, by file extension.

use rotortwin_campaign::table_file::{TableFile, Values};
use rotortwin_runner::log_verdict::judged::JudgedLog;
use rotortwin_verdicts::view::{ExplanationView, ExplanationWord, LossView, WindowView};
use std::path::Path;

/// Writes one row per window, with the logs concatenated. Times are those of the log, as in `LOG@35:65`.
///
/// # Errors
/// The file cannot be written.
pub(super) fn write(path: &Path, logs: &[JudgedLog]) -> Result<(), String> {
    let table = table(logs);
    let written = if path.extension().is_some_and(|ending| ending == "csv") {
        table.write_csv(path)
    } else {
        table.write_parquet(path)
    };
    written.map_err(|error| error.to_string())
}

fn table(logs: &[JudgedLog]) -> TableFile {
    let windows = Windows::of(logs);
    let rotors = logs
        .iter()
        .map(|log| log.report.detectors.rotor_count)
        .max()
        .unwrap_or(0);
    let mut table = TableFile::default();
    table
        .column("log", windows.text(|log, _| log.file.clone()))
        .column(
            "start_s",
            windows.number(|log, window| end_s(log, window) - length_s(log)),
        )
        .column("end_s", windows.number(end_s));
    if logs.iter().all(|log| log.truth.is_some()) {
        add_truth(&mut table, &windows, rotors);
    }
    add_verdicts(&mut table, &windows);
    add_losses(&mut table, &windows, rotors);
    add_probabilities(&mut table, &windows, "network_probability", |window| {
        &window.network.class_probability
    });
    add_probabilities(&mut table, &windows, "network_over_time_probability", |window| {
        &window.network_over_time.class_probability
    });
    table
}

/// The rows of the table.
struct Windows<'a>(Vec<(&'a JudgedLog, &'a WindowView)>);

impl<'a> Windows<'a> {
    fn of(logs: &'a [JudgedLog]) -> Self {
        let of_log = |log: &'a JudgedLog| log.report.windows.iter().map(move |window| (log, window));
        Self(logs.iter().flat_map(of_log).collect())
    }

    fn text(&self, of: impl Fn(&JudgedLog, &WindowView) -> String) -> Values {
        Values::Text(self.0.iter().map(|(log, window)| of(log, window)).collect())
    }

    fn number(&self, of: impl Fn(&JudgedLog, &WindowView) -> f64) -> Values {
        Values::Double(self.0.iter().map(|(log, window)| of(log, window)).collect())
    }

    fn code(&self, of: impl Fn(&JudgedLog, &WindowView) -> i32) -> Values {
        Values::Integer(self.0.iter().map(|(log, window)| i64::from(of(log, window))).collect())
    }
}

fn end_s(log: &JudgedLog, window: &WindowView) -> f64 {
    log.report.log.start_s + window.time_s + 1.0 / log.report.judged_rate_hz
}

fn length_s(log: &JudgedLog) -> f64 {
    f64::from(log.report.detectors.window_samples) / log.report.judged_rate_hz
}

/// The truth in the middle of each window; all logs have it.
fn add_truth(table: &mut TableFile, windows: &Windows<'_>, rotors: usize) {
    let truth = |log: &JudgedLog, window: &WindowView| {
        let truth = log.truth.as_ref().expect("all logs have it");
        truth.at(end_s(log, window) - 0.5 * length_s(log))
    };
    table.column("truth", windows.code(|log, window| truth(log, window).label()));
    for rotor in 0..rotors {
        table.column(
            &format!("true_loss_{}", rotor + 1),
            windows.number(|log, window| truth(log, window).loss[rotor]),
        );
    }
}

fn add_verdicts(table: &mut TableFile, windows: &Windows<'_>) {
    let why_not = |window: &WindowView| {
        let obstacle = window.cannot_judge.as_ref();
        obstacle.map_or_else(String::new, |obstacle| obstacle.why.clone())
    };
    table
        .column("t_test", windows.code(|_, window| window.t_test.code))
        .column("network", windows.code(|_, window| window.network.verdict.code))
        .column(
            "network_over_time",
            windows.code(|_, window| window.network_over_time.verdict.code),
        )
        .column("sequential", windows.code(|_, window| window.sequential.verdict.code))
        .column(
            "probability",
            windows.number(|_, window| f64::from(window.sequential.probability)),
        )
        .column("hypotheses", windows.text(|_, window| hypotheses(window)))
        .column("explanations", windows.text(|_, window| explanations(window)))
        .column("cannot_judge", windows.text(|_, window| why_not(window)));
}

/// Loss of thrust of each rotor, and the smallest one that would show.
fn add_losses(table: &mut TableFile, windows: &Windows<'_>, rotors: usize) {
    for rotor in 1..=rotors {
        let of = |field: fn(&LossView) -> f32| {
            windows.number(|_, window| {
                let losses = &window.sequential.thrust_loss;
                let loss = losses.iter().find(|loss| loss.rotor as usize == rotor);
                loss.map_or(f64::NAN, |loss| f64::from(field(loss)))
            })
        };
        table
            .column(&format!("loss_{rotor}"), of(|loss| loss.share))
            .column(&format!("loss_low_{rotor}"), of(|loss| loss.share_low))
            .column(&format!("loss_high_{rotor}"), of(|loss| loss.share_high))
            .column(
                &format!("loss_rate_{rotor}"),
                of(|loss| loss.motion.map_or(f32::NAN, |motion| motion.rate_1_s.value)),
            );
    }
    for rotor in 0..rotors {
        table.column(
            &format!("smallest_loss_{}", rotor + 1),
            windows.number(|_, window| or_nan(window.smallest_loss.get(rotor))),
        );
    }
}

/// Probability of each class according to a network. As many columns as the classes of the [`network`](WindowView::network), which both have.
fn add_probabilities(table: &mut TableFile, windows: &Windows<'_>, name: &str, of: impl Fn(&WindowView) -> &[f32]) {
    let classes = windows
        .0
        .iter()
        .map(|(_, window)| window.network.class_probability.len());
    for class in 0..classes.max().unwrap_or(0) {
        table.column(
            &format!("{name}_{class}"),
            windows.number(|_, window| or_nan(of(window).get(class))),
        );
    }
}

fn or_nan(value: Option<&f32>) -> f64 {
    value.map_or(f64::NAN, |value| f64::from(*value))
}

/// `3` or `1+2|4`: the rotor sets that an ambiguous verdict leaves open.
fn hypotheses(window: &WindowView) -> String {
    let set = |rotors: &Vec<u32>| rotors.iter().map(u32::to_string).collect::<Vec<_>>().join("+");
    window
        .sequential
        .hypotheses
        .iter()
        .map(set)
        .collect::<Vec<_>>()
        .join("|")
}

/// `loss 5 0.61|gain 2 0.37`: kind, rotors and probability of each explanation.
fn explanations(window: &WindowView) -> String {
    let one = |one: &ExplanationView| {
        let kind = match one.kind {
            ExplanationWord::Loss => "loss",
            ExplanationWord::LossWithDrag => "loss_with_drag",
            ExplanationWord::Gain => "gain",
            ExplanationWord::Load => "load",
        };
        let rotors: Vec<String> = one.rotors.iter().map(u32::to_string).collect();
        format!("{kind} {} {:.3}", rotors.join("+"), one.probability)
    };
    window
        .sequential
        .explanations
        .iter()
        .map(one)
        .collect::<Vec<_>>()
        .join("|")
}
