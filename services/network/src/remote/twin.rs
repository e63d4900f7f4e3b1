//! `rotortwin --server URL compare|diagnose|improve|log import`: the twin's work there, on logs of this machine or of the server.
//!
//! A model is sent as a version with its vehicle, so that the server uses this machine's version. The command's output on the
//! server (`comparison.txt`, …) is printed here.

use super::flights;
use super::http::Remote;
use super::{RemoteError, fetch, task, with_server};
use rotortwin_cli::network::remote::ServerArgs;
use rotortwin_cli::{compare, diagnose, improve, log, output};
use rotortwin_jobs::submission::{ModelChoice, TwinSubmission};
use rotortwin_runner::diagnosis::TIME_LIMIT_S;
use rotortwin_runner::log_import::unique_names;
use rotortwin_runner::versions::find_or_begin;
use rotortwin_twin::model::{ModelStore, ModelVersion};
use std::path::Path;
use std::process::ExitCode;

/// The final version of an improvement, among its files.
const FINAL_MODEL: &str = "model.toml";

fn bad(error: impl std::fmt::Display) -> RemoteError {
    RemoteError::BadInput(error.to_string())
}

/// Compares models with flights.
pub(super) fn compare(server: &ServerArgs, args: &compare::Args) -> ExitCode {
    let store = ModelStore::new(&args.models);
    let mut models = Vec::with_capacity(args.model.len());
    for (place, name) in args.model.iter().enumerate() {
        let found = match store.find(name) {
            Ok(found) => found,
            Err(error) => return output::told(&error.into()),
        };
        models.push(ModelChoice {
            label: Some(args.label.get(place).cloned().unwrap_or_else(|| found.label())),
            ..ModelChoice::of_version(found.version.to_toml())
        });
    }
    let mut models = models.into_iter();
    let Some(model) = models.next() else {
        return output::bad_input("no model is named; expected one after --model");
    };
    with_server(server, async |remote| {
        let flights = flights::named(remote, &args.logs, args.json).await?;
        let body = TwinSubmission {
            model,
            more_models: models.collect(),
            flights,
            ..TwinSubmission::default()
        };
        let done = task::perform(remote, "comparisons", "comparison", &body, args.json).await?;
        done.print(remote, "comparison", args.json, args.out.as_deref()).await
    })
}

/// Names the effect that a model lacks.
pub(super) fn diagnose(server: &ServerArgs, args: &diagnose::Args) -> ExitCode {
    if !args.baseline.is_empty() {
        return output::bad_input("--baseline belongs to diagnoses on this machine; expected it without --server");
    }
    if args.time_limit != TIME_LIMIT_S {
        return output::bad_input("--time-limit belongs to diagnoses on this machine; expected it without --server");
    }
    let found = match ModelStore::new(&args.models).find(&args.model) {
        Ok(found) => found,
        Err(error) => return output::told(&error.into()),
    };
    let read = |path: &std::path::PathBuf| {
        std::fs::read_to_string(path).map_err(|error| format!("{}: cannot be read: {error}", path.display()))
    };
    let effects: Result<Vec<String>, String> = args.effects.iter().map(read).collect();
    let effects = match effects {
        Ok(effects) => effects,
        Err(sentence) => return output::bad_input(sentence),
    };
    with_server(server, async |remote| {
        let flights = flights::named(remote, &args.logs, args.json).await?;
        let body = TwinSubmission {
            model: ModelChoice::of_version(found.version.to_toml()),
            flights,
            effects,
            ..TwinSubmission::default()
        };
        let done = task::perform(remote, "diagnoses", "diagnosis", &body, args.json).await?;
        done.print(remote, "diagnosis", args.json, args.out.as_deref()).await
    })
}

/// Improves a model; its versions are stored here, as if they were found here.
pub(super) fn improve(server: &ServerArgs, args: &improve::Args) -> ExitCode {
    if !args.yes {
        return output::bad_input("a server cannot ask before each step: expected --yes");
    }
    if args.truth.is_some() {
        return output::bad_input("--truth belongs to improvements on this machine; expected it without --server");
    }
    if args.time_limit != TIME_LIMIT_S {
        return output::bad_input("--time-limit belongs to improvements on this machine; expected it without --server");
    }
    let store = ModelStore::new(&args.models);
    let (version, branch) = match find_or_begin(&store, &args.model) {
        Ok(found) => found,
        Err(error) => return output::told(&error.into()),
    };
    if version != ModelVersion::first(version.name.clone(), version.documents()) {
        return output::bad_input(format!(
            "{}: a server improves from a vehicle's nominal model only; expected a model without effects, or no --server",
            args.model
        ));
    }
    with_server(server, async |remote| {
        let flights = flights::named(remote, &args.logs, args.json).await?;
        let held_out = match args.held_out.as_slice() {
            [] => None,
            texts => Some(flights::named(remote, texts, args.json).await?),
        };
        let body = TwinSubmission {
            model: ModelChoice::of_version(version.to_toml()),
            flights,
            held_out,
            ..TwinSubmission::default()
        };
        let done = task::perform(remote, "improvements", "improvement", &body, args.json).await?;
        let kept = keep(remote, &done, &store, &version, &branch).await?;
        if !args.json {
            for label in kept {
                output::line(&format!("Added as     {label}"));
            }
        }
        if let Some(path) = &args.final_version {
            let text = done.text(remote, FINAL_MODEL).await?;
            std::fs::write(path, text)
                .map_err(|error| RemoteError::Failed(format!("{}: cannot be written: {error}", path.display())))?;
        }
        done.print(remote, "improvement", args.json, args.out.as_deref()).await
    })
}

/// Stores the versions after `version` on this machine; returns their labels.
async fn keep(
    remote: &Remote,
    done: &task::Done,
    store: &ModelStore,
    version: &ModelVersion,
    branch: &str,
) -> Result<Vec<String>, RemoteError> {
    let told = |error: &dyn std::fmt::Display| RemoteError::Failed(format!("the versions cannot be kept: {error}"));
    let files = fetch::names(remote, &done.path).await?;
    let (mut labels, mut parent) = (Vec::new(), version.hash());
    // Version 0 is the one that was sent.
    for number in 1.. {
        let name = format!("models/{}/v{number}.toml", version.name);
        if !files.contains(&name) {
            break;
        }
        let text = done.text(remote, &name).await?;
        let next = ModelVersion::parse("the server's version", &text, Path::new("")).map_err(|error| told(&error))?;
        if next.parent.as_deref() != Some(parent.as_str()) {
            return Err(RemoteError::Failed(format!(
                "version {number} of the server does not follow from the one before; no further version was kept"
            )));
        }
        let place = store.append(branch, &next).map_err(|error| told(&error))?;
        labels.push(format!("{}@v{}", place.model, place.number));
        parent = next.hash();
    }
    Ok(labels)
}

/// Imports logs on the server, and downloads them in canonical form.
pub(super) fn log(server: &ServerArgs, args: &log::Args) -> ExitCode {
    let log::Command::Import(args) = &args.command else {
        return output::bad_input("log show reads a file on this machine; leave out --server, or use log import");
    };
    if let Some(option) = args.only_here() {
        return output::bad_input(format!(
            "{option} belongs to imports on this machine; expected it without --server"
        ));
    }
    with_server(server, async |remote| {
        let mut code = ExitCode::SUCCESS;
        for (file, name) in args.files.iter().zip(unique_names(&args.files)) {
            match import(remote, args, file, &name).await {
                Ok(()) => {}
                Err(RemoteError::BadInput(sentence)) => code = output::bad_input(sentence),
                Err(error) => return Err(error),
            }
        }
        Ok(code)
    })
}

async fn import(remote: &Remote, args: &log::ImportArgs, file: &Path, name: &str) -> Result<(), RemoteError> {
    if file.is_dir() {
        return Err(bad(format!(
            "{}: a run folder is imported on this machine; expected a file, or no --server",
            file.display()
        )));
    }
    if file.with_extension("toml").exists() {
        return Err(bad(format!(
            "{}: a log with a side file is imported on this machine; expected a file alone, or no --server",
            file.display()
        )));
    }
    let targets = ["parquet", "toml", "import.json"].map(|ending| args.out.join(format!("{name}.{ending}")));
    if let Some(there) = targets.iter().find(|path| path.exists()) {
        return Err(bad(format!(
            "{}: already exists; name another folder with --out, or remove it",
            there.display()
        )));
    }
    let bytes = std::fs::read(file).map_err(|error| bad(format!("{}: cannot be read: {error}", file.display())))?;
    let done = flights::import(remote, &flights::upload_name(file, None), bytes, &args.query(), false).await?;
    for (ending, target) in ["parquet", "toml", "import.json"].into_iter().zip(&targets) {
        fetch::file(remote, &format!("{}/artifacts/log.{ending}", done.path), target).await?;
    }
    let result = &done.job["result"];
    let headline = result["headline"].as_str().unwrap_or("log");
    let headline = headline.strip_prefix("log").unwrap_or(headline);
    output::line(&format!("{name}{headline} → {}", targets[0].display()));
    let text = if args.quiet {
        let findings = result["report"]["findings"].as_array().into_iter().flatten();
        findings
            .map(|finding| format!("  {}: {}", fetch::text(finding, "kind"), fetch::text(finding, "detail")))
            .collect::<Vec<_>>()
            .join("\n")
    } else {
        fetch::text(result, "account").trim_end().to_owned()
    };
    if !text.is_empty() {
        output::line(&text);
    }
    Ok(())
}
