//! Every window of every detector as a table: Parquet, or CSV, by file extension.

use super::judged::JudgedLog;
use rotortwin_campaign::table_file::{TableFile, Values};
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
    let rows: Vec<(&JudgedLog, &WindowView)> = logs
        .iter()
        .flat_map(|log| log.report.windows.iter().map(move |window| (log, window)))
        .collect();
    let rotors = logs
        .iter()
        .map(|log| log.report.detectors.rotor_count)
        .max()
        .unwrap_or(0);
    let text = |of: &dyn Fn(&JudgedLog, &WindowView) -> String| {
        Values::Text(rows.iter().map(|(log, window)| of(log, window)).collect())
    };
    let number = |of: &dyn Fn(&JudgedLog, &WindowView) -> f64| {
        Values::Double(rows.iter().map(|(log, window)| of(log, window)).collect())
    };
    let code = |of: &dyn Fn(&WindowView) -> i32| {
        Values::Integer(rows.iter().map(|(_, window)| i64::from(of(window))).collect())
    };
    let end_s =
        |log: &JudgedLog, window: &WindowView| log.report.log.start_s + window.time_s + 1.0 / log.report.judged_rate_hz;
    let length_s = |log: &JudgedLog| f64::from(log.report.detectors.window_samples) / log.report.judged_rate_hz;

    let mut table = TableFile::default();
    table
        .column("log", text(&|log, _| log.file.clone()))
        .column("start_s", number(&|log, window| end_s(log, window) - length_s(log)))
        .column("end_s", number(&end_s));
    if logs.iter().all(|log| log.truth.is_some()) {
        let truth = |log: &JudgedLog, window: &WindowView| {
            let truth = log.truth.as_ref().expect("all logs have it");
            truth.at(end_s(log, window) - 0.5 * length_s(log))
        };
        table.column(
            "truth",
            Values::Integer(
                rows.iter()
                    .map(|(log, window)| i64::from(truth(log, window).label()))
                    .collect(),
            ),
        );
        for rotor in 0..rotors {
            table.column(
                &format!("true_loss_{}", rotor + 1),
                number(&|log, window| truth(log, window).loss[rotor]),
            );
        }
    }
    table
        .column("t_test", code(&|window| window.t_test.code))
        .column("network", code(&|window| window.network.verdict.code))
        .column(
            "network_over_time",
            code(&|window| window.network_over_time.verdict.code),
        )
        .column("sequential", code(&|window| window.sequential.verdict.code))
        .column(
            "probability",
            number(&|_, window| f64::from(window.sequential.probability)),
        )
        .column("hypotheses", text(&|_, window| hypotheses(window)))
        .column("explanations", text(&|_, window| explanations(window)))
        .column(
            "cannot_judge",
            text(&|_, window| {
                window
                    .cannot_judge
                    .as_ref()
                    .map_or_else(String::new, |obstacle| obstacle.why.clone())
            }),
        );
    for rotor in 1..=rotors {
        let of = |field: fn(&LossView) -> f32| {
            number(&|_, window| {
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
        let smallest = |window: &WindowView| {
            window
                .smallest_loss
                .get(rotor)
                .map_or(f64::NAN, |share| f64::from(*share))
        };
        table.column(
            &format!("smallest_loss_{}", rotor + 1),
            number(&|_, window| smallest(window)),
        );
    }
    let classes = rows
        .iter()
        .map(|(_, window)| window.network.class_probability.len())
        .max()
        .unwrap_or(0);
    for class in 0..classes {
        let probability = |window: &WindowView| {
            window
                .network
                .class_probability
                .get(class)
                .map_or(f64::NAN, |p| f64::from(*p))
        };
        table.column(
            &format!("network_probability_{class}"),
            number(&|_, window| probability(window)),
        );
    }
    for class in 0..classes {
        let probability = |window: &WindowView| {
            let classes = &window.network_over_time.class_probability;
            classes.get(class).map_or(f64::NAN, |p| f64::from(*p))
        };
        table.column(
            &format!("network_over_time_probability_{class}"),
            number(&|_, window| probability(window)),
        );
    }
    table
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
