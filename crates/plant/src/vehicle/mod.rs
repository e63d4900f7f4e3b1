//! The nominal vehicle, how far a true one may be from it, and what it drops.

pub mod load;
pub mod mismatch;
pub mod model;
