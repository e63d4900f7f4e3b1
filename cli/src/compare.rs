//! `rotortwin compare`: compares models with flight logs.

use crate::output;
use clap::Parser;
use rotortwin_runner::comparison;
use rotortwin_twin::compare::files;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin compare`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Flight logs of any source, or run folders; LOG@35:65 takes only these seconds, LOG@NAME a segment
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Models to compare with them: MODEL, MODEL@BRANCH, MODEL@v2, or a version or vehicle file
    #[arg(long = "model", required = true, num_args = 1.., value_name = "MODEL")]
    pub model: Vec<String>,
    /// Labels of the models in the result, one for each
    #[arg(long, value_name = "NAME")]
    pub label: Vec<String>,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    pub models: PathBuf,
    /// Write report.html, comparison.json, comparison.txt and residuals of each log as Parquet into this folder; must not exist or be empty
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print the comparison as JSON, nothing else
    #[arg(long)]
    pub json: bool,
}

impl Args {
    fn job(&self) -> rotortwin_jobs::Comparison {
        rotortwin_jobs::Comparison {
            logs: self.logs.clone(),
            model: self.model.clone(),
            label: self.label.clone(),
            models: self.models.clone(),
            out: self.out.clone(),
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> ExitCode {
    let compared = match comparison::compare(&args.job()) {
        Ok(compared) => compared,
        Err(failure) => return output::told(&failure),
    };
    if args.json {
        println!("{}", files::json(&compared.comparison));
    } else {
        print!("{}", output::fitted(&compared.text));
        if let Some(folder) = &args.out {
            println!("Files        {}", folder.display());
            output::say("             report.html  comparison.json  comparison.txt  residuals of each log as Parquet");
        }
    }
    ExitCode::SUCCESS
}
