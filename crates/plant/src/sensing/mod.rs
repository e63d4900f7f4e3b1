//! Sensor readings of the state: noise and faults.

pub mod faults;
pub mod home;
pub mod instruments;
pub mod readings;
pub mod sensors;
