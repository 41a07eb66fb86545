//! RealTime control. The connection moves to a thread of its own, which borrows it for as long as RealTime lasts, and then comes back.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{self, Builder, JoinHandle, ThreadId};
use std::time::Duration;

use pyo3::exceptions::{PyRuntimeError, PyTimeoutError};
use pyo3::prelude::*;
use wraptor::turns::Turn;
use wraptor::{CallError, Control, Deadline, Format, NoTurn, Turns};

use crate::call::{limit, wait};
use crate::connection::{Connection, no_turn};
use crate::errors;

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
    End(Duration),
}

struct Loop {
    orders: Sender<Order>,
    thread: JoinHandle<Result<(), CallError>>,
}

/// RealTime control of some motors.
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
                    // Dropped, which ends it with ^C.
                    Err(_) => break,
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
        hand: wraptor::Hand,
        home: Arc<Connection<wraptor::Hand>>,
        choice: Choice,
    ) -> PyResult<Self> {
        let (started, start) = channel();
        let (orders, inbox) = channel();
        let run = move || serve(hand, &home, &choice, &started, &inbox);
        let thread = Builder::new().name("wraptor RealTime".to_owned()).spawn(run)?;
        let (worker, stop) = (thread.thread().id(), Arc::default());
        let mut realtime = Self { running: Turns::new(Some(Loop { orders, thread })), worker, stop, axes: 0 };
        // Dropping it brings the hand back after an error.
        realtime.axes = wait(py, start, || {})?.map_err(|error| errors::call(py, &error))?;
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
        let ended = || PyRuntimeError::new_err("RealTime has ended\n  next: call Hand.realtime again");
        let running = turn.as_ref().ok_or_else(ended)?;
        self.stop.store(false, Ordering::Relaxed);
        let (answer, answers) = channel();
        let order = Order::Do(Box::new(move |realtime| _ = answer.send(job(realtime))));
        running.orders.send(order).map_err(|_| errors::panicked())?;
        wait(py, answers, || self.stop.store(true, Ordering::Relaxed))
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
        let Some(Loop { orders, thread }) = turn.take() else { return Ok(()) };
        if waits_for_prompt {
            // It has ended by itself otherwise.
            let _ = orders.send(Order::End(deadline.remaining()));
        }
        drop(orders);
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
        if let Some(Loop { orders, thread }) = running {
            drop(orders);
            // A panic is reported by the thread itself.
            let _ = thread.join();
        }
    }
}

/// A velocity, or a velocity and a gain.
#[derive(FromPyObject)]
enum Wanted {
    Velocity(f64),
    WithGain(f64, u8),
}

impl Wanted {
    fn control(self) -> Control {
        // Rounded and clipped to a byte by the block.
        let control = |velocity: f64, gain| Control { velocity: velocity.round() as i32, gain };
        match self {
            Self::Velocity(velocity) => control(velocity, 0),
            Self::WithGain(velocity, gain) => control(velocity, gain),
        }
    }
}

fn controls(wanted: Vec<Wanted>) -> Vec<Control> {
    wanted.into_iter().map(Wanted::control).collect()
}

/// Calls the user's control function; `None` ends the loop.
fn ask(
    control: &Py<PyAny>,
    number: u64,
    feedback: &wraptor::Feedback,
) -> PyResult<ControlFlow<(), Vec<Control>>> {
    Python::attach(|py| {
        let wanted = control.call1(py, (number, Feedback::new(feedback)))?;
        let wanted: Option<Vec<Wanted>> = wanted.extract(py)?;
        Ok(wanted.map_or(ControlFlow::Break(()), |wanted| ControlFlow::Continue(controls(wanted))))
    })
}

#[pymethods]
impl RealTime {
    #[getter]
    const fn axes(&self) -> usize {
        self.axes
    }

    #[pyo3(signature = (controls, limit=1.0))]
    fn exchange(&self, py: Python<'_>, controls: Vec<Wanted>, limit: f64) -> PyResult<Feedback> {
        let (limit, controls) = (self::limit(limit)?, self::controls(controls));
        let feedback = self.run(py, limit, move |realtime| realtime.exchange(&controls, limit))?;
        feedback.map(|feedback| Feedback::new(&feedback)).map_err(|error| errors::call(py, &error))
    }

    #[pyo3(name = "run", signature = (rate, control, limit=1.0))]
    fn run_at(&self, py: Python<'_>, rate: f64, control: Py<PyAny>, limit: f64) -> PyResult<Statistics> {
        let limit = self::limit(limit)?;
        let stopped = Arc::clone(&self.stop);
        let job = move |realtime: &mut wraptor::RealTime<'_>| {
            let mut raised = None;
            let outcome = realtime.run(rate, limit, |number, feedback| {
                if stopped.load(Ordering::Relaxed) {
                    return ControlFlow::Break(());
                }
                ask(&control, number, feedback).unwrap_or_else(|error| {
                    raised = Some(error);
                    ControlFlow::Break(())
                })
            });
            (outcome, raised)
        };
        match self.run(py, limit, job)? {
            (_, Some(raised)) => Err(raised),
            (outcome, None) => outcome.map(Statistics::new).map_err(|error| errors::call(py, &error)),
        }
    }

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

/// A feedback block.
#[pyclass(module = "wraptor", frozen, get_all)]
pub struct Feedback {
    positions: Option<Vec<i32>>,
    velocities: Option<Vec<i32>>,
    strains: Option<Vec<i32>>,
    changes: Option<Vec<i32>>,
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
    blocks: u64,
    elapsed: f64,
    rate: f64,
    missed: u64,
    jitter: (f64, f64, f64),
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
