//! How motions end, and what is told of that (manual 5.5).

use god::Memory;
use god::memory::Stored;
use servo_core::mode::Mode;
use tater_wire::Property;

use super::super::tables::{Row, exercise};
use super::{
    Session, abort, assert_near, config, counts, initialized, line_until, node, set, status, until,
    with_object,
};

#[test]
fn control_c_ends_every_motor_as_hold_says() {
    let mut session = initialized();
    set(&mut session, 6, Property::HOLD, 1);
    line_until(&mut session, "C", |session| counts(session)[0] > 100);
    let from = counts(&session);
    assert_eq!(abort(&mut session), "\r\n\rERR 16384\r\n\r=> ");
    session.wait_us(300_000);
    let at = counts(&session);
    for motor in 1..=7 {
        let mode = if matches!(motor, 4 | 6) { Mode::Pid } else { Mode::Idle };
        assert_eq!(status(&mut session, motor).mode, mode, "{motor}");
        assert_eq!(config(&mut session, motor).mv, 1000, "{motor}");
        let place = usize::from(motor) - 1;
        // At some 600 counts/s a rotor without power coasts 20 counts or so.
        assert!((0..40).contains(&(at[place] - from[place])), "{motor}: {from:?} {at:?}");
    }
    // And on.
    assert_eq!(session.line("O"), "");
    assert_near(&session, [0; 7], "O");
}

#[test]
fn control_c_gives_bt_back_and_ends_torque_control() {
    let mut session = initialized();
    line_until(&mut session, "X1M 18000", |session| counts(session)[0] > 50);
    assert_eq!(config(&mut session, 1).bt, 0);
    assert!(abort(&mut session).contains("ERR 16384"));
    assert_eq!(config(&mut session, 1).bt, 400);
    line_until(&mut session, "STC", |session| counts(session)[3] > 50);
    assert!(abort(&mut session).contains("ERR 16384"));
    assert_eq!(status(&mut session, 4).mode, Mode::Pid);
    // At the prompt no command goes on, and what it has left holding holds.
    assert_eq!(session.line("SM 5500"), "");
    assert!(!abort(&mut session).contains("ERR"));
    assert_eq!(status(&mut session, 4).mode, Mode::Pid);
}

#[test]
fn what_presses_with_hold_goes_on_pressing() {
    let mut session = initialized();
    assert_eq!(session.line("STC"), "");
    // The board gives up on a host that is silent for 500 ms.
    for _ in 0..5 {
        session.wait_us(600_000);
        assert_eq!(status(&mut session, 4).mode, Mode::Velocity);
        assert_eq!(status(&mut session, 4).fault, None);
    }
    assert_eq!(session.line("1M 1000"), "", "and others move meanwhile");
    assert_eq!(status(&mut session, 4).mode, Mode::Velocity);
    // Whatever the host types, and however often.
    for _ in 0..20 {
        assert_eq!(session.line(""), "");
        session.wait_us(100_000);
    }
    assert_eq!(status(&mut session, 4).mode, Mode::Velocity);
    assert_eq!(session.line("ST"), "");
    assert_eq!(status(&mut session, 4).mode, Mode::Idle);
    let frames = session.hand.bus().stats().frames;
    session.wait_us(1_000_000);
    assert_eq!(session.hand.bus().stats().frames, frames, "then nobody is asked any more");
}

/// A grip of motor 1, while motor 2 closes for 5 s more.
fn grips_while_another_closes(session: &mut Session) {
    for line in ["X12FSET HOLD 1", "X1M 18000", "X2FSET MCV 60"] {
        assert_eq!(session.line(line), "", "{line}");
    }
}

#[test]
fn who_ends_long_before_the_last_presses_on() {
    let mut session = initialized();
    grips_while_another_closes(&mut session);
    assert_eq!(session.line("X12TC"), "");
    for motor in [1, 2] {
        assert_eq!(status(&mut session, motor).mode, Mode::Velocity, "{motor}");
    }
}

#[test]
fn control_c_leaves_who_has_ended_pressing() {
    let mut session = initialized();
    grips_while_another_closes(&mut session);
    line_until(&mut session, "X12TC", |session| counts(session)[1] > 100);
    assert!(abort(&mut session).contains("ERR 16384"));
    session.wait_us(2_000_000);
    assert_eq!((status(&mut session, 1).mode, status(&mut session, 1).fault), (Mode::Velocity, None));
    assert_eq!(status(&mut session, 2).mode, Mode::Pid);
    // Without HOLD nobody is asked any more.
    assert_eq!(session.line("X1FSET HOLD 0"), "");
    assert_eq!(session.line("X1M 11000"), "");
    line_until(&mut session, "X12TC", |session| status(session, 1).mode == Mode::Velocity);
    until(&mut session, "its end", |session| status(session, 1).mode == Mode::Idle);
    session.wait_us(10_000);
    assert!(abort(&mut session).contains("ERR 16384"));
    session.wait_us(500_000);
    let frames = session.hand.bus().stats().frames;
    session.wait_us(1_000_000);
    assert_eq!(session.hand.bus().stats().frames, frames);
}

#[test]
fn a_grip_outlasts_its_host() {
    let mut session = initialized();
    assert_eq!(session.line("STC"), "");
    assert_eq!(abort(&mut session), "\r\n\r=> ");
    session.hand.hang_up();
    session.wait_us(3_000_000);
    assert_eq!((status(&mut session, 4).mode, status(&mut session, 4).fault), (Mode::Velocity, None));
}

#[test]
fn what_stands_in_the_way_is_err_16_to_positions_only() {
    let mut session = with_object(4, 80.0);
    for (line, answer) in [
        ("SM 8000", "ERR 16"),
        ("SIC 2000", "ERR 16"),
        ("SMDEG 170", "ERR 16"),
        ("SMPER 90", "ERR 16"),
        ("SC", ""),
        ("STC", ""),
        ("SO", ""),
        ("SM 4000", ""),
        ("X4M 8000", "ERR 16"),
        ("SHOME", ""),
    ] {
        assert_eq!(session.line(line), answer, "{line}");
    }
}

/// A hand whose motor 4 has an MPE as it was set, and as its board has it.
fn with_mpe(as_set: i32, halls: i64) -> Session {
    let mut stored = Stored::default();
    stored.parameters.motors[3].as_set[3] = as_set;
    let mut session = Session::with(Memory::new(stored));
    assert_eq!(session.line("SHI"), "");
    set(&mut session, 4, Property::MPE, halls);
    session
}

/// MPE is judged in GCL counts. The board judges by its own, in hall counts: 0 is the very count.
#[test]
fn mpe_is_what_was_set() {
    for (as_set, halls, line, answer) in [
        // Hall count 100 is 5500; 27 off is the same hall count.
        (27, 0, "SM 5527", ""),
        (26, 0, "SM 5527", "ERR 16"),
        (0, 0, "SM 5500", ""),
        (-1, 0, "SM 5500", "ERR 16"),
        (-32_767, 0, "SM 5500", "ERR 16"),
        // Somebody else has set the board's since: 4 counts are 220.
        (-1, 4, "SM 5500", ""),
        (0, 4, "SM 5527", ""),
    ] {
        let mut session = with_mpe(as_set, halls);
        assert_eq!(session.line(line), answer, "MPE {as_set}, {halls}: {line}");
    }
}

/// With a supply of motor 2 that is too low, and stays so. C is never ERR 16.
pub const LOW_BUS: &[Row] = &[("GM 5500", "ERR 16"), ("2C", "ERR 8")];

#[test]
fn faults_are_told_as_far_as_there_is_a_code_and_forgotten_at_the_next_command() {
    let mut session = initialized();
    node(&mut session, 2).rig_mut().set_bus(10.0);
    session.wait_us(50_000);
    assert!(status(&mut session, 2).fault.is_some());
    exercise(&mut session, &LOW_BUS[..1]);
    assert_near(&session, [100, 0, 100, 0, 27, 27, 27], "the others");
    exercise(&mut session, &LOW_BUS[1..]);
    node(&mut session, 2).rig_mut().set_bus(24.0);
    assert_eq!(session.line("GM 0"), "", "it is over");
    assert_near(&session, [0; 7], "GM 0");
    // A motor at its temperature limit.
    set(&mut session, 3, Property::OTEMP, 200);
    assert_eq!(session.line("GM 5500"), "ERR 8208");
    assert_eq!(session.line("3C"), "ERR 8192");
    set(&mut session, 3, Property::OTEMP, 700);
    assert_eq!(session.line("GM 0"), "");
}

#[test]
fn a_board_that_falls_silent_keeps_nobody() {
    let mut session = initialized();
    line_until(&mut session, "GM 16500", |session| counts(session)[0] > 50);
    session.hand.bus_mut().cut(1, true);
    assert!(session.until_prompt().contains("ERR 1\r"));
    // Nothing reaches it: it has gone on alone.
    assert_near(&session, [300, 300, 300, 0, 80, 80, 80], "GM");
    session.hand.bus_mut().cut(1, false);
    assert_eq!(session.line("GM 0"), "");
    assert_near(&session, [0; 7], "GM 0");
}

#[test]
fn a_report_that_does_not_come_costs_little() {
    let mut session = initialized();
    line_until(&mut session, "SM 5500", |session| counts(session)[3] > 5);
    set(&mut session, 4, Property::LFLAGS, 0);
    let mut ended = None;
    until(&mut session, "its end", |session| {
        if status(session, 4).mode == Mode::Pid {
            ended = ended.or(Some(session.hand.now_us()));
        }
        session.hand.take_tx().ends_with(b"=> ")
    });
    // It is asked every 50 ms, and judged in a few more.
    let late_us = session.hand.now_us() - ended.expect("it ended");
    assert!(late_us <= 60_000, "{late_us} us");
}
