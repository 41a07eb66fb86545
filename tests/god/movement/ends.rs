//! Ends of motions and their status (manual 5.5).

use god::Memory;
use god::memory::Stored;
use servo_core::mode::Mode;
use tater_wire::Property;

use super::super::{Exchange, assert_answers};
use super::{
    Session, abort, assert_near, config, counts, initialized, node, run_until, set, telemetry, wait_until,
    with_object,
};

#[test]
fn control_c_holds_or_idles_each_motor_by_hold() {
    let mut session = initialized();
    set(&mut session, 6, Property::HOLD, 1);
    run_until(&mut session, "C", |session| counts(session)[0] > 100);
    let from = counts(&session);
    assert_eq!(abort(&mut session), "\r\n\rERR 16384\r\n\r=> ");
    session.wait_us(300_000);
    let at = counts(&session);
    for motor in 1..=7 {
        let mode = if matches!(motor, 4 | 6) { Mode::Pid } else { Mode::Idle };
        assert_eq!(telemetry(&mut session, motor).mode, mode, "{motor}");
        assert_eq!(config(&mut session, motor).mv, 1000, "{motor}");
        let place = usize::from(motor) - 1;
        // At some 600 counts/s a rotor without power coasts about 20 counts.
        assert!((0..40).contains(&(at[place] - from[place])), "{motor}: {from:?} {at:?}");
    }
    assert_eq!(session.run("O"), "");
    assert_near(&session, [0; 7], "O");
}

#[test]
fn control_c_restores_bt_and_ends_torque_control() {
    let mut session = initialized();
    run_until(&mut session, "X1M 18000", |session| counts(session)[0] > 50);
    assert_eq!(config(&mut session, 1).bt, 0);
    assert!(abort(&mut session).contains("ERR 16384"));
    assert_eq!(config(&mut session, 1).bt, 400);
    run_until(&mut session, "STC", |session| counts(session)[3] > 50);
    assert!(abort(&mut session).contains("ERR 16384"));
    assert_eq!(telemetry(&mut session, 4).mode, Mode::Pid);
    // ^C at the prompt aborts nothing; the spread keeps holding.
    assert_eq!(session.run("SM 5500"), "");
    assert!(!abort(&mut session).contains("ERR"));
    assert_eq!(telemetry(&mut session, 4).mode, Mode::Pid);
}

#[test]
fn tc_with_hold_presses_after_the_prompt() {
    let mut session = initialized();
    assert_eq!(session.run("STC"), "");
    // Longer than HOSTMS, 2 s, each.
    for _ in 0..2 {
        session.wait_us(2_100_000);
        assert_eq!(telemetry(&mut session, 4).mode, Mode::Velocity);
        assert_eq!(telemetry(&mut session, 4).fault, None);
    }
    assert_eq!(session.run("1M 1000"), "", "others can move meanwhile");
    assert_eq!(telemetry(&mut session, 4).mode, Mode::Velocity);
    for _ in 0..20 {
        assert_eq!(session.run(""), "");
        session.wait_us(100_000);
    }
    assert_eq!(telemetry(&mut session, 4).mode, Mode::Velocity);
    assert_eq!(session.run("ST"), "");
    assert_eq!(telemetry(&mut session, 4).mode, Mode::Idle);
    let frames = session.hand.bus().stats().frames;
    session.wait_us(1_000_000);
    assert_eq!(session.hand.bus().stats().frames, frames, "no keep-alives are left");
}

/// 0 is what Barrett's hosts write for "no limit"; at rest the gauge reads 128.
#[test]
fn strain_limit_of_0_ends_no_motion_and_one_below_the_gauge_ends_each() {
    let mut session = initialized();
    for line in ["FSET HSG 0 LSG 0", "C", "M 5500", "MPER 20", "GWM 5500", "O"] {
        assert_eq!(session.run(line), "", "{line}");
    }
    assert_near(&session, [0; 7], "O");
    assert_eq!(session.run("1FSET HSG 100"), "");
    // C and O do not say that they have not arrived.
    for (line, answer) in [("1M 5500", "ERR 16"), ("1MPER 30", "ERR 16"), ("1C", ""), ("1O", "")] {
        assert_eq!(session.run(line), answer, "{line}");
        assert_near(&session, [0; 7], line);
    }
}

fn prepare_grip_beside_slow_motor(session: &mut Session) {
    for line in ["X12FSET HOLD 1", "X1M 18000", "X2FSET MCV 60"] {
        assert_eq!(session.run(line), "", "{line}");
    }
}

#[test]
fn tc_motor_that_ends_first_presses_until_the_last_ends() {
    let mut session = initialized();
    prepare_grip_beside_slow_motor(&mut session);
    assert_eq!(session.run("X12TC"), "");
    for motor in [1, 2] {
        assert_eq!(telemetry(&mut session, motor).mode, Mode::Velocity, "{motor}");
    }
}

#[test]
fn control_c_during_tc_leaves_ended_motors_pressing() {
    let mut session = initialized();
    prepare_grip_beside_slow_motor(&mut session);
    run_until(&mut session, "X12TC", |session| counts(session)[1] > 100);
    assert!(abort(&mut session).contains("ERR 16384"));
    session.wait_us(2_000_000);
    assert_eq!((telemetry(&mut session, 1).mode, telemetry(&mut session, 1).fault), (Mode::Velocity, None));
    assert_eq!(telemetry(&mut session, 2).mode, Mode::Pid);
    // Without HOLD there are no keep-alives.
    assert_eq!(session.run("X1FSET HOLD 0"), "");
    assert_eq!(session.run("X1M 11000"), "");
    run_until(&mut session, "X12TC", |session| telemetry(session, 1).mode == Mode::Velocity);
    wait_until(&mut session, "its end", |session| telemetry(session, 1).mode == Mode::Idle);
    session.wait_us(10_000);
    assert!(abort(&mut session).contains("ERR 16384"));
    session.wait_us(500_000);
    let frames = session.hand.bus().stats().frames;
    session.wait_us(1_000_000);
    assert_eq!(session.hand.bus().stats().frames, frames);
}

#[test]
fn grip_survives_disconnect() {
    let mut session = initialized();
    assert_eq!(session.run("STC"), "");
    assert_eq!(abort(&mut session), "\r\n\r=> ");
    session.hand.hang_up();
    session.wait_us(3_000_000);
    assert_eq!((telemetry(&mut session, 4).mode, telemetry(&mut session, 4).fault), (Mode::Velocity, None));
}

#[test]
fn obstacle_is_err_16_for_position_commands_only() {
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
        assert_eq!(session.run(line), answer, "{line}");
    }
}

/// A hand whose motor 4 has MPE `as_set` in GOD (GCL counts) and `halls` in its board.
fn with_mpe(as_set: i32, halls: i64) -> Session {
    let mut stored = Stored::default();
    stored.parameters.motors[3].as_set[3] = as_set;
    let mut session = Session::with_memory(Memory::new(stored));
    assert_eq!(session.run("SHI"), "");
    set(&mut session, 4, Property::MPE, halls);
    session
}

/// GOD judges MPE in GCL counts; the board judges its own in hall counts, where 0 means the exact count.
#[test]
fn mpe_is_judged_in_gcl_counts() {
    for (as_set, halls, line, answer) in [
        // Hall count 100 is 5500; 27 off is the same hall count.
        (27, 0, "SM 5527", ""),
        (26, 0, "SM 5527", "ERR 16"),
        (0, 0, "SM 5500", ""),
        (-1, 0, "SM 5500", "ERR 16"),
        (-32_767, 0, "SM 5500", "ERR 16"),
        // Another host has set the board's since: 4 counts are 220.
        (-1, 4, "SM 5500", ""),
        (0, 4, "SM 5527", ""),
    ] {
        let mut session = with_mpe(as_set, halls);
        assert_eq!(session.run(line), answer, "MPE {as_set}, {halls}: {line}");
    }
}

/// Lines with a permanently low supply of motor 2. C never gives ERR 16.
pub const LOW_BUS: &[Exchange] = &[("GM 5500", "ERR 16"), ("2C", "ERR 8")];

#[test]
fn faults_are_reported_once_and_cleared_by_the_next_command() {
    let mut session = initialized();
    node(&mut session, 2).rig_mut().set_bus(10.0);
    session.wait_us(50_000);
    assert!(telemetry(&mut session, 2).fault.is_some());
    assert_answers(&mut session, &LOW_BUS[..1]);
    assert_near(&session, [100, 0, 100, 0, 27, 27, 27], "the others");
    assert_answers(&mut session, &LOW_BUS[1..]);
    node(&mut session, 2).rig_mut().set_bus(24.0);
    assert_eq!(session.run("GM 0"), "", "the supply is back");
    assert_near(&session, [0; 7], "GM 0");
    set(&mut session, 3, Property::OTEMP, 200);
    assert_eq!(session.run("GM 5500"), "ERR 8208");
    assert_eq!(session.run("3C"), "ERR 8192");
    set(&mut session, 3, Property::OTEMP, 700);
    assert_eq!(session.run("GM 0"), "");
}

#[test]
fn board_lost_in_mid_motion_is_err_1_and_others_finish() {
    let mut session = initialized();
    run_until(&mut session, "GM 16500", |session| counts(session)[0] > 50);
    session.hand.bus_mut().cut(1, true);
    assert!(session.read_to_prompt().contains("ERR 1\r"));
    // No stop order reaches it, so it finishes its move alone.
    assert_near(&session, [300, 300, 300, 0, 80, 80, 80], "GM");
    session.hand.bus_mut().cut(1, false);
    assert_eq!(session.run("GM 0"), "");
    assert_near(&session, [0; 7], "GM 0");
}

#[test]
fn lost_end_report_delays_the_prompt_60_ms_at_most() {
    let mut session = initialized();
    run_until(&mut session, "SM 5500", |session| counts(session)[3] > 5);
    set(&mut session, 4, Property::LFLAGS, 0);
    let mut ended = None;
    wait_until(&mut session, "its end", |session| {
        if telemetry(session, 4).mode == Mode::Pid {
            ended = ended.or(Some(session.hand.now_us()));
        }
        session.hand.take_tx().ends_with(b"=> ")
    });
    // GOD polls it every 50 ms, and judges in a few more.
    let late_us = session.hand.now_us() - ended.expect("it ended");
    assert!(late_us <= 60_000, "{late_us} us");
}
