//! A hand: commands of its language, parameters of its motors, properties of its boards.
//!
//! Every call has a limit, after which it returns [`Failure::TimedOut`]. A motion and a line of the language are aborted then; what only reads
//! or waits for a value stops no motor. Dropping a [`Hand`] sends ^C, which stops motors, closes the connection and ends its thread.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};
use std::time::Duration;

use god::Status;
use god::boards::parse_report;
use god::motors::Prefix;
use god::parameter;
use tater_wire::property::Access;
use tater_wire::{FaultCode, Frame, ModeCode, Node, Property};

use crate::deadline::Deadline;
use crate::download::{self, Link, OnDownload};
use crate::error::{CallError, Failure};
use crate::firmware::Firmware;
use crate::port::Out;
use crate::session::{ABORT, Answer, Session};

mod connect;
mod manual;
mod realtime;

pub use connect::{Boards, Connect, FIRST_VERSION};
pub use realtime::{Axis, Control, Feedback, Format, RATES, RealTime, Statistics};

/// The seven motor boards.
const NODES: &str = "1234567";

/// Time between two readings of a property that is waited for.
const POLL: Duration = Duration::from_millis(20);

/// The same for a hand that answers late, or not at all.
const ANSWER: Duration = Duration::from_secs(2);

/// Time to switch packets off after a download that has used up its limit: one line there, one back, at 9600 baud.
const RESTORE: Duration = Duration::from_millis(100);

/// What a call that waits has seen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Time since the call.
    pub elapsed: Duration,
    /// Boards and their value, where the call polls it. Empty while an answer is late, and for commands of the language: the hand answers
    /// nothing before their end.
    pub values: Vec<(Node, i64)>,
}

/// Called every 20 to 50 ms during a call; [`ControlFlow::Break`] cancels it.
pub type OnProgress<'a> = &'a mut dyn FnMut(&Progress) -> ControlFlow<()>;

/// No progress is wanted, nor a way to cancel.
pub fn no_progress(_: &Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// The state of a motor board, its property STAT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardState {
    /// It does not answer: no power, or not on the bus.
    Silent,
    /// STAT 0: it runs its monitor.
    Asleep,
    /// STAT 1: it must not be used.
    Unusable,
    /// STAT 2.
    Ready,
}

/// Aborts what a [`Hand`] runs, from another thread. After the hand is dropped it does nothing.
#[derive(Clone)]
pub struct Canceller {
    out: Weak<Out>,
    was_used: Arc<AtomicBool>,
}

impl Canceller {
    /// Sends ^C: the running call returns [`Failure::Cancelled`], and motors stop as HOLD demands.
    ///
    /// # Errors
    /// The connection does not take it within a second.
    pub fn cancel(&self) -> Result<(), CallError> {
        let Some(out) = self.out.upgrade() else { return Ok(()) };
        self.was_used.store(true, Ordering::SeqCst);
        out.write(&[ABORT], &Deadline::after(Duration::from_secs(1)))
            .map_err(|error| CallError { call: "^C".to_owned(), failure: Failure::Lost(error.to_string()) })
    }
}

/// A connection to a hand, as its one host: to its GOD, or by CAN to its motor boards.
pub struct Hand {
    session: Session,
    place: String,
    version: u16,
    /// Whether a board GOD is between this program and the motor boards; by CAN there is none.
    has_god: bool,
    /// Whether a canceller was used since the last move of fingers began.
    was_cancelled: Arc<AtomicBool>,
}

impl Drop for Hand {
    fn drop(&mut self) {
        self.session.hang_up();
    }
}

impl Hand {
    /// Where it is connected, as given.
    #[must_use]
    pub fn place(&self) -> &str {
        &self.place
    }

    /// The firmware's version, from VERS.
    #[must_use]
    pub const fn version(&self) -> u16 {
        self.version
    }

    /// A handle to abort this hand's calls from another thread.
    #[must_use]
    pub fn canceller(&self) -> Canceller {
        Canceller { out: self.session.port().out(), was_used: Arc::clone(&self.was_cancelled) }
    }

    /// # Errors
    /// By CAN: there is no board GOD.
    fn needs_god(&self) -> Result<(), Failure> {
        match self.has_god {
            true => Ok(()),
            false => Err(Failure::Invalid(
                "a connection over TCP or a serial port; by CAN there is no GOD".to_owned(),
            )),
        }
    }

    /// Closes the connection. As dropping it: motors stop, but after bytes of [`Self::write`] that no call has followed, which the hand finishes.
    pub fn disconnect(self) {}

    /// Runs a line of the language and returns what it prints.
    ///
    /// # Errors
    /// [`Failure::Status`] for ERR; those of every call.
    pub fn command(&mut self, line: &str, limit: Duration) -> Result<Vec<String>, CallError> {
        self.command_with(line, limit, &mut no_progress)
    }

    /// The same with progress, by which it can be cancelled.
    ///
    /// # Errors
    /// The same, and [`Failure::Cancelled`].
    pub fn command_with(
        &mut self,
        line: &str,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<Vec<String>, CallError> {
        if line.trim_end().to_ascii_uppercase().ends_with("LOOP") {
            let failure =
                Failure::Invalid("a line that ends with its answer; RealTime is Hand::realtime's".to_owned());
            return Err(CallError { call: line.to_owned(), failure });
        }
        let on_tick = &mut |elapsed| progress(&Progress { elapsed, values: Vec::new() });
        let answer = self.session.run(line, limit, on_tick)?;
        succeeded(line, answer)
    }

    /// Runs a line that moves nothing: the end of its limit stops no motor.
    fn ask(&mut self, line: &str, limit: Duration) -> Result<Vec<String>, CallError> {
        let answer = self.session.ask(line, limit, &mut |_| ControlFlow::Continue(()))?;
        succeeded(line, answer)
    }

    /// Writes bytes as they are, without waiting for an answer (the manual's tcp_msg). Bytes that make a line or a packet make an answer,
    /// which the next call takes as a report. A line that they leave without its CR is ended by the next call.
    ///
    /// # Errors
    /// They are not taken within the limit.
    pub fn write(&mut self, bytes: &[u8], limit: Duration) -> Result<(), CallError> {
        let failed = |failure| CallError { call: format!("{} bytes", bytes.len()), failure };
        self.session.write_raw(bytes, &Deadline::after(limit)).map_err(failed)
    }

    /// Receives what has arrived, so that [`Self::take_reports`] has it.
    ///
    /// # Errors
    /// The connection is lost, or what arrives is none of a hand's.
    pub fn poll(&mut self) -> Result<(), CallError> {
        self.session.poll().map_err(|failure| CallError { call: "poll".to_owned(), failure })
    }

    /// Takes the lines that the hand has printed unasked, such as `4 MODE=3` at the end of a motion. Keeps the last 256.
    pub fn take_reports(&mut self) -> Vec<String> {
        self.session.take_reports()
    }

    /// Places a frame on the bus as a packet (manual 1.4). It has no answer; a refusal is a report.
    ///
    /// # Errors
    /// It is not taken within the limit.
    pub fn send(&mut self, frame: &Frame, limit: Duration) -> Result<(), CallError> {
        let failed = |failure| CallError { call: "send".to_owned(), failure };
        self.session.write(&packet(frame), &Deadline::after(limit)).map_err(failed)
    }

    /// Switches answers of boards to packets, which [`Self::receive`] returns, or back to lines.
    ///
    /// # Errors
    /// Those of every call.
    pub fn set_packets(&mut self, on: bool, limit: Duration) -> Result<(), CallError> {
        self.command(&format!("0 S REPLY {}", u8::from(on)), limit).map(drop)
    }

    /// The oldest frame that a board has sent in a packet; `None` if none comes within the limit.
    ///
    /// # Errors
    /// The connection is lost.
    pub fn receive(&mut self, limit: Duration) -> Result<Option<Frame>, CallError> {
        let failed = |failure| CallError { call: "receive".to_owned(), failure };
        self.session.frame(&Deadline::after(limit)).map_err(failed)
    }

    /// Downloads firmware to boards, one after the other, as packets (the manual's downloadFirmware), and waits until each runs it. `nodes` is
    /// of the digits 1 to 7; the limit is for all of them. Boards go into their monitors by themselves; connect with [`Boards::Any`], since
    /// those without an application do not wake.
    ///
    /// # Errors
    /// [`Failure::Download`] names the board; cancelled, or not done within the limit; those of every call. That board has its old application,
    /// those before it the new one, those after it are untouched.
    pub fn download(
        &mut self,
        nodes: &str,
        firmware: &Firmware,
        limit: Duration,
        progress: OnDownload,
    ) -> Result<(), CallError> {
        let failed = |failure| CallError { call: format!("download to {nodes}"), failure };
        let deadline = Deadline::after(limit);
        let wanted = self::nodes(nodes).map_err(failed)?;
        self.set_packets(true, deadline.remaining()).map_err(of_step(limit))?;
        let outcome = wanted
            .into_iter()
            .try_for_each(|node| download::download(self, node, firmware, &deadline, progress));
        if let Err(failure @ Failure::Lost(_)) = outcome {
            return Err(failed(failure));
        }
        // Also after the limit: the next caller reads lines.
        let restored = self.set_packets(false, deadline.remaining().clamp(RESTORE, ANSWER));
        outcome.map_err(failed).and(restored)
    }

    /// Wakes all motor boards (WAKE), up to 1.5 s.
    ///
    /// # Errors
    /// ERR 1: some do not wake.
    pub fn wake(&mut self, limit: Duration) -> Result<(), CallError> {
        self.command("WAKE", limit).map(drop)
    }

    /// The states of motor boards 1 to 7.
    ///
    /// # Errors
    /// Those of every call.
    pub fn boards(&mut self, limit: Duration) -> Result<[BoardState; 7], CallError> {
        let line = format!("{NODES} G STAT");
        let answer = self.session.ask(&line, limit, &mut |_| ControlFlow::Continue(()))?;
        let mut states = [BoardState::Silent; 7];
        for (node, stat) in values(&answer.lines, Property::STAT) {
            let place = usize::from(node.number()).checked_sub(1).and_then(|index| states.get_mut(index));
            let state = match stat {
                0 => BoardState::Asleep,
                2 => BoardState::Ready,
                _ => BoardState::Unusable,
            };
            place.into_iter().for_each(|place| *place = state);
        }
        Ok(states)
    }

    /// The numbers that two boards have: ERR 1 of boards that answer. `ERR 1` of the hand's language names them.
    ///
    /// # Errors
    /// Those of every call.
    pub fn doubled(&mut self, limit: Duration) -> Result<Vec<Node>, CallError> {
        let deadline = Deadline::after(limit);
        let mut ask = |nodes: &str| {
            let line = format!("{nodes} G STAT");
            let answer = self.session.ask(&line, deadline.remaining(), &mut |_| ControlFlow::Continue(()))?;
            Ok((values(&answer.lines, Property::STAT), answer.status.has(Status::NO_BOARD)))
        };
        let (answers, is_missing) = ask(NODES)?;
        let mut doubled = Vec::new();
        for (node, _) in answers.into_iter().filter(|_| is_missing) {
            let (answers, is_doubled) = ask(&node.number().to_string())?;
            doubled.extend((is_doubled && !answers.is_empty()).then_some(node));
        }
        Ok(doubled)
    }

    /// The latched faults of motor boards.
    ///
    /// # Errors
    /// A board does not answer.
    pub fn faults(&mut self, limit: Duration) -> Result<Vec<(Node, FaultCode)>, CallError> {
        let errors = self.get(NODES, Property::ERROR, limit)?;
        Ok(errors.into_iter().filter_map(|(node, code)| Some((node, FaultCode::of(code)?))).collect())
    }

    /// Finds the stops of all motors and goes to 0 (HI): some 10 s. The workspace must be clear.
    ///
    /// # Errors
    /// ERR, and those of every call.
    pub fn init(&mut self, limit: Duration, progress: OnProgress) -> Result<(), CallError> {
        self.motion("", "HI", limit, progress)
    }

    /// Closes motors to CT, or until they are stopped (C). `motors` is a prefix of the language: `13`, `G`, `S`, `X15`, or empty for all with EN.
    ///
    /// # Errors
    /// ERR, and those of every call.
    pub fn close(&mut self, motors: &str, limit: Duration, progress: OnProgress) -> Result<(), CallError> {
        self.motion(motors, "C", limit, progress)
    }

    /// Opens motors to OT (O).
    ///
    /// # Errors
    /// The same.
    pub fn open(&mut self, motors: &str, limit: Duration, progress: OnProgress) -> Result<(), CallError> {
        self.motion(motors, "O", limit, progress)
    }

    /// Closes motors with limited torque until they stall, and leaves them pressing (TC).
    ///
    /// # Errors
    /// The same.
    pub fn grasp(&mut self, motors: &str, limit: Duration, progress: OnProgress) -> Result<(), CallError> {
        self.motion(motors, "TC", limit, progress)
    }

    /// Switches motors' power off (T). Worms and brake keep the grip.
    ///
    /// # Errors
    /// The same.
    pub fn relax(&mut self, motors: &str, limit: Duration) -> Result<(), CallError> {
        self.motion(motors, "T", limit, &mut no_progress)
    }

    /// Moves motors to a position of the language, GCL counts, 0 to 20000 (M).
    ///
    /// # Errors
    /// The same; ERR 16 if they end farther than MPE from it.
    pub fn move_to(
        &mut self,
        motors: &str,
        counts: i64,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        self.motion(motors, &format!("M {counts}"), limit, progress)
    }

    fn motion(
        &mut self,
        motors: &str,
        command: &str,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let prefix =
            prefix(motors).map_err(|failure| CallError { call: format!("{motors}{command}"), failure })?;
        self.command_with(&format!("{prefix}{command}"), limit, progress).map(drop)
    }

    /// Receives reports until the deadline.
    fn rest(&mut self, deadline: &Deadline) -> Result<(), Failure> {
        while self.session.receive(deadline)? && !deadline.is_over() {}
        Ok(())
    }

    /// A property of boards, in the units of docs/properties.md. `nodes` is of the digits 1 to 7.
    ///
    /// # Errors
    /// [`Failure::Asleep`], [`Failure::Silent`]: some do not answer; those of every call.
    pub fn get(
        &mut self,
        nodes: &str,
        property: Property,
        limit: Duration,
    ) -> Result<Vec<(Node, i64)>, CallError> {
        let deadline = Deadline::after(limit);
        self.get_with(nodes, property, limit, &mut no_progress).map_err(|error| match error.failure {
            Failure::Silent(silent) => {
                let asleep = self.asleep(&silent, &deadline);
                let failure =
                    if asleep.is_empty() { Failure::Silent(silent) } else { Failure::Asleep(asleep) };
                CallError { failure, ..error }
            }
            _ => error,
        })
    }

    /// The same with progress, without values, by which it can be cancelled.
    fn get_with(
        &mut self,
        nodes: &str,
        property: Property,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<Vec<(Node, i64)>, CallError> {
        let call = format!("{nodes} G {}", name(property));
        let failed = |failure| CallError { call: call.clone(), failure };
        let wanted = self::nodes(nodes).map_err(failed)?;
        if property.rules().access == Access::WriteOnly || property == Property::M {
            return Err(failed(Failure::Invalid("a property that can be read".to_owned())));
        }
        // After `0 S REPLY 1` boards answer by packets. Earlier ones are no answer.
        let of_packet = |frame: &Frame| {
            let (motor, of, value) = parse_report(frame)?;
            (of == property && wanted.contains(&motor.node())).then_some((motor.node(), value))
        };
        self.session.take_frames(of_packet);
        let on_tick = &mut |elapsed| progress(&Progress { elapsed, values: Vec::new() });
        let answer = self.session.ask(&call, limit, on_tick)?;
        let mut values = values(&answer.lines, property);
        values.extend(self.session.take_frames(of_packet));
        let silent = |node: &Node| values.iter().all(|(of, _)| of != node);
        let silent: Vec<Node> = wanted.iter().copied().filter(silent).collect();
        match (silent.is_empty(), answer.status.is_ok()) {
            (true, true) => Ok(values),
            (true, false) => Err(failed(Failure::Status(answer.status))),
            (false, _) => Err(failed(Failure::Silent(silent))),
        }
    }

    /// Those of silent boards that are in their monitors, as far as the limit allows to ask.
    fn asleep(&mut self, silent: &[Node], deadline: &Deadline) -> Vec<Node> {
        if deadline.is_over() {
            return Vec::new();
        }
        // A connection that is lost now shows at the next call.
        let states = self.boards(deadline.remaining()).unwrap_or([BoardState::Silent; 7]);
        let is_asleep = |node: &&Node| {
            let index = usize::from(node.number()).checked_sub(1);
            index.and_then(|index| states.get(index)) == Some(&BoardState::Asleep)
        };
        silent.iter().filter(is_asleep).copied().collect()
    }

    /// Sets a property of boards, in the units of docs/properties.md.
    ///
    /// # Errors
    /// A value out of range or a property that cannot be set, before anything is sent; ERR 1: a board sleeps or is silent;
    /// [`Failure::NotTaken`]: a locked property was not unlocked.
    pub fn set(
        &mut self,
        nodes: &str,
        property: Property,
        value: i64,
        limit: Duration,
    ) -> Result<(), CallError> {
        self.set_with(nodes, property, value, limit, &mut no_progress)
    }

    /// The same with progress, by which it can be cancelled.
    fn set_with(
        &mut self,
        nodes: &str,
        property: Property,
        value: i64,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let call = format!("{nodes} S {} {value}", name(property));
        let failed = |failure| CallError { call: call.clone(), failure };
        self::nodes(nodes).map_err(failed)?;
        settable(property, value).map_err(failed)?;
        if property == Property::M {
            // The language's M is MODE.
            return Err(failed(Failure::Invalid("E, then MODE 5: over the hand M cannot be set".to_owned())));
        }
        let deadline = Deadline::after(limit);
        self.command_with(&call, limit, progress)?;
        if property.rules().access != Access::Locked {
            return Ok(());
        }
        let held = self.get(nodes, property, deadline.remaining()).map_err(of_step(limit))?;
        match held.into_iter().find(|(_, found)| *found != value) {
            Some((node, found)) => Err(failed(Failure::NotTaken { node, found })),
            None => Ok(()),
        }
    }

    /// Polls a property until all boards have a value (the manual's waitFor). The progress has the values. Its end stops no motor.
    ///
    /// # Errors
    /// Those of [`Self::get`]; [`Failure::TimedOut`]; [`Failure::Cancelled`].
    pub fn wait_for(
        &mut self,
        nodes: &str,
        property: Property,
        value: i64,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let failed =
            |failure| CallError { call: format!("wait for {nodes} {}={value}", name(property)), failure };
        let rules = property.rules();
        in_range(value, rules.min(), rules.max()).map_err(failed)?;
        let deadline = Deadline::after(limit);
        loop {
            let values =
                self.get_with(nodes, property, deadline.remaining(), progress).map_err(of_step(limit))?;
            let is_done = values.iter().all(|(_, found)| *found == value);
            let is_cancelled = progress(&Progress { elapsed: deadline.elapsed(), values }).is_break();
            match (is_done, is_cancelled) {
                (true, _) => return Ok(()),
                (false, true) => return Err(failed(Failure::Cancelled)),
                (false, false) if deadline.is_over() => return Err(failed(Failure::TimedOut(limit))),
                (false, false) => self.rest(&deadline.within(POLL)).map_err(failed)?,
            }
        }
    }

    /// A parameter of motors in the units of the language (FGET), in the order of the motors.
    ///
    /// # Errors
    /// An unknown name, before anything is sent; those of every call.
    pub fn parameter(&mut self, motors: &str, name: &str, limit: Duration) -> Result<Vec<i64>, CallError> {
        let line = motor_parameter(motors, name)
            .map(|(prefix, name)| format!("{prefix}FGET {name}"))
            .map_err(|failure| CallError { call: format!("{motors}FGET {name}"), failure })?;
        let lines = self.ask(&line, limit)?;
        numbers(&line, &lines)
    }

    /// Sets a parameter of motors (FSET).
    ///
    /// # Errors
    /// An unknown name or a value out of range, before anything is sent; those of every call.
    pub fn set_parameter(
        &mut self,
        motors: &str,
        name: &str,
        value: i64,
        limit: Duration,
    ) -> Result<(), CallError> {
        let line = motor_parameter(motors, name).and_then(|(prefix, name)| {
            let row = parameter::motor(&name).filter(|row| row.writable);
            let row = row.ok_or_else(|| Failure::Invalid("a parameter that can be set".to_owned()))?;
            in_range(value, row.min(), row.max()).map(|()| format!("{prefix}FSET {name} {value}"))
        });
        let line =
            line.map_err(|failure| CallError { call: format!("{motors}FSET {name} {value}"), failure })?;
        self.command(&line, limit).map(drop)
    }

    /// A parameter of the hand (PGET).
    ///
    /// # Errors
    /// An unknown name, and TEMP and PTEMP by CAN, before anything is sent; those of every call.
    pub fn hand_parameter(&mut self, name: &str, limit: Duration) -> Result<i64, CallError> {
        let line = format!("PGET {}", name.to_ascii_uppercase());
        if parameter::hand(&name.to_ascii_uppercase()).is_none() {
            return Err(CallError { call: line, failure: unknown(name, "PLISTA") });
        }
        if ["TEMP", "PTEMP"].contains(&name.to_ascii_uppercase().as_str()) {
            self.needs_god().map_err(|failure| CallError { call: line.clone(), failure })?;
        }
        let lines = self.ask(&line, limit)?;
        let number = numbers(&line, &lines)?.first().copied();
        number.ok_or_else(|| CallError { call: line, failure: Failure::Unexpected(lines.join("\n")) })
    }

    /// Sets a parameter of the hand (PSET).
    ///
    /// # Errors
    /// An unknown name or a value out of range, before anything is sent; those of every call.
    pub fn set_hand_parameter(&mut self, name: &str, value: i64, limit: Duration) -> Result<(), CallError> {
        let line = format!("PSET {} {value}", name.to_ascii_uppercase());
        let failed = |failure| CallError { call: line.clone(), failure };
        let row =
            parameter::hand(&name.to_ascii_uppercase()).ok_or_else(|| failed(unknown(name, "PLISTA")))?;
        in_range(value, row.min, row.max).map_err(failed)?;
        self.command(&line, limit).map(drop)
    }

    /// The temperature of GOD's board, °C.
    ///
    /// # Errors
    /// There is none by CAN; those of every call.
    pub fn temperature(&mut self, limit: Duration) -> Result<f64, CallError> {
        self.hand_parameter("TEMP", limit).map(|tenths| tenths as f64 / 10.0)
    }

    /// Stores parameters of motors (FSAVE) and of the hand (PSAVE).
    ///
    /// # Errors
    /// ERR 512: a flash does not take them.
    pub fn save_parameters(&mut self, limit: Duration) -> Result<(), CallError> {
        let deadline = Deadline::after(limit);
        self.command("FSAVE", deadline.remaining()).map_err(of_step(limit))?;
        self.command("PSAVE", deadline.remaining()).map(drop).map_err(of_step(limit))
    }

    /// Makes the hand ready for power-off: motors off, then positions and parameters are stored (SAVE).
    ///
    /// # Errors
    /// The same.
    pub fn prepare_power_off(&mut self, limit: Duration) -> Result<(), CallError> {
        self.command("SAVE", limit).map(drop)
    }
}

impl Link for Hand {
    fn send(&mut self, frame: &Frame, deadline: &Deadline) -> Result<(), Failure> {
        self.session.write(&packet(frame), deadline)
    }

    fn receive(&mut self, deadline: &Deadline) -> Result<Option<Frame>, Failure> {
        self.session.frame(deadline)
    }
}

/// A frame as a packet: identifier, number of bytes, bytes (manual 1.4).
fn packet(frame: &Frame) -> Vec<u8> {
    let [high, low] = frame.raw_id().to_be_bytes();
    let len = u8::try_from(frame.data().len()).unwrap_or(0);
    [&[high, low, len], frame.data()].concat()
}

/// A step of a call had only what was left of the call's limit, which is what its error names.
fn of_step(limit: Duration) -> impl Fn(CallError) -> CallError + Copy {
    move |error| match error.failure {
        Failure::TimedOut(_) => CallError { failure: Failure::TimedOut(limit), ..error },
        _ => error,
    }
}

/// A prefix in upper case.
fn prefix(motors: &str) -> Result<String, Failure> {
    let upper = motors.to_ascii_uppercase();
    match Prefix::parse(upper.as_bytes()) {
        Some(_) => Ok(upper),
        None => Err(Failure::Invalid("motors as 13, G, S or X15, none twice".to_owned())),
    }
}

fn motor_parameter(motors: &str, name: &str) -> Result<(String, String), Failure> {
    let upper = name.to_ascii_uppercase();
    match parameter::motor(&upper) {
        Some(_) => Ok((prefix(motors)?, upper)),
        None => Err(unknown(name, "FLISTA")),
    }
}

fn unknown(name: &str, list: &str) -> Failure {
    Failure::Invalid(format!("a parameter of {list} instead of {name:?}"))
}

fn in_range(value: i64, min: i64, max: i64) -> Result<(), Failure> {
    match (min..=max).contains(&value) {
        true => Ok(()),
        false => Err(Failure::Invalid(format!("{min} to {max}"))),
    }
}

/// Whether a host may set the property to the value.
pub(crate) fn settable(property: Property, value: i64) -> Result<(), Failure> {
    let rules = property.rules();
    if rules.access == Access::ReadOnly {
        return Err(Failure::Invalid("a property that can be set".to_owned()));
    }
    match property {
        Property::MODE if ModeCode::of(value).is_none() => {
            Err(Failure::Invalid("0, 2, 3, 4 or 5, the modes of docs/properties.md".to_owned()))
        }
        Property::STAT if !matches!(value, 0 | 2) => Err(Failure::Invalid("0 or 2".to_owned())),
        _ => in_range(value, rules.min(), rules.max()),
    }
}

pub(crate) fn name(property: Property) -> &'static str {
    property.row().name
}

/// The lines of an answer that is no error.
fn succeeded(line: &str, answer: Answer) -> Result<Vec<String>, CallError> {
    match answer.status.is_ok() {
        true => Ok(answer.lines),
        false => Err(CallError { call: line.to_owned(), failure: Failure::Status(answer.status) }),
    }
}

/// Nodes 1 to 7 as digits, each once.
fn nodes(text: &str) -> Result<Vec<Node>, Failure> {
    let expected = || Failure::Invalid("nodes as digits 1 to 7, each once, such as 567".to_owned());
    let mut nodes = Vec::new();
    for digit in text.bytes().map(|byte| byte.wrapping_sub(b'0')) {
        let node = Node::new(digit).filter(|node| (1..=7).contains(&digit) && !nodes.contains(node));
        nodes.push(node.ok_or_else(expected)?);
    }
    if nodes.is_empty() { Err(expected()) } else { Ok(nodes) }
}

/// The values of lines `4 P=29`.
fn values(lines: &[String], property: Property) -> Vec<(Node, i64)> {
    let value = |line: &String| {
        let (node, rest) = line.split_once(' ')?;
        let (found, value) = rest.split_once('=')?;
        let value = (found == name(property)).then(|| value.parse().ok())??;
        Some((Node::new(node.parse().ok()?)?, value))
    };
    lines.iter().filter_map(value).collect()
}

fn numbers(line: &str, lines: &[String]) -> Result<Vec<i64>, CallError> {
    let numbers: Option<Vec<i64>> =
        lines.iter().flat_map(|line| line.split_whitespace()).map(|number| number.parse().ok()).collect();
    numbers.ok_or_else(|| CallError { call: line.to_owned(), failure: Failure::Unexpected(lines.join("\n")) })
}
