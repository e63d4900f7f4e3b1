//! The twin, and the detectors, on files and on columns of this process. Results are the JSON of the commands of the same name.

use crate::columns::doubles;
use crate::interrupt::{Clock, TIME_LIMIT_S, interruptible};
use crate::refusal::input;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rotortwin_scenario::effect_documents;
use rotortwin_twin::compare::NamedModel;
use rotortwin_twin::diagnose::{Diagnosis, Finding, Options};
use rotortwin_twin::identify::{files, in_the_order_of};
use rotortwin_twin::improve::{Guide, Request, Row, Unasked};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::{ModelStore, ModelVersion};
use rotortwin_verdicts::detectors::DetectorChoice;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Column that holds the time of a table.
const TIME: &str = "time_s";

/// A log: the path of a file, run folder or part of one, or the name of a table and its columns.
#[derive(FromPyObject)]
pub(crate) enum Log<'py> {
    /// `flight.ulg`, `flight.ulg@35:65`.
    Path(PathBuf),
    /// Canonical names, as in a file, with the bytes of doubles.
    Table(String, Bound<'py, PyDict>),
}

fn read(py: Python<'_>, log: &Log<'_>) -> PyResult<FlightLog> {
    match log {
        // A file of an hour takes seconds.
        Log::Path(path) => py.detach(|| FlightLog::read_part(path)).map_err(input),
        Log::Table(name, columns) => {
            let mut time_s = None;
            let mut others = Vec::with_capacity(columns.len());
            for (key, values) in columns.iter() {
                let key: String = key.extract()?;
                let values = doubles(values.extract()?);
                if key == TIME {
                    time_s = Some(values);
                } else {
                    others.push((key, values));
                }
            }
            let time_s = time_s.ok_or_else(|| input(format!("{name}: expected a column '{TIME}', in s")))?;
            FlightLog::from_columns(name, time_s, others).map_err(input)
        }
    }
}

/// Reads logs for a comparison with `model`.
fn read_for(py: Python<'_>, logs: &[Log<'_>], model: &ModelVersion) -> PyResult<Vec<FlightLog>> {
    let ordered = |log| read(py, log).map(|log| in_the_order_of(log, &model.vehicle));
    let logs = logs.iter().map(ordered).collect::<PyResult<Vec<_>>>()?;
    match logs.iter().find_map(|log| log.refusal_before_diagnosis(&model.vehicle)) {
        Some(sentence) => Err(input(sentence)),
        None => Ok(logs),
    }
}

fn model(store: &Path, name: &str) -> PyResult<NamedModel> {
    let found = ModelStore::new(store).find(name).map_err(input)?;
    Ok(NamedModel {
        label: found.label(),
        version: found.version,
    })
}

fn json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(input)
}

/// Compares models with logs.
#[pyfunction]
pub(crate) fn compare(py: Python<'_>, logs: Vec<Log<'_>>, models: Vec<String>, store: PathBuf) -> PyResult<String> {
    let models = models
        .iter()
        .map(|name| model(&store, name))
        .collect::<PyResult<Vec<_>>>()?;
    let first = models
        .first()
        .ok_or_else(|| input("expected at least one model, got none"))?;
    let logs = read_for(py, &logs, &first.version)?;
    let result = interruptible(py, |_| rotortwin_twin::compare::compare(&logs, &models))?;
    json(&result.map_err(input)?.0)
}

/// Diagnoses what a model lacks.
#[pyfunction]
pub(crate) fn diagnose(
    py: Python<'_>,
    logs: Vec<Log<'_>>,
    model_name: &str,
    store: PathBuf,
    effects: Vec<PathBuf>,
    baseline: Vec<Log<'_>>,
) -> PyResult<String> {
    let model = model(&store, model_name)?.version;
    let logs = read_for(py, &logs, &model)?;
    let baseline = read_for(py, &baseline, &model)?;
    let effects = effects
        .iter()
        .map(effect_documents::load)
        .collect::<Result<Vec<_>, _>>();
    let effects = effects.map_err(input)?;
    let result = interruptible(py, |stop| {
        let clock = Clock::new(stop);
        let options = Options {
            effects,
            baseline,
            clock: &|| clock.read(),
            time_limit_s: TIME_LIMIT_S,
            ..Options::default()
        };
        rotortwin_twin::diagnose::diagnose(&logs, &model, &options)
    })?;
    json(&result.map_err(input)?)
}

/// Adds what is missing until the model agrees or the reason why it does not is known: the result, and the last version's file.
#[pyfunction]
pub(crate) fn improve(
    py: Python<'_>,
    logs: Vec<Log<'_>>,
    held_out: Vec<Log<'_>>,
    model_name: &str,
    store: PathBuf,
) -> PyResult<(String, String)> {
    let model = model(&store, model_name)?;
    let logs = read_for(py, &logs, &model.version)?;
    let held_out = read_for(py, &held_out, &model.version)?;
    let result = interruptible(py, |stop| {
        let clock = Clock::new(stop);
        let options = Options {
            clock: &|| clock.read(),
            time_limit_s: TIME_LIMIT_S,
            ..Options::default()
        };
        let request = Request {
            model: &model,
            fitted: &logs,
            held_out: &held_out,
            oracle: None,
        };
        let mut guide = Interruptible {
            stop,
            guide: Unasked::default(),
        };
        rotortwin_twin::improve::improve(&request, &options, &mut guide)
    })?;
    let result = result.map_err(input)?;
    Ok((json(&result)?, result.model.to_toml()))
}

/// Takes every step without asking, until it is to stop.
struct Interruptible<'a> {
    stop: &'a AtomicBool,
    guide: Unasked,
}

impl Guide for Interruptible<'_> {
    fn compared(&mut self, row: &Row) -> Result<bool, String> {
        if self.stop.load(Ordering::Relaxed) {
            return Err("interrupted".to_owned());
        }
        self.guide.compared(row)
    }

    fn proposed(
        &mut self,
        before: &ModelVersion,
        next: &ModelVersion,
        finding: &Finding,
        diagnosis: &Diagnosis,
    ) -> Result<Option<String>, String> {
        self.guide.proposed(before, next, finding, diagnosis)
    }
}

/// The detectors' verdicts on logs: a list of reports.
#[pyfunction]
pub(crate) fn fdi_log(
    py: Python<'_>,
    logs: Vec<Log<'_>>,
    model_name: &str,
    store: PathBuf,
    classifier: Option<PathBuf>,
    settings: Vec<String>,
    every_window: bool,
) -> PyResult<String> {
    let choice = DetectorChoice {
        store: &ModelStore::new(&store),
        model: model_name,
        classifier: classifier.as_deref(),
        settings: &settings,
    };
    let (detectors, note) = choice.detectors().map_err(input)?;
    let logs = logs.iter().map(|log| read(py, log)).collect::<PyResult<Vec<_>>>()?;
    let reports = interruptible(py, |stop| {
        // Nobody reads what is left out.
        let wanted = logs.iter().take_while(|_| !stop.load(Ordering::Relaxed));
        let judged = wanted.map(|log| {
            let report = rotortwin_verdicts::log::judge(log, &detectors, every_window);
            let mut report = report.map_err(|refusal| format!("{}: {refusal}", log.name))?;
            report.notes.extend(note.clone());
            Ok(report)
        });
        judged.collect::<Result<Vec<_>, String>>()
    })?;
    json(&reports.map_err(input)?)
}

/// Identifies a vehicle from logs: the result, and its three files (vehicle, blades, intervals).
#[expect(clippy::too_many_arguments, reason = "Python's keyword arguments")]
#[pyfunction]
#[pyo3(signature = (logs, mass_kg, arm_m, name, frame = None, trust_frame = false, capacity_ah = None, cells = None, bench = Vec::new()))]
pub(crate) fn identify(
    py: Python<'_>,
    logs: Vec<Log<'_>>,
    mass_kg: f64,
    arm_m: f64,
    name: &str,
    frame: Option<String>,
    trust_frame: bool,
    capacity_ah: Option<f64>,
    cells: Option<u32>,
    bench: Vec<PathBuf>,
) -> PyResult<(String, [String; 3])> {
    let logs = logs.iter().map(|log| read(py, log)).collect::<PyResult<Vec<_>>>()?;
    let request = rotortwin_twin::identify::Request {
        mass_kg,
        arm_m,
        frame,
        trust_frame,
        capacity_ah,
        cells,
    };
    let found = interruptible(py, |_| {
        let bench = match bench.as_slice() {
            [] => None,
            tables => Some(rotortwin_twin::identify::Bench::read(tables)?),
        };
        rotortwin_twin::identify::identify_with(&logs, &request, bench.as_ref())
    })?;
    let found = found.map_err(input)?;
    let texts = files(&found, name);
    Ok((json(&found)?, [texts.vehicle, texts.blades, texts.intervals]))
}
