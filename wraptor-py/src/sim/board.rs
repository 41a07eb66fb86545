//! One motor board with its motor, in simulated time.

use std::sync::Mutex;

use hil_sim::node::Node;
use hil_sim::scenario::Scenario;
use hil_sim::{Options, set};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use tater_wire::{Body, Destination, Message, Property};

use super::scenario::{Changes, Overrides, model, out_of_range};
use super::{at_motor, span_us};
use crate::call::{lock, property};
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

/// A simulated board.
#[pyclass(module = "wraptor.sim", frozen)]
pub struct Board(Mutex<Hosted>);

impl Board {
    fn truth(&self, value: fn(&hil_sim::rig::Truth) -> f64) -> f64 {
        value(&lock(&self.0).node.board().rig().truth())
    }
}

#[pymethods]
impl Board {
    #[new]
    #[pyo3(signature = (kind="spread", properties=None, plant=None, seed=None, *, position=0.0, model="averaged"))]
    fn new(
        kind: &str,
        properties: Option<&Bound<'_, PyDict>>,
        plant: Option<&Bound<'_, PyDict>>,
        seed: Option<u64>,
        position: f64,
        model: &str,
    ) -> PyResult<Self> {
        if !["link", "spread", "tip"].contains(&kind) {
            let expected = "link, spread or tip";
            return Err(errors::value("kind", &format!("{kind:?}"), expected, "give one of them"));
        }
        let text = format!(
            "name = 'board'\nabout = 'a motor at rest'\nmotor = '{kind}'\nduration_ms = 1\ninitial = {{ position_counts = {position:?} }}\n"
        );
        let changes = Changes {
            properties: Overrides::of(properties)?,
            figures: vec![("plant", Overrides::of(plant)?)],
        };
        let options = Options { seed: seed.unwrap_or(1), model: self::model(model)?, trace: false };
        let made = Scenario::parse("Board", &text).and_then(|mut scenario| {
            changes.apply(&mut scenario)?;
            // A scenario with a motor has a case.
            let made = scenario.cases.first().map(|case| hil_sim::board(&scenario, case, &options));
            made.transpose().map_err(|error| out_of_range("Board", error))
        });
        let node = made.map_err(|bad| errors::bad_input(&bad))?.ok_or_else(errors::panicked)?;
        let now_us = node.board().rig().now_us();
        Ok(Self(Mutex::new(Hosted { node, now_us, start_us: now_us, next_poll_us: now_us })))
    }

    #[getter]
    fn time(&self) -> f64 {
        let hosted = lock(&self.0);
        (hosted.now_us - hosted.start_us) as f64 * 1e-6
    }

    fn step(&self, py: Python<'_>, seconds: f64) -> PyResult<()> {
        let mut left_us = span_us(seconds)?;
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

    fn get(&self, name: &str) -> PyResult<i64> {
        let property = property(name)?;
        lock(&self.0).get(property).ok_or_else(|| {
            let next = "see docs/properties.md for its access";
            errors::value("property", property.row().name, "one that can be read", next)
        })
    }

    fn set(&self, name: &str, value: i64) -> PyResult<()> {
        let property = property(name)?;
        set(&mut lock(&self.0).node, property, value).map_err(|why| {
            let rules = property.rules();
            let (name, found) = (property.row().name, format!("{value} ({why:?})"));
            let expected = format!("{} to {}, and a property that can be set", rules.min(), rules.max());
            errors::value(name, &found, &expected, "see docs/properties.md for range and access")
        })
    }

    /// Position of the rotor, hall counts.
    #[getter]
    fn position(&self) -> f64 {
        self.truth(|truth| truth.counts)
    }

    /// Velocity of the rotor, hall counts/s.
    #[getter]
    fn velocity(&self) -> f64 {
        self.truth(|truth| truth.counts_per_s)
    }

    /// Torque of the motor on its rotor, N·m.
    #[getter]
    fn torque(&self) -> f64 {
        self.truth(|truth| truth.torque_n_m)
    }

    /// Position of the joint behind play and twist of its gear, hall counts of the motor.
    #[getter]
    fn joint_position(&self) -> f64 {
        lock(&self.0).node.board().rig().joint_counts()
    }

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
