//! `rotortwin --server URL blind`: the server's workers run the cases; score sheet and files are written here.

use super::events::Event;
use super::http::Remote;
use super::{RemoteError, fetch, task, with_server};
use indicatif::ProgressBar;
use rotortwin_blind::bench::score::Row;
use rotortwin_blind::bench::sheet::sum_up;
use rotortwin_blind::vehicle::{Vehicle, blades_of};
use rotortwin_cli::blind::{self, Args, BenchArgs};
use rotortwin_cli::network::remote::ServerArgs;
use rotortwin_cli::output;
use rotortwin_jobs::submission::{BenchVehicle, BlindBenchSubmission};
use rotortwin_jobs::{JobEvent, QueueEvent};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::ExitCode;

/// Runs the command.
pub(super) fn run(server: &ServerArgs, args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    let Some(args) = args.bench() else {
        return output::bad_input(
            "blind generate and blind effects work on this machine only; expected them without --server",
        );
    };
    if let Some(option) = args.only_here() {
        return output::bad_input(format!(
            "{option} belongs to benches on this machine; expected it without --server"
        ));
    }
    let body = match body(args).and_then(|body| fetch::empty(&args.out).map(|()| body)) {
        Ok(body) => body,
        Err(sentence) => return output::bad_input(sentence),
    };
    with_server(server, async |remote| {
        let path = task::submit(remote, "blind-benches", "blind bench", &body, args.json).await?;
        let ended = async {
            let mut cases = Cases::new(args);
            let bar = cases.bar.clone();
            task::follow(remote, &path, &bar, &mut |event| cases.show(event)).await?;
            let done = task::ended(remote, path.clone(), "blind bench").await?;
            finish(remote, &done, args).await
        };
        ended.await.map_err(|error| {
            let (RemoteError::BadInput(sentence) | RemoteError::Failed(sentence)) = error;
            let id = path.rsplit('/').next().unwrap_or_default();
            RemoteError::Failed(format!(
                "{sentence}; blind bench {id} continues on the server: 'rotortwin --server {} blind-benches fetch {id}' gets it",
                remote.url()
            ))
        })
    })
}

/// The request, with this machine's versions of the vehicles.
fn body(args: &BenchArgs) -> Result<BlindBenchSubmission, String> {
    let request = args.request().map_err(|error| error.to_string())?;
    let mut names = BTreeSet::new();
    let vehicles: Vec<BenchVehicle> = args
        .vehicles
        .iter()
        .map(|path| sent(path, &mut names))
        .collect::<Result<_, _>>()?;
    Ok(BlindBenchSubmission {
        presets: request.presets,
        n: request.n,
        seed: request.seed,
        vehicles,
        duration_s: request.duration_s,
        priority: 0,
        max_wall_s: None,
    })
}

/// A vehicle with its blades, under a unique name.
fn sent(path: &Path, names: &mut BTreeSet<String>) -> Result<BenchVehicle, String> {
    Vehicle::load(path).map_err(|error| error.to_string())?;
    let blades = blades_of(path).map_err(|error| error.to_string())?;
    let read = |path: &Path| {
        std::fs::read_to_string(path).map_err(|error| format!("{}: cannot be read: {error}", path.display()))
    };
    let plain = document_name(path);
    let mut name = plain.clone();
    for number in 2.. {
        if names.insert(name.clone()) {
            break;
        }
        name = format!("{plain}-{number}");
    }
    Ok(BenchVehicle {
        vehicle: name,
        text: Some(read(path)?),
        blades: Some(read(&blades)?),
    })
}

/// The name of a file in a form that the server accepts for a document.
fn document_name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let plain = |c: char| {
        if c.is_ascii_alphanumeric() || "._-".contains(c) {
            c.to_ascii_lowercase()
        } else {
            '-'
        }
    };
    let name: String = stem.chars().map(plain).take(50).collect();
    if name.starts_with(|c: char| c.is_ascii_alphanumeric()) {
        name
    } else {
        format!("v{name}")
    }
}

/// Finished cases. A case of a restarted part is reported twice.
struct Cases {
    bar: ProgressBar,
    /// Their numbers.
    done: BTreeSet<usize>,
}

impl Cases {
    fn new(args: &BenchArgs) -> Self {
        Self {
            bar: blind::progress_bar(args.json, args.preset.len().saturating_mul(args.n) as u64, 0),
            done: BTreeSet::new(),
        }
    }

    fn show(&mut self, event: &Event) {
        if let Some(QueueEvent::Requeued { why }) = event.of_queue() {
            self.bar.println(format!("the server merges it again: {why}"));
        } else if let Some(JobEvent::Case(case)) = event.of_job() {
            self.done.insert(case.case);
            self.bar.set_position(self.done.len() as u64);
            self.bar.set_message(format!("{} → {}", case.truth, case.named));
        }
    }
}

/// The files, and their summary.
async fn finish(remote: &Remote, done: &task::Done, args: &BenchArgs) -> Result<ExitCode, RemoteError> {
    fetch::everything(remote, &done.path, &args.out).await?;
    if args.json {
        output::line(&format!("{:#}", done.job["result"]));
        return Ok(ExitCode::SUCCESS);
    }
    let file = args.out.join("score.json");
    let told = |error: &dyn std::fmt::Display| RemoteError::Failed(format!("{}: {error}", file.display()));
    let text = std::fs::read_to_string(&file).map_err(|error| told(&error))?;
    let mut score: Value = serde_json::from_str(&text).map_err(|error| told(&error))?;
    let rows: Vec<Row> = serde_json::from_value(score["rows"].take()).map_err(|error| told(&error))?;
    blind::print_text(&sum_up(&rows), &args.out);
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_blind::bench::cases::Preset;
    use rotortwin_blind::bench::score::Outcome;
    use rotortwin_jobs::CaseDone;

    #[test]
    fn val_names_of_documents() {
        for (path, name) in [
            ("config/vehicles/f550.toml", "f550"),
            ("My Quad (2).toml", "my-quad--2-"),
            ("_x.toml", "v_x"),
            ("ä.toml", "v-"),
        ] {
            assert_eq!(document_name(Path::new(path)), name);
        }
    }

    #[test]
    fn prop_a_case_that_is_told_twice_counts_once() {
        let mut cases = Cases {
            bar: ProgressBar::hidden(),
            done: BTreeSet::new(),
        };
        for case in [0, 1, 1, 0, 2] {
            cases.show(&Event {
                id: 1,
                kind: "case".to_owned(),
                data: serde_json::to_value(JobEvent::Case(CaseDone {
                    case,
                    named: "b".to_owned(),
                    outcome: Outcome::Right,
                    preset: Preset::Mixed,
                    truth: "a".to_owned(),
                }))
                .expect("JSON"),
            });
        }
        assert_eq!(cases.bar.position(), 3);
        assert_eq!(cases.bar.message(), "a → b");
    }
}
