use super::*;
use crate::time::US;

const KR: u32 = 0x0;
const PR: u32 = 0x4;
const RLR: u32 = 0x8;
const SR: u32 = 0xC;

/// A cycle of 40 kHz: 25 us.
const CYCLE: Time = 25 * US;

fn key(iwdg: &mut Iwdg, key: u32, now: Time) {
    iwdg.write(KR, key, now).expect("a key");
}

/// Started at 0 and then configured, as programs do; with the time at which both registers are in effect.
fn running(prescaler: u32, reload: u32) -> (Iwdg, Time) {
    let mut iwdg = Iwdg::default();
    key(&mut iwdg, START, 0);
    key(&mut iwdg, UNLOCK, 0);
    iwdg.write(PR, prescaler, 0).expect("open");
    iwdg.write(RLR, reload, 0).expect("open");
    assert_eq!(iwdg.read(SR, 5 * CYCLE - 1), Ok(3), "PVU and RVU");
    assert_eq!(iwdg.read(SR, 5 * CYCLE), Ok(0));
    (iwdg, 5 * CYCLE)
}

fn expiry(iwdg: &mut Iwdg) -> Time {
    loop {
        let next = iwdg.next_event();
        assert_ne!(next, NEVER);
        iwdg.advance(next);
        if iwdg.expired {
            assert_eq!(iwdg.next_event(), NEVER);
            return next;
        }
    }
}

#[test]
fn stopped_watchdog_never_expires() {
    let mut iwdg = Iwdg::default();
    assert_eq!(iwdg.next_event(), NEVER);
    assert_eq!((iwdg.read(PR, 0), iwdg.read(RLR, 0)), (Ok(0), Ok(0xFFF)), "RM0008 19.4");
    key(&mut iwdg, START, 77);
    // Table 96: by 4, 409.6 ms at most.
    assert_eq!(expiry(&mut iwdg), 77 + 409_600 * US);
}

#[test]
fn timeouts_match_table_96() {
    // RM0008 table 96: prescaler, shortest (RLR 0) and longest (RLR 0xFFF), us.
    for (code, shortest, longest) in [(0, 100, 409_600), (3, 800, 3_276_800), (6, 6_400, 26_214_400)] {
        for (reload, us) in [(0, shortest), (0xFFF, longest)] {
            let (mut iwdg, now) = running(code, reload);
            key(&mut iwdg, RELOAD, now);
            assert_eq!(expiry(&mut iwdg), now + us * US, "{code}, {reload}");
        }
    }
}

#[test]
fn reload_key_restarts_and_start_key_does_not() {
    let (mut iwdg, now) = running(3, 624);
    key(&mut iwdg, RELOAD, now);
    key(&mut iwdg, RELOAD, now + 300_000 * US);
    key(&mut iwdg, START, now + 400_000 * US);
    assert_eq!(expiry(&mut iwdg), now + 800_000 * US);
}

#[test]
fn reload_before_rlr_takes_effect_loads_the_old_value() {
    let mut iwdg = Iwdg::default();
    key(&mut iwdg, START, 0);
    key(&mut iwdg, UNLOCK, 0);
    iwdg.write(RLR, 0, 0).expect("open");
    key(&mut iwdg, RELOAD, 0);
    assert_eq!(expiry(&mut iwdg), 409_600 * US);
}

#[test]
fn registers_are_locked_without_their_key() {
    let (mut iwdg, now) = running(3, 624);
    key(&mut iwdg, RELOAD, now);
    iwdg.write(PR, 0, now).expect("ignored");
    iwdg.write(RLR, 0, now).expect("ignored");
    assert_eq!((iwdg.read(PR, now), iwdg.read(RLR, now)), (Ok(3), Ok(624)));
    key(&mut iwdg, UNLOCK, now);
    iwdg.write(PR, 4, now).expect("open");
    assert!(iwdg.write(PR, 5, now).is_err(), "before the last was taken over");
    assert!(iwdg.read(PR, now).is_err());
}

#[test]
fn prescaler_takes_effect_while_counting() {
    let mut iwdg = Iwdg::default();
    key(&mut iwdg, START, 0);
    let now = 400 * CYCLE;
    key(&mut iwdg, UNLOCK, now);
    iwdg.write(PR, 6, now).expect("open");
    assert_eq!(iwdg.read(SR, 900 * CYCLE), Ok(0), "looked at late");
    // 405 cycles by 4 are 101 counts, and 3995 more by 256.
    assert_eq!(expiry(&mut iwdg), 405 * CYCLE + 3995 * 256 * CYCLE);
}

#[test]
fn oscillator_tolerance_survives_reset() {
    for (hz, us) in [(30_000, 10_000_000 / 15), (60_000, 10_000_000 / 30)] {
        let mut iwdg = Iwdg::default();
        iwdg.set_oscillator(hz);
        iwdg.reset();
        key(&mut iwdg, START, 0);
        key(&mut iwdg, UNLOCK, 0);
        iwdg.write(PR, 3, 0).expect("open");
        iwdg.write(RLR, 624, 0).expect("open");
        iwdg.read(SR, 1000 * US).expect("SR");
        key(&mut iwdg, RELOAD, 1000 * US);
        let took = expiry(&mut iwdg) / US - 1000;
        assert!(took.abs_diff(us) <= 1, "{hz} Hz: {took} us");
        iwdg.reset();
        assert_eq!((iwdg.next_event(), iwdg.expired), (NEVER, false), "a reset stops it");
    }
}
