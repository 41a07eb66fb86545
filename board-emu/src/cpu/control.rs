//! Control registers of the core without side effects (PM0056 4.4).

/// SCR (PM0056 4.4.6).
pub const SLEEP_ON_EXIT: u32 = 1 << 1;
pub const SEV_ON_PEND: u32 = 1 << 4;
/// CCR (PM0056 4.4.7).
const NON_BASE_THREAD: u32 = 1;
const UNALIGN_TRP: u32 = 1 << 3;
const DIV_0_TRP: u32 = 1 << 4;
const STKALIGN: u32 = 1 << 9;
pub const CCR_BITS: u32 = 0x31B;

#[derive(Clone, Copy, Debug, Default)]
pub struct Control {
    /// SCR.
    pub sleep: u32,
    /// CCR. Revision r1p1 does not align stacks by itself.
    pub config: u32,
    /// DEMCR.
    pub debug: u32,
    /// DBGMCU_CR. On the chip a system reset keeps it; nothing depends on it here.
    pub device_debug: u32,
    /// DWT_CTRL.CYCCNTENA.
    pub counting: bool,
    /// Time at which DWT_CYCCNT was 0, or its value while it is stopped.
    pub cycles_from: u64,
}

impl Control {
    /// CCR.DIV_0_TRP: a division by 0 is a fault.
    pub const fn traps_division(&self) -> bool {
        self.config & DIV_0_TRP != 0
    }

    /// CCR.UNALIGN_TRP: an unaligned access is a fault.
    pub const fn traps_unaligned(&self) -> bool {
        self.config & UNALIGN_TRP != 0
    }

    /// CCR.STKALIGN: an exception's entry aligns the stack to 8 bytes.
    pub const fn aligns_stack(&self) -> bool {
        self.config & STKALIGN != 0
    }

    /// CCR.NONBASETHRDENA: a nested handler may return to thread mode.
    pub const fn leaves_nested(&self) -> bool {
        self.config & NON_BASE_THREAD != 0
    }

    pub const fn sleeps_on_exit(&self) -> bool {
        self.sleep & SLEEP_ON_EXIT != 0
    }

    /// SCR.SEVONPEND: an interrupt that becomes pending is an event.
    pub const fn pending_is_event(&self) -> bool {
        self.sleep & SEV_ON_PEND != 0
    }
}
