//! The paper's shallow network (§5.2): z-score, dense, ReLU, dense, softmax.
//!
//! Inference only; training lives in the campaign crate. Input: the window means of the 3 n_a residuals, in the order rotor by
//! rotor, arm, lever, yaw. Output: class 0 is healthy, class i is rotor i (from 1).
//!
//! Fixed capacity, no allocation: arrays for [`MAX_ROTORS`], of which the first 3 n_a (and n_a + 1) are used.

use super::FaultVerdict;
use super::residual::Residuals;
use crate::MAX_ROTORS;

/// Maximum number of inputs and of hidden neurons.
pub const MAX_FEATURES: usize = 3 * MAX_ROTORS;
/// Maximum number of classes: healthy and every rotor.
pub const MAX_CLASSES: usize = MAX_ROTORS + 1;

/// Weights of a trained classifier, checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Network {
    rotor_count: usize,
    self_calibrated: bool,
    mean: [f32; MAX_FEATURES],
    /// 1/deviation.
    scale: [f32; MAX_FEATURES],
    /// Stored by input: `hidden_weight[input][neuron]`, so that the inner loop is contiguous in memory.
    hidden_weight: [[f32; MAX_FEATURES]; MAX_FEATURES],
    hidden_bias: [f32; MAX_FEATURES],
    /// Stored by neuron: `output_weight[neuron][class]`.
    output_weight: [[f32; MAX_CLASSES]; MAX_FEATURES],
    output_bias: [f32; MAX_CLASSES],
}

/// Network parameters as a trainer provides them; f = 3 n_a features, f hidden neurons, c = n_a + 1 classes.
#[derive(Clone, Copy, Debug)]
pub struct NetworkWeights<'a> {
    /// Mean of every feature over the training set, f values.
    pub mean: &'a [f32],
    /// Standard deviation of every feature, f values above 0.
    pub deviation: &'a [f32],
    /// W₁, f rows (neurons) of f (inputs), row by row.
    pub hidden_weight: &'a [f32],
    /// b₁, f values.
    pub hidden_bias: &'a [f32],
    /// W₂, c rows (classes) of f (neurons), row by row.
    pub output_weight: &'a [f32],
    /// b₂, c values.
    pub output_bias: &'a [f32],
}

/// Why a set of weights is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NetworkError {
    /// n_a outside of 1 to [`MAX_ROTORS`].
    RotorCount {
        /// Count given.
        count: usize,
    },
    /// A table does not have the length that the rotor count requires.
    Length {
        /// Field of [`NetworkWeights`].
        field: &'static str,
        /// Values needed.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// NaN or infinite.
    NotFinite {
        /// Field of [`NetworkWeights`].
        field: &'static str,
    },
    /// A deviation that is not above 0 (or so small that its inverse overflows).
    DeviationNotPositive {
        /// Zero-based feature index.
        feature: usize,
    },
}

impl core::fmt::Display for NetworkError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::RotorCount { count } => {
                write!(out, "a network is for 1 to {MAX_ROTORS} rotors, but {count} are given")
            }
            Self::Length { field, expected, found } => write!(
                out,
                "the network's {field} needs {expected} values, but {found} are given"
            ),
            Self::NotFinite { field } => {
                write!(out, "the network's {field} holds a value that is not finite")
            }
            Self::DeviationNotPositive { feature } => write!(
                out,
                "the network's deviation of feature {} must be above 0",
                feature + 1
            ),
        }
    }
}

impl core::error::Error for NetworkError {}

/// A table of [`NetworkWeights`], for [`Network::set`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WeightTable {
    /// [`NetworkWeights::mean`].
    Mean,
    /// [`NetworkWeights::deviation`].
    Deviation,
    /// [`NetworkWeights::hidden_weight`].
    HiddenWeight,
    /// [`NetworkWeights::hidden_bias`].
    HiddenBias,
    /// [`NetworkWeights::output_weight`].
    OutputWeight,
    /// [`NetworkWeights::output_bias`].
    OutputBias,
}

impl WeightTable {
    /// Number of values for a given rotor count.
    pub const fn length(self, rotor_count: usize) -> usize {
        let (features, classes) = (3 * rotor_count, rotor_count + 1);
        match self {
            Self::Mean | Self::Deviation | Self::HiddenBias => features,
            Self::HiddenWeight => features * features,
            Self::OutputWeight => classes * features,
            Self::OutputBias => classes,
        }
    }

    /// Field of [`NetworkWeights`].
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::Deviation => "deviation",
            Self::HiddenWeight => "hidden_weight",
            Self::HiddenBias => "hidden_bias",
            Self::OutputWeight => "output_weight",
            Self::OutputBias => "output_bias",
        }
    }
}

impl Network {
    /// Placeholder with all weights 0, to be filled with [`Network::prepare`] and [`Network::set`] where there is no room for a second one.
    pub const BLANK: Self = Self {
        rotor_count: 0,
        self_calibrated: false,
        mean: [0.0; MAX_FEATURES],
        scale: [0.0; MAX_FEATURES],
        hidden_weight: [[0.0; MAX_FEATURES]; MAX_FEATURES],
        hidden_bias: [0.0; MAX_FEATURES],
        output_weight: [[0.0; MAX_CLASSES]; MAX_FEATURES],
        output_bias: [0.0; MAX_CLASSES],
    };

    /// Checks and stores the weights for `rotor_count` rotors.
    pub fn new(rotor_count: usize, weights: &NetworkWeights<'_>) -> Result<Self, NetworkError> {
        let mut network = Self::BLANK;
        network.prepare(rotor_count)?;
        for (table, values) in [
            (WeightTable::Mean, weights.mean),
            (WeightTable::Deviation, weights.deviation),
            (WeightTable::HiddenWeight, weights.hidden_weight),
            (WeightTable::HiddenBias, weights.hidden_bias),
            (WeightTable::OutputWeight, weights.output_weight),
            (WeightTable::OutputBias, weights.output_bias),
        ] {
            if values.len() != table.length(rotor_count) {
                return Err(NetworkError::Length {
                    field: table.name(),
                    expected: table.length(rotor_count),
                    found: values.len(),
                });
            }
            for (index, value) in values.iter().enumerate() {
                network.set(table, index, *value)?;
            }
        }
        Ok(network)
    }

    /// Restarts for `rotor_count` rotors: all weights are 0 until [`Network::set`] has been called for every value of every table.
    pub fn prepare(&mut self, rotor_count: usize) -> Result<(), NetworkError> {
        if !(1..=MAX_ROTORS).contains(&rotor_count) {
            return Err(NetworkError::RotorCount { count: rotor_count });
        }
        *self = Self::BLANK;
        self.rotor_count = rotor_count;
        Ok(())
    }

    /// Checks and stores one value; `index` as in [`NetworkWeights`].
    pub fn set(&mut self, table: WeightTable, index: usize, value: f32) -> Result<(), NetworkError> {
        let features = 3 * self.rotor_count;
        let expected = table.length(self.rotor_count);
        if index >= expected {
            return Err(NetworkError::Length {
                field: table.name(),
                expected,
                found: index + 1,
            });
        }
        if !value.is_finite() {
            return Err(NetworkError::NotFinite { field: table.name() });
        }
        let (row, column) = (index / features, index % features);
        match table {
            WeightTable::Mean => self.mean[index] = value,
            WeightTable::Deviation => {
                let scale = 1.0 / value;
                if !(scale > 0.0 && scale.is_finite()) {
                    return Err(NetworkError::DeviationNotPositive { feature: index });
                }
                self.scale[index] = scale;
            }
            WeightTable::HiddenWeight => self.hidden_weight[column][row] = value,
            WeightTable::HiddenBias => self.hidden_bias[index] = value,
            WeightTable::OutputWeight => self.output_weight[column][row] = value,
            WeightTable::OutputBias => self.output_bias[index] = value,
        }
        Ok(())
    }

    /// The same network with self-calibration on or off: subtracting the calibration mean from the residuals. Off by default, as in the
    /// paper.
    #[must_use]
    pub const fn with_self_calibration(mut self, self_calibrated: bool) -> Self {
        self.set_self_calibration(self_calibrated);
        self
    }

    /// [`Network::with_self_calibration`] in place.
    pub const fn set_self_calibration(&mut self, self_calibrated: bool) {
        self.self_calibrated = self_calibrated;
    }

    /// Whether the calibration mean is subtracted from the residuals first; the paper's network uses them unchanged.
    #[inline]
    pub const fn self_calibrated(&self) -> bool {
        self.self_calibrated
    }

    /// n_a that the network was trained for.
    #[inline]
    pub const fn rotor_count(&self) -> usize {
        self.rotor_count
    }

    /// Probability of every class; entries past n_a + 1 are 0.
    ///
    /// * `residual_mean`: means over one window
    pub fn class_probabilities(&self, residual_mean: &Residuals) -> [f32; MAX_CLASSES] {
        let mut output = self.logits(residual_mean);
        softmax(&mut output, self.rotor_count.min(MAX_ROTORS) + 1);
        output
    }

    /// Output of every class before the softmax: differences are log-odds; entries past n_a + 1 mean nothing.
    ///
    /// * `residual_mean`: means over one window
    #[inline(always)]
    pub fn logits(&self, residual_mean: &Residuals) -> [f32; MAX_CLASSES] {
        let rotor_count = self.rotor_count.min(MAX_ROTORS);
        let (features, classes) = (3 * rotor_count, rotor_count + 1);
        let mut hidden = self.hidden_bias;
        let inputs = residual_mean.component.as_flattened().iter().zip(&self.hidden_weight);
        let scales = self.mean.iter().zip(&self.scale);
        for ((x, weights), (mean, scale)) in inputs.zip(scales).take(features) {
            let z = (x - mean) * scale;
            for (h, w) in hidden[..features].iter_mut().zip(weights) {
                *h += w * z;
            }
        }
        let mut output = self.output_bias;
        for (value, weights) in hidden.iter().zip(&self.output_weight).take(features) {
            let active = value.max(0.0);
            for (o, w) in output[..classes].iter_mut().zip(weights) {
                *o += w * active;
            }
        }
        output
    }

    /// The most probable class as a verdict; ties go to the first.
    pub fn evaluate(&self, residual_mean: &Residuals) -> FaultVerdict {
        let probability = self.class_probabilities(residual_mean);
        if probability[0].is_nan() {
            // Finite but absurd residuals can overflow the sums.
            return FaultVerdict::Unknown;
        }
        let (mut best, mut most) = (0, probability[0]);
        for (class, p) in probability.iter().enumerate().take(self.rotor_count + 1).skip(1) {
            if *p > most {
                (best, most) = (class, *p);
            }
        }
        if best == 0 {
            FaultVerdict::Healthy
        } else {
            FaultVerdict::Faulty {
                rotor: (best - 1) as u8,
            }
        }
    }
}

/// Softmax of the first `classes` entries, shifted by the largest so that nothing overflows; the rest becomes 0.
fn softmax(value: &mut [f32; MAX_CLASSES], classes: usize) {
    let (used, unused) = value.split_at_mut(classes.min(MAX_CLASSES));
    let largest = used.iter().fold(f32::NEG_INFINITY, |a, b| a.max(*b));
    let mut sum = 0.0;
    for v in used.iter_mut() {
        *v = libm::expf(*v - largest);
        sum += *v;
    }
    for v in used {
        *v /= sum;
    }
    unused.fill(0.0);
}

#[cfg(test)]
mod tests {
    use super::super::test_vectors;
    use super::*;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    /// Sums of 18 products of size 1 in f32, twice.
    const SOFTMAX_TOLERANCE: f64 = 2e-6;

    fn flat(value: &serde_json::Value) -> Vec<f32> {
        match value {
            serde_json::Value::Array(items) => items.iter().flat_map(flat).collect(),
            other => vec![other.as_f64().expect("number") as f32],
        }
    }

    #[test]
    fn val_reference_forward_pass() {
        let vectors = test_vectors::json("nn.json");
        let network = Network::new(
            6,
            &NetworkWeights {
                mean: &[0.0; 18],
                deviation: &[1.0; 18],
                hidden_weight: &flat(&vectors["W1"]),
                hidden_bias: &flat(&vectors["b1"]),
                output_weight: &flat(&vectors["W2"]),
                output_bias: &flat(&vectors["b2"]),
            },
        )
        .expect("complete");
        let inputs = vectors["X"].as_array().expect("array");
        let outputs = vectors["softmax"].as_array().expect("array");
        assert_eq!(inputs.len(), 4);
        for (input, output) in inputs.iter().zip(outputs) {
            let got = network.class_probabilities(&residuals(&flat(input)));
            for (class, want) in output.as_array().expect("array").iter().enumerate() {
                let error = f64::from(got[class]) - want.as_f64().expect("number");
                assert!(error.abs() < SOFTMAX_TOLERANCE, "{error:e}");
            }
            assert_eq!(got[7..], [0.0; 10]);
        }
    }

    fn residuals(features: &[f32]) -> Residuals {
        let mut r = Residuals::default();
        for (k, x) in features.iter().enumerate() {
            r.component[k / 3][k % 3] = *x;
        }
        r
    }

    /// A network for one rotor that fires class 1 when the first feature is above its mean.
    fn tiny<'a>(mean: &'a [f32], deviation: &'a [f32]) -> NetworkWeights<'a> {
        NetworkWeights {
            mean,
            deviation,
            hidden_weight: &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            hidden_bias: &[0.0; 3],
            output_weight: &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            output_bias: &[0.5, 0.0],
        }
    }

    #[test]
    fn val_normalisation_and_verdict() {
        let network = Network::new(1, &tiny(&[10.0, 0.0, 0.0], &[2.0, 1.0, 1.0])).expect("complete");
        // (11.2 − 10)/2 = 0.6 > 0.5; (10.8 − 10)/2 = 0.4 < 0.5.
        assert_eq!(network.evaluate(&residuals(&[11.2])), FaultVerdict::Faulty { rotor: 0 });
        assert_eq!(network.evaluate(&residuals(&[10.8])), FaultVerdict::Healthy);
    }

    #[test]
    fn val_bad_weights_are_refused() {
        let mean = [0.0; 3];
        assert_eq!(
            Network::new(1, &tiny(&mean, &[1.0, 0.0, 1.0])),
            Err(NetworkError::DeviationNotPositive { feature: 1 })
        );
        assert_eq!(
            Network::new(2, &tiny(&mean, &[1.0; 3])),
            Err(NetworkError::Length {
                field: "mean",
                expected: 6,
                found: 3
            })
        );
        assert_eq!(
            Network::new(1, &tiny(&[f32::NAN, 0.0, 0.0], &[1.0; 3])),
            Err(NetworkError::NotFinite { field: "mean" })
        );
        assert_eq!(
            Network::new(17, &tiny(&mean, &[1.0; 3])),
            Err(NetworkError::RotorCount { count: 17 })
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn prop_probabilities_sum_to_one(features in proptest::collection::vec(-1e30f32..1e30, 3)) {
            let network = Network::new(1, &tiny(&[0.0; 3], &[1.0; 3])).expect("complete");
            let p = network.class_probabilities(&residuals(&features));
            prop_assert!((p.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            prop_assert!(p.iter().all(|x| (0.0..=1.0).contains(x)));
        }
    }
}
