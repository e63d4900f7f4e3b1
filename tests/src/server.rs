//! A server under test, and just enough HTTP to talk to it.

use crate::process::{Process, wait_until};
use crate::program::program;
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// No answer takes longer.
const LIMIT: Duration = Duration::from_secs(30);

/// An answer.
#[derive(Debug)]
pub struct Answer {
    /// HTTP status.
    pub status: u16,
    /// All headers, as they came.
    pub headers: String,
    /// What followed them.
    pub body: Vec<u8>,
}

impl Answer {
    /// The body as JSON.
    ///
    /// # Panics
    /// It is none.
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&self.body)))
    }
}

/// `rotortwin serve`, killed when it is dropped.
#[derive(Debug)]
pub struct Server {
    child: Child,
    address: String,
}

impl Server {
    /// Starts it on a free port with `data` as its folder and the project's library.
    ///
    /// # Panics
    /// It does not say where it serves.
    pub fn start(data: &Path) -> Self {
        Self::start_at(data, "127.0.0.1:0")
    }

    /// Starts it again where it was, after [`kill`](Self::kill).
    ///
    /// # Panics
    /// It does not say where it serves.
    pub fn start_again(&mut self, data: &Path) {
        *self = Self::start_at(data, &self.address);
    }

    fn start_at(data: &Path, listen: &str) -> Self {
        let library = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config");
        let mut child = Command::new(program())
            .args(["serve", "--listen", listen, "--workers", "2", "--data"])
            .arg(data)
            .arg("--library")
            .arg(library)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program starts");
        let mut line = String::new();
        let stdout = child.stdout.take().expect("it is piped");
        BufReader::new(stdout).read_line(&mut line).expect("it says something");
        let address = line.trim().rsplit("http://").next().unwrap_or_default().to_owned();
        assert!(address.starts_with("127.0.0.1:"), "{line}");
        Self { child, address }
    }

    /// Its URL.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
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

    /// SIGTERM; the exit code.
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
    /// No HTTP answer comes.
    pub fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Answer {
        let mut stream = self.send(method, path, headers, body);
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

    /// A connection on which nothing was said yet.
    ///
    /// # Panics
    /// The server does not listen.
    pub fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.address).expect("it listens");
        stream.set_read_timeout(Some(LIMIT)).expect("a time-out");
        stream
    }

    /// Sends a request and gives the open connection (HTTP/1.0: what comes is not cut into chunks).
    ///
    /// # Panics
    /// The server does not take it.
    pub fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> TcpStream {
        let mut stream = self.connect();
        let mut text = format!("{method} {path} HTTP/1.0\r\ncontent-length: {}\r\n", body.len());
        for (name, value) in headers {
            text += &format!("{name}: {value}\r\n");
        }
        if !body.is_empty() && !text.contains("content-type") {
            text += "content-type: application/json\r\n";
        }
        stream
            .write_all(format!("{text}\r\n{body}").as_bytes())
            .expect("it takes the request");
        stream
    }

    /// GET, as JSON; it must be there.
    ///
    /// # Panics
    /// It is not.
    pub fn get(&self, path: &str) -> Value {
        let answer = self.ask("GET", path, &[], "");
        assert_eq!(answer.status, 200, "{path}: {}", String::from_utf8_lossy(&answer.body));
        answer.json()
    }

    /// Submits a run that must be accepted; its id.
    ///
    /// # Panics
    /// It is not accepted.
    pub fn submit(&self, body: &Value) -> String {
        let answer = self.ask("POST", "/api/v1/runs", &[], &body.to_string());
        assert_eq!(answer.status, 202, "{}", String::from_utf8_lossy(&answer.body));
        answer.json()["id"].as_str().expect("an id").to_owned()
    }

    /// Waits until a run has ended; the run.
    ///
    /// # Panics
    /// It does not end.
    pub fn ended(&self, id: &str) -> Value {
        let mut run = Value::Null;
        let path = format!("/api/v1/runs/{id}");
        wait_until(Duration::from_secs(120), || {
            run = self.get(&path);
            !matches!(run["status"].as_str(), Some("queued" | "running"))
        })
        .unwrap_or_else(|| panic!("{run}"));
        run
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Err(error) = self.child.kill().and_then(|()| self.child.wait().map(|_| ())) {
            eprintln!("the server cannot be killed: {error}");
        }
    }
}
