//! A dead bus: no board acknowledges, so GOD's frames stay in its queue. The host must still get a prompt in time.

use super::Session;
use super::movement::{counts, run_until};
use tater_wire::{Body, Message, Node, Property};

/// Longest time to the prompt with ERR 1, us: 40 ms until GOD takes the bus for dead, and up to seven questions of 60 ms (SAVE, FLISTV).
const DOWN_US: u64 = 500_000;

fn cut(session: &mut Session, cut: bool) {
    (0..7).for_each(|board| session.hand.bus_mut().cut(board, cut));
}

fn dead() -> Session {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    cut(&mut session, true);
    session
}

/// Time from the prompt to the bus's return, us: longer than the 40 ms for which GOD keeps a frame.
const STAYS_DEAD_US: u64 = 100_000;

/// Asserts that no stale order leaves. At most three frames may: the controller's mailboxes.
fn assert_nothing_stale(session: &mut Session, what: &str) {
    session.wait_us(STAYS_DEAD_US);
    session.hand.bus_mut().tap(true);
    cut(session, false);
    session.wait_us(2_000_000);
    let frames = std::iter::from_fn(|| session.hand.bus_mut().tapped());
    let sent = frames.filter_map(|stamped| Message::parse(&stamped.frame));
    let sent: Vec<Message> = sent.filter(|message| message.from == Node::HOST).collect();
    assert!(sent.len() <= 3 && !sent.iter().any(moves), "{what}: {sent:?}");
}

fn moves(message: &Message) -> bool {
    let Body::Set { property, value } = message.body else { return !matches!(message.body, Body::Get(_)) };
    let property = Property::of(property).expect("a property");
    match property {
        Property::V => property.read(value) != 0,
        Property::MODE => ![0, 3].contains(&property.read(value)),
        Property::M | Property::E | Property::P | Property::T | Property::CMD => true,
        _ => false,
    }
}

fn assert_works(session: &mut Session) {
    assert_eq!(session.run("HOME"), "");
    // HOME ends within MPE, 200.
    let places = session.run("FGET P");
    let at_home = |place: &str| place.parse::<i32>().is_ok_and(|place| place.abs() <= 200);
    assert!(places.split(' ').count() == 4 && places.split(' ').all(at_home), "{places}");
}

#[test]
fn bus_down_at_power_up_each_command_is_err_1() {
    for line in ["FGET P", "HI", "WAKE", "FSAVE", "M 1000", "LOOP", "T"] {
        let mut session = Session::new();
        cut(&mut session, true);
        let (answer, us) = session.try_run(line, DOWN_US).expect("bus down at power-up");
        println!("figure: bus down at power-up: {line}: {answer} after {} ms", us / 1000);
        assert_eq!(answer, "ERR 1", "{line}");
        assert_eq!(session.run("VERS"), "600");
        assert_nothing_stale(&mut session, line);
    }
}

#[test]
fn bus_down_at_the_prompt_each_command_is_err_1() {
    for line in
        ["FGET P", "FSET DS 7", "FLISTV", "HI", "C", "M 1000", "TC", "T", "MACSET 3", "LOOP", "SAVE", "1 G P"]
    {
        let mut session = dead();
        let (answer, us) = session.try_run(line, DOWN_US).expect("bus down at the prompt");
        println!("figure: bus down at the prompt: {line}: {answer} after {} ms", us / 1000);
        assert!(answer.ends_with("ERR 1"), "{line}: {answer}");
        assert_nothing_stale(&mut session, line);
        assert_works(&mut session);
    }
}

#[test]
fn bus_down_in_mid_motion_is_err_1() {
    for line in ["HI", "C", "M 9000", "MDEG 60", "MPER 60", "IC 3000", "WM 6000", "PTM 2000", "TC", "MAC 3"] {
        let mut session = Session::new();
        for line in ["HI", "M 4000", "MACSET 3", "M 1000"] {
            assert_eq!(session.run(line), "");
        }
        run_until(&mut session, line, |session| counts(session) != [18, 18, 18, 18, 5, 5, 5]);
        session.wait_us(50_000);
        cut(&mut session, true);
        let (received, us) = session.try_read_to_prompt(DOWN_US).expect("bus down in mid-motion");
        println!("figure: bus down in mid-motion: {line}: ERR 1 after {} ms", us / 1000);
        assert!(received.ends_with("ERR 1\r\n\r=> "), "{line}: {received:?}");
        assert_nothing_stale(&mut session, line);
        session.wait_us(3_000_000);
        assert_eq!(session.run("HI"), "");
        assert_works(&mut session);
    }
}

fn block(header: u8) -> Vec<u8> {
    [&[header][..], &[20, 32].repeat(7)].concat()
}

fn dead_in_loop() -> Session {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    assert!(session.start("X1234567LOOP").ends_with('*'));
    for _ in 0..10 {
        session.hand.push_rx(&block(b'c'));
        session.wait_us(10_000);
        assert_eq!(session.hand.take_tx(), b"*");
    }
    cut(&mut session, true);
    session
}

/// Time for which a client waits for the answer to a block, us (decision 0026).
const PATIENCE_US: u64 = 100_000;

#[test]
fn bus_down_in_loop_the_next_block_is_err_1() {
    for header in [b'C', b'c'] {
        let mut session = dead_in_loop();
        let mut received = String::new();
        let start_us = session.hand.now_us();
        while !received.ends_with("\n\r=> ") {
            assert!(
                session.hand.now_us() < start_us + DOWN_US,
                "no prompt, but {received:?}; {}",
                session.motors()
            );
            session.hand.push_rx(&block(header));
            session.wait_us(PATIENCE_US);
            received.extend(session.hand.take_tx().into_iter().map(char::from));
        }
        println!(
            "figure: bus down in LOOP, blocks {:?}: ERR 1 after {} ms",
            char::from(header),
            (session.hand.now_us() - start_us) / 1000
        );
        assert!(received.contains("\r\n\rERR 1\r\n\r=> "), "{received:?}");
        assert_nothing_stale(&mut session, "LOOP");
        session.hand.push_rx(b"\x03");
        session.try_read_to_prompt(DOWN_US).expect("^C");
        assert_works(&mut session);
    }
}

/// Blocks that fill every queue on the way to the bus.
const BLOCKS: usize = 20;

#[test]
fn bus_down_in_loop_control_c_disconnect_and_a_new_host_get_a_prompt() {
    for how in ["^C", "disconnect", "new host"] {
        let mut session = dead_in_loop();
        for _ in 0..BLOCKS {
            session.hand.push_rx(&block(b'c'));
        }
        session.wait_us(1_000);
        session.hand.take_tx();
        match how {
            "^C" => session.hand.push_rx(b"\x03\x03\x03"),
            "disconnect" => session.hand.hang_up(),
            _ => {
                session.hand.hang_up();
                session.hand.push_rx(b"\r");
            }
        }
        let (_, us) = session.try_read_to_prompt(DOWN_US).unwrap_or_else(|hang| panic!("{how}: {hang}"));
        println!("figure: bus down in LOOP: {how}: prompt after {} ms", us / 1000);
        session.wait_us(DOWN_US);
        session.hand.take_tx();
        assert_eq!(session.run("VERS"), "600", "{how}");
        assert_nothing_stale(&mut session, how);
        assert_works(&mut session);
    }
}

#[test]
fn bus_down_in_a_command_control_c_and_disconnect_get_a_prompt() {
    for line in ["HI", "M 9000", "TC", "FLISTV"] {
        for hangs_up in [false, true] {
            for wait_us in [0, 20_000, 100_000] {
                let mut session = dead();
                session.hand.push_rx(line.as_bytes());
                session.hand.push_rx(b"\r");
                session.wait_us(wait_us);
                session.hand.take_tx();
                if hangs_up {
                    session.hand.hang_up()
                } else {
                    session.hand.push_rx(b"\x03")
                }
                let (_, us) = session
                    .try_read_to_prompt(DOWN_US)
                    .unwrap_or_else(|hang| panic!("{line}, {wait_us} us, disconnect {hangs_up}: {hang}"));
                println!(
                    "figure: bus down, {line}, {wait_us} us, disconnect {hangs_up}: prompt after {} ms",
                    us / 1000
                );
                assert_nothing_stale(&mut session, line);
                assert_works(&mut session);
            }
        }
    }
}
