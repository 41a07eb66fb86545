//! RealTime control. The connection moves to a thread of its own, which borrows it for as long as RealTime lasts, and then comes back.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::{self, Builder, JoinHandle, ThreadId};
use std::time::Duration;

use pyo3::exceptions::{PyRuntimeError, PyTimeoutError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use wraptor::turns::Turn;
use wraptor::{CallError, Control, Deadline, Format, NoTurn, Turns};

use crate::call::{Callback, limit, wait, whole};
use crate::connection::{Connection, no_turn};
use crate::errors::{self, caused};

/// Limit of the end of a `with`.
const END: Duration = Duration::from_secs(2);

/// How often a run of another thread is told to end.
const STOPS: Duration = Duration::from_millis(20);

/// What RealTime is begun with.
pub struct Choice {
    /// The prefix of LOOP.
    pub motors: String,
    /// What the blocks hold.
    pub format: Format,
    /// For the begin.
    pub limit: Duration,
}

enum Order {
    Do(Box<dyn FnOnce(&mut wraptor::RealTime<'_>) + Send>),
    /// With its prompt, within this.
    End(Duration),
    /// At once.
    Drop,
}

struct Loop {
    orders: Sender<Order>,
    /// Disconnected once the hand is back.
    is_back: Receiver<()>,
    thread: JoinHandle<Result<(), CallError>>,
}

/// RealTime control; motors stop when the host is silent for 250 ms. Use it in `with`.
#[pyclass(module = "wraptor", frozen)]
pub struct RealTime {
    /// `None` once it has ended.
    running: Turns<Option<Loop>>,
    /// RealTime's thread, which runs the control functions.
    worker: ThreadId,
    /// Whether a run is to end.
    stop: Arc<AtomicBool>,
    axes: usize,
}

/// Runs RealTime until it is ended, and brings the connection back.
fn serve(
    mut hand: wraptor::Hand,
    home: &Connection<wraptor::Hand>,
    choice: &Choice,
    started: &Sender<Result<usize, CallError>>,
    orders: &Receiver<Order>,
) -> Result<(), CallError> {
    let mut outcome = Ok(());
    match hand.realtime(&choice.motors, choice.format, choice.limit) {
        Ok(mut realtime) => {
            // Nobody waits any more after ^C.
            let _ = started.send(Ok(realtime.axes()));
            loop {
                match orders.recv() {
                    Ok(Order::Do(job)) => job(&mut realtime),
                    Ok(Order::End(limit)) => {
                        outcome = realtime.end(limit);
                        break;
                    }
                    // Dropping it sends ^C.
                    Ok(Order::Drop) | Err(_) => break,
                }
            }
        }
        Err(error) => _ = started.send(Err(error)),
    }
    home.bring_back(hand);
    outcome
}

impl RealTime {
    /// Begins it.
    ///
    /// # Errors
    /// `CallError`, with the hand back in its place.
    pub fn start(
        py: Python<'_>,
        home: &Arc<Connection<wraptor::Hand>>,
        mut choice: Choice,
    ) -> PyResult<Self> {
        let (started, start) = channel();
        let (orders, inbox) = channel();
        let (done, is_done) = channel::<()>();
        let (back, is_back) = channel::<()>();
        let stop = Arc::<AtomicBool>::default();
        let (ends, stops) = (orders.clone(), Arc::clone(&stop));
        let end = move || {
            stops.store(true, Ordering::Relaxed);
            // It may have ended by itself. A control function that closes its own hand does not wait for itself for long.
            if ends.send(Order::Drop).is_ok() {
                let _ = is_done.recv_timeout(END);
            }
        };
        let (hand, left) = home.take(py, choice.limit, Some(Box::new(end)))?;
        choice.limit = left;
        let home = Arc::clone(home);
        let run = move || {
            let outcome = serve(hand, &home, &choice, &started, &inbox);
            drop((done, back));
            outcome
        };
        let thread = Builder::new().name("wraptor RealTime".to_owned()).spawn(run)?;
        let worker = thread.thread().id();
        let mut realtime =
            Self { running: Turns::new(Some(Loop { orders, is_back, thread })), worker, stop, axes: 0 };
        // Dropping it brings the hand back after an error.
        realtime.axes =
            wait(py, start, || {}, errors::panicked)?.map_err(|error| errors::call(py, &error))?;
        Ok(realtime)
    }

    /// A turn of this thread. A control function has none: it is part of a run.
    fn turn(&self, py: Python<'_>, limit: Duration) -> PyResult<Turn<'_, Option<Loop>>> {
        if thread::current().id() == self.worker {
            return Err(no_turn(NoTurn::Own, limit));
        }
        py.detach(|| self.running.take(&Deadline::after(limit))).map_err(|why| no_turn(why, limit))
    }

    /// Runs a job on RealTime's thread; ^C sets `stop`.
    fn run<R: Send + 'static>(
        &self,
        py: Python<'_>,
        limit: Duration,
        job: impl FnOnce(&mut wraptor::RealTime<'_>) -> R + Send + 'static,
    ) -> PyResult<R> {
        let turn = self.turn(py, limit)?;
        let running = turn.as_ref().ok_or_else(ended)?;
        self.stop.store(false, Ordering::Relaxed);
        let (answer, answers) = channel();
        let order = Order::Do(Box::new(move |realtime| _ = answer.send(job(realtime))));
        // Its hand was closed.
        running.orders.send(order).map_err(|_| ended())?;
        wait(py, answers, || self.stop.store(true, Ordering::Relaxed), ended)
    }

    /// Ends it, and a run of another thread before, with ^C and its prompt within the limit, or without waiting for the prompt; then the hand
    /// is back in its place.
    fn finish(&self, py: Python<'_>, limit: Duration, waits_for_prompt: bool) -> PyResult<()> {
        let deadline = Deadline::after(limit);
        let mut turn = loop {
            self.stop.store(true, Ordering::Relaxed);
            match self.turn(py, deadline.remaining().min(STOPS)) {
                Err(error) if deadline.is_over() || !error.is_instance_of::<PyTimeoutError>(py) => {
                    return Err(error);
                }
                Err(_) => {}
                Ok(turn) => break turn,
            }
        };
        let Some(Loop { orders, is_back, thread }) = turn.take() else { return Ok(()) };
        let order = if waits_for_prompt { Order::End(deadline.remaining()) } else { Order::Drop };
        // It may have ended by itself.
        let _ = orders.send(order);
        let left = deadline.remaining();
        if py.detach(move || is_back.recv_timeout(left)) == Err(RecvTimeoutError::Timeout) {
            // A hand that does not answer: the thread brings it back after the limit of its block.
            return if waits_for_prompt { Err(errors::late(py, limit)) } else { Ok(()) };
        }
        let outcome = py.detach(|| thread.join()).map_err(|_| errors::panicked())?;
        outcome.map_err(|error| errors::call(py, &error))
    }
}

impl Drop for RealTime {
    /// Ends it, so that the hand is back in its place.
    fn drop(&mut self) {
        // Nobody else uses it any more.
        let running =
            self.running.take(&Deadline::after(Duration::ZERO)).ok().and_then(|mut turn| turn.take());
        if let Some(Loop { orders, is_back, .. }) = running {
            let _ = orders.send(Order::Drop);
            let _ = is_back.recv_timeout(END);
        }
    }
}

fn ended() -> PyErr {
    PyRuntimeError::new_err("RealTime has ended\n  next: end() it, then call Hand.realtime again")
}

/// The exception of a call; `None`: RealTime had ended before it.
fn raised(py: Python<'_>, error: Option<CallError>) -> PyErr {
    error.map_or_else(ended, |error| errors::call(py, &error))
}

/// A velocity, or a velocity and a gain.
fn control(wanted: &Bound<'_, PyAny>) -> PyResult<Control> {
    let (velocity, gain) = match wanted.cast::<PyTuple>() {
        Ok(pair) => {
            let (velocity, gain) = pair.extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>()?;
            (velocity.extract::<f64>()?, whole(&gain)?)
        }
        Err(_) => (wanted.extract::<f64>()?, 0),
    };
    if !velocity.is_finite() {
        let next = "check how the velocity is computed";
        return Err(errors::value("velocity", &velocity.to_string(), "hall counts/s", next));
    }
    // Rounded and clipped to a byte by the block.
    Ok(Control { velocity: velocity.round() as i32, gain })
}

/// A sequence of controls.
///
/// # Errors
/// `TypeError`: an item is no control; `ValueError`: it is out of range.
fn controls(wanted: &Bound<'_, PyAny>) -> PyResult<Vec<Control>> {
    let py = wanted.py();
    let item = |(index, item): (usize, Bound<'_, PyAny>)| {
        control(&item).map_err(|error| match error.is_instance_of::<PyTypeError>(py) {
            true => {
                let found = item.repr().map_or_else(|_| String::new(), |text| text.to_string());
                let text = format!(
                    "controls[{index}]: found {found}, expected a velocity, or a tuple of a velocity and a gain"
                );
                caused(py, PyTypeError::new_err(text), error)
            }
            false => error,
        })
    };
    wanted.extract::<Vec<Bound<'_, PyAny>>>()?.into_iter().enumerate().map(item).collect()
}

/// Calls the user's control function; `None` ends the loop.
fn ask(
    control: &Py<PyAny>,
    number: u64,
    feedback: &wraptor::Feedback,
) -> PyResult<ControlFlow<(), Vec<Control>>> {
    Python::attach(|py| {
        let wanted = control.call1(py, (number, Feedback::new(feedback)))?;
        match wanted.is_none(py) {
            true => Ok(ControlFlow::Break(())),
            false => controls(wanted.bind(py)).map(ControlFlow::Continue),
        }
    })
}

#[pymethods]
impl RealTime {
    /// Number of motors in each block.
    #[getter]
    const fn axes(&self) -> usize {
        self.axes
    }

    /// Sends a control block, one control for each motor, and waits for its feedback. Velocities are rounded to the unit of the
    /// format and clipped to a byte; a gain counts with gain=True alone.
    #[pyo3(signature = (controls, limit=1.0))]
    fn exchange(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = controls)] controls: Vec<Control>,
        limit: f64,
    ) -> PyResult<Feedback> {
        let limit = self::limit(limit)?;
        let job = move |realtime: &mut wraptor::RealTime<'_>| {
            if realtime.is_over() { Err(None) } else { realtime.exchange(&controls, limit).map_err(Some) }
        };
        let feedback = self.run(py, limit, job)?;
        feedback.map(|feedback| Feedback::new(&feedback)).map_err(|error| raised(py, error))
    }

    /// Exchanges `rate` blocks a second, 1 to 1000, until `control` returns None. It gets the number of the block and the last feedback.
    /// Each block has the limit to itself.
    #[pyo3(name = "run", signature = (rate, control, limit=1.0))]
    fn run_at(&self, py: Python<'_>, rate: f64, control: Callback, limit: f64) -> PyResult<Statistics> {
        let limit = self::limit(limit)?;
        let stopped = Arc::clone(&self.stop);
        let job = move |realtime: &mut wraptor::RealTime<'_>| {
            if realtime.is_over() {
                return (Err(None), None);
            }
            let mut raised = None;
            let outcome = realtime.run(rate, limit, |number, feedback| {
                if stopped.load(Ordering::Relaxed) {
                    return ControlFlow::Break(());
                }
                ask(&control.0, number, feedback).unwrap_or_else(|error| {
                    raised = Some(error);
                    ControlFlow::Break(())
                })
            });
            (outcome.map_err(Some), raised)
        };
        match self.run(py, limit, job)? {
            (_, Some(raised)) => Err(raised),
            (outcome, None) => outcome.map(Statistics::new).map_err(|error| raised(py, error)),
        }
    }

    /// Ends RealTime, and a run of another thread with its next block; the hand takes calls again.
    #[pyo3(signature = (limit=2.0))]
    fn end(&self, py: Python<'_>, limit: f64) -> PyResult<()> {
        self.finish(py, self::limit(limit)?, true)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    /// After an exception without waiting for the prompt, so that the exception remains.
    fn __exit__(
        &self,
        py: Python<'_>,
        kind: &Bound<'_, PyAny>,
        _value: &Bound<'_, PyAny>,
        _traceback: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        match kind.is_none() {
            true => self.finish(py, END, true),
            false => self.finish(py, END, false),
        }
    }
}

/// A feedback block, each motor in the order of the prefix; None for what the format lacks, and before the first block.
#[pyclass(module = "wraptor", frozen, get_all)]
pub struct Feedback {
    /// GCL counts.
    positions: Option<Vec<i32>>,
    /// Hall counts/s.
    velocities: Option<Vec<i32>>,
    /// 0 to 255.
    strains: Option<Vec<i32>>,
    /// Since the last report, GCL counts.
    changes: Option<Vec<i32>>,
    /// Of GOD's board, degrees Celsius.
    temperature: Option<f64>,
}

impl Feedback {
    fn new(feedback: &wraptor::Feedback) -> Self {
        let all = |get: fn(&wraptor::Axis) -> Option<i32>| {
            let values: Option<Vec<i32>> = feedback.axes.iter().map(get).collect();
            values.filter(|values| !values.is_empty())
        };
        Self {
            positions: all(|axis| axis.position),
            velocities: all(|axis| axis.velocity),
            strains: all(|axis| axis.strain.map(i32::from)),
            changes: all(|axis| axis.change),
            temperature: feedback.temperature,
        }
    }
}

/// How regular a run at a fixed rate was; times in seconds.
#[pyclass(module = "wraptor", frozen, get_all)]
pub struct Statistics {
    /// Number of blocks.
    blocks: u64,
    /// From the first block to the last answer.
    elapsed: f64,
    /// Blocks a second.
    rate: f64,
    /// Places of the schedule that were left out.
    missed: u64,
    /// How late blocks were sent: median, 99th percentile, maximum.
    jitter: (f64, f64, f64),
    /// From a block to its answer: median, 99th percentile, maximum.
    round_trip: (f64, f64, f64),
}

impl Statistics {
    fn new(of: wraptor::Statistics) -> Self {
        let seconds = |times: [Duration; 3]| times.map(|time| time.as_secs_f64()).into();
        Self {
            blocks: of.blocks,
            elapsed: of.elapsed.as_secs_f64(),
            rate: of.rate,
            missed: of.missed,
            jitter: seconds(of.jitter),
            round_trip: seconds(of.round_trip),
        }
    }
}
