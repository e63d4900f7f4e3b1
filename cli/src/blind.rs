//! `rotortwin blind`: the blind bench, and its generator by hand.

use crate::output;
use clap::{Args as ClapArgs, Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use rotortwin_blind::bench::cases::Preset;
use rotortwin_blind::bench::product::{read_diagnosis, read_either};
use rotortwin_blind::bench::run::{Bench, DiagnosisCommand, Request};
use rotortwin_blind::bench::{report, sheet};
use rotortwin_blind::command;
use rotortwin_blind::error::BlindError;
use rotortwin_blind::vehicle::Vehicle;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin blind`.
#[derive(Debug, Parser)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct Args {
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

#[derive(Debug, ClapArgs)]
struct BenchArgs {
    /// What to show; several with commas
    #[arg(long, value_enum, value_delimiter = ',', default_value = "mixed")]
    preset: Vec<Preset>,
    /// Cases of each preset
    #[arg(long, default_value_t = 200)]
    n: usize,
    /// Seed of the draws
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Vehicle documents, taken in turn; several with commas
    #[arg(long, value_delimiter = ',', default_value = "config/vehicles/f550.toml")]
    vehicles: Vec<PathBuf>,
    /// Length of a flight, s
    #[arg(long, default_value_t = 90.0)]
    duration_s: f64,
    /// Folder of the results; a bench that was stopped goes on there
    #[arg(long, default_value = "runs/blind")]
    out: PathBuf,
    /// Processes at a time
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// Keep the generated logs
    #[arg(long)]
    keep_logs: bool,
    /// Another diagnosis: a command line with {log} and {vehicle} that prints an answer as JSON (docs/blind-bench.md)
    #[arg(long, value_name = "COMMAND")]
    diagnosis: Option<String>,
    /// Print the score as JSON
    #[arg(long)]
    json: bool,
}

/// Runs the bench or the generator.
pub(crate) fn run(args: &Args) -> ExitCode {
    let result = match &args.command {
        Some(Sub::Generate(generate)) => return command::run(&command::Command::Generate(generate.clone())),
        Some(Sub::Effects { json }) => return command::run(&command::Command::Effects { json: *json }),
        None => bench(&args.bench),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if matches!(error.downcast_ref(), Some(BlindError::Input { .. })) => output::bad_input(error),
        Err(error) => output::failed(error),
    }
}

fn bench(args: &BenchArgs) -> anyhow::Result<()> {
    let rotor_counts = args
        .vehicles
        .iter()
        .map(|path| Vehicle::load(path).map(|vehicle| vehicle.rotors.len()))
        .collect::<Result<Vec<_>, _>>()?;
    let request = Request {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        presets: args.preset.clone(),
        n: args.n,
        seed: args.seed,
        vehicles: args.vehicles.iter().map(|path| path.display().to_string()).collect(),
        duration_s: args.duration_s,
    };
    let program = std::env::current_exe()?.display().to_string();
    let bench = Bench {
        folder: args.out.clone(),
        generator: [&program, "blind", "generate"].map(str::to_owned).to_vec(),
        jobs: args.jobs,
        keep_logs: args.keep_logs,
        request,
    };
    let diagnosis = match &args.diagnosis {
        Some(line) => DiagnosisCommand {
            command: line.split_whitespace().map(str::to_owned).collect(),
            read: read_either,
        },
        None => DiagnosisCommand {
            command: [&program, "diagnose", "{log}", "--model", "{vehicle}", "--json"]
                .map(str::to_owned)
                .to_vec(),
            read: read_diagnosis,
        },
    };
    bench.open()?;
    let cases = bench.request.cases(&rotor_counts);
    let bar = ProgressBar::new(cases.len() as u64).with_style(
        ProgressStyle::with_template("{bar:30} {pos}/{len}  {elapsed} of {duration}  {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar()),
    );
    bar.set_position(bench.rows(&cases).len() as u64);
    let rows = bench.run(&cases, &diagnosis, &|row| {
        bar.set_message(format!("{} → {}", row.truth, row.named));
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    let sheet = sheet::sum_up(&rows);
    report::write(&bench.folder, &bench.request, &rows, &sheet)?;
    if args.json {
        println!("{:#}", serde_json::to_value(&sheet)?);
    } else {
        print!("{}", sheet::text(&sheet));
        println!("Report: {}", bench.folder.join("report.html").display());
    }
    Ok(())
}
