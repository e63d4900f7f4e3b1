//! `rotortwin runs list|get|events|cancel|delete|fetch`: a server's jobs of any kind.

use super::events::Follow;
use super::http::{Ask, Remote};
use super::{RemoteError, fetch, with_server};
use rotortwin_cli::network::remote::{JobArgs, ServerArgs, Verb};
use rotortwin_cli::output;
use rotortwin_runner::grid::Grid;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::ExitCode;

/// Most entries of a page; the server refuses more.
const LARGEST_PAGE: u64 = 1000;

/// Runs the command for one kind of job: `runs`, `campaigns`, …
pub(super) fn run(server: &ServerArgs, kind: &'static str, args: &JobArgs) -> ExitCode {
    rotortwin_process::start_logging();
    with_server(server, async |remote| {
        let jobs = Jobs { remote, kind };
        match &args.verb {
            Verb::List {
                status,
                name,
                limit,
                json,
            } => jobs.list(status.as_deref(), name.as_deref(), *limit, *json).await?,
            Verb::Get { id } => {
                let job = remote.json(&Ask::get(jobs.path(id)?)).await?;
                output::line(&format!("{job:#}"));
            }
            Verb::Events { id, after } => jobs.events(id, *after).await?,
            Verb::Cancel { id } => {
                remote.call(&Ask::cancel(format!("{}/cancel", jobs.path(id)?))).await?;
            }
            Verb::Delete { id } => {
                remote.call(&Ask::delete(jobs.path(id)?)).await?;
            }
            Verb::Fetch { id, out } => jobs.fetch(id, out.clone()).await?,
        }
        Ok(ExitCode::SUCCESS)
    })
}

struct Jobs<'a> {
    remote: &'a Remote,
    kind: &'static str,
}

impl Jobs<'_> {
    fn path(&self, id: &str) -> Result<String, RemoteError> {
        if id.is_empty() || !id.bytes().all(|byte| byte.is_ascii_alphanumeric()) {
            return Err(RemoteError::BadInput(format!(
                "'{id}' is not an id; 'rotortwin {} list' prints them",
                self.kind
            )));
        }
        Ok(format!("/api/v1/{}/{id}", self.kind))
    }

    async fn list(&self, status: Option<&str>, name: Option<&str>, limit: u64, json: bool) -> Result<(), RemoteError> {
        let (mut items, mut cursor) = (Vec::new(), None::<String>);
        while (items.len() as u64) < limit {
            let mut url = reqwest::Url::parse("http://x").map_err(|error| RemoteError::Failed(error.to_string()))?;
            url.set_path(&format!("/api/v1/{}", self.kind));
            let page = (limit - items.len() as u64).min(LARGEST_PAGE).to_string();
            let pairs = [
                ("limit", Some(page.as_str())),
                ("status", status),
                ("name", name),
                ("cursor", cursor.as_deref()),
            ];
            for (key, value) in pairs.into_iter().filter_map(|(key, value)| Some((key, value?))) {
                url.query_pairs_mut().append_pair(key, value);
            }
            let path = format!("{}?{}", url.path(), url.query().unwrap_or_default());
            let page = self.remote.json(&Ask::get(path)).await?;
            items.extend(page["items"].as_array().cloned().unwrap_or_default());
            cursor = page["next"].as_str().map(str::to_owned);
            if cursor.is_none() {
                break;
            }
        }
        if json {
            output::line(&format!("{:#}", Value::Array(items)));
        } else {
            output::line(&table(&items).to_string());
        }
        Ok(())
    }

    async fn events(&self, id: &str, after: u64) -> Result<(), RemoteError> {
        let mut events = Follow::new(self.remote, self.path(id)?, after);
        while let Some(event) = events.next().await? {
            output::line(&json!({ "id": event.id, "kind": event.kind, "data": event.data }).to_string());
            if rotortwin_cli::terminal::is_closed() {
                break;
            }
        }
        Ok(())
    }

    async fn fetch(&self, id: &str, out: Option<PathBuf>) -> Result<(), RemoteError> {
        let path = self.path(id)?;
        let job = self.remote.json(&Ask::get(&path)).await?;
        let name = match (job["name"].as_str(), job["seed"].as_u64()) {
            (Some(name), Some(seed)) => format!("{}-{seed}", in_file_name(name)),
            _ => format!("{}-{id}", self.kind),
        };
        let folder = match out {
            Some(folder) => folder,
            None => output::next_free_folder(&name).map_err(RemoteError::BadInput)?,
        };
        fetch::empty(&folder).map_err(RemoteError::BadInput)?;
        let files = fetch::everything(self.remote, &path, &folder).await?;
        if files == 0 {
            return Err(RemoteError::BadInput(format!(
                "{id} has no files: it is {}",
                fetch::text(&job, "status")
            )));
        }
        output::line(&format!("{files} files in {}", folder.display()));
        Ok(())
    }
}

/// A name from a server must not lead outside.
fn in_file_name(name: &str) -> String {
    name.chars()
        .map(|letter| {
            if letter.is_alphanumeric() || "-_".contains(letter) {
                letter
            } else {
                '_'
            }
        })
        .collect()
}

/// Latest first.
fn table(items: &[Value]) -> Grid {
    let mut table = Grid::new(["id", "name", "seed", "state", "run hash or reason"]).numbers([2]);
    for job in items {
        let seed = job["seed"]
            .as_u64()
            .map_or_else(|| "–".to_owned(), |seed| seed.to_string());
        let note = job["error"].as_str().or(job["run_hash"].as_str()).unwrap_or("–");
        table.add_row([
            fetch::text(job, "id"),
            fetch::text(job, "name"),
            &seed,
            fetch::text(job, "status"),
            note,
        ]);
    }
    table
}
