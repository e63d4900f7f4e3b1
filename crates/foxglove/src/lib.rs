//! Live display of flights in Foxglove and Lichtblick, over Foxglove's WebSocket protocol.
//!
//! ```text
//!  LiveSample ─▶ Encoder ─▶ Row ─┬─▶ Server: one thread a viewer ─▶ WebSocket         rotortwin fly --foxglove
//!                                └─▶ Viewer (subscriptions, frames) in a task         GET /api/v1/runs/{id}/foxglove
//! ```
//! The flight never waits: a slow viewer loses rows and is informed of their number, a disconnected one is removed.
//!
//! This is our own server, not that of Foxglove's Rust library, because that brings an asynchronous runtime and forty packages for three
//! text messages and two binary ones: docs/decisions/0073.

pub mod protocol;
pub mod server;

pub use protocol::{Encoder, Row, SUBPROTOCOLS, Viewer};
pub use server::Server;
