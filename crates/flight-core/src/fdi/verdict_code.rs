//! Verdicts as numbers, in messages, tables and files: the paper's 0 and i, and those beyond it.
//!
//! A rotor has its number, from 1; two rotors i and j have 100 i + j. [`FaultVerdict::code`](super::FaultVerdict::code) gives the code of a
//! verdict. The label of the true fault uses the same numbers: [`UNKNOWN`] stands for several faulty rotors.

/// No fault.
pub const HEALTHY: i32 = 0;
/// A fault that matches no rotor; as a label: several rotors are faulty.
pub const UNKNOWN: i32 = -1;
/// The evaluator is not calibrated yet, or not present.
pub const NOT_READY: i32 = -2;
/// Several sets of rotors explain the fault.
pub const AMBIGUOUS: i32 = -3;
