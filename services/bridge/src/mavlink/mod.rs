//! MAVLink 2, as far as it is spoken here: frames and a handful of messages, little endian, unsigned.
//!
//! Written out instead of taken from a crate: see decision 36. Field orders, sizes and CRC extras are those of the common dialect; the
//! tests hold the bytes against pymavlink's.

pub mod broadcast;
pub mod catalogue;
pub mod frame;
#[cfg(test)]
mod hex;
pub mod messages;
mod reader;
pub mod steering;
