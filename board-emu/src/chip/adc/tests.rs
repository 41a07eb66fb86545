use super::*;

const SR: u32 = 0x00;
const CR1: u32 = 0x04;
const CR2: u32 = 0x08;
const SMPR2: u32 = 0x10;
const SQR3: u32 = 0x34;
const JSQR: u32 = 0x38;
const JDR1: u32 = 0x3C;
const DR: u32 = 0x4C;

/// A cycle at 12 MHz, ticks; a conversion of 28.5 + 12.5 cycles.
const CYCLE: Time = 12;
const CONVERSION_41: Time = 41 * CYCLE;
const READY: Time = 10 * US;

/// Inputs 5, 1, 2, 3 injected by TIM1, input 4 over and over, 28.5 cycles each.
fn converter() -> Adc {
    let mut adc = Adc::default();
    adc.write(CR2, ADON, 0).unwrap();
    adc.write(SMPR2, 0o333330, 0).unwrap();
    adc.write(JSQR, 3 << 20 | 3 << 15 | 2 << 10 | 1 << 5 | 5, 0).unwrap();
    adc.write(SQR3, 4, 0).unwrap();
    adc.write(CR1, SCAN | JEOCIE, 0).unwrap();
    adc.write(CR2, ADON | CONT | JEXTTRIG | EXTSEL | EXTTRIG, 0).unwrap();
    adc
}

fn inputs(base: u16) -> [u16; 18] {
    std::array::from_fn(|channel| base + channel as u16)
}

#[test]
fn calibration_bits_clear_after_their_time() {
    let mut adc = Adc::default();
    adc.write(CR2, ADON, 0).unwrap();
    adc.write(CR2, ADON | RSTCAL, 200).unwrap();
    assert_eq!(adc.read(CR2, 200), Ok(ADON | RSTCAL));
    assert_eq!(adc.read(CR2, 200 + 2 * CYCLE), Ok(ADON));
    adc.write(CR2, ADON | CAL, 300).unwrap();
    assert_eq!(adc.read(CR2, 300 + 83 * CYCLE - 1), Ok(ADON | CAL));
    assert_eq!(adc.read(CR2, 300 + 83 * CYCLE), Ok(ADON));
    let mut early = Adc::default();
    early.write(CR2, ADON, 0).unwrap();
    assert!(early.write(CR2, ADON | CAL, 2 * CYCLE - 1).is_err());
}

#[test]
fn trigger_starts_four_conversions() {
    let mut adc = converter();
    adc.set_inputs(inputs(100), READY);
    adc.trigger(READY);
    // The second channel's sampling ends at 41 + 28.5 cycles: a change a tick before it is seen, one at the third's is not.
    adc.set_inputs(inputs(200), READY + CONVERSION_41 + 57 * CYCLE / 2 - 1);
    adc.set_inputs(inputs(300), READY + 2 * CONVERSION_41 + 57 * CYCLE / 2);
    assert_eq!(adc.next_event(), READY + 3 * CONVERSION_41);
    let end = READY + 4 * CONVERSION_41;
    adc.advance(end - 1);
    assert!(!adc.interrupt());
    assert_eq!(adc.read(SR, end - 1), Ok(JSTRT));
    adc.advance(end);
    assert!(adc.interrupt());
    let read: Vec<u32> = (0..4).map(|i| adc.read(JDR1 + 4 * i, end).unwrap()).collect();
    assert_eq!(read, [105, 201, 202, 303]);
    adc.write(SR, !JEOC, end).unwrap();
    assert!(!adc.interrupt());
}

#[test]
fn shorter_group_uses_the_last_ranks() {
    let mut adc = converter();
    adc.write(JSQR, 1 << 20 | 3 << 15 | 2 << 10 | 1 << 5 | 5, 0).unwrap();
    adc.set_inputs(inputs(100), READY);
    adc.trigger(READY);
    let end = READY + 2 * CONVERSION_41;
    assert_eq!([0, 4].map(|i| adc.read(JDR1 + i, end).unwrap()), [102, 103]);
}

#[test]
fn injected_group_interrupts_regular_conversion() {
    let mut adc = converter();
    adc.set_inputs(inputs(100), READY);
    let cr2 = adc.read(CR2, READY).unwrap();
    adc.write(CR2, cr2 | SWSTART, READY).unwrap();
    assert_eq!(adc.read(SR, READY + CONVERSION_41 - 1), Ok(STRT));
    assert_eq!(adc.read(SR, READY + CONVERSION_41), Ok(STRT | EOC));
    assert_eq!(adc.read(DR, READY + CONVERSION_41), Ok(104));
    assert_eq!(adc.read(SR, READY + CONVERSION_41), Ok(STRT), "reading DR clears EOC");
    // Long after: what was sampled last.
    let at = READY + 50 * CONVERSION_41;
    adc.set_inputs(inputs(200), at + 57 * CYCLE / 2);
    assert_eq!(adc.read(DR, at + CONVERSION_41), Ok(104));
    assert_eq!(adc.read(DR, at + 2 * CONVERSION_41), Ok(204));
    // An injected group stops it; it begins anew after that.
    let at = READY + 60 * CONVERSION_41 + 40 * CYCLE;
    adc.set_inputs(inputs(300), at);
    adc.trigger(at);
    let again = at + 4 * CONVERSION_41;
    assert_eq!(adc.read(DR, again + CONVERSION_41 - 1), Ok(204));
    assert_eq!(adc.read(DR, again + CONVERSION_41), Ok(304));
}

#[test]
fn without_its_switches_a_trigger_does_nothing() {
    for cr2 in [0, ADON, JEXTTRIG] {
        let mut adc = converter();
        adc.write(CR2, cr2, READY).unwrap();
        adc.trigger(READY);
        assert_eq!(adc.read(SR, READY + 10 * CONVERSION_41), Ok(0), "{cr2:#x}");
    }
}

#[test]
fn unmodeled_bits_are_errors() {
    let on = ADON | EXTSEL | EXTTRIG;
    for (register, value, at) in [
        (CR1, 1 << 10, READY),                   // JAUTO
        (CR2, ADON | 1 << 8, READY),             // DMA
        (CR2, ADON | 1 << 11, READY),            // ALIGN
        (CR2, ADON | JEXTTRIG | 1 << 12, READY), // TIM1's channel 4
        (CR2, ADON | EXTTRIG, READY),            // TIM1's channel 1
        (CR2, on | SWSTART, WAKE_UP - 1),        // before it is awake
        (0x14, 1, READY),                        // an offset
        (0x2C, 1 << 20, READY),                  // two regular conversions
        (SQR3, 18, READY),
    ] {
        assert!(converter().write(register, value, at).is_err(), "{register:#x} {value:#x}");
    }
    assert!(converter().write(CR1, 0, READY).is_err(), "a group without SCAN");
    assert!(converter().write(CR2, on | SWSTART, WAKE_UP).is_ok());
    let mut fast = converter();
    fast.set_cycle(8, READY);
    assert!(fast.write(CR2, on | SWSTART, READY).unwrap_err().contains("14 MHz"));
}
