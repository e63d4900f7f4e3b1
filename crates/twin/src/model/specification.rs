//! One effect in words: `rotor-drag drag_n_s_m=0.253±0.001` on a command line, and what the catalogue says about it.

use std::collections::BTreeMap;

use rotortwin_plant::effects::{Catalogue, EffectInstance};

use super::{ModelEffect, Provenance};
use crate::Z95;

/// Reads `name=value` or `name=value±half` (also `+-` and `+/-`), where `half` is half of the 95 % interval, as everywhere behind a `±`.
///
/// Returns the name, the value and its standard deviation.
///
/// # Errors
/// One sentence with the text and what was expected.
pub fn parse_parameter(text: &str) -> Result<(String, f64, Option<f64>), String> {
    let refuse = |what: &str| format!("expected {what}, such as drag=0.25±0.01, got `{text}`");
    let (name, rest) = text
        .split_once('=')
        .ok_or_else(|| refuse("parameter=value or parameter=value±half of its 95 % interval"))?;
    let (value, half) = ["±", "+/-", "+-"]
        .iter()
        .find_map(|sign| rest.split_once(sign))
        .map_or((rest, None), |(value, half)| (value, Some(half)));
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|x| x.is_finite());
    let value = number(value).ok_or_else(|| refuse("a finite number after `=`"))?;
    let deviation = match half {
        Some(text) => Some(
            number(text)
                .filter(|half| *half >= 0.0)
                .map(|half| half / Z95)
                .ok_or_else(|| refuse("half of a 95 % interval, 0 or more, after `±`"))?,
        ),
        None => None,
    };
    let name = name.trim();
    if name.is_empty() {
        return Err(refuse("the name of a parameter before `=`"));
    }
    Ok((name.to_owned(), value, deviation))
}

/// The effect that a command line describes; values by hand.
///
/// # Errors
/// One sentence about the first text that is wrong.
pub fn effect_by_hand(
    effect: &str,
    rotor: Option<usize>,
    onset_s: Option<f64>,
    parameters: &[String],
) -> Result<ModelEffect, String> {
    let mut found = ModelEffect {
        effect: effect.to_owned(),
        rotor,
        onset_s,
        parameters: BTreeMap::new(),
        deviations: BTreeMap::new(),
        provenance: Provenance::by_hand(),
    };
    for text in parameters {
        let (name, value, deviation) = parse_parameter(text)?;
        if let Some(deviation) = deviation {
            found.deviations.insert(name.clone(), deviation);
        }
        if found.parameters.insert(name.clone(), value).is_some() {
            return Err(format!("expected each parameter once, `{name}` is given twice"));
        }
    }
    Ok(found)
}

/// The effect as the catalogue checks and builds it.
impl From<&ModelEffect> for EffectInstance {
    fn from(effect: &ModelEffect) -> Self {
        Self {
            effect: effect.effect.clone(),
            rotor: effect.rotor,
            onset_s: effect.onset_s,
            parameters: effect.parameters.clone(),
        }
    }
}

/// What the catalogue says about the effect, in one line.
pub(super) fn comment(effect: &ModelEffect, catalogue: &Catalogue) -> Option<String> {
    let declaration = catalogue.find(&effect.effect)?;
    let units: Vec<String> = declaration
        .parameters
        .iter()
        .filter(|parameter| effect.parameters.contains_key(parameter.name) && !parameter.unit.is_empty())
        .map(|parameter| format!("{} in {}", parameter.symbol, parameter.unit))
        .collect();
    let units = if units.is_empty() {
        String::new()
    } else {
        format!("; {}", units.join(", "))
    };
    Some(format!("{}: {}{units}", declaration.name, declaration.equation))
}
