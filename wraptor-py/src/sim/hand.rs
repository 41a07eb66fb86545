//! A whole hand in simulated time. It lives on a thread of its own, since GOD's future stays on the thread that made it; any thread of Python may
//! call it, and waits without the GIL.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::Builder;

use hil_sim::grasp;
use hil_sim::hand::scene::Scene;
use hil_sim::hand::{Hand, Motorized};
use hil_sim::typist::Typist;
use numpy::{PyArray1, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use wraptor::{CallError, Failure};

use super::scenario::model;
use super::{at_motor, span_us};
use crate::call::{limit, lock, wait};
use crate::errors;

/// Simulated time between two looks for ^C, us.
const SLICE_US: u64 = 10_000;

/// Longest line of the language.
const MOST_CHARACTERS: usize = 160;

/// A hand with its host, on the thread.
struct Served {
    typist: Typist,
    /// Sent by the hand, in no reply, and not yet received.
    unread: String,
}

type Job = Box<dyn FnOnce(&mut Served) + Send>;

/// The true state of the seven motors.
#[derive(Clone, Copy, Default)]
struct Truth {
    now_us: u64,
    positions: [f64; 7],
    velocities: [f64; 7],
    torques: [f64; 7],
    joints: [f64; 7],
}

impl Truth {
    fn of(hand: &Hand) -> Self {
        let mut truth = Self { now_us: hand.now_us(), joints: hand.pose(), ..Self::default() };
        for (index, node) in hand.bus().stations().enumerate().take(7) {
            let motor = node.rig().truth();
            truth.positions[index] = motor.counts;
            truth.velocities[index] = motor.counts_per_s;
            truth.torques[index] = motor.torque_n_m;
        }
        truth
    }
}

/// A simulated hand.
#[pyclass(name = "Hand", module = "wraptor.sim", frozen)]
pub struct SimHand {
    jobs: Sender<Job>,
    /// After the last job.
    truth: Arc<Mutex<Truth>>,
}

/// A hand at its first prompt.
fn start(
    seed: u64,
    grasp: Option<&PathBuf>,
    contacts: bool,
    inverter: hil_sim::Model,
) -> Result<Served, String> {
    let mut hand = Hand::new(inverter, seed, god::Memory::default());
    if contacts {
        let scene = grasp.map_or_else(|| Ok(Scene::default()), |path| grasp::read(path, &hand.pose()));
        hand.set_scene(scene.map_err(|bad| bad.to_string())?);
    }
    let (typist, _) = Typist::new(hand).map_err(|none| none.to_string())?;
    Ok(Served { typist, unread: String::new() })
}

impl Served {
    /// Takes what was sent and is in no reply. Latin-1: any byte is a character.
    fn collect(&mut self) {
        self.unread.extend(self.typist.take_output().into_iter().map(char::from));
    }

    /// Runs a line; `None` after the limit.
    fn run_line(&mut self, line: &str, limit_us: u64, stop: &AtomicBool) -> Option<(Vec<String>, u16)> {
        self.collect();
        let reply = self.typist.run_line_within(line, limit_us, &mut || !stop.load(Ordering::Relaxed));
        let Ok(reply) = reply else {
            self.typist.abort();
            return None;
        };
        self.unread.extend(reply.unsolicited.iter().map(|text| format!("{text}\n")));
        let lines = reply.answer.lines().filter(|line| !line.is_empty() && !line.starts_with("ERR "));
        Some((lines.map(str::to_owned).collect(), u16::try_from(reply.status).unwrap_or(u16::MAX)))
    }
}

impl SimHand {
    /// Runs a job on the hand's thread. It gets a flag that ^C sets.
    fn run<R: Send + 'static>(
        &self,
        py: Python<'_>,
        job: impl FnOnce(&mut Served, &AtomicBool) -> R + Send + 'static,
    ) -> PyResult<R> {
        let (answer, answers) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let (stopped, truth) = (Arc::clone(&stop), Arc::clone(&self.truth));
        let job: Job = Box::new(move |served| {
            let result = job(served, &stopped);
            *lock(&truth) = Truth::of(served.typist.hand());
            // Nobody waits any more after a second ^C.
            let _ = answer.send(result);
        });
        self.jobs.send(job).map_err(|_| errors::panicked())?;
        wait(py, answers, || stop.store(true, Ordering::Relaxed))
    }

    fn array<'py>(&self, py: Python<'py>, values: fn(&Truth) -> [f64; 7]) -> Bound<'py, PyArray1<f64>> {
        values(&lock(&self.truth)).to_pyarray(py)
    }
}

#[pymethods]
impl SimHand {
    #[new]
    #[pyo3(signature = (seed=0, grasp=None, *, contacts=true, model="averaged"))]
    fn new(py: Python<'_>, seed: u64, grasp: Option<PathBuf>, contacts: bool, model: &str) -> PyResult<Self> {
        if grasp.is_some() && !contacts {
            let next = "leave out grasp, or contacts=False";
            return Err(errors::value("contacts", "False with a grasp", "True for a grasp", next));
        }
        let inverter = self::model(model)?;
        let (jobs, inbox) = channel::<Job>();
        let (started, start) = channel();
        let thread = move || {
            let mut served = match self::start(seed, grasp.as_ref(), contacts, inverter) {
                Ok(served) => served,
                Err(why) => {
                    let _ = started.send(Err(why));
                    return;
                }
            };
            let _ = started.send(Ok(Truth::of(served.typist.hand())));
            for job in inbox {
                job(&mut served);
            }
        };
        Builder::new().name("wraptor simulated hand".to_owned()).spawn(thread)?;
        let truth = wait(py, start, || {})?.map_err(PyValueError::new_err)?;
        Ok(Self { jobs, truth: Arc::new(Mutex::new(truth)) })
    }

    #[getter]
    fn time(&self) -> f64 {
        lock(&self.truth).now_us as f64 * 1e-6
    }

    fn step(&self, py: Python<'_>, seconds: f64) -> PyResult<()> {
        let us = span_us(seconds)?;
        self.run(py, move |served, stop| {
            let until_us = served.typist.hand().now_us() + us;
            while served.typist.hand().now_us() < until_us && !stop.load(Ordering::Relaxed) {
                served.typist.advance(until_us.min(served.typist.hand().now_us() + SLICE_US));
            }
        })
    }

    fn send(&self, py: Python<'_>, text: &str) -> PyResult<()> {
        let bytes: Option<Vec<u8>> = text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
        let Some(bytes) = bytes else {
            let expected = "characters U+0000 to U+00FF, each a byte";
            return Err(errors::value("text", "another character", expected, "send the bytes as latin-1"));
        };
        self.run(py, move |served, _| served.typist.type_bytes(&bytes))
    }

    fn receive(&self, py: Python<'_>) -> PyResult<String> {
        self.run(py, |served, _| {
            served.collect();
            std::mem::take(&mut served.unread)
        })
    }

    #[pyo3(signature = (text, limit=60.0))]
    fn command(&self, py: Python<'_>, text: &str, limit: f64) -> PyResult<Vec<String>> {
        let limit = self::limit(limit)?;
        let failed = |failure| errors::call(py, &CallError { call: text.to_owned(), failure });
        if text.len() > MOST_CHARACTERS || !text.bytes().all(|byte| matches!(byte, b' '..=b'~')) {
            let expected = format!("at most {MOST_CHARACTERS} printable ASCII characters");
            return Err(failed(Failure::Invalid(expected)));
        }
        let (line, us) = (text.to_owned(), limit.as_micros().try_into().unwrap_or(u64::MAX));
        match self.run(py, move |served, stop| served.run_line(&line, us, stop))? {
            None => Err(failed(Failure::TimedOut(limit))),
            Some((lines, 0)) => Ok(lines),
            Some((_, status)) => Err(failed(Failure::Status(god::Status::of(status)))),
        }
    }

    /// Positions of the motors' rotors, hall counts.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.array(py, |truth| truth.positions)
    }

    /// Velocities of the motors' rotors, hall counts/s.
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.array(py, |truth| truth.velocities)
    }

    /// Torques of the motors on their rotors, N·m.
    #[getter]
    fn torques<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.array(py, |truth| truth.torques)
    }

    /// Positions of the joints behind play and twist of their gears, hall counts of the motors.
    #[getter]
    fn joint_positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.array(py, |truth| truth.joints)
    }

    fn load(&self, py: Python<'_>, motor: u8, torque: f64) -> PyResult<()> {
        if !(1..=7).contains(&motor) {
            let next = "fingers 1 to 3 are links, 4 the spread, 5 to 7 tips";
            return Err(errors::value("motor", &motor.to_string(), "1 to 7", next));
        }
        self.run(py, move |served, _| {
            let station = served.typist.hand_mut().bus_mut().station_mut(usize::from(motor) - 1);
            let rig = station.map(Motorized::rig_mut);
            rig.map_or(Ok(()), |rig| {
                let n_m = at_motor(torque, rig.plant().gear_ratio)?;
                rig.set_disturbance(n_m);
                Ok(())
            })
        })?
    }

    fn __repr__(&self) -> String {
        format!("<simulated Hand at {:.6} s>", self.time())
    }
}
