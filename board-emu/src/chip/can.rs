//! bxCAN: mailboxes, filters, two FIFOs, initialization and sleep, errors (RM0008 24).
//!
//! The bus reports sent and received frames; the controller offers frames to send. Not modeled: remote and
//! extended frames, time-triggered communication, silent and loop-back mode, and bit timings other than 1
//! Mbit/s.

mod errors;
mod fifo;
mod filters;
mod mailboxes;
#[cfg(test)]
mod tests;

use super::{Peripheral, RegisterResult};
use crate::time::{NEVER, Time, US};
use errors::Errors;
use fifo::Fifo;
use filters::Filters;
use hil_world::bus::bits;
use mailboxes::Mailboxes;
use tater_wire::Frame;

/// A bit on the bus: 1 Mbit/s.
const BIT: Time = US;
/// Recessive bits before a node may join (RM0008 24.4.2).
const IDLE: Time = 11 * BIT;
/// Recessive bits still missing at the end of a frame: its delimiter and end of frame are 8 of the 11.
const INTERMISSION: Time = 3 * BIT;

/// Bits of MCR (RM0008 24.9.2).
mod mcr {
    pub const INRQ: u32 = 1;
    pub const SLEEP: u32 = 1 << 1;
    pub const TXFP: u32 = 1 << 2;
    pub const RFLM: u32 = 1 << 3;
    pub const NART: u32 = 1 << 4;
    pub const AWUM: u32 = 1 << 5;
    pub const ABOM: u32 = 1 << 6;
    pub const TTCM: u32 = 1 << 7;
    pub const RESET: u32 = 1 << 15;
    pub const DBF: u32 = 1 << 16;
    /// Reset state: asleep, and frozen while a debugger halts the core.
    pub const AT_RESET: u32 = DBF | SLEEP;
}

mod msr {
    pub const INAK: u32 = 1;
    pub const SLAK: u32 = 1 << 1;
    pub const ERRI: u32 = 1 << 2;
    pub const WKUI: u32 = 1 << 3;
    pub const SLAKI: u32 = 1 << 4;
    /// Last sample and present level of the receive pin: always recessive in this model.
    pub const RECESSIVE: u32 = 3 << 10;
}

/// Bits of IER; those of the FIFOs are in `fifo`, those of errors in `errors`.
mod ier {
    pub const TMEIE: u32 = 1;
    pub const ERRIE: u32 = 1 << 15;
    pub const WKUIE: u32 = 1 << 16;
    pub const SLKIE: u32 = 1 << 17;
    pub const ALL: u32 = 0x0003_8F7F;
}

mod btr {
    pub const MODES: u32 = 3 << 30;
    pub const TIMING: u32 = 0x037F_03FF;
    pub const AT_RESET: u32 = 0x0123_0000;
}

/// Mode of operation (RM0008 24.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Sleep,
    Initialization,
    /// Waits for 11 recessive bits until this time; INAK or SLAK of the mode before still reads 1.
    Joining {
        at: Time,
        shows: u32,
    },
    Normal,
    /// Bus-off; recovers at this time, or never by itself.
    BusOff {
        until: Time,
    },
}

/// The CAN controller.
#[derive(Clone, Debug)]
pub struct Can {
    mode: Mode,
    mcr: u32,
    /// ERRI, WKUI, SLAKI.
    flags: u32,
    ier: u32,
    btr: u32,
    errors: Errors,
    mailboxes: Mailboxes,
    fifos: [Fifo; 2],
    filters: Filters,
    /// Ticks per cycle of APB1.
    cycle: Time,
    /// Cache for [`Self::pending`].
    offered: Vec<Frame>,
}

impl Default for Can {
    fn default() -> Self {
        Self {
            mode: Mode::Sleep,
            mcr: mcr::AT_RESET,
            flags: 0,
            ier: 0,
            btr: btr::AT_RESET,
            errors: Errors::default(),
            mailboxes: Mailboxes::default(),
            fifos: [Fifo::default(), Fifo::default()],
            filters: Filters::default(),
            cycle: 0,
            offered: Vec::new(),
        }
    }
}

impl Can {
    /// Reset state: asleep, off the bus.
    pub fn reset(&mut self) {
        *self = Self { cycle: self.cycle, ..Self::default() };
    }

    /// Sets the ticks per cycle of its clock, APB1. Joining the bus checks the bit timing against it.
    pub const fn set_cycle(&mut self, ticks: Time) {
        self.cycle = ticks;
    }

    /// Whether it takes part in the bus: it has left initialization and is not bus-off.
    #[must_use]
    pub fn is_on_bus(&self) -> bool {
        self.mode == Mode::Normal
    }

    /// Frames that it offers: those of the transmit mailboxes, in their order, or with TXFP only the oldest
    /// request. None while it is off the bus.
    #[must_use]
    pub fn pending(&self) -> &[Frame] {
        &self.offered
    }

    /// Reports that a frame was sent and acknowledged. Ignored if its mailbox no longer holds it.
    pub fn sent(&mut self, frame: &Frame, now: Time) {
        self.advance(now);
        if self.is_on_bus() && self.mailboxes.sent(frame) {
            self.errors.sent();
        }
        self.offer();
    }

    /// Receives a frame of another node, which ends at `now`, through the filters into a FIFO. Ignored if the
    /// controller joined after the frame began.
    pub fn receive(&mut self, frame: &Frame, now: Time) {
        if let Mode::Joining { at, shows } = self.mode
            && at > now.saturating_sub(bits(frame) * BIT)
        {
            // The 11 recessive bits can only follow a frame.
            self.mode = Mode::Joining { at: at.max(now + INTERMISSION), shows };
            return;
        }
        self.advance(now);
        match self.mode {
            Mode::Normal => {
                self.errors.received();
                if let Some((fifo, index)) = self.filters.pass(frame)
                    && let Some(fifo) = self.fifos.get_mut(fifo)
                {
                    fifo.push(frame, index, self.mcr & mcr::RFLM != 0);
                }
            }
            Mode::Sleep => {
                self.flags |= msr::WKUI;
                if self.mcr & mcr::AWUM != 0 {
                    self.mcr &= !mcr::SLEEP;
                    self.mode = Mode::Joining { at: now + INTERMISSION, shows: msr::SLAK };
                }
            }
            _ => {}
        }
    }

    /// Whether its error flag disturbs no other frame.
    #[must_use]
    pub const fn is_error_passive(&self) -> bool {
        self.errors.is_passive()
    }

    /// Reports a corrupted frame, its own or a received one.
    pub fn error(&mut self, sending: bool, now: Time) {
        self.advance(now);
        if !self.is_on_bus() {
            return;
        }
        let asked = if sending { self.errors.transmit() } else { self.errors.receive() };
        if sending {
            self.mailboxes.failed(self.mcr & mcr::TXFP != 0, self.mcr & mcr::NART != 0);
        }
        self.told(asked, now);
    }

    /// Reports that its frame was not acknowledged. It repeats the frame and never goes bus-off by that: the
    /// error counter stops at error passive (ISO 11898-1, exception for acknowledge errors).
    pub fn unacknowledged(&mut self, now: Time) {
        self.advance(now);
        if self.is_on_bus() {
            let asked = self.errors.unacknowledged();
            self.mailboxes.failed(self.mcr & mcr::TXFP != 0, self.mcr & mcr::NART != 0);
            self.told(asked, now);
        }
    }

    /// Effects of an error: an interrupt (`asked`: its enable bits) and possibly bus-off.
    fn told(&mut self, asked: u32, now: Time) {
        if self.ier & asked != 0 {
            self.flags |= msr::ERRI;
        }
        if self.errors.is_bus_off() {
            // 128 times 11 recessive bits on an idle bus (RM0008 24.7.6).
            let until = if self.mcr & mcr::ABOM != 0 { now + 128 * IDLE } else { NEVER };
            self.mode = Mode::BusOff { until };
        }
        self.offer();
    }

    /// Whether an empty mailbox requests an interrupt.
    #[must_use]
    pub fn interrupt_tx(&self) -> bool {
        self.ier & ier::TMEIE != 0 && self.mailboxes.is_any_complete()
    }

    /// Whether a FIFO requests an interrupt.
    #[must_use]
    pub fn interrupt_rx(&self, fifo: usize) -> bool {
        self.fifos.get(fifo).is_some_and(|queue| queue.interrupts(self.ier >> (1 + 3 * fifo)))
    }

    /// Whether a status change or an error requests an interrupt.
    #[must_use]
    pub fn interrupt_status(&self) -> bool {
        let pairs = [(ier::ERRIE, msr::ERRI), (ier::WKUIE, msr::WKUI), (ier::SLKIE, msr::SLAKI)];
        pairs.into_iter().any(|(enable, flag)| self.ier & enable != 0 && self.flags & flag != 0)
    }

    fn offer(&mut self) {
        self.offered.clear();
        if self.is_on_bus() {
            self.mailboxes.offer(self.mcr & mcr::TXFP != 0, &mut self.offered);
        }
    }

    fn read_msr(&self) -> u32 {
        let mode = match self.mode {
            Mode::Sleep => msr::SLAK,
            Mode::Initialization => msr::INAK,
            Mode::Joining { shows, .. } => shows,
            Mode::Normal | Mode::BusOff { .. } => 0,
        };
        self.flags | mode | msr::RECESSIVE
    }

    fn write_mcr(&mut self, value: u32, now: Time) -> RegisterResult<()> {
        if value & mcr::TTCM != 0 {
            return Err("CAN_MCR.TTCM: no time-triggered communication".to_owned());
        }
        if value & mcr::RESET != 0 {
            // A master reset keeps bit timing and filters (RM0008 24.9.2).
            self.mcr = mcr::AT_RESET;
            self.mode = Mode::Sleep;
            self.fifos = [Fifo::default(), Fifo::default()];
            return Ok(());
        }
        let bits =
            mcr::INRQ | mcr::SLEEP | mcr::TXFP | mcr::RFLM | mcr::NART | mcr::AWUM | mcr::ABOM | mcr::DBF;
        self.mcr = value & bits;
        self.request(now)
    }

    /// Follows INRQ and SLEEP (RM0008 24.4, figure 224). Sleep and initialization are entered at once.
    fn request(&mut self, now: Time) -> RegisterResult<()> {
        let (sleep, initialise) = (self.mcr & mcr::SLEEP != 0, self.mcr & mcr::INRQ != 0);
        self.mode = match (self.mode, sleep, initialise) {
            (Mode::Sleep, true, _) => Mode::Sleep,
            (_, _, true) => Mode::Initialization,
            (_, true, false) => {
                // Only if that interrupt is enabled (RM0008 24.9.2).
                self.flags |= msr::SLAKI * u32::from(self.ier & ier::SLKIE != 0);
                Mode::Sleep
            }
            (Mode::Initialization, false, false) => self.join(msr::INAK, now)?,
            (Mode::Sleep, false, false) => self.join(msr::SLAK, now)?,
            (mode, false, false) => mode,
        };
        Ok(())
    }

    /// Joins the bus after initialization or sleep, whose bit reads 1 until then.
    fn join(&self, shows: u32, now: Time) -> RegisterResult<Mode> {
        if self.btr & btr::MODES != 0 {
            return Err("CAN_BTR.SILM or LBKM: it is on the bus, or not".to_owned());
        }
        let field = |low: u32, mask: u32| Time::from((self.btr >> low & mask) + 1);
        let bit = self.cycle * field(0, 0x3FF) * (1 + field(16, 0xF) + field(20, 7));
        if bit != BIT {
            let btr = self.btr;
            return Err(format!("CAN_BTR = {btr:#010x}: a bit of {bit}/144 us, and that of the bus is 1 us"));
        }
        // Bus-off ends by initialization and 128 times 11 recessive bits (RM0008 24.7.6).
        let wait = if self.errors.is_bus_off() { 128 * IDLE } else { IDLE };
        Ok(Mode::Joining { at: now + wait, shows })
    }
}

impl Peripheral for Can {
    fn read(&mut self, offset: u32, now: Time) -> RegisterResult<u32> {
        self.advance(now);
        match offset {
            0x00 => Ok(self.mcr),
            0x04 => Ok(self.read_msr()),
            0x08 => Ok(self.mailboxes.status(self.mcr & mcr::TXFP != 0)),
            0x0C => Ok(self.fifos[0].status()),
            0x10 => Ok(self.fifos[1].status()),
            0x14 => Ok(self.ier),
            0x18 => Ok(self.errors.status()),
            0x1C => Ok(self.btr),
            0x180..0x1B0 => Ok(self.mailboxes.read(offset - 0x180)),
            0x1B0..0x1C0 => Ok(self.fifos[0].read(offset - 0x1B0)),
            0x1C0..0x1D0 => Ok(self.fifos[1].read(offset - 0x1C0)),
            0x200..0x2B0 => self.filters.read(offset - 0x200),
            _ => Err(format!("CAN has no register at offset {offset:#x}")),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()> {
        self.advance(now);
        match offset {
            0x00 => self.write_mcr(value, now)?,
            0x04 => self.flags &= !value,
            0x08 => self.mailboxes.write_status(value),
            0x0C => self.fifos[0].write_status(value),
            0x10 => self.fifos[1].write_status(value),
            0x14 if value & !ier::ALL != 0 => return Err(format!("CAN_IER = {value:#x}: reserved bits")),
            0x14 => self.ier = value,
            0x18 => self.errors.write_status(value),
            // Write-protected otherwise (RM0008 24.9.2).
            0x1C if self.mode == Mode::Initialization => self.btr = value & (btr::MODES | btr::TIMING),
            0x1C => {}
            0x180..0x1B0 => self.mailboxes.write(offset - 0x180, value)?,
            0x1B0..0x1D0 => return Err("a receive FIFO cannot be written".to_owned()),
            0x200..0x2B0 => self.filters.write(offset - 0x200, value)?,
            _ => return Err(format!("CAN has no register at offset {offset:#x}")),
        }
        self.offer();
        Ok(())
    }

    fn next_event(&self) -> Time {
        match self.mode {
            Mode::Joining { at, .. } => at,
            Mode::BusOff { until } => until,
            _ => NEVER,
        }
    }

    fn advance(&mut self, now: Time) {
        match self.mode {
            Mode::Joining { at, .. } if at <= now => {}
            Mode::BusOff { until } if until <= now => {}
            _ => return,
        }
        if self.errors.is_bus_off() {
            self.errors = Errors::default();
        }
        self.mode = Mode::Normal;
        self.offer();
    }
}
