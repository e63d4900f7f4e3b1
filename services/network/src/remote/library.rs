//! `rotortwin --server URL check|train`: work on a scenario of the server's library.

use super::http::{Ask, Remote};
use super::{RemoteError, fetch, task, with_server};
use rotortwin_cli::network::remote::ServerArgs;
use rotortwin_cli::train;
use rotortwin_cli::{output, show};
use rotortwin_jobs::submission::{ClassifierSubmission, ScenarioToCheck};
use rotortwin_scenario::{Classifier, Documents, Scenario};
use serde_json::Value;
use std::path::Path;
use std::process::ExitCode;

/// The classifier among the files of its job.
const CLASSIFIER: &str = "classifier.json";

/// Checks a scenario with the server's library: its vehicles, blades and classifiers.
pub(super) fn check(server: &ServerArgs, args: &show::CheckArgs) -> ExitCode {
    let text = match std::fs::read_to_string(&args.scenario) {
        Ok(text) => text,
        Err(error) => return output::bad_input(format!("{}: cannot be read: {error}", args.scenario.display())),
    };
    let asked = ScenarioToCheck {
        text: Some(text),
        ..ScenarioToCheck::default()
    };
    with_server(server, async |remote| {
        let ask = Ask::post("/api/v1/scenarios/validate").json(&asked)?;
        let found = remote.json(&ask).await?;
        if found["valid"] != true {
            return Err(RemoteError::BadInput(format!(
                "{}: {}",
                args.scenario.display(),
                fetch::text(&found, "refusal")
            )));
        }
        for warning in found["warnings"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
        {
            eprintln!("{}: {warning}", args.scenario.display());
        }
        let effective = fetch::text(&found, "effective");
        if args.json {
            let failed = |error: &dyn std::fmt::Display| {
                RemoteError::Failed(format!("the server's settings are of another version: {error}"))
            };
            let documents = Documents::from_toml("the server's settings", effective).map_err(|error| failed(&error))?;
            let json = serde_json::to_string_pretty(&documents).map_err(|error| failed(&error))?;
            output::line(&json);
        } else {
            print!("{effective}");
        }
        Ok(ExitCode::SUCCESS)
    })
}

/// Trains a classifier on flights of a scenario of the server, and downloads its file.
pub(super) fn train(server: &ServerArgs, args: &train::Args) -> ExitCode {
    rotortwin_process::start_logging();
    let Some(args) = args.training() else {
        return output::bad_input("merge combines folders on this machine; leave out --server");
    };
    let request = match args.request() {
        Ok(request) => request,
        Err(sentence) => return output::bad_input(sentence),
    };
    with_server(server, async |remote| {
        let body = ClassifierSubmission {
            method: request.method,
            scenario: same_there(remote, request.scenario).await?,
            seeds: u32::from(request.seeds),
            first_seed: request.first_seed,
            hyperparameters: request.hyperparameters,
            priority: 0,
        };
        let done = task::perform(remote, "classifiers", "classifier", &body, request.json).await?;
        fetch::file(remote, &format!("{}/artifacts/{CLASSIFIER}", done.path), request.out).await?;
        let classifier =
            Classifier::read(request.out).map_err(|error| RemoteError::Failed(format!("the server's {error}")))?;
        train::print_trained(&classifier, request.out, request.json);
        Ok(ExitCode::SUCCESS)
    })
}

/// The name of a scenario that is the same here and in the server's library.
async fn same_there(remote: &Remote, path: &Path) -> Result<String, RemoteError> {
    let here = Scenario::load_without_classifier(path).map_err(|error| RemoteError::BadInput(error.to_string()))?;
    let name = path
        .file_stem()
        .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let asked = ScenarioToCheck {
        scenario: Some(name.clone()),
        ..ScenarioToCheck::default()
    };
    let ask = Ask::post("/api/v1/scenarios/validate").json(&asked)?;
    let there = match remote.json(&ask).await {
        Ok(there) => there,
        Err(RemoteError::BadInput(sentence)) => {
            return Err(RemoteError::BadInput(format!(
                "{}: a server trains only on scenarios of its own library: {sentence}",
                path.display()
            )));
        }
        Err(error) => return Err(error),
    };
    let effective = there["effective"].as_str().unwrap_or_default();
    let mut documents = Documents::from_toml("the server's settings", effective)
        .map_err(|error| RemoteError::Failed(format!("the server's scenario {name} cannot be read: {error}")))?;
    let mut own = here.documents().clone();
    // A network to be trained is not read.
    (documents.classifier, own.classifier) = (None, None);
    (documents.scenario.fdi.network, own.scenario.fdi.network) = (None, None);
    if documents.to_toml() != own.to_toml() {
        return Err(RemoteError::BadInput(format!(
            "{}: the server's library has a different scenario {name}; expected identical ones, because a server trains on its own",
            path.display()
        )));
    }
    Ok(name)
}
