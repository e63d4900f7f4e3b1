//! Estimates: final values of the named effects, averaged over the vehicle's possible distance from its nominal values;
//! which of them are impossible.

use rotortwin_plant::effects::EffectClass;

use super::Pass;
use crate::diagnose::result::Calibration;
use crate::diagnose::state::{Doubt, State};
use crate::diagnose::{air, calibration, findings, picture, words};
use crate::estimation::settle::averaged;
use crate::predict::PredictError;

pub(crate) struct Estimates;

impl Pass for Estimates {
    fn name(&self) -> &'static str {
        "Estimates"
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        let posterior = match &state.weather {
            Some(gusts) => gusts.posterior.clone(),
            None => match averaged(&state.problem) {
                Some(averaged) => averaged,
                None => state.posterior()?,
            },
        };
        state.diagnosis.winds = air::winds(&state.problem, &posterior);
        let named = std::mem::take(&mut state.named);
        let (mut found, impossible) = findings::findings(&state.problem, named, &posterior);
        let unproved = calibration::without_proof(&mut found, &state.problem)?;
        if !unproved.is_empty() {
            state.diagnosis.notes.push(format!(
                "rejected: an error by a factor of {}, which explains less than half of what was measured where it shows most",
                unproved.iter().map(|label| words::in_sentence(label)).collect::<Vec<_>>().join(", ")
            ));
        }
        let parted = calibration::set_apart(found, &state.problem.library);
        let mut found = parted.found;
        let impossible_constants: Vec<Calibration>;
        (state.diagnosis.calibrate, impossible_constants) =
            parted.calibrations.into_iter().partition(calibration::can_be);
        if !parted.withheld.is_empty() {
            state.diagnosis.notes.push(format!(
                "not named before the guessed constants are known, because it may only compensate for them: {}",
                parted.withheld.join(", ")
            ));
        }
        let gusts = state.weather.as_ref();
        found.extend(gusts.and_then(|gusts| findings::weather_finding(&state.problem, gusts)));
        let (physics, faults) = found
            .into_iter()
            .partition(|finding| matches!(finding.class, EffectClass::Physics | EffectClass::Noise));
        (state.diagnosis.effects, state.diagnosis.sensor_or_timing) = (physics, faults);
        let diagnosis = &mut state.diagnosis;
        let drawn = diagnosis.effects.iter_mut().chain(&mut diagnosis.sensor_or_timing);
        picture::draw(&state.problem, &mut drawn.collect::<Vec<_>>())?;
        state.doubts.extend(impossible.into_iter().map(Doubt::ImpossibleSize));
        state.doubts.extend(
            impossible_constants
                .into_iter()
                .map(|one| Doubt::ImpossibleConstant(one.name)),
        );
        if findings::look_alikes(&state.problem) {
            state.doubts.push(Doubt::LookAlikes);
        }
        Ok(())
    }
}
