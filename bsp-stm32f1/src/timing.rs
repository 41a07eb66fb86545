//! Every number of the board that has to do with time, computed from the crystal and checked when it is compiled: a timer
//! that cannot reach its period exactly does not build.
//!
//! Sources: RM0008 (reference manual of the STM32F103), by section, and DS5319 (its data sheet).

/// The crystal.
pub const CRYSTAL_HZ: u32 = 8_000_000;
/// The PLL's factor (RM0008 7.2.3).
pub const PLL_FACTOR: u32 = 9;
/// Core, AHB, and APB2 with TIM1: at most 72 MHz (DS5319 5.3.1).
pub const CORE_HZ: u32 = CRYSTAL_HZ * PLL_FACTOR;
/// APB1, with bxCAN: at most 36 MHz.
pub const APB1_HZ: u32 = CORE_HZ / 2;
/// TIM2, TIM3 and TIM4: twice their bus where that is divided (RM0008 7.2).
pub const TIMER_HZ: u32 = APB1_HZ * 2;
/// The ADC: at most 14 MHz.
pub const ADC_HZ: u32 = CORE_HZ / 6;
/// The watchdog's RC oscillator, nominally; 30 to 60 kHz (DS5319 5.3.7).
pub const WATCHDOG_HZ: u32 = 40_000;

const _: () = assert!(CORE_HZ <= 72_000_000 && APB1_HZ <= 36_000_000 && ADC_HZ <= 14_000_000);

/// The lower 16 bits. Each use asserts that the value fits.
const fn register(value: u32) -> u16 {
    let [low, high, ..] = value.to_le_bytes();
    u16::from_le_bytes([low, high])
}

/// The bridge: TIM1, counting up and down (RM0008 14.3.2, 14.3.11).
pub mod pwm {
    use super::{ADC_HZ, CORE_HZ, adc, register};

    /// Above the audible range; 3600 core clocks per period.
    pub const HZ: u32 = 20_000;
    /// ARR: the counter goes up to it and down again in a period. Also the compare value of 100 %.
    pub const TOP: u16 = register(CORE_HZ / HZ / 2);
    /// Between a switch off and its complement on: twice the 250 ns that a gate driver and a MOSFET of this size need to
    /// switch off.
    pub const DEAD_TIME_NS: u32 = 500;
    /// DTG: below 128 it counts ticks of the core clock (RM0008 14.4.18).
    pub const DEAD_TIME: u8 = DEAD_TICKS.to_le_bytes()[0];
    const DEAD_TICKS: u32 = DEAD_TIME_NS * (CORE_HZ / 1_000_000) / 1000;
    /// Compare value of channel 4, whose edge starts the conversions: so long before the middle of the on-time (the counter
    /// at 0) that the middle of the first sample falls there.
    pub const CONVERT: u16 = register(CORE_HZ / ADC_HZ * adc::SAMPLE_HALF_CYCLES / 4);

    const _: () =
        assert!(CORE_HZ.is_multiple_of(2 * HZ) && CORE_HZ / HZ / 2 < 1 << 16, "20 kHz is not met exactly");
    const _: () = assert!(DEAD_TICKS < 128 && DEAD_TICKS * 1000 == DEAD_TIME_NS * (CORE_HZ / 1_000_000));
    const _: () = assert!(CORE_HZ.is_multiple_of(ADC_HZ) && CONVERT < TOP);
    const _: () = assert!(adc::INJECTED_NS < 1_000_000_000 / HZ, "conversions overlap the next");
}

/// Halls: TIM4 (RM0008 15.3.5, 15.3.15).
pub mod hall {
    use super::{TIMER_HZ, register};

    /// PSC: 1 us a count.
    pub const PRESCALER: u16 = register(TIMER_HZ / 1_000_000 - 1);
    /// Ticks of the core clock between two samples of the lines: 0.25 us at least, more than a spike that comes over from a
    /// switching leg lasts behind the lines' own low-pass.
    pub const SAMPLE_GAP: u32 = super::CORE_HZ / 4_000_000;
    /// CKD: the filter's clock is a quarter of the timer's (RM0008 15.4.1).
    pub const CLOCK_DIVISION: u8 = match DIVISION {
        1 => 0,
        2 => 1,
        4 => 2,
        _ => NONE,
    };
    const DIVISION: u32 = 4;
    /// The filter's clock.
    pub const FILTER_HZ: u32 = TIMER_HZ / DIVISION;
    /// ICF: of every 32nd of those a sample, and an edge is one after 8 alike (RM0008 15.4.7).
    pub const FILTER: u8 = match (EVERY, SAMPLES) {
        (2, 6) => 4,
        (2, 8) => 5,
        (4, 6) => 6,
        (4, 8) => 7,
        (8, 6) => 8,
        (8, 8) => 9,
        (16, 5) => 10,
        (16, 6) => 11,
        (16, 8) => 12,
        (32, 5) => 13,
        (32, 6) => 14,
        (32, 8) => 15,
        _ => NONE,
    };
    const EVERY: u32 = 32;
    const SAMPLES: u32 = 8;
    const NONE: u8 = 16;
    /// The filter's delay; shorter pulses are ignored.
    pub const FILTER_NS: u32 = EVERY * SAMPLES * 1000 / (FILTER_HZ / 1_000_000);

    const _: () = assert!(CLOCK_DIVISION < NONE && FILTER < NONE, "no such filter");
    const _: () = assert!(
        TIMER_HZ.is_multiple_of(1_000_000) && TIMER_HZ / 1_000_000 <= 1 << 16,
        "no whole microsecond"
    );
    // An edge is late by that, always: 1.5 % of a sector at the no-load speed of 1057 counts/s.
    const _: () = assert!(FILTER_NS < 15_000, "slower than 1/64 of a sector at full speed");
}

/// The clock, TIM2, and the control tick, TIM3.
pub mod tick {
    use super::{TIMER_HZ, register};

    /// Control ticks a second.
    pub const HZ: u32 = 1000;
    /// PSC of both: 1 us a count. The clock counts to 65.536 ms; it is read at least each tick, and after a page erase
    /// (40 ms at most, DS5319 5.3.9).
    pub const PRESCALER: u16 = register(TIMER_HZ / 1_000_000 - 1);
    /// ARR of the tick.
    pub const TOP: u16 = register(1_000_000 / HZ - 1);
    /// SysTick counts the core clock or, from what the core calls external, an eighth of it (RM0008 7.2).
    pub const SLOW_DIVISION: u32 = 8;
    /// SysTick's reload for the slow task (24 bits).
    pub const SLOW_RELOAD: u32 = super::CORE_HZ / SLOW_DIVISION / SLOW_HZ - 1;
    /// Slow tasks a second.
    pub const SLOW_HZ: u32 = 10;

    const _: () = assert!(
        TIMER_HZ.is_multiple_of(1_000_000) && 1_000_000_u32.is_multiple_of(HZ),
        "1 kHz is not met exactly"
    );
    const _: () = assert!(SLOW_DIVISION == 1 || SLOW_DIVISION == 8);
    const _: () =
        assert!((SLOW_RELOAD + 1) * SLOW_DIVISION * SLOW_HZ == super::CORE_HZ && SLOW_RELOAD < 1 << 24);
}

/// The ADC (RM0008 11.12, DS5319 5.3.18).
pub mod adc {
    use super::ADC_HZ;

    /// Sample time in half cycles of its clock: 28.5 cycles. The sources are at most 10 kilo-ohm (thermistors, the dividers),
    /// for which DS5319 asks for 1.3 us at 12 bits: (10 + 1) kilo-ohm x 8 pF x ln(2^14) = 0.9 us, and pins' capacitance.
    pub const SAMPLE_HALF_CYCLES: u32 = 57;
    /// From switching it on to calibrating it, in ticks of the core clock: 2 us. It takes 1 us to wake up (DS5319 5.3.18), and
    /// two of its cycles before it may be calibrated.
    pub const WAKE_UP: u32 = super::CORE_HZ / 500_000;
    /// Its code in SMPR.
    pub const SAMPLE_CODE: u8 = match SAMPLE_HALF_CYCLES {
        3 => 0,
        15 => 1,
        27 => 2,
        57 => 3,
        83 => 4,
        111 => 5,
        143 => 6,
        479 => 7,
        _ => NONE,
    };
    const NONE: u8 = 8;
    /// A sample.
    pub const SAMPLE_NS: u32 = SAMPLE_HALF_CYCLES * 500 / (ADC_HZ / 1_000_000);
    /// A conversion: the sample and 12.5 cycles.
    pub const CONVERSION_NS: u32 = (SAMPLE_HALF_CYCLES + 25) * 500 / (ADC_HZ / 1_000_000);
    /// The four conversions that a PWM period starts.
    pub const INJECTED_NS: u32 = 4 * CONVERSION_NS;

    const _: () = assert!(SAMPLE_CODE < NONE, "no such sample time");
    const _: () = assert!(SAMPLE_NS >= 1_300, "the sampling capacitor does not settle");
}

/// Straps.
pub mod straps {
    /// From their pull-ups to their reading, in ticks of the core clock: 100 us. The pull-ups have 50 kilo-ohm at most (DS5319
    /// 5.3.13), so that is time for 2 nF; an open strap that is still low is another node's.
    pub const SETTLE: u32 = super::CORE_HZ / 10_000;
}

/// bxCAN (RM0008 24.7.7).
pub mod can {
    use super::APB1_HZ;

    /// Bits a second.
    pub const HZ: u32 = 1_000_000;
    /// Clocks a quantum.
    pub const PRESCALER: u32 = 2;
    /// Quanta before the sample point, without the synchronization quantum.
    pub const SEGMENT_1: u32 = 14;
    /// Quanta after the sample point.
    pub const SEGMENT_2: u32 = 3;
    /// Quanta by which an edge may move it.
    pub const JUMP: u32 = 2;
    /// The sample point in 1/1000 of a bit. 75 % to 87.5 % suit a bus of a few meters at this rate.
    pub const SAMPLE_POINT: u32 = (1 + SEGMENT_1) * 1000 / QUANTA;
    /// Polls of the mailboxes, about 10 core clocks each, before the wait for them to empty ends: 1 ms, long enough for three frames
    /// to win arbitration on a live bus.
    pub const DRAIN: u32 = super::CORE_HZ / 1000 / 10;
    /// BTR.
    pub const REGISTER: u32 =
        (JUMP - 1) << 24 | (SEGMENT_2 - 1) << 20 | (SEGMENT_1 - 1) << 16 | (PRESCALER - 1);

    const QUANTA: u32 = 1 + SEGMENT_1 + SEGMENT_2;
    const _: () = assert!(HZ * PRESCALER * QUANTA == APB1_HZ, "1 Mbit/s is not met exactly");
    const _: () = assert!(SAMPLE_POINT >= 750 && SAMPLE_POINT <= 875);
    const _: () = assert!(SEGMENT_1 <= 16 && SEGMENT_2 <= 8 && JUMP <= 4 && JUMP <= SEGMENT_2);
}

/// The independent watchdog (RM0008 19).
pub mod watchdog {
    use super::WATCHDOG_HZ;

    /// Without a feed for so long, nominally, the board is reset: housekeeping has missed five turns.
    pub const MS: u32 = 500;
    /// PR = 3: the oscillator by 32.
    pub const PRESCALER_CODE: u8 = 3;
    const DIVIDER: u32 = 4 << PRESCALER_CODE;
    /// RLR, 12 bits.
    pub const RELOAD: u16 = super::register(WATCHDOG_HZ / DIVIDER * MS / 1000 - 1);

    const _: () = assert!(WATCHDOG_HZ / DIVIDER * MS / 1000 <= 1 << 12);
    // With the fastest oscillator, 60 kHz, three housekeeping periods still fit.
    const _: () = assert!(WATCHDOG_HZ / DIVIDER * MS / 1000 * DIVIDER / 60 >= 300);
}

/// The watchdog of the control tick: the window watchdog (RM0008 20), without a window.
pub mod tick_watchdog {
    use super::APB1_HZ;

    /// WDGTB: the counter's clock is APB1's by 4096 and by 8.
    pub const PRESCALER_CODE: u8 = 3;
    const DIVIDER: u32 = 4096 << PRESCALER_CODE;
    /// T and W: the largest value. The chip is reset when the counter goes below 0x40.
    pub const TOP: u8 = (COUNTS + 0x3F).to_le_bytes()[0];
    const COUNTS: u32 = 0x40;
    /// Without a tick for so long the board is reset, µs: 58,254, or up to a count of 910 less.
    pub const US: u32 = COUNTS * (DIVIDER / 8) * 2 / (APB1_HZ / 4_000_000);
    /// The longest erase of a page (DS5319 5.3.9).
    pub const ERASE_US: u32 = 40_000;

    const _: () =
        assert!(US <= 59_000, "the bridge is off within 60 ms of what stops the tick, 1 ms after the last");
    const _: () = assert!(US - 1_000 > ERASE_US + 10_000, "an erase and the tick after it fit");
}
