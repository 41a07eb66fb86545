use super::*;
use crate::time::US;

const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const SMCR: u32 = 0x08;
const DIER: u32 = 0x0C;
const SR: u32 = 0x10;
const EGR: u32 = 0x14;
const CCMR1: u32 = 0x18;
const CCER: u32 = 0x20;
const CNT: u32 = 0x24;
const PSC: u32 = 0x28;
const ARR: u32 = 0x2C;
const CCR1: u32 = 0x34;

fn written(writes: &[(u32, u32)]) -> Timer {
    let mut timer = Timer::default();
    for &(register, value) in writes {
        timer.write(register, value, 0).unwrap();
    }
    timer
}

#[test]
fn counter_wraps_after_65536_us() {
    // PSC 71 is taken over by UG.
    let mut timer = written(&[(PSC, 71), (ARR, 0xFFFF), (EGR, 1), (CR1, 1)]);
    for us in [0, 1, 999, 65_535, 65_536, 200_000] {
        assert_eq!(timer.read(CNT, us * US), Ok((us % 65_536) as u32), "{us}");
    }
    let mut timer = written(&[(PSC, 71), (CR1, 1)]);
    assert_eq!(timer.read(CNT, US), Ok(72), "the prescaler waits for an update");
}

#[test]
fn update_interrupts_each_period() {
    let mut timer = written(&[(PSC, 71), (ARR, 999), (EGR, 1), (SR, 0), (DIER, 1), (CR1, 1)]);
    assert_eq!(timer.next_event(), 1000 * US);
    timer.advance(1000 * US - 1);
    assert!(!timer.interrupt());
    timer.advance(1000 * US);
    assert!(timer.interrupt());
    // A flag is cleared by a 0; ones leave it.
    timer.write(SR, !0, 1001 * US).unwrap();
    assert!(timer.interrupt());
    timer.write(SR, !1, 1001 * US).unwrap();
    assert!(!timer.interrupt());
    assert_eq!(timer.next_event(), 2000 * US);
}

#[test]
fn ug_sets_the_flag_only_without_urs() {
    assert_eq!(written(&[(EGR, 1)]).read(SR, 0), Ok(UIF));
    assert_eq!(written(&[(CR1, 1 << 2), (EGR, 1)]).read(SR, 0), Ok(0));
    // UDIS: neither a flag nor what is buffered.
    let mut timer = written(&[(CR1, 1 << 1), (PSC, 71), (EGR, 1), (CR1, 1 << 1 | 1)]);
    assert_eq!((timer.read(SR, 0), timer.read(CNT, 72)), (Ok(0), Ok(36)));
}

/// As a hall interface: 1 us a count; the filter samples every 32nd clock, 8 samples (CKD 4).
fn halls() -> Timer {
    let mut timer = written(&[
        (PSC, 71),
        (CR1, 2 << 8 | 1 << 2),
        (CR2, 1 << 7),
        (SMCR, 0x44),
        (CCMR1, 15 << 4 | 3),
        (CCER, 1),
        (EGR, 1),
        (SR, 0),
        (DIER, CC1IF),
    ]);
    timer.write(CR1, 2 << 8 | 1 << 2 | 1, 0).unwrap();
    timer
}

/// Ticks between samples of that filter: 32 x 4 clocks.
const SAMPLE: Time = 32 * 4 * 2;

#[test]
fn edge_of_any_line_captures_and_restarts_after_the_filter() {
    let mut timer = halls();
    for (i, inputs) in [[true, false, false], [true, true, false], [true, true, true]].into_iter().enumerate()
    {
        let base = (i as Time + 1) * 1000 * SAMPLE;
        // Just after a sample: the next one is the first of eight.
        timer.set_inputs(inputs, base);
        let seen = base + 8 * SAMPLE;
        assert_eq!(timer.next_event(), seen);
        timer.advance(seen - 1);
        assert!(!timer.interrupt());
        timer.advance(seen);
        assert!(timer.interrupt());
        assert_eq!(timer.read(CNT, seen + 7 * US), Ok(7));
        let since_last = if i == 0 { seen } else { 1000 * SAMPLE };
        assert_eq!(timer.read(CCR1, seen + 7 * US), Ok((since_last / US) as u32));
        assert!(!timer.interrupt(), "reading CCR1 clears CC1IF");
        timer.write(SR, 0, seen + 7 * US).unwrap();
    }
}

#[test]
fn pulse_shorter_than_the_filter_is_no_edge() {
    let mut timer = halls();
    // Seven samples see it, the eighth does not.
    timer.set_inputs([true, false, false], 100 * SAMPLE);
    timer.set_inputs([false; 3], 108 * SAMPLE - 1);
    timer.advance(200 * SAMPLE);
    assert!(!timer.interrupt());
    // The eighth does: two edges.
    timer.set_inputs([true, false, false], 300 * SAMPLE);
    timer.set_inputs([false; 3], 308 * SAMPLE);
    assert!(timer.interrupt());
    timer.advance(400 * SAMPLE);
    assert_eq!(timer.read(SR, 400 * SAMPLE).unwrap() & (CC1IF | CC1OF), CC1IF | CC1OF);
    assert_eq!(timer.read(CNT, 400 * SAMPLE), Ok(((400 - 316) * SAMPLE / US) as u32));
    // A gap between samples is not seen.
    timer.write(SR, 0, 400 * SAMPLE).unwrap();
    timer.set_inputs([true, false, false], 500 * SAMPLE);
    timer.set_inputs([false; 3], 502 * SAMPLE + 1);
    timer.set_inputs([true, false, false], 502 * SAMPLE + 9);
    assert_eq!(timer.next_event(), 508 * SAMPLE);
    // A sampled gap restarts the count.
    timer.set_inputs([false; 3], 504 * SAMPLE - 1);
    timer.set_inputs([true, false, false], 504 * SAMPLE);
    assert_eq!(timer.next_event(), 512 * SAMPLE);
}

#[test]
fn filter_codes_match_the_manual() {
    let timer = |ckd: u32, code: u32| written(&[(CR1, ckd << 8), (CCMR1, code << 4 | 3)]).sampling();
    let expected = [
        (1, 1),
        (1, 2),
        (1, 4),
        (1, 8),
        (2, 6),
        (2, 8),
        (4, 6),
        (4, 8),
        (8, 6),
        (8, 8),
        (16, 5),
        (16, 6),
        (16, 8),
        (32, 5),
        (32, 6),
        (32, 8),
    ];
    for (code, (every, samples)) in (0..).zip(expected) {
        assert_eq!(timer(0, code), (2 * every, samples), "code {code}");
        // CKD divides DTS, not the timer's clock, at which codes 1 to 3 sample.
        let divided = if (1..4).contains(&code) { 1 } else { 4 };
        assert_eq!(timer(2, code), (2 * every * divided, samples), "code {code}");
    }
}

#[test]
fn unmodeled_bits_are_errors() {
    let mut timer = Timer::default();
    for (register, value) in
        [(CR1, 1 << 4), (CR1, 1 << 3), (SMCR, 0x54), (DIER, 1 << 8), (CCMR1, 0x60), (CCER, 1)]
    {
        assert!(timer.write(register, value, 0).is_err(), "{register:#x} {value:#x}");
    }
    assert!(halls().write(CCMR1, 0, 0).is_err(), "CC1S with CC1E on");
    assert!(timer.read(0x1C, 0).is_err());
}
