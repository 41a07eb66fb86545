//! The independent watchdog (RM0008 19): once started it cannot be stopped, by the other program neither. And the window watchdog
//! (RM0008 20), which the application's control tick feeds; a reset stops it.

use stm32f1xx_hal::pac::{IWDG, WWDG};
use stm32f1xx_hal::rcc::{Enable, Rcc};

use super::timing::tick_watchdog;
use super::timing::watchdog::{PRESCALER_CODE, RELOAD};

/// Lets PR and RLR be written.
const UNLOCK: u16 = 0x5555;
const START: u16 = 0xCCCC;
const FEED: u16 = 0xAAAA;

pub struct Watchdog(IWDG);

impl Watchdog {
    /// Starts the watchdog, or takes over a running one.
    pub fn new(iwdg: IWDG) -> Self {
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
        Self(iwdg)
    }

    pub fn feed(&mut self) {
        // SAFETY: see above.
        self.0.kr().write(|w| unsafe { w.key().bits(FEED) });
    }
}

/// WDGA: the window watchdog runs.
const RUN: u16 = 1 << 7;

/// The watchdog of the control tick; the first feed starts it.
pub struct TickWatchdog(WWDG);

impl TickWatchdog {
    pub fn new(wwdg: WWDG, rcc: &mut Rcc) -> Self {
        WWDG::enable(rcc);
        // SAFETY: WDGTB, two bits from bit 7 on, and W at its largest: no feed is too early. No early interrupt.
        wwdg.cfr().write(|w| unsafe {
            w.bits(u16::from(tick_watchdog::PRESCALER_CODE) << 7 | u16::from(tick_watchdog::TOP))
        });
        Self(wwdg)
    }

    #[inline(always)]
    pub fn feed(&mut self) {
        // SAFETY: T at its largest, which is above 0x3F.
        self.0.cr().write(|w| unsafe { w.bits(RUN | u16::from(tick_watchdog::TOP)) });
    }
}
