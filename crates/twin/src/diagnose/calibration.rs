//! What was found and is no missing physics: a constant that was guessed, and that the flights want to have another value.
//!
//! A vehicle of which no log told the inertia has that of its class. A flight that then needs another inertia does not lack an
//! effect; it calls for a calibration, and what else it seems to lack is told once that is made.

use rotortwin_plant::effects::CorrectionScale;
use serde::Serialize;
use utoipa::ToSchema;

use super::result::Finding;
use super::words::quantity;
use crate::estimation::candidates::Library;
use crate::identify::Source;

/// A constant of the vehicle that is a guess, and the value that the flights want.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = ConstantToCalibrate)]
pub struct Calibration {
    /// Key of the vehicle document, or a name of its own.
    pub key: String,
    /// In words.
    pub name: String,
    /// SI unit; empty for a ratio.
    pub unit: String,
    /// As the vehicle has it.
    pub value: f64,
    /// Lower end of the 95 % interval of the guess.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Whether the class alone has said it, or a log has narrowed it.
    pub source: Source,
    /// What the flights want.
    pub wanted: f64,
    /// Half width of its 95 % interval, everything else as it is.
    pub wanted_interval_95: f64,
    /// ln of the Bayes factor against the value as it is.
    pub ln_bayes_factor: f64,
    /// Why it was guessed.
    pub how: String,
    /// What would make it better.
    pub better: String,
}

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

impl Calibration {
    /// What is guessed, and what the flights want.
    pub fn sentence(&self) -> String {
        let what = if self.source == Source::Class {
            "is a guess of its class"
        } else {
            "is known from its class as much as from a log"
        };
        let number = |value: f64| quantity(value, &self.unit);
        let better = if self.better.is_empty() {
            String::new()
        } else {
            format!("; what tells it: {}", self.better)
        };
        format!(
            "{} {what} ({}, 95 % {} to {}), these flights want {} ± {}{better}",
            self.name,
            number(self.value),
            number(self.low),
            number(self.high),
            number(self.wanted),
            number(self.wanted_interval_95)
        )
    }
}

/// How a vehicle is calibrated, with what a user has to give.
pub(crate) const COMMAND: &str =
    "`rotortwin vehicle from-log LOG… --mass KG --arm M --out NAME.toml`, or type what is known into the vehicle";
