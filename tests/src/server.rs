//! A server under test, and a minimal HTTP client for it.

use crate::process::{Process, wait_until};
use crate::program::program;
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Read as _, Seek as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Timeout of an answer.
const LIMIT: Duration = Duration::from_secs(30);

/// An answer.
#[derive(Debug)]
pub struct Answer {
    /// HTTP status.
    pub status: u16,
    /// All headers, verbatim.
    pub headers: String,
    /// What followed them.
    pub body: Vec<u8>,
}

impl Answer {
    /// The body as JSON.
    ///
    /// # Panics
    /// It is not JSON.
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&self.body)))
    }
}

/// `rotortwin serve`, killed on drop.
#[derive(Debug)]
pub struct Server {
    child: Child,
    address: String,
    /// `https` if started with a certificate; then it can only be queried by programs.
    scheme: &'static str,
}

fn library() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../config")
}

/// Starts a part of the server; returns the first line that it prints, or its error messages.
fn start(command: &mut Command) -> (Child, String) {
    let mut complaints = tempfile::tempfile().expect("a file can be made");
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(complaints.try_clone().expect("it can be shared"))
        .spawn()
        .expect("the program starts");
    let mut line = String::new();
    let stdout = child.stdout.take().expect("it is piped");
    BufReader::new(stdout).read_line(&mut line).expect("it says something");
    if line.is_empty() {
        complaints.rewind().expect("it can be read");
        complaints.read_to_string(&mut line).expect("it is text");
    }
    (child, line)
}

fn command(what: &str, data: &Path, more: &[&str]) -> Command {
    let mut command = Command::new(program());
    command
        .arg(what)
        .arg("--data")
        .arg(data)
        .args(more)
        .env_remove("DATABASE_URL");
    command
}

/// `rotortwin worker`, killed on drop.
#[derive(Debug)]
pub struct Worker(Child);

impl Worker {
    /// Starts it with more arguments.
    ///
    /// # Panics
    /// It does not report that it is working.
    pub fn start(data: &Path, more: &[&str]) -> Self {
        Self::start_in(&[], data, more)
    }

    /// [`start`](Self::start) with more environment variables.
    ///
    /// # Panics
    /// It does not report that it is working.
    pub fn start_in(environment: &[(&str, &str)], data: &Path, more: &[&str]) -> Self {
        let (child, line) = start(command("worker", data, more).envs(environment.iter().copied()));
        assert!(line.starts_with("Working"), "{line}");
        Self(child)
    }

    /// The worker's process.
    pub fn process(&self) -> Process {
        Process::of_child(&self.0)
    }

    /// `kill -9`.
    ///
    /// # Panics
    /// The kernel refuses.
    pub fn kill(&mut self) {
        self.0.kill().expect("it can be killed");
        self.0.wait().expect("it can be waited for");
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        if let Err(error) = self.0.kill().and_then(|()| self.0.wait().map(|_| ())) {
            eprintln!("a worker cannot be killed: {error}");
        }
    }
}

impl Server {
    /// Starts it on a free port with `data` as its folder and the project's library.
    ///
    /// # Panics
    /// It does not report its address.
    pub fn start(data: &Path) -> Self {
        Self::start_at("127.0.0.1:0", data, &["--workers", "2"])
    }

    /// Restarts it at the same address, after [`kill`](Self::kill).
    ///
    /// # Panics
    /// It does not report its address.
    pub fn start_again(&mut self, data: &Path) {
        *self = Self::start_at(&self.address, data, &["--workers", "2"]);
    }

    /// Starts it at an address with more arguments.
    ///
    /// # Panics
    /// It does not report its address.
    pub fn start_at(address: &str, data: &Path, more: &[&str]) -> Self {
        Self::start_in(&[], address, data, more)
    }

    /// [`start_at`](Self::start_at) with more environment variables.
    ///
    /// # Panics
    /// It does not report its address.
    pub fn start_in(environment: &[(&str, &str)], address: &str, data: &Path, more: &[&str]) -> Self {
        let (child, line) = start(
            command("serve", data, more)
                .args(["--listen", address, "--library"])
                .arg(library())
                .envs(environment.iter().copied()),
        );
        let (before, address) = line.trim().rsplit_once("://").unwrap_or_default();
        assert!(address.starts_with("127.0.0.1:"), "{line}");
        let scheme = if before.ends_with("https") { "https" } else { "http" };
        Self {
            child,
            address: address.to_owned(),
            scheme,
        }
    }

    /// Listening address.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// For programs.
    pub fn url(&self) -> String {
        format!("{}://{}", self.scheme, self.address)
    }

    /// The server's process.
    pub fn process(&self) -> Process {
        Process::of_child(&self.child)
    }

    /// `kill -9`.
    ///
    /// # Panics
    /// The kernel refuses.
    pub fn kill(&mut self) {
        self.child.kill().expect("it can be killed");
        self.child.wait().expect("it can be waited for");
    }

    /// Sends SIGTERM; returns the exit code.
    ///
    /// # Panics
    /// It does not end.
    pub fn stop(&mut self) -> Option<i32> {
        self.process().signal(rustix::process::Signal::TERM);
        let mut code = None;
        wait_until(LIMIT, || {
            code = self.child.try_wait().expect("it can be waited for");
            code.is_some()
        })
        .expect("it ends");
        code.and_then(|status| status.code())
    }

    /// One request.
    ///
    /// # Panics
    /// There is no HTTP answer.
    pub fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Answer {
        self.ask_bytes(method, path, headers, body.as_bytes())
    }

    /// [`ask`](Self::ask) with a binary body.
    ///
    /// # Panics
    /// There is no HTTP answer.
    pub fn ask_bytes(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let mut stream = self.send_bytes(method, path, headers, body);
        let mut all = Vec::new();
        stream.read_to_end(&mut all).expect("an answer");
        let split = all.windows(4).position(|four| four == b"\r\n\r\n").expect("headers");
        let headers = String::from_utf8_lossy(&all[..split]).into_owned();
        let status = headers
            .split(' ')
            .nth(1)
            .and_then(|code| code.parse().ok())
            .expect("a status");
        Answer {
            status,
            headers,
            body: all[split + 4..].to_vec(),
        }
    }

    /// A fresh connection.
    ///
    /// # Panics
    /// The server does not listen.
    pub fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.address).expect("it listens");
        stream.set_read_timeout(Some(LIMIT)).expect("a time-out");
        stream
    }

    /// Sends a request and returns the open connection (HTTP/1.0: no chunked encoding).
    ///
    /// # Panics
    /// The server does not accept it.
    pub fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> TcpStream {
        self.send_bytes(method, path, headers, body.as_bytes())
    }

    fn send_bytes(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> TcpStream {
        let mut stream = self.connect();
        let mut text = format!("{method} {path} HTTP/1.0\r\ncontent-length: {}\r\n", body.len());
        for (name, value) in headers {
            text += &format!("{name}: {value}\r\n");
        }
        if !body.is_empty() && !text.contains("content-type") {
            text += "content-type: application/json\r\n";
        }
        stream
            .write_all(&[text.as_bytes(), b"\r\n", body].concat())
            .expect("it takes the request");
        stream
    }

    /// GET as JSON; it must exist.
    ///
    /// # Panics
    /// It does not.
    pub fn get(&self, path: &str) -> Value {
        let answer = self.ask("GET", path, &[], "");
        assert_eq!(answer.status, 200, "{path}: {}", String::from_utf8_lossy(&answer.body));
        answer.json()
    }

    /// Submits a run, which must be accepted; returns its id.
    ///
    /// # Panics
    /// It is not accepted.
    pub fn submit(&self, body: &Value) -> String {
        self.submit_to("runs", body)
    }

    /// Submits a job, which must be accepted; returns its id.
    ///
    /// # Panics
    /// It is not accepted.
    pub fn submit_to(&self, collection: &str, body: &Value) -> String {
        let answer = self.ask("POST", &format!("/api/v1/{collection}"), &[], &body.to_string());
        assert_eq!(answer.status, 202, "{}", String::from_utf8_lossy(&answer.body));
        answer.json()["id"].as_str().expect("an id").to_owned()
    }

    /// Requests a log of the independent simulator (`POST /api/v1/logs/generate`), and waits for it; returns its id.
    ///
    /// # Panics
    /// It is rejected, or fails.
    #[track_caller]
    pub fn generated(&self, body: &Value) -> String {
        let id = self.submit_to("logs/generate", body);
        let job = self.ended_in("logs", &id);
        assert_eq!(job["status"], "done", "{job}");
        id
    }

    /// Waits until a run has ended; returns the run.
    ///
    /// # Panics
    /// It does not end.
    pub fn ended(&self, id: &str) -> Value {
        self.ended_in("runs", id)
    }

    /// Waits until a job has ended; returns the job.
    ///
    /// # Panics
    /// It does not end.
    pub fn ended_in(&self, collection: &str, id: &str) -> Value {
        let mut job = Value::Null;
        let path = format!("/api/v1/{collection}/{id}");
        wait_until(Duration::from_secs(180), || {
            std::thread::sleep(Duration::from_millis(20));
            job = self.get(&path);
            !matches!(job["status"].as_str(), Some("queued" | "running"))
        })
        .unwrap_or_else(|| panic!("{job}"));
        job
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Err(error) = self.child.kill().and_then(|()| self.child.wait().map(|_| ())) {
            eprintln!("the server cannot be killed: {error}");
        }
    }
}
