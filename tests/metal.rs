//! The motor board's scales and register values against floating point, and `docs/board.md`.

mod front_end;
mod page;

use bsp_stm32f1::timing;
use tater_f103::scale;

const CODES: std::ops::Range<u16> = 0..4096;

/// The input's voltage: a code is 1/4096 of VDDA.
fn volts(code: u16) -> f64 {
    f64::from(code) / 4096.0 * 3.3
}

#[test]
fn voltage_matches_divider() {
    for code in CODES {
        let millivolts = volts(code) * (100e3 + 10e3) / 10e3 * 1e3;
        // Rounded to the nearest, with a thousandth for the floats.
        let error = f64::from(scale::bus(code).0) - millivolts;
        assert!(error.abs() <= 0.501, "code {code}: {error} mV");
    }
}

#[test]
fn current_matches_amplifier() {
    for code in CODES {
        let milliamps = (volts(code) - 1.65) / 41.25 / 2e-3 * 1e3;
        // Rounded down, with a thousandth for the floats.
        let error = f64::from(scale::current(code).0) - milliamps;
        assert!((-1.0..=0.001).contains(&error), "code {code}: {error} mA");
    }
}

#[test]
fn temperature_matches_thermistor() {
    let mut judged = 0;
    for code in CODES {
        // The thermistor is below a 10 k pull-up: R/10 k = code/(4096 - code). B equation with 10 k at 25 °C, B 3950 K.
        let ratio = f64::from(code) / f64::from(4096 - code);
        let celsius = 1.0 / (1.0 / 298.15 + ratio.ln() / 3950.0) - 273.15;
        let said = f64::from(scale::temperature(code).0) / 10.0;
        let allowed = if (0.0..=100.0).contains(&celsius) { 0.3 } else { 1.0 };
        if (-20.0..=120.0).contains(&celsius) {
            judged += 1;
            assert!((said - celsius).abs() <= allowed, "code {code}: {said} for {celsius} degrees");
        }
    }
    // R/R25 is 0.0405 at 120 °C and 10.5 at -20 °C: codes 159 to 3740.
    assert!(judged > 3500, "{judged} codes");
    let [short, open] = [0, 4095].map(|code| scale::temperature(code).0);
    assert_eq!((short, open), (1550, -500), "the ends that a broken wire reads");
}

/// The required clocks: 72 MHz from the 8 MHz crystal.
const CORE: f64 = 72e6;

#[track_caller]
fn near(value: f64, expected: f64, within: f64) {
    assert!((value - expected).abs() <= within, "{value} is not {expected} within {within}");
}

#[test]
fn clocks_match_requirement() {
    let mega = |hz: u32| f64::from(hz) / 1e6;
    let clocks =
        [timing::CRYSTAL_HZ, timing::CORE_HZ, timing::APB1_HZ, timing::TIMER_HZ, timing::ADC_HZ].map(mega);
    assert_eq!(clocks, [8.0, CORE / 1e6, 36.0, 72.0, 12.0]);
    near(clocks[0] * f64::from(timing::PLL_FACTOR), clocks[1], 0.0);
}

#[test]
fn pwm_registers_read_back() {
    use timing::{adc, pwm};
    // RM0008 14.3.2: centered, ARR up and ARR down. 14.4.18: DTG below 128 is in ticks.
    near(CORE / (2.0 * f64::from(pwm::TOP)), 20e3, 0.0);
    assert_eq!(pwm::DEAD_TIME >> 7, 0, "DTG above 127 counts other steps");
    near(f64::from(pwm::DEAD_TIME) / CORE, 500e-9, 1e-12);
    // RM0008 11.12.4: sample times by code, in cycles of the ADC's clock; 11.6: 12.5 more for each
    // conversion.
    let cycles = [1.5, 7.5, 13.5, 28.5, 41.5, 55.5, 71.5, 239.5][usize::from(adc::SAMPLE_CODE)];
    let sample = cycles / 12e6;
    near(f64::from(adc::SAMPLE_NS) * 1e-9, sample, 1e-9);
    near(f64::from(adc::CONVERSION_NS) * 1e-9, (cycles + 12.5) / 12e6, 1e-9);
    assert!(4.0 * (cycles + 12.5) / 12e6 < 1.0 / 20e3, "four conversions fit a period");
    // The middle of the first sample is the counter at 0, within a tick.
    near(f64::from(pwm::CONVERT) / CORE, sample / 2.0, 1.0 / CORE);
}

#[test]
fn timer_registers_read_back() {
    use timing::{hall, tick};
    let count = |prescaler: u16| (f64::from(prescaler) + 1.0) / CORE;
    near(count(hall::PRESCALER), 1e-6, 1e-15);
    near(count(tick::PRESCALER), 1e-6, 1e-15);
    near(count(tick::PRESCALER) * (f64::from(tick::TOP) + 1.0), 1e-3, 1e-12);
    near((f64::from(tick::SLOW_RELOAD) + 1.0) * f64::from(tick::SLOW_DIVISION) / CORE, 0.1, 1e-12);
    // RM0008 15.4.1: CKD divides by 1, 2, 4. 15.4.7: ICF from 4 on, the number of samples and their clock
    // divider.
    let clock = CORE / f64::from(1_u32 << hall::CLOCK_DIVISION);
    let filters = [
        (6, 2),
        (8, 2),
        (6, 4),
        (8, 4),
        (6, 8),
        (8, 8),
        (5, 16),
        (6, 16),
        (8, 16),
        (5, 32),
        (6, 32),
        (8, 32),
    ];
    let (samples, every) = filters[usize::from(hall::FILTER) - 4];
    let filter = f64::from(samples * every) / clock;
    near(f64::from(hall::FILTER_NS) * 1e-9, filter, 1e-9);
    // The slowest filter of the chip, and under 1/64 of a sector at the full speed of 1057 counts/s.
    assert!(filter > 14e-6 && filter < 1.0 / 1057.0 / 64.0, "{filter}");
}

#[test]
fn bit_timing_reads_back() {
    // RM0008 24.7.7 and 24.9.2 (CAN_BTR), from APB1.
    let field = |low: u32, bits: u32| f64::from(timing::can::REGISTER >> low & ((1 << bits) - 1));
    let quantum = (field(0, 10) + 1.0) / 36e6;
    let (before, after) = (quantum * (1.0 + field(16, 4) + 1.0), quantum * (field(20, 3) + 1.0));
    near(before + after, 1e-6, 1e-15);
    near(before / (before + after), 15.0 / 18.0, 1e-12);
    near(quantum * (field(24, 2) + 1.0), 2.0 * quantum, 1e-15);
    assert!(field(24, 2) <= field(20, 3), "no edge moves the sample point beyond the bit");
    assert_eq!(timing::can::REGISTER >> 30, 0, "neither silent nor looped back");
}

#[test]
fn watchdog_registers_read_back() {
    use timing::watchdog::{PRESCALER_CODE, RELOAD};
    // RM0008 19.4.2: PR divides by 4, 8, 16 ...
    let seconds =
        |oscillator: f64| 4.0 * f64::from(1_u32 << PRESCALER_CODE) * (f64::from(RELOAD) + 1.0) / oscillator;
    near(seconds(40e3), 0.5, 1e-9);
    // With the fastest oscillator (DS5319 5.3.7) two consecutive slow tasks of 100 ms may miss their feed.
    assert!(seconds(60e3) > 0.3);
}

#[test]
fn tick_watchdog_registers_read_back() {
    use timing::tick_watchdog::{PRESCALER_CODE, TOP, US};
    // RM0008 20.4: PCLK1 by 4096 and 2^WDGTB, T[5:0] + 1 counts.
    let seconds = 4096.0 * f64::from(1_u32 << PRESCALER_CODE) * (f64::from(TOP & 0x3F) + 1.0) / 36e6;
    near(seconds, f64::from(US) * 1e-6, 1e-6);
    const { assert!(TOP & 0x40 != 0, "below 0x40 it resets at once") };
}
