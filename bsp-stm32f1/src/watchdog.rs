//! The independent watchdog (RM0008 19): once started it cannot be stopped, by the other program neither. And the window watchdog
//! (RM0008 20), which the application's control tick feeds; a reset stops it.

use stm32f1xx_hal::pac::{DBGMCU, IWDG, WWDG};
use stm32f1xx_hal::rcc::{Enable, Rcc};

use crate::timing::tick_watchdog;
use crate::timing::watchdog::{PRESCALER_CODE, RELOAD};

/// Lets PR and RLR be written.
const UNLOCK: u16 = 0x5555;
const START: u16 = 0xCCCC;
const FEED: u16 = 0xAAAA;

/// The independent watchdog.
pub struct Watchdog {
    iwdg: IWDG,
    debug: DBGMCU,
}

impl Watchdog {
    /// Starts the watchdog, or takes over a running one.
    pub fn new(iwdg: IWDG, debug: DBGMCU) -> Self {
        let key = |key| {
            // SAFETY: the three keys are all that KR takes; none touches memory.
            iwdg.kr().write(|w| unsafe { w.key().bits(key) });
        };
        key(START);
        key(UNLOCK);
        // SAFETY: three bits and twelve bits, checked where they are computed.
        iwdg.pr().write(|w| unsafe { w.bits(PRESCALER_CODE.into()) });
        // SAFETY: as above.
        iwdg.rlr().write(|w| unsafe { w.bits(RELOAD) });
        // Both are taken over some clocks later; a reload before that would load the old one.
        while iwdg.sr().read().bits() != 0 {}
        key(FEED);
        Self { iwdg, debug }
    }

    /// Starts its time anew. Halted by a debug probe, the bridge is off as after a break, and the watchdogs wait (RM0008
    /// 31.16.4): set at each feed, because the chip takes it only while a probe is attached (errata).
    pub fn feed(&mut self) {
        self.debug
            .cr()
            .modify(|_, w| w.dbg_tim1_stop().set_bit().dbg_iwdg_stop().set_bit().dbg_wwdg_stop().set_bit());
        // SAFETY: see above.
        self.iwdg.kr().write(|w| unsafe { w.key().bits(FEED) });
    }
}

/// WDGA: the window watchdog runs.
const RUN: u16 = 1 << 7;

/// The watchdog of the control tick; the first feed starts it.
pub struct TickWatchdog(WWDG);

impl TickWatchdog {
    /// The watchdog, not yet started.
    pub fn new(wwdg: WWDG, rcc: &mut Rcc) -> Self {
        WWDG::enable(rcc);
        // SAFETY: WDGTB, two bits from bit 7 on, and W at its largest: no feed is too early. No early interrupt.
        wwdg.cfr().write(|w| unsafe {
            w.bits(u16::from(tick_watchdog::PRESCALER_CODE) << 7 | u16::from(tick_watchdog::TOP))
        });
        Self(wwdg)
    }

    /// Starts its time anew.
    #[inline(always)]
    pub fn feed(&mut self) {
        // SAFETY: T at its largest, which is above 0x3F.
        self.0.cr().write(|w| unsafe { w.bits(RUN | u16::from(tick_watchdog::TOP)) });
    }
}
