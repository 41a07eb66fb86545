//! The clock tree: frequencies from the system clock's source and CFGR; enable bits of peripherals.

use super::super::RegisterResult;
use crate::time::{HZ, Time};

/// The crystal, and the RC oscillator.
const OSCILLATOR_HZ: u64 = 8_000_000;

/// Source of the system clock (CFGR.SW).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    Hsi,
    Hse,
    Pll,
}

impl Source {
    /// Writes reject the reserved value.
    pub(super) const fn from_bits(bits: u32) -> Self {
        match bits {
            0 => Self::Hsi,
            1 => Self::Hse,
            _ => Self::Pll,
        }
    }

    pub(super) const fn bits(self) -> u32 {
        match self {
            Self::Hsi => 0,
            Self::Hse => 1,
            Self::Pll => 2,
        }
    }
}

/// Whether the PLL runs from the crystal (CFGR.PLLSRC).
pub(super) const fn is_pll_from_crystal(cfgr: u32) -> bool {
    cfgr >> 16 & 1 == 1
}

/// Cycles of all clocks, in ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tree {
    pub(super) core_hz: u64,
    pub(super) core: Time,
    pub(super) apb1: Time,
    pub(super) timer: Time,
    pub(super) timer1: Time,
    pub(super) adc: Time,
}

impl Tree {
    /// Reset state: all at 8 MHz, the converter at half of it.
    pub(super) const RESET: Self =
        Self { core_hz: OSCILLATOR_HZ, core: 18, apb1: 18, timer: 18, timer1: 18, adc: 36 };

    /// The tree of CFGR (RM0008 7.3.2) with this source.
    ///
    /// # Errors
    /// A clock above its limit (DS5319 table 9), or a cycle that is not a whole number of ticks.
    pub(super) fn new(source: Source, cfgr: u32) -> RegisterResult<Self> {
        let field = |low: u32, bits: u32| cfgr >> low & ((1 << bits) - 1);
        let system_hz = match source {
            Source::Hsi | Source::Hse => OSCILLATOR_HZ,
            Source::Pll => {
                let halved = !is_pll_from_crystal(cfgr) || field(17, 1) == 1;
                // 14 and 15 are both 16.
                let factor = u64::from((field(18, 4) + 2).min(16));
                OSCILLATOR_HZ / if halved { 2 } else { 1 } * factor
            }
        };
        // HPRE: 1, then 2 to 16 and 64 to 512; there is no 32.
        let ahb = match field(4, 4) {
            0..8 => 1,
            code @ 8..12 => 2 << (code - 8),
            code => 64 << (code - 12),
        };
        let apb = |code: u32| if code < 4 { 1 } else { 2 << (code - 4) };
        let (divider1, divider2): (u64, u64) = (apb(field(8, 3)), apb(field(11, 3)));
        let core_hz = system_hz / ahb;
        let (apb1_hz, apb2_hz) = (core_hz / divider1, core_hz / divider2);
        for (name, hz, limit) in [
            ("the system clock", system_hz, 72_000_000),
            ("APB1", apb1_hz, 36_000_000),
            ("APB2", apb2_hz, 72_000_000),
        ] {
            if hz > limit {
                return Err(format!("RCC_CFGR: {name} would be {hz} Hz, {limit} at most (DS5319 5.3.1)"));
            }
        }
        let cycle = |hz: u64| {
            let whole = hz > 0 && HZ.is_multiple_of(hz);
            if whole {
                Ok(HZ / hz)
            } else {
                Err(format!("RCC_CFGR: a clock of {hz} Hz, no whole divider of {HZ}"))
            }
        };
        let timer_hz = |hz: u64, divider: u64| if divider == 1 { hz } else { 2 * hz };
        Ok(Self {
            core_hz,
            core: cycle(core_hz)?,
            apb1: cycle(apb1_hz)?,
            timer: cycle(timer_hz(apb1_hz, divider1))?,
            timer1: cycle(timer_hz(apb2_hz, divider2))?,
            adc: cycle(apb2_hz)? * 2 * Time::from(field(14, 2) + 1),
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Switch {
    Ahb(u32),
    Apb1(u32),
    Apb2(u32),
}

/// Start address and enable bit of each peripheral of a medium-density chip (RM0008 3.3, 7.3.6 to 7.3.8).
const SWITCHES: [(u32, Switch); 26] = [
    (0x4000_0000, Switch::Apb1(0)),  // TIM2
    (0x4000_0400, Switch::Apb1(1)),  // TIM3
    (0x4000_0800, Switch::Apb1(2)),  // TIM4
    (0x4000_2C00, Switch::Apb1(11)), // WWDG
    (0x4000_3800, Switch::Apb1(14)), // SPI2
    (0x4000_4400, Switch::Apb1(17)), // USART2
    (0x4000_4800, Switch::Apb1(18)), // USART3
    (0x4000_5400, Switch::Apb1(21)), // I2C1
    (0x4000_5800, Switch::Apb1(22)), // I2C2
    (0x4000_5C00, Switch::Apb1(23)), // USB
    (0x4000_6400, Switch::Apb1(25)), // bxCAN
    (0x4000_6C00, Switch::Apb1(27)), // BKP
    (0x4000_7000, Switch::Apb1(28)), // PWR
    (0x4001_0000, Switch::Apb2(0)),  // AFIO
    (0x4001_0800, Switch::Apb2(2)),  // GPIOA
    (0x4001_0C00, Switch::Apb2(3)),  // GPIOB
    (0x4001_1000, Switch::Apb2(4)),  // GPIOC
    (0x4001_1400, Switch::Apb2(5)),  // GPIOD
    (0x4001_1800, Switch::Apb2(6)),  // GPIOE
    (0x4001_2400, Switch::Apb2(9)),  // ADC1
    (0x4001_2800, Switch::Apb2(10)), // ADC2
    (0x4001_2C00, Switch::Apb2(11)), // TIM1
    (0x4001_3000, Switch::Apb2(12)), // SPI1
    (0x4001_3800, Switch::Apb2(14)), // USART1
    (0x4002_0000, Switch::Ahb(0)),   // DMA1
    (0x4002_3000, Switch::Ahb(6)),   // CRC
];

/// Enable bit of the peripheral at an address; `None` if it has none: EXTI, RTC, IWDG, RCC, the flash.
pub(super) fn switch(address: u32) -> Option<Switch> {
    let base = address & !0x3FF;
    let found = SWITCHES.binary_search_by_key(&base, |&(start, _)| start).ok()?;
    SWITCHES.get(found).map(|&(_, switch)| switch)
}

pub(super) fn blocks(bits: u32, bus: fn(u32) -> Switch) -> impl Iterator<Item = u32> {
    let reset =
        move |&&(_, switch): &&(u32, Switch)| (0..32).any(|bit| bits >> bit & 1 == 1 && bus(bit) == switch);
    SWITCHES.iter().filter(reset).map(|&(start, _)| start)
}
