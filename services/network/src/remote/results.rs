//! `rotortwin --server URL show` and `replay`: for a run of the server.

use super::http::{Ask, Remote};
use super::{RemoteError, fetch, with_server};
use rotortwin_cli::network::remote::ServerArgs;
use rotortwin_cli::{output, replay, show};
use rotortwin_store::summary::Summary;
use serde_json::json;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Longest time to fly a run again.
const AGAIN: Duration = Duration::from_secs(3600);

/// Prints the result of a run, given by its id in place of the folder.
pub(super) fn show(server: &ServerArgs, args: &show::Args) -> ExitCode {
    with_server(server, async |remote| {
        let path = run_path(&args.run)?;
        let run = remote.json(&Ask::get(&path)).await?;
        let summary: Summary = match serde_json::from_value(run["summary"].clone()) {
            Ok(summary) => summary,
            Err(error) if run["summary"].is_null() => {
                tracing::debug!(%error, "no summary");
                let why = run["error"]
                    .as_str()
                    .map(|error| format!(": {error}"))
                    .unwrap_or_default();
                return Err(RemoteError::BadInput(format!(
                    "run {} has no result: it is {}{why}",
                    args.run.display(),
                    fetch::text(&run, "status")
                )));
            }
            Err(error) => {
                return Err(RemoteError::Failed(format!(
                    "the summary of run {} is of another version: {error}",
                    args.run.display()
                )));
            }
        };
        if args.json {
            print!("{}", summary.to_json());
        } else {
            print!("{}", output::summary_text(&summary, None));
            println!(
                "Files        rotortwin --server {} runs fetch {}",
                remote.url(),
                fetch::text(&run, "id")
            );
        }
        Ok(ExitCode::SUCCESS)
    })
}

/// Flies a run again on the server and compares the run hash.
pub(super) fn replay(server: &ServerArgs, args: &replay::Args) -> ExitCode {
    with_server(server, async |remote| verify(remote, args).await)
}

async fn verify(remote: &Remote, args: &replay::Args) -> Result<ExitCode, RemoteError> {
    let path = run_path(&args.run)?;
    let answer = remote.json(&Ask::post(format!("{path}/verify")).limit(AGAIN)).await?;
    let same = answer["same"].as_bool().unwrap_or(false);
    let (recorded, again) = (fetch::text(&answer, "recorded"), fetch::text(&answer, "again"));
    if args.json {
        println!("{}", json!({ "same": same, "recorded": recorded, "replayed": again }));
    } else if same {
        println!("same: the run and its second execution on the server have the run hash {recorded}");
    } else {
        println!("DIFFERENT\n  recorded {recorded}\n  replayed {again} (on the server, in one process)");
    }
    Ok(if same {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(rotortwin_process::EXIT_FAILED)
    })
}

/// The address of a run with this id.
fn run_path(id: &Path) -> Result<String, RemoteError> {
    let id = id.to_string_lossy();
    if id.is_empty() || !id.bytes().all(|byte| byte.is_ascii_alphanumeric()) {
        return Err(RemoteError::BadInput(format!(
            "'{id}' is not the id of a run; 'rotortwin runs list' prints them"
        )));
    }
    Ok(format!("/api/v1/runs/{id}"))
}
