//! RealTime (LOOP): control and feedback blocks, one by one or at a fixed rate.

use std::ops::ControlFlow;
use std::time::Duration;

use god::Status;
use god::motors::Prefix;

use super::{Hand, of_step, prefix};
use crate::deadline::Deadline;
use crate::error::{CallError, Failure};
use crate::session::{ABORT, Session};

/// The layout of blocks, the same for every motor. Parameters of the hand that [`Hand::realtime`] sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    /// Unit of control velocities, hall counts/s, 1 to 255 (LCVC); `None`: no velocity in control blocks.
    pub velocity: Option<u8>,
    /// A proportional gain in control blocks (LCPG).
    pub gain: bool,
    /// Unit of the velocity fed back, hall counts/s, 1 to 255 (LFVC); `None`: none.
    pub feeds_velocity: Option<u8>,
    /// Strain in feedback blocks (LFS).
    pub feeds_strain: bool,
    /// Position in feedback blocks, four bytes (LFAP 1).
    pub feeds_position: bool,
    /// Unit of the change of position fed back, GCL counts, 1 to 255 (LFDPC); `None`: none.
    pub feeds_change: Option<u8>,
    /// The hand's temperature in feedback blocks (LFT).
    pub feeds_temperature: bool,
}

impl Default for Format {
    /// Velocities in, positions out.
    fn default() -> Self {
        Self {
            velocity: Some(8),
            gain: false,
            feeds_velocity: None,
            feeds_strain: false,
            feeds_position: true,
            feeds_change: None,
            feeds_temperature: false,
        }
    }
}

impl Format {
    fn parameters(&self) -> String {
        let flag = |is: bool| u8::from(is);
        let unit =
            |name: &str, unit: Option<u8>| unit.map_or(String::new(), |unit| format!(" {name} {unit}"));
        format!(
            "LCV {}{} LCPG {} LFV {}{} LFS {} LFAP {} LFDP {}{}",
            flag(self.velocity.is_some()),
            unit("LCVC", self.velocity),
            flag(self.gain),
            flag(self.feeds_velocity.is_some()),
            unit("LFVC", self.feeds_velocity),
            flag(self.feeds_strain),
            flag(self.feeds_position),
            flag(self.feeds_change.is_some()),
            unit("LFDPC", self.feeds_change),
        )
    }

    /// Bytes of a control block after its header.
    fn push(&self, control: &Control, block: &mut Vec<u8>) {
        if let Some(unit) = self.velocity {
            let velocity = (f64::from(control.velocity) / f64::from(unit)).round().clamp(-128.0, 127.0) as i8;
            block.extend(velocity.to_be_bytes());
        }
        if self.gain {
            block.push(control.gain);
        }
    }
}

/// What a motor is to do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Control {
    /// Hall counts/s, positive closes; rounded and clipped to what a byte of [`Format::velocity`]'s unit holds.
    pub velocity: i32,
    /// Proportional gain, if the format has it (KPV).
    pub gain: u8,
}

/// Rates of [`RealTime::run`], blocks/s.
pub const RATES: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

/// What a motor has fed back; `None` for what the format lacks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Axis {
    /// Hall counts/s, in steps of [`Format::feeds_velocity`].
    pub velocity: Option<i32>,
    /// Strain, 0 to 255.
    pub strain: Option<u8>,
    /// GCL counts.
    pub position: Option<i32>,
    /// Change since the last report, GCL counts.
    pub change: Option<i32>,
}

/// A feedback block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Feedback {
    /// Each motor of LOOP's prefix in order.
    pub axes: Vec<Axis>,
    /// °C of GOD's board, if the format has it.
    pub temperature: Option<f64>,
}

/// How regular a run at a fixed rate was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// Blocks that were answered.
    pub blocks: u64,
    /// From the first block to the last answer.
    pub elapsed: Duration,
    /// Blocks a second.
    pub rate: f64,
    /// Places of the schedule that were left out, because an answer had taken longer than a period.
    pub missed: u64,
    /// How late blocks were sent against the schedule: median, 99th percentile, maximum.
    pub jitter: [Duration; 3],
    /// From a block to its whole answer: median, 99th percentile, maximum.
    pub round_trip: [Duration; 3],
}

/// RealTime control. Motors stop when the host is silent for 250 ms; dropping it ends it with ^C.
pub struct RealTime<'a> {
    session: &'a mut Session,
    format: Format,
    axes: usize,
    call: String,
    /// Whether the hand has left RealTime.
    is_over: bool,
}

impl Hand {
    /// Sets the parameters of RealTime for motors (a prefix such as `124` or `X1234567`; not empty) and begins it.
    ///
    /// # Errors
    /// No motors, or the temperature of a GOD that is not there by CAN; ERR, such as 4 before [`Hand::init`]; those of every call.
    pub fn realtime(
        &mut self,
        motors: &str,
        format: Format,
        limit: Duration,
    ) -> Result<RealTime<'_>, CallError> {
        let call = format!("{motors}LOOP");
        let failed = |failure| CallError { call: call.clone(), failure };
        let deadline = Deadline::after(limit);
        let prefix = prefix(motors).map_err(failed)?;
        let axes = Prefix::parse(prefix.as_bytes())
            .map_or(0, |parsed| parsed.select(god::Motors::NONE).axes.iter().count());
        if axes == 0 {
            return Err(failed(Failure::Invalid(
                "a prefix that names motors, such as 124 or X1234567".to_owned(),
            )));
        }
        if format.feeds_temperature {
            self.needs_god().map_err(failed)?;
        }
        self.command(&format!("{prefix}FSET {}", format.parameters()), deadline.remaining())
            .map_err(of_step(limit))?;
        let temperature = u8::from(format.feeds_temperature);
        self.command(&format!("PSET LFT {temperature} COMPAT 0"), deadline.remaining())
            .map_err(of_step(limit))?;
        match self.session.enter_realtime(&format!("{prefix}LOOP"), &deadline).map_err(failed)? {
            None => Ok(RealTime { session: &mut self.session, format, axes, call, is_over: false }),
            Some(answer) => Err(failed(Failure::Status(answer.status))),
        }
    }
}

impl RealTime<'_> {
    /// Number of motors in each block.
    #[must_use]
    pub const fn axes(&self) -> usize {
        self.axes
    }

    /// Whether it has ended by itself: the hand has ended it, or a call has failed.
    #[must_use]
    pub const fn is_over(&self) -> bool {
        self.is_over
    }

    /// Sends a control block, one control for each motor, and waits for its feedback.
    ///
    /// # Errors
    /// Another number of controls, before anything is sent; [`Failure::Status`]: the hand has ended RealTime; those of every call, which end it too.
    pub fn exchange(&mut self, controls: &[Control], limit: Duration) -> Result<Feedback, CallError> {
        if controls.len() != self.axes {
            let expected = format!("{} controls, one for each motor; found {}", self.axes, controls.len());
            return Err(CallError { call: self.call.clone(), failure: Failure::Invalid(expected) });
        }
        let outcome = self.try_exchange(controls, &Deadline::after(limit));
        outcome.map_err(|failure| self.failed(failure))
    }

    fn failed(&mut self, failure: Failure) -> CallError {
        if !std::mem::replace(&mut self.is_over, true) && !matches!(failure, Failure::Status(_)) {
            // The next call finds the prompt. A lost connection is reported already.
            let _ = self.session.abort();
        }
        CallError { call: self.call.clone(), failure }
    }

    fn try_exchange(&mut self, controls: &[Control], deadline: &Deadline) -> Result<Feedback, Failure> {
        if self.is_over {
            return Err(Failure::Invalid("RealTime that has not ended".to_owned()));
        }
        let mut block = vec![b'C'];
        for control in controls {
            self.format.push(control, &mut block);
        }
        self.session.write(&block, deadline)?;
        let header = self.session.raw(deadline)?;
        if header != b'*' {
            self.session.put_back(header);
            let answer = self.session.until_prompt(deadline)?;
            return Err(match answer.status {
                Status::ABORTED => Failure::Cancelled,
                // ^C ends LOOP without an error.
                Status::OK if answer.lines.is_empty() => Failure::Cancelled,
                Status::OK => Failure::Unexpected(answer.lines.join("\n")),
                status => Failure::Status(status),
            });
        }
        let mut feedback = Feedback::default();
        for _ in 0..self.axes {
            let axis = self.read_axis(deadline)?;
            feedback.axes.push(axis);
        }
        if self.format.feeds_temperature {
            let tenths = i16::from_be_bytes(self.read(deadline)?);
            feedback.temperature = Some(f64::from(tenths) / 10.0);
        }
        Ok(feedback)
    }

    fn read<const LEN: usize>(&mut self, deadline: &Deadline) -> Result<[u8; LEN], Failure> {
        let mut bytes = [0; LEN];
        for byte in &mut bytes {
            *byte = self.session.raw(deadline)?;
        }
        Ok(bytes)
    }

    fn read_axis(&mut self, deadline: &Deadline) -> Result<Axis, Failure> {
        let Format { feeds_velocity, feeds_strain, feeds_position, feeds_change, .. } = self.format;
        let mut axis = Axis::default();
        if let Some(unit) = feeds_velocity {
            axis.velocity = Some(i32::from(i8::from_be_bytes(self.read(deadline)?)) * i32::from(unit));
        }
        if feeds_strain {
            axis.strain = Some(u8::from_be_bytes(self.read(deadline)?));
        }
        if feeds_position {
            axis.position = Some(i32::from_be_bytes(self.read(deadline)?));
        }
        if let Some(unit) = feeds_change {
            axis.change = Some(i32::from(i8::from_be_bytes(self.read(deadline)?)) * i32::from(unit));
        }
        Ok(axis)
    }

    /// Exchanges blocks at a fixed rate, 1 to 1000 a second, until the callback breaks. It gets the number of the block and the last feedback (the
    /// first is empty) and returns what the motors are to do. Between blocks the thread is parked.
    ///
    /// # Errors
    /// Those of [`Self::exchange`]; each block has its own limit.
    pub fn run(
        &mut self,
        rate: f64,
        block_limit: Duration,
        mut control: impl FnMut(u64, &Feedback) -> ControlFlow<(), Vec<Control>>,
    ) -> Result<Statistics, CallError> {
        if !RATES.contains(&rate) {
            let failure = Failure::Invalid("a rate of 1 to 1000 blocks/s".to_owned());
            return Err(CallError { call: self.call.clone(), failure });
        }
        let period = Duration::from_secs_f64(rate.recip());
        let start = Deadline::after(Duration::MAX);
        let (mut due, mut missed) = (Duration::ZERO, 0);
        let (mut lateness, mut round_trips) = (Vec::new(), Vec::new());
        let mut feedback = Feedback::default();
        for number in 0.. {
            let ControlFlow::Continue(controls) = control(number, &feedback) else { break };
            loop {
                let early = due.saturating_sub(start.elapsed());
                if early.is_zero() {
                    break;
                }
                std::thread::park_timeout(early);
            }
            let sent = start.elapsed();
            lateness.push(sent - due);
            feedback = self.exchange(&controls, block_limit)?;
            let answered = start.elapsed();
            round_trips.push(answered - sent);
            due += period;
            while answered > due + period {
                due += period;
                missed += 1;
            }
        }
        let (blocks, elapsed) = (round_trips.len() as u64, start.elapsed());
        Ok(Statistics {
            blocks,
            elapsed,
            rate: blocks as f64 / elapsed.as_secs_f64(),
            missed,
            jitter: percentiles(lateness),
            round_trip: percentiles(round_trips),
        })
    }

    /// Ends RealTime with ^C and waits for the prompt.
    ///
    /// # Errors
    /// Those of every call.
    pub fn end(mut self, limit: Duration) -> Result<(), CallError> {
        let deadline = Deadline::after(limit);
        if std::mem::replace(&mut self.is_over, true) {
            return Ok(());
        }
        let outcome =
            self.session.write(&[ABORT], &deadline).and_then(|()| self.session.until_prompt(&deadline));
        match outcome {
            Ok(_) => Ok(()),
            Err(failure) => {
                self.is_over = false;
                Err(self.failed(failure))
            }
        }
    }
}

impl Drop for RealTime<'_> {
    fn drop(&mut self) {
        if !self.is_over {
            // A lost connection is reported by the next call.
            let _ = self.session.abort();
        }
    }
}

/// Median, 99th percentile and maximum.
fn percentiles(mut times: Vec<Duration>) -> [Duration; 3] {
    times.sort_unstable();
    let last = times.len().saturating_sub(1);
    [last / 2, last * 99 / 100, last].map(|index| times.get(index).copied().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_is_rounded_and_clipped_to_its_byte() {
        let format = Format { velocity: Some(8), gain: true, ..Format::default() };
        let bytes = |velocity| {
            let mut block = Vec::new();
            format.push(&Control { velocity, gain: 32 }, &mut block);
            block
        };
        assert_eq!(bytes(80), [10, 32]);
        assert_eq!(bytes(-84), [0xF5, 32]);
        assert_eq!(bytes(5000), [127, 32]);
        assert_eq!(bytes(-5000), [128, 32]);
    }

    #[test]
    fn percentiles_are_of_the_sorted_times() {
        let ms = Duration::from_millis;
        assert_eq!(percentiles((0..=100).rev().map(ms).collect()), [ms(50), ms(99), ms(100)]);
        assert_eq!(percentiles(Vec::new()), [Duration::ZERO; 3]);
    }
}
