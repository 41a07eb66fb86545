//! What a run takes: instructions of the tick, from a hall edge to the bridge, from a question on the bus to its answer.
//!
//! The board says what happens at its pins; instructions are the core's own counts ([`crate::cpu::counts`]).

use serde::Serialize;
use tater_wire::memory::STACK;
use tater_wire::{Body, Frame, Message, Property};

use crate::cpu::counts::Counts;
use crate::machine::Machine;
use crate::time::{HZ, Time, US};

/// Exception numbers (RM0008 table 63): TIM3, the control tick; TIM4, the hall timer.
const TICK: usize = 16 + 29;
const HALL: u32 = 16 + 30;

/// The timer's filter: a handler that began earlier after an edge does not run for it. Rounded down to the motor's steps.
const FILTER: Time = 12 * US;

/// How long a question may be unanswered before it is taken for one that has no answer.
const NO_ANSWER: Time = 100_000 * US;

/// Cycles an instruction, and cycles a second, of the model of a chip with wait states.
const CYCLES: f64 = 1.5;
const CYCLES_A_SECOND: f64 = 72e6;

/// Follows a board from a moment on.
#[derive(Clone, Debug, Default)]
pub struct Meter {
    /// When it began, and the instructions until then.
    since: (Time, u64),
    /// The lines of the hall sensors.
    code: u8,
    /// The oldest edge that is not done with.
    edge: Option<Edge>,
    hall_instructions_max: u64,
    hall_latency_max: Time,
    /// Properties that were asked for, and when.
    asked: Vec<(u8, Time)>,
    can_latency_max: Time,
    driven_since: Option<Time>,
}

/// A change of the hall lines while the bridge is on. It waits, however long, until the handler that runs for it has ended,
/// whether that has written to the bridge or had no need to, or until the code comes back: that was a spike or a bounce.
#[derive(Clone, Copy, Debug)]
struct Edge {
    at: Time,
    /// The code before it.
    from: u8,
    /// The bridge has been written for it; the handler may write again.
    served: bool,
}

/// What a run has taken. Names as in the JSON.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Figures {
    /// The control tick alone, what preempts it excluded: mean.
    pub tick_instructions_mean: f64,
    /// The same, at worst.
    pub tick_instructions_max: u64,
    /// From TIM4's exception entry to the handler's last write to the bridge's timer.
    pub hall_instructions_max: u64,
    /// From a hall line's edge to that write; the timer's filter of 14 us is in it. To 5 us: as often the motor is looked at.
    pub hall_latency_us_max: f64,
    /// From the end of a GET on the wire to its answer in a mailbox. To 10 us: as often the bus is looked at.
    pub can_latency_us_max: f64,
    /// Instructions by 1.5 cycles of 72 MHz.
    pub cpu_load_pct: f64,
    /// Deepest that the stack has been.
    pub stack_bytes_max: u32,
    /// All instructions.
    pub instructions: u64,
}

impl Meter {
    /// Begins anew, from now on.
    pub fn begin(&mut self, machine: &mut Machine) {
        machine.cpu.counts.clear();
        machine.cpu.reset_lowest_sp();
        let since = (machine.now(), machine.cpu.counts.instructions);
        *self = Self { since, driven_since: self.driven_since, code: self.code, ..Self::default() };
    }

    /// The code at the pins of the hall lines.
    pub fn halls(&mut self, now: Time, code: u8, counts: &Counts) {
        self.done(counts);
        let from = std::mem::replace(&mut self.code, code);
        let waits = self.edge.filter(|edge| !edge.served);
        if code != from {
            self.edge = match waits {
                Some(edge) if edge.from == code => None,
                // A bridge that is off has nothing to follow.
                None => self.driven_since.map(|_| Edge { at: now, from, served: false }),
                waits => waits,
            };
        }
    }

    /// Forgets an edge whose handler has ended.
    fn done(&mut self, counts: &Counts) {
        let ended = counts.handlers.get(HALL as usize).map_or(0, |handler| handler.since);
        self.edge = self.edge.filter(|edge| ended < edge.at + FILTER);
    }

    /// The program has written to the bridge's timer.
    pub fn gate_write(&mut self, now: Time, counts: &Counts) {
        let Some(run) = counts.running.last().filter(|run| run.exception == HALL) else { return };
        self.hall_instructions_max = self.hall_instructions_max.max(run.instructions);
        self.done(counts);
        // A handler that runs for another reason has no edge before it.
        if let Some(edge) = self.edge.as_mut().filter(|edge| edge.at + FILTER <= run.since) {
            edge.served = true;
            self.hall_latency_max = self.hall_latency_max.max(now.saturating_sub(edge.at));
        }
    }

    /// The bridge is on or off.
    pub fn bridge(&mut self, now: Time, on: bool) {
        self.driven_since = on.then(|| self.driven_since.unwrap_or(now));
        self.edge = self.edge.filter(|_| on);
    }

    /// Since when the bridge is on.
    #[must_use]
    pub const fn driven_since(&self) -> Option<Time> {
        self.driven_since
    }

    /// A frame for the board has ended on the wire.
    pub fn request(&mut self, frame: &Frame, now: Time) {
        self.asked.retain(|&(_, at)| now < at + NO_ANSWER);
        if let Some(Message { body: Body::Get(property), .. }) = Message::parse(frame) {
            self.asked.push((property, now));
        }
    }

    /// What is in the mailboxes now.
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

    /// What it has taken so far.
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
    /// The worse of two boards' figures, and the instructions of both.
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

    /// Until the handler of an edge is done, us.
    const AFTER_US: u64 = 16;

    /// A meter whose bridge is on, and the halls at 1.
    fn driven() -> (Meter, Counts) {
        let (mut meter, counts) = (Meter::default(), Counts::default());
        meter.halls(0, 1, &counts);
        meter.bridge(0, true);
        (meter, counts)
    }

    /// The hall handler runs from a moment, and writes or does not, after 2 us; us.
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
    fn an_edge_counts_however_late_it_is_served() {
        let (mut meter, mut counts) = driven();
        meter.halls(1000 * US, 3, &counts);
        handle(&mut meter, &mut counts, 1700, true);
        assert_eq!(latency_us(&meter), 702);
        // Also if the next edge has come before that.
        meter.halls(5000 * US, 2, &counts);
        meter.halls(6000 * US, 6, &counts);
        handle(&mut meter, &mut counts, 6014, true);
        assert_eq!(latency_us(&meter), 1016);
    }

    #[test]
    fn a_code_that_comes_back_is_no_edge() {
        let (mut meter, mut counts) = driven();
        meter.halls(1000 * US, 3, &counts);
        meter.halls(1003 * US, 1, &counts);
        meter.halls(3000 * US, 3, &counts);
        handle(&mut meter, &mut counts, 3014, true);
        assert_eq!(latency_us(&meter), AFTER_US);
    }

    #[test]
    fn an_edge_whose_handler_has_ended_waits_no_longer() {
        let (mut meter, mut counts) = driven();
        meter.halls(1000 * US, 3, &counts);
        handle(&mut meter, &mut counts, 1014, false);
        // It runs again for another reason.
        handle(&mut meter, &mut counts, 2000, true);
        meter.halls(3000 * US, 2, &counts);
        handle(&mut meter, &mut counts, 3014, true);
        handle(&mut meter, &mut counts, 3500, true);
        assert_eq!(latency_us(&meter), AFTER_US);
        // And none waits while the bridge is off.
        meter.halls(5000 * US, 6, &counts);
        meter.bridge(5001 * US, false);
        meter.halls(6000 * US, 4, &counts);
        meter.bridge(7000 * US, true);
        handle(&mut meter, &mut counts, 7500, true);
        assert_eq!(latency_us(&meter), AFTER_US);
    }
}
