//! From duty to thrust: blades and their lift, rotors with lag and faults, and the battery that feeds them.

pub mod battery;
pub mod blades;
pub mod faults;
pub(crate) mod held;
pub mod rotors;
