//! `rotortwin fly --foxglove [ADDR]`: the flight live in Foxglove and Lichtblick.
//!
//! Their protocol is spoken by `rotortwin-network`, which has a WebSocket library anyway; it says so with [`provide`].

use rotortwin_scenario::Scenario;
use rotortwin_wire::events::LiveSample;
use std::net::SocketAddr;
use std::sync::OnceLock;

/// Where viewers look first.
pub(crate) const DEFAULT_ADDRESS: &str = "127.0.0.1:8765";
/// Samples a second of simulated time, where nobody asks for another number.
pub(crate) const RATE_HZ: f64 = 50.0;

/// Shows a flight to whoever looks on; never waits for anybody.
pub trait Viewers {
    /// Where they connect.
    fn url(&self) -> String;
    /// A row of the telemetry.
    fn sample(&mut self, sample: &LiveSample);
}

/// Begins to serve viewers; an error is one sentence. The number tells runs apart.
pub type Open = fn(SocketAddr, &Scenario, u64) -> Result<Box<dyn Viewers>, String>;

static OPEN: OnceLock<Open> = OnceLock::new();

/// Says how viewers are served; the first word counts.
pub fn provide(open: Open) {
    OPEN.get_or_init(|| open);
}

/// Opens what was provided.
pub(crate) fn open(at: SocketAddr, scenario: &Scenario, run_id: u64) -> Result<Box<dyn Viewers>, String> {
    let open = OPEN
        .get()
        .ok_or_else(|| format!("--foxglove {at}: this program knows no WebSockets; expected rotortwin-network"))?;
    open(at, scenario, run_id)
}

/// Reads an address, and says what it expected otherwise.
pub(crate) fn parse_address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_error| {
        format!(
            "'{text}': expected IP:PORT, such as {DEFAULT_ADDRESS}, or nothing; the scenario stands before --foxglove"
        )
    })
}
