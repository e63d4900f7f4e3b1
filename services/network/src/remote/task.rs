//! A job other than a flight: submitted, shown, waited for; then its result as text, and its files.

use super::events::{Event, Follow};
use super::http::{Ask, Remote};
use super::stop::Stop;
use super::{RemoteError, fetch};
use indicatif::{ProgressBar, ProgressStyle};
use rotortwin_cli::output;
use rotortwin_jobs::{JobEvent, Progress, QueueEvent, Status};
use serde::Serialize;
use serde_json::Value;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Interval of the spinner.
const TURN: Duration = Duration::from_millis(120);

/// A finished job.
#[derive(Debug)]
pub(super) struct Done {
    /// `/api/v1/COLLECTION/ID`
    pub(super) path: String,
    /// All its data.
    pub(super) job: Value,
}

/// Submits a job; returns its address. `what`: its name in messages, `quiet`: nothing on the terminal.
pub(super) async fn submit(
    remote: &Remote,
    collection: &str,
    what: &str,
    body: &impl Serialize,
    quiet: bool,
) -> Result<String, RemoteError> {
    let ask = Ask::post(format!("/api/v1/{collection}")).json(body)?.once();
    let job = remote.json(&ask).await?;
    let id = fetch::text(&job, "id");
    if !quiet {
        eprintln!("{what} {id} of {}", remote.url());
    }
    Ok(format!("/api/v1/{collection}/{id}"))
}

/// Submits a job, shows it, and waits until it is done; `what`: its name in messages, `quiet`: nothing on the terminal.
pub(super) async fn perform(
    remote: &Remote,
    collection: &str,
    what: &str,
    body: &impl Serialize,
    quiet: bool,
) -> Result<Done, RemoteError> {
    let path = submit(remote, collection, what, body, quiet).await?;
    let id = path.rsplit('/').next().unwrap_or_default().to_owned();
    done(remote, path, what, quiet).await.map_err(|error| {
        let (RemoteError::BadInput(sentence) | RemoteError::Failed(sentence)) = error;
        RemoteError::Failed(format!("{sentence}; {what} {id} continues on the server"))
    })
}

/// Waits until a job is done; Ctrl-C asks the server to end it.
pub(super) async fn done(remote: &Remote, path: String, what: &str, quiet: bool) -> Result<Done, RemoteError> {
    let bar = if quiet {
        ProgressBar::hidden()
    } else {
        let style = ProgressStyle::with_template("{spinner:.cyan} {msg}").expect("the template is well formed");
        ProgressBar::new_spinner().with_style(style)
    };
    bar.enable_steady_tick(TURN);
    follow(remote, &path, &bar, &mut |event| show(&bar, event)).await?;
    ended(remote, path, what).await
}

/// Shows a job until it has ended; Ctrl-C asks the server to end it. The bar is then removed.
pub(super) async fn follow(
    remote: &Remote,
    path: &str,
    bar: &ProgressBar,
    show: &mut dyn FnMut(&Event),
) -> Result<(), RemoteError> {
    watch(remote, path, &|line| bar.println(line), show).await?;
    bar.finish_and_clear();
    Ok(())
}

/// As [`follow`]; `say` prints a line.
pub(super) async fn watch(
    remote: &Remote,
    path: &str,
    say: &dyn Fn(&str),
    show: &mut dyn FnMut(&Event),
) -> Result<(), RemoteError> {
    let mut stop = Stop::new()?;
    let mut events = Follow::new(remote, path.to_owned(), 0);
    let mut canceled = false;
    loop {
        tokio::select! {
            event = events.next() => match event? {
                Some(event) => show(&event),
                None => return Ok(()),
            },
            () = stop.wanted() => {
                if canceled {
                    return Err(RemoteError::Failed("given up".to_owned()));
                }
                canceled = true;
                say("asking the server to stop it; Ctrl-C again leaves it running there");
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

/// Returns a job that has ended, if it is done.
pub(super) async fn ended(remote: &Remote, path: String, what: &str) -> Result<Done, RemoteError> {
    let job = remote.json(&Ask::get(&path)).await?;
    if fetch::status(&job) == Some(Status::Done) {
        return Ok(Done { path, job });
    }
    // The command's message on the server is a complete sentence already.
    Err(RemoteError::Failed(job["error"].as_str().map_or_else(
        || format!("the {what} ended as {}", fetch::text(&job, "status")),
        |error| error.trim_start_matches("rotortwin: ").to_owned(),
    )))
}

fn show(bar: &ProgressBar, event: &Event) {
    match event.of_queue() {
        Some(QueueEvent::Queued {}) => bar.set_message("waits for a worker"),
        Some(QueueEvent::Started { worker, .. }) => {
            bar.set_message(format!("at {}", worker.as_deref().unwrap_or("a worker")));
        }
        Some(QueueEvent::Requeued { why }) => bar.println(format!("the server restarts it: {why}")),
        Some(QueueEvent::Part { .. } | QueueEvent::Ended { .. }) => {}
        None => {
            if let Some(JobEvent::Progress(Progress::Share { share, text })) = event.of_job() {
                bar.set_message(format!("{:3.0} % {text}", 100.0 * share));
            }
        }
    }
}

impl Done {
    /// One of its files, as text.
    pub(super) async fn text(&self, remote: &Remote, name: &str) -> Result<String, RemoteError> {
        let answer = remote
            .call(&Ask::get(format!("{}/artifacts/{}", self.path, fetch::in_url(name))))
            .await?;
        let told = |error: reqwest::Error| RemoteError::Failed(format!("{name} arrived incomplete: {error}"));
        answer.text().await.map_err(told)
    }

    /// Downloads its files if a folder is named, and prints `NAME.json` or `NAME.txt`, like the local command; then the files' names.
    pub(super) async fn print(
        &self,
        remote: &Remote,
        name: &str,
        json: bool,
        out: Option<&Path>,
    ) -> Result<ExitCode, RemoteError> {
        if let Some(folder) = out {
            fetch::everything(remote, &self.path, folder).await?;
        }
        let ending = if json { "json" } else { "txt" };
        let text = self.text(remote, &format!("{name}.{ending}")).await?;
        output::line(text.strip_suffix('\n').unwrap_or(&text));
        if let Some(folder) = out.filter(|_| !json) {
            output::line(&format!("Files        {}", folder.display()));
        }
        Ok(ExitCode::SUCCESS)
    }
}
