//! The outputs.

use super::*;

const EN: u32 = 0x0001;
const EN_N: u32 = 0x0004;

/// Channel 1 in PWM mode 1, centered, 3600 clocks a period.
fn pair(compare: u32, ccer: u32, bdtr: u32) -> Tim1 {
    written(&[
        (CR1, CENTRE),
        (ARR, 1800),
        (CCMR1, PWM1),
        (CCR1, compare),
        (CCER, ccer),
        (BDTR, bdtr),
        (CR1, CENTRE | 1),
    ])
}

fn first(tim: &Tim1) -> (Gate, Gate) {
    let gates = tim.gates();
    (gates.high[0], gates.low[0])
}

#[test]
fn pair_has_dead_time_at_both_edges() {
    let tim = pair(900, EN | EN_N, MOE | 36);
    // The reference is high from 2700 to 900 around the counter's 0; each side starts 36 clocks later.
    let on = Gate::Pwm { rise: 2736, high: 1764 };
    let off = Gate::Pwm { rise: 936, high: 1764 };
    assert_eq!((first(&tim), tim.gates().period), ((on, off), 3600));
    // One side alone has no dead time.
    assert_eq!(
        first(&pair(900, EN, MOE | OSSR | 36)),
        (Gate::Pwm { rise: 2700, high: 1800 }, Gate::Held(false))
    );
    // A pulse shorter than the dead time vanishes.
    assert_eq!(first(&pair(0, EN | EN_N, MOE | 36)), (Gate::Held(false), Gate::Held(true)));
    assert_eq!(first(&pair(1800, EN | EN_N, MOE | 36)), (Gate::Held(true), Gate::Held(false)));
    let short = Gate::Pwm { rise: 54, high: 3600 - 36 - 36 };
    assert_eq!(first(&pair(18, EN | EN_N, MOE | 36)), (Gate::Held(false), short));
    assert_eq!(first(&pair(19, EN | EN_N, MOE | 36)).0, Gate::Pwm { rise: 17, high: 2 });
}

#[test]
fn gates_follow_the_reference() {
    let mut tim = pair(700, EN, MOE);
    let (Gate::Pwm { rise, high }, _) = first(&tim) else { panic!("no PWM") };
    for clock in 0..3600 {
        tim.catch_up(clock * CLOCK);
        assert_eq!(tim.reference(0), (clock + 3600 - rise) % 3600 < high, "{clock}");
    }
}

#[test]
fn dead_time_has_four_ranges() {
    let dead = |dtg: u32| pair(900, EN | EN_N, MOE | dtg).dead_time();
    assert_eq!([0, 36, 127].map(dead), [0, 36, 127]);
    assert_eq!([0x80, 0x81, 0xBF].map(dead), [128, 130, 254]);
    assert_eq!([0xC0, 0xC1, 0xDF].map(dead), [256, 264, 504]);
    assert_eq!([0xE0, 0xE1, 0xFF].map(dead), [512, 528, 1008]);
    // In units of DTS, divided by CKD.
    let mut tim = pair(900, EN | EN_N, MOE | 36);
    tim.write(CR1, CENTRE | 1 << 8 | 1, 0).unwrap();
    assert_eq!(tim.dead_time(), 72);
}

#[test]
fn ossr_and_ossi_hold_disabled_outputs() {
    use Gate::{Held, Open};
    assert_eq!(first(&pair(900, 0, MOE | OSSR)), (Open, Open));
    assert_eq!(first(&pair(900, EN, MOE)).1, Open);
    assert_eq!(first(&pair(900, EN_N, MOE)).0, Open);
    assert_eq!(first(&pair(900, EN_N, MOE | OSSR)), (Held(false), Gate::Pwm { rise: 2700, high: 1800 }));
    assert_eq!(first(&pair(900, EN | EN_N, 0)), (Open, Open));
    assert_eq!(first(&pair(900, EN | EN_N, OSSI)), (Held(false), Held(false)));
    // Idle levels, but not both active.
    let idle = |cr2: u32| {
        let mut tim = pair(900, EN | EN_N, OSSI);
        tim.write(CR2, cr2, 0).unwrap();
        first(&tim)
    };
    assert_eq!(idle(1 << 8), (Held(true), Held(false)));
    assert_eq!(idle(1 << 9), (Held(false), Held(true)));
    assert_eq!(idle(3 << 8), (Held(false), Held(false)));
}

#[test]
fn polarity_inverts_the_pin() {
    let tim = pair(900, EN | 2 | EN_N | 8, MOE | OSSR | 36);
    // High while the side is off.
    assert_eq!(first(&tim), (Gate::Pwm { rise: 900, high: 1836 }, Gate::Pwm { rise: 2700, high: 1836 }));
    assert_eq!(first(&pair(900, EN | 8, MOE | OSSR)).1, Gate::Held(true));
}

#[test]
fn forced_and_frozen_modes_hold_their_level() {
    use Gate::Held;
    let forced = |mode: u32| {
        let mut tim = pair(900, EN | EN_N, MOE | 36);
        tim.write(CCMR1, mode << 4, 0).unwrap();
        first(&tim)
    };
    assert_eq!(forced(5), (Held(true), Held(false)));
    assert_eq!(forced(4), (Held(false), Held(true)));
    // Frozen at the level of the reference: below 900 first.
    assert_eq!(forced(0), (Held(true), Held(false)));
    assert_eq!(forced(7).0, Gate::Pwm { rise: 936, high: 1764 });
    let mut tim = pair(900, EN | EN_N, MOE | 36);
    tim.write(CR1, CENTRE, 1000 * CLOCK).unwrap();
    assert_eq!(first(&tim), (Held(false), Held(true)), "it stands at 1000");
    assert_eq!(tim.next_event(), NEVER);
}

#[test]
fn only_gate_changes_are_reported() {
    let mut tim = pair(900, EN | EN_N, MOE | 36);
    for (register, value, changes) in [
        (CCR1, 900, false),
        (CCR1, 901, true),
        (SR, 0, false),
        (CCER, EN, true),
        (CCR4, 5, false),
        (BDTR, 0, true),
    ] {
        tim.gates_changed = false;
        tim.write(register, value, 0).unwrap();
        assert_eq!(tim.gates_changed, changes, "{register:#x}");
    }
}
