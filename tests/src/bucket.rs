//! An S3-compatible store for tests.

use crate::process::wait_until;
use crate::python::environment;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// An S3-compatible store in a separate process; killed on drop.
pub struct Bucket {
    child: Child,
    port: u16,
}

impl Bucket {
    const NAME: &str = "rotortwin-files";

    /// `None` if none is available here.
    ///
    /// # Panics
    /// It cannot be started.
    pub fn start() -> Option<Self> {
        let programs = environment("s3-environment", &["moto[server]==5.1.16"])?;
        let port = TcpListener::bind("127.0.0.1:0")
            .and_then(|listener| listener.local_addr())
            .expect("a port")
            .port();
        let child = Command::new(programs.join("moto_server"))
            .args(["-H", "127.0.0.1", "-p", &port.to_string()])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("it starts");
        let bucket = Self { child, port };
        let up = wait_until(Duration::from_secs(60), || {
            TcpStream::connect(("127.0.0.1", port)).is_ok()
        });
        assert!(up.is_some(), "the store answers");
        bucket.ask("PUT", "");
        Some(bucket)
    }

    /// Writes an object, replacing any existing one.
    ///
    /// # Panics
    /// It does not answer.
    pub fn put(&self, key: &str, content: &str) {
        self.ask_with("PUT", &format!("/{key}"), content);
    }

    fn ask(&self, method: &str, query: &str) -> String {
        self.ask_with(method, query, "")
    }

    fn ask_with(&self, method: &str, rest: &str, content: &str) -> String {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).expect("it listens");
        let request = format!(
            "{method} /{}{rest} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{content}",
            Self::NAME,
            content.len()
        );
        stream.write_all(request.as_bytes()).expect("sent");
        let mut answer = Vec::new();
        match stream.read_to_end(&mut answer) {
            // The store may close before it has read all of a request that it has already answered.
            Err(error) if error.kind() == ErrorKind::ConnectionReset && !answer.is_empty() => {}
            read => assert!(read.is_ok(), "an answer: {read:?}"),
        }
        let answer = String::from_utf8_lossy(&answer).into_owned();
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
        answer
    }

    /// Keys of all objects.
    ///
    /// # Panics
    /// It does not answer.
    pub fn keys(&self) -> Vec<String> {
        self.ask("GET", "?list-type=2")
            .split("<Key>")
            .skip(1)
            .filter_map(|part| part.split_once("</Key>"))
            .map(|(key, _)| key.to_owned())
            .collect()
    }

    /// Environment for a program to access it.
    pub fn environment(&self) -> [(&'static str, String); 5] {
        [
            ("AWS_ACCESS_KEY_ID", "test".to_owned()),
            ("AWS_SECRET_ACCESS_KEY", "test".to_owned()),
            ("AWS_REGION", "us-east-1".to_owned()),
            ("AWS_ENDPOINT", format!("http://127.0.0.1:{}", self.port)),
            ("AWS_ALLOW_HTTP", "true".to_owned()),
        ]
    }

    /// The address of a prefix in it.
    pub fn address(&self, prefix: &str) -> String {
        format!("s3://{}/{prefix}", Self::NAME)
    }
}

impl Drop for Bucket {
    fn drop(&mut self) {
        if let Err(error) = self.child.kill().and_then(|()| self.child.wait().map(|_| ())) {
            eprintln!("the store cannot be killed: {error}");
        }
    }
}
