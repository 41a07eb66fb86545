//! The board: the chip's pins at the motor, its sensors and the bus.
//!
//! While the core sleeps, chip and motor go from event to event; while it runs, the motor follows it in steps of `SLICE` and at
//! each change of a gate. The time of a hall edge is exact in either case, because the timer's filter sees it later than that.

use std::rc::Rc;

use hil_sim::bus::Station;
use hil_sim::over_can::Watched;
use hil_sim::rig::{Bridge, Rig};
use tater_wire::memory::MONITOR;
use tater_wire::{Frame, Node};

use crate::analog::FrontEnd;
use crate::bridge;
use crate::chip::{Chip, Reset};
use crate::image::Programs;
use crate::machine::{Machine, Pause};
use crate::meter::{Figures, Meter};
use crate::stop::{Problem, Stop};
use crate::time::{Time, US};

/// How far the core runs ahead of the motor: less than the hall lines' filter (14 us) by more than an instruction.
const SLICE: Time = 5 * US;

/// How often the converter's inputs are brought up to date, us: a PWM period, in which it converts once.
const SAMPLE_US: u64 = 50;

/// How far apart bus and board may be while the board's program runs, us: how late a frame may begin that it asks for.
const BUS_US: u64 = 10;
/// The same while it sleeps: only a hall edge could wake it, which asks for no frame but the report of a fault.
const ASLEEP_US: u64 = 250;

/// Pins, port and number: straps (1, 2, 4), break input, brake, hall lines.
const STRAPS: [(usize, usize); 3] = [(1, 0), (1, 1), (1, 10)];
const BREAK: (usize, usize) = (1, 12);
const BRAKE: (usize, usize) = (1, 5);
const HALLS: [(usize, usize); 3] = [(1, 6), (1, 7), (1, 8)];

/// Runs a board to a time: what a debugger does in place of the board.
pub type Runner = Box<dyn FnMut(&mut Board, Time)>;

/// What a debugger requests of a board.
#[derive(Clone, Debug, Default)]
pub(crate) struct DebugRequests {
    pub breakpoints: Vec<u32>,
    /// One instruction, then stop.
    pub step: bool,
}

/// A board that executes its flash, and its motor.
pub struct Board {
    node: Node,
    machine: Machine,
    rig: Rig,
    front_end: FrontEnd,
    bridge: Bridge,
    brake_released: bool,
    /// Whether the over-current comparator pulls the break input low.
    tripped: bool,
    /// When the converter's inputs were last brought up to date, us.
    sampled_us: u64,
    /// The bus's time.
    now_us: u64,
    /// What the controller would send.
    pending: Vec<Frame>,
    /// Seed of what RAM holds after the next power-up.
    seed: u64,
    /// What is done to the hall lines, whatever the sensors say.
    hall_lines: [Option<bool>; 3],
    meter: Meter,
    /// Who runs it on the bus in place of itself.
    runner: Option<Runner>,
    pub(crate) debug: DebugRequests,
    /// What ended the run, if anything did.
    problem: Option<Stop>,
}

impl Board {
    /// A board whose power is off: the monitor in its flash, everything else erased. `straps` is its node number; `seed` is
    /// that of what its RAM holds at first.
    #[must_use]
    pub fn new(mut rig: Rig, straps: Node, programs: &Programs, seed: u64) -> Self {
        let number = u32::from(straps.number());
        let mut chip = Chip::new(seed, [0x0043_0025 + number, 0x3042_3132, 0x2039_3751]);
        chip.flash.load(MONITOR.start, &programs.monitor);
        for (bit, (port, pin)) in STRAPS.into_iter().enumerate() {
            // A strap to ground says 1.
            chip.gpio.driven[port][pin] = (number >> bit & 1 == 1).then_some(false);
        }
        // The comparator pulls the break input, and TIM1 does the rest.
        rig.guard_outside();
        let now_us = rig.now_us();
        chip.now = now_us * US;
        let mut board = Self {
            node: straps,
            machine: Machine::new(chip, Rc::clone(&programs.names)),
            front_end: FrontEnd::new(),
            rig,
            bridge: Bridge::Off,
            brake_released: false,
            tripped: false,
            sampled_us: now_us,
            now_us,
            pending: Vec::new(),
            seed,
            hall_lines: [None; 3],
            meter: Meter::default(),
            runner: None,
            debug: DebugRequests::default(),
            problem: None,
        };
        board.halls_changed();
        board
    }

    /// The power comes on.
    pub fn power_on(&mut self) {
        self.seed = self.seed.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(1);
        self.machine.chip_mut().forget(self.seed);
        self.reset(Reset::Power);
    }

    /// The power fails: bridge off, brake engaged, RAM lost. The rotor coasts on.
    pub fn power_off(&mut self) {
        self.machine.power_off();
        self.pins_changed();
    }

    /// The reset pin is pulled, or the supply sags below the threshold and comes back before RAM is lost.
    pub fn reset(&mut self, cause: Reset) {
        let done = self.machine.reset(cause);
        self.judge(done);
        self.pins_changed();
    }

    /// The same board in the same state, to see what becomes of it in another way.
    #[must_use]
    pub fn duplicate(&self) -> Self {
        Self {
            machine: self.machine.duplicate(),
            rig: self.rig.clone(),
            front_end: self.front_end.clone(),
            pending: self.pending.clone(),
            meter: self.meter.clone(),
            runner: None,
            debug: DebugRequests::default(),
            problem: self.problem.clone(),
            ..*self
        }
    }

    /// A hall line (0 to 2) sticks at a level, or follows its sensor again. An open line is pulled high.
    pub fn stick_hall(&mut self, line: usize, level: Option<bool>) {
        if let Some(forced) = self.hall_lines.get_mut(line) {
            *forced = level;
        }
        self.halls_changed();
    }

    /// Its number by its straps.
    #[must_use]
    pub const fn node(&self) -> Node {
        self.node
    }

    /// The chip and its core.
    #[must_use]
    pub const fn machine(&self) -> &Machine {
        &self.machine
    }

    /// The chip and its core.
    pub const fn machine_mut(&mut self) -> &mut Machine {
        &mut self.machine
    }

    /// The motor.
    #[must_use]
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The motor, to disturb it.
    pub const fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }

    /// What the gates do to the motor.
    #[must_use]
    pub const fn bridge(&self) -> Bridge {
        self.bridge
    }

    /// Whether the brake's coil is on.
    #[must_use]
    pub const fn brake_released(&self) -> bool {
        self.brake_released
    }

    /// What was measured last, before the converter.
    #[must_use]
    pub const fn front_end(&self) -> &FrontEnd {
        &self.front_end
    }

    /// What ended the run: from then on the board stands still, its bridge off.
    #[must_use]
    pub const fn problem(&self) -> Option<&Stop> {
        self.problem.as_ref()
    }

    fn judge<T>(&mut self, done: Result<T, Stop>) -> Option<T> {
        match done {
            Ok(value) => Some(value),
            Err(stop) => {
                self.problem.get_or_insert(stop);
                self.bridge = Bridge::Off;
                self.brake_released = false;
                None
            }
        }
    }

    /// Lets somebody else run it on the bus.
    pub fn set_runner(&mut self, runner: Runner) {
        self.runner = Some(runner);
    }

    /// Measures from now on what the program takes.
    pub fn begin_figures(&mut self) {
        self.meter.begin(&mut self.machine);
    }

    /// What the program has taken since.
    #[must_use]
    pub fn figures(&self) -> Figures {
        self.meter.figures(&self.machine)
    }

    /// Runs chip and motor to `until`, or to the first breakpoint: then it returns true.
    pub fn run(&mut self, until: Time, breakpoints: &[u32]) -> bool {
        while self.machine.now() < until && self.problem.is_none() {
            let to = if self.machine.is_waiting() {
                let to = self.machine.next_event().min(until).min(self.next_sample());
                // Perhaps only to an edge of a hall line, from which on the chip sees it.
                self.follow(to).unwrap_or(to)
            } else {
                until.min(self.machine.now() + SLICE).min(self.next_sample().max(self.machine.now() + 1))
            };
            let done = self.machine.run(to, breakpoints);
            let Some(pause) = self.judge(done) else { break };
            let now = self.machine.now();
            while self.follow(now).is_some() {}
            if pause == Pause::Gates {
                self.meter.gate_write(now, &self.machine.cpu.counts);
            }
            if matches!(pause, Pause::Gates | Pause::Reset(_)) {
                self.pins_changed();
            } else {
                self.brake_released = brake(self.machine.chip());
            }
            if pause == Pause::Breakpoint {
                return true;
            }
        }
        if self.problem.is_some() {
            while self.follow(until).is_some() {}
        }
        false
    }

    fn next_sample(&self) -> Time {
        (self.sampled_us + SAMPLE_US) * US
    }

    /// Lets the motor follow to `now` or to the first edge of a hall line, whose time it returns.
    fn follow(&mut self, now: Time) -> Option<Time> {
        let to_us = (now / US).min(self.sampled_us + SAMPLE_US);
        let edge = self.rig.advance(self.bridge, self.brake_released, to_us);
        self.over_current();
        if self.rig.now_us() >= self.sampled_us + SAMPLE_US {
            self.sampled_us = self.rig.now_us();
            self.sample();
        }
        if edge.is_some() {
            self.halls_changed();
        }
        let behind = self.rig.now_us() < now / US;
        (edge.is_some() || behind).then(|| self.rig.now_us() * US)
    }

    /// The comparator pulls the break input low, and the gates are off before the next microsecond.
    fn over_current(&mut self) {
        if self.rig.tripped() != self.tripped {
            self.tripped = self.rig.tripped();
            self.machine.chip_mut().set_pin(BREAK, self.tripped.then_some(false));
            self.pins_changed();
        }
    }

    /// Brings the converter's inputs up to date.
    fn sample(&mut self) {
        let inputs = self.front_end.sample(&mut self.rig);
        self.machine.chip_mut().set_analog(inputs);
    }

    /// The hall sensors pull their lines low or do not; the time is the motor's.
    fn halls_changed(&mut self) {
        let (code, at) = (self.rig.halls(), self.rig.now_us() * US);
        let mut pins = 0;
        let chip = self.machine.chip_mut();
        for (bit, (pin, forced)) in HALLS.into_iter().zip(self.hall_lines).enumerate() {
            let level = forced.unwrap_or(code >> bit & 1 == 1);
            pins |= u8::from(level) << bit;
            // Open collectors: high is the pull-up's.
            chip.gpio.driven[pin.0][pin.1] = (!level).then_some(false);
        }
        chip.hall_lines(at);
        self.meter.halls(at, pins, &self.machine.cpu.counts);
    }

    /// Takes over what the gates and the brake's pin do.
    fn pins_changed(&mut self) {
        let bridge = {
            let chip = self.machine.chip();
            self.brake_released = brake(chip);
            bridge::of(chip).and_then(|bridge| match bridge {
                Bridge::Off => Ok(bridge),
                Bridge::On { .. } => bridge::dead_time_agrees(chip, &self.rig).map(|()| bridge),
            })
        };
        match bridge {
            Ok(bridge) => {
                self.bridge = bridge;
                self.meter.bridge(self.machine.now(), bridge != Bridge::Off);
            }
            Err(what) => {
                let stop = self.machine.stop(Problem::Bridge { what });
                self.judge::<()>(Err(stop));
            }
        }
    }

    /// Takes over what the controller would send.
    fn mail(&mut self) {
        self.pending.clear();
        self.pending.extend_from_slice(self.machine.chip().can.pending());
        self.meter.mailboxes(&self.pending, self.machine.now());
    }
}

/// Whether the brake's pin is high; a resistor pulls it down.
fn brake(chip: &Chip) -> bool {
    chip.gpio.output(BRAKE.0, BRAKE.1) == Some(true)
}

impl Station for Board {
    fn now_us(&self) -> u64 {
        self.now_us
    }

    fn advance(&mut self, until_us: u64) {
        if let Some(mut runner) = self.runner.take() {
            runner(self, until_us * US);
            self.runner = Some(runner);
        } else {
            self.run(until_us * US, &[]);
        }
        self.now_us = until_us;
        self.mail();
    }

    fn next_us(&self) -> u64 {
        if self.problem.is_some() || !self.machine.is_powered() {
            u64::MAX
        } else if self.machine.is_waiting() && !self.machine.chip().touched {
            (self.machine.next_wake() / US + 1).clamp(self.now_us + 1, self.now_us + ASLEEP_US)
        } else {
            self.now_us + BUS_US
        }
    }

    fn busy_until_us(&self) -> u64 {
        0
    }

    fn latency_us(&self) -> u64 {
        0
    }

    fn is_on_bus(&self) -> bool {
        self.machine.is_powered() && self.problem.is_none() && self.machine.chip().can.is_on_bus()
    }

    fn receive(&mut self, frame: &Frame) {
        let at = self.now_us * US;
        if matches!(frame.id().to, tater_wire::Destination::Node(to) if to == self.node) {
            self.meter.request(frame, at);
        }
        let chip = self.machine.chip_mut();
        chip.can.receive(frame, at);
        chip.touched = true;
    }

    fn error(&mut self, sending: bool) {
        let at = self.now_us * US;
        let chip = self.machine.chip_mut();
        chip.can.error(sending, at);
        chip.touched = true;
    }

    fn pending(&self) -> &[Frame] {
        &self.pending
    }

    fn sent(&mut self, frame: &Frame) {
        let at = self.now_us * US;
        {
            let chip = self.machine.chip_mut();
            chip.can.sent(frame, at);
            chip.touched = true;
        }
        self.mail();
    }
}

impl Watched for Board {
    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }

    fn driven_since_us(&self) -> Option<u64> {
        self.meter.driven_since().map(|at| at / US)
    }

    fn is_brake_released(&self) -> bool {
        self.brake_released
    }

    fn power_on(&mut self) {
        Self::power_on(self);
    }

    fn problem(&self) -> Option<String> {
        self.problem
            .as_ref()
            .map(|stop| format!("{stop}\n  next: look at the code there, or single-step it with --gdb"))
    }
}
