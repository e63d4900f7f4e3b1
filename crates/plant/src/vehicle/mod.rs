//! The nominal vehicle, and how far a true one may be from it.

pub mod mismatch;
pub mod model;
