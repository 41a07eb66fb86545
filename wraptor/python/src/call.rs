//! What calls share: limits, names, progress, and a wait that ^C ends.

use std::ops::{ControlFlow, RangeInclusive};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use pyo3::exceptions::{PyOverflowError, PyTypeError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBool, PyByteArray, PyBytes, PyInt, PyMemoryView};
use tater_wire::property::ROWS;
use traces::input::did_you_mean;
use wraptor::{Deadline, DownloadProgress, Node, Progress, Property};

use crate::errors;

/// Time between two looks for ^C.
const SIGNALS: Duration = Duration::from_millis(50);

/// Time for a thread to stop after ^C.
const STOPPED: Duration = Duration::from_secs(1);

/// Locks what a panic cannot leave half changed.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Longest limit and longest step, s.
pub const MOST_SECONDS: f64 = 1e9;

/// A limit in seconds.
///
/// # Errors
/// `ValueError`: it is not above 0, or above [`MOST_SECONDS`].
pub fn limit(seconds: f64) -> PyResult<Duration> {
    if seconds > 0.0 && seconds <= MOST_SECONDS {
        return Ok(Duration::from_secs_f64(seconds));
    }
    let expected = format!("seconds above 0, at most {MOST_SECONDS}");
    Err(errors::value("limit", &seconds.to_string(), &expected, "give how long the call may take"))
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
pub fn node(number: i64) -> PyResult<Node> {
    u8::try_from(number).ok().and_then(Node::new).ok_or_else(|| {
        errors::value("node", &number.to_string(), "0 to 31", "a hand's motor boards are 1 to 7")
    })
}

/// An integer that an argument can hold.
pub trait Whole: for<'a, 'py> FromPyObject<'a, 'py, Error = PyErr> {
    /// Its range.
    const RANGE: RangeInclusive<i128>;
}

macro_rules! whole {
    ($($integer:ty)*) => {
        $(impl Whole for $integer {
            const RANGE: RangeInclusive<i128> = <$integer>::MIN as i128..=<$integer>::MAX as i128;
        })*
    };
}

whole!(u8 u16 u32 u64 i64);

/// An integer argument.
///
/// # Errors
/// `ValueError` instead of `OverflowError`: it is out of range; `TypeError`: it is none.
pub fn whole<T: Whole>(argument: &Bound<'_, PyAny>) -> PyResult<T> {
    argument.extract().map_err(|error: PyErr| match error.is_instance_of::<PyOverflowError>(argument.py()) {
        true => {
            let expected = format!("a whole number from {} to {}", T::RANGE.start(), T::RANGE.end());
            errors::value("argument", &argument.to_string(), &expected, "give a number in this range")
        }
        false => error,
    })
}

/// The same, or `None`.
///
/// # Errors
/// As of [`whole`].
pub fn whole_or_none<T: Whole>(argument: &Bound<'_, PyAny>) -> PyResult<Option<T>> {
    if argument.is_none() { Ok(None) } else { whole(argument).map(Some) }
}

/// The same, of each item of a sequence.
///
/// # Errors
/// As of [`whole`].
pub fn wholes<T: Whole>(argument: &Bound<'_, PyAny>) -> PyResult<Vec<T>> {
    argument.extract::<Vec<Bound<'_, PyAny>>>()?.iter().map(whole).collect()
}

/// A path: text, bytes or `os.PathLike`.
///
/// # Errors
/// `TypeError`: another argument.
pub fn path(argument: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    static DECODE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    DECODE.import(argument.py(), "os", "fsdecode")?.call1((argument,))?.extract()
}

/// The same, or `None`.
///
/// # Errors
/// As of [`path`].
pub fn path_or_none(argument: &Bound<'_, PyAny>) -> PyResult<Option<PathBuf>> {
    if argument.is_none() { Ok(None) } else { path(argument).map(Some) }
}

/// Bytes, a bytearray or a memoryview.
///
/// # Errors
/// `TypeError`: another argument.
pub fn bytes(argument: &Bound<'_, PyAny>) -> PyResult<Vec<u8>> {
    if let Ok(array) = argument.cast::<PyByteArray>() {
        return Ok(array.to_vec());
    }
    let is_view = argument.is_instance_of::<PyMemoryView>();
    let bytes = if is_view { &argument.call_method0("tobytes")? } else { argument };
    match bytes.cast::<PyBytes>() {
        Ok(bytes) => Ok(bytes.as_bytes().to_vec()),
        Err(_) => {
            let text = format!("found {}, expected bytes, a bytearray or a memoryview", argument.repr()?);
            Err(PyTypeError::new_err(text))
        }
    }
}

/// A function of the user.
pub struct Callback(pub Py<PyAny>);

impl FromPyObject<'_, '_> for Callback {
    type Error = PyErr;

    fn extract(argument: Borrowed<'_, '_, PyAny>) -> PyResult<Self> {
        match argument.is_callable() {
            true => Ok(Self(argument.to_owned().unbind())),
            false => Err(PyTypeError::new_err(format!("found {}, expected a function", argument.repr()?))),
        }
    }
}

/// Shows the progress of a call to Python and looks for ^C. Keeps the exception that ends the call.
pub struct Watch {
    callback: Option<Callback>,
    raised: Mutex<Option<PyErr>>,
}

impl Watch {
    /// A watch with the user's callback, if there is one. It gets the seconds since the call and the values by node, and ends the call if
    /// it returns `False`.
    pub const fn new(callback: Option<Callback>) -> Self {
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
            let Some(Callback(callback)) = &self.callback else { return Ok(true) };
            let answer = call(callback, py)?;
            let answer = answer.bind(py);
            // numpy's False, too, and not 0.
            let is_number = answer.is_instance_of::<PyInt>() && !answer.is_instance_of::<PyBool>();
            Ok(answer.is_none() || is_number || !answer.eq(false)?)
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

/// Waits for another thread's answer without the GIL. On ^C it calls `stop` once, after which it waits a second at most.
///
/// # Errors
/// `KeyboardInterrupt`; `gone` if the thread has ended.
pub fn wait<R: Send>(
    py: Python<'_>,
    mut answer: Receiver<R>,
    stop: impl Fn(),
    gone: fn() -> PyErr,
) -> PyResult<R> {
    let mut interrupt: Option<(PyErr, Deadline)> = None;
    loop {
        let next = &mut answer;
        match py.detach(move || next.recv_timeout(SIGNALS)) {
            Ok(answer) => return interrupt.map_or(Ok(answer), |(error, _)| Err(error)),
            Err(RecvTimeoutError::Disconnected) => return Err(gone()),
            Err(RecvTimeoutError::Timeout) => {
                if let Some((error, _)) = interrupt.take_if(|(_, deadline)| deadline.is_over()) {
                    return Err(error);
                }
                if interrupt.is_none()
                    && let Err(error) = py.check_signals()
                {
                    stop();
                    interrupt = Some((error, Deadline::after(STOPPED)));
                }
            }
        }
    }
}
