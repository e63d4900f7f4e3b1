//! Leave one trajectory out: three are used for training (70/30 with validation), the fourth for the test.

use crate::learning::network::Activation;
use crate::learning::optimiser::Optimiser;
use crate::learning::samples::{ZScore, stratified_split};
use crate::learning::training::{Trained, TrainingConfig, train};
use crate::paper::data_set::GroupedSamples;
use crate::paper::protocol::Course;
use crate::paper::scores::Confusion;
use rotortwin_flight_core::fdi::network::MAX_CLASSES;
use rotortwin_flight_core::fdi::{FaultVerdict, Residuals};
use rotortwin_plant::random::RandomStream;

/// Training fraction of the windows of the three trajectories (§5.2).
pub const TRAINING_SHARE: f64 = 0.7;

/// Accuracy on each part, and the test results.
#[derive(Clone, Debug, PartialEq)]
pub struct Fold {
    /// Held-out trajectory; `None`: none, so there is no test.
    pub held_out: Option<Course>,
    /// Accuracy on the training part.
    pub training: f64,
    /// Accuracy on the validation part.
    pub validation: f64,
    /// Training rows.
    pub training_rows: usize,
    /// Validation rows.
    pub validation_rows: usize,
    /// Verdicts on the held-out trajectory.
    pub test: Confusion,
    /// The network.
    pub trained: Trained,
}

/// The paper's network for `rotor_count` rotors (§5.2, Table 5): 3n–3n–(n+1), ReLU, SGDM, 5 epochs of batches of 32.
pub fn paper_network(rotor_count: usize, z_score: ZScore) -> TrainingConfig {
    TrainingConfig {
        hidden: 3 * rotor_count,
        activation: Activation::Relu,
        z_score,
        optimiser: Optimiser::PAPER,
        epochs: 5,
        batch: 32,
    }
}

/// Trains on all trajectories except `held_out` and tests on that one. All configurations of a seed use the same split.
pub fn fold(
    data: &GroupedSamples,
    config: &TrainingConfig,
    rotor_count: usize,
    held_out: Option<Course>,
    seed: u64,
) -> Fold {
    let label = held_out.map_or("all", Course::name);
    let rows = data.rows(|course| Some(course) != held_out);
    let mut random = RandomStream::new(seed, &format!("split/{label}"));
    let split = stratified_split(data.samples.labels(), &rows, TRAINING_SHARE, &mut random);
    let mut random = RandomStream::new(seed, &format!("train/{label}"));
    let trained = train(config, &data.samples, &split.training, rotor_count + 1, &mut random);
    let test_rows = held_out.map_or_else(Vec::new, |held_out| data.rows(|course| course == held_out));
    let [training, validation, test] = {
        let classify = classifier(&trained, rotor_count);
        [&split.training, &split.validation, &test_rows].map(|rows| {
            let mut confusion = Confusion::new(rotor_count);
            for (row, verdict) in rows.iter().zip(classify(data, rows)) {
                confusion.add(data.samples.labels()[*row as usize], verdict);
            }
            confusion
        })
    };
    Fold {
        held_out,
        training: training.accuracy(),
        validation: validation.accuracy(),
        training_rows: split.training.len(),
        validation_rows: split.validation.len(),
        test,
        trained,
    }
}

/// Verdicts of a trained network on rows of samples: with flight code in f32 where it supports the network, otherwise
/// in f64.
fn classifier(trained: &Trained, rotor_count: usize) -> impl Fn(&GroupedSamples, &[u32]) -> Vec<FaultVerdict> {
    let shape = trained.parameters.shape();
    let residuals = shape.inputs == 3 * rotor_count && shape.hidden <= shape.inputs && shape.classes <= MAX_CLASSES;
    let network = residuals.then(|| {
        trained
            .flight_weights()
            .network(rotor_count)
            .expect("training gives finite weights")
    });
    move |data, rows| match &network {
        Some(network) => rows
            .iter()
            .map(|row| {
                let mut input = Residuals::default();
                input.component[..rotor_count]
                    .as_flattened_mut()
                    .copy_from_slice(data.samples.row(*row as usize));
                network.evaluate(&input)
            })
            .collect(),
        None => trained
            .classify(&data.samples, rows)
            .into_iter()
            .map(|class| match class.checked_sub(1) {
                None => FaultVerdict::Healthy,
                Some(rotor) => FaultVerdict::Faulty { rotor },
            })
            .collect(),
    }
}
