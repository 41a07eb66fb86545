//! One simulated board on the bus: what its reset vector, its interrupts and its idle loop are on the metal, in the same
//! order, with simulated time for the timers. After power-up the monitor runs; it starts the application.

mod first_day;

use servo_core::units::Micros;
use servo_core::{Event, Telemetry};
use tater_fw::monitor::Next;
use tater_fw::storage::Progress;
use tater_fw::tater::SetError;
use tater_fw::{Analog, Board, Monitor, Tater};
use tater_wire::{FaultCode, Frame};

use crate::world::board::SimBoard;
use crate::world::bus::Station;
use crate::world::rig::{Rig, Truth};
use first_day::in_use;
pub use first_day::placeholder_application;

/// Control tick in microseconds (servo_core's TICK_HZ).
const TICK_US: u64 = 1_000_000 / servo_core::num::TICK_HZ as u64;

/// Unfed for so long, the watchdog resets the board, µs: the slow task feeds it ten times a second, and a page takes
/// 40 ms to erase.
const WATCHDOG_US: u64 = 500_000;

/// Ticks from one slow task to the next: 10 Hz.
const SLOW_TICKS: u64 = 100;

/// From a reset to the first line of the program, µs: crystal and clocks, 2 ms in the data sheet at most; chosen.
const BOOT_US: u64 = 5_000;

/// Steps without a flash operation that the monitor does at most from one event to the next: they take microseconds.
const STEPS: usize = 8;

/// What a slice of a sum over an image takes the monitor, µs: 256 bytes at some 42 cycles each, at 72 MHz.
const CHECK_US: u64 = 150;

/// What runs on the board.
#[allow(clippy::large_enum_variant, reason = "one a node, and it hardly ever moves")]
#[derive(Debug)]
enum Program {
    /// The power is off.
    Off(SimBoard),
    /// After a reset.
    Monitor(Monitor<SimBoard>),
    /// After STAT 2.
    Application(Tater<SimBoard>),
}

/// One board and its plant.
#[derive(Debug)]
pub struct Node {
    /// `None` only while one program hands the board to the next.
    program: Option<Program>,
    now_us: u64,
    next_tick_us: u64,
    ticks: u64,
    /// Until then the processor waits for its flash, or boots.
    busy_until_us: u64,
    /// Until then it boots.
    boots_until_us: u64,
    /// A hall line changed meanwhile.
    missed_edge: bool,
    resets: u32,
    /// How often the watchdog had been fed, and since when.
    fed: (u32, u64),
    watchdog_resets: u32,
    count: i32,
    last_count_us: u64,
}

/// Everything that can be known of a board after a tick.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Time of the tick.
    pub ms: u32,
    /// What the servo says.
    pub status: Telemetry,
    /// Whether the bridge is on.
    pub driven: bool,
    /// Whether the brake is told to release.
    pub brake_released: bool,
    /// What is really so.
    pub truth: Truth,
    /// Hall code.
    pub halls: u8,
    /// What the board measured at the tick.
    pub analog: Analog,
    /// Time of the last hall count, µs.
    pub last_count_us: u64,
    /// The plant's count that the servo calls 0, as [`crate::experiment::metrics::Meter`] has followed it.
    pub zero_counts: f64,
}

impl Sample {
    /// The servo's position.
    #[must_use]
    pub fn estimated_counts(&self) -> f64 {
        self.status.position.0.to_num()
    }

    /// The servo's set-point.
    #[must_use]
    pub fn setpoint_counts(&self) -> f64 {
        self.status.setpoint.0.to_num()
    }
}

impl Node {
    /// A board whose power comes on now, with an application in its flash: it waits in the monitor.
    #[must_use]
    pub fn new(board: SimBoard) -> Self {
        Self::again(in_use(board))
    }

    /// A board whose power comes on again, its flash as it is.
    #[must_use]
    pub fn again(board: SimBoard) -> Self {
        let mut node = Self::off(board);
        node.power_on();
        node
    }

    /// A new board that is awake already: STAT 2.
    #[must_use]
    pub fn awake(board: SimBoard) -> Self {
        let mut node = Self::off(in_use(board));
        node.start_application();
        node
    }

    fn off(board: SimBoard) -> Self {
        let now_us = board.rig().now_us();
        Self {
            program: Some(Program::Off(board)),
            now_us,
            next_tick_us: now_us + TICK_US,
            ticks: 0,
            busy_until_us: now_us,
            boots_until_us: now_us,
            missed_edge: false,
            resets: 0,
            fed: (0, now_us),
            watchdog_resets: 0,
            count: 0,
            last_count_us: now_us,
        }
    }

    // --- power and reset ----------------------------------------------------------------------------------

    /// The power fails: bridge off, brake engaged, RAM lost. The rotor coasts on.
    pub fn power_off(&mut self) {
        let mut board = self.take_board();
        board.reset_pins(None);
        self.program = Some(Program::Off(board));
    }

    /// The power comes on: the monitor runs, even if it was on.
    pub fn power_on(&mut self) {
        self.reset(None);
    }

    /// The monitor runs; `cause` is why, if nobody asked for it.
    fn reset(&mut self, cause: Option<FaultCode>) {
        let mut board = self.take_board();
        board.reset_pins(cause);
        board.flash().power_up();
        self.resets = board.resets();
        self.program = Some(Program::Monitor(Monitor::new(board)));
        self.boot();
    }

    fn start_application(&mut self) {
        let board = self.take_board();
        let tater = Tater::new(board, micros(self.now_us));
        self.count = tater.count();
        self.program = Some(Program::Application(tater));
    }

    /// Until then the CAN controller is off the bus.
    fn boot(&mut self) {
        self.boots_until_us = self.now_us + BOOT_US;
        self.busy_until_us = self.boots_until_us;
    }

    fn take_board(&mut self) -> SimBoard {
        match self.program.take().expect("a node has a program between two calls") {
            Program::Off(board) => board,
            Program::Monitor(monitor) => monitor.into_board(),
            Program::Application(tater) => tater.into_board(),
        }
    }

    // --- time -------------------------------------------------------------------------------------------------

    /// One millisecond.
    pub fn step(&mut self) {
        self.advance(self.now_us + TICK_US);
    }

    /// Runs the board and its plant until `until_us`.
    pub fn advance(&mut self, until_us: u64) {
        while self.now_us < until_us {
            let stalled = self.is_busy();
            let due = if stalled { self.busy_until_us } else { self.next_tick_us };
            let bites_us = self.fed.1 + WATCHDOG_US + 1;
            let edge = self.board_mut().run(until_us.min(due).min(bites_us));
            self.now_us = self.board().rig().now_us();
            self.missed_edge |= edge;
            self.watch();
            if self.is_busy() {
                continue;
            }
            // Only what happens is acted on, never where a caller's time ends: how it is sliced changes nothing.
            let ticks = self.now_us >= self.next_tick_us;
            if ticks {
                self.next_tick_us = (self.now_us / TICK_US + 1) * TICK_US;
                self.tick();
            }
            if self.missed_edge && !self.is_busy() {
                self.edge();
            }
            if ticks || stalled {
                self.idle();
            }
        }
    }

    const fn is_busy(&self) -> bool {
        self.now_us < self.busy_until_us
    }

    /// The hall interrupt; after a tick at the same time, because its filter lets an edge through a little later.
    fn edge(&mut self) {
        self.missed_edge = false;
        let now = micros(self.now_us);
        if let Some(Program::Application(tater)) = &mut self.program {
            tater.hall(now);
        }
        self.after();
    }

    /// The control tick, and every hundredth the slow task.
    fn tick(&mut self) {
        self.ticks += 1;
        let now = micros(self.now_us);
        self.board_mut().convert();
        if let Some(Program::Application(tater)) = &mut self.program {
            tater.tick(now);
            tater.flush();
            if self.ticks.is_multiple_of(SLOW_TICKS) {
                tater.housekeeping(now);
            }
        }
        self.after();
    }

    /// The watchdog: resets a board whose program has not fed it for too long.
    fn watch(&mut self) {
        let feeds = self.board().feeds();
        if feeds != self.fed.0 || matches!(self.program, Some(Program::Off(_))) {
            self.fed = (feeds, self.now_us);
        } else if self.now_us - self.fed.1 > WATCHDOG_US {
            self.fed.1 = self.now_us;
            self.watchdog_resets += 1;
            self.reset(Some(FaultCode::Watchdog));
        }
    }

    /// The idle loop: one flash operation, if one is due.
    fn idle(&mut self) {
        if self.is_busy() {
            return;
        }
        let now = micros(self.now_us);
        match &mut self.program {
            Some(Program::Application(tater)) => {
                let progress = tater.store();
                let flash = tater.board().sim_flash();
                debug_assert!(!matches!(progress, Progress::Failed(_)) || flash.is_dead() || flash.is_worn());
            }
            Some(Program::Monitor(monitor)) => {
                for _ in 0..STEPS {
                    if monitor.step(now) == Next::Start {
                        self.start_application();
                        self.boot();
                        break;
                    }
                    if monitor.is_checking() {
                        self.busy_until_us = self.now_us + CHECK_US;
                    }
                    if monitor.is_checking() || monitor.is_idle() || monitor.board().sim_flash().is_busy() {
                        break;
                    }
                }
            }
            Some(Program::Off(_)) | None => {}
        }
        self.after();
    }

    /// What every call into a program may have led to: time with the flash, a count, a reset, no power.
    fn after(&mut self) {
        let busy_us = self.board_mut().flash().take_busy_us();
        if busy_us > 0 {
            self.busy_until_us = self.now_us.max(self.busy_until_us) + busy_us;
        }
        if let Some(Program::Application(tater)) = &self.program {
            let count = tater.count();
            if count != self.count {
                (self.count, self.last_count_us) = (count, self.now_us);
            }
        }
        if self.board().sim_flash().is_dead() {
            self.power_off();
        } else if self.board().resets() != self.resets {
            self.power_on();
        }
    }

    // --- the bus ----------------------------------------------------------------------------------------------

    /// A frame comes in now. The filters of the CAN controller are before the program.
    ///
    /// # Errors
    /// Why the application did nothing with it, which on the bus nobody is told; the monitor never says.
    pub fn receive(&mut self, frame: &Frame) -> Result<(), SetError> {
        if !self.board().lets_through(frame) {
            return Ok(());
        }
        let now = micros(self.now_us);
        let done = match &mut self.program {
            Some(Program::Application(tater)) => tater.receive(frame, now),
            Some(Program::Monitor(monitor)) => {
                monitor.receive(frame, now);
                Ok(())
            }
            Some(Program::Off(_)) | None => Ok(()),
        };
        self.after();
        self.idle();
        done
    }

    /// Frames that the controller wants to send.
    #[must_use]
    pub fn mailboxes(&self) -> &[Frame] {
        self.board().mailboxes()
    }

    /// A frame of the mailboxes has been sent.
    pub fn sent(&mut self, frame: &Frame) {
        self.board_mut().sent(frame);
        if let Some(Program::Application(tater)) = &mut self.program {
            tater.flush();
        }
        self.idle();
    }

    // --- for those who watch --------------------------------------------------------------------------------

    /// The hardware.
    #[must_use]
    pub fn board(&self) -> &SimBoard {
        match self.program.as_ref().expect("a node has a program between two calls") {
            Program::Off(board) => board,
            Program::Monitor(monitor) => monitor.board(),
            Program::Application(tater) => tater.board(),
        }
    }

    /// The hardware.
    pub fn board_mut(&mut self) -> &mut SimBoard {
        match self.program.as_mut().expect("a node has a program between two calls") {
            Program::Off(board) => board,
            Program::Monitor(monitor) => monitor.board_mut(),
            Program::Application(tater) => tater.board_mut(),
        }
    }

    /// The node's number by its straps.
    #[must_use]
    pub fn straps(&self) -> tater_wire::Node {
        self.board().straps()
    }

    /// How often the watchdog has reset the board.
    #[must_use]
    pub const fn watchdog_resets(&self) -> u32 {
        self.watchdog_resets
    }

    /// The plant, to disturb it.
    pub fn rig_mut(&mut self) -> &mut Rig {
        self.board_mut().rig_mut()
    }

    /// The application, if it runs.
    #[must_use]
    pub const fn application(&self) -> Option<&Tater<SimBoard>> {
        match &self.program {
            Some(Program::Application(tater)) => Some(tater),
            _ => None,
        }
    }

    /// The application's next report.
    pub fn event(&mut self) -> Option<Event> {
        match &mut self.program {
            Some(Program::Application(tater)) => tater.event(),
            _ => None,
        }
    }

    /// What can be known now; `None` unless the application runs.
    #[must_use]
    pub fn sample(&self) -> Option<Sample> {
        let tater = self.application()?;
        let board = tater.board();
        Some(Sample {
            ms: (self.now_us / TICK_US) as u32,
            status: tater.status(),
            driven: tater.drive().duty.is_some(),
            brake_released: tater.drive().brake_released,
            truth: board.rig().truth(),
            halls: board.rig().halls(),
            analog: *board.analog_now(),
            last_count_us: self.last_count_us,
            zero_counts: 0.0,
        })
    }
}

#[cfg(test)]
mod tests;

/// A time-stamp as the board's 32-bit timer gives it.
fn micros(us: u64) -> Micros {
    Micros(us as u32)
}

impl Station for Node {
    fn now_us(&self) -> u64 {
        self.now_us
    }

    fn advance(&mut self, until_us: u64) {
        Self::advance(self, until_us);
    }

    fn next_us(&self) -> u64 {
        if self.is_busy() { self.busy_until_us } else { self.next_tick_us }
    }

    fn busy_until_us(&self) -> u64 {
        self.busy_until_us
    }

    fn is_on_bus(&self) -> bool {
        self.now_us >= self.boots_until_us && !matches!(self.program, Some(Program::Off(_)))
    }

    fn receive(&mut self, frame: &Frame) {
        // Nobody is told on the bus.
        let _ = Self::receive(self, frame);
    }

    fn pending(&self) -> &[Frame] {
        self.mailboxes()
    }

    fn sent(&mut self, frame: &Frame) {
        Self::sent(self, frame);
    }
}
