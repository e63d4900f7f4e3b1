//! `rotortwin --server URL fly`: flown on the server; progress and files appear here.

use super::events::Event;
use super::http::{Ask, Remote};
use super::{RemoteError, fetch, task, with_server};
use rotortwin_cli::fly::{self, Args, LinkKind, PaceArg, Screen};
use rotortwin_cli::network::remote::ServerArgs;
use rotortwin_cli::output;
use rotortwin_jobs::QueueEvent;
use rotortwin_jobs::flight::{Controller, Link, Pace};
use rotortwin_jobs::submission::{ModelChoice, RunSubmission, ScenarioToCheck};
use rotortwin_scenario::{Documents, Scenario};
use rotortwin_store::run_folder::RunFolder;
use rotortwin_store::summary::load_summary;
use serde_json::Value;
use std::process::ExitCode;

/// Runs the command.
pub(crate) fn run(server: &ServerArgs, args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    if let Some(option) = only_here(args) {
        return output::bad_input(format!(
            "{option} belongs to flights on this machine; expected it without --server"
        ));
    }
    let models = match Models::of(args) {
        Ok(models) => models,
        Err(sentence) => return output::bad_input(sentence),
    };
    // What is wrong here is said without a server.
    let here = match theirs(&args.scenario.to_string_lossy()) {
        Some(_) if args.documents => {
            return output::bad_input("--documents belongs to a file; expected @NAME without it");
        }
        Some(_) => None,
        None => match loaded(args, &models) {
            Ok(scenario) => Some(scenario),
            Err(code) => return code,
        },
    };
    with_server(server, async |remote| {
        let scenario = match here {
            Some(scenario) => scenario,
            None => of_server(remote, args).await?,
        };
        let seed = args.seed.unwrap_or_else(|| scenario.seed());
        scenario
            .simulation(seed)
            .map_err(|error| RemoteError::BadInput(error.to_string()))?;
        for warning in scenario.warnings() {
            eprintln!("{}: {warning}", args.scenario.display());
        }
        let folder = fly::run_folder(args, scenario.name(), seed).map_err(RemoteError::BadInput)?;
        let screen = Screen::new(args.json, args.events);
        let flight = Flight {
            args,
            models: &models,
            folder: &folder,
            screen: &screen,
        };
        let code = flight.fly(remote, &scenario, seed).await;
        screen.close();
        // For a run that has left nothing; otherwise the folder is not empty, and stays.
        if std::fs::read_dir(folder.path()).is_ok_and(|mut entries| entries.next().is_none())
            && let Err(error) = folder.discard()
        {
            tracing::warn!(%error, "an empty folder stays");
        }
        code
    })
}

/// `@NAME` is a document of the server's library.
fn theirs(text: &str) -> Option<&str> {
    text.strip_prefix('@').filter(|name| !name.is_empty())
}

/// Models of the server that replace those of the scenario.
struct Models {
    model: Option<String>,
    fdi_model: Option<String>,
}

impl Models {
    /// # Errors
    /// One model is of the server, the other of this machine.
    fn of(args: &Args) -> Result<Self, String> {
        let own = |text: &Option<String>| text.as_deref().and_then(theirs).map(str::to_owned);
        let models = Self {
            model: own(&args.model),
            fdi_model: own(&args.fdi_model),
        };
        let here = |given: &Option<String>, there: &Option<String>| given.is_some() && there.is_none();
        let mixes = here(&args.model, &models.model) || here(&args.fdi_model, &models.fdi_model);
        if mixes && (models.are_there() || theirs(&args.scenario.to_string_lossy()).is_some()) {
            return Err(
                "a flight of the server's documents (@NAME) takes no model of this machine; expected the models with @, too, or nothing with @"
                    .to_owned(),
            );
        }
        Ok(models)
    }

    fn are_there(&self) -> bool {
        self.model.is_some() || self.fdi_model.is_some()
    }
}

/// The scenario of this machine, with its models.
fn loaded(args: &Args, models: &Models) -> Result<Scenario, ExitCode> {
    let scenario = fly::load(args).map_err(output::bad_input)?;
    if models.are_there() {
        Ok(scenario)
    } else {
        fly::with_models(scenario, args)
    }
}

/// The scenario of the server's library, with the keys that are set.
async fn of_server(remote: &Remote, args: &Args) -> Result<Scenario, RemoteError> {
    let text = args.scenario.to_string_lossy();
    let name = theirs(&text).unwrap_or_default();
    let asked = ScenarioToCheck {
        scenario: Some(name.to_owned()),
        text: None,
        set: args.set.clone(),
    };
    let ask = Ask::post("/api/v1/scenarios/validate").json(&asked)?;
    let found = remote.json(&ask).await?;
    if found["valid"] != true {
        return Err(RemoteError::BadInput(format!(
            "{text}: {}",
            fetch::text(&found, "refusal")
        )));
    }
    Documents::from_toml("the server's settings", fetch::text(&found, "effective"))
        .and_then(|documents| Scenario::from_documents(&documents))
        .map_err(|error| RemoteError::Failed(format!("the server's settings are of another version: {error}")))
}

/// An option that applies to flights on this machine only.
fn only_here(args: &Args) -> Option<&'static str> {
    let options = [
        (args.listen.is_some(), "--listen"),
        (args.connect.is_some(), "--connect"),
        (args.domain.is_some(), "--domain"),
        (!args.external.is_empty(), "--external"),
        (args.join_timeout.is_some(), "--join-timeout"),
        (args.cpu.is_some(), "--cpu"),
        (args.priority.is_some(), "--priority"),
        (args.controller.is_some(), "--controller"),
        (args.mavlink.is_some(), "--mavlink"),
        (args.foxglove.is_some(), "--foxglove"),
    ];
    options.into_iter().find_map(|(given, name)| given.then_some(name))
}

struct Flight<'a> {
    args: &'a Args,
    models: &'a Models,
    folder: &'a RunFolder,
    screen: &'a Screen,
}

impl Flight<'_> {
    async fn fly(&self, remote: &Remote, scenario: &Scenario, seed: u64) -> Result<ExitCode, RemoteError> {
        let body = self.submission(scenario, seed);
        let run = remote.json(&Ask::post("/api/v1/runs").json(&body)?.once()).await?;
        let id = fetch::text(&run, "id").to_owned();
        self.screen.line(&format!("run {id} of {}", remote.url()));
        let path = format!("/api/v1/runs/{id}");
        let watched = task::watch(remote, &path, &|line| self.screen.line(line), &mut |event| {
            self.show(event)
        })
        .await;
        let fetched = match watched {
            Ok(()) => self.fetch(remote, &path).await,
            Err(error) => Err(error),
        };
        fetched.map_err(|error| match error {
            RemoteError::BadInput(sentence) | RemoteError::Failed(sentence) => RemoteError::Failed(format!(
                "{sentence}; run {id} continues on the server: 'rotortwin --server {} runs fetch {id}' gets it",
                remote.url()
            )),
        })
    }

    fn submission(&self, scenario: &Scenario, seed: u64) -> RunSubmission {
        let body = RunSubmission {
            documents: Some(scenario.documents().to_toml()),
            model: self.models.model.clone().map(ModelChoice::of_server),
            fdi_model: self.models.fdi_model.clone().map(ModelChoice::of_server),
            seed: Some(seed),
            ..RunSubmission::default()
        };
        match &self.args.autopilot {
            // Link and pace are those of the server.
            Some(name) => RunSubmission {
                controller: Controller::Autopilot(name.clone()),
                ..body
            },
            None => RunSubmission {
                link: match self.args.link {
                    LinkKind::InProcess => Link::InProcess,
                    LinkKind::Iceoryx2 => Link::Iceoryx2,
                    LinkKind::Zenoh => Link::Zenoh,
                },
                pace: match self.args.pace {
                    PaceArg::Fast => Pace::Fast,
                    PaceArg::RealTime => Pace::RealTime,
                },
                ..body
            },
        }
    }

    fn show(&self, event: &Event) {
        match serde_json::from_value(event.data.clone()) {
            Ok(known) => self.screen.show(&known),
            Err(_) => {
                if let Some(QueueEvent::Requeued { why }) = event.of_queue() {
                    self.screen.line(&format!("the server restarts the flight: {why}"));
                }
            }
        }
    }

    /// The files, and their summary.
    async fn fetch(&self, remote: &Remote, path: &str) -> Result<ExitCode, RemoteError> {
        let run = remote.json(&Ask::get(path)).await?;
        let files = fetch::everything(remote, path, self.folder.path()).await?;
        self.screen.close();
        let Ok(summary) = load_summary(self.folder.path()) else {
            return Ok(output::failed(unfinished(&run, files)));
        };
        if self.args.json {
            print!("{}", summary.to_json());
        } else if !self.args.events {
            print!("{}", output::summary_text(&summary, Some(self.folder.path())));
        }
        Ok(output::exit_code(&summary))
    }
}

/// Report on a run without a summary.
fn unfinished(run: &Value, files: usize) -> String {
    let why = run["error"]
        .as_str()
        .map(|error| format!(": {error}"))
        .unwrap_or_default();
    let left = if files == 0 {
        ""
    } else {
        "; its files hold no further detail"
    };
    format!("the run ended as {}{why}{left}", fetch::text(run, "status"))
}
