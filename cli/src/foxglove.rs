//! `rotortwin fly --foxglove [ADDR]`: live display in Foxglove and Lichtblick.
//!
//! The protocol is implemented by `rotortwin-network`, which needs a WebSocket library anyway and registers it with
//! [`provide`].

use rotortwin_scenario::Scenario;
use rotortwin_wire::events::LiveSample;
use std::net::SocketAddr;
use std::sync::OnceLock;

/// Default address for viewers.
pub(crate) const DEFAULT_ADDRESS: &str = "127.0.0.1:8765";
/// Default samples per second of simulated time.
pub(crate) const RATE_HZ: f64 = 50.0;

/// Shows a flight to viewers; never waits for them.
pub trait Viewers {
    /// Where they connect.
    fn url(&self) -> String;
    /// A row of the telemetry.
    fn sample(&mut self, sample: &LiveSample);
}

/// Starts serving viewers; the error is a message. The number distinguishes runs.
pub type Open = fn(SocketAddr, &Scenario, u64) -> Result<Box<dyn Viewers>, String>;

static OPEN: OnceLock<Open> = OnceLock::new();

/// Registers the implementation; the first registration wins.
pub fn provide(open: Open) {
    OPEN.get_or_init(|| open);
}

/// Opens the registered implementation.
pub(crate) fn open(at: SocketAddr, scenario: &Scenario, run_id: u64) -> Result<Box<dyn Viewers>, String> {
    let open = OPEN
        .get()
        .ok_or_else(|| format!("--foxglove {at}: this program has no WebSocket support; expected rotortwin-network"))?;
    open(at, scenario, run_id)
}

/// Parses an address, with an error message that states what was expected.
pub(crate) fn parse_address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_error| {
        format!("'{text}': expected IP:PORT, such as {DEFAULT_ADDRESS}, or nothing; put the scenario before --foxglove")
    })
}
