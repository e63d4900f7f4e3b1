//! What the processes of a run say to each other, and over what.
//!
//! * [`frames`]: the native, fixed-size messages of the 400 Hz loop. iceoryx2 shares them as they are.
//! * [`convert`]: between those and the generated messages of `rotortwin-proto`, which zenoh carries; refuses what is not finite or out of range.
//! * [`setup`]: between the hand-shake's parameters and the configurations of `flight-core`.
//! * [`link`]: who stands on the other side ([`link::PlantLink`], [`link::ControllerPeer`], [`link::FdiPeer`]) and the link
//!   within one process; those between processes are in `rotortwin-links`. A run has the same hash over each of them.
//! * [`autopilot`]: an autopilot with instruments and a clock of its own in the place of the controller.
//! * [`events`]: what a run reports while it goes on.
//! * [`peers`]: our own controller and FDI engine behind those traits.
//!
//! ```text
//!  plant ── SensorFrame ──▶ controller ── CommandFrame ──▶ plant
//!    │                          │
//!    └──── SensorFrame ────┐    └── CommandFrame ──┐
//!                          ▼                       ▼
//!                          fdi ─────────── FdiReport ──▶ plant
//! ```
//! No mathematics lives here and no clock decides anything about the simulated world: clocks only bound how long a peer may be
//! silent.

pub mod autopilot;
pub mod convert;
pub mod events;
pub mod frames;
pub mod link;
pub mod peers;
pub mod setup;

/// Version of the messages and of the hand-shake. Both sides must speak the same one.
pub const PROTOCOL_VERSION: u32 = 1;
