//! The library of the diagnosis: every effect of the catalogue on every rotor, as columns of one Jacobian.

use rotortwin_plant::effects::{
    Catalogue, EffectClass, EffectDeclaration, EffectInstance, ParameterDeclaration, ParameterKind, Strategy,
};

use crate::model::ConstantInterval;
use crate::predict::VehicleSize;

/// Spike of a shape over its plausible range: fixed as long as its effect is not open.
const SHAPE_SPIKE: f64 = 1e-4;

/// An effect that can be named: a declaration, and the rotor for effects of one rotor.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// Entry of the catalogue.
    pub(crate) declaration: &'static EffectDeclaration,
    /// Its parameters, with the plausible sizes of the vehicle.
    pub(crate) parameters: Vec<ParameterDeclaration>,
    /// Rotor, from 1.
    pub(crate) rotor: Option<usize>,
    /// Column of each parameter, counted within the library; `None` for one whose plausible range is a point, and for gross errors.
    pub(crate) columns: Vec<Option<usize>>,
    /// Range of each parameter: what documents accept, or less where that yields an invalid configuration ([`Library::tighten`]).
    pub(crate) limits: Vec<(f64, f64)>,
    /// The parameter that is the error of a constant that is a guess, and that constant.
    pub(crate) guess: Option<Guess>,
    /// The parameter that is a relative error of a constant that files are wrong about by factors, and that constant, guessed or not.
    pub(crate) constant: Option<(usize, ConstantInterval)>,
}

/// Relative errors of such a constant up to which a file may be off that somebody wrote in good faith: a tenth to ten times of the truth,
/// as of an inertia that is relative to thrust and arms which are wrong, too.
const FAR: (f64, f64) = (-0.9, 9.0);
/// Share of a plausible range by which a value may lie beyond it.
const BEYOND: f64 = 0.1;

/// A parameter that is the error of a constant that was guessed.
#[derive(Debug, Clone)]
pub(crate) struct Guess {
    /// Place in [`Candidate::parameters`].
    pub(crate) parameter: usize,
    /// The constant.
    pub(crate) constant: ConstantInterval,
    /// Deviation of the error by the constant's interval, in the unit of the parameter.
    pub(crate) deviation: f64,
}

impl Candidate {
    /// Name with the rotor.
    pub(crate) fn label(&self) -> String {
        match self.rotor {
            Some(rotor) => format!("{} (rotor {rotor})", self.declaration.name),
            None => self.declaration.name.to_owned(),
        }
    }

    /// The instance with values in the order of the declaration; `None` if every size is 0.
    pub(crate) fn instance(&self, values: &[f64], onset_s: Option<f64>) -> Option<EffectInstance> {
        let acts = self
            .parameters
            .iter()
            .zip(values)
            .any(|(p, &value)| p.kind == ParameterKind::Size && value != 0.0);
        acts.then(|| EffectInstance {
            effect: self.declaration.id.to_owned(),
            rotor: self.rotor,
            onset_s,
            parameters: self
                .parameters
                .iter()
                .zip(values)
                .map(|(p, &value)| (p.name.to_owned(), value))
                .collect(),
        })
    }

    /// Sizes 0, shapes typical.
    pub(crate) fn neutral(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.default_value()).collect()
    }

    /// Value pulled into its limits.
    pub(crate) fn clamped(&self, parameter: usize, value: f64) -> f64 {
        let (low, high) = self.limits[parameter];
        value.clamp(low, high)
    }

    /// Range in which a parameter is looked for: where real vehicles have it, or where a wrong constant may be.
    pub(crate) fn reach(&self, parameter: usize) -> (f64, f64) {
        let p = &self.parameters[parameter];
        match self.constant {
            Some((place, _)) if place == parameter => (p.plausible_low.min(FAR.0), p.plausible_high.max(FAR.1)),
            _ => (p.plausible_low, p.plausible_high),
        }
    }

    /// True if a value lies in the plausible range of its parameter, give or take a tenth of it.
    pub(crate) fn is_plausible(&self, parameter: usize, value: f64) -> bool {
        let p = &self.parameters[parameter];
        let margin = BEYOND * (p.plausible_high - p.plausible_low);
        (p.plausible_low - margin..=p.plausible_high + margin).contains(&value)
    }

    /// True for a constant that is off by more than missing physics is, and by no more than a wrong file. A file is wrong
    /// from the first second: nothing that sets in later is far off.
    pub(crate) fn is_far_off(&self, values: &[f64], onset_s: Option<f64>) -> bool {
        let constant = self.constant.as_ref().filter(|_| onset_s.is_none());
        constant.is_some_and(|&(place, _)| {
            let (p, value) = (&self.parameters[place], values[place]);
            !(p.plausible_low..=p.plausible_high).contains(&value) && (FAR.0..=FAR.1).contains(&value)
        })
    }

    /// True for a fault of the log instead of physics.
    pub(crate) fn is_log_fault(&self) -> bool {
        matches!(
            self.declaration.class,
            EffectClass::SensorFault | EffectClass::TimingFault
        )
    }
}

/// One column: the size parameter of a candidate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LibraryColumn {
    /// Place in [`Library::candidates`].
    pub(crate) candidate: usize,
    /// Place in the declaration's parameters.
    pub(crate) parameter: usize,
    /// Plausible size: unit of the column and deviation of the slab.
    pub(crate) size: f64,
    /// Deviation of the spike over the plausible size.
    pub(crate) spike: f64,
}

/// All candidates and columns.
#[derive(Debug, Clone)]
pub(crate) struct Library {
    /// Effects that can be named.
    pub(crate) candidates: Vec<Candidate>,
    /// Their sizes.
    pub(crate) columns: Vec<LibraryColumn>,
}

impl Library {
    /// Every entry of a catalogue that is not a nuisance, for a vehicle of a size with `rotors` rotors.
    pub(crate) fn new(catalogue: &Catalogue, rotors: usize, size: &VehicleSize) -> Self {
        let mut library = Self {
            candidates: Vec::new(),
            columns: Vec::new(),
        };
        for &declaration in catalogue.entries() {
            // Noise has no column; a nuisance is not a finding.
            if matches!(declaration.class, EffectClass::Nuisance | EffectClass::Noise) {
                continue;
            }
            let parameters = size.parameters(declaration);
            // No small deviation, so a candidate without columns.
            let gross = matches!(declaration.search.strategy, Strategy::Wiring(_));
            let places: Vec<Option<usize>> = if declaration.per_rotor {
                (1..=rotors).map(Some).collect()
            } else {
                vec![None]
            };
            for rotor in places {
                let candidate = library.candidates.len();
                let columns = parameters
                    .iter()
                    .enumerate()
                    .map(|(parameter, p)| {
                        (p.size > 0.0 && !gross).then(|| {
                            library.columns.push(LibraryColumn {
                                candidate,
                                parameter,
                                size: p.size,
                                // A shape shows only once its effect has a size; until then its column is 0.
                                spike: (p.clutter / p.size).clamp(SHAPE_SPIKE, 1.0),
                            });
                            library.columns.len() - 1
                        })
                    })
                    .collect();
                library.candidates.push(Candidate {
                    declaration,
                    rotor,
                    columns,
                    // No document takes more than the catalogue's margin, however large the vehicle.
                    limits: parameters
                        .iter()
                        .zip(declaration.parameters)
                        .map(|(own, p)| {
                            let ((low, high), (least, most)) = (own.accepted(), p.accepted());
                            (low.max(least), high.min(most))
                        })
                        .collect(),
                    parameters: parameters.clone(),
                    guess: None,
                    constant: None,
                });
            }
        }
        library
    }

    /// Drops candidates and their columns.
    pub(crate) fn retain(&mut self, keep: impl Fn(&Candidate) -> bool) {
        let kept: Vec<Candidate> = self.candidates.iter().filter(|c| keep(c)).cloned().collect();
        let old = std::mem::take(&mut self.columns);
        self.candidates = kept;
        for (place, candidate) in self.candidates.iter_mut().enumerate() {
            for column in candidate.columns.iter_mut().flatten() {
                self.columns.push(LibraryColumn {
                    candidate: place,
                    ..old[*column]
                });
                *column = self.columns.len() - 1;
            }
        }
    }

    /// Tightens the limits of every size to where an effect alone still yields a valid vehicle, to 0.1 % of its range.
    pub(crate) fn tighten(&mut self, makes_a_vehicle: impl Fn(&EffectInstance) -> bool) {
        for candidate in &mut self.candidates {
            let neutral = candidate.neutral();
            for (i, p) in candidate.parameters.iter().enumerate() {
                if p.kind != ParameterKind::Size || candidate.columns[i].is_none() {
                    continue;
                }
                let works = |value: f64| {
                    let mut values = neutral.clone();
                    values[i] = value;
                    candidate
                        .instance(&values, None)
                        .is_none_or(|one| makes_a_vehicle(&one))
                };
                let inward = |limit: f64| {
                    if works(limit) {
                        return limit;
                    }
                    let (mut good, mut bad) = (neutral[i], limit);
                    for _ in 0..10 {
                        let middle = 0.5 * (good + bad);
                        *(if works(middle) { &mut good } else { &mut bad }) = middle;
                    }
                    good
                };
                let (low, high) = candidate.limits[i];
                let tightened = (inward(low), inward(high));
                candidate.limits[i] = tightened;
            }
        }
    }

    /// Columns of a candidate.
    pub(crate) fn columns_of(&self, candidate: usize) -> Vec<usize> {
        self.candidates[candidate].columns.iter().flatten().copied().collect()
    }
}

/// True if a parameter of the declaration has a column of its own.
pub(crate) fn is_size(library: &Library, candidate: usize, parameter: usize) -> bool {
    library.candidates[candidate].parameters[parameter].kind == ParameterKind::Size
}
