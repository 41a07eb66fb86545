use super::*;

pub(super) const CR1: u32 = 0x00;
pub(super) const CR2: u32 = 0x04;
pub(super) const DIER: u32 = 0x0C;
pub(super) const SR: u32 = 0x10;
pub(super) const EGR: u32 = 0x14;
pub(super) const CCMR1: u32 = 0x18;
pub(super) const CCMR2: u32 = 0x1C;
pub(super) const CCER: u32 = 0x20;
pub(super) const CNT: u32 = 0x24;
pub(super) const PSC: u32 = 0x28;
pub(super) const ARR: u32 = 0x2C;
pub(super) const RCR: u32 = 0x30;
pub(super) const CCR1: u32 = 0x34;
pub(super) const CCR4: u32 = 0x40;
pub(super) const BDTR: u32 = 0x44;
pub(super) const CENTRE: u32 = 1 << 5;
/// OCxM of both channels of a CCMR: PWM mode 1.
pub(super) const PWM1: u32 = 0x6060;

/// Break input high: no break with BKP 0.
pub(super) fn written(writes: &[(u32, u32)]) -> Tim1 {
    let mut tim = Tim1::default();
    tim.set_break(true, false, 0);
    for &(register, value) in writes {
        tim.write(register, value, 0).unwrap();
    }
    tim
}

/// A tick for each clock of the timer, 2.
const CLOCK: Time = 2;

#[test]
fn counts_up_and_down_at_known_times() {
    let mut tim = written(&[(CR1, CENTRE), (ARR, 1800), (CR1, CENTRE | 1)]);
    for (clock, count, down) in
        [(0, 0, 0), (1, 1, 0), (1799, 1799, 0), (1800, 1800, 1), (1801, 1799, 1), (3599, 1, 1)]
    {
        for period in [0, 1, 7] {
            let at = (period * 3600 + clock) * CLOCK;
            assert_eq!(tim.read(CNT, at), Ok(count), "{period} {clock}");
            assert_eq!(tim.read(CR1, at).unwrap() >> 4 & 1, down, "{period} {clock}");
        }
        tim = written(&[(CR1, CENTRE), (ARR, 1800), (CR1, CENTRE | 1)]);
    }
    // Prescaler by UG, and down.
    let mut tim = written(&[(CR1, 1 << 4), (ARR, 9), (PSC, 3), (EGR, 1), (CR1, 1 << 4 | 1)]);
    assert_eq!([0, 4, 39, 40].map(|clock| tim.read(CNT, clock * CLOCK).unwrap()), [9, 8, 0, 9]);
}

#[test]
fn update_flag_at_each_turn_except_by_rcr() {
    let set = |rcr: u32| {
        written(&[(CR1, CENTRE), (ARR, 100), (RCR, rcr), (EGR, 1), (SR, 0), (DIER, UIF), (CR1, CENTRE | 1)])
    };
    for (rcr, first) in [(0, 100), (1, 200), (3, 400)] {
        let mut tim = set(rcr);
        assert_eq!(tim.next_event(), first * CLOCK, "RCR {rcr}");
        tim.advance(first * CLOCK - 1);
        assert!(!tim.interrupt_update());
        tim.advance(first * CLOCK);
        assert!(tim.interrupt_update());
        tim.write(SR, !UIF, first * CLOCK).unwrap();
        assert_eq!(tim.next_event(), 2 * first * CLOCK, "RCR {rcr}");
    }
}

#[test]
fn compare_flag_depends_on_cms() {
    let times = |cms: u32| {
        let cr1 = cms << 5;
        let mut tim = written(&[(CR1, cr1), (ARR, 100), (CCR1, 30), (DIER, 2), (CR1, cr1 | 1)]);
        let mut at = Vec::new();
        while at.len() < 3 {
            let now = tim.next_event();
            tim.advance(now);
            assert!(tim.interrupt_compare());
            tim.write(SR, !2, now).unwrap();
            at.push(now / CLOCK);
        }
        at
    };
    assert_eq!(times(1), [170, 370, 570], "down only");
    assert_eq!(times(2), [30, 230, 430], "up only");
    assert_eq!(times(3), [30, 170, 230]);
    assert_eq!(times(0), [30, 131, 232], "edge-aligned: a period of 101");
}

#[test]
fn channel_4_triggers_while_counting_down() {
    let mut tim =
        written(&[(CR1, CENTRE), (CR2, 7 << 4), (ARR, 1800), (CCMR2, PWM1), (CCR4, 85), (CR1, CENTRE | 1)]);
    // The first period begins below the compare value.
    assert_eq!(tim.take_trigger(), Some(0));
    for period in 1..4 {
        let due = (3600 * period - 85) * CLOCK;
        assert_eq!(tim.next_event(), due);
        tim.advance(due);
        assert_eq!(tim.take_trigger(), Some(due));
        assert_eq!(tim.take_trigger(), None);
    }
}

#[test]
fn mms_selects_the_trigger() {
    let mut reset = written(&[(EGR, 1)]);
    assert_eq!(reset.take_trigger(), Some(0));
    assert_eq!(written(&[(CR2, 1 << 4), (EGR, 1)]).take_trigger(), None);
    assert_eq!(written(&[(CR2, 1 << 4), (CR1, 1)]).take_trigger(), Some(0), "enable");
    let update = written(&[(CR2, 2 << 4), (ARR, 9), (CR1, 1)]);
    assert_eq!(update.next_event(), 10 * CLOCK);
    let mut reference = written(&[(CR2, 4 << 4), (ARR, 9), (CCMR1, 0x60), (CCR1, 5)]);
    assert_eq!(reference.take_trigger(), Some(0), "OC1REF is high below 5");
    reference.write(CCMR1, 0x40, 0).unwrap();
    reference.write(CCMR1, 0x50, 6).unwrap();
    assert_eq!(reference.take_trigger(), Some(6), "forced low, forced high");
    assert!(Tim1::default().write(CR2, 3 << 4, 0).is_err());
}

#[test]
fn preload_waits_for_an_update() {
    let mut tim = written(&[(CR1, CENTRE), (ARR, 100), (CCMR1, 0x68), (CCR1, 30), (CR1, CENTRE | 1)]);
    assert_eq!((tim.read(CCR1, 0), tim.gates().compare[0]), (Ok(30), 0));
    // The update counts as visible: the gates may change.
    assert_eq!(tim.next_event(), 100 * CLOCK);
    tim.gates_changed = false;
    tim.advance(100 * CLOCK);
    assert_eq!((tim.gates_changed, tim.gates().compare[0]), (true, 30));
    // Without preload at once; the same for ARR with ARPE.
    tim.write(CCMR1, 0x60, 100 * CLOCK).unwrap();
    tim.write(CCR1, 40, 100 * CLOCK).unwrap();
    assert_eq!(tim.gates().compare[0], 40);
    tim.write(CR1, CENTRE | 1 << 7 | 1, 100 * CLOCK).unwrap();
    tim.write(ARR, 50, 100 * CLOCK).unwrap();
    assert_eq!((tim.read(ARR, 100 * CLOCK), tim.gates().full), (Ok(50), 100));
    tim.write(EGR, 1, 100 * CLOCK).unwrap();
    assert_eq!(tim.gates().full, 50);
}

#[test]
fn break_acts_without_code_and_latches() {
    let mut tim = written(&[(BDTR, MOE | BKE), (DIER, BIF)]);
    assert!(tim.is_on());
    tim.gates_changed = false;
    tim.set_break(false, false, 1000);
    assert!(!tim.is_on() && tim.interrupt_break() && tim.gates_changed);
    // While the input is active, neither MOE is set nor BIF cleared (RM0008 14.3.12).
    tim.write(BDTR, MOE | BKE, 1001).unwrap();
    tim.write(SR, 0, 1002).unwrap();
    assert_eq!((tim.is_on(), tim.read(SR, 1003).unwrap() & BIF), (false, BIF));
    tim.set_break(true, false, 1004);
    tim.write(SR, 0, 1005).unwrap();
    tim.write(BDTR, MOE | BKE, 1006).unwrap();
    assert_eq!((tim.is_on(), tim.read(SR, 1007).unwrap() & BIF), (true, 0));
    // The clock security system causes a break too.
    tim.set_break(true, true, 1008);
    assert!(!tim.is_on());
}

#[test]
fn break_follows_bke_bkp_bg_and_aoe() {
    let mut ignored = written(&[(BDTR, MOE)]);
    ignored.set_break(false, true, 0);
    assert!(ignored.is_on(), "BKE 0");
    assert!(!written(&[(BDTR, MOE | BKE | BKP)]).is_on(), "the input is active-high");
    assert!(!written(&[(BDTR, MOE), (EGR, 1 << 7)]).is_on(), "BG");
    let mut auto = written(&[(ARR, 99), (BDTR, AOE | BKE), (CR1, 1)]);
    auto.set_break(false, false, 0);
    auto.advance(100 * CLOCK);
    assert!(!auto.is_on(), "not while the input is active");
    auto.set_break(true, false, 150 * CLOCK);
    assert_eq!(auto.next_event(), 200 * CLOCK);
    auto.advance(200 * CLOCK);
    assert!(auto.is_on(), "AOE at the next update");
}

/// Remaining bits after writes to all that LOCK may protect: CR2, CCER, CCMR1, BDTR.
fn after_lock(level: u32) -> [u32; 4] {
    let mut tim = written(&[(BDTR, level << 8)]);
    for (register, value) in [(CR2, IDLE), (CCER, 0x3FFF), (CCMR1, 0x6868), (BDTR, 0xFFFF & !BKP & !MOE)] {
        tim.write(register, value, 0).unwrap();
    }
    [CR2, CCER, CCMR1, BDTR].map(|register| tim.read(register, 0).unwrap())
}

#[test]
fn lock_levels_protect_registers() {
    let (free, bdtr) = (0xFFFF & !BKP & !MOE & !LOCK, DTG | BKE | AOE);
    assert_eq!(after_lock(0), [IDLE, 0x3FFF, 0x6868, free]);
    assert_eq!(after_lock(1), [0, 0x3FFF, 0x6868, free & !bdtr | 1 << 8]);
    assert_eq!(after_lock(2), [0, 0x3FFF & !POLARITIES, 0x6868, 2 << 8]);
    assert_eq!(after_lock(3), [0, 0x3FFF & !POLARITIES, 0, 3 << 8]);
    // MOE is never locked; LOCK can be written once.
    let mut tim = written(&[(BDTR, 3 << 8), (BDTR, MOE)]);
    assert_eq!(tim.read(BDTR, 0), Ok(MOE | 3 << 8));
    let mut tim = written(&[(BDTR, 0), (BDTR, 3 << 8)]);
    assert_eq!(tim.read(BDTR, 0), Ok(0));
}

#[test]
fn unmodeled_bits_are_errors() {
    for (register, value) in [
        (CR1, 1 << 3),
        (0x08, 4),
        (DIER, 1 << 8),
        (CCMR1, 1),
        (CCMR1, 0x30),
        (CCMR2, 1 << 2),
        (EGR, 1 << 5),
        (0x48, 1),
    ] {
        assert!(written(&[]).write(register, value, 0).is_err(), "{register:#x} {value:#x}");
    }
    assert!(written(&[(CR1, 1)]).write(CR1, CENTRE | 1, 0).is_err(), "CMS while it counts");
}

mod pins;
