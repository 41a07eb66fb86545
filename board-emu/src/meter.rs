//! Measures a run: instructions of a tick, latency from a hall edge to the bridge, and from a GET to its
//! answer.
//!
//! The board reports events at its pins; the core counts instructions ([`crate::cpu::counts`]).

use serde::Serialize;
use tater_f103::map::STACK;
use tater_wire::{Body, Frame, Message, Property};

use crate::cpu::counts::Counts;
use crate::machine::Machine;
use crate::time::{HZ, Time, US};

/// Exception numbers (RM0008 table 63): TIM3, the control tick; TIM4, the hall timer.
const TICK: usize = 16 + 29;
const HALL: u32 = 16 + 30;

/// Filter of the hall timer, rounded down to a step of the motor: a handler that began earlier after an edge
/// serves another one.
const FILTER: Time = 12 * US;

/// A request that is unanswered for this long is dropped.
const NO_ANSWER: Time = 100_000 * US;

/// Cycles an instruction, and cycles a second: the model of a chip with wait states.
const CYCLES: f64 = 1.5;
const CYCLES_A_SECOND: f64 = 72e6;

/// Measures a board from a moment on.
#[derive(Clone, Debug, Default)]
pub struct Meter {
    /// Start of the measurement, and the instructions before it.
    since: (Time, u64),
    code: u8,
    /// The oldest edge that is not served.
    edge: Option<Edge>,
    hall_instructions_max: u64,
    hall_latency_max: Time,
    /// Requested properties, and when.
    asked: Vec<(u8, Time)>,
    can_latency_max: Time,
    driven_since: Option<Time>,
}

/// A change of the hall lines while the bridge is on. It is served when its handler has ended, whether or not
/// that wrote to the bridge. It is dropped if the code returns before: a spike or bounce.
#[derive(Clone, Copy, Debug)]
struct Edge {
    at: Time,
    from: u8,
    /// The bridge has been written for it; its handler may write again.
    served: bool,
}

/// Figures of a run, named as in the JSON object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Mean instructions of a control tick, without those of handlers that preempt it.
    pub tick_instructions_mean: f64,
    /// Maximum of the same.
    pub tick_instructions_max: u64,
    /// From the entry of TIM4's exception to its handler's last write to the bridge's timer, at most.
    pub hall_instructions_max: u64,
    /// From a hall edge to that write, at most; includes the timer's filter of 14 us. Resolution 5 us: the
    /// step of the motor.
    pub hall_latency_us_max: f64,
    /// From the end of a GET on the wire to its answer in a mailbox, at most. Resolution 10 us: the step of
    /// the bus.
    pub can_latency_us_max: f64,
    /// Instructions at 1.5 cycles each, relative to 72 MHz.
    pub cpu_load_pct: f64,
    /// Deepest stack, bytes.
    pub stack_bytes_max: u32,
    /// All instructions.
    pub instructions: u64,
}

impl Meter {
    /// Starts the measurement anew.
    pub fn begin(&mut self, machine: &mut Machine) {
        machine.cpu.counts.clear();
        machine.cpu.reset_lowest_sp();
        let since = (machine.now(), machine.cpu.counts.instructions);
        *self = Self { since, driven_since: self.driven_since, code: self.code, ..Self::default() };
    }

    /// Records the hall code at the pins.
    pub fn halls(&mut self, now: Time, code: u8, counts: &Counts) {
        self.done(counts);
        let from = std::mem::replace(&mut self.code, code);
        let waits = self.edge.filter(|edge| !edge.served);
        if code != from {
            self.edge = match waits {
                Some(edge) if edge.from == code => None,
                // A bridge that is off has no edge to follow.
                None => self.driven_since.map(|_| Edge { at: now, from, served: false }),
                waits => waits,
            };
        }
    }

    /// Drops an edge whose handler has ended.
    fn done(&mut self, counts: &Counts) {
        let ended = counts.handlers.get(HALL as usize).map_or(0, |handler| handler.since);
        self.edge = self.edge.filter(|edge| ended < edge.at + FILTER);
    }

    /// Records a write to the bridge's timer.
    pub fn gate_write(&mut self, now: Time, counts: &Counts) {
        let Some(run) = counts.running.last().filter(|run| run.exception == HALL) else { return };
        self.hall_instructions_max = self.hall_instructions_max.max(run.instructions);
        self.done(counts);
        // The handler may run for another reason.
        if let Some(edge) = self.edge.as_mut().filter(|edge| edge.at + FILTER <= run.since) {
            edge.served = true;
            self.hall_latency_max = self.hall_latency_max.max(now.saturating_sub(edge.at));
        }
    }

    /// Records that the bridge is on or off.
    pub fn bridge(&mut self, now: Time, on: bool) {
        self.driven_since = on.then(|| self.driven_since.unwrap_or(now));
        self.edge = self.edge.filter(|_| on);
    }

    /// When the bridge was switched on.
    #[must_use]
    pub const fn driven_since(&self) -> Option<Time> {
        self.driven_since
    }

    /// Records a frame for the board at its end on the wire.
    pub fn request(&mut self, frame: &Frame, now: Time) {
        self.asked.retain(|&(_, at)| now < at + NO_ANSWER);
        if let Some(Message { body: Body::Get(property), .. }) = Message::parse(frame) {
            self.asked.push((property, now));
        }
    }

    /// Records the present contents of the mailboxes.
    pub fn mailboxes(&mut self, frames: &[Frame], now: Time) {
        for message in frames.iter().filter_map(Message::parse) {
            let property = match message.body {
                Body::Set { property, .. } => property,
                Body::Position(_) => Property::P.id(),
                Body::Get(_) | Body::Torques(_) | Body::More { .. } => continue,
            };
            if let Some(index) = self.asked.iter().position(|&(asked, _)| asked == property) {
                let (_, at) = self.asked.remove(index);
                self.can_latency_max = self.can_latency_max.max(now.saturating_sub(at));
            }
        }
    }

    /// The figures so far.
    #[must_use]
    pub fn figures(&self, machine: &Machine) -> Figures {
        let counts = &machine.cpu.counts;
        let tick = counts.handlers.get(TICK).copied().unwrap_or_default();
        let us = |time: Time| time as f64 / US as f64;
        let instructions = counts.instructions - self.since.1;
        let seconds = (machine.now() - self.since.0) as f64 / HZ as f64;
        let percent = |share: f64| if share.is_finite() { 100.0 * share } else { 0.0 };
        Figures {
            tick_instructions_mean: tick.total as f64 / tick.runs.max(1) as f64,
            tick_instructions_max: tick.max,
            hall_instructions_max: self.hall_instructions_max,
            hall_latency_us_max: us(self.hall_latency_max),
            can_latency_us_max: us(self.can_latency_max),
            cpu_load_pct: percent(instructions as f64 * CYCLES / (CYCLES_A_SECOND * seconds)),
            stack_bytes_max: STACK.end().saturating_sub(machine.cpu.lowest_sp()),
            instructions,
        }
    }
}

impl Figures {
    /// The maximum of each figure, and the sum of the instructions.
    #[must_use]
    pub fn worst(self, other: Self) -> Self {
        Self {
            tick_instructions_mean: self.tick_instructions_mean.max(other.tick_instructions_mean),
            tick_instructions_max: self.tick_instructions_max.max(other.tick_instructions_max),
            hall_instructions_max: self.hall_instructions_max.max(other.hall_instructions_max),
            hall_latency_us_max: self.hall_latency_us_max.max(other.hall_latency_us_max),
            can_latency_us_max: self.can_latency_us_max.max(other.can_latency_us_max),
            cpu_load_pct: self.cpu_load_pct.max(other.cpu_load_pct),
            stack_bytes_max: self.stack_bytes_max.max(other.stack_bytes_max),
            instructions: self.instructions + other.instructions,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::counts::Run;

    const AFTER_US: u64 = 16;

    fn driven() -> (Meter, Counts) {
        let (mut meter, counts) = (Meter::default(), Counts::default());
        meter.halls(0, 1, &counts);
        meter.bridge(0, true);
        (meter, counts)
    }

    fn handle(meter: &mut Meter, counts: &mut Counts, at_us: u64, writes: bool) {
        counts.running.push(Run { exception: HALL, instructions: 100, since: at_us * US });
        if writes {
            meter.gate_write((at_us + 2) * US, counts);
        }
        counts.leave(HALL);
    }

    fn latency_us(meter: &Meter) -> u64 {
        meter.hall_latency_max / US
    }

    #[test]
    fn late_edge_counts_in_full() {
        let (mut meter, mut counts) = driven();
        meter.halls(1000 * US, 3, &counts);
        handle(&mut meter, &mut counts, 1700, true);
        assert_eq!(latency_us(&meter), 702);
        // The same if another edge arrives before the handler.
        meter.halls(5000 * US, 2, &counts);
        meter.halls(6000 * US, 6, &counts);
        handle(&mut meter, &mut counts, 6014, true);
        assert_eq!(latency_us(&meter), 1016);
    }

    #[test]
    fn returning_code_is_no_edge() {
        let (mut meter, mut counts) = driven();
        meter.halls(1000 * US, 3, &counts);
        meter.halls(1003 * US, 1, &counts);
        meter.halls(3000 * US, 3, &counts);
        handle(&mut meter, &mut counts, 3014, true);
        assert_eq!(latency_us(&meter), AFTER_US);
    }

    #[test]
    fn edge_ends_with_its_handler() {
        let (mut meter, mut counts) = driven();
        meter.halls(1000 * US, 3, &counts);
        handle(&mut meter, &mut counts, 1014, false);
        // The handler runs for another reason.
        handle(&mut meter, &mut counts, 2000, true);
        meter.halls(3000 * US, 2, &counts);
        handle(&mut meter, &mut counts, 3014, true);
        handle(&mut meter, &mut counts, 3500, true);
        assert_eq!(latency_us(&meter), AFTER_US);
        meter.halls(5000 * US, 6, &counts);
        meter.bridge(5001 * US, false);
        meter.halls(6000 * US, 4, &counts);
        meter.bridge(7000 * US, true);
        handle(&mut meter, &mut counts, 7500, true);
        assert_eq!(latency_us(&meter), AFTER_US);
    }
}
