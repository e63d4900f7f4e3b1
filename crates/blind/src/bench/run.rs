//! Runs the cases: generator and diagnosis as processes, results on disk case by case.
//!
//! ```text
//!  DIR/bench.json             what was asked for; a bench goes on only with the same request
//!  DIR/logs/0007.parquet      what the diagnosis sees; removed afterwards unless kept
//!  DIR/truth/0007.json        what it must not see
//!  DIR/answers/0007.json      its output as it came;  0007.err: what it wrote to standard error
//!  DIR/rows/0007.json         the score
//! ```

use super::answer::Answer;
use super::cases::{Case, Preset, draw_cases};
use super::score::{Outcome, Row, failed, score};
use crate::command::DURATION_S;
use crate::error::{BlindError, Result};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Longest time of one process.
const TIME_LIMIT: Duration = Duration::from_secs(120);
/// Most flights of one case, if they are lost.
const FLIGHTS: u64 = 8;
/// Folders of a bench; the rows last, because they are written last.
pub(super) const PARTS: [&str; 4] = ["logs", "truth", "answers", "rows"];
/// The generator's message for a lost flight.
const LOST: &str = "the flight was lost";

/// The request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Request {
    /// Version of the program.
    pub version: String,
    /// Presets.
    pub presets: Vec<Preset>,
    /// Cases of each.
    pub n: usize,
    /// Seed of the random draws.
    pub seed: u64,
    /// Vehicle documents, used in turn.
    pub vehicles: Vec<String>,
    /// Length of a flight, s.
    pub duration_s: f64,
}

impl Request {
    /// Whether it can be run at all.
    ///
    /// # Errors
    /// No preset, no cases of each, no vehicle, or flights that the generator does not fly.
    pub fn check(&self) -> Result<()> {
        let refuse = |place: &str, reason: String| Err(BlindError::input(place, reason));
        let [shortest, longest] = DURATION_S;
        if self.presets.is_empty() {
            return refuse("presets", "is empty; expected at least one".to_owned());
        }
        if self.presets.contains(&Preset::Faults) {
            return refuse(
                "presets",
                "faults are judged by the detectors and scored separately; expected `rotortwin blind --preset faults` without other presets".to_owned(),
            );
        }
        if self.n == 0 {
            return refuse("n", "is 0; expected at least one case of each preset".to_owned());
        }
        if self.vehicles.is_empty() {
            return refuse("vehicles", "is empty; expected at least one".to_owned());
        }
        if !(shortest..=longest).contains(&self.duration_s) {
            return refuse(
                "duration_s",
                format!("is {}; expected {shortest} to {longest} s", self.duration_s),
            );
        }
        Ok(())
    }

    /// The request that a bench in this folder was created with.
    ///
    /// # Errors
    /// There is none.
    pub fn of_folder(folder: &Path) -> Result<Self> {
        let path = folder.join("bench.json");
        let text = std::fs::read_to_string(&path).map_err(|source| BlindError::file("reading", &path, source))?;
        Self::parse(&path, &text)
    }

    fn parse(path: &Path, text: &str) -> Result<Self> {
        serde_json::from_str(text).map_err(|error| BlindError::input(path.display().to_string(), error.to_string()))
    }

    /// How many cases [`cases`](Self::cases) draws; the largest number if that is beyond all bounds.
    pub fn case_count(&self) -> usize {
        self.presets.len().saturating_mul(self.n)
    }

    /// Every case of the request, presets one after the other, with running indices.
    pub fn cases(&self, rotor_counts: &[usize]) -> Vec<Case> {
        let vehicles: Vec<(String, usize)> = self
            .vehicles
            .iter()
            .cloned()
            .zip(rotor_counts.iter().copied())
            .collect();
        self.presets
            .iter()
            .flat_map(|preset| draw_cases(*preset, self.n, self.seed, &vehicles))
            .enumerate()
            .map(|(index, case)| Case { index, ..case })
            .collect()
    }
}

/// How a log becomes an answer.
pub trait Diagnose: Sync {
    /// Diagnoses one log with a vehicle document; output and errors are in the files `stem`.json and `stem`.err.
    fn diagnose(&self, log: &Path, vehicle: &Path, stem: &Path) -> std::result::Result<Answer, String>;
}

/// A program that the bench starts.
#[derive(Debug, Clone)]
pub struct Program {
    /// Its path and first arguments.
    pub words: Vec<String>,
    /// Its standard input stays open until it ends: it takes the closing for our death and ends, too, so that none outlives a bench that
    /// was killed. Otherwise its standard input is empty.
    pub held: bool,
    /// Number of cores it may use (`RAYON_NUM_THREADS`), so that parallel diagnoses do not each use all.
    pub cores: usize,
}

/// A program with arguments; `{log}` and `{vehicle}` are replaced. Its standard output is turned into an answer by `read`.
pub struct DiagnosisCommand {
    /// Program and arguments.
    pub command: Program,
    /// Reads the output.
    pub read: fn(&str) -> std::result::Result<Answer, String>,
}

impl Diagnose for DiagnosisCommand {
    fn diagnose(&self, log: &Path, vehicle: &Path, stem: &Path) -> std::result::Result<Answer, String> {
        let replaced = |text: &String| {
            text.replace("{log}", &log.display().to_string())
                .replace("{vehicle}", &vehicle.display().to_string())
        };
        let program = Program {
            words: self.command.words.iter().map(replaced).collect(),
            ..self.command
        };
        let output = stem.with_extension("json");
        run_process(&program, &output, &stem.with_extension("err"))?;
        let text = std::fs::read_to_string(&output).map_err(|error| error.to_string())?;
        (self.read)(&text)
    }
}

/// Reads an answer in this crate's own form.
pub fn read_plain(text: &str) -> std::result::Result<Answer, String> {
    serde_json::from_str(text).map_err(|error| format!("the answer is not as expected: {error}"))
}

/// Runs a process with a time limit; an exit code other than 0 is an error with the last line of its standard error.
///
/// What it prints is at `output` once it has ended: who looks before sees no half answer.
pub(super) fn run_process(process: &Program, output: &Path, errors: &Path) -> std::result::Result<(), String> {
    let aside = output.with_extension("part");
    let ended = run_aside(process, &aside, errors);
    // Also that of a process that failed, if it was started.
    match std::fs::rename(&aside, output) {
        Err(error) if ended.is_ok() => Err(format!("{}: {error}", output.display())),
        _ => ended,
    }
}

fn run_aside(process: &Program, output: &Path, errors: &Path) -> std::result::Result<(), String> {
    let (program, arguments) = process.words.split_first().ok_or("an empty command")?;
    let create = |path: &Path| File::create(path).map_err(|error| format!("{}: {error}", path.display()));
    let mut child = Command::new(program)
        .args(arguments)
        .env("RAYON_NUM_THREADS", process.cores.to_string())
        .stdin(if process.held { Stdio::piped() } else { Stdio::null() })
        .stdout(create(output)?)
        .stderr(create(errors)?)
        .spawn()
        .map_err(|error| format!("starting `{program}`: {error}"))?;
    let _held = child.stdin.take();
    let start = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok(()),
            Ok(Some(status)) => {
                let text = std::fs::read_to_string(errors).unwrap_or_default();
                let last = text
                    .lines()
                    .rev()
                    .find(|line| !line.trim().is_empty())
                    .unwrap_or("no message");
                return Err(format!("{status}: {last}"));
            }
            Ok(None) if start.elapsed() > TIME_LIMIT => {
                let killed = child.kill().and_then(|()| child.wait());
                return Err(format!(
                    "not done after {} s, stopped ({killed:?})",
                    TIME_LIMIT.as_secs()
                ));
            }
            Ok(None) => std::thread::sleep(Duration::from_millis(2)),
            Err(error) => return Err(error.to_string()),
        }
    }
}

/// The folder of a bench.
pub struct BenchFolder {
    /// Its place.
    pub path: PathBuf,
    /// What is asked for.
    pub request: Request,
}

/// A bench that runs.
pub struct Bench {
    /// Its results.
    pub folder: BenchFolder,
    /// The generator: its options are appended.
    pub generator: Program,
    /// Processes at a time.
    pub jobs: usize,
    /// Keep the logs.
    pub keep_logs: bool,
}

pub(super) fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<()> {
    let text = serde_json::to_string_pretty(value)
        .map_err(|error| BlindError::input(path.display().to_string(), error.to_string()))?;
    // Written aside and renamed, so that a stopped bench leaves no half row.
    let aside = path.with_extension("part");
    std::fs::write(&aside, text + "\n")
        .and_then(|()| std::fs::rename(&aside, path))
        .map_err(|source| BlindError::file("writing", path, source))
}

impl BenchFolder {
    /// Makes the folder, or checks that the one there belongs to the same request.
    pub fn open(&self) -> Result<()> {
        for part in PARTS {
            let path = self.path.join(part);
            std::fs::create_dir_all(&path).map_err(|source| BlindError::file("creating", path, source))?;
        }
        let path = self.path.join("bench.json");
        match std::fs::read_to_string(&path) {
            Ok(text) => {
                if Request::parse(&path, &text)? == self.request {
                    return Ok(());
                }
                let reason = "expected the request that the folder was created with (presets, n, seed, vehicles, \
                              duration, version); use another folder for another request";
                Err(BlindError::input(path.display().to_string(), reason))
            }
            Err(_) => write_json(&path, &self.request),
        }
    }

    fn row_path(&self, index: usize) -> PathBuf {
        self.path.join(format!("rows/{index:05}.json"))
    }

    /// The rows on disk.
    pub fn rows(&self, cases: &[Case]) -> Vec<Row> {
        cases
            .iter()
            .filter_map(|case| {
                let text = std::fs::read_to_string(self.row_path(case.index)).ok()?;
                let row: Row = serde_json::from_str(&text).ok()?;
                (row.case == *case).then_some(row)
            })
            .collect()
    }
}

impl Bench {
    /// Runs every case that has no row yet; `progress` is called after each with its row.
    pub fn run(&self, cases: &[Case], diagnosis: &dyn Diagnose, progress: &(dyn Fn(&Row) + Sync)) -> Result<Vec<Row>> {
        let done: Vec<usize> = self.folder.rows(cases).iter().map(|row| row.case.index).collect();
        let open: Vec<&Case> = cases.iter().filter(|case| !done.contains(&case.index)).collect();
        let next = AtomicUsize::new(0);
        let failure: Mutex<Option<BlindError>> = Mutex::new(None);
        std::thread::scope(|scope| {
            for _ in 0..self.jobs.clamp(1, open.len().max(1)) {
                scope.spawn(|| {
                    while let Some(case) = open.get(next.fetch_add(1, Ordering::Relaxed)) {
                        match self.run_case(case, diagnosis) {
                            Ok(row) => progress(&row),
                            Err(error) => {
                                // The first failure ends the bench; the others find nothing more to take.
                                next.store(open.len(), Ordering::Relaxed);
                                if let Ok(mut first) = failure.lock() {
                                    first.get_or_insert(error);
                                }
                            }
                        }
                    }
                });
            }
        });
        match failure.into_inner() {
            Ok(Some(error)) => Err(error),
            _ => Ok(self.folder.rows(cases)),
        }
    }

    fn run_case(&self, case: &Case, diagnosis: &dyn Diagnose) -> Result<Row> {
        let log = self.folder.path.join(format!("logs/{:05}.parquet", case.index));
        let stem = self.folder.path.join(format!("answers/{:05}", case.index));
        if !self.generate(case, &log)? {
            let row = Row {
                outcome: Outcome::NotFlown,
                ..failed(case, format!("{LOST}, {FLIGHTS} times"), 0.0)
            };
            write_json(&self.folder.row_path(case.index), &row)?;
            return Ok(row);
        }
        let start = Instant::now();
        let answer = diagnosis.diagnose(&log, Path::new(&case.vehicle), &stem);
        let seconds = start.elapsed().as_secs_f64();
        let row = match answer {
            Ok(answer) => score(case, &answer, seconds),
            Err(reason) => failed(case, reason, seconds),
        };
        if !self.keep_logs {
            std::fs::remove_file(&log).map_err(|source| BlindError::file("removing", &log, source))?;
        }
        write_json(&self.folder.row_path(case.index), &row)?;
        Ok(row)
    }

    /// Runs the generator, which writes the log and, separately, the truth. A lost flight (a reversed rotor in a gust
    /// of its own sensor noise) leaves no log: the same case is flown again with another seed, which the truth file
    /// states. False if all were lost.
    fn generate(&self, case: &Case, log: &Path) -> Result<bool> {
        for attempt in 0..FLIGHTS {
            match self.generate_with(case, case.seed ^ (attempt << 32), log) {
                Ok(()) => return Ok(true),
                Err(reason) if reason.contains(LOST) => (),
                Err(reason) => return Err(BlindError::input(format!("generator, case {}", case.index), reason)),
            }
        }
        Ok(false)
    }

    fn generate_with(&self, case: &Case, seed: u64, log: &Path) -> std::result::Result<(), String> {
        let truth = self.folder.path.join(format!("truth/{:05}.json", case.index));
        let mut program = self.generator.clone();
        let mut add = |name: &str, value: String| program.words.extend([name.to_owned(), value]);
        add("--vehicle", case.vehicle.clone());
        add("--flight", case.flight.clone());
        add("--duration-s", self.folder.request.duration_s.to_string());
        add("--seed", seed.to_string());
        add("--out", log.display().to_string());
        add("--truth", truth.display().to_string());
        if case.disturbance != 1.0 {
            add("--disturbance", case.disturbance.to_string());
        }
        for effect in case.effect_arguments() {
            add("--effect", effect);
        }
        if case.clutter {
            program.words.push("--clutter".to_owned());
        }
        let stem = self.folder.path.join(format!("logs/{:05}", case.index));
        let (output, errors) = (stem.with_extension("out"), stem.with_extension("err"));
        run_process(&program, &output, &errors)?;
        for path in [output, errors] {
            std::fs::remove_file(&path).map_err(|source| format!("removing {}: {source}", path.display()))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request() -> Request {
        Request {
            version: "0".to_owned(),
            presets: vec![Preset::Mixed, Preset::Null],
            n: 3,
            seed: 1,
            vehicles: vec!["f550.toml".to_owned()],
            duration_s: 10.0,
        }
    }

    #[test]
    fn val_a_request_that_cannot_be_run_says_which_key() {
        assert!(request().check().is_ok());
        type Change = fn(&mut Request);
        let wrong: [(&str, Change); 5] = [
            ("presets", |request| request.presets.clear()),
            ("n", |request| request.n = 0),
            ("vehicles", |request| request.vehicles.clear()),
            ("duration_s", |request| request.duration_s = 0.5),
            ("duration_s", |request| request.duration_s = f64::NAN),
        ];
        for (key, change) in wrong {
            let mut request = request();
            change(&mut request);
            let error = request.check().unwrap_err().to_string();
            assert!(error.starts_with(&format!("{key}: ")), "{error}");
        }
    }

    #[test]
    fn prop_as_many_cases_as_are_counted() {
        let mut request = request();
        assert_eq!(request.cases(&[6]).len(), request.case_count());
        request.n = usize::MAX;
        assert_eq!(request.case_count(), usize::MAX);
    }

    #[test]
    fn val_only_a_held_process_keeps_its_standard_input() {
        let folder = tempfile::tempdir().unwrap();
        // Ends immediately with 0 if the input is empty; otherwise `read` waits until it is stopped after a moment.
        let script = "if timeout 0.3 cat >/dev/null; then echo empty; else echo held; fi";
        for (held, expected) in [(false, "empty"), (true, "held")] {
            let program = Program {
                words: ["sh", "-c", script].map(str::to_owned).to_vec(),
                held,
                cores: 1,
            };
            let (output, errors) = (folder.path().join("out"), folder.path().join("err"));
            run_process(&program, &output, &errors).unwrap();
            assert_eq!(std::fs::read_to_string(output).unwrap().trim(), expected);
        }
    }
}
