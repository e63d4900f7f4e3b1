//! `rotortwin log import`, `rotortwin log show`, `rotortwin log map` and `rotortwin log example`.

use crate::output::{self, bad_input, failed};
use rotortwin_jobs::MappingDraft;
use rotortwin_runner::grid::Grid;
use rotortwin_runner::log_import::{self, Imported, import as import_one, unique_names};
use rotortwin_runner::question;
use rotortwin_twin::flight_picture::FlightPicture;
use rotortwin_twin::identify::known_rotor_places;
use rotortwin_twin::log::FlightLog;
use rotortwin_verdicts::fleet::journal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Import flight logs, and show what they contain.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// What is done.
    #[command(subcommand)]
    pub command: Command,
}

/// What is done with logs.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Convert logs to the canonical format: NAME.parquet, NAME.toml, NAME.import.json
    Import(ImportArgs),
    /// Print columns, ranges, rate, gaps, and what a log can and cannot test
    Show(ShowArgs),
    /// Draft a mapping for a CSV from another program, for `log import --mapping`, with questions about what its columns leave open
    Map(MapArgs),
    /// Write an example: a flight with a hidden effect from the independent simulator of the blind bench, and the truth in a separate file
    Example(crate::log_example::Args),
}

/// How logs are read.
#[derive(Debug, clap::Args)]
pub struct Reading {
    /// Mapping file whose rows override the built-in ones (config/log-mappings)
    #[arg(long, value_name = "FILE", value_parser = crate::named::log_mapping())]
    mapping: Option<PathBuf>,
    /// For a simulated run, import the truth instead of the sensed values
    #[arg(long = "take-truth", visible_alias = "truth")]
    truth: bool,
    /// Vehicle file to check the log against: number and order of the rotors
    #[arg(long = "model", alias = "vehicle", value_name = "VEHICLE", value_parser = crate::named::vehicle())]
    vehicle: Option<PathBuf>,
    /// Import the readable part of a file whose checksum is wrong
    #[arg(long)]
    damaged: bool,
}

/// Which columns become what.
#[derive(Debug, clap::Args)]
pub struct MapArgs {
    /// CSV with any columns
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Mapping file to write; it must not exist. Without it the mapping is printed
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the draft as JSON: layout, columns, rows with their evidence, questions
    #[arg(long, conflicts_with = "out")]
    json: bool,
}

/// What is imported, and where to.
#[derive(Debug, clap::Args)]
pub struct ImportArgs {
    /// Canonical CSV or Parquet, run folder, PX4 ULog, ArduPilot .bin or .log, blackbox, MAVLink .tlog, ROS 2 .mcap, Crazyflie micro-SD log; LOG@35:65 takes these seconds
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    #[command(flatten)]
    reading: Reading,
    /// Folder for the imported logs
    #[arg(long, value_name = "DIR", default_value = "logs")]
    pub out: PathBuf,
    /// Resample every column to this constant rate, Hz
    #[arg(long, value_name = "HZ", value_parser = rate)]
    rate: Option<f64>,
    /// Remove the estimated delays from attitude, velocity and position
    #[arg(long)]
    align: bool,
    /// Print one line per log
    #[arg(long)]
    pub quiet: bool,
}

impl ImportArgs {
    /// An option that a server does not support.
    pub fn only_here(&self) -> Option<&'static str> {
        let options = [
            (self.reading.mapping.is_some(), "--mapping"),
            (self.reading.truth, "--take-truth"),
            (self.reading.vehicle.is_some(), "--model"),
        ];
        options.into_iter().find_map(|(given, name)| given.then_some(name))
    }

    /// The other options, as query parameters of an upload.
    pub fn query(&self) -> String {
        let mut query = self.rate.map_or_else(String::new, |rate| format!("&rate_hz={rate}"));
        for (given, name) in [(self.align, "align"), (self.reading.damaged, "damaged")] {
            if given {
                query += &format!("&{name}=true");
            }
        }
        query
    }
}

/// What is shown of a log.
#[derive(Debug, clap::Args)]
pub struct ShowArgs {
    /// The log, or a part of it: LOG@35:65 (seconds), LOG@NAME (a segment)
    #[arg(value_name = "LOG")]
    file: PathBuf,
    #[command(flatten)]
    reading: Reading,
    /// Print the import report as JSON
    #[arg(long)]
    json: bool,
    /// Print the flight over time as JSON instead, for plotting: trajectory, parts, events, motor outputs, vibration spectra
    #[arg(long = "over-time", visible_alias = "flight", requires = "json")]
    flight: bool,
}

fn rate(text: &str) -> Result<f64, String> {
    let rate: f64 = text
        .parse()
        .map_err(|_not_a_number: std::num::ParseFloatError| "not a number".to_owned())?;
    (1.0..=10_000.0)
        .contains(&rate)
        .then_some(rate)
        .ok_or_else(|| "1 to 10000 Hz were expected".to_owned())
}

impl Reading {
    fn options(&self) -> log_import::Reading<'_> {
        log_import::Reading {
            mapping: self.mapping.as_deref(),
            truth: self.truth,
            vehicle: self.vehicle.as_deref(),
            damaged: self.damaged,
        }
    }
}

impl ImportArgs {
    fn job(&self, file: &Path) -> rotortwin_jobs::LogImport {
        rotortwin_jobs::LogImport {
            file: file.to_path_buf(),
            out: self.out.clone(),
            damaged: self.reading.damaged,
            truth: self.reading.truth,
            vehicle: self.reading.vehicle.clone(),
            mapping: self.reading.mapping.clone(),
            rate_hz: self.rate,
            align: self.align,
        }
    }
}

pub(crate) fn run(args: &Args) -> ExitCode {
    match &args.command {
        Command::Import(args) => import(args),
        Command::Show(args) => show(args),
        Command::Map(args) => map(args),
        Command::Example(args) => crate::log_example::run(args),
    }
}

/// The mapping goes to the file or to standard output, the questions to standard error.
fn map(args: &MapArgs) -> ExitCode {
    let question = MappingDraft {
        file: args.file.clone(),
    };
    let drafted = match question::mapping_draft(&question) {
        Ok(drafted) => drafted,
        Err(failure) => return output::told(&failure),
    };
    if args.json {
        return printed(&drafted);
    }
    match &args.out {
        None => print!("{}", drafted.toml),
        Some(out) => {
            if *out == args.file.with_extension("toml") {
                return bad_input(format!(
                    "{}: this name is for facts on the log {} (docs/logs.md); expected another name for its mapping",
                    out.display(),
                    args.file.display()
                ));
            }
            // Answers that a user has typed are not overwritten.
            let file = std::fs::File::create_new(out);
            let written = file.and_then(|mut file| std::io::Write::write_all(&mut file, drafted.toml.as_bytes()));
            if let Err(error) = written {
                return bad_input(format!("{}: cannot write the mapping: {error}", out.display()));
            }
            output::say(format!("{} → {}", args.file.display(), out.display()));
        }
    }
    if drafted.rows.is_empty() {
        output::say_aside(
            "No column was recognised: an import takes this mapping only with rows that you write (`[[column]]`, `to`, `from`, `unit`: docs/logs.md).",
        );
    }
    for question in &drafted.questions {
        output::say_aside(format!("Question: {}.", question.sentence));
    }
    if !drafted.left_out.is_empty() {
        output::say_aside(format!("Left out: {}.", drafted.left_out.join(", ")));
    }
    ExitCode::SUCCESS
}

fn import(args: &ImportArgs) -> ExitCode {
    let mut code = ExitCode::SUCCESS;
    let names = unique_names(&args.files);
    for (file, name) in args.files.iter().zip(names) {
        match import_one(&args.job(file), &name) {
            Ok(Imported { log, path }) => {
                output::say(format!("{} → {}", log.headline(), path.display()));
                let findings = &log.report.findings;
                if args.quiet {
                    for finding in findings {
                        output::say(format!("  {finding}"));
                    }
                } else {
                    print!("{}", output::fitted(&log.account()));
                }
            }
            Err(failure) => code = output::told(&failure),
        }
    }
    code
}

fn show(args: &ShowArgs) -> ExitCode {
    let log = match log_import::read(&args.file, &args.reading.options()) {
        Ok(log) => log,
        Err(refusal) => return bad_input(refusal),
    };
    if args.flight {
        return printed(&FlightPicture::of(&log));
    }
    let parts = log.flight_parts(known_rotor_places(&log).as_deref());
    if args.json {
        let account = serde_json::json!({
            "source": log.source, "segments": log.segments, "report": log.report, "flight_parts": parts,
        });
        return printed(&account);
    }
    let mut text = format!("{}\n", log.headline());
    if let Some(clock) = log.report.clock_start_s {
        text += &format!("Clock        our 0 s is {clock:.3} s of the log's own clock\n");
    }
    if let Some((date, flown)) = journal::date_of(&log).zip(log.report.flown.as_ref()) {
        text += &format!("Flown        {date} ({})\n", flown.from);
    }
    if let Some(vehicle) = &log.vehicle {
        text += &format!("Vehicle      {vehicle}\n");
    }
    for segment in &log.segments {
        text += &format!(
            "Segment      {}: {} s to {} s\n",
            segment.name, segment.start_s, segment.end_s
        );
    }
    text += &format!("\n{}\n\n{}", range_table(&log), log.account_with(&parts));
    print!("{}", output::fitted(&text));
    ExitCode::SUCCESS
}

/// A value as JSON.
fn printed(value: &impl serde::Serialize) -> ExitCode {
    match serde_json::to_string_pretty(value) {
        Ok(text) => {
            println!("{text}");
            ExitCode::SUCCESS
        }
        Err(error) => failed(error),
    }
}

fn range_table(log: &FlightLog) -> Grid {
    let mut table = Grid::new(["column", "unit", "values", "least", "mean", "most"]).numbers_from(2);
    for range in log.ranges() {
        let number = |value: f64| {
            if value.is_nan() {
                "–".to_owned()
            } else {
                format!("{value:.4}")
            }
        };
        table.add_row([
            range.column,
            range.unit.to_owned(),
            range.values.to_string(),
            number(range.least),
            number(range.mean),
            number(range.most),
        ]);
    }
    table
}
