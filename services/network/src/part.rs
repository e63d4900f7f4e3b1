//! `rotortwin part`: a node of a Ray cluster fetches a part of a job from the server, runs it in a separate process like a worker, and
//! delivers the result.
//!
//! The server may be down for ten minutes ([`OUTAGE_TIMEOUT`]): it may be killed, and another one continues the attempt. Once it says that the
//! attempt is over (410), the result is no longer needed, and this ends.

use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue};
use reqwest::{Method, StatusCode};
use rotortwin_cli::output::{bad_input, failed};
use rotortwin_jobs::part::{CA_VARIABLE, TICKET_VARIABLE, URL_VARIABLE};
use rotortwin_jobs::{NextPart, PartAccepted, PartEnd, PartEvents, PartFile, PartHow, PartOrder};
use std::path::{Component, Path, PathBuf};
use std::process::{ExitCode, ExitStatus, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, Command};
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::{Notify, mpsc};

/// Longest outage of the server.
const OUTAGE_TIMEOUT: Duration = Duration::from_secs(600);
/// A process starts no further part after this: a submission costs Ray about a second, and others may need its place.
const LONGEST: Duration = Duration::from_secs(300);
/// Time-out for an answer.
const ANSWER: Duration = Duration::from_secs(60);
/// Time-out for a connection.
const CONNECT: Duration = Duration::from_secs(10);
/// Pause between attempts.
const PAUSE: Duration = Duration::from_secs(1);
/// Interval at which events are sent.
const TELL: Duration = Duration::from_millis(500);
/// Longest interval without a sign of life.
const LIVES: Duration = Duration::from_secs(3);
/// Events per request.
const AT_ONCE: usize = 1000;
/// Limit of a process's output other than events, bytes.
const MOST_WORDS: usize = 64 << 20;
/// Time to end on request before a process is killed.
const GRACE: Duration = Duration::from_millis(900);
/// Exit code of a job with bad input.
const BAD_INPUT: i32 = rotortwin_process::EXIT_BAD_INPUT as i32;
/// The job, in its folder.
const JOB_FILE: &str = "job.json";
/// Its error messages, next to it.
const COMPLAINTS: &str = "part.log";

/// Why the work stops.
enum Stop {
    /// The server says that the attempt is over.
    Over,
    /// This process was asked to end.
    Ended,
    /// One sentence.
    Failed(String),
}

/// The server's interface to this attempt.
#[derive(Clone)]
struct Server {
    http: reqwest::Client,
    url: String,
}

/// Runs the part named by the environment.
pub(crate) fn run() -> ExitCode {
    rotortwin_process::start_logging();
    super::serve::in_runtime(async {
        let server = match Server::from_environment() {
            Ok(server) => server,
            Err(sentence) => return bad_input(sentence),
        };
        match perform(&server).await {
            Ok(()) => ExitCode::SUCCESS,
            Err(Stop::Over) => failed(format!(
                "{}: the server reports that this attempt is over; nothing is delivered",
                server.url
            )),
            Err(Stop::Ended) => failed("the part was stopped"),
            Err(Stop::Failed(sentence)) => failed(sentence),
        }
    })
}

impl Server {
    fn from_environment() -> Result<Self, String> {
        let variable = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
        let (Some(url), Some(ticket)) = (variable(URL_VARIABLE), variable(TICKET_VARIABLE)) else {
            return Err(format!(
                "{URL_VARIABLE} and {TICKET_VARIABLE}, which identify the part, are not set; this command is started by Ray, for `rotortwin serve \
                 --executor ray=URL`"
            ));
        };
        Self::open(&url, &ticket)
    }

    fn open(url: &str, ticket: &str) -> Result<Self, String> {
        // Another part of this program may have installed one already.
        if rustls::crypto::ring::default_provider().install_default().is_err() {
            tracing::debug!("TLS was set up before");
        }
        let mut value = HeaderValue::from_str(&format!("Bearer {ticket}"))
            .map_err(|error| format!("{TICKET_VARIABLE}: no ticket: {error}"))?;
        value.set_sensitive(true);
        let mut http = reqwest::Client::builder()
            .connect_timeout(CONNECT)
            .timeout(ANSWER)
            .default_headers(HeaderMap::from_iter([(AUTHORIZATION, value)]));
        if let Some(pem) = std::env::var(CA_VARIABLE).ok().filter(|pem| !pem.is_empty()) {
            let certificates = reqwest::Certificate::from_pem_bundle(pem.as_bytes())
                .map_err(|error| format!("{CA_VARIABLE}: {error}"))?;
            http = http.tls_certs_only(certificates);
        } else if url.starts_with("http://") {
            // No certificates are needed, and a machine without any can still connect.
            http = http.tls_certs_only([]);
        }
        let http = http.build().map_err(|error| format!("TLS cannot be set up: {error}"))?;
        Ok(Self {
            http,
            url: url.to_owned(),
        })
    }

    /// A successful answer.
    async fn ask(&self, method: Method, path: &str, body: &Body) -> Result<reqwest::Response, Stop> {
        let begun = Instant::now();
        loop {
            let mut request = self.http.request(method.clone(), format!("{}{path}", self.url));
            request = match body {
                Body::None => request,
                Body::Json(text) => request.header("content-type", "application/json").body(text.clone()),
                Body::File(file) => {
                    let opened = tokio::fs::File::open(file)
                        .await
                        .map_err(|error| cannot(file, &error))?;
                    let size = opened.metadata().await.map_err(|error| cannot(file, &error))?.len();
                    request
                        .header("content-type", "application/octet-stream")
                        .header("content-length", size)
                        .body(reqwest::Body::from(opened))
                }
            };
            let why = match request.send().await {
                Ok(answer) if answer.status().is_success() => return Ok(answer),
                Ok(answer) if answer.status() == StatusCode::GONE => return Err(Stop::Over),
                Ok(answer) => {
                    let status = answer.status();
                    let said = answer.text().await.unwrap_or_default();
                    let passes = status.is_server_error() || status == StatusCode::TOO_MANY_REQUESTS;
                    let why = format!(
                        "it answered {} ({})",
                        status.as_u16(),
                        said.chars().take(300).collect::<String>()
                    );
                    if !passes {
                        return Err(Stop::Failed(format!("{}{path}: {why}", self.url)));
                    }
                    why
                }
                Err(error) => causes(&error),
            };
            if begun.elapsed() > OUTAGE_TIMEOUT {
                let silent = OUTAGE_TIMEOUT.as_secs();
                return Err(Stop::Failed(format!(
                    "{}: the server did not accept this for {silent} s: {why}",
                    self.url
                )));
            }
            tracing::warn!(url = self.url, why, "trying again");
            tokio::time::sleep(PAUSE).await;
        }
    }

    async fn order(&self) -> Result<PartOrder, Stop> {
        let answer = self.ask(Method::GET, "", &Body::None).await?;
        let text = answer.text().await.map_err(|error| Stop::Failed(causes(&error)))?;
        // An order from another version may be invalid here.
        let program = serde_json::from_str::<serde_json::Value>(&text).ok();
        let program = program
            .as_ref()
            .and_then(|order| order["program"].as_str())
            .unwrap_or("another");
        let own = env!("CARGO_PKG_VERSION");
        if program != own {
            let why = format!(
                "rotortwin here is of version {own}, the server's of version {program}; expected the same version on every node"
            );
            self.end(PartHow::Refused { why: why.clone() }, false).await?;
            return Err(Stop::Failed(why));
        }
        serde_json::from_str(&text)
            .map_err(|error| Stop::Failed(format!("{}: the part cannot be read: {error}", self.url)))
    }

    async fn tell(&self, lines: Vec<String>) -> Result<(), Stop> {
        let body = Body::json(&PartEvents { lines })?;
        self.ask(Method::POST, "/events", &body).await.map(drop)
    }

    /// Reports how the part ended; returns the next one, if any.
    async fn end(&self, how: PartHow, wants_more: bool) -> Result<Option<NextPart>, Stop> {
        let end = PartEnd {
            node: rotortwin_links::host_name(),
            wants_more,
            how,
        };
        let begun = Instant::now();
        match self.ask(Method::POST, "/end", &Body::json(&end)?).await {
            Ok(answer) => {
                let text = answer.text().await.map_err(|error| Stop::Failed(causes(&error)))?;
                let accepted: PartAccepted = serde_json::from_str(&text)
                    .map_err(|error| Stop::Failed(format!("{}: the response cannot be read: {error}", self.url)))?;
                Ok(accepted.next)
            }
            // This very report may have arrived, and its answer been lost.
            Err(Stop::Over) if begun.elapsed() >= PAUSE => Ok(None),
            Err(stop) => Err(stop),
        }
    }

    /// Another part of the same server.
    fn at(&self, next: &NextPart) -> Result<Self, Stop> {
        let base = self.url.split("/executor/").next().unwrap_or_default();
        Self::open(&format!("{base}{}", next.path), &next.ticket).map_err(Stop::Failed)
    }
}

enum Body {
    None,
    Json(String),
    File(PathBuf),
}

impl Body {
    fn json(value: &impl serde::Serialize) -> Result<Self, Stop> {
        serde_json::to_string(value)
            .map(Self::Json)
            .map_err(|error| Stop::Failed(error.to_string()))
    }
}

fn cannot(path: &Path, error: &std::io::Error) -> Stop {
    Stop::Failed(format!("{}: {error}", path.display()))
}

async fn perform(server: &Server) -> Result<(), Stop> {
    let signals = |kind| signal(kind).map_err(|error| Stop::Failed(format!("signals cannot be caught: {error}")));
    let (mut terminate, mut interrupt) = (signals(SignalKind::terminate())?, signals(SignalKind::interrupt())?);
    tokio::select! {
        done = one_after_another(server) => done,
        () = either(&mut terminate, &mut interrupt) => Err(Stop::Ended),
    }
}

async fn either(terminate: &mut Signal, interrupt: &mut Signal) {
    tokio::select! {
        _ = terminate.recv() => {}
        _ = interrupt.recv() => {}
    }
}

/// Runs parts as long as there are any and [`LONGEST`] has not passed: then others of the cluster may have its place.
async fn one_after_another(server: &Server) -> Result<(), Stop> {
    let begun = Instant::now();
    let mut server = server.clone();
    while let Some(next) = in_folder(&server, begun).await? {
        server = server.at(&next)?;
    }
    Ok(())
}

async fn in_folder(server: &Server, begun: Instant) -> Result<Option<NextPart>, Stop> {
    let order = server.order().await?;
    let folder = tempfile::Builder::new()
        .prefix("rotortwin-part-")
        .tempdir()
        .map_err(|error| Stop::Failed(format!("a folder for temporary files cannot be created: {error}")))?;
    lay_out(server, &order, folder.path()).await?;
    let how = do_job(server, &order, folder.path()).await?;
    let ended = server.end(how, begun.elapsed() < LONGEST).await;
    removed(folder);
    ended
}

/// Leftovers in a folder for temporary files are not a failure of the part.
fn removed(folder: TempDir) {
    if let Err(error) = folder.close() {
        tracing::warn!(%error, "temporary files cannot be removed");
    }
}

fn below(folder: &Path, path: &str) -> Result<PathBuf, Stop> {
    let plain = !path.is_empty()
        && Path::new(path)
            .components()
            .all(|part| matches!(part, Component::Normal(_)));
    if plain {
        Ok(folder.join(path))
    } else {
        Err(Stop::Failed(format!(
            "the part names {path}, which is outside its folder"
        )))
    }
}

async fn lay_out(server: &Server, order: &PartOrder, folder: &Path) -> Result<(), Stop> {
    for input in &order.inputs {
        let place = below(folder, &input.path)?;
        let parent = place.parent().unwrap_or(folder);
        std::fs::create_dir_all(parent).map_err(|error| cannot(parent, &error))?;
        match &input.text {
            Some(text) => std::fs::write(&place, text),
            None => {
                let path = format!("/inputs/{}", input.path);
                let answer = server.ask(Method::GET, &path, &Body::None).await?;
                let bytes = answer.bytes().await.map_err(|error| Stop::Failed(causes(&error)))?;
                std::fs::write(&place, bytes)
            }
        }
        .map_err(|error| cannot(&place, &error))?;
    }
    let out = below(folder, &order.out)?;
    std::fs::create_dir_all(&out).map_err(|error| cannot(&out, &error))?;
    let file = folder.join(JOB_FILE);
    std::fs::write(&file, &order.file).map_err(|error| cannot(&file, &error))
}

fn start(order: &PartOrder, folder: &Path) -> std::io::Result<Child> {
    let mut command = Command::new(std::env::current_exe()?);
    for name in [URL_VARIABLE, TICKET_VARIABLE, CA_VARIABLE] {
        command.env_remove(name);
    }
    let child = command
        .args(["job", JOB_FILE])
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(std::fs::File::create(folder.join(COMPLAINTS))?)
        .kill_on_drop(true)
        .spawn()?;
    rotortwin_api::hold_within(child.id().unwrap_or(0), order.memory, order.cpu_s)?;
    Ok(child)
}

/// Runs the job, sends its events, and delivers its files.
async fn do_job(server: &Server, order: &PartOrder, folder: &Path) -> Result<PartHow, Stop> {
    let mut child = match start(order, folder) {
        Ok(child) => child,
        Err(error) => {
            return Ok(PartHow::Failed {
                why: format!("the job could not be started: {error}"),
            });
        }
    };
    let stdout = child.stdout.take();
    // Open until this ends: the process takes its closing for our death.
    let stdin = child.stdin.take();
    let (events, told) = mpsc::unbounded_channel();
    let (teller, ended) = (server.clone(), Arc::new(Notify::new()));
    let of_teller = Arc::clone(&ended);
    let mut telling = tokio::spawn(async move { tell_all(&teller, told, &of_teller).await });
    let read = async {
        let mut words = String::new();
        let Some(stdout) = stdout else { return words };
        let mut lines = BufReader::new(stdout).lines();
        while let Ok(Some(line)) = lines.next_line().await {
            let event = serde_json::from_str::<serde_json::Value>(&line).ok();
            if event.is_some_and(|event| event["event"].is_string()) {
                if events.send(line).is_err() {
                    break;
                }
            } else if words.len() + line.len() < MOST_WORDS {
                words.push_str(&line);
                words.push('\n');
            }
        }
        words
    };
    let words = tokio::select! {
        words = read => Some(words),
        ended = &mut telling => {
            end_child(&mut child).await;
            return Err(match ended {
                Ok(Err(stop)) => stop,
                _ => Stop::Failed("the server is no longer informed".to_owned()),
            });
        }
        () = tokio::time::sleep(Duration::from_secs(order.wall_limit_s)) => None,
    };
    let Some(words) = words else {
        end_child(&mut child).await;
        return Ok(PartHow::Refused {
            why: format!("the limit of {} s of wall time was exceeded", order.wall_limit_s - 1),
        });
    };
    let status = child.wait().await;
    drop(stdin);
    drop(events);
    ended.notify_one();
    match telling.await {
        Ok(Ok(())) => {}
        Ok(Err(stop)) => return Err(stop),
        Err(error) => return Err(Stop::Failed(error.to_string())),
    }
    match status {
        Ok(status) if status.success() => {}
        Ok(status) => return Ok(why_not(status, &folder.join(COMPLAINTS), order)),
        Err(error) => {
            return Ok(PartHow::Failed {
                why: format!("waiting for its process failed: {error}"),
            });
        }
    }
    let out = below(folder, &order.out)?;
    for name in &order.leftovers {
        if let Err(error) = std::fs::remove_file(out.join(name)) {
            tracing::debug!(name, %error, "nothing to discard");
        }
    }
    let files = rotortwin_api::files_of(&out).map_err(|error| cannot(&out, &error))?;
    let files: Vec<PartFile> = files.into_iter().map(|(path, size)| PartFile { path, size }).collect();
    for file in &files {
        let path = format!("/files/{}", file.path);
        server
            .ask(Method::PUT, &path, &Body::File(out.join(&file.path)))
            .await?;
    }
    Ok(PartHow::Done { result: words, files })
}

/// Sends events and signs of life until there are no more.
async fn tell_all(server: &Server, mut events: mpsc::UnboundedReceiver<String>, ended: &Notify) -> Result<(), Stop> {
    let mut told = Instant::now();
    loop {
        let mut lines = Vec::new();
        let come = tokio::time::timeout(LIVES, events.recv_many(&mut lines, AT_ONCE)).await;
        if come == Ok(0) {
            return Ok(());
        }
        if !lines.is_empty() || told.elapsed() >= LIVES {
            server.tell(lines).await?;
            told = Instant::now();
        }
        if !events.is_closed() {
            tokio::select! {
                () = tokio::time::sleep(TELL) => {}
                () = ended.notified() => {}
            }
        }
    }
}

async fn end_child(child: &mut Child) {
    let id = child
        .id()
        .and_then(|id| rustix::process::Pid::from_raw(id.cast_signed()));
    if let Some(id) = id
        && let Err(error) = rustix::process::kill_process(id, rustix::process::Signal::TERM)
    {
        tracing::debug!(%error, "the process has ended already");
    }
    if tokio::time::timeout(GRACE, child.wait()).await.is_err()
        && let Err(error) = child.kill().await
    {
        tracing::warn!(%error, "the process cannot be killed");
    }
}

fn why_not(status: ExitStatus, complaints: &Path, order: &PartOrder) -> PartHow {
    let said = std::fs::read_to_string(complaints).unwrap_or_default();
    let last = said
        .lines()
        .rev()
        .find(|line| !line.trim().is_empty())
        .unwrap_or("it said nothing");
    let why: String = last
        .strip_prefix("rotortwin: ")
        .unwrap_or(last)
        .chars()
        .take(500)
        .collect();
    if let Some(why) = rotortwin_api::limit_that_ended(status, &said, order.memory) {
        return PartHow::Refused { why };
    }
    if status.code() == Some(BAD_INPUT) {
        return PartHow::Refused { why };
    }
    PartHow::Failed {
        why: format!("{why} ({status})"),
    }
}

/// An error with its causes.
fn causes(error: &dyn std::error::Error) -> String {
    let (mut words, mut next) = (error.to_string(), error.source());
    while let Some(cause) = next {
        words += &format!(": {cause}");
        next = cause.source();
    }
    words
}
