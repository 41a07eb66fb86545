//! The ADC: four conversions around the middle of each PWM period's on-time, and the board's temperature in between
//! (RM0008 11.3.9, 11.7).

use stm32f1xx_hal::pac::ADC1;
use stm32f1xx_hal::rcc::{Enable, Rcc};

use super::scale;
use super::timing::adc::{SAMPLE_CODE, WAKE_UP};
use crate::board::Analog;

pub struct Adc(ADC1);

impl Adc {
    /// A converter that waits for TIM1's trigger.
    pub fn new(adc: ADC1, rcc: &mut Rcc) -> Self {
        ADC1::enable(rcc);
        adc.cr2().write(|w| w.adon().enabled());
        cortex_m::asm::delay(WAKE_UP);
        adc.cr2().modify(|_, w| w.rstcal().initialize());
        while adc.cr2().read().rstcal().bit_is_set() {}
        adc.cr2().modify(|_, w| w.cal().start());
        while adc.cr2().read().cal().bit_is_set() {}
        adc.smpr2().write(|w| {
            let code = SAMPLE_CODE;
            w.smp5().set(code).smp1().set(code).smp2().set(code).smp3().set(code).smp4().set(code)
        });
        // Injected: inputs 5, 1, 2 and 3, in that order; not 0, which glitches with injected conversions (errata). Regular: input 4, over and over.
        // SAFETY: five bits each, channels that exist.
        adc.jsqr()
            .write(|w| unsafe { w.jl().bits(3).jsq1().bits(5).jsq2().bits(1).jsq3().bits(2).jsq4().bits(3) });
        // SAFETY: the same.
        adc.sqr3().write(|w| unsafe { w.sq1().bits(4) });
        adc.cr1().write(|w| w.scan().enabled());
        adc.cr2().write(|w| {
            w.adon().enabled().cont().continuous();
            w.jextsel().tim1trgo().jexttrig().enabled().extsel().swstart().exttrig().enabled()
        });
        adc.cr2().modify(|_, w| w.swstart().start());
        Self(adc)
    }

    /// The latest conversions. Inlined, because the tick needs only half of them.
    #[inline(always)]
    pub fn read(&self, bridge_fault: bool) -> Analog {
        let adc = &self.0;
        let (strain, motor) = (adc.jdr3().read().jdata().bits(), adc.jdr4().read().jdata().bits());
        Analog {
            bus: scale::bus(adc.jdr2().read().jdata().bits()),
            current: scale::current(adc.jdr1().read().jdata().bits()),
            motor_temp: scale::temperature(motor),
            board_temp: scale::temperature(adc.dr().read().data().bits()),
            strain: scale::strain(strain),
            raw: [strain, motor],
            bridge_fault,
        }
    }
}
