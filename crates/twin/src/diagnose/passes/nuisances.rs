//! Nuisance fit: rotor biases and the charge at the start, which every flight has.

use super::Pass;
use crate::diagnose::state::State;
use crate::estimation::nuisances::Reach;
use crate::predict::PredictError;

pub(crate) struct NuisanceFit;

impl Pass for NuisanceFit {
    fn name(&self) -> &'static str {
        "Nuisance fit"
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        state.problem.fit_nuisances(Reach::Plausible)?;
        state.compared = state.problem.logs.clone();
        state.plain = state.problem.logs.iter().map(|log| log.nuisances).collect();
        Ok(())
    }
}
