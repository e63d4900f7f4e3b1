//! Comparison of models with flights.

use crate::destination::{ResultFolder, write_text};
use crate::failure::Failure;
use crate::grid::Grid;
use crate::logs::read_logs_for;
use crate::text::significant;
use rotortwin_jobs::Comparison as Job;
use rotortwin_twin::compare::evaluate::{CHI2_LIMIT, KINEMATIC_LIMIT, LOW_FREQUENCY_LIMIT};
use rotortwin_twin::compare::{self, ChannelVerdict, Comparison, LogComparison, ModelOnLog, NamedModel};
use rotortwin_twin::flight_picture::FlightPicture;
use rotortwin_twin::identify::same_rotor_order;
use rotortwin_twin::improve::report::short;
use rotortwin_twin::log::RotorOrder;
use rotortwin_twin::model::ModelStore;

/// A comparison, with its text form.
#[derive(Debug)]
pub struct Compared {
    /// The result.
    pub comparison: Comparison,
    /// Human-readable: verdict first.
    pub text: String,
}

/// Compares models with flights; the result is also written to the job's folder.
///
/// # Errors
/// A model or a log cannot be used, or the folder cannot be written.
pub fn compare(job: &Job) -> Result<Compared, Failure> {
    if !job.label.is_empty() && job.label.len() != job.model.len() {
        return Err(Failure::input(format!(
            "{} labels for {} models; expected one for each, or none",
            job.label.len(),
            job.model.len()
        )));
    }
    let mut models = named_models(&ModelStore::new(&job.models), &job.model)?;
    for (model, label) in models.iter_mut().zip(&job.label) {
        model.label.clone_from(label);
    }
    // Before the logs: reading those of an hour takes seconds.
    let folder = ResultFolder::of_option(job.out.as_ref()).map_err(Failure::input)?;
    let first = models.first().map(|model| model.version.vehicle.clone());
    let logs = match &first {
        Some(vehicle) => read_logs_for(&job.logs, vehicle)?,
        None => Vec::new(),
    };
    for model in &models {
        let moved = logs
            .iter()
            .find(|log| matches!(log.report.rotor_order, RotorOrder::Vehicle(_)));
        if let (Some(log), Some(first)) = (moved, &first)
            && !same_rotor_order(first, &model.version.vehicle)
        {
            return Err(Failure::input(format!(
                "{}: its motors are reordered to the rotors of a vehicle, and '{}' and '{}' have different orders; compare them one at a time",
                log.name, first.name, model.version.vehicle.name
            )));
        }
        if let Some(sentence) = logs.iter().find_map(|log| log.refusal_against(&model.version.vehicle)) {
            return Err(Failure::input(sentence));
        }
    }
    let (comparison, series) = compare::compare(&logs, &models).map_err(Failure::input)?;
    let text = text(&comparison);
    if let Some(folder) = folder.map(ResultFolder::keep) {
        let path = folder.path();
        let flights: Vec<FlightPicture> = logs.iter().map(FlightPicture::of).collect();
        compare::files::write(path, &comparison, &series, &flights)
            .map_err(|error| error.to_string())
            .and_then(|()| write_text(&path.join("comparison.txt"), &text))
            .map_err(|sentence| Failure::writing(path, sentence))?;
    }
    Ok(Compared { comparison, text })
}

/// The models named by texts.
fn named_models(store: &ModelStore, texts: &[String]) -> Result<Vec<NamedModel>, Failure> {
    texts
        .iter()
        .map(|text| {
            let found = store.find(text)?;
            Ok(NamedModel {
                label: found.label(),
                version: found.version,
            })
        })
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
            text.push_str(&format!(
                "chi²: mean square of the whitened residual; slow: of its sums over 0.25 s; both 1 for pure noise. FAILS: chi² above \
                 {CHI2_LIMIT}, or slow above {LOW_FREQUENCY_LIMIT} (k… channels: {KINEMATIC_LIMIT}) and beyond chance\n"
            ));
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
                short(value)
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
                .map_or_else(|| "–".to_owned(), |error| short(error.error))
        }));
        row.push(short(error.noise));
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
                        short(open.position_m),
                        short(open.velocity_m_s),
                        short(open.attitude_rad.to_degrees())
                    )
                },
            )
        }));
        row.push(String::new());
        table.add_row(row);
    }
    table
}
