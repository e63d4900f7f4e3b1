//! Wiring test: a gross error of the build is accepted where it removes nearly all of a large error of forces and
//! torques.

use super::Pass;
use crate::diagnose::named::Named;
use crate::diagnose::state::State;
use crate::diagnose::strategies::discrete::{excess, fitted, likeliest, without_nuisances};
use crate::estimation::columns::Active;
use crate::estimation::nuisances::Reach;
use crate::estimation::problem::Problem;
use crate::predict::PredictError;

/// Mean chi² of the torque channels about their means from which a gross error is looked for.
const LARGE_CHI2: f64 = 1.5;

/// Largest share of the excess chi² that may remain with the right wiring.
const LEFT_SHARE: f64 = 0.25;

pub(crate) struct WiringTest;

impl Pass for WiringTest {
    fn name(&self) -> &'static str {
        "Wiring test"
    }

    fn searches(&self) -> bool {
        true
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        let Some((active, gain)) = find(&state.problem) else {
            return Ok(());
        };
        state.named.push(Named {
            candidate: active.candidate,
            log_bayes_factor: gain,
            posterior: 1.0,
            minimum: f64::INFINITY,
            rivals: Vec::new(),
            together: false,
        });
        state.problem.active.push(active);
        state.problem.fit_nuisances(Reach::Plausible)
    }
}

/// The gross error that explains the flights, and half of the chi² that it removes.
fn find(problem: &Problem) -> Option<(Active, f64)> {
    if excess(&without_nuisances(problem), &[], None)?.torque < LARGE_CHI2 {
        return None;
    }
    let before = fitted(problem, &[])?;
    let (active, after) = likeliest(problem)?;
    let scatter = before.scatter();
    let right = after.fits()
        && after.moves_better_than(&before)
        && after.cost < (LEFT_SHARE * before.cost).max(scatter)
        && before.cost > 4.0 * scatter;
    right.then_some((active, 0.5 * (before.cost - after.cost)))
}
