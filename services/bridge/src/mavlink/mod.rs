//! The supported subset of MAVLink 2: frames and a handful of messages, little endian, unsigned.
//!
//! Implemented here instead of using a crate: see decision 36. Field orders, sizes and CRC extras are those of the common dialect; the
//! tests compare the encoding with pymavlink's.

pub mod broadcast;
pub mod catalogue;
pub mod frame;
#[cfg(test)]
mod hex;
pub mod messages;
mod reader;
pub mod steering;
