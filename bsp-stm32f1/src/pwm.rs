//! The bridge: TIM1, three complementary pairs at 20 kHz, center-aligned, with dead time and a break input (RM0008 14).
//!
//! The break input switches all six gates off without code, and they stay off until the program has asked for the bridge
//! to be off.

use servo_core::sense::commutation::{Bridge, Leg};
use servo_core::units::Duty;
use stm32f1xx_hal::pac::TIM1;
use stm32f1xx_hal::rcc::{Enable, Rcc};

use crate::address::pointer;
use crate::timing::pwm::{CONVERT, DEAD_TIME, TOP};

/// The bridge behind its break input.
pub struct Guarded {
    tim: TIM1,
    /// The [`image`] that compare values and CCER are for; [`NONE`] when the bridge is off.
    legs: u32,
    /// Address of the compare value of the leg that is [`PWM`] in it.
    share: u32,
}

impl Guarded {
    /// All gates off.
    pub fn new(tim: TIM1, rcc: &mut Rcc) -> Self {
        TIM1::enable(rcc);
        tim.cr1().write(|w| w.cms().center_aligned1());
        // TRGO is the rising edge of channel 4's compare, which starts the ADC. Idle levels: 0, gates off.
        tim.cr2().write(|w| w.mms().compare_oc4());
        tim.arr().write(|w| w.arr().set(TOP));
        // On while the counter is below the compare value. No preload: a new vector is there at once.
        tim.ccmr1_output().write(|w| w.oc1m().pwm_mode1().oc2m().pwm_mode1());
        tim.ccmr2_output().write(|w| w.oc3m().pwm_mode1().oc4m().pwm_mode1());
        tim.ccr4().write(|w| w.ccr().set(CONVERT));
        // Driven from here on, not only pulled down.
        tim.ccer().write(|w| {
            w.cc1e().set_bit().cc2e().set_bit().cc3e().set_bit();
            w.cc1ne().set_bit().cc2ne().set_bit().cc3ne().set_bit()
        });
        // Outputs that are off are driven low, with MOE and without. Break is active low and needs a restart by software.
        // LOCK 2 freezes dead time, break, idle levels and polarities until the next reset.
        tim.bdtr().write(|w| {
            w.dtg().set(DEAD_TIME);
            w.ossi().idle_level().ossr().idle_level();
            w.bke().enabled().bkp().active_low().aoe().manual().lock().level2()
        });
        tim.sr().write(|w| w.bif().clear_bit());
        tim.cr1().modify(|_, w| w.cen().enabled());
        Self { tim, legs: NONE, share: CCR1 }
    }

    /// Sets the three legs.
    #[inline(always)]
    pub fn set(&mut self, bridge: Bridge) {
        match bridge {
            Bridge::On { legs, duty } => self.on(image(legs), compare(duty)),
            Bridge::Off => self.off(),
        }
    }

    /// Legs that stay take the duty alone. A bridge that is off has none, so it is not switched on here.
    #[inline(always)]
    fn on(&mut self, legs: u32, share: u16) {
        if self.legs == legs {
            self.set_duty(share);
        } else {
            self.set_legs(legs, share);
        }
    }

    #[inline(always)]
    fn set_duty(&mut self, share: u16) {
        // SAFETY: the address of CCR1, CCR2 or CCR3, which are this timer's, and it is ours.
        unsafe { pointer::<u32>(self.share).write_volatile(share.into()) };
    }

    /// Sets the legs in an order without a wrong vector in between: high sides off, then the enabled outputs, then the duty
    /// (decision 0020). The timer adds the dead time. Off, unless exactly one leg is [`PWM`].
    // Leg by leg, because an edge waits: arrays cost three times as many instructions here.
    #[inline(never)]
    fn set_legs(&mut self, legs: u32, share: u16) {
        let tim = &self.tim;
        let is = |kind: u32, leg: u32| legs & 0xFF << leg == kind << leg;
        let (a, b, c) = (is(PWM, A), is(PWM, B), is(PWM, C));
        if !a {
            tim.ccr1().write(|w| w.ccr().set(0));
        }
        if !b {
            tim.ccr2().write(|w| w.ccr().set(0));
        }
        if !c {
            tim.ccr3().write(|w| w.ccr().set(0));
        }
        // A leg that floats has its high side off by compare value 0 and its low side by the output's off-state.
        tim.ccer().write(|w| {
            w.cc1e().set_bit().cc2e().set_bit().cc3e().set_bit();
            w.cc1ne().bit(!is(FLOAT, A)).cc2ne().bit(!is(FLOAT, B)).cc3ne().bit(!is(FLOAT, C))
        });
        self.share = match (a, b, c) {
            (true, false, false) => CCR1,
            (false, true, false) => CCR1 + 4,
            (false, false, true) => CCR1 + 8,
            _ => return self.off(),
        };
        self.legs = legs;
        self.set_duty(share);
        if self.tim.bdtr().read().moe().is_disabled_idle() {
            self.enable();
        }
    }

    /// Switches on what is set, but not after a break: only `off` leads back here with the flag cleared.
    #[cold]
    #[inline(never)]
    fn enable(&mut self) {
        if self.broken() {
            return;
        }
        self.tim.bdtr().modify(|_, w| w.moe().enabled());
        self.tim.dier().write(|w| w.bie().enabled());
        // A pulse that came and went between the two lines above.
        if self.broken() {
            self.tim.bdtr().modify(|_, w| w.moe().disabled_idle());
        }
    }

    /// Switches all gates off and clears a break, so that the bridge may be switched on again. An input that is still low sets the
    /// flag again at once, but interrupts only while the bridge is on.
    fn off(&mut self) {
        self.tim.bdtr().modify(|_, w| w.moe().disabled_idle());
        self.tim.dier().write(|w| w.bie().disabled());
        self.tim.sr().write(|w| w.bif().clear_bit());
        self.legs = NONE;
    }

    /// Whether the break input switched the bridge off since the last [`Self::off`].
    #[must_use]
    pub fn broken(&self) -> bool {
        self.tim.sr().read().bif().bit_is_set()
    }

    /// Disables the break interrupt; the flag stays, because it keeps the bridge off.
    pub fn seen(&mut self) {
        self.tim.dier().write(|w| w.bie().disabled());
    }
}

/// TIM1's CCR1; CCR2 and CCR3 follow it (RM0008 14.4.21).
const CCR1: u32 = 0x4001_2C34;

/// The position of a leg's byte in an image.
const A: u32 = 0;
const B: u32 = 8;
const C: u32 = 16;
/// The values of a leg's byte, one for each [`Leg`].
const PWM: u32 = 0;
const LOW: u32 = 1;
const FLOAT: u32 = 2;
const NONE: u32 = u32::MAX;

#[inline(always)]
fn image([a, b, c]: [Leg; 3]) -> u32 {
    let byte = |leg| match leg {
        Leg::Pwm => PWM,
        Leg::Low => LOW,
        Leg::Float => FLOAT,
    };
    byte(a) << A | byte(b) << B | byte(c) << C
}

/// Compare value of a duty, which is not negative: the nearest. Full duty is above the counter's top, where the output never
/// falls (RM0008 14.3.10); at the top itself it would for a clock, and the dead time after that.
fn compare(duty: Duty) -> u16 {
    let share = (u32::from(duty.0.to_bits().unsigned_abs()) * u32::from(TOP) + (1 << 14)) >> 15;
    let share = if share == u32::from(TOP) { share + 1 } else { share };
    u16::try_from(share).unwrap_or(0)
}
