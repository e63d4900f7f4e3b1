//! A parameter with its interval.

use rotortwin_plant::effects::ParameterDeclaration;
use serde::Serialize;
use utoipa::ToSchema;

use super::candidates::Library;

/// Normal quantile of a two-sided 95 % interval. What documents hold and a command line says is divided by [`crate::Z95`].
pub(crate) const QUANTILE_95: f64 = 1.959_963_984_540_054;

/// A parameter with its interval.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct FittedParameter {
    /// Key in documents.
    pub name: String,
    /// Letter.
    pub symbol: String,
    /// Unit.
    pub unit: String,
    /// Value.
    #[schema(value_type = Option<f64>)]
    pub value: f64,
    /// Standard deviation.
    #[schema(value_type = Option<f64>)]
    pub deviation: f64,
    /// Half width of the 95 % interval.
    #[schema(value_type = Option<f64>)]
    pub interval_95: f64,
    /// False outside the plausible range.
    pub plausible: bool,
}

/// Below, a number is written with a power of ten.
pub(crate) const SMALLEST: f64 = 1e-4;

/// A value with three or four significant digits.
pub(crate) fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    // An inertia of a rotor is 2e-8 kg·m²: decimals that are cut off left zeros of it.
    if value.abs() < SMALLEST {
        return format!("{value:.3e}");
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 8) as usize;
    format!("{value:.digits$}")
}

/// Parameters of a candidate from values and deviations in its own units.
pub(crate) fn parameters(
    library: &Library,
    candidate: usize,
    values: &[f64],
    deviations: &[f64],
) -> Vec<FittedParameter> {
    parameters_of(&library.candidates[candidate].parameters, values, deviations)
}

/// The same of parameters as they are declared.
pub(crate) fn parameters_of(
    declared: &[ParameterDeclaration],
    values: &[f64],
    deviations: &[f64],
) -> Vec<FittedParameter> {
    declared
        .iter()
        .zip(values)
        .zip(deviations)
        .map(|((p, &value), &deviation)| FittedParameter {
            name: p.name.to_owned(),
            symbol: p.symbol.to_owned(),
            unit: p.unit.to_owned(),
            value,
            deviation,
            interval_95: QUANTILE_95 * deviation,
            plausible: value + 2.0 * deviation >= p.plausible_low && value - 2.0 * deviation <= p.plausible_high,
        })
        .collect()
}
