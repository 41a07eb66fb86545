//! The board: connects the chip's pins to motor, sensors and bus.
//!
//! While the core sleeps, chip and motor advance from event to event. While it runs, the motor follows in
//! steps of `SLICE` and at each change of a gate. The time of a hall edge is exact in both cases, because the
//! timer's filter delays it by more than a step.

use std::rc::Rc;

use hil_experiment::over_can::ObservedBoard;
use hil_torture::fault::Subject;
use hil_world::bus::Station;
use hil_world::hand::Motorized;
use hil_world::node::shipped_storage;
use hil_world::rig::{Bridge, Rig};
use tater_f103::map::{HEAT, MONITOR, RAM, STORAGE};
use tater_wire::{Frame, Node};

use crate::analog::FrontEnd;
use crate::bridge;
use crate::chip::{Chip, Reset};
use crate::image::Programs;
use crate::machine::{Machine, Pause};
use crate::meter::{Figures, Meter};
use crate::stop::{Problem, Stop};
use crate::time::{Time, US};

/// Longest lead of the core over the motor: the filter of the hall lines (14 us) less one instruction.
const SLICE: Time = 5 * US;

/// Sample period of the converter's inputs, us: one PWM period, in which it converts once.
const SAMPLE_US: u64 = 50;

/// Largest time between bus and board while the program runs, us: how late a requested frame may begin.
const BUS_US: u64 = 10;
/// The same while it sleeps: only a hall edge could wake it, which requests no frame but a fault report.
const ASLEEP_US: u64 = 250;

/// Pins as (port, number); the straps weigh 1, 2 and 4.
const STRAPS: [(usize, usize); 3] = [(1, 0), (1, 1), (1, 10)];
const BREAK: (usize, usize) = (1, 12);
const BRAKE: (usize, usize) = (1, 5);
const HALLS: [(usize, usize); 3] = [(1, 6), (1, 7), (1, 8)];

/// Runs a board up to a time in place of [`Board::run`]: a debugger.
pub type Runner = Box<dyn FnMut(&mut Board, Time)>;

#[derive(Clone, Debug, Default)]
pub(crate) struct DebugRequests {
    pub breakpoints: Vec<u32>,
    pub step: bool,
}

/// A board that executes its flash, with its motor.
pub struct Board {
    node: Node,
    machine: Machine,
    rig: Rig,
    front_end: FrontEnd,
    bridge: Bridge,
    brake_released: bool,
    /// The over-current comparator pulls the break input low.
    tripped: bool,
    sampled_us: u64,
    /// Time of the bus, us.
    now_us: u64,
    pending: Vec<Frame>,
    /// Seed of the RAM contents after the next power-up.
    seed: u64,
    /// Levels that override the hall sensors: stuck lines.
    hall_lines: [Option<bool>; 3],
    meter: Meter,
    runner: Option<Runner>,
    pub(crate) debug: DebugRequests,
    problem: Option<Stop>,
}

impl Board {
    /// A board without power: the monitor and the stored wiring of a shipped board in its flash, everything else erased. `straps` is its node number,
    /// `seed` determines the first contents of its RAM.
    #[must_use]
    pub fn new(mut rig: Rig, straps: Node, programs: &Programs, seed: u64) -> Self {
        let number = u32::from(straps.number());
        let mut chip = Chip::new(seed, [0x0043_0025 + number, 0x3042_3132, 0x2039_3751]);
        chip.flash.load(MONITOR.start, &programs.monitor);
        chip.flash.load(STORAGE.start, &shipped_storage());
        for (bit, (port, pin)) in STRAPS.into_iter().enumerate() {
            // A strap to ground is a 1.
            chip.gpio.driven[port][pin] = (number >> bit & 1 == 1).then_some(false);
        }
        // The comparator acts through the break input and TIM1 alone.
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

    /// Switches the power on.
    pub fn power_on(&mut self) {
        self.seed = self.seed.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(1);
        self.machine.chip_mut().forget(self.seed);
        // The rotor, or the order of the lines, may have changed meanwhile.
        self.halls_changed();
        self.reset(Reset::Power);
    }

    /// Switches the power off: bridge off, brake engaged, RAM lost. The rotor coasts on.
    pub fn power_off(&mut self) {
        self.machine.power_off();
        self.pins_changed();
    }

    /// Resets by the pin, or by a supply dip too short to lose RAM.
    pub fn reset(&mut self, cause: Reset) {
        let done = self.machine.reset(cause);
        self.judge(done);
        self.pins_changed();
    }

    /// A copy in the same state, to try another continuation.
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

    /// Makes a hall line (0 to 2) stick at a level, or follow its sensor again. An open line is pulled high.
    pub fn stick_hall(&mut self, line: usize, level: Option<bool>) {
        if let Some(forced) = self.hall_lines.get_mut(line) {
            *forced = level;
        }
        self.halls_changed();
    }

    /// The node number of the straps.
    #[must_use]
    pub const fn node(&self) -> Node {
        self.node
    }

    /// Chip and core.
    #[must_use]
    pub const fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Chip and core.
    pub const fn machine_mut(&mut self) -> &mut Machine {
        &mut self.machine
    }

    /// Motor and sensors.
    #[must_use]
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Motor and sensors, to disturb them.
    pub const fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }

    /// The state of the bridge.
    #[must_use]
    pub const fn bridge(&self) -> Bridge {
        self.bridge
    }

    /// Whether the brake's coil is energized.
    #[must_use]
    pub const fn brake_released(&self) -> bool {
        self.brake_released
    }

    /// The last analog readings, before conversion.
    #[must_use]
    pub const fn front_end(&self) -> &FrontEnd {
        &self.front_end
    }

    /// The problem that ended the run. From then on the board stands still with its bridge off.
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

    /// Sets who runs the board on the bus in place of [`Self::run`].
    pub fn set_runner(&mut self, runner: Runner) {
        self.runner = Some(runner);
    }

    /// Starts to measure the program.
    pub fn begin_figures(&mut self) {
        self.meter.begin(&mut self.machine);
    }

    /// The figures since [`Self::begin_figures`].
    #[must_use]
    pub fn figures(&self) -> Figures {
        self.meter.figures(&self.machine)
    }

    /// Runs chip and motor up to `until`; returns `true` early at the first breakpoint.
    pub fn run(&mut self, until: Time, breakpoints: &[u32]) -> bool {
        while self.machine.now() < until && self.problem.is_none() {
            let to = if self.machine.is_waiting() {
                let to = self.machine.next_event().min(until).min(self.next_sample());
                // The motor may stop earlier, at a hall edge.
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

    /// Advances the motor to `now`, or to the first edge of a hall line, whose time it returns.
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

    /// Lets the comparator pull the break input low: the gates are off before the next microsecond.
    fn over_current(&mut self) {
        if self.rig.tripped() != self.tripped {
            self.tripped = self.rig.tripped();
            self.machine.chip_mut().set_pin(BREAK, self.tripped.then_some(false));
            self.pins_changed();
        }
    }

    fn sample(&mut self) {
        let inputs = self.front_end.sample(&mut self.rig);
        self.machine.chip_mut().set_analog(inputs);
    }

    /// Sets the hall lines from the sensors; the time is the motor's.
    fn halls_changed(&mut self) {
        let (code, at) = (self.rig.halls(), self.rig.now_us() * US);
        let mut pins = 0;
        let chip = self.machine.chip_mut();
        for (bit, (pin, forced)) in HALLS.into_iter().zip(self.hall_lines).enumerate() {
            let level = forced.unwrap_or(code >> bit & 1 == 1);
            pins |= u8::from(level) << bit;
            // Open collectors: the pull-up makes the high level.
            chip.gpio.driven[pin.0][pin.1] = (!level).then_some(false);
        }
        chip.hall_lines(at);
        self.meter.halls(at, pins, &self.machine.cpu.counts);
    }

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

    fn mail(&mut self) {
        self.pending.clear();
        self.pending.extend_from_slice(self.machine.chip().can.pending());
        self.meter.mailboxes(&self.pending, self.machine.now());
    }
}

/// A resistor pulls the pin down.
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
        let exchange_us = self.rig.next_exchange_us();
        if self.problem.is_some() || !self.machine.is_powered() {
            exchange_us
        } else if self.machine.is_waiting() && !self.machine.chip().touched {
            let wake_us = (self.machine.next_wake() / US + 1).clamp(self.now_us + 1, self.now_us + ASLEEP_US);
            wake_us.min(exchange_us)
        } else {
            exchange_us.min(self.now_us + BUS_US)
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

    fn counts_errors(&self) -> bool {
        true
    }

    fn is_error_passive(&self) -> bool {
        self.machine.chip().can.is_error_passive()
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

impl Motorized for Board {
    fn set_power(&mut self, on: bool) {
        match (on, self.machine.is_powered()) {
            (true, false) => self.power_on(),
            // RAM survives, and with it the winding's heat.
            (true, true) => self.reset(Reset::Pin),
            (false, _) => self.power_off(),
        }
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }
}

impl Subject for Board {
    fn native(&self) -> Option<&hil_world::node::Node> {
        None
    }

    fn native_mut(&mut self) -> Option<&mut hil_world::node::Node> {
        None
    }

    fn bridge(&self) -> Bridge {
        self.bridge
    }

    fn is_brake_released(&self) -> bool {
        self.brake_released
    }

    fn problem(&self) -> Option<String> {
        self.problem.as_ref().map(Stop::to_string)
    }
}

impl ObservedBoard for Board {
    fn driven_since_us(&self) -> Option<u64> {
        self.meter.driven_since().map(|at| at / US)
    }

    fn is_brake_released(&self) -> bool {
        self.brake_released
    }

    fn power_on(&mut self) {
        Self::power_on(self);
    }

    fn keep_heat(&mut self, word: u32) {
        let at = (HEAT.start - RAM.start) as usize;
        let bytes = self.machine.chip_mut().ram.get_mut(at..);
        for (byte, kept) in bytes.into_iter().flatten().zip(word.to_le_bytes()) {
            *byte = kept;
        }
    }

    fn problem(&self) -> Option<String> {
        self.problem
            .as_ref()
            .map(|stop| format!("{stop}\n  next: look at the code there, or single-step it with --gdb"))
    }
}
