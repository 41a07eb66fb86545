//! Errors of the libraries as the exceptions of `python/wraptor/_errors.py`.

use std::time::Duration;

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use traces::input::BadInput;
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

/// An error of the library that is an exception.
pub trait Raised {
    /// The exception of a call with this limit: the library had what was left of it.
    fn raised(self, py: Python<'_>, limit: Duration) -> PyErr;
}

impl Raised for ConnectError {
    fn raised(self, py: Python<'_>, _: Duration) -> PyErr {
        connect(py, &self)
    }
}

impl Raised for CallError {
    fn raised(mut self, py: Python<'_>, limit: Duration) -> PyErr {
        if matches!(self.failure, Failure::TimedOut(_)) {
            self.failure = Failure::TimedOut(limit);
        }
        call(py, &self)
    }
}

/// A `CallTimeout`: a call of another thread has not ended within the limit.
pub fn late(py: Python<'_>, limit: Duration) -> PyErr {
    let next = "give it a longer limit, or cancel the other call";
    let text = format!("a call of another thread has not ended within {limit:?}\n  next: {next}");
    made(timeout(py).and_then(|class| class.call1((text, "", "TimedOut", next, 0))))
}

fn timeout(py: Python<'_>) -> PyResult<Bound<'_, PyType>> {
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    class(py, &CLASS, "CallTimeout")
}

/// A `ConnectError`.
pub fn connect(py: Python<'_>, error: &ConnectError) -> PyErr {
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let arguments = (error.to_string(), error.place.as_str(), variant(&error.cause), error.cause.next_step());
    made(class(py, &CLASS, "ConnectError").and_then(|class| class.call1(arguments)))
}

/// A `CallError`; its subclass `CallTimeout` after the limit, `InvalidArgument` for a wrong argument.
pub fn call(py: Python<'_>, error: &CallError) -> PyErr {
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    static INVALID: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let status = match &error.failure {
        Failure::Status(status) => status.code(),
        _ => 0,
    };
    let class = match error.failure {
        Failure::TimedOut(_) => timeout(py),
        Failure::Invalid(_) => class(py, &INVALID, "InvalidArgument"),
        _ => class(py, &CLASS, "CallError"),
    };
    let arguments =
        (error.to_string(), error.call.as_str(), variant(&error.failure), error.failure.next_step(), status);
    made(class.and_then(|class| class.call1(arguments)))
}

/// A `ValueError` for what the user gave, without the options and commands of `hil-sim`.
pub fn bad_input(error: BadInput) -> PyErr {
    let mut place = error.place.replacen("--set ", "properties ", 1);
    for option in ["plant ", "rig ", "supply "] {
        place = place.replacen(&format!("--{option}"), option, 1);
    }
    let next = match error.next.contains("--") {
        true => "give what is expected (docs/python.md)".to_owned(),
        false => error.next.replace("`hil-sim list`", "wraptor.sim.scenarios()"),
    };
    PyValueError::new_err(BadInput { place, next, ..error }.to_string())
}

/// A `ValueError`: what was found, what is expected, and the next step.
pub fn value(what: &str, found: &str, expected: &str, next: &str) -> PyErr {
    PyValueError::new_err(format!("{what}: found {found}, expected {expected}\n  next: {next}"))
}

/// An exception with what caused it.
pub fn caused(py: Python<'_>, error: PyErr, cause: PyErr) -> PyErr {
    error.set_cause(py, Some(cause));
    error
}

/// A `RuntimeError`: a thread of ours has panicked.
pub fn panicked() -> PyErr {
    PyRuntimeError::new_err("a defect of wraptor ended this object's thread; report it with the lines above")
}
