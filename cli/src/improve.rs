//! `rotortwin improve`: compare, diagnose, propose, add and compare again, until the model agrees or the reason for the disagreement
//! is known.

use crate::output;
use crate::progress::Progress;
use clap::Parser;
use rotortwin_runner::diagnosis::TIME_LIMIT_S;
use rotortwin_runner::improvement::{self, Companion};
use rotortwin_runner::text::significant;
use rotortwin_twin::Z95;
use rotortwin_twin::diagnose::{Diagnosis, Finding};
use rotortwin_twin::improve::Row;
use rotortwin_twin::improve::report::{QUANTITIES, short};
use rotortwin_twin::model::{ModelEffect, ModelVersion};
use std::io::{BufRead as _, IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin improve`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Flight logs of one vehicle to learn from, of any source, or run folders; LOG@35:65 takes only these seconds
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Model to improve: MODEL or MODEL@BRANCH; a vehicle file starts a model with its name
    #[arg(long, value_name = "MODEL")]
    pub model: String,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    pub models: PathBuf,
    /// Held-out logs of the same vehicle, not used in any fit
    #[arg(long, value_name = "LOG", num_args = 1..)]
    pub held_out: Vec<PathBuf>,
    /// Accept every step without asking
    #[arg(long)]
    pub yes: bool,
    /// What is actually missing, if known: a model version, a file with `[[effect]]`, or the truth of 'rotortwin blind generate'
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// Write report.html, improvement.json and improvement.txt into this folder; must not exist or be empty
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Write the final version into this file, as 'rotortwin model export' does
    #[arg(long = "final", value_name = "FILE")]
    pub final_version: Option<PathBuf>,
    /// Time limit of each search for a missing effect, s; it then continues with what has been proved so far
    #[arg(long, value_name = "S", default_value_t = TIME_LIMIT_S, value_parser = clap::value_parser!(u32).range(1..=86_400))]
    pub time_limit: u32,
    /// Print the result as JSON, nothing else; needs --yes
    #[arg(long, requires = "yes")]
    pub json: bool,
    /// Print the progress as JSON lines on standard output
    #[arg(long, hide = true)]
    events: bool,
}

impl Args {
    fn job(&self) -> rotortwin_jobs::Improvement {
        rotortwin_jobs::Improvement {
            logs: self.logs.clone(),
            held_out: self.held_out.clone(),
            model: self.model.clone(),
            models: self.models.clone(),
            truth: self.truth.clone(),
            out: self.out.clone(),
            final_version: self.final_version.clone(),
            time_limit_s: Some(self.time_limit),
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> ExitCode {
    if !args.yes && !std::io::stdin().is_terminal() {
        return output::bad_input("this command asks before each step and its input is not a terminal: expected --yes");
    }
    let progress = Progress::new(args.json, args.events);
    let mut terminal = Terminal {
        ask: !args.yes,
        quiet: args.json,
        progress: &progress,
    };
    let done = improvement::improve(&args.job(), &mut terminal, &|event| progress.tell(event));
    progress.clear();
    let done = match done {
        Ok(done) => done,
        Err(failure) => return output::told(&failure),
    };
    if args.json {
        println!("{}", improvement::json(&done.improvement));
    } else {
        print!("{}", output::fitted(&done.text));
        if let Some(folder) = &args.out {
            println!("Files        {}", folder.display());
            println!("             report.html  improvement.json  improvement.txt");
        }
    }
    ExitCode::SUCCESS
}

/// Asks for confirmation at the terminal.
struct Terminal<'a> {
    ask: bool,
    quiet: bool,
    progress: &'a Progress,
}

impl Terminal<'_> {
    fn say(&self, text: &str) {
        self.progress.clear();
        if !self.quiet {
            println!("{}", output::fitted(text));
        }
    }

    fn yes(&self, question: &str) -> Result<bool, String> {
        if !self.ask {
            return Ok(true);
        }
        print!("{question} [Y/n] ");
        let mut answer = String::new();
        std::io::stdout()
            .flush()
            .and_then(|()| std::io::stdin().lock().read_line(&mut answer))
            .map_err(|error| format!("cannot ask at the terminal: {error}"))?;
        // End of input is not consent.
        Ok(!answer.is_empty() && matches!(answer.trim().to_lowercase().as_str(), "" | "y" | "yes"))
    }
}

impl Companion for Terminal<'_> {
    fn compared(&mut self, row: &Row) -> Result<bool, String> {
        for log in &row.logs {
            let role = if log.held_out { " (held out)" } else { "" };
            let errors: Vec<String> = log
                .errors
                .iter()
                .filter(|e| QUANTITIES.contains(&e.quantity))
                .map(|e| {
                    format!(
                        "{} {} {} (noise {})",
                        e.quantity,
                        short(e.error),
                        e.unit,
                        short(e.noise)
                    )
                })
                .collect();
            self.say(&format!("{} on {}{role}: {}", row.version, log.log, errors.join(", ")));
        }
        for remark in &row.remarks {
            self.say(&format!("Note         {remark}"));
        }
        self.yes("Look for what is missing?")
    }

    fn proposed(&mut self, next: &ModelVersion, finding: &Finding, diagnosis: &Diagnosis) -> Result<bool, String> {
        self.say(&format!("\n{}", diagnosis.sentence));
        let same = |e: &&ModelEffect| e.effect == finding.instance.effect && e.rotor == finding.instance.rotor;
        if let Some(effect) = next.effect.iter().find(same) {
            let values: Vec<String> = effect
                .parameters
                .iter()
                .map(|(name, value)| {
                    let deviation = effect.deviations.get(name).copied().unwrap_or(0.0);
                    format!("{name} = {} ± {}", significant(*value), significant(Z95 * deviation))
                })
                .collect();
            self.say(&format!("Proposed     {}: {}", finding.label, values.join(", ")));
            self.say(&format!("             {}", finding.equation));
        } else {
            self.say(&format!("Proposed     {}", finding.label));
        }
        self.yes("Add it?")
    }

    fn added(&mut self, label: &str) {
        self.say(&format!("Added as     {label}\n"));
    }
}
