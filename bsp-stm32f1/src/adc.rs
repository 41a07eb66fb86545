//! The ADC: four conversions around the middle of each PWM period's on-time, and a fifth over and over in between
//! (RM0008 11.3.9, 11.7).

use stm32f1xx_hal::pac::ADC1;
use stm32f1xx_hal::rcc::{Enable, Rcc};

use crate::timing::adc::{SAMPLE_CODE, WAKE_UP};

/// The converter.
pub struct Adc(ADC1);

/// The channels of a board's inputs.
pub struct Channels {
    /// Converted in this order around the middle of each on-time; not 0, which glitches with injected conversions (errata).
    pub injected: [u8; 4],
    /// Converted over and over in between.
    pub regular: u8,
}

/// The latest conversions, 0..=4095.
pub struct Codes {
    /// Of the channels of [`Channels::injected`].
    pub injected: [u16; 4],
    /// Of [`Channels::regular`].
    pub regular: u16,
}

impl Adc {
    /// A converter that waits for TIM1's trigger. Channels are 1 to 9.
    pub fn new(adc: ADC1, channels: &Channels, rcc: &mut Rcc) -> Self {
        ADC1::enable(rcc);
        adc.cr2().write(|w| w.adon().enabled());
        cortex_m::asm::delay(WAKE_UP);
        adc.cr2().modify(|_, w| w.rstcal().initialize());
        while adc.cr2().read().rstcal().bit_is_set() {}
        adc.cr2().modify(|_, w| w.cal().start());
        while adc.cr2().read().cal().bit_is_set() {}
        let [a, b, c, d] = channels.injected;
        let each = [a, b, c, d, channels.regular];
        let code = u32::from(SAMPLE_CODE);
        // SAFETY: three bits a channel, a code that exists.
        adc.smpr2()
            .write(|w| unsafe { w.bits(each.iter().fold(0, |bits, channel| bits | code << (3 * channel))) });
        // SAFETY: five bits each, channels that exist.
        adc.jsqr()
            .write(|w| unsafe { w.jl().bits(3).jsq1().bits(a).jsq2().bits(b).jsq3().bits(c).jsq4().bits(d) });
        // SAFETY: the same.
        adc.sqr3().write(|w| unsafe { w.sq1().bits(channels.regular) });
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
    pub fn read(&self) -> Codes {
        let adc = &self.0;
        Codes {
            injected: [
                adc.jdr1().read().jdata().bits(),
                adc.jdr2().read().jdata().bits(),
                adc.jdr3().read().jdata().bits(),
                adc.jdr4().read().jdata().bits(),
            ],
            regular: adc.dr().read().data().bits(),
        }
    }
}
