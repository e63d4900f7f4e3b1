//! Intervals of a vehicle's constants as priors of the effects that are errors of them.
//!
//! A vehicle that was identified from a log knows its lag to 5 %, and its inertia perhaps not at all. An effect that is the error of
//! such a constant ([`rotortwin_plant::effects::Correction`], declared by the effect) has a prior from the constant's interval:
//!
//! | the constant is | spike: what every vehicle has | slab: what a finding may have |
//! |---|---|---|
//! | measured, a parameter, entered, assumed | the interval's deviation | three of them, or the plausible size |
//! | narrowed by the log, else of its class | the interval's deviation | the same |
//! | a default of its class | the catalogue's clutter | the interval's deviation, or the plausible size |
//!
//! So a deviation within a measured interval is not missing physics, and a wrong guess is recognised as such: it is a
//! calibration that has not been made, not an effect ([`crate::diagnose`]).
//!
//! Limits: intervals are taken as normal and independent of each other, about the value that the document has.

use rotortwin_plant::effects::{CorrectionScale, ParameterDeclaration};

use super::candidates::{Guess, Library};
use crate::estimation::parameters::QUANTILE_95;
use crate::model::ConstantInterval;
use crate::model::constants::Source;

/// Least slab over the spike: an effect of a constant that is known well must lie clearly outside of its interval.
const SLAB: f64 = 3.0;
/// How far beyond its interval a guess may turn out to be, in widths of the interval.
const BEYOND: f64 = 0.5;

/// The interval of the error that a parameter represents, in the parameter's unit.
fn error(constant: &ConstantInterval, scale: CorrectionScale) -> Option<(f64, f64)> {
    let (low, high) = match scale {
        CorrectionScale::Share if constant.value != 0.0 => {
            let a = (constant.low - constant.value) / constant.value;
            let b = (constant.high - constant.value) / constant.value;
            (a.min(b), a.max(b))
        }
        CorrectionScale::Share => return None,
        CorrectionScale::Difference => (constant.low - constant.value, constant.high - constant.value),
        CorrectionScale::Whole => (constant.low, constant.high),
    };
    (high > low).then_some((low, high))
}

/// The constant that a parameter is an error of, and the interval of that error.
fn prior<'a>(
    constants: &'a [ConstantInterval],
    parameter: &ParameterDeclaration,
) -> Option<(&'a ConstantInterval, f64, f64)> {
    let correction = parameter.corrects?;
    let constant = constants.iter().find(|c| c.key == correction.key)?;
    let (low, high) = error(constant, correction.scale)?;
    Some((constant, low, high))
}

/// Most guesses that a search makes room for.
const MOST_GUESSES: usize = 3;

impl Library {
    /// How many findings of a search may be guesses.
    pub(crate) fn guesses(&self) -> usize {
        self.candidates
            .iter()
            .filter(|c| c.guess.is_some())
            .count()
            .min(MOST_GUESSES)
    }

    /// Effects that are the errors of guesses, by id.
    pub(crate) fn guessed(&self) -> Vec<&'static str> {
        let guesses = self.candidates.iter().filter(|c| c.guess.is_some());
        guesses.map(|c| c.declaration.id).collect()
    }

    /// Takes intervals of the model's constants as priors.
    pub(crate) fn take_priors(&mut self, constants: &[ConstantInterval]) {
        for candidate in &mut self.candidates {
            for (i, p) in candidate.parameters.iter_mut().enumerate() {
                // A value that a user measured for an identification is trusted.
                let of = |key: &str| constants.iter().find(|c| c.key == key && c.source != Source::Entered);
                if let Some(correction) = p.corrects.filter(|c| c.by_factors)
                    && let Some(constant) = of(correction.key)
                {
                    candidate.constant = Some((i, constant.clone()));
                }
                let Some((constant, low, high)) = prior(constants, p) else {
                    continue;
                };
                let Some(column) = candidate.columns[i].map(|j| &mut self.columns[j]) else {
                    continue;
                };
                let whole = p.corrects.is_some_and(|c| c.scale == CorrectionScale::Whole);
                let deviation = if whole {
                    // The document has 0 where the constant is not 0.
                    low.abs().max(high.abs()) / QUANTILE_95
                } else {
                    0.5 * (high - low) / QUANTILE_95
                };
                if constant.source == Source::Class && !whole {
                    p.size = p.size.max(deviation);
                } else {
                    p.size = p.size.max(SLAB * deviation);
                    p.clutter = p.clutter.max(deviation);
                }
                if constant.source.is_guess() && !whole {
                    let margin = BEYOND * (high - low);
                    p.plausible_low = p.plausible_low.min(low - margin);
                    p.plausible_high = p.plausible_high.max(high + margin);
                    candidate.guess = Some(Guess {
                        parameter: i,
                        constant: constant.clone(),
                        deviation,
                    });
                }
                column.size = p.size;
                column.spike = p.clutter / p.size;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ModelVersion;
    use crate::predict::VehicleSize;
    use rotortwin_plant::effects::{Catalogue, Constants};
    use std::path::Path;

    fn constant(key: &str, value: f64, half_width: f64, source: Source) -> ConstantInterval {
        ConstantInterval {
            key: key.to_owned(),
            name: key.to_owned(),
            unit: String::new(),
            value,
            low: value - half_width,
            high: value + half_width,
            source,
            how: String::new(),
            better: String::new(),
        }
    }

    fn library(constants: &[ConstantInterval]) -> Library {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
        let vehicle = ModelVersion::load(path).unwrap().documents().vehicle;
        let size = VehicleSize::of(&Constants::nominal(&vehicle), &vehicle.battery);
        let mut library = Library::new(&Catalogue::default(), 6, &size);
        library.take_priors(constants);
        library
    }

    /// Spike and slab, in the unit of the parameter, of the only size that corrects a key, and whether it is a guess.
    fn of(library: &Library, key: &str) -> (f64, f64, bool) {
        let corrects = |p: &ParameterDeclaration| p.corrects.is_some_and(|c| c.key == key);
        let candidate = library
            .candidates
            .iter()
            .find(|c| c.parameters.iter().any(corrects))
            .unwrap();
        let column = &library.columns[candidate.columns[0].unwrap()];
        (column.spike * column.size, column.size, candidate.guess.is_some())
    }

    #[test]
    fn val_an_interval_is_the_prior_of_the_error_of_its_constant() {
        const JX: &str = "body.inertia_body_kg_m2[0]";
        // ± 19.6 % at 95 % are 10 % of one deviation.
        let near = |(a, b, c): (f64, f64, bool), (x, y, z): (f64, f64, bool)| {
            assert!((a - x).abs() < 1e-6 && (b - y).abs() < 1e-6 && c == z, "{a} {b} {c}");
        };
        near(of(&library(&[]), JX), (0.004, 0.2, false));
        let known = |source| library(&[constant(JX, 0.02, 0.196 * 0.02, source)]);
        near(of(&known(Source::Log), JX), (0.1000018, 0.3000055, false));
        near(of(&known(Source::LogAndClass), JX), (0.1000018, 0.3000055, true));
        near(of(&known(Source::Class), JX), (0.004, 0.2, true));
        // A value that was entered has no width and changes nothing.
        near(
            of(&library(&[constant(JX, 0.02, 0.0, Source::Entered)]), JX),
            (0.004, 0.2, false),
        );
    }

    /// "Mass −59 % from 41.8 s on" was named as if somebody had written down a wrong mass.
    #[test]
    fn regress_what_sets_in_is_no_wrong_constant() {
        let library = library(&[constant("body.mass_kg", 1.55, 0.01, Source::Log)]);
        let mut candidates = library.candidates.iter();
        let mass = candidates.find(|c| c.declaration.id == "mass").unwrap();
        assert!(mass.is_far_off(&[-0.59], None) && !mass.is_far_off(&[-0.59], Some(41.8)));
        assert!(!mass.is_far_off(&[-0.05], None), "within what payloads are");
    }

    #[test]
    fn val_a_constant_without_a_place_in_the_document_is_wide_about_0() {
        let library = library(&[constant("motor.delay_s", 0.008, 0.002, Source::Log)]);
        let (spike, _, guess) = of(&library, "motor.delay_s");
        assert!((spike - 0.010 / QUANTILE_95).abs() < 1e-9 && !guess);
    }
}
