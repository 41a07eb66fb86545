//! The independent watchdog (RM0008 19): once started it cannot be stopped, by the other program neither.

use stm32f1xx_hal::pac::IWDG;

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
