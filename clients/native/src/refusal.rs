//! Errors as Python sees them: one sentence each.

use pyo3::PyErr;
use pyo3::exceptions::{PyRuntimeError, PyTypeError, PyValueError};

pyo3::create_exception!(
    rotortwin,
    InputError,
    PyValueError,
    "A name, file, value or log that cannot be used: what, where, and what was expected."
);
pyo3::create_exception!(
    rotortwin,
    FlightError,
    PyRuntimeError,
    "A flight that cannot continue: the step, and which of its numbers is not finite."
);

/// Bad input.
pub(crate) fn input(sentence: impl std::fmt::Display) -> PyErr {
    InputError::new_err(sentence.to_string())
}

/// A flight has ended unexpectedly.
pub(crate) fn flight(sentence: impl std::fmt::Display) -> PyErr {
    FlightError::new_err(sentence.to_string())
}

/// State of this process was to be written down.
pub(crate) fn pickled(what: &str, instead: &str) -> PyErr {
    PyTypeError::new_err(format!("{what} cannot be pickled; expected {instead}"))
}
