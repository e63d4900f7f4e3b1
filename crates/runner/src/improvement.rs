//! Compare, diagnose, propose, add and compare again, until the model agrees or the reason for the disagreement is
//! known.

use crate::Tell;
use crate::destination::{self, ResultFolder, write_text};
use crate::diagnosis::{PLUS_MINUS, TIME_LIMIT_S, share_done};
use crate::failure::Failure;
use crate::grid::Grid;
use crate::logs::{read_logs_for, refused};
use crate::next_flight;
use crate::versions::find_or_begin;
use rotortwin_jobs::Improvement as Job;
use rotortwin_twin::compare::NamedModel;
use rotortwin_twin::diagnose::{Diagnosis, Finding, Options};
use rotortwin_twin::improve::report::{QUANTITIES, open_loop_m, short, value_text};
use rotortwin_twin::improve::truth::truth;
use rotortwin_twin::improve::{
    Guide, ImproveError, Improvement, OnLog, ParameterValue, Request, Row, improve as search, report,
};
use rotortwin_twin::log::RotorOrder;
use rotortwin_twin::model::{ModelStore, ModelVersion};
use std::time::Instant;

/// An improvement of a model, with its text form.
#[derive(Debug)]
pub struct Improved {
    /// The result.
    pub improvement: Improvement,
    /// Human-readable: the waterfall, and why it ended.
    pub text: String,
}

/// Confirms each step.
pub trait Companion {
    /// A version was compared with the flights. `false`: stop.
    ///
    /// # Errors
    /// No confirmation is possible.
    fn compared(&mut self, row: &Row) -> Result<bool, String>;

    /// `next` has one more effect. `false`: stop.
    ///
    /// # Errors
    /// No confirmation is possible.
    fn proposed(&mut self, next: &ModelVersion, finding: &Finding, diagnosis: &Diagnosis) -> Result<bool, String>;

    /// The version was stored under this name.
    fn added(&mut self, label: &str);
}

/// Confirms every step without asking.
#[derive(Debug)]
pub struct Always;

impl Companion for Always {
    fn compared(&mut self, _: &Row) -> Result<bool, String> {
        Ok(true)
    }

    fn proposed(&mut self, _: &ModelVersion, _: &Finding, _: &Diagnosis) -> Result<bool, String> {
        Ok(true)
    }

    fn added(&mut self, _: &str) {}
}

/// Improves a model step by step; accepted versions are stored in the folder of the models.
///
/// # Errors
/// The model or a log cannot be used, no confirmation is possible, or a file cannot be written.
pub fn improve(job: &Job, companion: &mut impl Companion, tell: Tell<'_>) -> Result<Improved, Failure> {
    let store = ModelStore::new(&job.models);
    let (version, branch) = find_or_begin(&store, &job.model)?;
    // Before the logs: reading those of an hour takes seconds.
    job.final_version
        .as_deref()
        .map_or(Ok(()), destination::writable_file)
        .map_err(Failure::input)?;
    let folder = ResultFolder::beside(job.out.as_deref(), &job.models).map_err(Failure::input)?;
    let logs = read_logs_for(&job.logs, &version.vehicle)?;
    let held_out = read_logs_for(&job.held_out, &version.vehicle)?;
    refused(&logs, &version.vehicle)?;
    refused(&held_out, &version.vehicle)?;
    let oracle = job.truth.as_deref().map(|path| truth(path, &version)).transpose();
    let oracle = oracle.map_err(Failure::input)?;
    let number = store.head(&version.name, &branch)?;
    let label = format!("{}@v{number}", version.name);
    let base = format!("{label}, hash {}", version.hash());
    let model = NamedModel { label, version };
    let start = Instant::now();
    let options = Options {
        progress: &|text, share| tell(&share_done(text, share)),
        clock: &|| start.elapsed().as_secs_f64(),
        time_limit_s: f64::from(job.time_limit_s.unwrap_or(TIME_LIMIT_S)),
        ..Options::default()
    };
    let request = Request {
        model: &model,
        fitted: &logs,
        held_out: &held_out,
        oracle: oracle.as_ref(),
    };
    let mut keeper = Keeper {
        store: &store,
        branch: &branch,
        companion,
    };
    let mut improvement = search(&request, &options, &mut keeper).map_err(|error| match error {
        ImproveError::Input(error) => Failure::input(error),
        ImproveError::Guide(sentence) => Failure::Failed(sentence),
    })?;
    if let Some(diagnosis) = &improvement.diagnosis {
        improvement.next_flight = next_flight::after(diagnosis, &improvement.model);
    }
    let head = improvement.last();
    let last = format!("{}, hash {}", head.version, head.hash);
    let mut text = text(&improvement);
    text += &if last == base {
        format!("Model        {base}\n")
    } else {
        format!("Model        {last}; based on {base}\n")
    };
    for log in logs.iter().chain(&held_out) {
        if let RotorOrder::Vehicle(note) = &log.report.rotor_order {
            text += &format!("Note         {note}\n");
        }
    }
    folder.map(ResultFolder::keep);
    if let Some(path) = &job.out {
        report::write(path, &improvement)
            .and_then(|()| write_text(&path.join("improvement.txt"), &text))
            .map_err(|sentence| Failure::writing(path, sentence))?;
    }
    if let Some(path) = &job.final_version {
        write_text(path, &improvement.model.to_toml()).map_err(|sentence| Failure::writing(path, sentence))?;
    }
    Ok(Improved { improvement, text })
}

/// As printed.
pub fn json(improvement: &Improvement) -> String {
    serde_json::to_string_pretty(improvement).expect("text and numbers are JSON")
}

/// Stores accepted versions.
struct Keeper<'a, C> {
    store: &'a ModelStore,
    branch: &'a str,
    companion: &'a mut C,
}

impl<C: Companion> Guide for Keeper<'_, C> {
    fn compared(&mut self, row: &Row) -> Result<bool, String> {
        self.companion.compared(row)
    }

    fn proposed(
        &mut self,
        before: &ModelVersion,
        next: &ModelVersion,
        finding: &Finding,
        diagnosis: &Diagnosis,
    ) -> Result<Option<String>, String> {
        if !self.companion.proposed(next, finding, diagnosis)? {
            return Ok(None);
        }
        let mut kept = next.clone();
        kept.parent = Some(before.hash());
        let place = self
            .store
            .append(self.branch, &kept)
            .map_err(|error| error.to_string())?;
        let label = format!("{}@v{}", place.model, place.number);
        self.companion.added(&label);
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
    text += &format!("Errors are means over 0.1 s; {PLUS_MINUS}; open loop: position error after 1 s\n\n");
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
        let values: Vec<String> = row.parameters.iter().map(|p: &ParameterValue| value_text(p)).collect();
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
