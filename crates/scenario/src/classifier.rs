//! Classifier files: a trained network with its inputs, provenance and accuracy.
//!
//! JSON, one file per classifier (`config/classifiers/*.json`), referenced by `[fdi] network` of a scenario. Files are written by
//! training (`rotortwin train`), never by hand. A file is rejected as a whole if its format version is unknown, its numbers do not form a
//! network, or its inputs differ from what the scenario's detectors provide: the scale of a residual depends on rotor model, gain and
//! window.
//!
//! Weights are f32 and written so that they read back bit-identically; the record of a flight contains them in full, since
//! [`Documents`](crate::Documents) carries the whole classifier, not its path.
//!
//! The model hash identifies the vehicle that the network was trained on. It is a record, not a condition: whether a network still works
//! on a modified vehicle has to be tested in flight.

use std::path::Path;

use rotortwin_flight_core::fdi::{Network, NetworkError, NetworkWeights};
use serde::{Deserialize, Serialize};

use crate::error::ConfigError;
use crate::settings::{FdiSettings, NominalThrustModel};
use crate::toml_document::{Document, no_file, plain};
use rotortwin_plant::error::Refusal;

/// The format that this program reads and writes.
pub const FORMAT_VERSION: u32 = 1;

/// Larger files are rejected without reading: a network for 16 rotors takes 60 kB.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// A classifier file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Classifier {
    /// [`FORMAT_VERSION`] of the program that wrote it.
    pub format_version: u32,
    /// Display name.
    pub name: String,
    /// Purpose.
    pub description: String,
    /// Inputs of the network.
    pub inputs: ClassifierInputs,
    /// z-score of the inputs.
    pub normalisation: Normalisation,
    /// Weights of the network.
    pub weights: Weights,
    /// Origin.
    pub provenance: Provenance,
}

/// Inputs of a classifier: window means of the 3 n_a residuals, rotor by rotor, arm, lever, yaw.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClassifierInputs {
    /// n_a.
    pub rotor_count: usize,
    /// Samples of 2.5 ms per window.
    pub window_samples: u16,
    /// h of H_i = h I, 1/s.
    pub observer_gain_1_s: f64,
    /// Rotor model of the residual generators.
    pub nominal_thrust: NominalThrustModel,
    /// The calibration mean is subtracted first; there is no verdict until then.
    pub self_calibrated: bool,
}

/// z = (x − mean)/deviation, 3 n_a values each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normalisation {
    /// `per-feature`, or `pooled`: one mean and deviation for all.
    pub kind: String,
    /// Means over the training set, kg·m²/s.
    pub mean: Vec<f32>,
    /// Standard deviations, above 0.
    pub deviation: Vec<f32>,
}

/// f inputs, f hidden neurons (ReLU), c = n_a + 1 classes (softmax); class 0 is healthy, class i is rotor i.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// f rows (neurons) of f (inputs), row by row.
    pub hidden_weight: Vec<f32>,
    /// f values.
    pub hidden_bias: Vec<f32>,
    /// c rows (classes) of f (neurons), row by row.
    pub output_weight: Vec<f32>,
    /// c values.
    pub output_bias: Vec<f32>,
}

/// Origin of a classifier.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Program and version.
    pub program: String,
    /// Command that reproduces the file bit for bit.
    pub command: String,
    /// The flights, in words.
    pub data: String,
    /// XXH3-128 over features and labels of all windows used for training and validation.
    pub data_hash: String,
    /// Content hash of vehicle and blades, as in the summary of a run.
    pub model_hash: String,
    /// Name of the vehicle.
    pub vehicle: String,
    /// Optimiser and its settings, in words.
    pub training: String,
    /// Seed of the flights, the split, the initial weights and the order of the windows.
    pub seed: u64,
    /// Fraction of correct windows in the training set.
    pub training_accuracy: f64,
    /// Fraction of correct windows in the validation set.
    pub validation_accuracy: f64,
    /// Accuracy of networks with the same training, on trajectories that they had not seen.
    pub cross_validation: CrossValidationRecord,
}

/// Result of a training.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct TrainedClassifier<'a> {
    /// The classifier's file.
    #[schema(value_type = String)]
    pub file: &'a Path,
    /// Its name.
    pub name: &'a str,
    /// Training data and accuracy.
    pub provenance: &'a Provenance,
}

/// Leave-one-trajectory-out cross-validation; fractions of correct windows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CrossValidationRecord {
    /// Seeds, one data set each.
    pub seeds: Vec<u64>,
    /// Mean over seeds and folds.
    pub test_mean: f64,
    /// Standard deviation over the folds, mean over the seeds.
    pub test_deviation_over_folds: f64,
    /// Half width of the 95 % interval of the mean over the seeds; 0 for a single seed.
    pub test_interval_over_seeds: f64,
    /// Each trajectory in turn held out.
    pub folds: Vec<FoldRecord>,
}

/// One fold.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FoldRecord {
    /// Trajectory that was not trained on.
    pub held_out: String,
    /// Fraction of correct windows, one for each seed.
    pub test: Vec<f64>,
}

impl Classifier {
    /// Reads and checks the file at `path`.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let name = plain(path);
        let refuse = |line, key, reason: String| ConfigError::new(&name, line, key, reason);
        let size = std::fs::metadata(path).map(|metadata| metadata.len());
        if let Ok(size) = size
            && size > MAX_FILE_BYTES
        {
            let reason = format!("expected a classifier file of at most {MAX_FILE_BYTES} bytes, this one has {size}");
            return Err(refuse(None, None, reason));
        }
        let text = std::fs::read_to_string(path)
            .map_err(|error| refuse(None, None, format!("expected a readable classifier file: {error}")))?;
        Self::parse(&name, &text)
    }

    /// Reads the classifier at `path`, the value of `key` in `document`; if it is missing, the error points to the key.
    pub(crate) fn named(document: &Document, key: &str, path: &Path) -> Result<Self, ConfigError> {
        if path.is_file() {
            return Self::read(path);
        }
        Err(document.refuse(Refusal::new(key, no_file("classifier", path))))
    }

    /// As [`Classifier::read`], from a text that errors refer to as `name`.
    pub fn parse(name: &str, text: &str) -> Result<Self, ConfigError> {
        let refuse = |line, key, reason: String| ConfigError::new(name, line, key, reason);
        // The version first: a newer format may have other keys.
        let version = serde_json::from_str::<serde_json::Value>(text)
            .ok()
            .and_then(|file| file.get("format_version")?.as_u64());
        if let Some(version) = version
            && version != u64::from(FORMAT_VERSION)
        {
            return Err(refuse(None, Some("format_version".to_owned()), wrong_version(version)));
        }
        let classifier: Self = serde_json::from_str(text).map_err(|error| {
            let line = Some(error.line()).filter(|line| *line > 0);
            let words = error.to_string();
            let words = words.split(" at line ").next().unwrap_or_default();
            refuse(line, None, format!("expected a classifier file: {words}"))
        })?;
        classifier
            .check()
            .map_err(|refusal| refuse(None, Some(refusal.key), refusal.reason))?;
        Ok(classifier)
    }

    /// The file's text; reads back bit-identically.
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).expect("numbers and texts are JSON");
        text = compact_lists(&text);
        text.push('\n');
        text
    }

    /// The parameters in the form that flight code uses.
    pub fn network_weights(&self) -> NetworkWeights<'_> {
        NetworkWeights {
            mean: &self.normalisation.mean,
            deviation: &self.normalisation.deviation,
            hidden_weight: &self.weights.hidden_weight,
            hidden_bias: &self.weights.hidden_bias,
            output_weight: &self.weights.output_weight,
            output_bias: &self.weights.output_bias,
        }
    }

    /// The network that flight code runs.
    pub fn network(&self) -> Result<Network, NetworkError> {
        let network = Network::new(self.inputs.rotor_count, &self.network_weights())?;
        Ok(network.with_self_calibration(self.inputs.self_calibrated))
    }

    /// Checks the file by itself; keys are those of the file.
    pub(crate) fn check(&self) -> Result<(), Refusal> {
        if self.format_version != FORMAT_VERSION {
            return Err(Refusal::new(
                "format_version",
                wrong_version(u64::from(self.format_version)),
            ));
        }
        self.network()
            .map(|_| ())
            .map_err(|error| Refusal::new("weights", format!("expected a network that can be run: {error}")))
    }

    /// Checks that the detectors of a scenario provide this classifier's inputs; the error refers to `fdi.network`.
    pub(crate) fn check_fits(&self, settings: &FdiSettings, rotor_count: usize) -> Result<(), Refusal> {
        let name = &self.name;
        let inputs = &self.inputs;
        let reason = if inputs.rotor_count != rotor_count {
            format!(
                "the classifier `{name}` was trained for {} rotors, the vehicle has {rotor_count}",
                inputs.rotor_count
            )
        } else if inputs.nominal_thrust != settings.nominal_thrust {
            format!(
                "the classifier `{name}` was trained on residuals with nominal_thrust = \"{}\", the scenario has \"{}\"",
                inputs.nominal_thrust.as_str(),
                settings.nominal_thrust.as_str()
            )
        } else if inputs.window_samples != settings.window_samples {
            format!(
                "the classifier `{name}` was trained on windows of {} samples, the scenario has window_samples = {}",
                inputs.window_samples, settings.window_samples
            )
        } else if inputs.observer_gain_1_s.to_bits() != settings.observer_gain_1_s.to_bits() {
            format!(
                "the classifier `{name}` was trained on residuals with an observer gain of {} 1/s, the scenario has \
                 observer_gain_1_s = {}",
                inputs.observer_gain_1_s, settings.observer_gain_1_s
            )
        } else {
            return Ok(());
        };
        Err(Refusal::new("fdi.network", reason))
    }
}

fn wrong_version(version: u64) -> String {
    format!("expected format version {FORMAT_VERSION}, got {version}; train the classifier again with this program")
}

/// Writes lists of numbers on one line each: a file of 500 weights stays readable, and a single change shows as one line.
fn compact_lists(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut list: Option<Vec<&str>> = None;
    for line in text.lines() {
        let code = line.trim();
        match &mut list {
            None => {
                out.push_str(line);
                if code.ends_with('[') {
                    list = Some(Vec::new());
                } else {
                    out.push('\n');
                }
            }
            Some(items) if code.starts_with(']') => {
                out.push_str(&items.join(" "));
                out.push_str(code);
                out.push('\n');
                list = None;
            }
            Some(items) if code.starts_with(['{', '"', '[']) => {
                // Not a list of numbers: unchanged.
                out.push('\n');
                for item in items.drain(..) {
                    out.push_str(item);
                    out.push('\n');
                }
                out.push_str(line);
                out.push('\n');
                list = None;
            }
            Some(items) => items.push(code),
        }
    }
    out.pop();
    out
}
