//! Expected evidence on a flight: normal matrix of the whole library about a model, and what follows from it by algebra.
//!
//! Data with effect A at its ordinary size θ are J_A θ plus noise. Under a model that opens the prior of candidate C and leaves all
//! other parameters their clutter (deviations P), the evidence is
//!
//! ```text
//! ln p = −½ (dᵀd − gᵀ (H + P⁻²)⁻¹ g) − ½ ln |I + P H P|,   H = JᵀJ, g = Jᵀ d
//! ```
//! and everything needed is in H.

use rotortwin_plant::effects::{Catalogue, EffectClass, EffectInstance, Hooks, ParameterKind};
use serde::Serialize;

use super::Rival;
use crate::estimation::candidates::Library;
use crate::estimation::nuisances::{BIAS_SHARE, CHARGE_DEVIATION};
use crate::log::FlightLog;
use crate::model::ModelVersion;
use crate::predict::{CHANNELS, Nuisances, PredictError, Predictor, Source, Stages};

/// Step of the differences in plausible sizes.
const STEP: f64 = 0.02;

/// What data with an effect in them are expected to say.
#[derive(Debug, Clone, Serialize)]
pub struct Evidence {
    /// ln Bayes factor against the other effect of the pair.
    pub against_other: f64,
    /// ln Bayes factor against the strongest of all other candidates, "nothing" included.
    pub against_all: f64,
    /// That candidate.
    pub strongest_rival: String,
}

impl Evidence {
    /// The smaller of both.
    pub fn worth(&self) -> f64 {
        self.against_other.min(self.against_all)
    }
}

/// Sensitivity of a flight to the whole library.
#[derive(Debug, Clone)]
pub struct Sensitivity {
    library: Library,
    /// Normal matrix: nuisances first, then the columns of the library, all in prior sizes (nuisances) and plausible sizes.
    matrix: Vec<Vec<f64>>,
    nuisances: usize,
}

type Column = [Option<Vec<f32>>; CHANNELS];

impl Sensitivity {
    /// Of a log flown with the model.
    ///
    /// # Errors
    /// The log cannot be held against the model.
    pub fn new(log: &FlightLog, model: &ModelVersion, catalogue: &Catalogue) -> Result<Self, PredictError> {
        let instances = model.instances();
        let predictor = Predictor::new(&model.documents(), &instances, catalogue, log)?;
        let rotors = predictor.series().rotors;
        let mut library = Library::new(catalogue, rotors, &predictor.vehicle_size());
        library.retain(|c| {
            instances
                .iter()
                .all(|m| m.effect != c.declaration.id || m.rotor != c.rotor)
        });
        library.take_priors(&model.constant);
        let nothing = Nuisances::default();
        let base_set = predictor.effect_set(&nothing, &[])?;
        let base = predictor.predict(&base_set, Source::Smooth, None);
        let column =
            |nuisances: &Nuisances, extra: &[EffectInstance], hooks: Hooks, per: f64| -> Result<Column, PredictError> {
                let set = predictor.effect_set(nuisances, extra)?;
                let stages = Stages::between(base_set.constants(), set.constants(), hooks);
                let moved = predictor.predict(&set, Source::Smooth, Some((&base, stages)));
                Ok(std::array::from_fn(|channel| {
                    let (a, b) = (&moved.channels[channel], &base.channels[channel]);
                    if a == b {
                        return None;
                    }
                    predictor
                        .whitener(channel)
                        .map(|whitener| whitener.difference(a, b, per))
                }))
            };
        let mut columns: Vec<Column> = Vec::new();
        for which in 0..=rotors {
            let mut moved = nothing;
            let per = if which < rotors {
                moved.rotor_bias_n[which] = 0.5 * BIAS_SHARE * predictor.nominal.hover_thrust_n;
                2.0
            } else {
                moved.charge = 0.01 * CHARGE_DEVIATION;
                100.0
            };
            columns.push(column(&moved, &[], Hooks::CONSTANTS, per)?);
        }
        for one in &library.columns {
            let candidate = &library.candidates[one.candidate];
            let p = &candidate.parameters[one.parameter];
            let mut values = candidate.neutral();
            let (_, high) = p.accepted();
            let mut step = STEP * p.size;
            if values[one.parameter] + step > high || (values[one.parameter] == 0.0 && p.plausible_high <= 0.0) {
                step = -step;
            }
            values[one.parameter] += step;
            // A shape without a size shows nothing; neither does what makes no vehicle here.
            let made = candidate.instance(&values, None).and_then(|instance| {
                let hooks = predictor.hooks_of(&instance).ok()?;
                column(&nothing, &[instance], hooks, p.size / step).ok()
            });
            columns.push(made.unwrap_or_else(|| std::array::from_fn(|_| None)));
        }
        let size = columns.len();
        let mut matrix = vec![vec![0.0; size]; size];
        for i in 0..size {
            for j in 0..=i {
                let product: f64 = (0..CHANNELS)
                    .filter_map(|c| Some(dot(columns[i][c].as_ref()?, columns[j][c].as_ref()?)))
                    .sum();
                matrix[i][j] = product;
                matrix[j][i] = product;
            }
        }
        Ok(Self {
            library,
            matrix,
            nuisances: rotors + 1,
        })
    }

    fn place(&self, rival: &Rival) -> Result<usize, String> {
        let found = self
            .library
            .candidates
            .iter()
            .position(|c| c.declaration.id == rival.effect && c.rotor == rival.rotor);
        found.ok_or_else(|| {
            format!(
                "expected an effect that a diagnosis can name and that the model does not have yet, got {}",
                rival.label()
            )
        })
    }

    /// The truth in plausible sizes, over all columns.
    fn truth(&self, candidate: usize) -> Vec<f64> {
        let mut truth = vec![0.0; self.matrix.len()];
        for j in self.library.columns_of(candidate) {
            let column = &self.library.columns[j];
            let p = &self.library.candidates[candidate].parameters[column.parameter];
            if p.kind == ParameterKind::Size {
                truth[self.nuisances + j] = p.typical / p.size;
            }
        }
        truth
    }

    /// ln evidence with one candidate open, or none, for g = H θ; the term dᵀd is common to all.
    fn log_evidence(&self, open: Option<usize>, gradient: &[f64]) -> f64 {
        let size = self.matrix.len();
        let mut deviation = vec![1.0; size];
        for (j, column) in self.library.columns.iter().enumerate() {
            deviation[self.nuisances + j] = column.spike;
        }
        if let Some(candidate) = open {
            for j in self.library.columns_of(candidate) {
                deviation[self.nuisances + j] = 1.0;
            }
        }
        let mut m: Vec<Vec<f64>> = (0..size)
            .map(|i| {
                (0..size)
                    .map(|j| deviation[i] * self.matrix[i][j] * deviation[j] + f64::from(u8::from(i == j)))
                    .collect()
            })
            .collect();
        let g: Vec<f64> = gradient.iter().zip(&deviation).map(|(g, d)| g * d).collect();
        // Cholesky in place, and the forward substitution of g.
        let (mut log_determinant, mut square) = (0.0, 0.0);
        let mut z = vec![0.0; size];
        for i in 0..size {
            let (done, rest) = m.split_at_mut(i);
            let row = &mut rest[0];
            for j in 0..i {
                let known: f64 = row[..j].iter().zip(&done[j][..j]).map(|(a, b)| a * b).sum();
                row[j] = (row[j] - known) / done[j][j];
            }
            let known: f64 = row[..i].iter().map(|x| x * x).sum();
            row[i] = (row[i] - known).max(1e-12).sqrt();
            log_determinant += 2.0 * row[i].ln();
            let known: f64 = row[..i].iter().zip(&z[..i]).map(|(a, b)| a * b).sum();
            z[i] = (g[i] - known) / row[i];
            square += z[i] * z[i];
        }
        0.5 * (square - log_determinant)
    }

    /// What data with `truth` in them say about it, against `other` and against everything else.
    ///
    /// # Errors
    /// One of them is not in the library.
    pub fn expected(&self, truth: &Rival, other: &Rival) -> Result<Evidence, String> {
        let (own, against) = (self.place(truth)?, self.place(other)?);
        let data = self.truth(own);
        let gradient: Vec<f64> = self
            .matrix
            .iter()
            .map(|row| row.iter().zip(&data).map(|(h, x)| h * x).sum())
            .collect();
        let right = self.log_evidence(Some(own), &gradient);
        let mut strongest = (self.log_evidence(None, &gradient), "nothing".to_owned());
        let mut pair = f64::NEG_INFINITY;
        for (place, candidate) in self.library.candidates.iter().enumerate() {
            if place == own || candidate.declaration.class == EffectClass::Noise {
                continue;
            }
            let touched = self
                .library
                .columns_of(place)
                .iter()
                .any(|&j| self.matrix[self.nuisances + j][self.nuisances + j] > 0.0);
            if !touched && place != against {
                continue;
            }
            let evidence = self.log_evidence(Some(place), &gradient);
            if place == against {
                pair = evidence;
            }
            if evidence > strongest.0 {
                strongest = (evidence, candidate.label());
            }
        }
        Ok(Evidence {
            against_other: right - pair,
            against_all: right - strongest.0,
            strongest_rival: strongest.1,
        })
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    let mut lanes = [0.0_f64; 8];
    for (x, y) in a8.iter().zip(b8) {
        for i in 0..8 {
            lanes[i] += f64::from(x[i]) * f64::from(y[i]);
        }
    }
    lanes.iter().sum::<f64>()
        + a_rest
            .iter()
            .zip(b_rest)
            .map(|(x, y)| f64::from(*x) * f64::from(*y))
            .sum::<f64>()
}
