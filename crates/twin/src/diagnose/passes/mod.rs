//! The passes of a diagnosis: each has one job. `search` has them in their order.

pub(crate) mod charge;
pub(crate) mod coverage;
pub(crate) mod elimination;
pub(crate) mod estimates;
pub(crate) mod goodness;
pub(crate) mod gusts;
pub(crate) mod held_out;
pub(crate) mod nuisances;
pub(crate) mod onset;
pub(crate) mod reconsideration;
mod refinement;
pub(crate) mod selection;
pub(crate) mod verdict;
pub(crate) mod wiring;

use super::state::State;
use crate::predict::PredictError;

/// One pass over the state of a search.
pub(crate) trait Pass: Sync {
    /// What it is called, also in docs/diagnose.md.
    fn name(&self) -> &'static str;

    /// True for passes that look for further explanations: left out once the time is up.
    fn searches(&self) -> bool {
        false
    }

    /// Runs the pass.
    ///
    /// # Errors
    /// One sentence: the effects together yield an invalid vehicle, or numbers of the log cannot be fitted.
    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError>;
}
