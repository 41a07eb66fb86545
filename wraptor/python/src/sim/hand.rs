//! A whole hand in simulated time. It lives on a thread of its own, since GOD's future stays on the thread that made it; any thread of Python may
//! call it, and waits without the GIL.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::Builder;

use hil_experiment::grasp;
use hil_experiment::typist::Typist;
use hil_world::hand::scene::Scene;
use hil_world::hand::{Hand, Motorized};
use numpy::{PyArray1, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use wraptor::{CallError, Failure};

use super::scenario::model;
use super::{Remainder, at_motor, span};
use crate::call::{limit, lock, path_or_none, wait, whole};
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
    remainder: Remainder,
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

/// A whole hand in simulated time: GOD, the bus and seven motor boards, powered up, at its first prompt. The same seed and
/// calls give the same results. Motors are 1 to 3 (links of the fingers), 4 (spread), 5 to 7 (tips); index 0 of an array is motor 1.
///
/// `grasp` is a file of objects between the fingers. Without `contacts` fingers meet only their stops, for a physics engine
/// that computes what else they touch and applies it by `load`.
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
    inverter: hil_world::plant::Model,
) -> Result<Served, String> {
    let mut hand = Hand::new(inverter, seed, god::Memory::default());
    if contacts {
        let scene = grasp.map_or_else(|| Ok(Scene::default()), |path| grasp::read(path, &hand.pose()));
        hand.set_scene(scene.map_err(|bad| bad.to_string())?);
    }
    let (typist, _) = Typist::new(hand).map_err(|none| none.to_string())?;
    Ok(Served { typist, unread: String::new(), remainder: Remainder::default() })
}

impl Served {
    /// Takes what was sent and is in no reply. Latin-1: any byte is a character.
    fn collect(&mut self) {
        self.unread.extend(self.typist.take_output().into_iter().map(char::from));
    }

    /// Runs a line, once what was sent before has ended; `None` after the limit.
    fn run_line(&mut self, line: &str, limit_us: u64, stop: &AtomicBool) -> Option<(Vec<String>, u16)> {
        let goes_on = &mut || !stop.load(Ordering::Relaxed);
        let end_us = self.typist.hand().now_us() + limit_us;
        let is_at_prompt = self.typist.wait_for_line(limit_us, goes_on);
        self.collect();
        let left_us = end_us.saturating_sub(self.typist.hand().now_us());
        let reply = is_at_prompt.then(|| self.typist.run_line_within(line, left_us, goes_on));
        let Some(Ok(reply)) = reply else {
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
        wait(py, answers, || stop.store(true, Ordering::Relaxed), errors::panicked)
    }

    fn array<'py>(&self, py: Python<'py>, values: fn(&Truth) -> [f64; 7]) -> Bound<'py, PyArray1<f64>> {
        values(&lock(&self.truth)).to_pyarray(py)
    }
}

#[pymethods]
impl SimHand {
    #[new]
    #[pyo3(signature = (seed=0, grasp=None, *, contacts=true, model="averaged"))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] seed: u64,
        #[pyo3(from_py_with = path_or_none)] grasp: Option<PathBuf>,
        contacts: bool,
        model: &str,
    ) -> PyResult<Self> {
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
        let truth = wait(py, start, || {}, errors::panicked)?.map_err(PyValueError::new_err)?;
        Ok(Self { jobs, truth: Arc::new(Mutex::new(truth)) })
    }

    /// Simulated seconds since power-up.
    #[getter]
    fn time(&self) -> f64 {
        lock(&self.truth).now_us as f64 * 1e-6
    }

    /// Advances time by whole microseconds; the rest is kept for the next step.
    fn step(&self, py: Python<'_>, seconds: f64) -> PyResult<()> {
        let seconds = span(seconds)?;
        self.run(py, move |served, stop| {
            let until_us = served.typist.hand().now_us() + served.remainder.step_us(seconds);
            while served.typist.hand().now_us() < until_us && !stop.load(Ordering::Relaxed) {
                served.typist.advance(until_us.min(served.typist.hand().now_us() + SLICE_US));
            }
        })
    }

    /// Types characters, each a byte (Latin-1), without waiting.
    fn send(&self, py: Python<'_>, text: &str) -> PyResult<()> {
        let bytes: Option<Vec<u8>> = text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
        let Some(bytes) = bytes else {
            let expected = "characters U+0000 to U+00FF, each a byte";
            return Err(errors::value("text", "another character", expected, "send the bytes as latin-1"));
        };
        self.run(py, move |served, _| served.typist.type_bytes(&bytes))
    }

    /// What the hand has sent since the last call and no command has returned, each byte a character (Latin-1).
    fn receive(&self, py: Python<'_>) -> PyResult<String> {
        self.run(py, |served, _| {
            served.collect();
            std::mem::take(&mut served.unread)
        })
    }

    /// Runs a line of the hand's language, once those that were sent have ended, and returns what it prints. Time advances until
    /// the prompt.
    ///
    /// Raises CallError for ERR, and CallTimeout, a TimeoutError, after `limit` simulated seconds: then the line was aborted.
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

    /// True positions of the motors' rotors, hall counts.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.array(py, |truth| truth.positions)
    }

    /// True velocities of the motors' rotors, hall counts/s.
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.array(py, |truth| truth.velocities)
    }

    /// True torques of the motors on their rotors, N m.
    #[getter]
    fn torques<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.array(py, |truth| truth.torques)
    }

    /// True positions of the joints behind play and twist of their gears, hall counts of the motors.
    #[getter]
    fn joint_positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.array(py, |truth| truth.joints)
    }

    /// Applies a torque to a motor's joint from outside, N m behind the gear, positive closing, until changed. Motors of links and
    /// tips have worms, through which no load drives them.
    fn load(&self, py: Python<'_>, #[pyo3(from_py_with = whole)] motor: i64, torque: f64) -> PyResult<()> {
        let index = (1..=7).position(|number| number == motor).ok_or_else(|| {
            let next = "fingers 1 to 3 are links, 4 the spread, 5 to 7 tips";
            errors::value("motor", &motor.to_string(), "1 to 7", next)
        })?;
        self.run(py, move |served, _| {
            let station = served.typist.hand_mut().bus_mut().station_mut(index);
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
