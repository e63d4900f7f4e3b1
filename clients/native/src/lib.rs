//! `rotortwin._native`: what the Python package computes in its own process, without a server.
//!
//! * [`scenario`]: what is flown. * [`flight`]: one flight, a step at a time. * [`batch`]: many at once. * [`twin`]: logs against models.
//! * [`campaign`]: flights of a campaign, and verdicts of one's own on them. * [`interrupt`]: Ctrl-C in all of them. * [`recorded`]: runs that are complete, and verdicts of one's own on them. * [`columns`]: telemetry as NumPy arrays.
//!
//! Python sees it through `clients/python/src/rotortwin/{simulation,analysis,detectors,gym}.py`, which documents units, frames and shapes. Whatever
//! takes longer than a step runs without Python's lock and ends with `KeyboardInterrupt` on Ctrl-C.

use pyo3::prelude::*;

mod batch;
mod campaign;
mod columns;
mod flight;
mod interrupt;
mod recorded;
mod refusal;
mod scenario;
mod twin;

/// See the crate.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::batch::{SimulationBatch, fly};
    #[pymodule_export]
    use super::campaign::CampaignFlights;
    #[pymodule_export]
    use super::flight::Simulation;
    #[pymodule_export]
    use super::recorded::{judge, recorded};
    #[pymodule_export]
    use super::refusal::{FlightError, InputError};
    #[pymodule_export]
    use super::scenario::Scenario;
    #[pymodule_export]
    use super::twin::{compare, diagnose, fdi_log, identify, improve};
}
