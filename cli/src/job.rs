//! `rotortwin job`: one job of any kind, from a file.

use crate::progress::Lines;
use crate::{fly, output, query};
use clap::Parser;
use rotortwin_jobs::flight::{Flight, Link};
use rotortwin_jobs::{FlightHere, Job, JobFile, Question};
use rotortwin_runner::failure::Failure;
use rotortwin_runner::result::perform;
use rotortwin_runner::{flight, question};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin job`.
#[derive(Debug, Parser)]
pub struct Args {
    /// The job as JSON with its version, as a worker writes it: docs/jobs.md
    #[arg(value_name = "FILE")]
    file: PathBuf,
}

/// Instead of a file: a question ([`Question`]) on standard input, as a server asks one.
const STANDARD_INPUT: &str = "-";

impl Args {
    /// True for a flight over zenoh. An unreadable file is rejected later.
    pub(crate) fn is_over_zenoh(&self) -> bool {
        self.file != Path::new(STANDARD_INPUT)
            && matches!(read(&self.file), Ok(JobFile { job: Job::Run(flight), .. }) if flight.link == Link::Zenoh)
    }
}

/// Executes the job: prints events as JSON lines, then its result as JSON. Exit code 0 if completed, 1 if it failed or was stopped, 2 for
/// bad input.
pub(crate) fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    if args.file == Path::new(STANDARD_INPUT) {
        return answer(std::io::stdin());
    }
    let JobFile { job, here } = match read(&args.file) {
        Ok(file) => file,
        Err(failure) => return output::told(&failure),
    };
    if here.until_input_ends {
        fly::end_with_standard_input();
    }
    let done = match job {
        Job::Run(job) => fly_one(&job, &here.flight),
        job => {
            let lines = Lines::new();
            perform(job, &|event| lines.tell(event)).and_then(|result| {
                println!("{}", result.json()?);
                Ok(if result.is_complete() {
                    ExitCode::SUCCESS
                } else {
                    ExitCode::from(rotortwin_process::EXIT_FAILED)
                })
            })
        }
    };
    done.unwrap_or_else(|failure| output::told(&failure))
}

/// Answers the question with JSON.
fn answer(input: impl Read) -> ExitCode {
    let question = match asked(input) {
        Ok(question) => question,
        Err(failure) => return output::told(&failure),
    };
    let answer = match &question {
        Question::Sql(sql) => return query::print_json(sql),
        Question::LogVerdict(logs) => question::log_verdict(logs),
        Question::EffectPicture(effect) => question::effect_picture(effect),
        Question::LogOverTime(log) => question::log_over_time(log),
        Question::CampaignCheck(campaign) => question::campaign_check(campaign),
        Question::MappingDraft(table) => question::mapping_draft(table)
            .and_then(|draft| serde_json::to_string_pretty(&draft).map_err(Failure::failed)),
    };
    match answer {
        Ok(json) => {
            println!("{json}");
            ExitCode::SUCCESS
        }
        Err(failure) => output::told(&failure),
    }
}

fn asked(mut input: impl Read) -> Result<Question, Failure> {
    let bad = |error: &dyn std::fmt::Display| Failure::input(format!("standard input: {error}"));
    let mut text = String::new();
    input.read_to_string(&mut text).map_err(|error| bad(&error))?;
    match Question::parse(&text) {
        Some(question) => {
            question.map_err(|error| bad(&format!("this version does not understand the question: {error}")))
        }
        None => Err(bad(
            &"expected a question as JSON, with the key `question`; a job is given as a file",
        )),
    }
}

fn fly_one(job: &Flight, here: &FlightHere) -> Result<ExitCode, Failure> {
    let folder = std::env::current_dir().map_err(Failure::failed)?;
    let screen = fly::Screen::new(true, true).with_samples(here.live_hz.is_some());
    let flown = flight::perform(job, here, &folder, &|event| screen.tell(event))?;
    print!("{}", flown.summary.to_json());
    Ok(output::exit_code(&flown.summary))
}

fn read(path: &Path) -> Result<JobFile, Failure> {
    let bad = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| bad(&format!("cannot be read: {error}")))?;
    JobFile::parse(&text).map_err(|error| bad(&error))
}
