//! The messages between the processes of a run, and the link abstraction that carries them.
//!
//! * [`frames`]: the native, fixed-size messages of the 400 Hz loop. iceoryx2 shares them as they are.
//! * [`convert`]: between those and the generated messages of `rotortwin-proto`, which zenoh carries; rejects values that are not finite or out
//!   of range.
//! * [`setup`]: between the handshake's parameters and the configurations of `flight-core`.
//! * [`link`]: the other side ([`link::PlantLink`], [`link::ControllerPeer`], [`link::FdiPeer`]) and the link within one
//!   process; those between processes are in `rotortwin-links`. A run has the same hash over each of them.
//! * [`autopilot`]: an autopilot with its own instruments and clock, in place of the controller.
//! * [`autopilot_commands`]: what it commanded, as recorded for a replay.
//! * [`events`]: progress events of a run.
//! * [`peers`]: our own controller and FDI engine behind those traits.
//!
//! ```text
//!  plant ── SensorFrame ──▶ controller ── CommandFrame ──▶ plant
//!    │                          │
//!    └──── SensorFrame ────┐    └── CommandFrame ──┐
//!                          ▼                       ▼
//!                          fdi ─────────── FdiReport ──▶ plant
//! ```
//! This crate contains no mathematics, and no clock affects the simulated world: clocks only bound how long a peer may be
//! silent.

pub mod autopilot;
pub mod autopilot_commands;
pub mod convert;
pub mod events;
pub mod frames;
pub mod link;
pub mod peers;
pub mod setup;

/// Version of the messages and of the handshake. Must match on both sides.
pub const PROTOCOL_VERSION: u32 = 1;
