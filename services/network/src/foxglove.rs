//! `rotortwin fly --foxglove`: the server that implements the protocol.

use rotortwin_cli::foxglove::Viewers;
use rotortwin_foxglove::Server;
use rotortwin_scenario::Scenario;
use rotortwin_sim::session::telemetry_header;
use rotortwin_wire::events::LiveSample;
use std::net::SocketAddr;

struct Served(Server);

impl Viewers for Served {
    fn url(&self) -> String {
        format!("ws://{}", self.0.address())
    }

    fn sample(&mut self, sample: &LiveSample) {
        self.0.show(sample);
    }
}

/// Serves viewers of a flight of this scenario.
pub(crate) fn open(at: SocketAddr, scenario: &Scenario, run_id: u64) -> Result<Box<dyn Viewers>, String> {
    let name = format!("rotortwin: {}", scenario.name());
    let server = Server::listen(at, &name, &format!("{run_id:016x}"), &telemetry_header(scenario))?;
    Ok(Box::new(Served(server)))
}
