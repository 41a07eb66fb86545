//! Pending, enabled and active exceptions, and the one to take (ARMv7-M B1.5.4, B3.4; PM0056 4.3).
//!
//! Sets of exceptions have one bit each: 2 is NMI, 3 HardFault, 16 the first interrupt.

/// Exception numbers (ARMv7-M B1.5.2).
pub mod number {
    /// Non-maskable interrupt: the clock security system.
    pub const NMI: u32 = 2;
    /// Faults that no other exception takes.
    pub const HARD_FAULT: u32 = 3;
    /// Access to execute-never memory.
    pub const MEM_MANAGE: u32 = 4;
    /// Bus errors.
    pub const BUS_FAULT: u32 = 5;
    /// Errors of instructions.
    pub const USAGE_FAULT: u32 = 6;
    /// The instruction SVC.
    pub const SV_CALL: u32 = 11;
    /// Set pending by software.
    pub const PEND_SV: u32 = 14;
    /// The system timer.
    pub const SYS_TICK: u32 = 15;
    /// The first interrupt.
    pub const IRQ: u32 = 16;
}

use number::{BUS_FAULT, HARD_FAULT, IRQ, MEM_MANAGE, NMI, PEND_SV, SV_CALL, SYS_TICK, USAGE_FAULT};

/// Interrupts of a medium-density STM32F103 (RM0008 table 63).
pub const LINES: u32 = 43;

/// Number of exceptions, with the unused 0.
pub const EXCEPTIONS: usize = (IRQ + LINES) as usize;

/// Priority of thread mode, below every exception.
pub const LOWEST: i16 = 256;

/// Implemented bits of a priority (PM0056 4.3.7).
pub const PRIORITY_BITS: u8 = 0xF0;

const ALWAYS: u128 = 1 << NMI | 1 << HARD_FAULT | 1 << SV_CALL | 1 << 12 | 1 << PEND_SV | 1 << SYS_TICK;

/// All interrupts.
pub const ALL_LINES: u128 = ((1 << LINES) - 1) << IRQ;

/// Exception masks (ARMv7-M B1.4.3).
#[derive(Clone, Copy, Debug, Default)]
pub struct Masks {
    /// Raises priority to 0.
    pub primask: bool,
    /// Raises priority to -1.
    pub faultmask: bool,
    /// Raises priority to this, unless 0.
    pub basepri: u8,
}

/// The interrupt controller.
#[derive(Clone, Debug)]
pub struct Nvic {
    /// Pending.
    pub pending: u128,
    /// Active.
    pub active: u128,
    /// Enabled.
    pub enabled: u128,
    levels: u128,
    priority: [u8; EXCEPTIONS],
    /// AIRCR.PRIGROUP: priority bits up to this one are sub-priority.
    pub group: u8,
    /// Changed since [`Self::due`] last returned `None`.
    pub changed: bool,
}

impl Default for Nvic {
    fn default() -> Self {
        let priority = [0; EXCEPTIONS];
        Self { pending: 0, active: 0, enabled: ALWAYS, levels: 0, priority, group: 0, changed: true }
    }
}

/// The bit of an exception.
pub const fn bit(exception: u32) -> u128 {
    1 << exception
}

impl Nvic {
    /// Sets the lines: a rising edge pends, and so does a high line whose handler is not active.
    pub fn set_lines(&mut self, interrupts: u64, nmi: bool) {
        let levels = u128::from(interrupts) << IRQ & ALL_LINES | u128::from(nmi) << NMI;
        let rising = levels & !self.levels;
        self.levels = levels;
        self.pend(rising | levels & !self.active);
    }

    /// Pends exceptions.
    pub const fn pend(&mut self, exceptions: u128) {
        if exceptions & !self.pending != 0 {
            self.pending |= exceptions;
            self.changed = true;
        }
    }

    /// Clears pending exceptions; a high line pends again at once.
    pub const fn unpend(&mut self, exceptions: u128) {
        self.pending &= !exceptions | self.levels & !self.active;
    }

    /// Ends a handler. Its line pends again if it is still high.
    pub const fn deactivate(&mut self, exception: u32) {
        self.active &= !bit(exception);
        self.pending |= self.levels & bit(exception);
        self.changed = true;
    }

    /// Starts a handler.
    pub const fn activate(&mut self, exception: u32) {
        self.active |= bit(exception);
        self.pending &= !bit(exception);
        self.changed = true;
    }

    /// Enables a configurable fault (SHCSR).
    pub fn enable_fault(&mut self, exception: u32, on: bool) {
        debug_assert!([MEM_MANAGE, BUS_FAULT, USAGE_FAULT].contains(&exception));
        self.enabled = self.enabled & !bit(exception) | u128::from(on) << exception;
        self.changed = true;
    }

    /// Register of a priority.
    #[must_use]
    pub fn priority_byte(&self, exception: u32) -> u8 {
        self.priority.get(exception as usize).copied().unwrap_or(0)
    }

    /// Sets a priority.
    pub fn set_priority(&mut self, exception: u32, value: u8) {
        let settable = matches!(exception, MEM_MANAGE..=USAGE_FAULT | SV_CALL | 12 | PEND_SV..);
        if let Some(priority) = self.priority.get_mut(exception as usize).filter(|_| settable) {
            *priority = value & PRIORITY_BITS;
            self.changed = true;
        }
    }

    /// Priority; lower is more urgent.
    #[must_use]
    pub fn priority(&self, exception: u32) -> i16 {
        match exception {
            1..=HARD_FAULT => exception as i16 - 4,
            _ => i16::from(self.priority_byte(exception)),
        }
    }

    /// Group priority, without sub-priority.
    #[must_use]
    pub const fn group(&self, priority: i16) -> i16 {
        if priority < 0 { priority } else { priority & !((2 << self.group) - 1) }
    }

    /// `ExecutionPriority()` of ARMv7-M B1.5.4.
    #[must_use]
    pub fn execution_priority(&self, masks: Masks) -> i16 {
        let mut lowest = LOWEST;
        let mut active = self.active;
        while active != 0 {
            lowest = lowest.min(self.group(self.priority(active.trailing_zeros())));
            active &= active - 1;
        }
        if masks.basepri != 0 {
            lowest = lowest.min(self.group(i16::from(masks.basepri)));
        }
        if masks.primask {
            lowest = lowest.min(0);
        }
        if masks.faultmask {
            lowest = lowest.min(-1);
        }
        lowest
    }

    /// The most urgent pending and enabled exception: by priority with sub-priority, then by number.
    #[must_use]
    pub fn most_urgent(&self) -> Option<u32> {
        let mut waiting = self.pending & self.enabled;
        let mut best = None;
        while waiting != 0 {
            let exception = waiting.trailing_zeros();
            let key = (self.priority(exception), exception);
            best = Some(best.map_or(key, |best: (i16, u32)| best.min(key)));
            waiting &= waiting - 1;
        }
        best.map(|(_, exception)| exception)
    }

    /// The exception to take now, if any.
    #[must_use]
    pub fn due(&self, masks: Masks) -> Option<u32> {
        let exception = self.most_urgent()?;
        (self.group(self.priority(exception)) < self.execution_priority(masks)).then_some(exception)
    }
}
