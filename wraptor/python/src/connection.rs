//! A connection that threads of Python use in turn. Waits and calls are without the GIL.

use std::ops::ControlFlow;
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use wraptor::turns::Turn;
use wraptor::{CallError, Deadline, NoTurn, Progress, Turns};

use crate::call::{Callback, Watch, limit};
use crate::errors::{self, Raised};

/// Longer than any call.
const LONGEST: Duration = Duration::from_secs(1_000_000_000);

enum Place<T> {
    /// Here.
    Here(Box<T>),
    /// With a `RealTime`, which brings it back; called, this ends that.
    RealTime(Ender),
    /// Closed, or part of a `Bus`.
    Closed,
}

/// Ends a `RealTime`, and waits a while until its hand is back.
pub type Ender = Box<dyn FnOnce() + Send>;

/// A hand or a bus.
pub struct Connection<T>(Turns<Place<T>>);

impl<T: Send> Connection<T> {
    pub fn new(connection: T) -> Self {
        Self(Turns::new(Place::Here(Box::new(connection))))
    }

    fn turn(&self, deadline: &Deadline) -> PyResult<Turn<'_, Place<T>>> {
        self.0.take(deadline).map_err(|why| no_turn(why, deadline.limit()))
    }

    /// Runs a call; `job` gets what is left of the limit.
    pub fn run<R: Send, E: Raised + Send>(
        &self,
        py: Python<'_>,
        seconds: f64,
        job: impl FnOnce(&mut T, Duration) -> Result<R, E> + Send,
    ) -> PyResult<R> {
        let limit = limit(seconds)?;
        let outcome = py.detach(|| {
            let deadline = Deadline::after(limit);
            let mut turn = self.turn(&deadline)?;
            Ok::<_, PyErr>(job(here(&mut turn)?, deadline.remaining()))
        })?;
        outcome.map_err(|error| error.raised(py, limit))
    }

    /// The same with progress, by which ^C ends it.
    pub fn watched<R: Send>(
        &self,
        py: Python<'_>,
        seconds: f64,
        progress: Option<Callback>,
        job: impl FnOnce(&mut T, Duration, &mut dyn FnMut(&Progress) -> ControlFlow<()>) -> Result<R, CallError>
        + Send,
    ) -> PyResult<R> {
        let watch = Watch::new(progress);
        let outcome =
            self.run(py, seconds, |connection, limit| job(connection, limit, &mut |seen| watch.on(seen)));
        watch.outcome(outcome)
    }

    /// Takes the connection out, for RealTime, or for good without an end of that. Returns what is left of the limit as well.
    pub fn take(&self, py: Python<'_>, limit: Duration, realtime: Option<Ender>) -> PyResult<(T, Duration)> {
        let instead = realtime.map_or(Place::Closed, Place::RealTime);
        py.detach(|| {
            let deadline = Deadline::after(limit);
            let mut turn = self.turn(&deadline)?;
            here(&mut turn)?;
            match std::mem::replace(&mut *turn, instead) {
                Place::Here(connection) => Ok((*connection, deadline.remaining())),
                // It was here.
                Place::RealTime(_) | Place::Closed => Err(errors::panicked()),
            }
        })
    }

    /// Brings the connection back from RealTime; one that was closed meanwhile is dropped.
    pub fn bring_back(&self, connection: T) {
        if let Ok(mut turn) = self.0.take(&Deadline::after(LONGEST))
            && matches!(*turn, Place::RealTime(_))
        {
            *turn = Place::Here(Box::new(connection));
        }
    }

    /// What it is used for, for people.
    pub fn state(&self) -> &'static str {
        match self.0.take(&Deadline::after(Duration::ZERO)) {
            Ok(turn) => match *turn {
                Place::Here(_) => "connected",
                Place::RealTime(_) => "in RealTime",
                Place::Closed => "closed",
            },
            Err(NoTurn::Own | NoTurn::Late) => "in a call",
            Err(NoTurn::Closed) => "closed",
        }
    }

    /// Closes the connection, once a running call has ended. RealTime is ended.
    pub fn close(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| match self.0.take(&Deadline::after(LONGEST)) {
            Ok(mut turn) => {
                let before = std::mem::replace(&mut *turn, Place::Closed);
                // Who brings the hand back wants a turn.
                drop(turn);
                if let Place::RealTime(end) = before {
                    end();
                }
                Ok(())
            }
            Err(NoTurn::Closed) => Ok(()),
            Err(why) => Err(no_turn(why, LONGEST)),
        })
    }
}

fn here<T>(place: &mut Place<T>) -> PyResult<&mut T> {
    match place {
        Place::Here(connection) => Ok(connection),
        Place::RealTime(_) => Err(PyRuntimeError::new_err("the hand is in RealTime\n  next: call its end()")),
        Place::Closed => Err(closed()),
    }
}

fn closed() -> PyErr {
    PyRuntimeError::new_err("the connection is closed\n  next: connect again")
}

/// The exception of a call that does not get its turn.
pub fn no_turn(why: NoTurn, limit: Duration) -> PyErr {
    match why {
        NoTurn::Own => PyRuntimeError::new_err(
            "the connection is in use by the call whose callback this is\n  next: return from the callback first; False ends the call",
        ),
        NoTurn::Late => Python::attach(|py| errors::late(py, limit)),
        NoTurn::Closed => closed(),
    }
}
