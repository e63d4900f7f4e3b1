//! Diagnosis: which physical effect a model lacks.

use crate::Tell;
use crate::destination::ResultFolder;
use crate::failure::Failure;
use crate::grid::Grid;
use crate::logs::{own_baseline, read_logs_for, refused};
use crate::next_flight;
use rotortwin_jobs::{Diagnosis as Job, JobEvent, Progress};
use rotortwin_page::Report;
use rotortwin_plant::effects::EffectDocument;
use rotortwin_scenario::{ConfigError, effect_documents};
use rotortwin_twin::baseline::Trim;
use rotortwin_twin::compare::NamedModel;
use rotortwin_twin::diagnose::{Diagnosis, Finding, NotConsidered, Options, Verdict, diagnose as search, in_sentence};
use rotortwin_twin::estimation::parameters::FittedParameter;
use rotortwin_twin::improve::from_diagnosis::Addition;
use rotortwin_twin::improve::report::quantity;
use rotortwin_twin::model::{ModelStore, ModelVersion};
use rotortwin_twin::over_time::OverTime;
use std::path::Path;
use std::time::Instant;

/// Number of reported rows of the ranking.
const RANKING_ROWS: usize = 8;
/// Default time limit after which a search starts nothing new, s.
pub const TIME_LIMIT_S: u32 = 600;
/// Effect document of a proposal.
pub const PROPOSAL_FILE: &str = "proposed-effect.toml";
/// What a `±` is, in all that the programs print.
pub(crate) const PLUS_MINUS: &str = "± is half of a 95 % interval";

/// A diagnosis, with its text form if needed.
#[derive(Debug)]
pub struct Diagnosed {
    /// The result.
    pub diagnosis: Diagnosis,
    /// Human-readable, with advice on what to fly next if the diagnosis is undecided.
    pub text: String,
}

/// Identifies the effects that a model lacks; the result is also written to the job's folder.
///
/// * `advise`: simulate manoeuvres to determine what to fly next; always done if there is a folder
///
/// # Errors
/// The model, a log or an effect document cannot be used, or the folder cannot be written.
pub fn diagnose(job: &Job, advise: bool, tell: Tell<'_>) -> Result<Diagnosed, Failure> {
    let start = Instant::now();
    let found = ModelStore::new(&job.models).find(&job.model)?;
    // Before the logs: reading those of an hour takes seconds.
    let folder = ResultFolder::of_option(job.out.as_ref()).map_err(Failure::input)?;
    let logs = read_logs_for(&job.logs, &found.version.vehicle)?;
    refused(&logs, &found.version.vehicle)?;
    let baseline = read_logs_for(&job.baseline, &found.version.vehicle)?;
    refused(&baseline, &found.version.vehicle)?;
    own_baseline(&logs, &baseline)?;
    let effects: Result<Vec<EffectDocument>, ConfigError> = job.effects.iter().map(effect_documents::load).collect();
    let effects = effects.map_err(Failure::input)?;
    let options = Options {
        effects,
        baseline,
        progress: &|text, share| tell(&share_done(text, share)),
        clock: &|| start.elapsed().as_secs_f64(),
        time_limit_s: f64::from(job.time_limit_s.unwrap_or(TIME_LIMIT_S)),
        ..Options::default()
    };
    let diagnosis = search(&logs, &found.version, &options).map_err(Failure::input)?;
    // A file has the same name wherever it lies.
    let model = if found.place.is_some() {
        found.label()
    } else {
        diagnosis.model.name.clone()
    };
    let mut text = text(&diagnosis, &model);
    if (folder.is_some() || advise)
        && let Some(advice) = next_flight::after(&diagnosis, &found.version)
    {
        text += &format!("Next flight  {advice}\n");
    }
    if let Some(folder) = folder.map(ResultFolder::keep) {
        let over_time = OverTime::of(&logs, &compared_models(&found.label(), &found.version, &diagnosis));
        write(folder.path(), &text, &diagnosis, &over_time)
            .map_err(|sentence| Failure::writing(folder.path(), sentence))?;
    }
    Ok(Diagnosed { diagnosis, text })
}

/// Progress of a search.
pub(crate) fn share_done(text: &str, share: f64) -> JobEvent {
    JobEvent::Progress(Progress::Share {
        share,
        text: text.to_owned(),
    })
}

/// As printed and stored.
pub fn json(diagnosis: &Diagnosis) -> String {
    serde_json::to_string_pretty(diagnosis).expect("text and numbers are JSON")
}

/// The effect document of a proposal, if the error is outside the catalogue.
pub fn proposed(diagnosis: &Diagnosis) -> Option<&EffectDocument> {
    diagnosis.proposal.as_ref()?.document.as_ref()
}

/// The diagnosed model and, if something was found, the model including it: for the plots of a report.
fn compared_models(label: &str, version: &ModelVersion, diagnosis: &Diagnosis) -> Vec<NamedModel> {
    let mut models = vec![NamedModel {
        label: label.to_owned(),
        version: version.clone(),
    }];
    let json = serde_json::to_value(diagnosis).unwrap_or_default();
    let found = Addition::found(&json, std::slice::from_ref(version)).unwrap_or_default();
    if !found.is_empty() {
        models.push(NamedModel {
            label: format!("{label} with what was found"),
            version: found.onto(version, "what a diagnosis found"),
        });
    }
    models
}

fn write(folder: &Path, text: &str, diagnosis: &Diagnosis, over_time: &OverTime) -> Result<(), String> {
    let file = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|error| format!("cannot write {}: {error}", path.display()))
    };
    file("diagnosis.json", &format!("{}\n", json(diagnosis)))?;
    file("diagnosis.txt", text)?;
    file("report.html", &report(text, diagnosis, over_time))?;
    match proposed(diagnosis) {
        Some(document) => file(PROPOSAL_FILE, &rotortwin_twin::propose::to_toml(document)),
        None => Ok(()),
    }
}

/// Embedded data of a diagnosis page.
#[derive(serde::Serialize)]
struct Inside<'a> {
    diagnosis: &'a Diagnosis,
    over_time: &'a OverTime,
}

/// The diagnosis on a page.
fn report(text: &str, diagnosis: &Diagnosis, over_time: &OverTime) -> String {
    let page = Report {
        kind: "diagnosis",
        title: &format!("Diagnosis · {}", diagnosis.logs.join(", ")),
        summary: text,
        program: rotortwin_twin::model::TOOL,
        data: &Inside { diagnosis, over_time },
    };
    page.render().expect("text and numbers are JSON")
}

fn parameter(p: &FittedParameter) -> String {
    quantity(&p.symbol, p.value, p.interval_95, &p.unit)
}

fn parameters(list: &[FittedParameter]) -> String {
    list.iter().map(parameter).collect::<Vec<_>>().join(", ")
}

fn finding(found: &Finding) -> String {
    let mut text = format!("{}: {}\n", found.label, parameters(&found.parameters));
    text += &format!("             {}\n             {}\n", found.equation, found.reason);
    for rival in &found.also_compatible {
        text += &format!(
            "             also compatible: {} (ln BF {:.1} behind)\n",
            rival.label, rival.evidence_gap
        );
    }
    for rival in &found.lost {
        text += &format!("             not {}: {}\n", in_sentence(&rival.label), rival.reason);
    }
    text
}

/// Changes relative to healthy flights.
fn trim(trim: &Trim) -> String {
    let changes: Vec<String> = trim
        .thrust_change
        .iter()
        .map(|x| format!("{:+.1}", 100.0 * x))
        .collect();
    let mut seen = trim.smallest_loss.map_or_else(
        || "no loss of one rotor up to 60 % would be named".to_owned(),
        |loss| format!("a loss of {:.0} % of one rotor would be named", 100.0 * loss),
    );
    let more: Vec<String> = trim
        .with_more
        .iter()
        .filter_map(|more| {
            Some(format!(
                "with {} healthy flights {:.0} %",
                more.flights,
                100.0 * more.smallest_loss?
            ))
        })
        .collect();
    if !more.is_empty() {
        seen += &format!(" ({})", more.join(", "));
    }
    if trim.another_day {
        seen +=
            "; all healthy flights are of one day and this one is of another, so a further 3 % per rotor is allowed";
    }
    let shaken = match (&trim.vibration, &trim.no_vibration) {
        (Some(change), _) => format!("Vibration    {}\n", change.sentence),
        (None, Some(reason)) => format!("Vibration    {reason}\n"),
        (None, None) => String::new(),
    };
    format!(
        "{}\n             thrust command of the rotors over the healthy mean: {} %; healthy flights vary by {:.1} % in common and {:.1} % rotor \
         by rotor; {seen}\n{shaken}\n",
        trim.sentence,
        changes.join(", "),
        100.0 * trim.spread[0],
        100.0 * trim.spread[1]
    )
}

/// Wording for a finding under a verdict: "missing" only if established.
fn called(verdict: &Verdict) -> &'static str {
    match verdict {
        Verdict::Missing { .. } | Verdict::PartlyMissing { .. } => "Missing",
        Verdict::CannotTell { .. } => "One of",
        _ => "Looks like",
    }
}

/// Smallest size that shows, over the plausible one, beyond which the factor tells nothing.
const FAR_TOO_LARGE: f64 = 10.0;

/// The diagnosis for a terminal: the verdict first.
///
/// * `model`: the version that it stands on
fn text(diagnosis: &Diagnosis, model: &str) -> String {
    let mut text = diagnosis.trim.as_ref().map_or_else(String::new, trim);
    // Another method, which may see less or more than the comparison with healthy flights.
    if diagnosis.trim.is_some() {
        text += "Without the healthy flights, against the model alone:\n";
    }
    text += &format!("{}\n", diagnosis.sentence);
    // Told once, where the first one is.
    let is_told = text.contains('±');
    if is_told {
        text += &format!("{PLUS_MINUS}\n");
    }
    text += "\n";
    text += &findings(diagnosis);
    for one in diagnosis.calibrate.iter().filter(|one| !one.blocking) {
        text += &format!("Calibrate    {}\n", one.sentence());
    }
    if let Some(proposal) = &diagnosis.proposal {
        text += &format!("Proposal     {}\n", proposal.sentence());
    }
    text += &held_out(diagnosis);
    let plus_minus = if is_told {
        String::new()
    } else {
        format!("; {PLUS_MINUS}")
    };
    text += &format!(
        "\nRanking about the given model (linear{plus_minus})\n{}\n",
        ranking(diagnosis)
    );
    text += &not_testable(diagnosis);
    text += &not_considered(&diagnosis.not_considered);
    let colour: Vec<&str> = diagnosis.goodness.unexplained.iter().map(String::as_str).collect();
    if !colour.is_empty() {
        text += &format!("Unexplained  {}\n", colour.join(", "));
    }
    for one in &diagnosis.remainder {
        text += &format!("Left over    {}\n", one.sentence);
    }
    for note in &diagnosis.notes {
        text += &format!("Note         {note}\n");
    }
    text += &format!(
        "Model        {model}, hash {}; the findings apply to this model only\n",
        diagnosis.model.hash
    );
    text += &format!(
        "Assumed      the model is right to (95 %): {}; everything else to 4 % of its plausible size; `rotortwin vehicle tolerances` \
         states other values; threshold ln BF {:.0}\n",
        diagnosis.assumed, diagnosis.threshold
    );
    text += &format!(
        "Took         {:.2} s, ranked after {:.2} s\n",
        diagnosis.timing.total_s, diagnosis.timing.ranked_s
    );
    text
}

/// What is missing, and what is wrong with the logs: of all flights together, then of those that stand apart.
fn findings(diagnosis: &Diagnosis) -> String {
    let mut text = String::new();
    let label = called(&diagnosis.verdict);
    for found in &diagnosis.effects {
        text += &format!("{label:13}{}", finding(found));
    }
    for found in &diagnosis.sensor_or_timing {
        text += &format!("Log fault    {}", finding(found));
    }
    for one in &diagnosis.apart {
        let logs = one.logs.join(", ");
        let label = called(&one.verdict);
        for found in &one.effects {
            text += &format!("{label:13}in {logs}: {}", finding(found));
        }
        for found in &one.sensor_or_timing {
            text += &format!("Log fault    in {logs}: {}", finding(found));
        }
    }
    text
}

/// Errors on the parts of the flights that the fit has not seen.
fn held_out(diagnosis: &Diagnosis) -> String {
    let mut text = String::new();
    if !diagnosis.held_out.is_empty() {
        text += "\nFitted on every other 5 s, tested on the rest (means over 0.1 s)\n";
        for error in &diagnosis.held_out {
            text += &format!(
                "  {:8} {:9.2} → {:9.2} m{}, noise alone {:.2}\n",
                error.quantity,
                1e3 * error.before,
                1e3 * error.after,
                error.unit,
                1e3 * error.noise
            );
        }
    }
    text
}

/// The effects that explain most, by themselves.
fn ranking(diagnosis: &Diagnosis) -> Grid {
    let mut table = Grid::new(["effect", "fitted", "ln BF", "held-out chi²"]).numbers([2, 3]);
    for row in diagnosis.ranking.iter().take(RANKING_ROWS) {
        let label = if row.can_be() {
            row.label.clone()
        } else {
            format!("{} (impossible size)", row.label)
        };
        table.add_row([
            label,
            parameters(&row.parameters),
            format!("{:.1}", row.ln_bayes_factor),
            format!("{:+.0}", row.held_out_chi2_change),
        ]);
    }
    table
}

/// Effects that would not show on these flights, with the size that would.
fn not_testable(diagnosis: &Diagnosis) -> String {
    let mut text = String::new();
    if !diagnosis.not_testable.is_empty() {
        text += "Not testable on this flight\n";
        for row in &diagnosis.not_testable {
            let need = match row.minimum_size {
                None => "nothing of it shows".to_owned(),
                // The number would be that of no vehicle.
                Some(size) if size > FAR_TOO_LARGE * row.plausible_size => format!(
                    "nothing of a plausible size ({}) shows by far",
                    format!("{} {}", short(row.plausible_size), row.unit).trim_end()
                ),
                Some(size) => format!(
                    "would need {} (plausible {})",
                    format!("{} {}", short(size), row.unit).trim_end(),
                    short(row.plausible_size)
                ),
            };
            let when = match row.excited_by.strip_prefix("always") {
                Some(rest) => format!("there always{rest}"),
                None => format!("excited by {}", row.excited_by),
            };
            text += &format!("  {}: {} {need}; {when}\n", row.label, row.parameter);
        }
    }
    text
}

/// Effects that could not be considered, grouped by reason.
fn not_considered(all: &[NotConsidered]) -> String {
    let mut reasons: Vec<(&str, Vec<&str>)> = Vec::new();
    for one in all {
        match reasons.iter_mut().find(|(reason, _)| *reason == one.reason) {
            Some((_, labels)) => labels.push(&one.label),
            None => reasons.push((&one.reason, vec![&one.label])),
        }
    }
    let mut text = String::new();
    if !reasons.is_empty() {
        text += "Not considered\n";
    }
    for (reason, labels) in reasons {
        text += &format!("  {}: {reason}\n", labels.join(", "));
    }
    text
}

/// Three significant digits.
fn short(value: f64) -> String {
    let digits = if value == 0.0 {
        0
    } else {
        (2 - value.abs().log10().floor() as i32).clamp(0, 8) as usize
    };
    format!("{value:.digits$}")
}
