//! One motor board with its motor, in simulated time.

use std::sync::Mutex;

use hil_experiment::run::SetError;
use hil_experiment::run::{Options, set};
use hil_experiment::scenario::Scenario;
use hil_world::node::Node;
use hil_world::plant::ParamError;
use pyo3::prelude::*;
use pyo3::types::PyMapping;
use tater_wire::{Body, Destination, Message, Property};

use super::scenario::{Changes, Overrides, model, out_of_range};
use super::{Remainder, at_motor, span};
use crate::call::{lock, property, whole, whole_or_none};
use crate::errors;

/// Simulated time between two questions of the host, us: a board that hears none for HOSTMS, 2 s, idles in modes 2 and 4.
const POLL_US: u64 = 100_000;

/// Simulated time between two looks for ^C, us.
const SLICE_US: u64 = 1_000_000;

/// A board and its host's clock.
struct Hosted {
    node: Node,
    now_us: u64,
    start_us: u64,
    next_poll_us: u64,
    remainder: Remainder,
}

impl Hosted {
    /// Advances as a host that asks for MODE ten times a second.
    fn advance(&mut self, until_us: u64) {
        while self.now_us < until_us {
            if self.now_us >= self.next_poll_us {
                self.next_poll_us += POLL_US;
                // The question alone counts.
                let _ = self.get(Property::MODE);
            }
            self.now_us = until_us.min(self.next_poll_us);
            self.node.advance(self.now_us);
            self.drain();
        }
    }

    /// The bus takes the board's frames at once.
    fn drain(&mut self) {
        while let Some(frame) = self.node.mailboxes().first().copied() {
            self.node.sent(&frame);
        }
    }

    /// The monitor runs, or the board boots.
    const fn is_asleep(&self) -> bool {
        self.node.application().is_none()
    }

    fn set(&mut self, property: Property, value: i64) -> PyResult<()> {
        // The monitor ignores what it does not know.
        if self.is_asleep() && !(property == Property::STAT && matches!(value, 0 | 2)) {
            return Err(asleep(property));
        }
        set(&mut self.node, property, value).map_err(|why| {
            let rules = property.rules();
            let found = value.to_string();
            let (expected, next) = match why {
                SetError::Range(_) => {
                    (format!("{} to {}", rules.min(), rules.max()), "give a value in this range")
                }
                SetError::Access(_) => {
                    ("a property that can be set".to_owned(), "see docs/properties.md for its access")
                }
                SetError::Fault(_) => {
                    ("a board without a fault".to_owned(), "read ERROR, then set STAT 2, which clears it")
                }
                _ => (
                    "what the board takes in its state".to_owned(),
                    "read MODE and ERROR, and see docs/servo.md",
                ),
            };
            errors::value(property.row().name, &found, &expected, next)
        })
    }

    fn get(&mut self, property: Property) -> Option<i64> {
        self.drain();
        let get = Message::get(Destination::Node(self.node.straps()), property);
        self.node.receive(&get.frame()).ok()?;
        let mut value = None;
        while let Some(frame) = self.node.mailboxes().first().copied() {
            match Message::parse(&frame).map(|message| message.body) {
                Some(Body::Position(counts)) if property == Property::P => value = Some(counts.into()),
                Some(Body::Set { property: of, value: read }) if of == property.id() => {
                    value = Some(property.read(read));
                }
                _ => {}
            }
            self.node.sent(&frame);
        }
        value
    }
}

/// A board in its monitor knows few properties.
fn asleep(property: Property) -> PyErr {
    let next = "wake it by set(\"STAT\", 2) and a step of 0.1 s";
    errors::value(property.row().name, "a board in its monitor (STAT 0)", "an awake board (STAT 2)", next)
}

/// One motor board with its motor, awake, in simulated time. Its host asks for MODE ten times a simulated second.
///
/// `position` is where the motor stands, hall counts. Overrides as of `run`.
#[pyclass(module = "wraptor.sim", frozen)]
pub struct Board(Mutex<Hosted>);

impl Board {
    fn truth(&self, value: fn(&hil_world::rig::Truth) -> f64) -> f64 {
        value(&lock(&self.0).node.board().rig().truth())
    }
}

#[pymethods]
impl Board {
    #[new]
    #[pyo3(signature = (kind="spread", properties=None, plant=None, seed=None, *, position=0.0, model="averaged"))]
    fn new(
        kind: &str,
        properties: Option<&Bound<'_, PyMapping>>,
        plant: Option<&Bound<'_, PyMapping>>,
        #[pyo3(from_py_with = whole_or_none)] seed: Option<u64>,
        position: f64,
        model: &str,
    ) -> PyResult<Self> {
        if !["link", "spread", "tip"].contains(&kind) {
            let expected = "link, spread or tip";
            return Err(errors::value("kind", &format!("{kind:?}"), expected, "give one of them"));
        }
        let text = format!("name = 'board'\nabout = 'a motor at rest'\nmotor = '{kind}'\nduration_ms = 1\n");
        let changes = Changes {
            properties: Overrides::of("properties", properties)?,
            figures: vec![("plant", Overrides::of("plant", plant)?)],
        };
        let options = Options { seed: seed.unwrap_or(1), model: self::model(model)?, trace: false };
        let made = Scenario::parse("Board", &text).and_then(|mut scenario| {
            changes.apply(&mut scenario)?;
            scenario.initial.position_counts = position;
            // A scenario with a motor has a case.
            let made =
                scenario.cases.first().map(|case| hil_experiment::run::board(&scenario, case, &options));
            made.transpose().map_err(|error| match error.field {
                "start_count" => out_of_range("Board", ParamError { field: "position", ..error }),
                _ => out_of_range("Board", error),
            })
        });
        let node = made.map_err(errors::bad_input)?.ok_or_else(errors::panicked)?;
        let now_us = node.board().rig().now_us();
        let remainder = Remainder::default();
        Ok(Self(Mutex::new(Hosted { node, now_us, start_us: now_us, next_poll_us: now_us, remainder })))
    }

    /// Simulated seconds since the start.
    #[getter]
    fn time(&self) -> f64 {
        let hosted = lock(&self.0);
        (hosted.now_us - hosted.start_us) as f64 * 1e-6
    }

    /// Advances time by whole microseconds; the rest is kept for the next step.
    fn step(&self, py: Python<'_>, seconds: f64) -> PyResult<()> {
        let seconds = span(seconds)?;
        let mut left_us = lock(&self.0).remainder.step_us(seconds);
        while left_us > 0 {
            let us = left_us.min(SLICE_US);
            py.detach(|| {
                let mut hosted = lock(&self.0);
                let until_us = hosted.now_us + us;
                hosted.advance(until_us);
            });
            left_us -= us;
            py.check_signals()?;
        }
        Ok(())
    }

    /// A property, over the bus, in the units of docs/properties.md.
    fn get(&self, name: &str) -> PyResult<i64> {
        let property = property(name)?;
        let mut hosted = lock(&self.0);
        hosted.get(property).ok_or_else(|| match hosted.is_asleep() {
            true => asleep(property),
            false => {
                let next = "see docs/properties.md for its access";
                errors::value("property", property.row().name, "one that can be read", next)
            }
        })
    }

    /// Sets a property over the bus. Raises ValueError if the board does not take it; in its monitor (STAT 0) it
    /// takes STAT alone.
    fn set(&self, name: &str, #[pyo3(from_py_with = whole)] value: i64) -> PyResult<()> {
        lock(&self.0).set(property(name)?, value)
    }

    /// True position of the rotor, hall counts.
    #[getter]
    fn position(&self) -> f64 {
        self.truth(|truth| truth.counts)
    }

    /// True velocity of the rotor, hall counts/s.
    #[getter]
    fn velocity(&self) -> f64 {
        self.truth(|truth| truth.counts_per_s)
    }

    /// True torque of the motor on its rotor, N m.
    #[getter]
    fn torque(&self) -> f64 {
        self.truth(|truth| truth.torque_n_m)
    }

    /// True position of the joint behind play and twist of its gear, hall counts of the motor.
    #[getter]
    fn joint_position(&self) -> f64 {
        lock(&self.0).node.board().rig().joint_counts()
    }

    /// Applies a torque to the joint from outside, N m behind the gear, positive closing, until changed.
    fn load(&self, torque: f64) -> PyResult<()> {
        let mut hosted = lock(&self.0);
        let rig = hosted.node.rig_mut();
        rig.set_disturbance(at_motor(torque, rig.plant().gear_ratio)?);
        Ok(())
    }

    fn __repr__(&self) -> String {
        format!("<simulated Board at {:.6} s>", self.time())
    }
}
