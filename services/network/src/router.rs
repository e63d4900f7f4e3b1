//! `rotortwin router`: a zenoh router with this program's configuration, to which processes of runs connect.

use rotortwin_cli::network::router::Args;
use rotortwin_cli::output::{bad_input, failed, line};
use rotortwin_process::{LinkAddress, Supervisor};
use rotortwin_zenoh::endpoint::ZenohRouter;
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::time::Duration;

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
