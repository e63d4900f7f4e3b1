//! `rotortwin serve`: the HTTP server.

use crate::output::{bad_input, failed, line};
use clap::Parser;
use rotortwin_api::{ServeConfig, Server};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin serve`.
#[derive(Debug, Parser)]
pub(crate) struct Args {
    /// Address to listen on; loopback only, port 0: a free one
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8400")]
    listen: SocketAddr,
    /// Folder for the database and the runs; one server each
    #[arg(long, value_name = "DIR", default_value = "data")]
    data: PathBuf,
    /// Scenarios and vehicles that clients can name, laid out as config/
    #[arg(long, value_name = "DIR", default_value = "config")]
    library: PathBuf,
    /// Runs that are flown at the same time [default: half of the CPUs]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    workers: Option<u16>,
    /// Print the OpenAPI document and end
    #[arg(long)]
    openapi: bool,
}

/// Serves until Ctrl-C or SIGTERM.
pub(crate) fn run(args: &Args) -> ExitCode {
    if args.openapi {
        print!("{}", rotortwin_api::openapi_document());
        return ExitCode::SUCCESS;
    }
    rotortwin_process::start_logging();
    let program = match std::env::current_exe() {
        Ok(program) => program,
        Err(error) => return failed(format!("the path of this program cannot be read: {error}")),
    };
    let cpus = std::thread::available_parallelism().map_or(1, usize::from);
    let config = ServeConfig {
        listen: args.listen,
        data: args.data.clone(),
        library: args.library.clone(),
        workers: args.workers.map_or_else(|| (cpus / 2).max(1), usize::from),
        program,
    };
    let runtime = match tokio::runtime::Builder::new_multi_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => return failed(format!("the server cannot start its threads: {error}")),
    };
    runtime.block_on(async {
        let server = match Server::open(config).await {
            Ok(server) => server,
            Err(sentence) => return bad_input(sentence),
        };
        line(&format!("Serving      http://{}", server.address()));
        match server.run(stopped()).await {
            Ok(()) => ExitCode::SUCCESS,
            Err(sentence) => failed(sentence),
        }
    })
}

/// Ready once somebody wants the server to end.
async fn stopped() {
    use tokio::signal::unix::{SignalKind, signal};
    match signal(SignalKind::terminate()) {
        Ok(mut terminate) => {
            tokio::select! {
                _ = tokio::signal::ctrl_c() => {}
                _ = terminate.recv() => {}
            }
        }
        Err(error) => {
            tracing::warn!(%error, "SIGTERM cannot be handled");
            if let Err(error) = tokio::signal::ctrl_c().await {
                tracing::warn!(%error, "Ctrl-C cannot be handled");
            }
        }
    }
}
