//! Longest times from a command to its prompt, and motors whose boards refuse an order.

use hil_torture::deadline::command_us;
use hil_world::node::Node;
use servo_core::mode::Mode;
use tater_fw::Tater;

use super::Session;
use super::movement::assert_near;

/// Longest time in which a motor that refuses an order or has a fault ends its share of a command, us.
pub const SHARE_US: u64 = 100_000;

/// Longest time from ^C or a disconnect to the prompt, us: up to three properties, each with three questions of 60 ms to a silent board.
pub const ABORT_US: u64 = 600_000;

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
        let within_us = within_us.unwrap_or_else(|| command_us(line, 400).expect("a command"));
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
    // Shorter than HOSTMS, after which a board in mode 4 would give up by itself.
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

/// HOSTMS of a board on which nothing has been set (docs/properties.md), and a tenth of a second, us.
const HOST_LOST_US: u64 = 2_000_000 + 100_000;

/// Whether ^C comes before T's orders have left or after them: every motor that pressed is off, and GOD sends no more keep-alives. A motor
/// left pressing would go on for ever: one that TO has started needs no host (decision 0013).
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
        // Behind the orders of the stop.
        session.wait_us(100_000);
        let before = session.hand.bus().stats().frames;
        session.wait_us(HOST_LOST_US);
        let frames = session.hand.bus().stats().frames - before;
        let status = |node: &Node| node.application().map(Tater::status);
        let mut found = session.hand.bus().stations().filter_map(status);
        let are_off = found.all(|status| status.mode == Mode::Idle && status.fault.is_none());
        assert!(are_off && frames == 0, "T, ^C after {us} us: {frames} frames; {}", session.motors());
    }
}
