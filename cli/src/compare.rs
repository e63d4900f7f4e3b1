//! `rotortwin compare`: models against flight logs.

use crate::destination::{self, ResultFolder};
use crate::grid::Grid;
use crate::output::{self, significant};
use crate::versions::store_failed;
use clap::Parser;
use rotortwin_twin::compare::{self, ChannelVerdict, Comparison, LogComparison, ModelOnLog, NamedModel};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelStore;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin compare`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Flight logs of any source, or run folders; LOG@35:65 takes only these seconds, LOG@NAME a segment
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Models to compare with them: MODEL, MODEL@BRANCH, MODEL@v2, or a version or vehicle file
    #[arg(long = "model", required = true, num_args = 1.., value_name = "MODEL")]
    pub model: Vec<String>,
    /// What to call the models in the result, one for each
    #[arg(long, value_name = "NAME")]
    pub label: Vec<String>,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    pub models: PathBuf,
    /// Write report.html, comparison.json, comparison.txt and residuals of each log as Parquet into this folder; must not exist or be empty
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print the comparison as JSON, nothing else
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> ExitCode {
    if !args.label.is_empty() && args.label.len() != args.model.len() {
        return output::bad_input(format!(
            "{} --label for {} --model; expected one for each, or none",
            args.label.len(),
            args.model.len()
        ));
    }
    let mut models = match named_models(&ModelStore::new(&args.models), &args.model) {
        Ok(models) => models,
        Err(code) => return code,
    };
    for (model, label) in models.iter_mut().zip(&args.label) {
        model.label.clone_from(label);
    }
    let logs = match read_logs(&args.logs) {
        Ok(logs) => logs,
        Err(code) => return code,
    };
    for model in &models {
        if let Some(sentence) = logs.iter().find_map(|log| log.refusal_against(&model.version.vehicle)) {
            return output::bad_input(sentence);
        }
    }
    let folder = match ResultFolder::of_option(args.out.as_ref()) {
        Ok(folder) => folder,
        Err(sentence) => return output::bad_input(sentence),
    };
    let (comparison, series) = match compare::compare(&logs, &models) {
        Ok(done) => done,
        Err(error) => return output::bad_input(error),
    };
    let text = text(&comparison);
    if let Some(folder) = folder.map(ResultFolder::keep) {
        let path = folder.path();
        let written = compare::files::write(path, &comparison, &series)
            .map_err(|error| error.to_string())
            .and_then(|()| output::write_text(&path.join("comparison.txt"), &text));
        if let Err(sentence) = written {
            return destination::failed_at(path, sentence);
        }
    }
    if args.json {
        println!("{}", compare::files::json(&comparison));
    } else {
        print!("{}", output::fitted(&text));
        if let Some(folder) = &args.out {
            println!("Files        {}", folder.display());
            println!("             report.html  comparison.json  comparison.txt  residuals of each log as Parquet");
        }
    }
    ExitCode::SUCCESS
}

/// The models that texts name.
pub fn named_models(store: &ModelStore, texts: &[String]) -> Result<Vec<NamedModel>, ExitCode> {
    texts
        .iter()
        .map(|text| {
            let found = store.find(text).map_err(|error| store_failed(&error))?;
            Ok(NamedModel {
                label: found.label(),
                version: found.version,
            })
        })
        .collect()
}

/// Refuses the first log that must be mended before a diagnosis against this vehicle.
pub fn refused(logs: &[FlightLog], vehicle: &rotortwin_plant::vehicle::model::VehicleModel) -> Result<(), ExitCode> {
    match logs.iter().find_map(|log| log.refusal_before_diagnosis(vehicle)) {
        Some(sentence) => Err(output::bad_input(sentence)),
        None => Ok(()),
    }
}

/// The logs at these paths, or parts of them.
pub fn read_logs(paths: &[PathBuf]) -> Result<Vec<FlightLog>, ExitCode> {
    paths
        .iter()
        .map(|path| FlightLog::read_part(path).map_err(output::bad_input))
        .collect()
}

/// The comparison for a terminal: verdict first.
fn text(comparison: &Comparison) -> String {
    let mut text = String::new();
    for log in &comparison.logs {
        for model in &log.models {
            text.push_str(&format!("{}: {}\n", log.log.name, model.sentence()));
        }
        if let Some(last) = log.models.last() {
            text.push_str(&format!("{}\n", channel_table(last)));
            text.push_str(
                "chi²: mean square of the whitened residual; slow: of its sums over 0.25 s; both 1 for pure noise\n",
            );
            text.push_str(&worst(last));
        }
        text.push_str(&format!(
            "\nError (means over 0.1 s), and open-loop prediction\n{}\n",
            error_table(log)
        ));
        for note in &log.notes {
            text.push_str(&format!("Note         {note}\n"));
        }
        text.push('\n');
    }
    text
}

fn channel_table(model: &ModelOnLog) -> Grid {
    let mut table = Grid::new(["channel", "", "depends on", "error", "noise", "unit", "chi²", "slow"]).numbers_from(3);
    for channel in &model.channels {
        let verdict = match channel.verdict {
            ChannelVerdict::Agrees => "agrees",
            ChannelVerdict::Fails => "FAILS",
            ChannelVerdict::NotTestable => "not testable",
        };
        let depends = channel
            .conditions
            .first()
            .filter(|d| channel.verdict == ChannelVerdict::Fails && d.explained > 0.3)
            .map_or_else(String::new, |d| format!("{} ({:.0} %)", d.title, 100.0 * d.explained));
        let number = |value: f64| {
            if value.is_finite() {
                significant3(value)
            } else {
                "–".to_owned()
            }
        };
        table.add_row([
            channel.channel.to_owned(),
            verdict.to_owned(),
            depends,
            number(channel.smoothed_rms),
            number(channel.smoothed_noise),
            channel.unit.to_owned(),
            number(channel.chi2),
            number(channel.low_frequency),
        ]);
    }
    table
}

/// Three significant digits.
fn significant3(value: f64) -> String {
    if !value.is_finite() {
        // No sample of flight under this model.
        return "–".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let decimals = (2 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    format!("{value:.decimals$}")
}

fn worst(model: &ModelOnLog) -> String {
    let mut text = String::new();
    for (line, moment) in model.worst.iter().take(3).enumerate() {
        let label = if line == 0 { "Worst" } else { "" };
        text.push_str(&format!(
            "{label:<12} {:.1}–{:.1} s  {} off by {} {}, {:.0} deviations\n",
            moment.start_s,
            moment.end_s,
            moment.channel,
            significant(moment.error),
            moment.unit,
            moment.deviations
        ));
    }
    text
}

/// One row per quantity and horizon, one column per model: the waterfall in numbers.
pub fn error_table(log: &LogComparison) -> Grid {
    let mut header = vec!["quantity".to_owned()];
    header.extend(log.models.iter().map(|model| model.model.clone()));
    header.push("noise".to_owned());
    let mut table = Grid::new(header).numbers_from(1);
    let Some(first) = log.models.first() else { return table };
    for error in &first.errors {
        let mut row = vec![format!("{}, {}", error.quantity, error.unit)];
        row.extend(log.models.iter().map(|model| {
            model
                .error_of(error.quantity)
                .map_or_else(|| "–".to_owned(), |error| significant3(error.error))
        }));
        row.push(significant3(error.noise));
        table.add_row(row);
    }
    for (place, open) in first.open_loop.iter().enumerate() {
        let mut row = vec![format!("after {} s, m · m/s · °", open.horizon_s)];
        row.extend(log.models.iter().map(|model| {
            model.open_loop.get(place).map_or_else(
                || "–".to_owned(),
                |open| {
                    format!(
                        "{} · {} · {}",
                        significant3(open.position_m),
                        significant3(open.velocity_m_s),
                        significant3(open.attitude_rad.to_degrees())
                    )
                },
            )
        }));
        row.push(String::new());
        table.add_row(row);
    }
    table
}
