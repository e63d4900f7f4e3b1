//! `rotortwin --server URL fly`: flown on the server; progress and files appear here.

use super::events::{Event, Follow};
use super::http::{Ask, Remote};
use super::stop::Stop;
use super::{RemoteError, fetch, with_server};
use rotortwin_cli::fly::{self, Args, LinkKind, PaceArg, Screen};
use rotortwin_cli::network::remote::ServerArgs;
use rotortwin_cli::output;
use rotortwin_scenario::Scenario;
use rotortwin_store::run_folder::RunFolder;
use rotortwin_store::summary::load_summary;
use serde_json::{Value, json};
use std::process::ExitCode;

/// Runs the command.
pub(crate) fn run(server: &ServerArgs, args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    if let Some(option) = only_here(args) {
        return output::bad_input(format!(
            "{option} belongs to flights on this machine; expected it without --server"
        ));
    }
    let scenario = match fly::load(args) {
        Ok(scenario) => scenario,
        Err(error) => return output::bad_input(error),
    };
    let scenario = match fly::with_models(scenario, args) {
        Ok(scenario) => scenario,
        Err(code) => return code,
    };
    let seed = args.seed.unwrap_or_else(|| scenario.seed());
    if let Err(error) = scenario.simulation(seed) {
        return output::bad_input(error);
    }
    for warning in scenario.warnings() {
        eprintln!("{}: {warning}", args.scenario.display());
    }
    with_server(server, async |remote| {
        let folder = fly::run_folder(args, scenario.name(), seed).map_err(RemoteError::BadInput)?;
        let screen = Screen::new(args.json, args.events);
        let flight = Flight {
            args,
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
    folder: &'a RunFolder,
    screen: &'a Screen,
}

impl Flight<'_> {
    async fn fly(&self, remote: &Remote, scenario: &Scenario, seed: u64) -> Result<ExitCode, RemoteError> {
        let link = match self.args.link {
            LinkKind::InProcess => "in-process",
            LinkKind::Iceoryx2 => "iceoryx2",
            LinkKind::Zenoh => "zenoh",
        };
        let pace = match self.args.pace {
            PaceArg::Fast => "fast",
            PaceArg::RealTime => "real-time",
        };
        let documents = scenario.documents().to_toml();
        let body = match &self.args.autopilot {
            Some(name) => json!({ "documents": documents, "seed": seed, "controller": { "autopilot": name } }),
            None => json!({ "documents": documents, "seed": seed, "link": link, "pace": pace }),
        };
        let run = remote.json(&Ask::post("/api/v1/runs").json(body).once()).await?;
        let id = fetch::text(&run, "id").to_owned();
        self.screen.line(&format!("run {id} of {}", remote.url()));
        let path = format!("/api/v1/runs/{id}");
        let watched = self.watch(remote, &path).await;
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

    /// Shows the run until it has ended; Ctrl-C asks the server to end it.
    async fn watch(&self, remote: &Remote, path: &str) -> Result<(), RemoteError> {
        let mut stop = Stop::new()?;
        let mut events = Follow::new(remote, path.to_owned(), 0);
        let mut canceled = false;
        loop {
            tokio::select! {
                event = events.next() => match event? {
                    Some(event) => self.show(&event),
                    None => return Ok(()),
                },
                () = stop.wanted() => {
                    if canceled {
                        return Err(RemoteError::Failed("given up".to_owned()));
                    }
                    canceled = true;
                    self.screen.line("asking the server to stop the run; Ctrl-C again leaves it running there");
                    match remote.call(&Ask::cancel(format!("{path}/cancel"))).await {
                        Ok(_) => {}
                        // Ended meanwhile.
                        Err(RemoteError::BadInput(sentence)) => tracing::debug!(sentence, "nothing to cancel"),
                        Err(error) => return Err(error),
                    }
                }
            }
        }
    }

    fn show(&self, event: &Event) {
        match serde_json::from_value(event.data.clone()) {
            Ok(known) => self.screen.show(&known),
            Err(_) if event.kind == "requeued" => {
                let why = event.data["why"].as_str().unwrap_or("it did not say why");
                self.screen.line(&format!("the server restarts the flight: {why}"));
            }
            Err(_) => {}
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
