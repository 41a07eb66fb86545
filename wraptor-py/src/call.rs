//! What calls share: limits, names, progress, and a wait that ^C ends.

use std::ops::ControlFlow;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use hil_sim::input::did_you_mean;
use pyo3::prelude::*;
use tater_wire::property::ROWS;
use wraptor::{DownloadProgress, Node, Progress, Property};

use crate::errors;

/// Time between two looks for ^C.
const SIGNALS: Duration = Duration::from_millis(50);

/// Locks what a panic cannot leave half changed.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A limit in seconds.
///
/// # Errors
/// `ValueError`: it is not above 0, or above 10⁹.
pub fn limit(seconds: f64) -> PyResult<Duration> {
    if seconds > 0.0 && seconds <= 1e9 {
        return Ok(Duration::from_secs_f64(seconds));
    }
    Err(errors::value("limit", &seconds.to_string(), "seconds above 0", "give how long the call may take"))
}

/// A property by its name, case-insensitive.
///
/// # Errors
/// `ValueError` with the nearest name.
pub fn property(name: &str) -> PyResult<Property> {
    Property::named(name).ok_or_else(|| {
        let next = did_you_mean(name, ROWS.iter().map(|row| row.name));
        let next = next.unwrap_or_else(|| "see docs/properties.md for all of them".to_owned());
        errors::value("property", &format!("{name:?}"), "a name such as KP", &next)
    })
}

/// A node of the bus.
///
/// # Errors
/// `ValueError`: there is none of this number.
pub fn node(number: u8) -> PyResult<Node> {
    Node::new(number).ok_or_else(|| {
        errors::value("node", &number.to_string(), "0 to 31", "a hand's motor boards are 1 to 7")
    })
}

/// Shows the progress of a call to Python and looks for ^C. Keeps the exception that ends the call.
pub struct Watch {
    callback: Option<Py<PyAny>>,
    raised: Mutex<Option<PyErr>>,
}

impl Watch {
    /// A watch with the user's callback, if there is one. It gets the seconds since the call and the values by node, and ends the call if
    /// it returns `False`.
    pub const fn new(callback: Option<Py<PyAny>>) -> Self {
        Self { callback, raised: Mutex::new(None) }
    }

    /// The progress of a call.
    pub fn on(&self, progress: &Progress) -> ControlFlow<()> {
        let values: Vec<(u8, i64)> =
            progress.values.iter().map(|(node, value)| (node.number(), *value)).collect();
        self.show(|callback, py| {
            let values = pyo3::types::IntoPyDict::into_py_dict(values, py)?;
            callback.call1(py, (progress.elapsed.as_secs_f64(), values))
        })
    }

    /// The progress of a download: its callback gets the seconds since the call, the node and the percent sent.
    pub fn on_download(&self, progress: &DownloadProgress) -> ControlFlow<()> {
        let (elapsed, node) = (progress.elapsed.as_secs_f64(), progress.node.number());
        self.show(|callback, py| callback.call1(py, (elapsed, node, progress.percent())))
    }

    fn show(&self, call: impl FnOnce(&Py<PyAny>, Python<'_>) -> PyResult<Py<PyAny>>) -> ControlFlow<()> {
        let shown = Python::attach(|py| {
            py.check_signals()?;
            let Some(callback) = &self.callback else { return Ok(true) };
            let answer = call(callback, py)?;
            Ok(answer.is_none(py) || answer.is_truthy(py)?)
        });
        match shown {
            Ok(true) => ControlFlow::Continue(()),
            Ok(false) => ControlFlow::Break(()),
            Err(error) => {
                lock(&self.raised).get_or_insert(error);
                ControlFlow::Break(())
            }
        }
    }

    /// The outcome of the call, or the exception that ended it.
    ///
    /// # Errors
    /// The callback's, `KeyboardInterrupt`, or the call's own.
    pub fn outcome<R>(self, outcome: PyResult<R>) -> PyResult<R> {
        match self.raised.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(error) => Err(error),
            None => outcome,
        }
    }
}

/// Waits for another thread's answer without the GIL. On ^C it calls `stop` once, after which the answer is to come soon.
///
/// # Errors
/// `KeyboardInterrupt`; `RuntimeError` if the thread has ended.
pub fn wait<R: Send>(py: Python<'_>, mut answer: Receiver<R>, stop: impl Fn()) -> PyResult<R> {
    let mut interrupt = None;
    loop {
        let next = &mut answer;
        match py.detach(move || next.recv_timeout(SIGNALS)) {
            Ok(answer) => return interrupt.map_or(Ok(answer), Err),
            Err(RecvTimeoutError::Disconnected) => return Err(errors::panicked()),
            Err(RecvTimeoutError::Timeout) if interrupt.is_none() => {
                if let Err(error) = py.check_signals() {
                    stop();
                    interrupt = Some(error);
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}
