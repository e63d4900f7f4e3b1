//! `rotortwin --server URL campaign`: flown by the server's workers, in parts; table and files are written here.

use super::events::Event;
use super::http::{Ask, Remote};
use super::{RemoteError, fetch, task, with_server};
use indicatif::ProgressBar;
use rotortwin_campaign::study::Campaign;
use rotortwin_cli::campaign::{self, Args, FlightArgs};
use rotortwin_cli::network::remote::ServerArgs;
use rotortwin_cli::output;
use rotortwin_jobs::submission::CampaignSubmission;
use rotortwin_jobs::{JobEvent, Progress, QueueEvent, Status};
use serde_json::Value;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// How long the server's answer to a new campaign may take: a process reads and tries it first.
const READ_BY_A_PROCESS: Duration = Duration::from_secs(130);

/// Runs the command.
pub(crate) fn run(server: &ServerArgs, args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    if args.is_in_a_store() {
        return output::bad_input("s3://… is accessed from this machine; leave out --server");
    }
    let Some(args) = args.flights() else {
        return output::bad_input("merge combines folders on this machine; leave out --server");
    };
    if let Some(option) = args.only_here() {
        return output::bad_input(format!(
            "{option} belongs to campaigns on this machine; expected it without --server"
        ));
    }
    let campaign = match Campaign::load(&args.campaign) {
        Ok(campaign) => campaign,
        Err(error) => return output::bad_input(error),
    };
    let text = match std::fs::read_to_string(&args.campaign) {
        Ok(text) => text,
        Err(error) => return output::bad_input(format!("{}: cannot be read: {error}", args.campaign.display())),
    };
    let name = &campaign.document().name;
    let folder = args
        .out
        .clone()
        .map_or_else(|| output::next_free_folder(&format!("campaign-{name}")), Ok);
    let folder = match folder.and_then(|folder| fetch::empty(&folder).map(|()| folder)) {
        Ok(folder) => folder,
        Err(sentence) => return output::bad_input(sentence),
    };
    let body = CampaignSubmission {
        text: Some(text),
        ..CampaignSubmission::default()
    };
    with_server(server, async |remote| {
        let ask = Ask::post("/api/v1/campaigns")
            .json(&body)?
            .limit(READ_BY_A_PROCESS)
            .once();
        let job = remote.json(&ask).await?;
        let id = fetch::text(&job, "id").to_owned();
        eprintln!("campaign {id} of {}", remote.url());
        let ended = watch(remote, &id, &campaign, args.json).await;
        match ended {
            Ok(()) => finish(remote, &id, &campaign, &folder, args).await,
            Err(error) => Err(error),
        }
        .map_err(|error| {
            let (RemoteError::BadInput(sentence) | RemoteError::Failed(sentence)) = error;
            RemoteError::Failed(format!(
                "{sentence}; campaign {id} continues on the server: 'rotortwin --server {} campaigns fetch {id}' gets it",
                remote.url()
            ))
        })
    })
}

/// Shows it until it has ended; Ctrl-C asks the server to end it.
async fn watch(remote: &Remote, id: &str, campaign: &Campaign, quiet: bool) -> Result<(), RemoteError> {
    let path = format!("/api/v1/campaigns/{id}");
    let parts = remote.json(&Ask::get(&path)).await?["facts"]["parts"]
        .as_u64()
        .unwrap_or(0);
    let bar = campaign::progress_bar(quiet, campaign.flights(), 0);
    let mut done = 0;
    task::follow(remote, &path, &bar, &mut |event| {
        show(&bar, event, &mut done, parts, campaign.flights());
    })
    .await
}

fn show(bar: &ProgressBar, event: &Event, done: &mut u64, parts: u64, flights: u64) {
    if let Some(QueueEvent::Part { .. }) = event.of_queue() {
        *done += 1;
        bar.set_position(flights * *done / parts.max(*done));
        bar.set_message(format!("{done} of {parts} parts"));
    } else if let Some(JobEvent::Progress(Progress::Flights { flights: flown, .. })) = event.of_job() {
        bar.set_position(flown);
    }
}

/// The files, and their summary.
async fn finish(
    remote: &Remote,
    id: &str,
    campaign: &Campaign,
    folder: &Path,
    args: &FlightArgs,
) -> Result<ExitCode, RemoteError> {
    let path = format!("/api/v1/campaigns/{id}");
    let job = remote.json(&Ask::get(&path)).await?;
    if fetch::status(&job) != Some(Status::Done) {
        let why = job["error"]
            .as_str()
            .map(|error| format!(": {error}"))
            .unwrap_or_default();
        return Err(RemoteError::Failed(format!(
            "it ended as {}{why}",
            fetch::text(&job, "status")
        )));
    }
    fetch::everything(remote, &path, folder).await?;
    // The server stores results next to its log and its inputs.
    let folder = if folder.join("out").is_dir() {
        folder.join("out")
    } else {
        folder.to_owned()
    };
    let summary: &Value = &job["result"];
    if args.json {
        output::line(&format!("{summary:#}"));
        return Ok(ExitCode::SUCCESS);
    }
    if let Err(sentence) = campaign::print_fetched(args, campaign, &folder) {
        // Of another version, or of vehicles other than this machine's.
        tracing::debug!(sentence, "the folder is not a campaign folder");
        let number = |key: &str| summary[key].as_u64().unwrap_or(0);
        output::line(&format!(
            "{}: {} of {} flights, {} failed, {} could not be flown; hash {}\nFiles        {}",
            campaign.document().name,
            number("flights"),
            number("planned_flights"),
            number("failed"),
            number("refused"),
            fetch::text(summary, "hash"),
            folder.display()
        ));
    }
    Ok(ExitCode::SUCCESS)
}
