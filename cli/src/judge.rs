//! `rotortwin judge`: verdicts of a detector of the user's own become part of a run, under its own name.

use crate::output;
use clap::Parser;
use rotortwin_store::own_detector::{Listed, judge};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin judge`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Run folder
    run: PathBuf,
    /// CSV file with the columns `time_s` and `verdict`; each verdict holds from its time until the next one
    verdicts: PathBuf,
    /// Name of the detector in tables, at most 40 characters
    #[arg(long, value_name = "NAME")]
    name: String,
    /// Print the new summary as JSON
    #[arg(long)]
    json: bool,
}

/// Prints the run as `show` does, with the detector's rows.
pub(crate) fn run(args: &Args) -> ExitCode {
    let listed = read(&args.verdicts)
        .and_then(|said| Listed::new(&args.name, said))
        .map_err(|reason| format!("{}: {reason}", args.verdicts.display()));
    let mut listed = match listed {
        Ok(listed) => listed,
        Err(sentence) => return output::bad_input(sentence),
    };
    match judge(&args.run, &mut listed) {
        Ok(summary) if args.json => print!("{}", summary.to_json()),
        Ok(summary) => print!("{}", output::summary_text(&summary, Some(&args.run))),
        Err(error) => return output::bad_input(error),
    }
    ExitCode::SUCCESS
}

/// Times, s, and codes.
fn read(path: &Path) -> Result<Vec<(f64, i32)>, String> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_path(path)
        .map_err(|error| error.to_string())?;
    let header = reader.headers().map_err(|error| error.to_string())?.clone();
    let place = |name: &str| {
        header
            .iter()
            .position(|column| column == name)
            .ok_or_else(|| format!("there is no column `{name}`; expected `time_s` and `verdict`"))
    };
    let (time, verdict) = (place("time_s")?, place("verdict")?);
    let rows = reader.records().enumerate().map(|(row, record)| {
        let record = record.map_err(|error| error.to_string())?;
        let cell = |place: usize| record.get(place).unwrap_or("");
        let expected = |name: &str, place: usize, what: &str| {
            format!("row {}, `{name}`: expected {what}, got '{}'", row + 1, cell(place))
        };
        let time_s = cell(time)
            .parse()
            .map_err(|_not_a_number| expected("time_s", time, "a number of seconds"))?;
        let code = cell(verdict)
            .parse()
            .map_err(|_not_a_number| expected("verdict", verdict, "a whole number"))?;
        Ok((time_s, code))
    });
    rows.collect()
}
