//! The plant process of a run: flies a scenario with the controller and the FDI engine behind a link, and leaves a run folder.
//!
//! ```text
//!  supervisor ── spawns ──▶ sim (this) ──link──▶ controller, fdi
//!       ▲                     │
//!       └── RunEvent lines ───┘──▶ run folder
//! ```
//! * [`session`]: one run from its scenario to its folder, over any link. The in-process run of the command line uses it too.
//! * [`recorder`]: samples into the telemetry spool, and the events that a supervisor shows.
//! * [`commands`]: what an autopilot sent, kept for a replay.
//! * [`conditions`]: what is wrong with which rotor at which step, in words.
//! * [`events`]: those events, one JSON object a line on standard output.
//! * [`live`]: samples of the telemetry among them, for people who look on.
//! * [`process`]: what the process does with its arguments and signals.

pub mod commands;
pub mod conditions;
pub mod live;
pub mod process;
pub mod recorder;
pub mod session;
