//! `rotortwin judge`: verdicts of a detector of the user's own, or of an improved network over time, become part of a run, under their own name.

use crate::output;
use clap::Parser;
use rotortwin_scenario::{Classifier, Documents, Scenario};
use rotortwin_sim::network_over_time::{self, NetworkOverTime};
use rotortwin_store::own_detector::{Detector, Listed, judge};
use rotortwin_store::summary::load_summary;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin judge`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Run folder
    run: PathBuf,
    /// CSV file with the columns `time_s` and `verdict`; each verdict holds from its time until the next one
    #[arg(
        required_unless_present = "classifier",
        conflicts_with = "classifier",
        requires = "name"
    )]
    verdicts: Option<PathBuf>,
    /// Name of the detector in tables, at most 40 characters
    #[arg(long, value_name = "NAME", conflicts_with = "classifier")]
    name: Option<String>,
    /// Instead of a file: this self-calibrating classifier, with evidence accumulated over windows
    #[arg(long, value_name = "CLASSIFIER", value_parser = crate::named::classifier())]
    classifier: Option<PathBuf>,
    /// Print the new summary as JSON
    #[arg(long)]
    json: bool,
}

/// Prints the run as `show` does, with the detector's rows.
pub(crate) fn run(args: &Args) -> ExitCode {
    let mut detector = match detector(args) {
        Ok(detector) => detector,
        Err(sentence) => return output::bad_input(sentence),
    };
    match judge(&args.run, detector.as_mut()) {
        Ok(summary) if args.json => print!("{}", summary.to_json()),
        Ok(summary) => print!("{}", output::summary_text(&summary, Some(&args.run))),
        Err(error) => return output::bad_input(error),
    }
    ExitCode::SUCCESS
}

/// The one that the options name.
fn detector(args: &Args) -> Result<Box<dyn Detector>, String> {
    match (&args.classifier, &args.verdicts, &args.name) {
        (Some(classifier), ..) => {
            let classifier = Classifier::read(classifier).map_err(|error| error.to_string())?;
            let summary = load_summary(&args.run).map_err(|error| error.to_string())?;
            let name = format!("{}, the recorded scenario", args.run.display());
            let scenario = Documents::from_toml(&name, &summary.scenario.text)
                .and_then(|documents| Scenario::from_documents(&documents))
                .map_err(|error| error.to_string())?;
            let detector =
                NetworkOverTime::new(&scenario, classifier).map_err(|reason| format!("--classifier: {reason}"))?;
            Ok(Box::new(detector))
        }
        (None, Some(verdicts), Some(name)) => read(verdicts)
            .and_then(|said| Listed::new(name, said))
            .map(|listed| Box::new(listed) as Box<dyn Detector>)
            .map_err(|reason| format!("{}: {reason}", verdicts.display())),
        _ => Err(format!(
            "expected a file of verdicts with --name, or --classifier for the {}",
            network_over_time::NAME
        )),
    }
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
