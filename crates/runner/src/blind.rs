//! Execution of a blind bench, of some of its cases, or of its scoring.

use crate::Tell;
use crate::failure::Failure;
use rotortwin_blind::bench::cases::Case;
use rotortwin_blind::bench::product::{read_diagnosis, read_either};
use rotortwin_blind::bench::report;
use rotortwin_blind::bench::run::{Bench, BenchFolder, DiagnosisCommand, Program, Request};
use rotortwin_blind::bench::score::Row;
use rotortwin_blind::bench::sheet::{self, Sheet};
use rotortwin_blind::error::BlindError;
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_jobs::{BlindBench as Job, CaseDone, JobEvent};
use serde::Serialize;
use std::ops::Range;

/// A bench ready to start.
pub struct Prepared {
    bench: Bench,
    diagnosis: DiagnosisCommand,
    cases: Vec<Case>,
    /// Only some of them.
    part: bool,
}

/// Result of a bench.
#[derive(Debug)]
pub enum Benched {
    /// The requested cases, without scoring.
    Part(CasesDone),
    /// All of them, scored.
    Whole(Sheet),
}

/// The result of some cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct CasesDone {
    /// Number requested.
    pub cases: usize,
    /// Number of existing rows.
    pub rows: usize,
}

/// The request of a job.
///
/// # Errors
/// It cannot be run.
pub fn request(job: &Job) -> Result<Request, BlindError> {
    let request = Request {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        presets: job.presets.clone(),
        n: job.n,
        seed: job.seed,
        vehicles: job.vehicles.clone(),
        duration_s: job.duration_s,
    };
    request.check()?;
    Ok(request)
}

/// A command of this program, which ends with this process.
///
/// # Errors
/// The path of this program is unknown.
pub fn of_this_program(words: &[&str], cores: usize) -> std::io::Result<Program> {
    let program = std::env::current_exe()?.display().to_string();
    let all = [&program, "--end-with-stdin"].into_iter().chain(words.iter().copied());
    Ok(Program {
        words: all.map(str::to_owned).collect(),
        held: true,
        cores,
    })
}

/// Opens the folder of the bench and draws its cases.
///
/// * `diagnosis`: alternative diagnosis, a command line with `{log}` and `{vehicle}`; `None`: ours
///
/// # Errors
/// It cannot be run, or its folder belongs to another bench.
pub fn prepare(job: &Job, diagnosis: Option<&str>) -> Result<Prepared, Failure> {
    let rotor_counts = job
        .vehicles
        .iter()
        .map(|path| Vehicle::load(path.as_ref()).map(|vehicle| vehicle.rotors.len()))
        .collect::<Result<Vec<_>, _>>()?;
    let jobs = job.processes.map_or(1, usize::from);
    let cores = (std::thread::available_parallelism().map_or(1, usize::from) / jobs).max(1);
    let ours = |words: &[&str]| of_this_program(words, cores).map_err(Failure::failed);
    let bench = Bench {
        folder: BenchFolder {
            path: job.out.clone(),
            request: request(job)?,
        },
        generator: ours(&["blind", "generate"])?,
        jobs,
        keep_logs: job.keep_logs,
    };
    let diagnosis = match diagnosis {
        Some(line) => DiagnosisCommand {
            command: Program {
                words: line.split_whitespace().map(str::to_owned).collect(),
                held: false,
                cores,
            },
            read: read_either,
        },
        None => DiagnosisCommand {
            command: ours(&["diagnose", "{log}", "--model", "{vehicle}", "--json"])?,
            read: read_diagnosis,
        },
    };
    let mut cases = bench.folder.request.cases(&rotor_counts);
    if let Some(range) = &job.cases {
        cases = part_of(&cases, range)?.to_vec();
    }
    bench.folder.open()?;
    Ok(Prepared {
        bench,
        diagnosis,
        cases,
        part: job.cases.is_some(),
    })
}

impl Prepared {
    /// Number of requested cases.
    pub fn wanted(&self) -> usize {
        self.cases.len()
    }

    /// Number of existing ones among them.
    pub fn present(&self) -> usize {
        self.bench.folder.rows(&self.cases).len()
    }

    /// Executes the missing cases.
    ///
    /// # Errors
    /// A case cannot be flown or diagnosed, or a file cannot be written.
    pub fn run(&self, tell: Tell<'_>) -> Result<Benched, Failure> {
        let told = |row: &Row| tell(&JobEvent::Case(case_done(row)));
        let rows = self.bench.run(&self.cases, &self.diagnosis, &told)?;
        if self.part {
            return Ok(Benched::Part(CasesDone {
                cases: self.cases.len(),
                rows: rows.len(),
            }));
        }
        let sheet = sheet::sum_up(&rows);
        report::write(&self.bench.folder.path, &self.bench.folder.request, &rows, &sheet)?;
        Ok(Benched::Whole(sheet))
    }
}

/// The cases of a requested range.
fn part_of<'a>(cases: &'a [Case], range: &Range<u64>) -> Result<&'a [Case], Failure> {
    let end = |number: u64| usize::try_from(number).unwrap_or(usize::MAX);
    cases.get(end(range.start)..end(range.end)).ok_or_else(|| {
        Failure::input(format!(
            "--cases: {}..{}; expected within 0..{}",
            range.start,
            range.end,
            cases.len()
        ))
    })
}

fn case_done(row: &Row) -> CaseDone {
    CaseDone {
        case: row.case.index,
        named: row.named.clone(),
        outcome: row.outcome,
        preset: row.case.preset,
        truth: row.truth.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_blind::bench::cases::Preset;

    #[test]
    fn val_parts_lie_within_the_bench() {
        let job = Job {
            presets: vec![Preset::Mixed],
            n: 5,
            seed: 1,
            vehicles: vec!["f550.toml".to_owned()],
            duration_s: 90.0,
            out: "out".into(),
            cases: None,
            processes: None,
            keep_logs: false,
        };
        let cases = request(&job).unwrap().cases(&[6]);
        let part = part_of(&cases, &(3..5)).unwrap();
        assert_eq!(part.iter().map(|case| case.index).collect::<Vec<_>>(), [3, 4]);
        let error = part_of(&cases, &(3..6)).unwrap_err().to_string();
        assert!(error.contains("within 0..5"), "{error}");
    }
}
