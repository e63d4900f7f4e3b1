//! `rotortwin blind`: the blind bench, and its generator by hand.

use crate::output;
use crate::progress::resumed_bar;
use clap::{Args as ClapArgs, Parser, Subcommand};
use indicatif::ProgressBar;
use rotortwin_blind::bench::cases::{Case, Preset};
use rotortwin_blind::bench::faults::FaultBench;
use rotortwin_blind::bench::faults_sheet;
use rotortwin_blind::bench::product::{read_diagnosis, read_either};
use rotortwin_blind::bench::report;
use rotortwin_blind::bench::run::{Bench, DiagnosisCommand, Program, Request};
use rotortwin_blind::bench::score::Row;
use rotortwin_blind::bench::sheet::{self, Sheet};
use rotortwin_blind::command;
use rotortwin_blind::error::BlindError;
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_scenario::names::Kind;
use serde_json::json;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin blind`.
#[derive(Debug, Parser)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Sub>,
    #[command(flatten)]
    bench: BenchArgs,
}

#[derive(Debug, Subcommand)]
enum Sub {
    /// Fly once in the foreign simulator: the log, and the truth apart
    Generate(command::GenerateArgs),
    /// List what can be hidden: ids, parameters, typical sizes
    Effects {
        /// As JSON
        #[arg(long)]
        json: bool,
    },
}

/// Which bench.
#[derive(Debug, ClapArgs)]
pub struct BenchArgs {
    /// What to show; several with commas
    #[arg(long, value_enum, value_delimiter = ',', default_value = "mixed")]
    pub preset: Vec<Preset>,
    /// Cases of each preset
    #[arg(long, default_value_t = 200)]
    pub n: usize,
    /// Seed of the draws
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Vehicle documents, taken in turn; several with commas
    #[arg(
        long = "model",
        alias = "vehicles",
        value_name = "VEHICLE",
        value_delimiter = ',',
        default_value = "f550",
        value_parser = crate::named::vehicle()
    )]
    pub vehicles: Vec<PathBuf>,
    /// Length of a flight, s
    #[arg(long, default_value_t = 90.0)]
    pub duration_s: f64,
    /// Folder of the results; a bench that was stopped goes on there
    #[arg(long, default_value = "runs/blind")]
    pub out: PathBuf,
    /// Processes at a time [default: 1]
    #[arg(long)]
    jobs: Option<usize>,
    /// Keep the generated logs
    #[arg(long)]
    keep_logs: bool,
    /// Another diagnosis: a command line with {log} and {vehicle} that prints an answer as JSON (docs/blind-bench.md)
    #[arg(long, value_name = "COMMAND")]
    diagnosis: Option<String>,
    /// Do only these cases, counted over all presets, and leave them as they are: they are put together elsewhere
    #[arg(long, value_name = "FIRST..END", value_parser = output::range)]
    cases: Option<Range<u64>>,
    /// Print the score as JSON
    #[arg(long)]
    pub json: bool,
    /// With --json: print each case as a JSON line when it is done; end when the standard input does
    #[arg(long, requires = "json")]
    events: bool,
}

impl BenchArgs {
    /// An option that a server cannot be asked for.
    pub fn only_here(&self) -> Option<&'static str> {
        let options = [
            (self.jobs.is_some(), "--jobs"),
            (self.keep_logs, "--keep-logs"),
            (self.diagnosis.is_some(), "--diagnosis"),
            (self.cases.is_some(), "--cases"),
            (self.events, "--events"),
        ];
        options.into_iter().find_map(|(given, name)| given.then_some(name))
    }

    /// What is asked for.
    ///
    /// # Errors
    /// It cannot be run.
    pub fn request(&self) -> Result<Request, BlindError> {
        let request = Request {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            presets: self.preset.clone(),
            n: self.n,
            seed: self.seed,
            vehicles: self.vehicles.iter().map(|path| path.display().to_string()).collect(),
            duration_s: self.duration_s,
        };
        request.check()?;
        Ok(request)
    }
}

impl Args {
    /// The bench that is asked for; `None`: something by hand.
    pub fn bench(&self) -> Option<&BenchArgs> {
        self.command.is_none().then_some(&self.bench)
    }
}

/// Runs the bench or the generator.
pub fn run(args: &Args) -> ExitCode {
    let result = match &args.command {
        Some(Sub::Generate(generate)) => return self::generate(generate),
        Some(Sub::Effects { json }) => return command::run(&command::Command::Effects { json: *json }),
        None => bench(&args.bench),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if matches!(error.downcast_ref(), Some(BlindError::Input { .. })) => output::bad_input(error),
        Err(error) => output::failed(error),
    }
}

/// The generator knows files only.
fn generate(args: &command::GenerateArgs) -> ExitCode {
    let mut args = args.clone();
    let vehicle = args.vehicle.unwrap_or_else(|| PathBuf::from("f550"));
    match crate::named::resolved(Kind::Vehicle, vehicle.as_os_str()) {
        Ok(path) => args.vehicle = Some(path),
        Err(error) => return output::bad_input(error),
    }
    command::run(&command::Command::Generate(args))
}

/// A command of this program, which ends with us.
fn of_this_program(words: &[&str], cores: usize) -> std::io::Result<Program> {
    let program = std::env::current_exe()?.display().to_string();
    let all = [&program, "--end-with-stdin"].into_iter().chain(words.iter().copied());
    Ok(Program {
        words: all.map(str::to_owned).collect(),
        held: true,
        cores,
    })
}

/// Faults are judged by the detectors, one flight after the other, and have a sheet of their own.
fn faults(args: &BenchArgs) -> anyhow::Result<()> {
    let refused = [
        (args.diagnosis.is_some(), "--diagnosis"),
        (args.cases.is_some(), "--cases"),
        (args.events, "--events"),
        (args.jobs.is_some(), "--jobs"),
    ];
    if let Some((_, option)) = refused.into_iter().find(|(given, _)| *given) {
        let (place, reason) = (
            option.to_owned(),
            "is not for the preset faults; expected --n, --seed, --model, --out".to_owned(),
        );
        return Err(BlindError::Input { place, reason }.into());
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let bench = FaultBench {
        folder: args.out.clone(),
        n: args.n,
        seed: args.seed,
        vehicles: args.vehicles.iter().map(|path| path.display().to_string()).collect(),
        duration_s: args.duration_s,
        detectors: of_this_program(
            &["fdi-log", "{log}", "--model", "{vehicle}", "--json", "--windows"],
            cores,
        )?,
        keep_logs: args.keep_logs,
    };
    let cases = bench.cases()?;
    let bar = progress_bar(args.json, cases.len() as u64, 0);
    let rows = bench.run(&cases, &mut |row| {
        bar.set_message(row.case.class.words());
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    let sheets = faults_sheet::sum_up(&rows);
    faults_sheet::write(&bench.folder, bench.seed, &rows, &sheets)?;
    if args.json {
        println!("{:#}", serde_json::to_value(&sheets)?);
    } else {
        print!("{}", faults_sheet::text(&sheets));
        println!("Score: {}", bench.folder.join("score.json").display());
    }
    Ok(())
}

fn bench(args: &BenchArgs) -> anyhow::Result<()> {
    if args.preset == [Preset::Faults] {
        return faults(args);
    }
    if args.events {
        crate::fly::end_with_standard_input();
    }
    let rotor_counts = args
        .vehicles
        .iter()
        .map(|path| Vehicle::load(path).map(|vehicle| vehicle.rotors.len()))
        .collect::<Result<Vec<_>, _>>()?;
    let jobs = args.jobs.unwrap_or(1).max(1);
    let cores = (std::thread::available_parallelism().map_or(1, usize::from) / jobs).max(1);
    let bench = Bench {
        folder: args.out.clone(),
        generator: of_this_program(&["blind", "generate"], cores)?,
        jobs,
        keep_logs: args.keep_logs,
        request: args.request()?,
    };
    let diagnosis = match &args.diagnosis {
        Some(line) => DiagnosisCommand {
            command: Program {
                words: line.split_whitespace().map(str::to_owned).collect(),
                held: false,
                cores,
            },
            read: read_either,
        },
        None => DiagnosisCommand {
            command: of_this_program(&["diagnose", "{log}", "--model", "{vehicle}", "--json"], cores)?,
            read: read_diagnosis,
        },
    };
    let cases = bench.request.cases(&rotor_counts);
    let cases = match &args.cases {
        None => &cases[..],
        Some(range) => part_of(&cases, range)?,
    };
    bench.open()?;
    let bar = progress_bar(args.events, cases.len() as u64, bench.rows(cases).len() as u64);
    let rows = bench.run(cases, &diagnosis, &|row| {
        bar.set_message(format!("{} → {}", row.truth, row.named));
        bar.inc(1);
        if args.events {
            output::line(&case_event(row).to_string());
        }
    })?;
    bar.finish_and_clear();
    if args.cases.is_some() {
        let done = json!({ "cases": cases.len(), "rows": rows.len() });
        output::line(&if args.json {
            done.to_string()
        } else {
            format!(
                "{} of {} cases; rows in {}",
                rows.len(),
                cases.len(),
                bench.folder.display()
            )
        });
        return Ok(());
    }
    let sheet = sheet::sum_up(&rows);
    report::write(&bench.folder, &bench.request, &rows, &sheet)?;
    if args.json {
        println!("{:#}", serde_json::to_value(&sheet)?);
    } else {
        print_text(&sheet, &bench.folder);
    }
    Ok(())
}

/// The cases of a range that was asked for.
fn part_of<'a>(cases: &'a [Case], range: &Range<u64>) -> anyhow::Result<&'a [Case]> {
    let end = |number: u64| usize::try_from(number).unwrap_or(usize::MAX);
    cases
        .get(end(range.start)..end(range.end))
        .ok_or_else(|| {
            let reason = format!("{}..{}; expected within 0..{}", range.start, range.end, cases.len());
            BlindError::Input {
                place: "--cases".to_owned(),
                reason,
            }
        })
        .map_err(anyhow::Error::from)
}

/// What is said of a case that is done.
fn case_event(row: &Row) -> serde_json::Value {
    json!({
        "event": "case", "case": row.case.index, "preset": row.case.preset, "truth": row.truth, "named": row.named,
        "outcome": row.outcome,
    })
}

/// A bar over cases; the first `present` are there already.
pub fn progress_bar(hidden: bool, cases: u64, present: u64) -> ProgressBar {
    resumed_bar("{bar:30} {pos}/{len}  {elapsed}, {left}  {msg}", hidden, cases, present)
}

/// The score sheet, and where the report is.
pub fn print_text(sheet: &Sheet, folder: &Path) {
    print!("{}", sheet::text(sheet));
    println!("Report: {}", folder.join("report.html").display());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        blind: Args,
    }

    fn parsed(words: &[&str]) -> Args {
        Line::try_parse_from([&["blind"], words].concat()).unwrap().blind
    }

    #[test]
    fn val_what_a_server_cannot_be_asked_for() {
        assert_eq!(parsed(&["--n", "3"]).bench().and_then(BenchArgs::only_here), None);
        for words in [
            &["--jobs", "2"][..],
            &["--keep-logs"],
            &["--diagnosis", "tool {log}"],
            &["--cases", "0..4"],
            &["--events", "--json"],
        ] {
            assert_eq!(parsed(words).bench().and_then(BenchArgs::only_here), Some(words[0]));
        }
        assert!(parsed(&["effects"]).bench().is_none());
    }

    #[test]
    fn val_parts_lie_within_the_bench() {
        let mut request = parsed(&["--n", "5"]).bench().unwrap().request().unwrap();
        request.vehicles.truncate(1);
        let cases = request.cases(&[6]);
        let part = part_of(&cases, &(3..5)).unwrap();
        assert_eq!(part.iter().map(|case| case.index).collect::<Vec<_>>(), [3, 4]);
        let error = part_of(&cases, &(3..6)).unwrap_err().to_string();
        assert!(error.contains("within 0..5"), "{error}");
    }
}
