//! What a flight board runs besides [`rotortwin_flight_core`]: the link to the host, the download of parameters, and the
//! application that joins them. `no_std`, no allocation, no hardware.
//!
//! ```text
//!  bytes ─▶ frame ─▶ message ─▶ application ─▶ control, fdi (flight-core)
//!        ◀──────────────────────────┘  ▲
//!                                      └── parameters (ControllerSetup and FdiSetup of proto/rotortwin/v1)
//! ```
//! * [`frame`]: COBS, CRC-32, sequence number, protocol version; finds its way back after garbage.
//! * [`message`]: what the frames carry, and how many bytes that takes.
//! * [`parameters`]: reads the hand-shake's protobuf messages without allocation.
//! * [`application`]: answers every request of the host; the one thing that a board has to run.
//!
//! A board adds bytes in and out, a counter of its own time, and its lamps ([`application::Board`]). The same application runs on
//! the host as a *virtual board*, so that nearly all tests need neither emulator nor hardware.
//!
//! The host leads: a board only ever answers. One request is outstanding at a time; a request that is repeated gets the answer that it
//! got before, so that a lost, damaged or doubled frame never makes a step happen twice.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod application;
pub mod frame;
pub mod message;
pub mod parameters;

/// Version of frames and messages; a board of another version is refused, with both numbers.
pub const PROTOCOL_VERSION: u8 = 2;
