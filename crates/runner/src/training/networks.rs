//! The networks of one training, a few at a time by whatever schedules them, and the classifier file made of them.
//!
//! A training of n seeds has 1 + 4 n networks. Number 0 is trained on all four trajectories with the first seed: its weights are those of
//! the classifier. Number 1 + 4 i + k has seed i and does not see trajectory k: its accuracy there is its part of the cross-validation.
//!
//! ```text
//!  DIR/training.json            what was asked for; parts are merged only if theirs are equal
//!  DIR/networks/00007.json      one network; it appears when it is complete, so that a part that died is resumed
//! ```
//! The file made of all of them is that of `rotortwin train` on one machine, byte for byte, in whatever parts they were trained.

use super::{Prepared, command_line, data_set, method, settle};
use crate::destination;
use crate::failure::Failure;
use rotortwin_campaign::paper::classifiers;
use rotortwin_campaign::paper::protocol::{CHARGES, Course};
use rotortwin_campaign::paper::reproduction::{self, Reproduction};
use rotortwin_campaign::parallel::map_in_order;
use rotortwin_jobs::Training as Job;
use rotortwin_jobs::training::{Hyperparameters, Method};
use rotortwin_scenario::Classifier;
use rotortwin_scenario::classifier::CrossValidationRecord;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

const REQUEST: &str = "training.json";
const NETWORKS: &str = "networks";
const COURSES: u64 = Course::ALL.len() as u64;

/// What was asked for, wherever its parts are computed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    program: String,
    method: Method,
    seeds: u32,
    first_seed: u64,
    hyperparameters: Hyperparameters,
    /// All settings of the scenario, as TOML.
    settings: String,
}

impl Request {
    fn networks(&self) -> u64 {
        1 + COURSES * u64::from(self.seeds)
    }

    /// Seed and held-out trajectory of a network.
    fn place(&self, number: u64) -> (u64, Option<Course>) {
        match number.checked_sub(1) {
            None => (self.first_seed, None),
            Some(i) => (self.first_seed + i / COURSES, Some(Course::ALL[(i % COURSES) as usize])),
        }
    }
}

/// One network, as it stands in a file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Network {
    number: u64,
    seed: u64,
    /// `None`: trained on all trajectories.
    held_out: Option<String>,
    /// Accuracy on the held-out trajectory.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    test: Option<f64>,
    /// The classifier without its cross-validation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    classifier: Option<Classifier>,
}

/// Some networks of a training, ready to be trained.
#[derive(Debug)]
pub struct PreparedNetworks<'a> {
    prepared: Prepared<'a>,
    request: Request,
    /// Those that the folder lacks.
    numbers: Vec<u64>,
}

/// Checks everything possible before the work, and opens the folder [`Job::out`], which may hold networks of this training.
///
/// # Errors
/// The scenario cannot be used; the training has no such networks; the folder is of another training, or cannot be written.
pub fn prepare_networks<'a>(job: &'a Job, numbers: &Range<u64>) -> Result<PreparedNetworks<'a>, Failure> {
    let prepared = settle(job)?;
    let request = Request {
        program: format!("rotortwin {}", env!("CARGO_PKG_VERSION")),
        method: job.method,
        seeds: job.seeds,
        first_seed: job.first_seed,
        hyperparameters: job.hyperparameters,
        settings: prepared.base.documents().to_toml(),
    };
    let count = request.networks();
    if numbers.is_empty() || numbers.end > count {
        return Err(Failure::input(format!(
            "networks {}..{}: this training has {count}; expected FIRST..END within 0..{count}",
            numbers.start, numbers.end
        )));
    }
    open(&job.out, &request)?;
    let numbers = numbers
        .clone()
        .filter(|number| !file_of(&job.out, *number).exists())
        .collect();
    Ok(PreparedNetworks {
        prepared,
        request,
        numbers,
    })
}

impl PreparedNetworks<'_> {
    /// Flights and networks to compute.
    pub fn parts(&self) -> u64 {
        let rotor_count = self.prepared.base.fdi_config().geometry.rotor_count();
        let flights = Course::ALL.len() * CHARGES.len() * rotor_count;
        (self.by_seed().len() * flights + self.numbers.len()) as u64
    }

    /// Trains them and writes each to its file; `tick` is called after each flight and network.
    ///
    /// # Errors
    /// A flight fails, or a file cannot be written.
    pub fn train(&self, tick: &(dyn Fn() + Sync)) -> Result<(), Failure> {
        let Prepared { job, base, options } = &self.prepared;
        for (seed, numbers) in self.by_seed() {
            let flown = reproduction::fly_only(base, options, seed, tick).map_err(Failure::failed)?;
            let trained = map_in_order(options.threads, &numbers, |number| self.network(&flown, *number), tick);
            for network in trained {
                let network = network.ok_or_else(|| Failure::failed("no flights were kept to train on"))?;
                write(&file_of(&job.out, network.number), &network)?;
            }
        }
        Ok(())
    }

    fn by_seed(&self) -> BTreeMap<u64, Vec<u64>> {
        let mut seeds: BTreeMap<u64, Vec<u64>> = BTreeMap::new();
        for number in &self.numbers {
            seeds.entry(self.request.place(*number).0).or_default().push(*number);
        }
        seeds
    }

    fn network(&self, flown: &Reproduction, number: u64) -> Option<Network> {
        let Prepared { job, base, .. } = &self.prepared;
        let (seed, held_out) = self.request.place(number);
        let method = method(job.method);
        let fold = classifiers::train(flown, method, seed, held_out)?;
        let classifier = match held_out {
            Some(_) => None,
            None => {
                let data_set = data_set(job.seeds, job.first_seed, &job.scenario);
                let command = command_line(job.method, &data_set, &job.hyperparameters);
                // Replaced when all networks are there.
                let untested = CrossValidationRecord {
                    seeds: Vec::new(),
                    test_mean: 0.0,
                    test_deviation_over_folds: 0.0,
                    test_interval_over_seeds: 0.0,
                    folds: Vec::new(),
                };
                let file = classifiers::classifier_file(base, flown, method, seed, &fold, &command, untested)?;
                Some(file)
            }
        };
        Some(Network {
            number,
            seed,
            held_out: held_out.map(|course| course.name().to_owned()),
            test: held_out.map(|_| fold.test.accuracy()),
            classifier,
        })
    }
}

/// What a merge gave.
#[derive(Debug)]
pub struct Merged {
    /// Networks of the training.
    pub networks: u64,
    /// Numbers that no folder has, ascending.
    pub missing: Vec<u64>,
    /// The classifier, if none is missing; it is written then.
    pub classifier: Option<Classifier>,
}

/// Makes the classifier file `out` of the networks in `folders`.
///
/// # Errors
/// A folder is none of a training, or of another one than the first; two have different files of one network; a file cannot be read or
/// written.
pub fn merge(folders: &[PathBuf], out: &Path) -> Result<Merged, Failure> {
    destination::writable_file(out).map_err(Failure::Input)?;
    let (first, others) = folders
        .split_first()
        .ok_or_else(|| Failure::input("expected folders with networks of a training"))?;
    let request: Request = read(&first.join(REQUEST))?;
    for other in others {
        if read::<Request>(&other.join(REQUEST))? != request {
            return Err(another(other, &first.display().to_string()));
        }
    }
    let found = (0..request.networks())
        .map(|number| in_one_of(folders, number))
        .collect::<Result<Vec<_>, _>>()?;
    let mut merged = Merged {
        networks: request.networks(),
        missing: (0..)
            .zip(&found)
            .filter(|(_, network)| network.is_none())
            .map(|(number, _)| number)
            .collect(),
        classifier: None,
    };
    if merged.missing.is_empty() {
        let mut networks = found.into_iter().flatten();
        let classifier = networks.next().and_then(|network| network.classifier);
        let tests: Option<Vec<f64>> = networks.map(|network| network.test).collect();
        let (Some(mut classifier), Some(tests)) = (classifier, tests) else {
            return Err(Failure::input(format!(
                "{}: the files of its networks hold no classifier or no accuracy; expected those of `rotortwin train --networks`",
                first.display()
            )));
        };
        let seeds = (request.first_seed..).take(request.seeds as usize).collect();
        let tests: Vec<Vec<f64>> = tests.chunks(Course::ALL.len()).map(<[f64]>::to_vec).collect();
        classifier.provenance.cross_validation = classifiers::cross_validation_of(seeds, &tests);
        destination::write_text(out, &classifier.to_json()).map_err(|sentence| Failure::writing(out, sentence))?;
        merged.classifier = Some(classifier);
    }
    Ok(merged)
}

/// The network `number`, the same in each of `folders` that has it; `None`: none has it.
fn in_one_of(folders: &[PathBuf], number: u64) -> Result<Option<Network>, Failure> {
    let mut found: Option<(&Path, String)> = None;
    for folder in folders {
        let path = file_of(folder, number);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            Err(error) => return Err(Failure::failed(format!("{}: {error}", path.display()))),
        };
        match &found {
            Some((first, before)) if *before != text => {
                return Err(Failure::input(format!(
                    "{}: differs from the same network in {}; one of the two machines does not compute the same bits",
                    path.display(),
                    first.display()
                )));
            }
            Some(_) => {}
            None => found = Some((folder, text)),
        }
    }
    found
        .map(|(folder, text)| parse(&file_of(folder, number), &text))
        .transpose()
}

fn open(folder: &Path, request: &Request) -> Result<(), Failure> {
    let path = folder.join(REQUEST);
    std::fs::create_dir_all(folder.join(NETWORKS))
        .map_err(|error| Failure::writing(folder, format!("{}: cannot be made: {error}", folder.display())))?;
    if !path.exists() {
        return write(&path, request);
    }
    match read::<Request>(&path)? == *request {
        true => Ok(()),
        false => Err(another(folder, "what was asked for")),
    }
}

fn another(folder: &Path, than: &str) -> Failure {
    Failure::input(format!(
        "{}: its networks belong to another training than {than} (method, seeds, scenario, settings or program); expected parts of one",
        folder.join(REQUEST).display()
    ))
}

fn file_of(folder: &Path, number: u64) -> PathBuf {
    folder.join(NETWORKS).join(format!("{number:05}.json"))
}

/// Complete or not at all. Under a name of this process's own until then: unlike a campaign's, this folder has no lock, and two processes may
/// train the same network there.
fn write(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).expect("text and numbers are JSON");
    let aside = path.with_extension(format!("{}.part", std::process::id()));
    std::fs::write(&aside, text)
        .and_then(|()| std::fs::rename(&aside, path))
        .map_err(|error| Failure::writing(path, format!("{}: cannot write the file: {error}", path.display())))
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<T, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
    parse(path, &text)
}

fn parse<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, Failure> {
    serde_json::from_str(text).map_err(|error| Failure::input(format!("{}: {error}", path.display())))
}

#[cfg(test)]
mod tests {
    use super::super::prepare;
    use super::*;

    fn job(out: PathBuf, first_seed: u64) -> Job {
        Job {
            method: Method::Paper,
            scenario: PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config/scenarios/reference-flight.toml"),
            seeds: 1,
            first_seed,
            out,
            threads: None,
            hyperparameters: Hyperparameters {
                epochs: Some(1),
                ..Hyperparameters::default()
            },
        }
    }

    fn train_part(out: PathBuf, numbers: Range<u64>) {
        prepare_networks(&job(out, 7), &numbers).unwrap().train(&|| ()).unwrap();
    }

    #[test]
    fn val_parts_in_any_order_after_deaths_give_the_file_of_one_machine() {
        let scratch = tempfile::tempdir().unwrap();
        let at = |name: &str| scratch.path().join(name);
        prepare(&job(at("whole.json"), 7)).unwrap().train(&|| ()).unwrap();
        train_part(at("a"), 0..2);
        train_part(at("b"), 1..5);
        // One that died: half a file beside its place, and a network fewer.
        std::fs::write(at("b/networks/00003.12.part"), "{").unwrap();
        std::fs::remove_file(at("b/networks/00003.json")).unwrap();
        let early = merge(&[at("b"), at("a")], &at("merged.json")).unwrap();
        assert_eq!(
            (early.networks, early.missing, early.classifier.is_none()),
            (5, vec![3], true)
        );
        assert!(!at("merged.json").exists());
        let again = job(at("b"), 7);
        let again = prepare_networks(&again, &(1..5)).unwrap();
        assert_eq!(again.numbers, [3]);
        again.train(&|| ()).unwrap();
        let merged = merge(&[at("b"), at("a")], &at("merged.json")).unwrap();
        assert!(merged.missing.is_empty());
        let read = |name: &str| std::fs::read_to_string(at(name)).unwrap();
        assert_eq!(read("merged.json"), read("whole.json"));

        // Machines that do not agree are named instead of mixed.
        let spoilt = read("a/networks/00001.json").replacen("0.", "0.0", 1);
        std::fs::write(at("a/networks/00001.json"), spoilt).unwrap();
        let error = merge(&[at("b"), at("a")], &at("merged.json")).unwrap_err().to_string();
        assert!(error.contains("a/networks/00001.json: differs"), "{error}");
    }

    #[test]
    fn val_what_is_no_part_of_this_training_is_refused() {
        let scratch = tempfile::tempdir().unwrap();
        let at = |name: &str| scratch.path().join(name);
        let refused = |job: &Job, numbers: Range<u64>| prepare_networks(job, &numbers).unwrap_err().to_string();
        let error = refused(&job(at("a"), 7), 3..6);
        assert_eq!(
            error,
            "networks 3..6: this training has 5; expected FIRST..END within 0..5"
        );
        drop(prepare_networks(&job(at("a"), 7), &(0..1)).unwrap());
        drop(prepare_networks(&job(at("b"), 8), &(0..1)).unwrap());
        let error = refused(&job(at("b"), 7), 0..1);
        assert!(error.contains("another training than what was asked for"), "{error}");
        let error = merge(&[at("a"), at("b")], &at("out.json")).unwrap_err().to_string();
        assert!(error.contains("another training than"), "{error}");
        let error = merge(&[at("nowhere")], &at("out.json")).unwrap_err().to_string();
        assert!(error.contains("nowhere"), "{error}");
    }
}
