//! Training of classifiers, on this machine or in parts on several.

mod networks;

pub use networks::{Merged, PreparedNetworks, merge, prepare_networks};

use crate::destination;
use crate::failure::Failure;
use rotortwin_campaign::learning::training::Overrides;
use rotortwin_campaign::paper::classifiers;
use rotortwin_campaign::paper::reproduction::{self, Method, Options, Reproduction};
use rotortwin_campaign::parallel::available_threads;
use rotortwin_jobs::Training as Job;
use rotortwin_jobs::training::{Hyperparameters, Method as Asked, Rule};
use rotortwin_scenario::classifier::TrainedClassifier;
use rotortwin_scenario::{Classifier, Scenario};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Default scenario: vehicle, controller and detectors of the data set.
pub const BASE_SCENARIO: &str = "reference-flight";

/// A training ready to start.
#[derive(Debug)]
pub struct Prepared<'a> {
    job: &'a Job,
    base: Scenario,
    options: Options,
}

/// Checks everything possible before the work.
///
/// # Errors
/// The scenario cannot be used, or the file cannot be written.
pub fn prepare(job: &Job) -> Result<Prepared<'_>, Failure> {
    let parent = job.out.parent().filter(|parent| !parent.as_os_str().is_empty());
    if let Some(parent) = parent
        && !parent.is_dir()
    {
        return Err(Failure::input(format!("--out: folder {} not found", parent.display())));
    }
    destination::writable_file(&job.out).map_err(Failure::Input)?;
    settle(job)
}

/// What is to be trained, wherever the result goes.
fn settle(job: &Job) -> Result<Prepared<'_>, Failure> {
    let base = Scenario::load_without_classifier(&job.scenario).map_err(Failure::input)?;
    let options = Options {
        items: BTreeSet::new(),
        methods: BTreeSet::new(),
        seeds: (job.first_seed..).take(job.seeds as usize).collect(),
        threads: job.threads.unwrap_or_else(available_threads),
        tracking_epochs: 20,
        overrides: overrides(&job.hyperparameters),
    };
    let options = classifiers::options_for(method(job.method), options);
    let rotor_count = base.fdi_config().geometry.rotor_count();
    options.check(rotor_count).map_err(Failure::input)?;
    Ok(Prepared { job, base, options })
}

impl Prepared<'_> {
    /// Flights and networks to compute.
    pub fn parts(&self) -> u64 {
        self.options.jobs(self.base.fdi_config().geometry.rotor_count())
    }

    /// Trains, and writes the classifier's file; `tick` is called after each part.
    ///
    /// # Errors
    /// No flight is usable for training, or the file cannot be written.
    pub fn train(&self, tick: &(dyn Fn() + Sync)) -> Result<Classifier, Failure> {
        let trained = || {
            let result = reproduction::run(&self.base, &self.options, tick)?;
            let job = self.job;
            let data_set = data_set(job.seeds, job.first_seed, &job.scenario);
            let command = command_line(job.method, &data_set, &job.hyperparameters);
            save_classifier(
                &self.base,
                &result,
                method(job.method),
                job.first_seed,
                &command,
                &job.out,
            )
        };
        trained().map_err(|sentence: String| Failure::writing(&self.job.out, sentence))
    }
}

const fn method(asked: Asked) -> Method {
    match asked {
        Asked::Paper => Method::Paper,
        Asked::Improved => Method::Improved,
    }
}

fn overrides(asked: &Hyperparameters) -> Overrides {
    let count = |number: Option<u32>| number.map(|number| number as usize);
    Overrides {
        epochs: asked.epochs,
        hidden: count(asked.hidden),
        adam: asked.optimiser.map(|rule| rule == Rule::Adam),
        learning_rate: asked.learning_rate,
        momentum: asked.momentum,
        l2: asked.l2,
        batch: count(asked.batch),
        seed: asked.seed,
    }
}

/// The command recorded in the classifier's file.
///
/// * `data_set`: [`data_set`]
pub fn command_line(method: Asked, data_set: &str, asked: &Hyperparameters) -> String {
    let mut line = format!("rotortwin train --method {}{data_set}", method.as_str());
    let mut add = |option: &str, value: Option<String>| {
        if let Some(value) = value {
            line += &format!(" --{option} {value}");
        }
    };
    add("epochs", asked.epochs.map(|n| n.to_string()));
    add("hidden", asked.hidden.map(|n| n.to_string()));
    add("optimiser", asked.optimiser.map(|rule| rule.as_str().to_owned()));
    add("learning-rate", asked.learning_rate.map(|x| x.to_string()));
    add("momentum", asked.momentum.map(|x| x.to_string()));
    add("l2", asked.l2.map(|x| x.to_string()));
    add("batch", asked.batch.map(|n| n.to_string()));
    add("seed", asked.seed.map(|n| n.to_string()));
    line + " --out FILE"
}

/// The arguments that determine a data set, as typed.
pub fn data_set(seeds: u32, first_seed: u64, scenario: &Path) -> String {
    let mut line = format!(" --seeds {seeds} --first-seed {first_seed}");
    if scenario != Path::new(BASE_SCENARIO) {
        line += &format!(" --scenario {}", scenario.display());
    }
    line
}

/// Trains on all flights of one seed and writes the classifier's file.
///
/// # Errors
/// No flight is usable for training, or the file cannot be written.
pub fn save_classifier(
    base: &Scenario,
    result: &Reproduction,
    method: Method,
    seed: u64,
    command: &str,
    path: &Path,
) -> Result<Classifier, String> {
    let tested = classifiers::cross_validation(result, method);
    let classifier = classifiers::train(result, method, seed, None)
        .and_then(|fold| classifiers::classifier_file(base, result, method, seed, &fold, command, tested))
        .ok_or("no flights were kept to train on")?;
    std::fs::write(path, classifier.to_json())
        .map_err(|error| format!("{}: cannot write the file: {error}", path.display()))?;
    Ok(classifier)
}

/// The result: path of the classifier, and its training data.
pub fn json(classifier: &Classifier, out: &Path) -> Value {
    let trained = TrainedClassifier {
        file: out,
        name: &classifier.name,
        provenance: &classifier.provenance,
    };
    serde_json::to_value(trained).expect("text and numbers are JSON")
}
