//! Classifier files from training: the network, its inputs, its cross-validation and its provenance.
//!
//! The same method, scenario and seeds give a bit-identical file: nothing in it depends on the clock, the machine or the number of
//! threads.

use crate::learning::training::TrainingConfig;
use crate::paper::cross_validation::{Fold, TRAINING_SHARE, fold};
use crate::paper::protocol::Course;
use crate::paper::reproduction::{Method, Options, Reproduction, SeedResult};
use crate::paper::scores::{deviation, interval_95, mean};
use rotortwin_scenario::classifier::{
    Classifier, ClassifierInputs, CrossValidationRecord, FORMAT_VERSION, FoldRecord, Normalisation, Provenance, Weights,
};
use rotortwin_scenario::{ConfigError, Scenario};

/// Trains on all trajectories but `held_out`, with the split and settings of the cross-validation, for `seed` of `reproduction`. `None`:
/// its flights were not kept.
pub fn train(reproduction: &Reproduction, method: Method, seed: u64, held_out: Option<Course>) -> Option<Fold> {
    let result = reproduction.seeds.iter().find(|result| result.seed == seed)?;
    let samples = method.samples(result.data.as_ref()?);
    let config = method.training(reproduction.rotor_count, &reproduction.options);
    let seed = reproduction.options.overrides.seed.unwrap_or(seed);
    Some(fold(&samples, &config, reproduction.rotor_count, held_out, seed))
}

/// The classifier file of a network trained with `method`.
///
/// * `seed`: that of the weights   * `command`: reproduces the file   * `cross_validation`: [`cross_validation`]
pub fn classifier_file(
    base: &Scenario,
    reproduction: &Reproduction,
    method: Method,
    seed: u64,
    fold: &Fold,
    command: &str,
    cross_validation: CrossValidationRecord,
) -> Option<Classifier> {
    let result = reproduction.seeds.iter().find(|result| result.seed == seed)?;
    let data = result.data.as_ref()?;
    let model = method.model()?;
    let config = method.training(reproduction.rotor_count, &reproduction.options);
    let settings = &base.document().fdi;
    let weights = fold.trained.flight_weights();
    let flown = match fold.held_out {
        None => "all four trajectories".to_owned(),
        Some(course) => format!("three trajectories, without {}", course.name()),
    };
    Some(Classifier {
        format_version: FORMAT_VERSION,
        name: format!("{}-{}", slug(&base.vehicle().name), method.key()),
        description: match method {
            Method::Improved => {
                "Network on residuals with the rotor lag, less their mean over the calibration time".to_owned()
            }
            _ => "Network of §5.2 of the paper, trained with its settings".to_owned(),
        },
        inputs: ClassifierInputs {
            rotor_count: reproduction.rotor_count,
            window_samples: settings.window_samples,
            observer_gain_1_s: settings.observer_gain_1_s,
            nominal_thrust: model,
            self_calibrated: method.self_calibrated(),
        },
        normalisation: Normalisation {
            kind: fold.trained.z_score.as_str().to_owned(),
            mean: weights.mean,
            deviation: weights.deviation,
        },
        weights: Weights {
            hidden_weight: weights.hidden_weight,
            hidden_bias: weights.hidden_bias,
            output_weight: weights.output_weight,
            output_bias: weights.output_bias,
        },
        provenance: Provenance {
            program: format!("rotortwin {}", env!("CARGO_PKG_VERSION")),
            command: command.to_owned(),
            data: format!(
                "{} flights of 90 s (§5.2) with {}, {flown}; {:.0} % of the windows trained on, the rest held back",
                data.flights.len(),
                reproduction.world,
                100.0 * TRAINING_SHARE
            ),
            data_hash: method.samples(data).samples.content_hash(),
            model_hash: reproduction.model_hash.clone(),
            vehicle: reproduction.vehicle.clone(),
            training: training_words(&config, 3 * reproduction.rotor_count),
            seed,
            training_accuracy: fold.training,
            validation_accuracy: fold.validation,
            cross_validation,
        },
    })
}

/// * `neurons`: usual number of hidden neurons, which goes without saying
fn training_words(config: &TrainingConfig, neurons: usize) -> String {
    let hidden = if config.hidden == neurons {
        String::new()
    } else {
        format!(", {} hidden neurons", config.hidden)
    };
    format!(
        "{}, {} epochs, batches of {}{hidden}",
        config.optimiser.words(),
        config.epochs,
        config.batch
    )
}

/// Accuracy on the trajectories held out, over all seeds of `reproduction`.
pub fn cross_validation(reproduction: &Reproduction, method: Method) -> CrossValidationRecord {
    let tests = |seed: &SeedResult| seed.networks[&method].iter().map(|fold| fold.test.accuracy()).collect();
    cross_validation_of(
        reproduction.seeds.iter().map(|seed| seed.seed).collect(),
        &reproduction.seeds.iter().map(tests).collect::<Vec<_>>(),
    )
}

/// * `tests`: accuracy on the held-out trajectory, seed by seed, each in the order of [`Course::ALL`]
pub fn cross_validation_of(seeds: Vec<u64>, tests: &[Vec<f64>]) -> CrossValidationRecord {
    let means: Vec<f64> = tests.iter().map(|folds| mean(folds)).collect();
    let deviations: Vec<f64> = tests.iter().map(|folds| deviation(folds)).collect();
    CrossValidationRecord {
        seeds,
        test_mean: mean(&means),
        test_deviation_over_folds: mean(&deviations),
        test_interval_over_seeds: interval_95(&means).unwrap_or(0.0),
        folds: Course::ALL
            .map(|course| FoldRecord {
                held_out: course.name().to_owned(),
                test: tests.iter().map(|folds| folds[course.index()]).collect(),
            })
            .into(),
    }
}

/// Options for training a classifier.
pub fn options_for(method: Method, options: Options) -> Options {
    Options {
        items: Default::default(),
        methods: [method].into(),
        ..options
    }
}

/// `scenario` with `classifier` as its network and the matching rotor model. `name` replaces the file's path.
pub fn with_classifier(scenario: &Scenario, classifier: Classifier, name: &str) -> Result<Scenario, ConfigError> {
    let mut documents = scenario.documents().clone();
    documents.scenario.fdi.nominal_thrust = classifier.inputs.nominal_thrust;
    documents.scenario.fdi.network = Some(name.to_owned());
    documents.classifier = Some(classifier);
    Scenario::from_documents(&documents)
}

/// Lower case, with hyphens for everything else: `DJI F550` → `dji-f550`.
fn slug(name: &str) -> String {
    let mut slug = String::new();
    for letter in name.to_lowercase().chars() {
        if letter.is_alphanumeric() {
            slug.push(letter);
        } else if !slug.ends_with('-') && !slug.is_empty() {
            slug.push('-');
        }
    }
    slug.trim_end_matches('-').to_owned()
}
