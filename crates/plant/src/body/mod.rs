//! The vehicle as a rigid body: its motion, what acts on it from outside, and the integration of the whole plant.

pub(crate) mod contact;
pub(crate) mod dynamics;
pub mod environment;
pub mod ground;
pub mod rigid_body;
