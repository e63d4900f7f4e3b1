//! `rotortwin diagnose`: which physical effect the model lacks.

use crate::output;
use crate::progress::Progress;
use clap::Parser;
use rotortwin_runner::diagnosis::{self, PROPOSAL_FILE, proposed};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin diagnose`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Flight logs of one vehicle, of any source, or run folders; LOG@35:65 takes only these seconds
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Model to compare with them: MODEL, MODEL@BRANCH, MODEL@v2, or a version or vehicle file
    #[arg(long, value_name = "MODEL")]
    pub model: String,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    pub models: PathBuf,
    /// Effect document of your own to consider as well; may be given several times
    #[arg(long, value_name = "FILE", value_parser = crate::named::effect())]
    pub effects: Vec<PathBuf>,
    /// At least three healthy flights of the same vehicle: reports changes since then, from the commanded thrust of each rotor
    #[arg(long, num_args = 1.., value_name = "LOG")]
    pub baseline: Vec<PathBuf>,
    /// Write report.html, diagnosis.json and diagnosis.txt into this folder, and proposed-effect.toml if the catalogue does not explain the error; must not exist or
    /// be empty
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Time limit of the search, s; it then reports what has been proved so far
    #[arg(long, value_name = "S", default_value_t = diagnosis::TIME_LIMIT_S, value_parser = clap::value_parser!(u32).range(1..=86_400))]
    pub time_limit: u32,
    /// Print the diagnosis as JSON, nothing else
    #[arg(long)]
    pub json: bool,
    /// Print the progress as JSON lines on standard output
    #[arg(long, hide = true)]
    events: bool,
}

impl Args {
    fn job(&self) -> rotortwin_jobs::Diagnosis {
        rotortwin_jobs::Diagnosis {
            logs: self.logs.clone(),
            model: self.model.clone(),
            models: self.models.clone(),
            effects: self.effects.clone(),
            baseline: self.baseline.clone(),
            out: self.out.clone(),
            time_limit_s: Some(self.time_limit),
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> ExitCode {
    let progress = Progress::new(args.json, args.events);
    let done = diagnosis::diagnose(&args.job(), !args.json, &|event| progress.tell(event));
    progress.clear();
    let done = match done {
        Ok(done) => done,
        Err(failure) => return output::told(&failure),
    };
    if args.json {
        println!("{}", diagnosis::json(&done.diagnosis));
    } else {
        print!("{}", output::fitted(&done.text));
        if let Some(folder) = &args.out {
            println!("Files        {}", folder.display());
            println!("             report.html  diagnosis.json  diagnosis.txt");
            if proposed(&done.diagnosis).is_some() {
                println!("             {}", folder.join(PROPOSAL_FILE).display());
                println!(
                    "Try it with  rotortwin model add {} --from {} --proposal",
                    args.model,
                    folder.join("diagnosis.json").display()
                );
            }
        }
    }
    ExitCode::SUCCESS
}
