//! A scenario document with its vehicle, checked once and flown any number of times.

use crate::refusal::{input, pickled};
use pyo3::prelude::*;
use rotortwin_scenario::names::{Kind, find, is_name};
use std::path::PathBuf;
use std::sync::Arc;

/// The file of a document that is given by its path or its name.
pub(crate) fn find_named(kind: Kind, given: PathBuf) -> PyResult<PathBuf> {
    match given.to_str() {
        Some(name) if is_name(name) && !given.exists() => find(kind, name).map_err(input),
        _ => Ok(given),
    }
}

/// A scenario, by the path of its file or by a name that `rotortwin list scenarios` shows.
#[pyclass(frozen, module = "rotortwin._native")]
pub(crate) struct Scenario {
    pub(crate) inner: Arc<rotortwin_scenario::Scenario>,
}

#[pymethods]
impl Scenario {
    #[new]
    #[pyo3(signature = (scenario, settings = Vec::new()))]
    fn new(scenario: PathBuf, settings: Vec<String>) -> PyResult<Self> {
        let path = find_named(Kind::Scenario, scenario)?;
        let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
        let inner = rotortwin_scenario::Scenario::load_with(path, &settings).map_err(input)?;
        Ok(Self { inner: Arc::new(inner) })
    }

    #[getter]
    fn name(&self) -> &str {
        self.inner.name()
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.inner.seed()
    }

    #[getter]
    fn steps(&self) -> u64 {
        self.inner.duration_steps()
    }

    #[getter]
    fn rotor_count(&self) -> usize {
        self.inner.vehicle().rotor_count()
    }

    /// Nothing can change it.
    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(pickled(
            "a Scenario",
            "its name or file, and `set`, to be sent, and a Scenario to be made of them there",
        ))
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.inner.warnings()
    }
}
