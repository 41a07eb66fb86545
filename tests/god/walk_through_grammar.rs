//! The walk-through grammar (manual 3; decision 0029).

use servo_core::mode::Mode;
use tater_wire::{Message, Node, Property};

use super::{Exchange, Session, assert_answers};

pub const LINES: &[Exchange] = &[
    // A sleeping board answers STAT, but not TEMP.
    ("1 G STAT", "1 STAT=0"),
    ("1 G TEMP", "ERR 1"),
    ("4 S M 5", "ERR 1"),
    ("4 S CMD 18", "ERR 1"),
    ("WAKE", ""),
    ("123 G TEMP", "1 TEMP=350\n2 TEMP=350\n3 TEMP=350"),
    ("31 g temp", "1 TEMP=350\n3 TEMP=350"),
    ("12GACCEL", "1 ACCEL=40\n2 ACCEL=40"),
    ("4 G AP", "4 P=0"),
    ("4 G M", "4 MODE=0"),
    ("4 S M 0", ""),
    ("4SM0", ""),
    ("1 G STATUS", "1 STAT=2"),
    ("1SSTATUS2", ""),
    ("7 S MT 550", ""),
    ("7 G MT", "7 MT=550"),
    ("567 S X0 12", ""),
    ("5SX013", ""),
    ("567GX0", "5 X0=13\n6 X0=12\n7 X0=12"),
    ("5 S E-85", ""),
    ("5 G E", "5 E=-85"),
    ("1 G FROB", "ERR 64"),
    ("1 S FROB 1", "ERR 64"),
    ("1 S", "ERR 64"),
    ("1 S E", "ERR 128"),
    ("1 S E x", "ERR 128"),
    ("1 S E 40000", "ERR 128"),
    ("1 S E 1 2", "ERR 1024"),
    ("1 G E P", "ERR 1024"),
    ("1 S TEMP 1", "ERR 256"),
    ("1 G CMD", "ERR 128"),
    ("8 G P", "ERR 2"),
    ("1F", "ERR 32"),
    ("0 G REPLY", "0 REPLY=0"),
    ("0 G TEMP", "ERR 64"),
    ("01 G REPLY", "ERR 64"),
    ("0 S REPLY 2", "ERR 128"),
    ("0 S REPLY 0", ""),
    ("SAVE", ""),
];

#[test]
fn walk_through_lines_have_their_answers() {
    assert_answers(&mut Session::new(), LINES);
}

fn unsolicited(session: &mut Session) -> String {
    session.read_to_prompt().replace("\r\n\r", "\n")
}

/// Manual 3, step 11: the spread reports that it has ended its move and holds.
#[test]
fn end_of_motion_is_reported_between_lines() {
    let mut session = Session::new();
    assert_answers(&mut session, &[("WAKE", ""), ("4 S E 82", ""), ("4 S M 5", "")]);
    assert_eq!(unsolicited(&mut session), "\n4 MODE=3\n=> ");
    assert_eq!(session.run("4 G P"), "4 P=82");
    assert_answers(&mut session, &[("4 S E 40", ""), ("1 S E 20", ""), ("14 SM5", "")]);
    session.hand.push_rx(b"4 G");
    session.wait_us(3_000_000);
    session.hand.push_rx(b" M\r");
    // Links hold too, whatever HOLD is (decision 0069).
    assert_eq!(unsolicited(&mut session), "4 G M\n4 MODE=3\n=> \n1 MODE=3\n=> \n4 MODE=3\n=> ");
    // Only motions that this grammar started are reported, each once.
    let node = Node::new(4).expect("the spread");
    session.hand.io().push_frame(&Message::reply(node, Property::MODE, 3).expect("it fits").frame());
    session.wait_us(10_000);
    assert_eq!(session.hand.take_tx(), b"");
}

/// Moves the first link there or back by this grammar, and types a question whose line end is sent `at_us` after the order. Returns what the hand
/// prints until it has reported the end of the move, or for 100 ms more.
fn move_and_ask(session: &mut Session, there: bool, question: &str, at_us: u64) -> String {
    assert_answers(session, &[(if there { "1 S E 6" } else { "1 S E 0" }, ""), ("1 S M 5", "")]);
    let begun_us = session.hand.now_us();
    session.hand.push_rx(question.as_bytes());
    session.wait_us(begun_us + at_us - session.hand.now_us());
    session.hand.push_rx(b"\r");
    let mut text = String::new();
    for _ in 0..100 {
        session.wait_us(1_000);
        text.extend(session.hand.take_tx().into_iter().map(char::from));
        if text.ends_with(END_REPORT) {
            break;
        }
    }
    text
}

/// The report of the end after a prompt, and the prompt after it.
const END_REPORT: &str = "=> \r\n\r1 MODE=3\r\n\r=> ";

/// The time from the order until the board has ended the move, us.
fn move_us(session: &mut Session, there: bool) -> u64 {
    assert_answers(session, &[(if there { "1 S E 6" } else { "1 S E 0" }, ""), ("1 S M 5", "")]);
    let begun_us = session.hand.now_us();
    while mode(session, 1) != Mode::Pid {
        session.wait_us(100);
    }
    let taken_us = session.hand.now_us() - begun_us;
    unsolicited(session);
    taken_us
}

/// Board and host ask and report at the same moment: 240 of them, 100 us apart, before and after the end of a move. A board's answer must not be taken for
/// its report, nor the other way round.
#[test]
fn end_that_comes_during_a_g_mode_is_reported() {
    // A line end at 9600 baud and the question take some 6 ms.
    const EARLIER_US: u64 = 12_000;
    for question in ["1 G MODE", "1234567 G MODE"] {
        let mut session = Session::new();
        assert_answers(&mut session, &[("WAKE", "")]);
        let took_us = [true, false].map(|there| move_us(&mut session, there));
        let (mut moving, mut lost) = (0, Vec::new());
        for phase in 0..120 {
            let there = phase % 2 == 0;
            let at_us = took_us[usize::from(!there)] - EARLIER_US + 100 * phase;
            let text = move_and_ask(&mut session, there, question, at_us);
            moving += usize::from(text.contains("1 MODE=5"));
            if !text.ends_with(END_REPORT) {
                lost.push((phase, text));
            }
        }
        println!(
            "figure: {question}: {moving} of 120 before the end of the move; {} reports lost",
            lost.len()
        );
        assert_eq!(lost, [], "{question}");
        assert!((20..100).contains(&moving), "both sides of the end: {moving} of 120");
    }
}

/// OTEMP applies to this grammar too. Orders that end a motion are not refused.
#[test]
fn hot_hand_refuses_moves_of_the_walk_through() {
    let mut session = Session::new();
    session.hand.fix_temperature(Some(45.0));
    let rows = [
        ("WAKE", ""),
        ("PSET OTEMP 449", ""),
        ("4 S E 82", ""),
        ("4 S M 5", "ERR 8192"),
        ("4 S CMD 18", "ERR 8192"),
        ("4 S CMD 21", ""),
        ("4 S MODE 0", ""),
        ("4 G E", "4 E=82"),
        ("PSET OTEMP 450", ""),
        ("4 S M 5", ""),
    ];
    assert_answers(&mut session, &rows);
    assert_eq!(unsolicited(&mut session), "\n4 MODE=3\n=> ");
}

#[test]
fn reply_1_answers_with_the_boards_frames() {
    let mut session = Session::new();
    assert_answers(
        &mut session,
        &[("WAKE", ""), ("0 S REPLY 1", ""), ("0 G REPLY", "0 REPLY=1"), ("4 S E 82", "")],
    );
    session.hand.push_rx(b"14 G TEMP\r");
    let mut received = Vec::new();
    for _ in 0..100 {
        session.wait_us(1000);
        received.extend(session.hand.take_tx());
    }
    // 0x406 | node << 5: to group 6. TEMP is 9; 350 is 0x15E.
    let expected = b"14 G TEMP\x04\x26\x04\x89\0\x5E\x01\x04\x86\x04\x89\0\x5E\x01\r\n\r=> ";
    assert_eq!(received, expected);
    received.clear();
    session.hand.push_rx(b"4 S M 5\r");
    for _ in 0..2000 {
        session.wait_us(1000);
        received.extend(session.hand.take_tx());
    }
    assert_eq!(received, b"4 S M 5\r\n\r=> \x04\x86\x04\x88\0\x03\0\r\n\r=> ", "MODE is 8");
    session.hand.push_rx(b"0 S REPLY 0\r");
    session.read_to_prompt();
    assert_answers(&mut session, &[("4 G TEMP", "4 TEMP=350")]);
}

/// Manual 3, step 17, with the spread holding: positions are still known after a power cycle.
#[test]
fn save_ends_holding_and_stores_positions_and_parameters() {
    let mut session = Session::new();
    assert_answers(&mut session, &[("WAKE", ""), ("1234567 S CMD 13", "")]);
    session.wait_us(10_000_000);
    session.hand.take_tx();
    assert_answers(&mut session, &[("4 S E 82", ""), ("4 S M 5", "")]);
    unsolicited(&mut session);
    assert_answers(
        &mut session,
        &[("1 S KP 61", ""), ("X1FSET CT 10010", ""), ("4 G M", "4 MODE=3"), ("SAVE", "")],
    );
    assert_eq!(session.run("4 G M"), "4 MODE=0");
    for node in 0..7 {
        let node = session.hand.bus_mut().station_mut(node).expect("seven");
        node.power_off();
        node.power_on();
    }
    session.wait_us(100_000);
    assert_answers(
        &mut session,
        &[("WAKE", ""), ("4 G P", "4 P=82"), ("1 G KP", "1 KP=61"), ("X1FGET CT", "10010")],
    );
    session.hand.bus_mut().cut(2, true);
    assert_answers(&mut session, &[("SAVE", "ERR 1"), ("WAKE", "ERR 1")]);
}

fn mode(session: &Session, motor: usize) -> Mode {
    let node = session.hand.bus().stations().nth(motor - 1).expect("1 to 7");
    node.application().expect("it is awake").status().mode
}

const START_MOVES: &[Exchange] = &[("WAKE", ""), ("4 S E 150", ""), ("1 S E 300", ""), ("14 S M 5", "")];

/// Manual 5.5, case 3. A host that has disconnected cannot end the motion, so the disconnect does.
#[test]
fn control_c_and_disconnect_end_motions_of_the_walk_through() {
    let ends: [fn(&mut Session); 3] = [
        |session| session.hand.push_rx(b"\x03"),
        |session| session.hand.hang_up(),
        |session| {
            session.start("WAIT 3000");
            session.hand.push_rx(b"\x03");
        },
    ];
    for (number, end) in ends.into_iter().enumerate() {
        let mut session = Session::new();
        assert_answers(&mut session, START_MOVES);
        session.wait_us(100_000);
        assert_eq!(mode(&session, 4), Mode::Trapezoidal);
        end(&mut session);
        assert_eq!(session.read_to_prompt(), "\r\n\rERR 16384\r\n\r=> ", "{number}");
        session.wait_us(100_000);
        assert_eq!((mode(&session, 4), mode(&session, 1)), (Mode::Pid, Mode::Idle), "{number}");
        assert_eq!(session.hand.take_tx(), b"", "no further report: {number}");
        session.hand.push_rx(b"\x03");
        assert_eq!(session.read_to_prompt(), "\r\n\r=> ", "nothing moves");
        assert_eq!(mode(&session, 4), Mode::Pid, "a holding motor keeps holding");
    }
}

/// Clients read to the first prompt, so a later report would confuse them.
#[test]
fn command_that_takes_over_a_motor_suppresses_its_end_report() {
    for line in ["4M 1000", "4T", "4LOOP"] {
        let mut session = Session::new();
        assert_answers(&mut session, &[("HI", ""), ("4 S E 150", ""), ("4 S M 5", "")]);
        let answer = if line == "4LOOP" { session.run_with_input(line, b"\x03") } else { session.run(line) };
        assert_eq!(answer, if line == "4LOOP" { "*" } else { "" });
        session.wait_us(3_000_000);
        session.hand.bus_mut().station_mut(3).expect("the spread").rig_mut().set_bus(10.0);
        session.wait_us(100_000);
        assert_eq!(session.hand.take_tx(), b"", "{line}");
    }
}

#[test]
fn order_replacing_a_motion_reports_only_its_own_end() {
    let mut session = Session::new();
    assert_answers(&mut session, &[("WAKE", ""), ("4 S E 150", ""), ("4 S M 5", ""), ("WAIT 60", "")]);
    assert_answers(&mut session, &[("4 S CMD 13", "")]);
    assert_eq!(unsolicited(&mut session), "\n4 MODE=3\n=> ");
    let node = session.hand.bus().stations().nth(3).expect("the spread");
    assert!(node.application().expect("it is awake").status().homed);
}

#[test]
fn grip_replaced_by_an_order_gets_no_keepalives() {
    // A refused order, such as T, leaves the grip, which needs no host (decision 0013).
    let cases: [&[&str]; 7] = [
        &["1 S MODE 0", "1 S V -100", "1 S MODE 4"],
        &["1 S MODE 0"],
        &["1 S V -100"],
        &["1 S CMD 18"],
        &["1 S CMD 21"],
        &["1 S STAT 0"],
        &["SAVE"],
    ];
    for lines in cases {
        let mut session = Session::new();
        assert_answers(&mut session, &[("HI", ""), ("1FSET HOLD 1", ""), ("X1TC", "")]);
        for line in lines {
            assert_answers(&mut session, &[(line, "")]);
        }
        assert_answers(&mut session, &[("WAIT 3000", "")]);
        let node = session.hand.bus().stations().next().expect("a link");
        let steered = node.application().is_some_and(|tater| tater.status().mode == Mode::Velocity);
        assert!(!steered, "{lines:?}");
        session.wait_us(100_000);
        let frames = session.hand.bus().stats().frames;
        session.wait_us(1_000_000);
        assert_eq!(session.hand.bus().stats().frames, frames, "{lines:?}");
    }
}

#[test]
fn grip_survives_questions_and_settings() {
    let mut session = Session::new();
    assert_answers(&mut session, &[("HI", ""), ("1FSET HOLD 1", ""), ("X1TC", "")]);
    assert_answers(
        &mut session,
        &[("1 S KP 61", ""), ("1 S STAT 2", ""), ("1 S CMD 1", ""), ("WAIT 3000", "")],
    );
    assert_eq!(session.run("1 G MODE"), "1 MODE=4");
}

#[test]
fn wake_needs_stat_2() {
    let mut session = Session::new();
    assert_answers(&mut session, &[("WAKE", "")]);
    session.hand.bus_mut().cut(1, true);
    session.hand.push_rx(b"WAKE\r");
    session.wait_us(1000);
    let node = Node::new(2).expect("a board");
    session.hand.io().push_frame(&Message::reply(node, Property::STAT, 1).expect("it fits").frame());
    assert!(session.read_to_prompt().contains("ERR 1\r"));
}
