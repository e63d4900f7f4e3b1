//! `rotortwin router`: a zenoh router with this program's configuration, where processes of runs meet.

use crate::output::{bad_input, failed, line};
use clap::Parser;
use rotortwin_links::zenoh::ZenohRouter;
use rotortwin_process::{LinkAddress, Supervisor};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Arguments of `rotortwin router`.
#[derive(Debug, Parser)]
pub(crate) struct Args {
    /// Endpoint to listen on, e.g. tls/0.0.0.0:7447
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7447")]
    listen: String,
    /// Certificates, users and who may do what: docs/hosts.md
    #[arg(long, value_name = "FILE")]
    zenoh_config: Option<PathBuf>,
}

/// Routes until Ctrl-C or SIGTERM.
pub(crate) fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    let address = match format!("zenoh:listen={}", args.listen).parse::<LinkAddress>() {
        Ok(address) => match &args.zenoh_config {
            Some(file) => address.with_config(file.clone()),
            None => address,
        },
        Err(error) => return bad_input(format!("--listen: {error}")),
    };
    let security = match address.probe().and_then(|()| address.security()) {
        Ok(security) => security,
        Err(sentence) => return bad_input(sentence),
    };
    let LinkAddress::ZenohListen { endpoint, .. } = &address else {
        return bad_input("--listen: expected an endpoint of zenoh");
    };
    let supervisor = match Supervisor::watch(false) {
        Ok(supervisor) => supervisor,
        Err(error) => return failed(format!("Ctrl-C cannot be handled: {error}")),
    };
    let router = match ZenohRouter::listen(endpoint.clone(), security) {
        Ok(router) => router,
        Err(error) => return bad_input(error),
    };
    line(&format!("Routing      {endpoint}"));
    let stop = supervisor.stop_flag();
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
    match router.close() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => failed(error),
    }
}
