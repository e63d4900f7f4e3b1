//! Code of a flight board besides [`rotortwin_flight_core`]: the link to the host, the download of parameters, and the
//! application that combines them. `no_std`, no allocation, no hardware.
//!
//! ```text
//!  bytes ─▶ frame ─▶ message ─▶ application ─▶ control, fdi (flight-core)
//!        ◀──────────────────────────┘  ▲
//!                                      └── parameters (ControllerSetup and FdiSetup of proto/rotortwin/v1)
//! ```
//! * [`frame`]: COBS, CRC-32, sequence number, protocol version; resynchronises after garbage.
//! * [`message`]: content and size of the frames.
//! * [`parameters`]: decodes the handshake's protobuf messages without allocation.
//! * [`application`]: answers every request of the host; the only thing that a board has to run.
//!
//! A board adds byte input and output, a counter, and LEDs ([`application::Board`]). The same application runs on the host as a
//! *virtual board*, so that nearly all tests need neither emulator nor hardware.
//!
//! The host leads: a board only answers. One request is outstanding at a time; a repeated request gets the same answer again, so
//! that a lost, corrupted or duplicated frame never causes a second step.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod application;
pub mod frame;
pub mod message;
pub mod parameters;

/// Version of frames and messages; a board with a different version is rejected, naming both.
pub const PROTOCOL_VERSION: u8 = 2;
