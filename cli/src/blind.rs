//! `rotortwin blind`: the blind bench, and manual use of its generator.

use crate::output;
use crate::progress::{Lines, resumed_bar};
use clap::{Args as ClapArgs, Parser, Subcommand};
use indicatif::ProgressBar;
use rotortwin_blind::bench::cases::Preset;
use rotortwin_blind::bench::faults::{End, FaultBench};
use rotortwin_blind::bench::faults_sheet;
use rotortwin_blind::bench::merge;
use rotortwin_blind::bench::run::Request;
use rotortwin_blind::bench::sheet::{self, Sheet};
use rotortwin_blind::command;
use rotortwin_blind::error::BlindError;
use rotortwin_jobs::JobEvent;
use rotortwin_runner::blind::{self as runner, Benched, of_this_program};
use rotortwin_runner::failure::Failure;
use rotortwin_runner::named::resolved;
use rotortwin_scenario::names::Kind;
use std::num::NonZeroUsize;
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
    /// Fly once in the independent simulator: a log, and the truth in a separate file
    Generate(command::GenerateArgs),
    /// List what can be hidden: ids, parameters, typical sizes
    Effects {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Merge parts of one bench (--cases) that were run elsewhere, and score it
    Merge {
        /// Folders with parts, in any order; a case may be in several
        #[arg(required = true, value_name = "DIR")]
        folders: Vec<PathBuf>,
        /// Folder of the whole bench; it may hold some of the cases already
        #[arg(long, value_name = "DIR", default_value = "runs/blind")]
        out: PathBuf,
        /// Print the score as JSON
        #[arg(long)]
        json: bool,
    },
}

/// Which bench.
#[derive(Debug, ClapArgs)]
pub struct BenchArgs {
    /// Presets to run; several with commas
    #[arg(long, value_enum, value_delimiter = ',', default_value = "mixed")]
    pub preset: Vec<Preset>,
    /// Cases per preset
    #[arg(long = "count", visible_alias = "n", value_name = "COUNT", default_value_t = 200)]
    pub n: usize,
    /// Seed of the random draws
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Vehicle documents, used in turn; several with commas
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
    #[arg(long, value_name = "S", default_value_t = 90.0)]
    pub duration_s: f64,
    /// Folder of the results; a bench that was stopped is resumed there
    #[arg(long, value_name = "DIR", default_value = "runs/blind")]
    pub out: PathBuf,
    /// Number of parallel processes [default: 1]
    #[arg(long, value_name = "COUNT")]
    jobs: Option<usize>,
    /// Keep the generated logs
    #[arg(long)]
    keep_logs: bool,
    /// Another diagnosis: a command line with {log} and {vehicle} that prints an answer as JSON (docs/blind-bench.md)
    #[arg(long, value_name = "COMMAND")]
    diagnosis: Option<String>,
    /// Do only these cases, counted over all presets, without scoring them; 'rotortwin blind merge' does that
    #[arg(long, value_name = "FIRST..END", value_parser = output::range)]
    cases: Option<Range<u64>>,
    /// Print the score as JSON
    #[arg(long)]
    pub json: bool,
    /// With --json: print each case as a JSON line when it is done; end when standard input is closed
    #[arg(long, requires = "json")]
    events: bool,
}

impl BenchArgs {
    /// An option not available with a server.
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

    fn job(&self) -> rotortwin_jobs::BlindBench {
        rotortwin_jobs::BlindBench {
            presets: self.preset.clone(),
            n: self.n,
            seed: self.seed,
            vehicles: self.vehicles.iter().map(|path| path.display().to_string()).collect(),
            duration_s: self.duration_s,
            out: self.out.clone(),
            cases: self.cases.clone(),
            processes: self.jobs.and_then(NonZeroUsize::new),
            keep_logs: self.keep_logs,
        }
    }

    /// The request.
    ///
    /// # Errors
    /// It cannot be run.
    pub fn request(&self) -> Result<Request, BlindError> {
        runner::request(&self.job())
    }
}

impl Args {
    /// The requested bench; `None` for the generator.
    pub fn bench(&self) -> Option<&BenchArgs> {
        self.command.is_none().then_some(&self.bench)
    }
}

/// Runs the bench or the generator.
pub fn run(args: &Args) -> ExitCode {
    let result = match &args.command {
        Some(Sub::Generate(generate)) => return self::generate(generate),
        Some(Sub::Effects { json }) => return command::run(&command::Command::Effects { json: *json }),
        Some(Sub::Merge { folders, out, json }) => merge(folders, out, *json),
        None => bench(&args.bench),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if matches!(error.downcast_ref(), Some(BlindError::Input { .. })) => output::bad_input(error),
        Err(error) if matches!(error.downcast_ref(), Some(Failure::Input(_))) => output::bad_input(error),
        Err(error) => output::failed(error),
    }
}

/// The generator only accepts files.
fn generate(args: &command::GenerateArgs) -> ExitCode {
    let mut args = args.clone();
    let vehicle = args.vehicle.unwrap_or_else(|| PathBuf::from("f550"));
    match resolved(Kind::Vehicle, vehicle.as_os_str()) {
        Ok(path) => args.vehicle = Some(path),
        Err(error) => return output::bad_input(error),
    }
    match command::generate(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error @ BlindError::Input { .. }) => output::bad_input(error),
        Err(error) => output::told(&Failure::writing(&args.out, error)),
    }
}

/// Faults are evaluated by the detectors, one flight after another, with a separate score sheet.
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
    // On standard error, so that --json does not need it hidden.
    let bar = progress_bar(false, cases.len() as u64, bench.present(&cases) as u64);
    let rows = bench.run(&cases, &mut |row| {
        let end = row.end.map_or("no verdict", End::words);
        bar.set_message(format!("{} → {end}", row.case.class.words()));
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    let sheets = faults_sheet::sum_up(&rows);
    faults_sheet::write(&bench.folder, bench.seed, &rows, &sheets)?;
    if args.json {
        println!("{:#}", serde_json::to_value(&sheets)?);
    } else {
        print!("{}", output::fitted(&faults_sheet::text(&sheets)));
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
    let prepared = runner::prepare(&args.job(), args.diagnosis.as_deref())?;
    let bar = progress_bar(args.events, prepared.wanted() as u64, prepared.present() as u64);
    let lines = args.events.then(Lines::new);
    let done = prepared.run(&|event| {
        if let JobEvent::Case(case) = event {
            bar.set_message(format!("{} → {}", case.truth, case.named));
            bar.inc(1);
        }
        if let Some(lines) = &lines {
            lines.tell(event);
        }
    });
    bar.finish_and_clear();
    match done? {
        Benched::Part(done) if args.json => output::line(&serde_json::to_string(&done)?),
        Benched::Part(done) => output::line(&format!(
            "{} of {} cases; rows in {}",
            done.rows,
            done.cases,
            args.out.display()
        )),
        Benched::Whole(sheet) if args.json => println!("{:#}", serde_json::to_value(&sheet)?),
        Benched::Whole(sheet) => print_text(&sheet, &args.out),
    }
    Ok(())
}

fn merge(folders: &[PathBuf], out: &Path, json: bool) -> anyhow::Result<()> {
    let merged = merge::merge(folders, out)?;
    match merged.sheet {
        Some(sheet) if json => println!("{:#}", serde_json::to_value(&sheet)?),
        Some(sheet) => print_text(&sheet, out),
        None => {
            return Err(anyhow::anyhow!(
                "{} of {} cases are missing: {}; do them with --cases and merge again",
                merged.missing.len(),
                merged.cases,
                output::ranges(&merged.missing)
            ));
        }
    }
    Ok(())
}

/// A progress bar over cases, the first `present` of which already exist.
pub fn progress_bar(hidden: bool, cases: u64, present: u64) -> ProgressBar {
    resumed_bar("{bar:30} {pos}/{len}  {elapsed}, {left}  {msg}", hidden, cases, present)
}

/// The score sheet, and the path of the report.
pub fn print_text(sheet: &Sheet, folder: &Path) {
    print!("{}", output::fitted(&sheet::text(sheet)));
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
}
