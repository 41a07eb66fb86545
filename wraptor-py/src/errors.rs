//! Errors of the libraries as the exceptions of `python/wraptor/_errors.py`.

use hil_sim::input::BadInput;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use wraptor::{CallError, ConnectError, Failure};

/// A class of `_errors.py`.
fn class<'py>(py: Python<'py>, cell: &PyOnceLock<Py<PyType>>, name: &str) -> PyResult<Bound<'py, PyType>> {
    cell.import(py, "wraptor._errors", name).cloned()
}

/// The exception, or why there is none.
fn made(exception: PyResult<Bound<'_, PyAny>>) -> PyErr {
    exception.map_or_else(|error| error, PyErr::from_value)
}

/// Name of an enum's variant.
fn variant(value: &impl std::fmt::Debug) -> String {
    format!("{value:?}").chars().take_while(char::is_ascii_alphanumeric).collect()
}

/// A `ConnectError`.
pub fn connect(py: Python<'_>, error: &ConnectError) -> PyErr {
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let arguments = (error.to_string(), error.place.as_str(), variant(&error.cause), error.cause.next_step());
    made(class(py, &CLASS, "ConnectError").and_then(|class| class.call1(arguments)))
}

/// A `CallError`; its subclass `CallTimeout` after the limit.
pub fn call(py: Python<'_>, error: &CallError) -> PyErr {
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    static TIMEOUT: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let status = match &error.failure {
        Failure::Status(status) => status.code(),
        _ => 0,
    };
    let class = match error.failure {
        Failure::TimedOut(_) => class(py, &TIMEOUT, "CallTimeout"),
        _ => class(py, &CLASS, "CallError"),
    };
    let arguments =
        (error.to_string(), error.call.as_str(), variant(&error.failure), error.failure.next_step(), status);
    made(class.and_then(|class| class.call1(arguments)))
}

/// A `ValueError` for what the user gave.
pub fn bad_input(error: &BadInput) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// A `ValueError`: what was found, what is expected, and the next step.
pub fn value(what: &str, found: &str, expected: &str, next: &str) -> PyErr {
    PyValueError::new_err(format!("{what}: found {found}, expected {expected}\n  next: {next}"))
}

/// A `RuntimeError`: a thread of ours has panicked.
pub fn panicked() -> PyErr {
    PyRuntimeError::new_err("a defect of wraptor ended this object's thread; report it with the lines above")
}
