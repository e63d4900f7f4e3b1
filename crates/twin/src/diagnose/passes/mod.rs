//! The passes of a diagnosis: each has one job.

pub(crate) mod charge;
pub(crate) mod elimination;
pub(crate) mod goodness;
pub(crate) mod gusts;
pub(crate) mod held_out;
pub(crate) mod onset;
pub(crate) mod selection;
pub(crate) mod wiring;
