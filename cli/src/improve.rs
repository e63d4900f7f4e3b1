//! `rotortwin improve`: compare, diagnose, propose, add, compare again, until the model agrees or the reason why it does not is known.

use crate::compare::{read_logs, refused};
use crate::destination::{self, ResultFolder};
use crate::grid::Grid;
use crate::output::{self, significant};
use crate::progress::Progress;
use crate::versions::{find_or_begin, store_failed};
use clap::Parser;
use rotortwin_twin::compare::NamedModel;
use rotortwin_twin::diagnose::{Diagnosis, Finding, Options};
use rotortwin_twin::improve::report::{QUANTITIES, open_loop_m, short, value_text};
use rotortwin_twin::improve::truth::truth;
use rotortwin_twin::improve::{Guide, ImproveError, Improvement, OnLog, Request, Row, Value, improve, report};
use rotortwin_twin::model::{ModelEffect, ModelStore, ModelVersion};
use std::io::{BufRead as _, IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Arguments of `rotortwin improve`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Flight logs of one vehicle to learn from, of any source, or run folders; LOG@35:65 takes only these seconds
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Model to improve: MODEL or MODEL@BRANCH; a vehicle file begins one of its name
    #[arg(long, value_name = "MODEL")]
    pub model: String,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    pub models: PathBuf,
    /// Logs of the same vehicle that no fit sees, as proof
    #[arg(long, value_name = "LOG", num_args = 1..)]
    pub held_out: Vec<PathBuf>,
    /// Take every step without asking
    #[arg(long)]
    pub yes: bool,
    /// What is really missing, if it is known: a model version, a file with `[[effect]]`, or the truth of 'rotortwin blind generate'
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// Write report.html, improvement.json and improvement.txt into this folder; must not exist or be empty
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Write the final version into this file, as 'rotortwin model export' does
    #[arg(long = "final", value_name = "FILE")]
    pub final_version: Option<PathBuf>,
    /// Print the result as JSON, nothing else; needs --yes
    #[arg(long, requires = "yes")]
    pub json: bool,
    /// Say on standard output, as JSON lines, how far it is
    #[arg(long, hide = true)]
    events: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> ExitCode {
    if !args.yes && !std::io::stdin().is_terminal() {
        return output::bad_input(
            "this command asks before each step and there is nobody at the terminal: expected --yes",
        );
    }
    let logs = match read_logs(&args.logs) {
        Ok(logs) => logs,
        Err(code) => return code,
    };
    let held_out = match read_logs(&args.held_out) {
        Ok(logs) => logs,
        Err(code) => return code,
    };
    let store = ModelStore::new(&args.models);
    let (version, branch) = match find_or_begin(&store, &args.model) {
        Ok(found) => found,
        Err(error) => return store_failed(&error),
    };
    if let Err(code) = refused(&logs, &version.vehicle).and_then(|()| refused(&held_out, &version.vehicle)) {
        return code;
    }
    let oracle = match args.truth.as_deref().map(|path| truth(path, &version)).transpose() {
        Ok(oracle) => oracle,
        Err(sentence) => return output::bad_input(sentence),
    };
    let label = match store.head(&version.name, &branch) {
        Ok(number) => format!("{}@v{number}", version.name),
        Err(error) => return store_failed(&error),
    };
    let model = NamedModel { label, version };
    let (folder, writable) = (
        ResultFolder::beside(args.out.as_deref(), &args.models),
        args.final_version.as_deref().map_or(Ok(()), destination::writable_file),
    );
    let folder = match writable.and(folder) {
        Ok(folder) => folder,
        Err(sentence) => return output::bad_input(sentence),
    };
    let start = Instant::now();
    let progress = Progress::new(args.json, args.events);
    let options = Options {
        progress: &|text, share| progress.tell(text, share),
        clock: &|| start.elapsed().as_secs_f64(),
        ..Options::default()
    };
    let request = Request {
        model: &model,
        fitted: &logs,
        held_out: &held_out,
        oracle: oracle.as_ref(),
    };
    let mut guide = Terminal {
        store: &store,
        branch: &branch,
        ask: !args.yes,
        quiet: args.json,
        progress: &progress,
    };
    let mut improvement = match improve(&request, &options, &mut guide) {
        Ok(improvement) => improvement,
        Err(ImproveError::Input(error)) => return output::bad_input(error),
        Err(ImproveError::Guide(sentence)) => return output::failed(sentence),
    };
    progress.clear();
    if let Some(diagnosis) = &improvement.diagnosis {
        improvement.next_flight = crate::next_flight::after(diagnosis, &improvement.model);
    }
    let text = text(&improvement);
    folder.map(ResultFolder::keep);
    if let Some(path) = &args.out
        && let Err(sentence) =
            report::write(path, &improvement).and_then(|()| output::write_text(&path.join("improvement.txt"), &text))
    {
        return destination::failed_at(path, sentence);
    }
    if let Some(path) = &args.final_version
        && let Err(error) = std::fs::write(path, improvement.model.to_toml())
    {
        return destination::failed_at(path, format!("{}: cannot be written: {error}", path.display()));
    }
    if args.json {
        println!(
            "{}",
            serde_json::to_string_pretty(&improvement).expect("text and numbers are JSON")
        );
    } else {
        print!("{}", output::fitted(&text));
        if let Some(folder) = &args.out {
            println!("Files        {}", folder.display());
            println!("             report.html  improvement.json  improvement.txt");
        }
    }
    ExitCode::SUCCESS
}

/// Asks at the terminal, and keeps accepted versions.
struct Terminal<'a> {
    store: &'a ModelStore,
    branch: &'a str,
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
        // The end of the input is no consent.
        Ok(!answer.is_empty() && matches!(answer.trim().to_lowercase().as_str(), "" | "y" | "yes"))
    }
}

impl Guide for Terminal<'_> {
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

    fn proposed(
        &mut self,
        before: &ModelVersion,
        next: &ModelVersion,
        finding: &Finding,
        diagnosis: &Diagnosis,
    ) -> Result<Option<String>, String> {
        self.say(&format!("\n{}", diagnosis.sentence));
        let same = |e: &&ModelEffect| e.effect == finding.instance.effect && e.rotor == finding.instance.rotor;
        if let Some(effect) = next.effect.iter().find(same) {
            let values: Vec<String> = effect
                .parameters
                .iter()
                .map(|(name, value)| {
                    let deviation = effect.deviations.get(name).copied().unwrap_or(0.0);
                    format!("{name} = {} ± {}", significant(*value), significant(1.96 * deviation))
                })
                .collect();
            self.say(&format!("Proposed     {}: {}", finding.label, values.join(", ")));
            self.say(&format!("             {}", finding.equation));
        }
        if !self.yes("Add it?")? {
            return Ok(None);
        }
        let branch = self.branch.to_owned();
        let parent = before.hash();
        let mut kept = next.clone();
        kept.parent = Some(parent);
        let place = self.store.append(&branch, &kept).map_err(|error| error.to_string())?;
        let label = format!("{}@v{}", place.model, place.number);
        self.say(&format!("Added as     {label}\n"));
        Ok(Some(label))
    }
}

/// The waterfall for a terminal, and why it ended.
fn text(improvement: &Improvement) -> String {
    let mut text = String::new();
    let Some(first) = improvement.rows.first() else {
        return text;
    };
    for (place, log) in first.logs.iter().enumerate() {
        let role = if log.held_out { "held out" } else { "fitted" };
        text += &format!("\n{} ({role})\n{}\n", log.log, waterfall(improvement, place, log));
    }
    text += "Errors are means over 0.1 s; ± is 95 %; open loop: position error after 1 s\n\n";
    text += &format!("{}\n", improvement.reason);
    if let Some(advice) = &improvement.next_flight {
        text += &format!("Next flight  {advice}\n");
    }
    text
}

fn waterfall(improvement: &Improvement, place: usize, first: &OnLog) -> Grid {
    let mut header = vec!["version".to_owned(), "effect".to_owned(), "parameter".to_owned()];
    let quantities: Vec<&str> = QUANTITIES.into_iter().filter(|q| first.error_of(q).is_some()).collect();
    for quantity in &quantities {
        let unit = first.error_of(quantity).map_or("", |e| e.unit);
        header.push(format!("{quantity}, {unit}"));
    }
    header.push("open loop, m".to_owned());
    let mut table = Grid::new(header).numbers_from(3);
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), short);
    for row in &improvement.rows {
        let Some(log) = row.logs.get(place) else { continue };
        let values: Vec<String> = row.parameters.iter().map(|p: &Value| value_text(p)).collect();
        let mut cells = vec![
            row.version.clone(),
            row.added.clone().unwrap_or_default(),
            values.join("\n"),
        ];
        cells.extend(quantities.iter().map(|q| number(log.error_of(q).map(|e| e.error))));
        cells.push(number(open_loop_m(log)));
        table.add_row(cells);
    }
    let mut cells = vec!["noise".to_owned(), String::new(), String::new()];
    cells.extend(quantities.iter().map(|q| number(first.error_of(q).map(|e| e.noise))));
    cells.push(String::new());
    table.add_row(cells);
    table
}
