//! `rotortwin model`: versions of a model as files: list, show, add, undo, branch, diff, export, import, log.

use crate::output::{self, fitted};
use clap::{Parser, Subcommand};
use rotortwin_runner::grid::Grid;
use rotortwin_runner::text::significant;
use rotortwin_runner::versions::{Head, model_and_branch};
use rotortwin_scenario::effect_documents;
use rotortwin_twin::Z95;
use rotortwin_twin::improve::from_diagnosis::{self, Addition};
use rotortwin_twin::model::difference::{ParameterChange, Value};
use rotortwin_twin::model::specification::effect_by_hand;
use rotortwin_twin::model::store::{Found, Place};
use rotortwin_twin::model::{Difference, ModelEffect, ModelStore, ModelVersion, Source, StoreError};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin model`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models", global = true)]
    models: PathBuf,
    #[command(subcommand)]
    command: Command,
}

/// A model is named MODEL, MODEL@BRANCH, MODEL@v2, or by the path of a version or vehicle file.
#[derive(Debug, Subcommand)]
enum Command {
    /// Print the models and their branches
    List,
    /// Print a version: vehicle, effects, where they come from
    Show {
        /// MODEL, MODEL@BRANCH, MODEL@v2, or a file
        model: String,
        /// Print the version as JSON, nothing else
        #[arg(long)]
        json: bool,
    },
    /// Print the versions of a model, oldest first, and the version of each branch
    Log {
        /// MODEL
        model: String,
    },
    /// Make the next version: with one more effect, or with new values for an existing one
    Add(Add),
    /// Move a branch back to the previous version; no file is deleted
    Undo {
        /// MODEL or MODEL@BRANCH
        model: String,
    },
    /// Create a branch
    Branch {
        /// MODEL, MODEL@BRANCH or MODEL@v2: where the branch begins
        model: String,
        /// Name of the branch
        name: String,
    },
    /// Print what changed between two versions
    Diff {
        /// Earlier version
        before: String,
        /// Later version
        after: String,
        /// Print the changes as JSON, nothing else
        #[arg(long)]
        json: bool,
    },
    /// Write a version as one self-contained file
    Export {
        /// MODEL, MODEL@BRANCH, MODEL@v2
        model: String,
        /// File to write; must not exist [default: standard output]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Fly a model's effects with detectors that know them, and with detectors that do not
    Detectors(crate::fdi_models::Args),
    /// Import a vehicle or version file as version 0 of a new model
    Import {
        /// The file
        #[arg(value_parser = crate::named::vehicle())]
        file: PathBuf,
        /// Name of the model [default: the one in the file, or the file's]
        #[arg(long)]
        name: Option<String>,
    },
}

#[derive(Debug, Parser)]
struct Add {
    /// MODEL or MODEL@BRANCH; a vehicle file starts a model with its name
    model: String,
    /// Effect of the catalogue, such as rotor-drag
    #[arg(required_unless_present = "from")]
    effect: Option<String>,
    /// Its parameters: name=value, or name=value±half of its 95 % interval
    #[arg(value_name = "PARAM=VALUE[±HALF]")]
    parameters: Vec<String>,
    /// Add the effects that a diagnosis found, from the JSON of 'rotortwin diagnose --json'
    #[arg(long, value_name = "FILE", conflicts_with_all = ["effect", "rotor", "onset"])]
    from: Option<PathBuf>,
    /// Only this one of the effects, from 1
    #[arg(long, value_name = "NUMBER", requires = "from")]
    pick: Option<usize>,
    /// Add what a diagnosis proposes for an error that the catalogue does not explain
    #[arg(long, requires = "from", conflicts_with = "pick")]
    proposal: bool,
    /// Effect document of your own, for EFFECT; the model keeps it
    #[arg(long, value_name = "FILE", conflicts_with = "from", value_parser = crate::named::effect())]
    effects: Vec<PathBuf>,
    /// Rotor, from 1, of an effect of one rotor
    #[arg(long, value_name = "N")]
    rotor: Option<usize>,
    /// When the effect begins, s of the flight
    #[arg(long, value_name = "S")]
    onset: Option<f64>,
    /// Reason, as a note for readers
    #[arg(long, value_name = "TEXT", default_value = "")]
    note: String,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    let store = ModelStore::new(&args.models);
    let done = match &args.command {
        Command::List => list(&store),
        Command::Show { model, json } => store.find(model).map(|found| show(&found, *json)),
        Command::Log { model } => log(&store, model),
        Command::Add(add) => add.run(&store),
        Command::Undo { model } => undo(&store, model),
        Command::Branch { model, name } => branch(&store, model, name),
        Command::Diff { before, after, json } => diff(&store, before, after, *json),
        Command::Export { model, out } => export(&store, model, out.as_deref()),
        Command::Detectors(args) => return crate::fdi_models::run(&store, args),
        Command::Import { file, name } => import(&store, file, name.as_deref()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => output::told(&error.into()),
    }
}

fn list(store: &ModelStore) -> Result<(), StoreError> {
    let names = store.names()?;
    if names.is_empty() {
        println!(
            "{}",
            fitted(&format!(
                "no models in {}; create one with 'rotortwin model import VEHICLE', a file or a name that 'rotortwin list vehicles' shows",
                store.root().display()
            ))
        );
        return Ok(());
    }
    let mut table = Grid::new(["model", "branch", "at", "vehicle", "effects"]);
    for name in names {
        let history = store.history(&name)?;
        for (branch, number) in &history.branches {
            let version = &history.versions[number];
            table.add_row([
                name.clone(),
                branch.clone(),
                format!("v{number}"),
                version.vehicle.name.clone(),
                effects(version),
            ]);
        }
    }
    println!("{table}");
    Ok(())
}

fn effects(version: &ModelVersion) -> String {
    match version.effect.as_slice() {
        [] => "none".to_owned(),
        effects => effects.iter().map(ModelEffect::label).collect::<Vec<_>>().join(", "),
    }
}

fn show(found: &Found, json: bool) {
    let version = &found.version;
    if json {
        let text = serde_json::json!({ "version": found.label(), "hash": version.hash(), "model": version });
        println!("{text:#}");
        return;
    }
    output::say(format!(
        "{} · {} · hash {}",
        found.label(),
        version.vehicle.name,
        version.hash()
    ));
    if !version.note.is_empty() {
        output::say(&version.note);
    }
    if version.effect.is_empty() {
        println!("no effects: the vehicle as documented");
        return;
    }
    let mut table = Grid::new(["effect", "parameter", "value", "± 95 %", "from"]);
    for effect in &version.effect {
        for (line, (name, value)) in effect.parameters.iter().enumerate() {
            let deviation = effect
                .deviations
                .get(name)
                .map_or_else(|| "–".to_owned(), |d| significant(Z95 * d));
            let (label, from) = if line == 0 {
                (effect.label(), source(effect))
            } else {
                (String::new(), String::new())
            };
            table.add_row([label, name.clone(), significant(*value), deviation, from]);
        }
    }
    println!("{table}");
}

/// Provenance of an effect, as a clause.
fn source(effect: &ModelEffect) -> String {
    let provenance = &effect.provenance;
    match provenance.source {
        Source::ByHand => "by hand".to_owned(),
        Source::Diagnosis => {
            let logs = provenance
                .log
                .iter()
                .map(|log| log.name.as_str())
                .collect::<Vec<_>>()
                .join(", ");
            match provenance.ln_bayes_factor {
                Some(evidence) => format!("diagnosis of {logs}, ln BF {evidence:.0}"),
                None => format!("diagnosis of {logs}"),
            }
        }
    }
}

fn log(store: &ModelStore, model: &str) -> Result<(), StoreError> {
    let history = store.history(model)?;
    let mut table = Grid::new(["version", "from", "branches", "added or changed", "note", "hash"]);
    for (number, version) in &history.versions {
        let parent = history.parent_of(*number);
        let branches: Vec<&str> = history
            .branches
            .iter()
            .filter(|(_, at)| *at == number)
            .map(|(name, _)| name.as_str())
            .collect();
        let change = match parent {
            None => version.vehicle.name.clone(),
            Some(parent) => changed_terms(&Difference::between(&history.versions[&parent], version)),
        };
        let from = parent.map_or_else(|| "–".to_owned(), |parent| format!("v{parent}"));
        table.add_row([
            format!("v{number}"),
            from,
            branches.join(", "),
            change,
            version.note.clone(),
            version.hash()[..8].to_owned(),
        ]);
    }
    println!("{table}");
    Ok(())
}

fn changed_terms(difference: &Difference) -> String {
    let mut terms: Vec<&str> = difference
        .parameters
        .iter()
        .map(|change| change.effect.as_str())
        .collect();
    terms.dedup();
    let mut terms: Vec<String> = terms.into_iter().map(str::to_owned).collect();
    terms.extend(difference.keys.iter().map(|change| change.key.clone()));
    if terms.is_empty() {
        "nothing".to_owned()
    } else {
        terms.join(", ")
    }
}

impl Add {
    fn run(&self, store: &ModelStore) -> Result<(), StoreError> {
        let head = Head::find(store, &self.model)?;
        let found = self.effects(&head.line(store)?)?;
        let next = found.onto(&head.version, self.note.clone());
        // Before anything is created, so that a rejection leaves nothing behind.
        ModelStore::check(&next)?;
        if head.version.has_all_of(&next) {
            return Err(StoreError::Refused(format!(
                "{} has all of this already: nothing is added",
                self.model
            )));
        }
        head.begin(store)?;
        let place = store.append(&head.branch, &next)?;
        announce(&head.version, &next, &place);
        Ok(())
    }

    /// What the command line gives, or a diagnosis. `line` contains the versions up to the one that it is added to.
    fn effects(&self, line: &[ModelVersion]) -> Result<Addition, StoreError> {
        let Some(path) = &self.from else {
            let documents = self
                .effects
                .iter()
                .map(effect_documents::load)
                .collect::<Result<Vec<_>, _>>()?;
            let effect = self.effect.as_deref().unwrap_or_default();
            return effect_by_hand(effect, self.rotor, self.onset, &self.parameters)
                .map(|effect| Addition::of_one(effect, documents))
                .map_err(StoreError::Refused);
        };
        let refuse = |reason: String| StoreError::Refused(format!("{}: {reason}", path.display()));
        let text =
            std::fs::read_to_string(path).map_err(|error| refuse(format!("expected a readable file: {error}")))?;
        let json = serde_json::from_str(&text).map_err(|error| refuse(format!("expected JSON: {error}")))?;
        from_diagnosis::check_base(&json, line).map_err(refuse)?;
        if self.proposal {
            return Addition::proposed(&json).map_err(refuse);
        }
        let found = Addition::found(&json, line).map_err(refuse)?;
        if found.is_empty() {
            return Err(refuse("this diagnosis found no missing physics to add".into()));
        }
        match self.pick {
            None => Ok(found),
            Some(number) => found.picked(number, "--pick").map_err(refuse),
        }
    }
}

/// Prints the differences of a new version from the previous one.
pub(crate) fn announce(before: &ModelVersion, after: &ModelVersion, place: &Place) {
    output::say(format!("{}@v{} · hash {}", place.model, place.number, after.hash()));
    print_changes(&Difference::between(before, after));
}

fn print_changes(difference: &Difference) {
    if difference.is_empty() {
        println!("no difference");
        return;
    }
    let text = |value: Option<Value>| match value {
        None => "–".to_owned(),
        Some(Value { value, deviation: None }) => significant(value),
        Some(Value {
            value,
            deviation: Some(d),
        }) => format!("{} ± {}", significant(value), significant(Z95 * d)),
    };
    let mut table = Grid::new(["what", "key", "before", "after, ± 95 %"]);
    for ParameterChange {
        effect,
        parameter,
        before,
        after,
    } in &difference.parameters
    {
        table.add_row([effect.clone(), parameter.clone(), text(*before), text(*after)]);
    }
    let absent = || "–".to_owned();
    for change in &difference.keys {
        let [before, after] = [&change.before, &change.after].map(|v| v.clone().unwrap_or_else(absent));
        // Keys of the vehicle are paths.
        let what = if change.key.contains('.') { "vehicle" } else { "flights" };
        table.add_row([what.to_owned(), change.key.clone(), before, after]);
    }
    println!("{table}");
}

fn undo(store: &ModelStore, text: &str) -> Result<(), StoreError> {
    let (model, branch) = model_and_branch(text);
    let (left, reached) = store.undo(model, branch)?;
    println!(
        "{}",
        fitted(&format!(
            "{model}@{branch} is now at v{reached}; v{left} is kept: 'rotortwin model branch {model}@v{left} NAME' makes a branch of it"
        ))
    );
    Ok(())
}

fn branch(store: &ModelStore, text: &str, name: &str) -> Result<(), StoreError> {
    let found = store.find(text)?;
    let Some(place) = found.place else {
        return Err(StoreError::Refused(format!(
            "{text}: expected a version of a model in {}, got a file",
            store.root().display()
        )));
    };
    store.branch(&place.model, name, place.number)?;
    println!("{}@{name} is at v{}", place.model, place.number);
    Ok(())
}

fn diff(store: &ModelStore, before: &str, after: &str, json: bool) -> Result<(), StoreError> {
    let (before, after) = (store.find(before)?, store.find(after)?);
    let difference = Difference::between(&before.version, &after.version);
    if json {
        println!(
            "{}",
            serde_json::to_string_pretty(&difference).expect("text and numbers are JSON")
        );
    } else {
        println!("{} → {}", before.label(), after.label());
        print_changes(&difference);
    }
    Ok(())
}

fn export(store: &ModelStore, text: &str, out: Option<&Path>) -> Result<(), StoreError> {
    let found = store.find(text)?;
    let toml = found.version.to_toml();
    let Some(path) = out else {
        print!("{toml}");
        return Ok(());
    };
    let write = || -> std::io::Result<()> {
        use std::io::Write as _;
        std::fs::File::create_new(path)?.write_all(toml.as_bytes())
    };
    match write() {
        Ok(()) => {
            println!("{} → {}", found.label(), path.display());
            Ok(())
        }
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => Err(StoreError::Refused(format!(
            "{}: expected a file that does not exist yet",
            path.display()
        ))),
        Err(source) => Err(StoreError::Io {
            action: "writing",
            path: path.to_owned(),
            source,
        }),
    }
}

fn import(store: &ModelStore, file: &Path, name: Option<&str>) -> Result<(), StoreError> {
    let mut version = ModelVersion::load(file)?;
    if let Some(name) = name {
        version.name = name.to_owned();
    }
    let place = store.create(&version)?;
    println!(
        "{}",
        fitted(&format!(
            "{}@v{} · {} · effects: {} · hash {}",
            place.model,
            place.number,
            version.vehicle.name,
            effects(&version),
            version.hash()
        ))
    );
    Ok(())
}
