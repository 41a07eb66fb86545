//! One simulated board on the bus: the reset vector, interrupts and idle loop of the firmware in the same order as on the
//! microcontroller, with simulated timers. The monitor runs after power-up and starts the application.

mod factory;

use std::collections::VecDeque;

use boot::monitor::Next;
use boot::storage::Progress;
use boot::{Chip, Monitor};
use servo_core::units::Micros;
use servo_core::{Event, Telemetry};
use tater_fw::SetError;
use tater_fw::events::BoardEvent;
use tater_fw::{Analog, Board, Tater};
use tater_wire::{FaultCode, Frame};

use crate::board::SimBoard;
use crate::bus::Station;
use crate::rig::{Rig, Truth};
use factory::provisioned;
pub use factory::{STANDARD_WIRING, placeholder_application, shipped_storage, store};

const TICK_US: u64 = 1_000_000 / servo_core::num::TICK_HZ as u64;

/// The watchdog's period, µs: it is fed ten times a second, and a page takes 40 ms to erase.
const WATCHDOG_US: u64 = 500_000;

/// Ticks between two housekeeping tasks: 10 Hz.
const SLOW_TICKS: u64 = 100;

/// Time from reset to the program's first instruction, µs; chosen: crystal and clocks take at most 2 ms by the data sheet.
const BOOT_US: u64 = 5_000;

/// Limit on consecutive monitor steps without a flash operation: each takes microseconds.
const STEPS: usize = 8;

/// Time the monitor needs for one slice of an image's checksum, µs: 256 bytes at about 42 cycles each, at 72 MHz.
const CHECK_US: u64 = 150;

#[allow(clippy::large_enum_variant, reason = "one a node, and it hardly ever moves")]
#[derive(Debug)]
enum Program {
    Off(SimBoard),
    Monitor(Monitor<SimBoard>),
    Application(Tater<SimBoard>),
}

/// A board and its plant.
#[derive(Debug)]
pub struct Node {
    /// `None` only inside a switch from one program to the next.
    program: Option<Program>,
    now_us: u64,
    next_tick_us: u64,
    ticks: u64,
    /// End of a flash stall or of the boot.
    busy_until_us: u64,
    boots_until_us: u64,
    missed_edge: bool,
    resets: u32,
    /// Deviation of the board's clock, parts per million: positive runs fast.
    drift_ppm: i32,
    /// The time since which it deviates so, and the clock then, us.
    drifts_from: (u64, u64),
    /// Starts of the application since power was first applied.
    starts: u32,
    /// Events that the last application recorded and nobody has taken.
    left: VecDeque<BoardEvent>,
    /// The board's feed counter and when it last changed.
    fed: (u32, u64),
    watchdog_resets: u32,
    count: i32,
    last_count_us: u64,
    heard_us: u64,
}

/// The state of a board after a tick, as seen from outside.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Time of the tick.
    pub ms: u32,
    /// The servo's state.
    pub status: Telemetry,
    /// Whether the bridge is on.
    pub driven: bool,
    /// Whether the brake is commanded to release.
    pub brake_released: bool,
    /// The true state of the plant.
    pub truth: Truth,
    /// Hall code.
    pub halls: u8,
    /// The ADC readings of the tick.
    pub analog: Analog,
    /// Time of the last hall count, µs.
    pub last_count_us: u64,
    /// The plant's count that the servo calls 0, as `Meter` tracks it.
    pub zero_counts: f64,
}

impl Sample {
    /// The servo's position estimate.
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
    /// A new board at power-up, with an application in its flash: it waits in the monitor.
    #[must_use]
    pub fn new(board: SimBoard) -> Self {
        Self::with_flash_kept(provisioned(board, true))
    }

    /// A new board that has left the monitor already, and does not know how its motor is wired.
    #[must_use]
    pub fn unwired(board: SimBoard) -> Self {
        let mut node = Self::off(provisioned(board, false));
        node.start_application();
        node
    }

    /// A board at power-up with its flash unchanged.
    #[must_use]
    pub(crate) fn with_flash_kept(mut board: SimBoard) -> Self {
        board.forget();
        let mut node = Self::off(board);
        node.power_on();
        node
    }

    /// A new board that has left the monitor already (STAT 2).
    #[must_use]
    pub fn awake(board: SimBoard) -> Self {
        let mut node = Self::off(provisioned(board, true));
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
            drift_ppm: 0,
            drifts_from: (0, 0),
            starts: 0,
            left: VecDeque::new(),
            fed: (0, now_us),
            watchdog_resets: 0,
            count: 0,
            last_count_us: now_us,
            heard_us: now_us,
        }
    }

    /// The power fails: bridge off, brake engaged, RAM lost. The rotor coasts.
    pub fn power_off(&mut self) {
        let mut board = self.take_board();
        board.reset_pins(None);
        board.forget();
        self.program = Some(Program::Off(board));
    }

    /// Powers the board up, or resets it if it was on: the monitor starts.
    pub fn power_on(&mut self) {
        self.reset(None);
    }

    fn reset(&mut self, cause: Option<FaultCode>) {
        let mut board = self.take_board();
        board.reset_pins(cause);
        board.flash().power_up();
        self.resets = board.resets();
        self.program = Some(Program::Monitor(Monitor::new(board)));
        self.boot();
    }

    /// Writes the word of RAM that a reset keeps.
    pub fn keep_heat(&mut self, word: u32) {
        self.board_mut().retain(word);
    }

    /// The program hangs, with the bridge as it is, until the watchdog bites after `us`.
    pub fn hang(&mut self, us: u64) {
        let until_us = self.now_us + us;
        while self.now_us < until_us {
            self.board_mut().run(until_us);
            self.now_us = self.board().rig().now_us();
        }
        self.next_tick_us = self.tick_after_now_us();
        self.fed.1 = self.now_us;
        self.watchdog_resets += 1;
        self.reset(Some(FaultCode::Watchdog));
    }

    /// Makes the board's clock run fast (positive) or slow, parts per million; at most ±100,000.
    pub fn set_drift_ppm(&mut self, ppm: i32) {
        self.drifts_from = (self.now_us, self.local_us());
        self.drift_ppm = ppm.clamp(-100_000, 100_000);
        self.next_tick_us = self.tick_after_now_us();
    }

    /// The board's clock.
    const fn local_us(&self) -> u64 {
        let (from_us, local_us) = self.drifts_from;
        let us = self.now_us - from_us;
        // Three years keep this within 64 bits.
        local_us + us.wrapping_add_signed(us as i64 * self.drift_ppm as i64 / 1_000_000)
    }

    /// A time stamp of the board's 32-bit timer.
    #[must_use]
    pub const fn stamp(&self) -> Micros {
        Micros(self.local_us() as u32)
    }

    /// The first control tick after now.
    const fn tick_after_now_us(&self) -> u64 {
        if self.drift_ppm == 0 {
            return (self.now_us / TICK_US + 1) * TICK_US;
        }
        // A tick at a time from the last one: the phase of a drifting clock means nothing.
        let tick_us = TICK_US as i64 * 1_000_000 / (1_000_000 + self.drift_ppm as i64);
        self.now_us + tick_us as u64
    }

    fn start_application(&mut self) {
        let board = self.take_board();
        let tater = Tater::new(board, self.stamp());
        self.starts += 1;
        self.count = tater.count();
        self.program = Some(Program::Application(tater));
    }

    /// The CAN controller is off the bus during the boot.
    fn boot(&mut self) {
        self.boots_until_us = self.now_us + BOOT_US;
        self.busy_until_us = self.boots_until_us;
    }

    fn take_board(&mut self) -> SimBoard {
        match self.program.take().expect("a node has a program between two calls") {
            Program::Off(board) => board,
            Program::Monitor(monitor) => monitor.into_board(),
            Program::Application(mut tater) => {
                self.left.clear();
                self.left.extend(std::iter::from_fn(|| Some(tater.next_event()?.event)));
                tater.into_board()
            }
        }
    }

    /// Advances by one millisecond.
    pub fn step(&mut self) {
        self.advance(self.now_us + TICK_US);
    }

    /// Advances the board and its plant to `until_us`.
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
            // Act on events only, never at the end of a caller's slice: the slicing must not change the result.
            let ticks = self.now_us >= self.next_tick_us;
            if ticks {
                self.next_tick_us = self.tick_after_now_us();
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

    /// The hall interrupt. It follows a tick at the same time, because the timer's filter delays the edge.
    fn edge(&mut self) {
        self.missed_edge = false;
        let now = self.stamp();
        if let Some(Program::Application(tater)) = &mut self.program {
            tater.hall(now);
        }
        self.after();
    }

    fn tick(&mut self) {
        self.ticks += 1;
        let now = self.stamp();
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
        let now = self.stamp();
        match &mut self.program {
            Some(Program::Application(tater)) => {
                let progress = tater.store();
                let flash = tater.board().sim_flash();
                let may_fail = flash.is_dead() || flash.was_damaged();
                debug_assert!(!matches!(progress, Progress::Failed(_)) || may_fail);
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

    /// After each call into the program: accounts flash stalls, hall counts, resets and power failures.
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

    /// A frame arrives now, and passes the receive filters first.
    ///
    /// # Errors
    /// Why the application ignored it; the bus does not see this. The monitor never fails.
    pub fn receive(&mut self, frame: &Frame) -> Result<(), SetError> {
        if !self.board().accepts(frame) {
            return Ok(());
        }
        self.heard_us = self.now_us;
        let now = self.stamp();
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

    /// When the last frame passed the receive filters, simulated time in µs.
    #[must_use]
    pub const fn heard_us(&self) -> u64 {
        self.heard_us
    }

    /// Frames in the transmit mailboxes.
    #[must_use]
    pub fn mailboxes(&self) -> &[Frame] {
        self.board().mailboxes()
    }

    /// A frame of the mailboxes was sent.
    pub fn sent(&mut self, frame: &Frame) {
        self.board_mut().sent(frame);
        if let Some(Program::Application(tater)) = &mut self.program {
            tater.flush();
        }
        self.idle();
    }

    /// The hardware.
    #[must_use]
    pub fn board(&self) -> &SimBoard {
        match self.program.as_ref().expect("a node has a program between two calls") {
            Program::Off(board) => board,
            Program::Monitor(monitor) => monitor.board(),
            Program::Application(tater) => tater.board(),
        }
    }

    /// The hardware, mutable.
    pub fn board_mut(&mut self) -> &mut SimBoard {
        match self.program.as_mut().expect("a node has a program between two calls") {
            Program::Off(board) => board,
            Program::Monitor(monitor) => monitor.board_mut(),
            Program::Application(tater) => tater.board_mut(),
        }
    }

    /// The node's number as strapped.
    #[must_use]
    pub fn straps(&self) -> tater_wire::Node {
        self.board().straps()
    }

    /// How often the application has started.
    #[must_use]
    pub const fn starts(&self) -> u32 {
        self.starts
    }

    /// Whether the board has power.
    #[must_use]
    pub const fn is_on(&self) -> bool {
        !matches!(self.program, Some(Program::Off(_)))
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

    /// The application, if it is running.
    #[must_use]
    pub const fn application(&self) -> Option<&Tater<SimBoard>> {
        match &self.program {
            Some(Program::Application(tater)) => Some(tater),
            _ => None,
        }
    }

    /// Makes the direction of the motor seen, as after a motion since waking.
    pub fn trust_direction(&mut self) {
        if let Some(Program::Application(tater)) = &mut self.program {
            tater.trust_direction();
        }
    }

    /// The board's next event that has not been taken, also of an application that has just ended.
    pub fn board_event(&mut self) -> Option<BoardEvent> {
        if let Some(event) = self.left.pop_front() {
            return Some(event);
        }
        let Some(Program::Application(tater)) = &mut self.program else { return None };
        Some(tater.next_event()?.event)
    }

    /// The servo's next event, if the application runs. Drops what else the board has recorded since the last call.
    pub fn event(&mut self) -> Option<Event> {
        let Some(Program::Application(tater)) = &mut self.program else { return None };
        loop {
            if let BoardEvent::Motor(event) = tater.next_event()?.event {
                return Some(event);
            }
        }
    }

    /// The present state; `None` unless the application runs.
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

impl Station for Node {
    fn now_us(&self) -> u64 {
        self.now_us
    }

    fn advance(&mut self, until_us: u64) {
        Self::advance(self, until_us);
    }

    fn next_us(&self) -> u64 {
        let own_us = if self.is_busy() { self.busy_until_us } else { self.next_tick_us };
        own_us.min(self.board().rig().next_exchange_us())
    }

    fn busy_until_us(&self) -> u64 {
        self.busy_until_us
    }

    fn is_on_bus(&self) -> bool {
        self.now_us >= self.boots_until_us && !matches!(self.program, Some(Program::Off(_)))
    }

    fn accepts(&self, frame: &Frame) -> bool {
        self.board().accepts(frame)
    }

    fn receive(&mut self, frame: &Frame) {
        // A refusal is not visible on the bus.
        let _ = Self::receive(self, frame);
    }

    fn pending(&self) -> &[Frame] {
        self.mailboxes()
    }

    fn sent(&mut self, frame: &Frame) {
        Self::sent(self, frame);
    }
}
