//! What is refused, and that nothing moves then.

use god::Memory;
use god::memory::Stored;

use super::{Session, assert_near, counts, initialized, status};
use servo_core::mode::Mode;

#[test]
fn words_that_are_wrong() {
    let mut session = initialized();
    let before = counts(&session);
    for (line, answer) in [
        // Nobody: X alone, a number that is no motor, fingers or spread where only the others can.
        ("XM 1000", "ERR 2"),
        ("XHI", "ERR 2"),
        ("XT", "ERR 2"),
        ("5M 1000", "ERR 2"),
        ("SWM 1000", "ERR 2"),
        ("X5WM 1000", "ERR 2"),
        ("SPTM 1000", "ERR 2"),
        ("X124PTM 1000", "ERR 2"),
        // Numbers.
        ("M 20001", "ERR 128"),
        ("M -1", "ERR 128"),
        ("IO -1", "ERR 128"),
        ("IO 20001", "ERR 128"),
        ("IC -1", "ERR 128"),
        ("IC 20001", "ERR 128"),
        ("WM -1", "ERR 128"),
        ("WM 20001", "ERR 128"),
        ("PTM -20001", "ERR 128"),
        ("PTM 20001", "ERR 128"),
        ("M 1.5", "ERR 128"),
        ("M FAR", "ERR 128"),
        // 243 degrees of a link are 32744 counts, 244 are more than any position.
        ("1MDEG 244", "ERR 128"),
        ("X5MDEG -306", "ERR 128"),
        ("1MPER 181", "ERR 128"),
        ("1MDEG 9223372036854775807", "ERR 128"),
        // More than they take.
        ("M 1 2", "ERR 1024"),
        ("MDEG 1 2", "ERR 1024"),
        ("C 1", "ERR 1024"),
        ("O 1", "ERR 1024"),
        ("HI 1", "ERR 1024"),
        ("HOME 0", "ERR 1024"),
        ("TC 1", "ERR 1024"),
        ("TO 1", "ERR 1024"),
        ("T 1", "ERR 1024"),
    ] {
        assert_eq!(session.line(line), answer, "{line}");
        assert_eq!(counts(&session), before, "{line}");
    }
}

#[test]
fn what_is_not_initialized_does_not_move_but_is_switched_off() {
    let mut session = Session::new();
    for line in ["C", "O", "M 1000", "1HOME", "SIC", "GWM", "X5PTM", "TC", "STO", "LOOP", "T"] {
        assert_eq!(session.line(line), "ERR 4", "{line}");
    }
    assert_eq!(counts(&session), [0; 7]);
    // One finger.
    assert_eq!(session.line("2HI"), "");
    assert_eq!(session.line("2M 5500"), "");
    assert_near(&session, [0, 100, 0, 0, 0, 27, 0], "finger 2");
    let before = counts(&session);
    assert_eq!(session.line("12M 1000"), "ERR 4", "one that is not, and none moves");
    assert_eq!(session.line("X6PTM 1000"), "ERR 4", "which way, only the spread knows");
    assert_eq!(counts(&session), before);
    assert_eq!(session.line("2T"), "");
    assert_eq!(session.line("T"), "ERR 4");
}

#[test]
fn a_hand_hotter_than_otemp_does_not_move() {
    let mut stored = Stored::default();
    stored.parameters.hand.otemp = 450;
    let mut session = Session::with(Memory::new(stored));
    session.hand.io().set_temperature(450);
    assert_eq!(session.line("HI"), "", "as hot as that is not hotter");
    assert_eq!(session.line("STC"), "");
    assert_eq!(status(&mut session, 4).mode, Mode::Velocity, "it presses");
    session.hand.io().set_temperature(451);
    let before = counts(&session);
    for line in ["HI", "M 1000", "C", "TC", "GPTM 100", "12WM", "LOOP", "T"] {
        assert_eq!(session.line(line), "ERR 8192", "{line}");
    }
    assert_eq!(counts(&session), before);
    assert_eq!(status(&mut session, 4).mode, Mode::Idle, "T has switched it off all the same");
    // -551: any temperature.
    let mut session = initialized();
    session.hand.io().set_temperature(1250);
    assert_eq!(session.line("1M 1000"), "");
    // The manual's example is 6 °C: no hand in use is that cold.
    let mut session = initialized();
    assert_eq!(session.line("PSET OTEMP 60"), "");
    assert_eq!(session.line("1M 1000"), "ERR 8192");
}

#[test]
fn a_board_that_does_not_answer() {
    let mut session = initialized();
    session.hand.bus_mut().cut(1, true);
    let before = counts(&session);
    for line in ["M 5500", "2M 5500", "12M 5500", "X2C", "TC", "LOOP", "HI"] {
        assert_eq!(session.line(line), "ERR 1", "{line}");
        assert_eq!(counts(&session), before, "{line}");
    }
    // Without it they go; and T reaches those that it reaches.
    assert_eq!(session.line("13M 5500"), "");
    assert_near(&session, [100, 0, 100, 0, 27, 0, 27], "fingers 1 and 3");
    assert_eq!(session.line("STC"), "");
    assert_eq!(session.line("T"), "ERR 1");
    assert_eq!(status(&mut session, 4).mode, Mode::Idle);
    // The link of a finger answers, its tip does not.
    session.hand.bus_mut().cut(1, false);
    session.hand.bus_mut().cut(4, true);
    assert_eq!(session.line("1M 0"), "ERR 1");
    assert_eq!(session.line("X1M 0"), "");
    // Both: a board that is away, and a motor that is not initialized.
    super::node(&mut session, 3).power_off();
    super::node(&mut session, 3).power_on();
    assert_eq!(session.line("GM 0"), "ERR 5");
}
