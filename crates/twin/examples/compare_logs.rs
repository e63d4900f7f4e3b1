//! Compares a vehicle with logs and prints the verdicts: `compare_logs MODEL LOG… [--out DIR]`.

use std::error::Error;
use std::path::Path;

use rotortwin_twin::compare::{self, NamedModel};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let out = match arguments.iter().position(|argument| argument == "--out") {
        Some(place) => arguments.split_off(place).get(1).cloned(),
        None => None,
    };
    let Some((model, logs)) = arguments.split_first() else {
        return Err("expected MODEL LOG… [--out DIR]".into());
    };
    let models: Vec<NamedModel> = model
        .split(',')
        .map(|path| {
            Ok(NamedModel {
                label: path.to_owned(),
                version: ModelVersion::load(path)?,
            })
        })
        .collect::<Result<_, Box<dyn Error>>>()?;
    let logs: Vec<FlightLog> = logs
        .iter()
        .map(|path| FlightLog::read(Path::new(path)))
        .collect::<Result<_, _>>()?;
    let (comparison, series) = compare::compare(&logs, &models)?;
    for log in &comparison.logs {
        for model in &log.models {
            println!("{}: {}", log.log.name, model.sentence());
            for channel in &model.channels {
                println!(
                    "  {:9} {:?} chi2 {:.3} slow {:.3}±{:.3} lag1 {:.3}",
                    channel.channel,
                    channel.verdict,
                    channel.chi2,
                    channel.low_frequency,
                    channel.low_frequency_chance,
                    channel.ljung_box.map_or(f64::NAN, |test| test.lag_one)
                );
            }
            for error in &model.errors {
                println!(
                    "  {} {:.3} (noise {:.3}) {}",
                    error.quantity, error.error, error.noise, error.unit
                );
            }
            for open in &model.open_loop {
                println!("  {open:?}");
            }
        }
    }
    if let Some(out) = out {
        compare::files::write(Path::new(&out), &comparison, &series, &[])?;
    }
    Ok(())
}
