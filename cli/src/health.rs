//! `rotortwin health`: does somebody answer? For health checks of containers, which have no other program to ask.

use crate::output::{bad_input, failed};
use clap::Parser;
use std::io::{Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::process::ExitCode;
use std::time::Duration;

/// For each of connecting, sending and the answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// Arguments of `rotortwin health`.
#[derive(Debug, Parser)]
pub(crate) struct Args {
    /// http://HOST:PORT/PATH: answers with 200; tcp/HOST:PORT or tls/HOST:PORT: takes connections
    place: String,
}

/// Exit code 0 if it is well, 1 with a sentence if not.
pub(crate) fn run(args: &Args) -> ExitCode {
    let http = args.place.strip_prefix("http://");
    let plain = args
        .place
        .strip_prefix("tcp/")
        .or_else(|| args.place.strip_prefix("tls/"));
    let result = match (http, plain) {
        (Some(rest), _) => {
            let (host, path) = rest.split_once('/').unwrap_or((rest, ""));
            connect(host).and_then(|stream| get(stream, host, path))
        }
        (None, Some(host)) => connect(host).map(|_| ()),
        (None, None) => {
            return bad_input(format!(
                "{}: expected http://HOST:PORT/PATH, tcp/HOST:PORT or tls/HOST:PORT",
                args.place
            ));
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(sentence) => failed(format!("{}: {sentence}", args.place)),
    }
}

fn connect(host: &str) -> Result<TcpStream, String> {
    let mut last = "the name has no address".to_owned();
    for address in host.to_socket_addrs().map_err(|error| error.to_string())? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error.to_string(),
        }
    }
    Err(last)
}

fn get(mut stream: TcpStream, host: &str, path: &str) -> Result<(), String> {
    let told = |error: std::io::Error| error.to_string();
    stream.set_read_timeout(Some(PATIENCE)).map_err(told)?;
    stream.set_write_timeout(Some(PATIENCE)).map_err(told)?;
    let request = format!("GET /{path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).map_err(told)?;
    // "HTTP/1.1 200"
    let mut status = [0; 12];
    stream.read_exact(&mut status).map_err(told)?;
    match &status[9..] {
        b"200" => Ok(()),
        other => Err(format!(
            "the answer is {}, expected 200",
            String::from_utf8_lossy(other)
        )),
    }
}
