//! What was found and is no missing physics: a constant that was guessed, and that the flights want to have another value.
//!
//! A vehicle of which no log told the inertia has that of its class. A flight that then needs another inertia does not lack an
//! effect; it calls for a calibration, and what else it seems to lack is told once that is made.

use rotortwin_plant::effects::CorrectionScale;

use super::result::{Calibration, Finding};
use crate::estimation::candidates::Library;

/// Takes the findings that are errors of guessed constants out of the others. Of several that are errors of one constant the first
/// is told.
pub(crate) fn set_apart(found: Vec<Finding>, library: &Library) -> (Vec<Finding>, Vec<Calibration>) {
    let mut calibrations: Vec<Calibration> = Vec::new();
    let rest = found
        .into_iter()
        .filter(|finding| {
            let Some(wanted) = calibration(finding, library) else {
                return true;
            };
            if calibrations.iter().all(|known| known.key != wanted.key) {
                calibrations.push(wanted);
            }
            false
        })
        .collect();
    (rest, calibrations)
}

fn calibration(finding: &Finding, library: &Library) -> Option<Calibration> {
    let instance = &finding.instance;
    let candidate = library
        .candidates
        .iter()
        .find(|c| c.declaration.id == instance.effect && c.rotor == instance.rotor)?;
    let (parameter, constant) = candidate.guess.as_ref()?;
    let scale = candidate.parameters[*parameter].corrects?.scale;
    let fitted = &finding.parameters[*parameter];
    let (offset, unit) = match scale {
        CorrectionScale::Share => (constant.value, constant.value.abs()),
        CorrectionScale::Difference => (1.0, 1.0),
        CorrectionScale::Whole => return None,
    };
    Some(Calibration {
        key: constant.key.clone(),
        name: constant.name.clone(),
        unit: constant.unit.clone(),
        value: constant.value,
        low: constant.low,
        high: constant.high,
        source: constant.source,
        wanted: constant.value + offset * fitted.value,
        wanted_interval_95: unit * fitted.interval_95,
        ln_bayes_factor: finding.ln_bayes_factor,
        how: constant.how.clone(),
        better: constant.better.clone(),
    })
}
