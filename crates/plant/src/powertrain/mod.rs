//! From duty to thrust: blades and their lift, rotors with lag and faults, motors with their speed as a state, and the battery that feeds them.

pub mod battery;
pub mod blades;
pub mod faults;
pub(crate) mod held;
pub mod motor;
pub mod rotors;
