//! A flight board in the place of the controller and, by choice, of the FDI engine.
//!
//! ```text
//!  plant ── SensorFrame ──▶ BoardLink ── frames ──▶ Line ──▶ board (crates/board)
//!        ◀── CommandFrame, FdiReport ──┘      ◀──
//! ```
//! * [`session`]: the plant's link to a board: hand-shake, download, one request a step, time-outs that name the board.
//! * [`mavlink`]: the part of MAVLink 2 that is spoken here.
//! * [`line`]: what carries bytes: a serial port, a pseudo-terminal with a virtual board behind it, the emulator.
//! * [`virtual_line`]: a virtual board behind a virtual serial line with baud, latency, jitter, loss, corruption and pulled plugs, in
//!   virtual time and seeded.
//! * [`autopilot`]: autopilots with a clock of their own, behind the protocols of their simulator builds.
//! * [`address`]: `serial:/dev/ttyACM0`, `pty`, `qemu`, `virtual`.
//! * [`boot_loader`], [`px4_file`]: PX4's boot loader, and the files that it takes.
//! * [`budget`]: bytes of a 400 Hz cycle against what a line carries.
//!
//! Lockstep: the plant waits for the board, so that a slow line slows a run and does not change it.

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
