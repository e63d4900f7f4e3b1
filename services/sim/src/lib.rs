//! The plant process of a run: flies a scenario with the controller and the FDI engine over a link, and writes a run folder.
//!
//! ```text
//!  supervisor ── spawns ──▶ sim (this) ──link──▶ controller, fdi
//!       ▲                     │
//!       └── RunEvent lines ───┘──▶ run folder
//! ```
//! * [`session`]: one run from its scenario to its folder, over any link. Also used by the command line for in-process runs.
//! * [`recorder`]: samples into the telemetry spool, and events for a supervisor.
//! * [`commands`]: recorded autopilot commands for a replay.
//! * [`conditions`]: condition of each rotor and sensor at each step.
//! * [`events`]: those events, one JSON object per line on standard output.
//! * [`live`]: telemetry samples among them, for live viewers.
//! * [`network_over_time`]: the improved network over time, after the flight.
//! * [`second_look`]: current sizes and alternative explanations, after the flight.
//! * [`process`]: the process, with its arguments and signals.

pub mod commands;
pub mod conditions;
pub mod live;
mod measured;
pub mod network_over_time;
pub mod process;
pub mod recorder;
pub mod second_look;
pub mod session;
