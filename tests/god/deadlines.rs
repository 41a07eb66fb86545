//! Longest times from a command to its prompt, and motors whose boards refuse an order.

use god::command::{self, GclCommand};
use hil_sim::node::Node;
use servo_core::mode::Mode;

use super::Session;
use super::movement::assert_near;

/// Speed of a tip in TC and TO, counts/s: it follows its link by velocity at 13/49 of MCV's and MOV's 1000.
const TIP_ALONG: u64 = 265;

/// Homing speed IVEL, counts/s.
const HOMING: u64 = 200;

/// Droop of the proportional velocity loop under friction, counts/s: 63 torque units (decision 0003) divided by KPV's gain of 2.
const DROOP: u64 = 32;

/// The joints' ranges, hall counts (manual table 1): link, spread, tip.
const LINK: u64 = 363;
const SPREAD: u64 = 166;
const TIP: u64 = 508;

/// Longest move, ms, a tip's over its whole range: 2·√(distance/acceleration) with an acceleration of (ACCEL/1024)² counts/ms² (decision
/// 0002). No range is long enough to reach MV. A link takes 976 ms and the spread 880 ms.
const MOVE_MS: u64 = triangle_ms(TIP, 30);

/// GOD's own time, ms: five questions to a silent board, three times 60 ms each, and 100 ms for brake (30 ms), waking (26 ms) and answers.
const OWN_MS: u64 = 5 * 3 * 60 + 100;

/// Longest time in which a motor that refuses an order or has a fault ends its share of a command, us.
pub const SHARE_US: u64 = 100_000;

/// Longest time from ^C or a disconnect to the prompt, us: up to three properties, each with three questions of 60 ms to a silent board.
pub const ABORT_US: u64 = 600_000;

/// 2·√(distance/acceleration), rounded up.
const fn triangle_ms(counts: u64, accel: u64) -> u64 {
    2 * (counts * 1024 * 1024).isqrt() / accel + 1
}

/// Longest time of a command, us: TSTOP (ms) and travel of each stage, and GOD's own time. TSTOP 0 has no bound.
pub fn command_us(line: &str, tstop_ms: u64) -> u64 {
    let word = line.split(' ').next().unwrap_or_default();
    // The longest end of the word that is a command: the rest is its prefix.
    let command = (0..word.len()).find_map(|start| command::find(&word[start..])).expect("a command");
    let (stages, travel_ms) = match command {
        // Links to their stops and IOFF 25 back, then tips to theirs and 350 back; the spread is faster. Each goes 12 counts
        // from its stop and back to it, and stalls again.
        GclCommand::Hi => (
            4,
            (LINK + 24) * 1000 / (HOMING - DROOP)
                + triangle_ms(25, 40)
                + (TIP + 24) * 1000 / (HOMING - DROOP)
                + triangle_ms(350, 30),
        ),
        // A tip whose link breaks away continues to its own goal.
        GclCommand::C => (2, 2 * MOVE_MS),
        GclCommand::Tc | GclCommand::To => (1, TIP * 1000 / (TIP_ALONG - DROOP)),
        GclCommand::T => (0, 0),
        _ => (1, MOVE_MS),
    };
    // HI stalls for 250 ms at least (decision 0009).
    1000 * (stages * tstop_ms.max(250) + travel_ms + OWN_MS)
}

const _: () = assert!(MOVE_MS > triangle_ms(LINK, 40) && MOVE_MS > triangle_ms(SPREAD, 30));

/// Lines before the command, the command, its answer, and its longest time, us, if that is not [`command_us`].
type Refused = (&'static [&'static str], &'static str, &'static str, Option<u64>);

/// Orders that a board refuses, and two that it accepts.
const REFUSED: &[Refused] = &[
    // At 25 °C: OverTemperature, so not initialized.
    (&["WAKE", "1 S OTEMP 250"], "HI", "ERR 8196", None),
    (&["WAKE", "1 S OTEMP 250"], "X1HI", "ERR 8196", Some(SHARE_US)),
    (&["HI", "1 S IVEL 0"], "HI", "ERR 4", None),
    (&["HI", "1 S IVEL 0"], "X1HI", "ERR 4", Some(SHARE_US)),
    (&["HI", "4 S MODE 2"], "SC", "", None),
    (&["HI", "4 S MODE 0"], "SC", "", None),
    (&["HI", "4 S OTEMP 250"], "SC", "ERR 8192", Some(SHARE_US)),
    (&["HI", "4 S MODE 2", "4 S MODE 0", "4 S OTEMP 250"], "SC", "ERR 8192", Some(SHARE_US)),
];

#[test]
fn refused_order_ends_with_a_status() {
    let mut wrong = Vec::new();
    for (before, line, expected, within_us) in REFUSED {
        let mut session = Session::new();
        for line in *before {
            session.run(line);
        }
        let within_us = within_us.unwrap_or_else(|| command_us(line, 400));
        match session.try_run(line, within_us) {
            Ok((answer, us)) if answer == *expected => {
                println!(
                    "figure: deadlines: {before:?}, {line}: {answer:?} after {} ms, bound {} ms",
                    us / 1000,
                    within_us / 1000
                );
            }
            Ok((answer, _)) => wrong.push(format!("{before:?}, {line}: {answer:?}, expected {expected:?}")),
            Err(hang) => wrong.push(format!("{before:?}: {hang}")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn refused_homing_leaves_the_others_initialized() {
    for refusal in ["1 S OTEMP 250", "1 S IVEL 0"] {
        let mut session = Session::new();
        session.run("WAKE");
        session.run(refusal);
        session.run("HI");
        assert_eq!(session.run("X234567M 1000"), "", "{refusal}");
        assert_near(&session, [0, 18, 18, 18, 18, 18, 18], refusal);
    }
}

/// Delays between a stop and the next ^C, us: the orders of the first stop take about 1 ms to leave.
const REPEAT_US: [u64; 8] = [50, 100, 200, 300, 500, 800, 1500, 3000];

fn assert_stopped(session: &mut Session, what: &str) {
    session.try_read_to_prompt(500_000).expect("a prompt");
    // A board in mode 4 without a host would give up by itself 500 ms after its last frame.
    session.wait_us(100_000);
    let mode = |node: &Node| node.application().map(|tater| tater.status().mode);
    let stopped =
        session.hand.bus().stations().all(|node| matches!(mode(node), Some(Mode::Idle | Mode::Pid)));
    assert!(stopped, "{what}: {}", session.motors());
}

/// A hand `us` after a ^C in the middle of a move.
fn aborted_move(us: u64) -> Session {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    session.type_line("M 15000");
    session.wait_us(300_000);
    session.hand.push_rx(b"\x03");
    session.wait_us(us);
    session
}

#[test]
fn second_abort_keeps_the_stop_orders_of_the_first() {
    for us in REPEAT_US {
        let mut session = aborted_move(us);
        session.hand.push_rx(b"\x03");
        assert_stopped(&mut session, &format!("M, ^C again after {us} us"));
    }
}

#[test]
fn abort_of_the_next_line_keeps_the_stop_orders_of_the_last() {
    for us in REPEAT_US {
        let mut session = aborted_move(us);
        session.hand.push_rx(b"FGET P\r");
        session.wait_us(50);
        session.hand.push_rx(b"\x03");
        assert_stopped(&mut session, &format!("M, a line and ^C after {us} us"));
    }
}

#[test]
fn abort_after_a_disconnect_in_loop_keeps_its_stop_orders() {
    for us in REPEAT_US {
        let mut session = Session::new();
        assert_eq!(session.run("HI"), "");
        assert!(session.start("X1234567LOOP").ends_with('*'));
        session.hand.push_rx(&[&b"c"[..], &[20, 32].repeat(7)].concat());
        session.wait_us(100_000);
        session.hand.hang_up();
        session.wait_us(us);
        session.hand.push_rx(b"\x03");
        assert_stopped(&mut session, &format!("LOOP, disconnect, ^C after {us} us"));
    }
}

/// ^C before T's orders leaves the motors pressing, ^C after them finds them off. None may press without GOD's keep-alives.
#[test]
fn abort_after_terminate_abandons_no_motor() {
    for us in [50, 500, 1000, 2000, 3000, 3500, 4000, 4500, 5000, 6000] {
        let mut session = Session::new();
        assert_eq!(session.run("HI"), "");
        assert_eq!(session.run("FSET HOLD 1"), "");
        assert_eq!(session.run("TO"), "");
        session.type_line("XGST");
        session.wait_us(us);
        session.hand.push_rx(b"\x03");
        session.try_read_to_prompt(500_000).expect("a prompt");
        session.wait_us(700_000);
        let fault = |node: &Node| node.application().and_then(|tater| tater.status().fault);
        let lost = session.hand.bus().stations().any(|node| fault(node).is_some());
        assert!(!lost, "T, ^C after {us} us: {}", session.motors());
    }
}
