//! Response time of the server to telemetry queries: the reference flight on a dedicated server, 60 channels in 2000 points.
//!
//! Over loopback, without compression, one connection per query, from its opening to the last byte.

use crate::bench::{Spread, machine};
use anyhow::{Context, Result, bail};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const CHANNELS: usize = 60;
const REPETITIONS: usize = 50;

/// Killed on drop.
struct Server {
    child: Child,
    address: String,
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Err(error) = self.child.kill().and_then(|()| self.child.wait().map(|_| ())) {
            eprintln!("the server cannot be killed: {error}");
        }
    }
}

impl Server {
    fn start(root: &Path, data: &Path) -> Result<Self> {
        let mut child = Command::new(root.join("target/release/rotortwin"))
            .args(["serve", "--listen", "127.0.0.1:0", "--workers", "1", "--library"])
            .arg(root.join("config"))
            .arg("--data")
            .arg(data)
            .stdout(Stdio::piped())
            .spawn()
            .context("starting the server")?;
        let mut line = String::new();
        let stdout = child.stdout.take().context("it is piped")?;
        BufReader::new(stdout).read_line(&mut line)?;
        let address = line.trim().rsplit("http://").next().unwrap_or_default().to_owned();
        Ok(Self { child, address })
    }

    /// Body of the response, which must be a success.
    fn ask(&self, method: &str, path: &str, body: &str) -> Result<Vec<u8>> {
        let mut stream = TcpStream::connect(&self.address)?;
        let length = body.len();
        let head = "content-type: application/json\r\ncontent-length:";
        write!(stream, "{method} {path} HTTP/1.0\r\n{head} {length}\r\n\r\n{body}")?;
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer)?;
        let split = answer
            .windows(4)
            .position(|four| four == b"\r\n\r\n")
            .context("no headers")?;
        if !answer.starts_with(b"HTTP/1.0 2") {
            bail!("{method} {path}: {}", String::from_utf8_lossy(&answer));
        }
        Ok(answer.split_off(split + 4))
    }

    fn json(&self, method: &str, path: &str, body: &str) -> Result<serde_json::Value> {
        Ok(serde_json::from_slice(&self.ask(method, path, body)?)?)
    }

    /// Times of repeated queries, ms, and the bytes of a response.
    fn time(&self, path: &str) -> Result<(Spread, usize)> {
        let (mut times, mut bytes) = (Vec::new(), 0);
        for _ in 0..REPETITIONS {
            let start = Instant::now();
            bytes = self.ask("GET", path, "")?.len();
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        Ok((Spread::of(times), bytes))
    }
}

/// Measures and prints.
pub(crate) fn run(root: &Path) -> Result<()> {
    crate::command::build(root, &["--bin", "rotortwin", "--bin", "rotortwin-network"])?;
    let data = std::env::temp_dir().join(format!("rotortwin-telemetry-bench-{}", std::process::id()));
    let measured = measure(root, &data);
    std::fs::remove_dir_all(&data).with_context(|| format!("removing {}", data.display()))?;
    measured
}

fn measure(root: &Path, data: &Path) -> Result<()> {
    let server = Server::start(root, data)?;
    let run = server.json(
        "POST",
        "/api/v1/runs",
        r#"{"scenario":"reference-flight","link":"in-process"}"#,
    )?;
    let id = run["id"].as_str().context("a run has an id")?;
    let deadline = Instant::now() + Duration::from_secs(120);
    loop {
        let run = server.json("GET", &format!("/api/v1/runs/{id}"), "")?;
        match run["status"].as_str() {
            Some("done") => break,
            Some("queued" | "running") if Instant::now() < deadline => std::thread::sleep(Duration::from_millis(100)),
            _ => bail!("the flight was not done: {run}"),
        }
    }
    let channels = server.json("GET", &format!("/api/v1/runs/{id}/channels"), "")?;
    let names = channels["items"].as_array().context("a list")?.iter();
    let names: Vec<&str> = names
        .filter_map(|item| item["name"].as_str())
        .filter(|name| *name != "time_s")
        .collect();
    if names.len() < CHANNELS {
        bail!("the run has {} channels; expected at least {CHANNELS}", names.len());
    }
    println!("{}", machine());
    println!(
        "{} samples of {CHANNELS} channels, 2000 points, {REPETITIONS} queries: median (lowest – highest), ms",
        channels["rows"]
    );
    let all = format!(
        "/api/v1/runs/{id}/telemetry?points=2000&channels={}",
        names[..CHANNELS].join(",")
    );
    let one = format!("/api/v1/runs/{id}/telemetry?points=2000&channels=roll_rad");
    for (name, path) in [
        ("JSON", all.clone()),
        ("CSV", format!("{all}&format=csv")),
        ("Parquet", format!("{all}&format=parquet")),
        ("JSON, 10 s", format!("{all}&from_s=40&to_s=50")),
        ("JSON, one channel", one),
    ] {
        let (spread, bytes) = server.time(&path)?;
        println!("  {name:<18} {spread}   {:.0} kB", bytes as f64 / 1e3);
    }
    Ok(())
}
