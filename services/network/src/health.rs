//! `rotortwin health`: does a server answer, does a worker make progress? For health checks of containers that have no other tool.

use rotortwin_cli::network::health::Args;
use rotortwin_cli::output::{bad_input, failed};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Time-out for connecting, and for the answer.
const PROBE_TIMEOUT: Duration = Duration::from_secs(2);

/// Exit code 0 if healthy, 1 with a sentence if not.
pub(crate) fn run(args: &Args) -> ExitCode {
    let place = args.place.as_str();
    let plain = place.strip_prefix("tcp/").or_else(|| place.strip_prefix("tls/"));
    if let Some(data) = place.strip_prefix("worker:") {
        return match rotortwin_api::alive(Path::new(data), Duration::from_secs(args.silence)) {
            Ok(()) => ExitCode::SUCCESS,
            Err(sentence) => failed(sentence),
        };
    }
    let result = match plain {
        Some(host) => connect(host),
        None if place.starts_with("http://") || place.starts_with("https://") => get(place, args.ca.as_deref()),
        None => {
            return bad_input(format!(
                "{place}: expected http://HOST:PORT/PATH, https://HOST:PORT/PATH, tcp/HOST:PORT, tls/HOST:PORT or worker:DATA"
            ));
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(sentence) => failed(format!("{place}: {sentence}")),
    }
}

fn connect(host: &str) -> Result<(), String> {
    let mut last = "the name has no address".to_owned();
    for address in host.to_socket_addrs().map_err(|error| error.to_string())? {
        match TcpStream::connect_timeout(&address, PROBE_TIMEOUT) {
            Ok(_) => return Ok(()),
            Err(error) => last = error.to_string(),
        }
    }
    Err(last)
}

fn get(url: &str, ca: Option<&Path>) -> Result<(), String> {
    let told = |error: &dyn std::fmt::Display| error.to_string();
    if rustls::crypto::ring::default_provider().install_default().is_err() {
        tracing::debug!("TLS was set up before");
    }
    let certificates = match ca {
        None => Vec::new(),
        Some(path) => std::fs::read(path)
            .map_err(|error| format!("--ca {}: {error}", path.display()))
            .and_then(|pem| reqwest::Certificate::from_pem_bundle(&pem).map_err(|error| told(&error)))?,
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| told(&error))?;
    let answer = runtime.block_on(async {
        let client = reqwest::Client::builder()
            .timeout(PROBE_TIMEOUT)
            .tls_certs_only(certificates)
            .build()?;
        client.get(url).send().await
    });
    let answer = answer.map_err(|error| crate::remote::http::causes(&error))?;
    match answer.status().as_u16() {
        200 => Ok(()),
        other => Err(format!("the answer is {other}, expected 200")),
    }
}
