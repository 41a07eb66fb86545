//! The clock tree (RM0008 7.2): 8 MHz crystal, PLL by 9, 72 MHz; APB1 36 MHz, ADC 12 MHz.

use stm32f1xx_hal::flash::Parts;
use stm32f1xx_hal::pac::RCC;
use stm32f1xx_hal::rcc::{AdcPre, HPre, PPre, RawConfig, Rcc, RccExt};

use crate::timing::{ADC_HZ, APB1_HZ, CORE_HZ, CRYSTAL_HZ, PLL_FACTOR};

const _: () = assert!(CORE_HZ == 2 * APB1_HZ && CORE_HZ == 6 * ADC_HZ, "the dividers below");

/// Brings the clocks up and has the crystal watched: if it stops, TIM1's break input switches the bridge off and a
/// non-maskable interrupt follows. Waits for the crystal: the watchdog must be running.
pub fn start(rcc: RCC, flash: &mut Parts) -> Rcc {
    let config = RawConfig {
        hse: Some(CRYSTAL_HZ),
        // PLLMUL 0 is a factor of 2. The PLL takes a factor up to 16.
        pllmul: Some((PLL_FACTOR - 2).to_le_bytes()[0]),
        hpre: HPre::Div1,
        ppre1: PPre::Div2,
        ppre2: PPre::Div1,
        adcpre: AdcPre::Div6,
        ..RawConfig::default()
    };
    let rcc = rcc.freeze(config, &mut flash.acr);
    rcc.cr().modify(|_, w| w.csson().set_bit());
    rcc
}
