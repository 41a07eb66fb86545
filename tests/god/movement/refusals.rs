//! Refused commands move nothing.

use god::Memory;
use god::memory::Stored;

use super::{Session, assert_near, counts, initialized, telemetry};
use servo_core::mode::Mode;

#[test]
fn invalid_lines_are_refused_and_move_nothing() {
    let mut session = initialized();
    let before = counts(&session);
    for (line, answer) in [
        // No motor: X alone, a digit that selects nothing, WM of a spread or tip, PTM of a link or spread.
        ("XM 1000", "ERR 2"),
        ("XHI", "ERR 2"),
        ("XT", "ERR 2"),
        ("5M 1000", "ERR 2"),
        ("SWM 1000", "ERR 2"),
        ("X5WM 1000", "ERR 2"),
        ("SPTM 1000", "ERR 2"),
        ("X124PTM 1000", "ERR 2"),
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
        // 243 degrees of a link are 32744 counts; 244 exceed the largest position.
        ("1MDEG 244", "ERR 128"),
        ("X5MDEG -306", "ERR 128"),
        ("1MPER 181", "ERR 128"),
        ("1MDEG 9223372036854775807", "ERR 128"),
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
        assert_eq!(session.run(line), answer, "{line}");
        assert_eq!(counts(&session), before, "{line}");
    }
}

#[test]
fn uninitialized_motor_does_not_move_but_t_switches_it_off() {
    let mut session = Session::new();
    for line in ["C", "O", "M 1000", "1HOME", "SIC", "GWM", "X5PTM", "TC", "STO", "LOOP", "T"] {
        assert_eq!(session.run(line), "ERR 4", "{line}");
    }
    assert_eq!(counts(&session), [0; 7]);
    assert_eq!(session.run("2HI"), "");
    assert_eq!(session.run("2M 5500"), "");
    assert_near(&session, [0, 100, 0, 0, 0, 27, 0], "finger 2");
    let before = counts(&session);
    assert_eq!(session.run("12M 1000"), "ERR 4", "motor 1 is not initialized, so none moves");
    assert_eq!(session.run("X6PTM 1000"), "ERR 4", "the spread's position decides the direction");
    assert_eq!(counts(&session), before);
    assert_eq!(session.run("2T"), "");
    assert_eq!(session.run("T"), "ERR 4");
}

#[test]
fn hand_hotter_than_otemp_does_not_move() {
    let mut stored = Stored::default();
    stored.parameters.hand.otemp = 450;
    let mut session = Session::with_memory(Memory::new(stored));
    session.hand.fix_temperature(Some(45.0));
    assert_eq!(session.run("HI"), "", "the limit itself is allowed");
    assert_eq!(session.run("STC"), "");
    assert_eq!(telemetry(&mut session, 4).mode, Mode::Velocity, "it presses");
    session.hand.fix_temperature(Some(45.1));
    let before = counts(&session);
    for line in ["HI", "M 1000", "C", "TC", "GPTM 100", "12WM", "LOOP", "T"] {
        assert_eq!(session.run(line), "ERR 8192", "{line}");
    }
    assert_eq!(counts(&session), before);
    assert_eq!(telemetry(&mut session, 4).mode, Mode::Idle, "T switches it off nevertheless");
    // OTEMP -551 allows any temperature.
    let mut session = initialized();
    session.hand.fix_temperature(Some(125.0));
    assert_eq!(session.run("1M 1000"), "");
    // The manual's example is 6 °C, below any hand in use.
    let mut session = initialized();
    assert_eq!(session.run("PSET OTEMP 60"), "");
    assert_eq!(session.run("1M 1000"), "ERR 8192");
}

#[test]
fn missing_board_is_err_1() {
    let mut session = initialized();
    session.hand.bus_mut().cut(1, true);
    let before = counts(&session);
    for line in ["M 5500", "2M 5500", "12M 5500", "X2C", "TC", "LOOP", "HI"] {
        assert_eq!(session.run(line), "ERR 1", "{line}");
        assert_eq!(counts(&session), before, "{line}");
    }
    assert_eq!(session.run("13M 5500"), "");
    assert_near(&session, [100, 0, 100, 0, 27, 0, 27], "fingers 1 and 3");
    assert_eq!(session.run("STC"), "");
    assert_eq!(session.run("T"), "ERR 1");
    assert_eq!(telemetry(&mut session, 4).mode, Mode::Idle);
    session.hand.bus_mut().cut(1, false);
    session.hand.bus_mut().cut(4, true);
    assert_eq!(session.run("1M 0"), "ERR 1");
    assert_eq!(session.run("X1M 0"), "");
    // A missing board and a motor that is not initialized add up.
    super::node(&mut session, 3).power_off();
    super::node(&mut session, 3).power_on();
    assert_eq!(session.run("GM 0"), "ERR 5");
}
