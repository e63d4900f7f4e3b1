//! A scenario document with its vehicle, checked once and flown any number of times.

use crate::refusal::input;
use pyo3::prelude::*;
use rotortwin_scenario::names::{Kind, find, is_name};
use std::path::PathBuf;
use std::sync::Arc;

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
        let path = match scenario.to_str() {
            Some(name) if is_name(name) && !scenario.exists() => find(Kind::Scenario, name).map_err(input)?,
            _ => scenario,
        };
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

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.inner.warnings()
    }
}
