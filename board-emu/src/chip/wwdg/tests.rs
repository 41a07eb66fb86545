use super::*;
use crate::time::US;

const CR: u32 = 0x0;
const CFR: u32 = 0x4;

/// A cycle of 36 MHz.
const CYCLE: Time = 4;

fn configured(config: u32) -> Wwdg {
    let mut wwdg = Wwdg::default();
    wwdg.set_cycle(CYCLE);
    wwdg.write(CFR, config, 0).expect("not running");
    wwdg
}

#[test]
fn stopped_watchdog_never_expires() {
    let mut wwdg = Wwdg::default();
    assert_eq!((wwdg.read(CR, 0), wwdg.read(CFR, 0)), (Ok(0x7F), Ok(0x7F)), "RM0008 20.6");
    wwdg.write(CR, 0x7F, 0).expect("modeled");
    assert_eq!((wwdg.next_event(), wwdg.expired), (NEVER, false));
}

#[test]
fn timeouts_match_table_97() {
    // RM0008 20.4, at 36 MHz: prescaler, shortest (T = 0x40) and longest (0x7F), us, cut to whole ones.
    for (code, shortest, longest) in [(0, 113, 7_281), (1, 227, 14_563), (2, 455, 29_127), (3, 910, 58_254)] {
        for (count, us) in [(0x40, shortest), (0x7F, longest)] {
            let mut wwdg = configured(code << 7 | COUNT);
            wwdg.write(CR, WDGA | count, 5).expect("modeled");
            let at = wwdg.next_event();
            assert_eq!((at - 5) / US, us, "{code}, {count:#x}");
            wwdg.advance(at - 1);
            assert!(!wwdg.expired);
            wwdg.advance(at);
            assert!(wwdg.expired && wwdg.next_event() == NEVER);
        }
    }
}

#[test]
fn feed_restarts_it_and_nothing_stops_it() {
    let mut wwdg = configured(3 << 7 | COUNT);
    wwdg.write(CR, WDGA | COUNT, 0).expect("modeled");
    let first = wwdg.next_event();
    // Without WDGA, which only a reset clears.
    wwdg.write(CR, COUNT, first - 1).expect("modeled");
    assert_eq!(wwdg.next_event(), 2 * first - 1);
    assert_eq!(wwdg.read(CR, first - 1 + wwdg.period()), Ok(WDGA | 0x7E));
}

#[test]
fn feed_above_the_window_or_with_a_small_count_resets() {
    let mut wwdg = configured(0x50);
    wwdg.write(CR, WDGA | COUNT, 0).expect("modeled");
    wwdg.write(CR, WDGA | COUNT, 1).expect("modeled");
    assert!(wwdg.expired, "the count is above the window");
    let mut wwdg = configured(COUNT);
    wwdg.write(CR, WDGA | 0x3F, 0).expect("modeled");
    assert!(wwdg.expired);
}
