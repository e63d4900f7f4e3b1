//! Runs that are complete: their telemetry as arrays, and verdicts of detectors of the user's own.

use crate::columns::bytes;
use crate::refusal::input;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyDict};
use rotortwin_store::files::TELEMETRY_FILE;
use rotortwin_store::own_detector::{Detector, Seen};
use rotortwin_store::query::{QueryError, TelemetryFile};
use std::path::PathBuf;

/// The rotors of a run, and those columns whose names begin with one of `prefixes`, as bytes of doubles.
#[pyfunction]
pub(crate) fn recorded<'py>(
    py: Python<'py>,
    run: PathBuf,
    prefixes: Vec<String>,
) -> PyResult<(usize, Bound<'py, PyDict>)> {
    let path = run.join(TELEMETRY_FILE);
    let file = TelemetryFile::open(&path).map_err(input)?;
    let rotor_count = file.fact("rotor_count").and_then(|text| text.parse().ok());
    let rotor_count = rotor_count.ok_or_else(|| {
        input(format!(
            "{}: it does not say how many rotors; expected the telemetry of a run",
            path.display()
        ))
    })?;
    let wanted = |name: &&str| prefixes.iter().any(|prefix| name.starts_with(prefix.as_str()));
    let names: Vec<&str> = file
        .channels()
        .iter()
        .map(|channel| channel.name.as_str())
        .filter(wanted)
        .collect();
    let mut columns = vec![Vec::new(); names.len()];
    py.detach(|| {
        file.for_each_block(&names, |block| {
            for (column, values) in columns.iter_mut().zip(block) {
                column.extend_from_slice(values);
            }
            Ok::<(), QueryError>(())
        })
    })
    .map_err(input)?;
    let dict = PyDict::new(py);
    for (name, values) in names.iter().zip(&columns) {
        let numbers: Bound<'py, PyByteArray> = bytes(py, values.iter().map(|value| value.to_ne_bytes()));
        dict.set_item(name, numbers)?;
    }
    Ok((rotor_count, dict))
}

/// What a detector of Python's said in each step.
struct Said {
    name: String,
    verdicts: std::vec::IntoIter<i32>,
}

impl Detector for Said {
    fn name(&self) -> &str {
        &self.name
    }

    fn begin(&mut self, _: usize) {}

    fn step(&mut self, _: &Seen) -> i32 {
        self.verdicts
            .next()
            .unwrap_or(rotortwin_flight_core::fdi::verdict_code::NOT_READY)
    }
}

/// Makes verdicts, one for each step, part of a run; returns its new summary.
#[pyfunction]
pub(crate) fn judge(py: Python<'_>, run: PathBuf, name: String, verdicts: Vec<i32>) -> PyResult<String> {
    let mut said = Said {
        name,
        verdicts: verdicts.into_iter(),
    };
    let summary = py.detach(|| rotortwin_store::own_detector::judge(&run, &mut said));
    Ok(summary.map_err(input)?.to_json())
}
