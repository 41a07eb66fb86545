//! The time base, TIM2, and the control tick, TIM3 (RM0008 15).

use servo_core::units::Micros;
use stm32f1xx_hal::pac::{TIM2, TIM3};
use stm32f1xx_hal::rcc::{Enable, Rcc, Reset};

use crate::timing;

/// The time base: TIM2 counts microseconds in 16 bits, the rest is counted here.
pub struct Clock {
    tim: TIM2,
    now: Micros,
}

impl Clock {
    /// A clock at 0.
    pub fn new(tim: TIM2, rcc: &mut Rcc) -> Self {
        TIM2::enable(rcc);
        TIM2::reset(rcc);
        tim.psc().write(|w| w.psc().set(timing::tick::PRESCALER));
        tim.arr().write(|w| w.arr().set(u16::MAX));
        // The prescaler is taken over by an update.
        tim.egr().write(|w| w.ug().update());
        tim.cr1().write(|w| w.cen().enabled());
        Self { tim, now: Micros(0) }
    }

    /// The last time that was asked for.
    #[must_use]
    pub const fn last(&self) -> Micros {
        self.now
    }

    /// The time, in us since the start. Must be called at least every 65.5 ms.
    pub fn now(&mut self) -> Micros {
        let [low, high, ..] = self.now.0.to_le_bytes();
        let since = self.tim.cnt().read().cnt().bits().wrapping_sub(u16::from_le_bytes([low, high]));
        self.now = self.now.wrapping_add(Micros(since.into()));
        #[cfg(feature = "log")]
        LOGGED_AT.store(self.now.0, core::sync::atomic::Ordering::Relaxed);
        self.now
    }
}

#[cfg(feature = "log")]
static LOGGED_AT: core::sync::atomic::AtomicU32 = core::sync::atomic::AtomicU32::new(0);

/// The time of a log line, in µs: that of the last tick.
#[cfg(feature = "log")]
pub fn logged_at() -> u32 {
    LOGGED_AT.load(core::sync::atomic::Ordering::Relaxed)
}

/// The control tick's timer, TIM3.
pub struct Ticker(TIM3);

impl Ticker {
    /// A tick each millisecond.
    pub fn new(tim: TIM3, rcc: &mut Rcc) -> Self {
        TIM3::enable(rcc);
        tim.psc().write(|w| w.psc().set(timing::tick::PRESCALER));
        tim.arr().write(|w| w.arr().set(timing::tick::TOP));
        tim.egr().write(|w| w.ug().update());
        tim.sr().write(|w| w.uif().clear());
        tim.dier().write(|w| w.uie().enabled());
        tim.cr1().write(|w| w.cen().enabled());
        Self(tim)
    }

    /// Clears the interrupt.
    pub fn seen(&mut self) {
        self.0.sr().write(|w| w.uif().clear());
    }
}
