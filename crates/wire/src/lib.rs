//! What the processes of a run say to each other, and over what.
//!
//! * [`frames`]: the native, fixed-size messages of the 400 Hz loop. iceoryx2 shares them as they are.
//! * [`proto`]: the same messages, and the hand-shake, as generated from `proto/rotortwin/v1`; what zenoh carries.
//! * [`convert`]: between the two; refuses what is not finite or out of range.
//! * [`setup`]: between the hand-shake's parameters and the configurations of `flight-core`.
//! * [`link`]: who stands on the other side ([`link::PlantLink`], [`link::ControllerPeer`], [`link::FdiPeer`]) over three back
//!   ends: in-process, iceoryx2, zenoh. They give the same answers, so a run has the same hash over each of them.
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

pub mod convert;
pub mod frames;
pub mod link;
pub mod peers;
pub mod setup;

/// Messages generated from `proto/rotortwin/v1` (`cargo xtask codegen`); documented in the `.proto` files.
#[expect(missing_docs, reason = "generated; the .proto files carry the documentation")]
pub mod proto {
    include!("proto/rotortwin.v1.rs");

    /// Serialized `FileDescriptorSet` of the package, for files that describe themselves (MCAP).
    pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("proto/descriptor.bin");
}

/// Version of the messages and of the hand-shake. Both sides must speak the same one.
pub const PROTOCOL_VERSION: u32 = 1;
