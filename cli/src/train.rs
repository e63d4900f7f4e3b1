//! `rotortwin train`: a classifier, trained on this machine or in parts on several.

use crate::output;
use crate::reproduce::Common;
use clap::{Args as ClapArgs, Parser, Subcommand, ValueEnum};
use rotortwin_jobs::training::{Hyperparameters, Method, Rule};
use rotortwin_runner::failure::Failure;
use rotortwin_runner::training;
use rotortwin_scenario::Classifier;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin train`.
#[derive(Debug, Parser)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Sub>,
    #[command(flatten)]
    train: TrainArgs,
}

#[derive(Debug, Subcommand)]
enum Sub {
    /// Make the classifier file from networks trained elsewhere (--networks): equal to that of one machine, byte for byte
    Merge(MergeArgs),
}

/// Arguments of `rotortwin train merge`.
#[derive(Debug, ClapArgs)]
struct MergeArgs {
    /// Folders with networks of the training, in any order; a network may be in several
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Classifier file to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print the result as JSON, nothing else
    #[arg(long)]
    json: bool,
}

/// What is trained.
#[derive(Debug, ClapArgs)]
pub struct TrainArgs {
    /// Classifier file to write; with --networks a folder
    #[arg(long, value_name = "FILE", required = true)]
    out: Option<PathBuf>,
    /// Train only these of the 1 + 4 SEEDS networks, FIRST..END, into the folder --out; 'rotortwin train merge' makes the classifier file
    #[arg(long, value_name = "FIRST..END", value_parser = output::range)]
    networks: Option<Range<u64>>,
    /// Method: inputs and training of the network
    #[arg(long, value_enum, default_value_t = MethodArg::Paper)]
    method: MethodArg,
    #[command(flatten)]
    common: Common,
    /// Number of epochs [default: 5; improved: 30]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=10_000), help_heading = "Training")]
    epochs: Option<u32>,
    /// Hidden neurons, at most three per rotor [default: three per rotor]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=48), help_heading = "Training")]
    hidden: Option<u32>,
    /// Update rule of the weights [default: sgdm; improved: adam]
    #[arg(long, value_enum, value_name = "RULE", help_heading = "Training")]
    optimiser: Option<RuleArg>,
    /// Learning rate, above 0; with adam the initial one [default: 0.001; improved: 0.003]
    #[arg(long, value_name = "RATE", help_heading = "Training")]
    learning_rate: Option<f64>,
    /// Momentum of sgdm, from 0 to below 1 [default: 0.9]
    #[arg(long, value_name = "SHARE", help_heading = "Training")]
    momentum: Option<f64>,
    /// Weight decay, 0 to 1 [default: 0.0001; improved: 0]
    #[arg(long, value_name = "FACTOR", help_heading = "Training")]
    l2: Option<f64>,
    /// Windows per mini-batch [default: 32]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=10_000), help_heading = "Training")]
    batch: Option<u32>,
    /// Seed of split, initial weights and order of the windows [default: that of the data set]
    #[arg(long, value_name = "SEED", value_parser = clap::value_parser!(u64).range(..1 << 53), help_heading = "Training")]
    seed: Option<u64>,
}

/// Update rule on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum RuleArg {
    /// Stochastic gradient descent with momentum
    Sgdm,
    /// Adam; its learning rate falls to 0 as a half cosine
    Adam,
}

/// A training request to a server.
pub struct TrainRequest<'a> {
    /// Classifier file to write here.
    pub out: &'a Path,
    /// Inputs and training of the network.
    pub method: Method,
    /// The server must have the same scenario.
    pub scenario: &'a Path,
    /// Data sets.
    pub seeds: u16,
    /// First seed.
    pub first_seed: u64,
    /// What is trained otherwise than the method says.
    pub hyperparameters: Hyperparameters,
    /// Print JSON.
    pub json: bool,
}

impl Args {
    /// The training; `None` for a merge.
    pub fn training(&self) -> Option<&TrainArgs> {
        self.command.is_none().then_some(&self.train)
    }
}

impl TrainArgs {
    fn job(&self) -> rotortwin_jobs::Training {
        rotortwin_jobs::Training {
            method: self.method.asked(),
            scenario: self.common.scenario.clone(),
            seeds: u32::from(self.common.seeds),
            first_seed: self.common.first_seed,
            out: self.out().to_owned(),
            threads: self.common.threads,
            hyperparameters: self.hyperparameters(),
        }
    }

    /// Empty with a subcommand, which does not use it.
    fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new(""))
    }

    fn hyperparameters(&self) -> Hyperparameters {
        Hyperparameters {
            epochs: self.epochs,
            hidden: self.hidden,
            optimiser: self.optimiser.map(|rule| match rule {
                RuleArg::Sgdm => Rule::Sgdm,
                RuleArg::Adam => Rule::Adam,
            }),
            learning_rate: self.learning_rate,
            momentum: self.momentum,
            l2: self.l2,
            batch: self.batch,
            seed: self.seed,
        }
    }

    /// The corresponding request to a server.
    ///
    /// # Errors
    /// An option that a server does not support.
    pub fn request(&self) -> Result<TrainRequest<'_>, String> {
        for (given, option) in [
            (self.common.threads.is_some(), "--jobs"),
            (self.networks.is_some(), "--networks"),
        ] {
            if given {
                return Err(format!(
                    "{option} applies to training on this machine only; leave it out with --server"
                ));
            }
        }
        Ok(TrainRequest {
            out: self.out(),
            method: self.method.asked(),
            scenario: &self.common.scenario,
            seeds: self.common.seeds,
            first_seed: self.common.first_seed,
            hyperparameters: self.hyperparameters(),
            json: self.common.json,
        })
    }
}

/// A network that can be a classifier file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum MethodArg {
    /// §5.2 and Table 5; for scenarios with nominal_thrust = "static"
    Paper,
    /// Rotor lag in the residuals, self-calibrated, Adam; for scenarios with nominal_thrust = "lagged"
    Improved,
}

impl MethodArg {
    fn asked(self) -> Method {
        match self {
            Self::Paper => Method::Paper,
            Self::Improved => Method::Improved,
        }
    }
}

/// Trains a classifier or some of its networks, or merges these; 0: done, 1: failed, 2: bad input.
pub fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    let done = match (&args.command, &args.train.networks) {
        (Some(Sub::Merge(args)), _) => merge(args),
        (None, Some(networks)) => train_networks(&args.train, networks),
        (None, None) => train(&args.train),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => output::told(&failure),
    }
}

fn train(args: &TrainArgs) -> Result<(), Failure> {
    let job = args.job();
    let prepared = training::prepare(&job)?;
    let bar = args.common.progress(prepared.parts());
    let trained = prepared.train(&|| bar.inc(1));
    bar.finish_and_clear();
    print_trained(&trained?, args.out(), args.common.json);
    Ok(())
}

fn train_networks(args: &TrainArgs, networks: &Range<u64>) -> Result<(), Failure> {
    let job = args.job();
    let prepared = training::prepare_networks(&job, networks)?;
    let bar = args.common.progress(prepared.parts());
    let trained = prepared.train(&|| bar.inc(1));
    bar.finish_and_clear();
    trained?;
    let count = networks.end - networks.start;
    if args.common.json {
        output::line(&serde_json::json!({ "networks": count, "folder": args.out() }).to_string());
    } else {
        output::line(&format!("{count} networks in {}", args.out().display()));
    }
    Ok(())
}

fn merge(args: &MergeArgs) -> Result<(), Failure> {
    let merged = training::merge(&args.folders, &args.out)?;
    match merged.classifier {
        Some(classifier) => {
            print_trained(&classifier, &args.out, args.json);
            Ok(())
        }
        None => Err(Failure::failed(format!(
            "{} of {} networks are missing: {}; train them with --networks and merge again",
            merged.missing.len(),
            merged.networks,
            output::ranges(&merged.missing)
        ))),
    }
}

/// Prints a summary of the trained classifier.
pub fn print_trained(classifier: &Classifier, out: &Path, json: bool) {
    let provenance = &classifier.provenance;
    let cross_validation = &provenance.cross_validation;
    if json {
        println!("{:#}", training::json(classifier, out));
        return;
    }
    println!("{}", out.display());
    println!(
        "{}: {} rotors, nominal_thrust = \"{}\"{}",
        classifier.name,
        classifier.inputs.rotor_count,
        classifier.inputs.nominal_thrust.as_str(),
        if classifier.inputs.self_calibrated {
            ", self-calibrated"
        } else {
            ""
        }
    );
    println!(
        "{}",
        output::fitted(&format!(
            "trained on {:.2} %, held back {:.2} % right; trajectories not seen: {:.2} % (std {:.2} over folds; 95 % interval ± {:.2} over {} seeds)",
            100.0 * provenance.training_accuracy,
            100.0 * provenance.validation_accuracy,
            100.0 * cross_validation.test_mean,
            100.0 * cross_validation.test_deviation_over_folds,
            100.0 * cross_validation.test_interval_over_seeds,
            cross_validation.seeds.len()
        ))
    );
}
