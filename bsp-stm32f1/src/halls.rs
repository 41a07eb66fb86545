//! The hall lines: TIM4 as a hall-sensor interface (RM0008 15.3.15). Any edge of the three lines, filtered, captures the
//! counter, restarts it, and interrupts, so the counter is the time since the last edge.

use stm32f1xx_hal::pac::{GPIOB, TIM4};
use stm32f1xx_hal::rcc::{Enable, Rcc};

use crate::timing::hall::{CLOCK_DIVISION, FILTER, PRESCALER, SAMPLE_GAP};

/// A turn of `delay`, a subtraction and a branch that is taken, is three ticks of a Cortex-M3 or more.
const DELAY_TICKS: u32 = 3;

/// The hall lines.
pub struct Halls {
    tim: TIM4,
    first: u8,
}

impl Halls {
    /// The lines, with their interrupt enabled.
    pub fn new(tim: TIM4, rcc: &mut Rcc) -> Self {
        TIM4::enable(rcc);
        tim.psc().write(|w| w.psc().set(PRESCALER));
        tim.arr().write(|w| w.arr().set(u16::MAX));
        // The filter's clock; only an overflow, and no restart, is an update.
        // SAFETY: two bits, a code of CKD, checked where it is computed.
        tim.cr1().write(|w| unsafe { w.ckd().bits(CLOCK_DIVISION) }.urs().counter_only());
        // Channel 1 sees the exclusive or of the lines.
        tim.cr2().write(|w| w.ti1s().xor());
        // Both its edges, filtered, are the trigger, which restarts the counter.
        tim.smcr().write(|w| w.ts().ti1f_ed().sms().reset_mode());
        // The trigger captures.
        tim.ccmr1_input().write(|w| w.cc1s().trc().ic1f().set(FILTER));
        tim.ccer().write(|w| w.cc1e().set_bit());
        // The prescaler is taken over by an update.
        tim.egr().write(|w| w.ug().update());
        tim.sr().write(|w| w.uif().clear_bit());
        tim.dier().write(|w| w.cc1ie().enabled());
        tim.cr1().modify(|_, w| w.cen().enabled());
        Self { tim, first: Self::port() }
    }

    /// Takes the first sample, at least [`SAMPLE_GAP`] before [`Self::code`].
    pub fn sample(&mut self) {
        self.first = Self::port();
    }

    /// The first sample.
    #[must_use]
    pub const fn first(&self) -> u8 {
        self.first
    }

    /// The lines now: PB6 is bit 0. The port is not behind the timer's filter, so two samples must agree, or a third decides
    /// for each line: a spike shorter than the time between them changes nothing.
    #[must_use]
    pub fn code(&self) -> u8 {
        let (a, b) = (self.first, Self::port());
        if a == b { a } else { a & b | (a | b) & Self::port_later() }
    }

    #[cold]
    fn port_later() -> u8 {
        cortex_m::asm::delay(SAMPLE_GAP / DELAY_TICKS);
        Self::port()
    }

    fn port() -> u8 {
        // SAFETY: reads the port's input register, which nobody writes.
        let port = unsafe { &*GPIOB::ptr() }.idr().read().bits();
        (port >> 6 & 7).to_le_bytes()[0]
    }

    /// Time since the edge that interrupted, in µs; clears the interrupt. The counter has not wrapped: nothing delays the interrupt
    /// by 65 ms, not even a page erase.
    pub fn age(&mut self) -> u16 {
        // First the flags: an edge from here on interrupts again.
        self.tim.sr().write(|w| w.cc1if().clear().cc1of().clear());
        self.tim.cnt().read().cnt().bits()
    }
}
