//! Verdict codes in messages, tables and files: the paper's 0 and i, and extensions.
//!
//! A rotor has its 1-based number; two rotors i and j have 100 i + j. [`FaultVerdict::code`](super::FaultVerdict::code) returns the code
//! of a verdict. Labels of the true fault use the same numbers, with [`UNKNOWN`] for several faulty rotors.

/// No fault.
pub const HEALTHY: i32 = 0;
/// A fault that matches no rotor; as a label: several faulty rotors.
pub const UNKNOWN: i32 = -1;
/// The evaluator is not calibrated yet, or absent.
pub const NOT_READY: i32 = -2;
/// Several sets of rotors explain the fault.
pub const AMBIGUOUS: i32 = -3;
