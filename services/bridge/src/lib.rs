//! A flight board in place of the controller and, optionally, of the FDI engine.
//!
//! ```text
//!  plant ── SensorFrame ──▶ BoardLink ── frames ──▶ Line ──▶ board (crates/board)
//!        ◀── CommandFrame, FdiReport ──┘      ◀──
//! ```
//! * [`session`]: the plant's link to a board: handshake, download, one request per step, time-outs that name the board.
//! * [`mavlink`]: the supported subset of MAVLink 2.
//! * [`line`]: byte transports: a serial port, a pseudo-terminal with a virtual board behind it, the emulator.
//! * [`virtual_line`]: a virtual board behind a virtual serial line with baud, latency, jitter, loss, corruption and unplugging, in
//!   virtual time and seeded.
//! * [`autopilot`]: autopilots with their own clock, with the protocols of their simulator builds.
//! * [`address`]: `serial:/dev/ttyACM0`, `pty`, `qemu`, `virtual`.
//! * [`boot_loader`], [`px4_file`]: PX4's boot loader, and its firmware files.
//! * [`budget`]: bytes of a 400 Hz cycle compared with the capacity of a line.
//!
//! Lockstep: the plant waits for the board, so that a slow line slows a run down without changing it.

pub mod address;
pub mod autopilot;
pub mod boot_loader;
pub mod budget;
pub mod line;
pub mod mavlink;
pub mod px4_file;
pub mod session;
mod shadow;
pub mod virtual_line;
