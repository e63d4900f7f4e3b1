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

/// What replaces settings of a [`TrainingConfig`]; unset: they stay.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overrides {
    /// See [`TrainingConfig::epochs`].
    pub epochs: Option<u32>,
    /// See [`TrainingConfig::hidden`].
    pub hidden: Option<usize>,
    /// Adam in place of gradient descent, or the other way round.
    pub adam: Option<bool>,
    /// ε.
    pub learning_rate: Option<f64>,
    /// µ.
    pub momentum: Option<f64>,
    /// λ.
    pub l2: Option<f64>,
    /// See [`TrainingConfig::batch`].
    pub batch: Option<usize>,
    /// Seed of split, initial weights and order in place of the data set's.
    pub seed: Option<u64>,
}

/// Learning rate of Adam where gradient descent was the default.
const ADAM_LEARNING_RATE: f64 = 3e-3;

impl Overrides {
    /// The settings with these in place of their own.
    ///
    /// # Errors
    /// One sentence: a number out of range, or a momentum of Adam.
    pub fn apply(&self, config: TrainingConfig) -> Result<TrainingConfig, String> {
        let count = |name: &str, value: usize, most: usize| {
            if (1..=most).contains(&value) {
                Ok(value)
            } else {
                Err(format!("{name} is {value}; expected 1 to {most}"))
            }
        };
        let number = |name: &str, value: f64, ok: bool, range: &str| {
            if ok {
                Ok(value)
            } else {
                Err(format!("{name} is {value}; expected {range}"))
            }
        };
        let (own_rate, own_momentum, own_l2) = match config.optimiser {
            Optimiser::Sgdm {
                learning_rate,
                momentum,
                l2,
            } => (learning_rate, Some(momentum), l2),
            Optimiser::Adam { learning_rate, l2 } => (learning_rate, None, l2),
        };
        let is_adam = self.adam.unwrap_or(own_momentum.is_none());
        let same_rule = is_adam == own_momentum.is_none();
        let Optimiser::Sgdm {
            learning_rate: paper_rate,
            momentum: paper_momentum,
            ..
        } = Optimiser::PAPER
        else {
            unreachable!("the paper's is gradient descent")
        };
        let usual_rate = match (same_rule, is_adam) {
            (true, _) => own_rate,
            (false, true) => ADAM_LEARNING_RATE,
            (false, false) => paper_rate,
        };
        let rate = self.learning_rate.unwrap_or(usual_rate);
        let learning_rate = number(
            "the learning rate",
            rate,
            rate > 0.0 && rate <= 1.0,
            "above 0, and 1 at most",
        )?;
        let l2 = self.l2.unwrap_or(own_l2);
        let l2 = number("the weight decay (l2)", l2, (0.0..=1.0).contains(&l2), "0 to 1")?;
        let optimiser = match (is_adam, self.momentum) {
            (true, Some(_)) => {
                return Err("Adam has no momentum of its own; leave it out, or take the optimiser sgdm".to_owned());
            }
            (true, None) => Optimiser::Adam { learning_rate, l2 },
            (false, momentum) => {
                let momentum = momentum.or(own_momentum).unwrap_or(paper_momentum);
                let momentum = number(
                    "the momentum",
                    momentum,
                    (0.0..1.0).contains(&momentum),
                    "0 or more, and below 1",
                )?;
                Optimiser::Sgdm {
                    learning_rate,
                    momentum,
                    l2,
                }
            }
        };
        let epochs = self.epochs.unwrap_or(config.epochs);
        Ok(TrainingConfig {
            hidden: count(
                "the number of hidden neurons",
                self.hidden.unwrap_or(config.hidden),
                config.hidden,
            )?,
            optimiser,
            epochs: count("the number of epochs", epochs as usize, MOST_EPOCHS)? as u32,
            batch: count("the batch", self.batch.unwrap_or(config.batch), MOST_BATCH)?,
            ..config
        })
    }
}

/// Most epochs.
const MOST_EPOCHS: usize = 10_000;
/// Most samples of a mini-batch.
const MOST_BATCH: usize = 10_000;

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

    /// The tables of this network in f32, as used by flight code and classifier files, which have as many hidden neurons as inputs: those that it lacks have weights of 0.
    pub fn flight_weights(&self) -> FlightWeights {
        let shape = self.parameters.shape();
        let neurons = shape.inputs.max(shape.hidden);
        let by_neuron = |matrix: &Matrix, outputs: usize, inputs: usize| {
            let weight = |neuron: usize, input: usize| {
                let is_used = neuron < matrix.columns() && input < matrix.rows();
                if is_used { matrix.row(input)[neuron] as f32 } else { 0.0 }
            };
            (0..outputs)
                .flat_map(|neuron| (0..inputs).map(move |input| (neuron, input)))
                .map(|(neuron, input)| weight(neuron, input))
                .collect()
        };
        let narrow = |values: &[f64]| values.iter().map(|x| *x as f32).collect::<Vec<f32>>();
        let mut hidden_bias = narrow(self.parameters.hidden_bias.row(0));
        hidden_bias.resize(neurons, 0.0);
        FlightWeights {
            mean: narrow(&self.scaling.mean),
            deviation: narrow(&self.scaling.deviation),
            hidden_weight: by_neuron(&self.parameters.hidden_weight, neurons, shape.inputs),
            hidden_bias,
            output_weight: by_neuron(&self.parameters.output_weight, shape.classes, neurons),
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

    #[test]
    fn val_overrides_replace_what_they_name_and_refuse_in_one_sentence() {
        let own = TrainingConfig {
            hidden: 18,
            activation: Activation::Relu,
            z_score: ZScore::PerFeature,
            optimiser: Optimiser::PAPER,
            epochs: 5,
            batch: 32,
        };
        assert_eq!(Overrides::default().apply(own), Ok(own));
        let asked = Overrides {
            epochs: Some(7),
            hidden: Some(4),
            momentum: Some(0.5),
            batch: Some(64),
            ..Overrides::default()
        };
        let got = asked.apply(own).expect("in range");
        let Optimiser::Sgdm {
            learning_rate,
            momentum,
            l2,
        } = got.optimiser
        else {
            panic!("{got:?}");
        };
        assert_eq!((got.epochs, got.hidden, got.batch, momentum), (7, 4, 64, 0.5));
        assert_eq!((learning_rate, l2), (1e-3, 1e-4));
        let adam = Overrides {
            adam: Some(true),
            ..Overrides::default()
        };
        let want = Optimiser::Adam {
            learning_rate: ADAM_LEARNING_RATE,
            l2: 1e-4,
        };
        assert_eq!(adam.apply(own).map(|config| config.optimiser), Ok(want));
        for (bad, word) in [
            (
                Overrides {
                    epochs: Some(0),
                    ..Overrides::default()
                },
                "epochs",
            ),
            (
                Overrides {
                    hidden: Some(19),
                    ..Overrides::default()
                },
                "1 to 18",
            ),
            (
                Overrides {
                    learning_rate: Some(f64::NAN),
                    ..Overrides::default()
                },
                "learning rate",
            ),
            (
                Overrides {
                    momentum: Some(1.0),
                    ..Overrides::default()
                },
                "momentum",
            ),
            (
                Overrides {
                    momentum: Some(0.5),
                    ..adam
                },
                "Adam has no momentum",
            ),
            (
                Overrides {
                    batch: Some(0),
                    ..Overrides::default()
                },
                "batch",
            ),
        ] {
            let sentence = bad.apply(own).expect_err("out of range");
            assert!(sentence.contains(word), "{sentence}");
        }
    }

    /// A network with fewer neurons than inputs, in flight code, says what it says in f64.
    #[test]
    fn val_fewer_neurons_are_the_same_network_in_flight() {
        let mut random = RandomStream::new(8, "few");
        let mut samples = Samples::new(12);
        for i in 0..300 {
            let label = (i % 5) as u8;
            let row: Vec<f32> = (0..12)
                .map(|feature| (f64::from(label) * f64::from(feature % 3) + 0.3 * random.symmetric()) as f32)
                .collect();
            samples.push(&row, label);
        }
        let config = TrainingConfig {
            hidden: 5,
            activation: Activation::Relu,
            z_score: ZScore::PerFeature,
            optimiser: Optimiser::PAPER,
            epochs: 20,
            batch: 32,
        };
        let rows: Vec<u32> = (0..300).collect();
        let trained = train(&config, &samples, &rows, 5, &mut random);
        let network = trained.flight_weights().network(4).expect("complete tables");
        let mut input = rotortwin_flight_core::fdi::Residuals::default();
        let mut kinds = std::collections::BTreeSet::new();
        for (row, class) in rows.iter().zip(trained.classify(&samples, &rows)) {
            input.component[..4]
                .as_flattened_mut()
                .copy_from_slice(samples.row(*row as usize));
            assert_eq!(network.evaluate(&input).code(), i32::from(class));
            kinds.insert(class);
        }
        assert!(kinds.len() > 2, "{kinds:?}: one answer to everything would have passed");
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
