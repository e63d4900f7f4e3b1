//! Numbers for Python as bytes that NumPy reads as arrays; telemetry under the names and in the precision of `telemetry.parquet`.

use crate::refusal::input;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyDict};
use rotortwin_flight::sample::Sample;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::names::nearest;
use rotortwin_sim::conditions::ConditionSchedule;
use rotortwin_sim::recorder::fill_row;
use rotortwin_store::telemetry::{Column, Kind, TelemetryRow, telemetry_columns};

/// Some columns of one flight, row by row.
#[derive(Clone)]
pub(crate) struct Recording {
    conditions: ConditionSchedule,
    rotor_count: usize,
    all: Vec<f64>,
    /// Indices of the recorded columns among all.
    places: Vec<usize>,
    columns: Vec<Column>,
    /// One vector per recorded column.
    pub(crate) values: Vec<Vec<f64>>,
}

impl Recording {
    /// The columns that match `patterns` (a name, or its beginning followed by `*`).
    pub(crate) fn new(scenario: &Scenario, rotor_count: usize, patterns: &[String]) -> PyResult<Self> {
        let known = telemetry_columns(rotor_count);
        let places = chosen(&known, patterns)?;
        let columns: Vec<Column> = places.iter().map(|&place| known[place].clone()).collect();
        Ok(Self {
            conditions: ConditionSchedule::new(scenario),
            rotor_count,
            all: vec![0.0; known.len()],
            values: vec![Vec::new(); places.len()],
            places,
            columns,
        })
    }

    pub(crate) fn names(&self) -> Vec<String> {
        self.columns.iter().map(|column| column.name.clone()).collect()
    }

    pub(crate) fn push(&mut self, sample: &Sample) {
        let mut row = TelemetryRow::default();
        fill_row(&mut row, sample, self.conditions.at(sample.truth.step));
        row.fill(self.rotor_count, &mut self.all);
        for (column, &place) in self.values.iter_mut().zip(&self.places) {
            column.push(self.all[place]);
        }
    }

    /// Name → bytes of doubles.
    pub(crate) fn doubles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (column, values) in self.columns.iter().zip(&self.values) {
            dict.set_item(&column.name, bytes(py, values.iter().map(|value| value.to_ne_bytes())))?;
        }
        Ok(dict)
    }

    /// Name → type code of NumPy and bytes, each in the precision of its column.
    pub(crate) fn arrays<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (column, values) in self.columns.iter().zip(&self.values) {
            dict.set_item(&column.name, coded(py, column.kind, values))?;
        }
        Ok(dict)
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "codes and masks that came from such integers"
)]
fn coded<'py>(py: Python<'py>, kind: Kind, values: &[f64]) -> (&'static str, Bound<'py, PyByteArray>) {
    let numbers = values.iter();
    match kind {
        Kind::F64 => ("f8", bytes(py, numbers.map(|value| value.to_ne_bytes()))),
        Kind::F32 => ("f4", bytes(py, numbers.map(|&value| (value as f32).to_ne_bytes()))),
        Kind::I32 => ("i4", bytes(py, numbers.map(|&value| (value as i32).to_ne_bytes()))),
        Kind::U64 => ("u8", bytes(py, numbers.map(|&value| (value as u64).to_ne_bytes()))),
    }
}

/// Contiguous numbers; a NumPy array over them is writable.
pub(crate) fn bytes<const N: usize>(py: Python<'_>, numbers: impl Iterator<Item = [u8; N]>) -> Bound<'_, PyByteArray> {
    PyByteArray::new(py, &numbers.flatten().collect::<Vec<u8>>())
}

/// The reverse: single-precision numbers from bytes, whole numbers only.
pub(crate) fn singles(bytes: &[u8]) -> Vec<f32> {
    let (numbers, _) = bytes.as_chunks::<4>();
    numbers.iter().map(|&number| f32::from_ne_bytes(number)).collect()
}

/// Double-precision numbers from bytes.
pub(crate) fn doubles(bytes: &[u8]) -> Vec<f64> {
    let (numbers, _) = bytes.as_chunks::<8>();
    numbers.iter().map(|&number| f64::from_ne_bytes(number)).collect()
}

fn chosen(known: &[Column], patterns: &[String]) -> PyResult<Vec<usize>> {
    let mut places = Vec::new();
    for pattern in patterns {
        let fits = |name: &str| match pattern.strip_suffix('*') {
            Some(beginning) => name.starts_with(beginning),
            None => name == pattern,
        };
        let before = places.len();
        places.extend((0..known.len()).filter(|&place| fits(&known[place].name)));
        if places.len() == before {
            let near = nearest(pattern, known.iter().map(|column| column.name.as_str()));
            let hint = near.map_or(String::new(), |name| format!("; did you mean '{name}'?"));
            return Err(input(format!(
                "there is no column '{pattern}' in the telemetry of a flight{hint}"
            )));
        }
    }
    places.sort_unstable();
    places.dedup();
    Ok(places)
}
