//! Flights shown live in Foxglove and Lichtblick, over Foxglove's WebSocket protocol.
//!
//! ```text
//!  LiveSample ─▶ Encoder ─▶ Row ─┬─▶ Server: one thread a viewer ─▶ WebSocket         rotortwin fly --foxglove
//!                                └─▶ Viewer (subscriptions, frames) in a task         GET /api/v1/runs/{id}/foxglove
//! ```
//! The flight waits for nobody: a viewer who is too slow loses rows and is told how many, one who is gone is forgotten.
//!
//! It is our own server, and not that of Foxglove's library for Rust, because that brings an asynchronous runtime and forty packages for
//! three messages of text and two of bytes: docs/decisions/0073.

pub mod protocol;
pub mod server;

pub use protocol::{Encoder, Row, SUBPROTOCOLS, Viewer};
pub use server::Server;
