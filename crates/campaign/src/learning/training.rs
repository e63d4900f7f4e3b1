//! From samples to a trained network: scaling, epochs of mini-batches, and classification of other samples.

use super::matrix::Matrix;
use super::network::{Activation, Parameters, Shape, Workspace, arg_max};
use super::optimiser::{Optimiser, OptimiserState};
use super::samples::{Samples, Scaling, ZScore, shuffle};
use rotortwin_flight_core::fdi::{Network, NetworkError, NetworkWeights};
use rotortwin_plant::random::RandomStream;

/// Training settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingConfig {
    /// Hidden neurons.
    pub hidden: usize,
    /// Activation of the hidden layer.
    pub activation: Activation,
    /// Scaling of the features.
    pub z_score: ZScore,
    /// Optimiser of the weights.
    pub optimiser: Optimiser,
    /// Number of epochs.
    pub epochs: u32,
    /// Samples per mini-batch; the last one of an epoch may be smaller.
    pub batch: usize,
}

/// A network and the scaling of its inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct Trained {
    /// Scaling of the inputs.
    pub scaling: Scaling,
    /// z-score used for the scaling.
    pub z_score: ZScore,
    /// Weights and biases.
    pub parameters: Parameters,
    activation: Activation,
}

/// Trains on `rows` of `samples` with `classes` classes. Initial weights and the order of the samples come from `random`; the order is
/// reshuffled for every epoch.
pub fn train(
    config: &TrainingConfig,
    samples: &Samples,
    rows: &[u32],
    classes: usize,
    random: &mut RandomStream,
) -> Trained {
    let shape = Shape {
        inputs: samples.features(),
        hidden: config.hidden,
        classes,
    };
    let scaling = Scaling::new(samples, rows, config.z_score);
    let mut parameters = Parameters::random(shape, random);
    let mut work = Workspace::new(shape, config.activation, config.batch);
    let mut gradient = Parameters::zero(shape);
    let mut batch = Matrix::new(config.batch, shape.inputs);
    let mut labels = Vec::with_capacity(config.batch);
    let mut order = rows.to_vec();
    let batches = rows.len().div_ceil(config.batch) as u64;
    let mut optimiser = OptimiserState::new(config.optimiser, shape, batches * u64::from(config.epochs));
    for _ in 0..config.epochs {
        shuffle(&mut order, random);
        for chunk in order.chunks(config.batch) {
            labels.clear();
            for (slot, row) in chunk.iter().enumerate() {
                scaling.scale(samples.row(*row as usize), batch.row_mut(slot));
                labels.push(samples.labels()[*row as usize]);
            }
            work.gradient(&parameters, &batch, &labels, &mut gradient);
            optimiser.step(&mut parameters, &gradient);
        }
    }
    Trained {
        scaling,
        z_score: config.z_score,
        parameters,
        activation: config.activation,
    }
}

impl Trained {
    /// The most probable class of each of `rows`, in f64.
    pub fn classify(&self, samples: &Samples, rows: &[u32]) -> Vec<u8> {
        const BATCH: usize = 32;
        let shape = self.parameters.shape();
        let mut work = Workspace::new(shape, self.activation, BATCH);
        let mut batch = Matrix::new(BATCH, shape.inputs);
        let mut classes = Vec::with_capacity(rows.len());
        for chunk in rows.chunks(BATCH) {
            for (slot, row) in chunk.iter().enumerate() {
                self.scaling.scale(samples.row(*row as usize), batch.row_mut(slot));
            }
            work.forward(&self.parameters, &batch, chunk.len());
            classes.extend((0..chunk.len()).map(|i| arg_max(work.probabilities(i)) as u8));
        }
        classes
    }

    /// The tables of this network in f32, as used by flight code and classifier files.
    pub fn flight_weights(&self) -> FlightWeights {
        let by_neuron = |matrix: &Matrix| {
            (0..matrix.columns())
                .flat_map(|neuron| (0..matrix.rows()).map(move |input| matrix.row(input)[neuron] as f32))
                .collect()
        };
        let narrow = |values: &[f64]| values.iter().map(|x| *x as f32).collect();
        FlightWeights {
            mean: narrow(&self.scaling.mean),
            deviation: narrow(&self.scaling.deviation),
            hidden_weight: by_neuron(&self.parameters.hidden_weight),
            hidden_bias: narrow(self.parameters.hidden_bias.row(0)),
            output_weight: by_neuron(&self.parameters.output_weight),
            output_bias: narrow(self.parameters.output_bias.row(0)),
        }
    }
}

/// A network in the layout of [`NetworkWeights`].
#[derive(Clone, Debug, PartialEq)]
#[expect(missing_docs, reason = "the fields are those of NetworkWeights")]
pub struct FlightWeights {
    pub mean: Vec<f32>,
    pub deviation: Vec<f32>,
    pub hidden_weight: Vec<f32>,
    pub hidden_bias: Vec<f32>,
    pub output_weight: Vec<f32>,
    pub output_bias: Vec<f32>,
}

impl FlightWeights {
    /// The network that flight code runs, for `rotor_count` rotors.
    pub fn network(&self, rotor_count: usize) -> Result<Network, NetworkError> {
        Network::new(
            rotor_count,
            &NetworkWeights {
                mean: &self.mean,
                deviation: &self.deviation,
                hidden_weight: &self.hidden_weight,
                hidden_bias: &self.hidden_bias,
                output_weight: &self.output_weight,
                output_bias: &self.output_bias,
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tolerance of the vectors.
    const VECTOR_TOLERANCE: f64 = 1e-12;

    fn table(value: &serde_json::Value) -> Vec<Vec<f64>> {
        let numbers = |row: &serde_json::Value| -> Vec<f64> {
            row.as_array()
                .expect("row")
                .iter()
                .map(|x| x.as_f64().expect("number"))
                .collect()
        };
        value.as_array().expect("table").iter().map(numbers).collect()
    }

    fn network(vector: &serde_json::Value) -> Parameters {
        let transposed = |key: &str| {
            let rows = table(&vector[key]);
            Matrix::from_fn(rows[0].len(), rows.len(), |i, j| rows[j][i])
        };
        let bias = |key: &str| {
            let values = vector[key].as_array().expect("row");
            Matrix::from_fn(1, values.len(), |_, j| values[j].as_f64().expect("number"))
        };
        Parameters {
            hidden_weight: transposed("W1"),
            hidden_bias: bias("b1"),
            output_weight: transposed("W2"),
            output_bias: bias("b2"),
        }
    }

    /// Forward pass, loss, and two steps of SGDM compared with an independent implementation.
    #[test]
    fn val_reference_network_and_two_steps_of_training() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/vectors/nn.json");
        let vector: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(path).expect("readable")).expect("JSON");
        let mut parameters = network(&vector);
        let shape = parameters.shape();
        assert_eq!((shape.inputs, shape.hidden, shape.classes), (18, 18, 7));
        let rows = table(&vector["X"]);
        let x = Matrix::from_fn(rows.len(), 18, |i, j| rows[i][j]);
        let labels: Vec<u8> = vector["y"]
            .as_array()
            .expect("labels")
            .iter()
            .map(|y| y.as_u64().expect("class") as u8)
            .collect();
        let mut work = Workspace::new(shape, Activation::Relu, rows.len());
        work.forward(&parameters, &x, rows.len());
        for (i, row) in table(&vector["softmax"]).iter().enumerate() {
            for (got, want) in work.probabilities(i).iter().zip(row) {
                assert!((got - want).abs() < VECTOR_TOLERANCE, "{got} {want}");
            }
        }
        let number = |key: &str| vector[key].as_f64().expect("number");
        let rule = Optimiser::Sgdm {
            learning_rate: number("lr"),
            momentum: number("momentum"),
            l2: number("l2"),
        };
        assert_eq!(rule, Optimiser::PAPER);
        let mut optimiser = OptimiserState::new(rule, shape, 2);
        let mut gradient = Parameters::zero(shape);
        for want in vector["data_loss_before_each_step"].as_array().expect("losses") {
            let loss = work.gradient(&parameters, &x, &labels, &mut gradient);
            assert!((loss - want.as_f64().expect("number")).abs() < VECTOR_TOLERANCE);
            optimiser.step(&mut parameters, &gradient);
        }
        let want = network(&vector["after2"]);
        let start = network(&vector);
        let mut moved: f64 = 0.0;
        for ((got, want), start) in parameters.blocks().into_iter().zip(want.blocks()).zip(start.blocks()) {
            for ((got, want), start) in got.padded().iter().zip(want.padded()).zip(start.padded()) {
                assert!((got - want).abs() < VECTOR_TOLERANCE, "{got} {want}");
                moved = moved.max((got - start).abs());
            }
        }
        assert!(moved > 1e-4, "two steps that change nothing would have passed");
    }

    /// Two linearly separable clouds: both optimisers must separate them.
    #[test]
    fn scenario_both_optimisers_learn_separable_classes() {
        let mut random = RandomStream::new(5, "clouds");
        let mut samples = Samples::new(2);
        for i in 0..600 {
            let label = (i % 2) as u8;
            let centre = if label == 0 { -1.0 } else { 1.0 };
            let row = [centre + 0.5 * random.symmetric(), 10.0 * random.symmetric()].map(|x| x as f32);
            samples.push(&row, label);
        }
        let rows: Vec<u32> = (0..600).collect();
        let adam = Optimiser::Adam {
            learning_rate: 3e-3,
            l2: 0.0,
        };
        for (optimiser, epochs) in [(Optimiser::PAPER, 30), (adam, 30)] {
            let config = TrainingConfig {
                hidden: 4,
                activation: Activation::Relu,
                z_score: ZScore::PerFeature,
                optimiser,
                epochs,
                batch: 32,
            };
            let trained = train(&config, &samples, &rows, 2, &mut RandomStream::new(1, "train"));
            let right = trained
                .classify(&samples, &rows)
                .iter()
                .zip(samples.labels())
                .filter(|(a, b)| a == b)
                .count();
            assert!(right > 595, "{optimiser:?}: {right} of 600");
            let again = train(&config, &samples, &rows, 2, &mut RandomStream::new(1, "train"));
            assert_eq!(again, trained, "the same seed gives the same bits");
        }
    }
}
