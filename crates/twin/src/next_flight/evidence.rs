//! Expected evidence on a flight: normal matrix of the whole library about a model, and what follows from it by algebra.
//!
//! Data with effect A at its ordinary size θ are J_A θ plus noise. Under a model that opens the prior of candidate C and leaves all
//! other parameters their clutter (deviations P), the evidence is
//!
//! ```text
//! ln p = −½ (dᵀd − gᵀ (H + P⁻²)⁻¹ g) − ½ ln |I + P H P|,   H = JᵀJ, g = Jᵀ d
//! ```
//! and everything needed is in H: that of a diagnosis ([`crate::estimation`]) about nothing.

use rotortwin_plant::effects::{Catalogue, EffectClass, ParameterKind};
use serde::Serialize;

use super::Rival;
use crate::estimation::candidates::Library;
use crate::estimation::columns::LogState;
use crate::estimation::dense::Matrix;
use crate::estimation::linearisation::accumulate;
use crate::estimation::normal::{Normal, Posterior};
use crate::log::FlightLog;
use crate::model::ModelVersion;
use crate::predict::{CHANNELS, PredictError, Predictor};

/// Expected evidence from data with one of the effects in it.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
#[schema(as = ManoeuvreEvidence)]
pub struct Evidence {
    /// ln Bayes factor against the other effect of the pair.
    pub against_other: f64,
    /// ln Bayes factor against the strongest of all other candidates, including "nothing".
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
    matrix: Matrix,
    nuisances: usize,
}

impl Sensitivity {
    /// Of a log flown with the model.
    ///
    /// # Errors
    /// The log cannot be compared with the model.
    pub fn new(log: &FlightLog, model: &ModelVersion, catalogue: &Catalogue) -> Result<Self, PredictError> {
        let instances = model.instances();
        let predictor =
            Predictor::new(&model.documents(), &instances, catalogue, log)?.with_own_wind(model.wind_of_each_flight);
        let rotors = predictor.series().rotors;
        let mut library = Library::new(catalogue, rotors, &predictor.vehicle_size());
        library.retain(|c| {
            instances
                .iter()
                .all(|m| m.effect != c.declaration.id || m.rotor != c.rotor)
        });
        library.retain(|c| !model.wind_of_each_flight || !c.declaration.search.is_steady_wind);
        library.take_priors(&model.constant);
        let state = LogState::new(predictor);
        let linear = state.linearise(&library, &[], &|_| ())?;
        let mut normal = Normal::zero(state.nuisance_count() + library.columns.len());
        accumulate(&mut normal, &linear, &[1.0; CHANNELS], |j| j, |_| true);
        Ok(Self {
            library,
            matrix: normal.matrix,
            nuisances: state.nuisance_count(),
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
        let mut truth = vec![0.0; self.matrix.size()];
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
    fn log_evidence(&self, open: Option<usize>, expected: &Normal) -> Result<f64, String> {
        let mut deviations = vec![1.0; self.nuisances];
        deviations.extend(self.library.columns.iter().map(|column| {
            if open == Some(column.candidate) {
                1.0
            } else {
                column.spike
            }
        }));
        Posterior::log_evidence_of(expected, &deviations)
            .ok_or_else(|| "the flight holds numbers that give no evidence".to_owned())
    }

    /// The evidence of data that contain `truth` for it, against `other` and against everything else.
    ///
    /// # Errors
    /// One of them is not in the library.
    pub fn expected(&self, truth: &Rival, other: &Rival) -> Result<Evidence, String> {
        let (own, against) = (self.place(truth)?, self.place(other)?);
        let data = self.truth(own);
        let expected = Normal {
            gradient: self.matrix.times(&data),
            matrix: self.matrix.clone(),
            square_sum: 0.0,
            samples: 0.0,
        };
        let right = self.log_evidence(Some(own), &expected)?;
        let mut strongest = (self.log_evidence(None, &expected)?, "nothing".to_owned());
        let mut pair = f64::NEG_INFINITY;
        for (place, candidate) in self.library.candidates.iter().enumerate() {
            if place == own || candidate.declaration.class == EffectClass::Noise {
                continue;
            }
            let touched = self
                .library
                .columns_of(place)
                .iter()
                .any(|&j| self.matrix.at(self.nuisances + j, self.nuisances + j) > 0.0);
            if !touched && place != against {
                continue;
            }
            let evidence = self.log_evidence(Some(place), &expected)?;
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
