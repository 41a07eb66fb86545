//! Error counters, error passive, bus-off.

use super::*;

const NOW: Time = 1000 * BIT;

/// TEC, REC, and EWGF, EPVF, BOFF of ESR.
fn counters(can: &mut Can, now: Time) -> (u32, u32, u32) {
    let status = read(can, ESR, now);
    (status >> 16 & 0xFF, status >> 24, status & 7)
}

#[test]
fn counters_rise_with_errors_and_fall_with_frames() {
    let mut can = on_bus(0);
    request(&mut can, 0, 7, NOW);
    can.error(true, NOW);
    can.error(false, NOW);
    can.error(false, NOW);
    assert_eq!(counters(&mut can, NOW), (8, 2, 0));
    assert_ne!(read(&mut can, ESR, NOW) >> 4 & 7, 0, "LEC");
    can.sent(&frame(7, &[0xAA, 0xBB]), NOW);
    can.receive(&frame(8, &[]), NOW);
    assert_eq!(counters(&mut can, NOW), (7, 1, 0));
    assert_eq!(read(&mut can, ESR, NOW) >> 4 & 7, 0);
}

#[test]
fn warning_at_96_and_error_passive_above_127() {
    let mut can = on_bus(0);
    let mut seen = Vec::new();
    for _ in 0..16 {
        can.error(true, NOW);
        seen.push(counters(&mut can, NOW));
    }
    assert_eq!([seen[10], seen[11], seen[14], seen[15]], [(88, 0, 0), (96, 0, 1), (120, 0, 1), (128, 0, 3)]);
    let mut can = on_bus(0);
    (0..300).for_each(|_| can.error(false, NOW));
    assert_eq!(counters(&mut can, NOW), (0, 255, 3), "never bus-off by listening");
    can.receive(&frame(8, &[]), NOW);
    let (_, receive, flags) = counters(&mut can, NOW);
    assert!((119..=127).contains(&receive) && flags == 1, "{receive}");
}

#[test]
fn bus_off_above_255_recovers_by_abom() {
    let mut can = on_bus(mcr::ABOM);
    request(&mut can, 0, 7, NOW);
    (0..31).for_each(|_| can.error(true, NOW));
    assert!(can.is_on_bus());
    can.error(true, NOW);
    assert!(!can.is_on_bus() && can.pending().is_empty());
    assert_eq!(counters(&mut can, NOW).2, 7);
    can.receive(&frame(8, &[]), NOW);
    assert_eq!(read(&mut can, RF0R, NOW), 0, "deaf");
    // 128 times 11 recessive bits.
    assert_eq!(can.next_event(), NOW + 1408 * BIT);
    can.advance(NOW + 1408 * BIT - 1);
    assert!(!can.is_on_bus());
    can.advance(NOW + 1408 * BIT);
    assert!(can.is_on_bus());
    assert_eq!((counters(&mut can, NOW + 1408 * BIT), offered(&can)), ((0, 0, 0), vec![7]));
}

#[test]
fn bus_off_without_abom_ends_by_initialization() {
    let mut can = on_bus(0);
    (0..32).for_each(|_| can.error(true, NOW));
    assert_eq!((can.next_event(), can.is_on_bus()), (NEVER, false));
    write(&mut can, MCR, mcr::INRQ, NOW);
    assert_eq!(read(&mut can, MSR, NOW) & msr::INAK, msr::INAK);
    write(&mut can, MCR, 0, NOW);
    assert_eq!(can.next_event(), NOW + 1408 * BIT);
    can.advance(NOW + 1408 * BIT);
    assert_eq!((can.is_on_bus(), counters(&mut can, NOW + 1408 * BIT)), (true, (0, 0, 0)));
}

#[test]
fn missing_acknowledge_never_causes_bus_off() {
    let mut can = on_bus(mcr::ABOM);
    request(&mut can, 0, 7, NOW);
    (0..1000).for_each(|_| can.unacknowledged(NOW));
    assert_eq!(counters(&mut can, NOW), (128, 0, 3));
    assert_eq!(read(&mut can, ESR, NOW) >> 4 & 7, 3, "LEC: acknowledge");
    assert_eq!(offered(&can), [7]);
}

#[test]
fn status_interrupts_have_separate_enables() {
    // ERRIE and: EWGIE at the 12th error, EPVIE at the 16th, BOFIE at the 32nd, LECIE at the first.
    for (enable, at) in [(1 << 8, 12), (1 << 9, 16), (1 << 10, 32), (1 << 11, 1)] {
        let mut can = on_bus(0);
        write(&mut can, IER, enable, NOW);
        can.error(true, NOW);
        assert!(!can.interrupt_status(), "without ERRIE");
        write(&mut can, MSR, msr::ERRI, NOW);
        write(&mut can, IER, enable | ier::ERRIE, NOW);
        let first = (2..=32).find(|_| {
            can.error(true, NOW);
            can.interrupt_status()
        });
        assert_eq!(first, Some(at.max(2)), "{enable:#x}");
        write(&mut can, MSR, msr::ERRI, NOW);
        assert!(!can.interrupt_status());
    }
}
