//! Packets of the host, in every state of GOD (docs/wire.md, decision 0055).

use hil_world::hand::serial::Serial;
use servo_core::mode::Mode;
use tater_wire::{Destination, Frame, Group, Message, Node, Property};

use super::{Exchange, Session, assert_answers};

/// More than the silence that ends a packet, us.
const SILENCE_US: u64 = 25_000;

fn node(number: u8) -> Destination {
    Destination::Node(Node::new(number).expect("a node"))
}

fn packet(frame: &Frame) -> Vec<u8> {
    [&frame.raw_id().to_be_bytes()[..], &[frame.data().len() as u8], frame.data()].concat()
}

fn get(to: Destination, property: Property) -> Vec<u8> {
    packet(&Message::get(to, property).frame())
}

fn set(to: Destination, property: Property, value: i64) -> Vec<u8> {
    packet(&Message::set(to, property, value).expect("it fits").frame())
}

fn awake(lines: &[Exchange]) -> Session {
    let mut session = Session::new();
    assert_answers(&mut session, &[("WAKE", "")]);
    assert_answers(&mut session, lines);
    session
}

impl Session {
    /// Sends bytes at once and returns what comes within `us`.
    fn exchange(&mut self, bytes: &[u8], us: u64) -> Vec<u8> {
        self.hand.push_rx(bytes);
        let end_us = self.hand.now_us() + us;
        let mut received = Vec::new();
        while self.hand.now_us() < end_us {
            self.wait_us(1000);
            received.extend(self.hand.take_tx());
        }
        received
    }

    fn exchange_text(&mut self, bytes: &[u8], us: u64) -> String {
        String::from_utf8_lossy(&self.exchange(bytes, us)).replace("\r\n\r", "|")
    }
}

fn mode(session: &Session, motor: usize) -> Mode {
    let node = session.hand.bus().stations().nth(motor - 1).expect("1 to 7");
    node.application().expect("it is awake").status().mode
}

#[test]
fn packet_is_obeyed_without_echo_answer_or_prompt() {
    let mut session = awake(&[]);
    assert_eq!(session.exchange(&set(node(4), Property::MT, 555), SILENCE_US), b"");
    assert_eq!(session.run("4 G MT"), "4 MT=555");
    let all = Destination::Group(Group::TATERS);
    assert_eq!(session.exchange(&set(all, Property::MT, 444), SILENCE_US), b"");
    assert_eq!(session.run("37 G MT"), "3 MT=444\n7 MT=444");
}

#[test]
fn answers_return_as_text_or_as_packets() {
    let mut session = awake(&[]);
    let all = Destination::Group(Group::TATERS);
    assert_eq!(session.exchange_text(&get(node(4), Property::TEMP), SILENCE_US), "|4 TEMP=350");
    assert_eq!(session.exchange_text(&get(node(4), Property::P), SILENCE_US), "|4 P=0");
    let each: String = (1..=7).map(|number| format!("|{number} STAT=2")).collect();
    assert_eq!(session.exchange_text(&get(all, Property::STAT), SILENCE_US), each);
    assert_answers(&mut session, &[("0 S REPLY 1", "")]);
    // 0x406 | node << 5, to group 6; TEMP is 9, 350 is 0x15E. P goes to group 3.
    let answer = session.exchange(&get(node(4), Property::TEMP), SILENCE_US);
    assert_eq!(answer, b"\x04\x86\x04\x89\0\x5E\x01");
    assert_eq!(session.exchange(&get(node(4), Property::P), SILENCE_US), b"\x04\x83\x03\x80\0\0");
    assert_eq!(session.exchange(&get(all, Property::STAT), SILENCE_US).len(), 7 * 7);
}

/// What a host gets for bytes that are no packet, at the latest 25 ms later.
const BROKEN: &[(&[u8], &str)] = &[
    // A NUL alone, or a serial line's break to a port that cannot tell.
    (b"\x00", ""),
    (b"\x04", ""),
    (b"\x04\x04", "|ERR 128|=> "),
    (b"\x00\x01\x04\x85\x00\x02", "|ERR 128|=> "),
    // Nine data bytes; none of what follows is read.
    (b"\x00\x01\x09FGET P\r\x00\x01\x01\x05", "|ERR 128|=> "),
    (b"\x00\x01\xFF", "|ERR 128|=> "),
    // The identifier of a board, node 1: behind 0x00 it is text.
    (b"\x00\x41\x01\x05\r", "A|ERR 128|=> "),
    (b"\x04\x26\x04\x85\x00\x02\x00", "|ERR 128|=> "),
    // No data, an unknown property, a board that is not there: frames that nobody answers.
    (b"\x00\x01\x00", ""),
    (b"\x00\x01\x01\x71", ""),
    (b"\x00\x1F\x01\x05", ""),
    // Not at the start of a line: a line with control characters.
    (b"C\x00\x01\x01\x05\x7F\r", "C\x08 \x08|ERR 128|=> "),
    (b"C\x00\x7F\r", "C\x08 \x08|=> "),
    // ^C in a packet that breaks off or has a wrong length, and ahead of GOD's reading a packet.
    (b"\x00\x01\x09\x00\x03", "|=> "),
    (b"\x00\x01\x09\x03\x00", "|=> "),
    (b"\x00\x03\x09", "|=> "),
    (b"\x00\x03", "|=> "),
    (b"\x04\x04\x04\x88\x03\x00", "|=> "),
    (b"\x00\x01\x01\x05\x03", "|=> "),
    (b"\x00\x01\x01\x05\r", "|1 STAT=2|=> "),
];

#[test]
fn bytes_that_are_no_packet_have_a_defined_result() {
    for &(bytes, expected) in BROKEN {
        let mut session = awake(&[]);
        assert_eq!(session.exchange_text(bytes, SILENCE_US), expected, "{bytes:02X?}");
        // The next line and the next packet are read as such.
        assert_answers(&mut session, &[("1 G MODE", "1 MODE=0")]);
        assert_eq!(
            session.exchange_text(&get(node(1), Property::MODE), SILENCE_US),
            "|1 MODE=0",
            "{bytes:02X?}"
        );
    }
}

/// Every split of a packet: whole if the pause is shorter than 20 ms, broken if it is longer. Then a 0x03 before the pause was ^C.
#[test]
fn pause_of_20_ms_breaks_a_packet() {
    let bytes = set(node(1), Property::MT, 3 * 256 + 3);
    for split in 1..bytes.len() {
        let broken = match &bytes[..split] {
            [_] => "",
            with_abort if with_abort.contains(&3) => "|=> ",
            _ => "|ERR 128|=> ",
        };
        for (pause_us, expected) in [(19_000, ""), (21_000, broken)] {
            let mut session = awake(&[]);
            let before = session.exchange_text(&bytes[..split], pause_us);
            assert_eq!(before, if pause_us < 20_000 { "" } else { expected }, "{split}");
            let rest = session.exchange(&bytes[split..], SILENCE_US);
            session.exchange(b"\r", SILENCE_US);
            let whole = session.run("1 G MT") == "1 MT=771";
            assert_eq!(whole, pause_us < 20_000, "{split}: {rest:?}");
        }
    }
}

/// 0x03 in a packet is no ^C, while a command runs and at the prompt; the packet waits for the command's end.
#[test]
fn packet_waits_for_a_command_and_does_not_abort_it() {
    let mut session = awake(&[]);
    let bytes = [set(node(1), Property::MT, 3), get(node(1), Property::MT)].concat();
    assert!(bytes.contains(&3));
    session.type_line("WAIT 500");
    assert_eq!(session.exchange_text(&bytes, 400_000), "WAIT 500");
    assert_eq!(session.exchange_text(b"", 200_000), "|=> |1 MT=3");
    // ^C drops it with the rest of the type-ahead.
    session.type_line("WAIT 500");
    session.exchange(&set(node(1), Property::MT, 300), 100_000);
    assert_eq!(session.exchange_text(b"\x03", 100_000), "|ERR 16384|=> ");
    assert_eq!(session.run("1 G MT"), "1 MT=3");
}

/// An answer is not lost to a command typed right behind the packet.
#[test]
fn answers_precede_the_next_command() {
    let mut session = awake(&[]);
    for line in ["1 G MODE", "FGET P", "PGET TEMP"] {
        let bytes =
            [&get(Destination::Group(Group::TATERS), Property::STAT)[..], line.as_bytes(), b"\r"].concat();
        let text = session.exchange_text(&bytes, 400_000);
        assert_eq!(text.matches("STAT=2").count(), 7, "{text}");
        assert!(text.ends_with("|=> "), "{text}");
    }
    // A board that is not there delays the line by 60 ms at most.
    session.hand.push_rx(&get(node(9), Property::STAT));
    assert!(session.try_run("PGET LFT", 62_000).is_ok());
}

/// What boards still answer to a command that ^C has ended is no news for the host: nothing follows the prompt.
#[test]
fn answers_to_an_aborted_command_are_not_passed_on() {
    let mut session = awake(&[]);
    assert_eq!(session.exchange_text(&get(node(4), Property::P), SILENCE_US), "|4 P=0");
    for after_us in (0..8_000).step_by(20) {
        session.hand.push_rx(b"FGET P\r");
        session.wait_us(after_us);
        let text = session.exchange_text(b"\x03", 100_000);
        assert!(text.ends_with("|=> "), "{after_us} us: {text}");
    }
}

#[test]
fn packet_passes_during_a_motion_of_the_walk_through() {
    let mut session = awake(&[("4 S E 150", ""), ("4 S M 5", "")]);
    assert_eq!(session.exchange_text(&get(node(4), Property::MODE), SILENCE_US), "|4 MODE=5");
    assert_eq!(session.exchange_text(&get(node(4), Property::END), SILENCE_US), "|4 END=0");
    // The end is reported as ever.
    assert_eq!(session.exchange_text(b"", 3_000_000), "|4 MODE=3|=> ");
}

/// In LOOP all bytes are the loop's.
#[test]
fn packet_in_loop_is_a_bad_header() {
    let mut session = awake(&[("HI", "")]);
    session.start("4LOOP");
    assert_eq!(session.exchange_text(&set(node(1), Property::MT, 333), 50_000), "|ERR 2048|=> ");
    assert_eq!(session.run("1 G MT"), "1 MT=750");
    // Behind ^C a packet is one again.
    session.start("4LOOP");
    let bytes = [b"\x03", &set(node(1), Property::MT, 333)[..]].concat();
    assert_eq!(session.exchange_text(&bytes, 50_000), "|=> ");
    assert_eq!(session.run("1 G MT"), "1 MT=333");
}

#[test]
fn packet_to_a_sleeping_board_is_the_monitors() {
    let mut session = Session::new();
    assert_eq!(session.exchange_text(&get(node(1), Property::STAT), SILENCE_US), "|1 STAT=0");
    assert_eq!(session.exchange(&set(node(1), Property::MT, 333), SILENCE_US), b"", "ignored");
    assert_eq!(session.exchange(&set(node(1), Property::STAT, 2), 1_100_000), b"");
    assert_eq!(session.exchange_text(&get(node(1), Property::STAT), SILENCE_US), "|1 STAT=2");
}

#[test]
fn packet_on_a_dead_bus_is_err_1() {
    let mut session = awake(&[]);
    cut(&mut session, true);
    // Three wait in the CAN controller, and the fourth in GOD until it takes the bus for dead.
    (0..4).for_each(|_| assert_eq!(session.exchange_text(&set(node(1), Property::MT, 333), 5_000), ""));
    assert_eq!(session.exchange(b"", 50_000), b"");
    (0..2).for_each(|_| {
        assert_eq!(session.exchange_text(&set(node(1), Property::MT, 333), 65_000), "|ERR 1|=> ");
    });
    assert_eq!(session.exchange_text(b"\r", 50_000), "|=> ");
    cut(&mut session, false);
    // No stale frame leaves; the next packet passes.
    assert_eq!(session.exchange(&set(node(2), Property::MT, 222), SILENCE_US), b"");
    assert_eq!(session.run("12 G MT"), "1 MT=750\n2 MT=222");
}

/// An order to move does not wait in the CAN controller for a bus that comes back.
#[test]
fn order_to_move_on_a_dead_bus_is_withdrawn() {
    for (property, value) in [(Property::M, 100), (Property::MODE, 3), (Property::CMD, 18)] {
        let mut session = awake(&[]);
        cut(&mut session, true);
        assert_eq!(session.exchange_text(&set(node(4), property, value), 250_000), "|ERR 1|=> ");
        cut(&mut session, false);
        session.wait_us(500_000);
        assert_eq!(mode(&session, 4), Mode::Idle, "{property:?}");
    }
}

fn cut(session: &mut Session, cut: bool) {
    (0..7).for_each(|board| session.hand.bus_mut().cut(board, cut));
}

#[test]
fn packet_is_not_recorded() {
    let mut session = awake(&[("REC 1", ""), ("1 G MODE", "1 MODE=0")]);
    assert_eq!(session.exchange(&set(node(1), Property::MT, 333), SILENCE_US), b"");
    assert_answers(
        &mut session,
        &[("REC", ""), ("1 S MT 750", ""), ("PLAY 1", "1 MODE=0"), ("1 G MT", "1 MT=750")],
    );
}

#[test]
fn half_a_packet_and_a_disconnect_leave_nothing() {
    let bytes = set(node(1), Property::MT, 333);
    for split in 1..bytes.len() {
        let mut session = awake(&[]);
        session.hand.push_rx(&bytes[..split]);
        session.hand.hang_up();
        assert_eq!(session.exchange_text(b"", SILENCE_US), "|=> ", "{split}");
        assert_answers(&mut session, &[("1 G MT", "1 MT=750")]);
    }
}

#[test]
fn reply_1_does_not_outlive_its_host() {
    for (end, reply) in [
        (&(|session: &mut Session| session.hand.hang_up()) as &dyn Fn(&mut Session), 0),
        (&|session: &mut Session| session.hand.push_rx(b"\x03"), 1),
    ] {
        let mut session = awake(&[("0 S REPLY 1", "")]);
        session.exchange(&get(node(1), Property::STAT), SILENCE_US);
        end(&mut session);
        session.read_to_prompt();
        assert_eq!(session.run("0 G REPLY"), format!("0 REPLY={reply}"));
    }
    // In the middle of a command too.
    let mut session = awake(&[("0 S REPLY 1", "")]);
    session.start("WAIT 5000");
    session.hand.hang_up();
    session.read_to_prompt();
    assert_eq!(session.run("0 G REPLY"), "0 REPLY=0");
    // Nor does the passing of frames.
    session.exchange(&get(node(1), Property::STAT), SILENCE_US);
    session.hand.hang_up();
    session.read_to_prompt();
    let frame =
        Message::reply(Node::new(4).expect("the spread"), Property::TEMP, 3).expect("it fits").frame();
    session.hand.io().push_frame(&frame);
    assert_eq!(session.exchange(b"", 10_000), b"");
}

/// Manual 5.5, case 3, for motions that packets have started: one by node, one by a group.
#[test]
fn control_c_and_disconnect_end_motions_of_packets() {
    for (to, property, value) in [
        (node(4), Property::M, 150),
        (Destination::Group(Group::LOW), Property::M, 150),
        (node(4), Property::CMD, 18),
    ] {
        for hangs_up in [false, true] {
            let mut session = awake(&[]);
            session.exchange(&set(to, property, value), 150_000);
            assert!(!matches!(mode(&session, 4), Mode::Idle | Mode::Pid), "{property:?}");
            if hangs_up {
                session.hand.hang_up()
            } else {
                session.hand.push_rx(b"\x03")
            }
            assert_eq!(session.read_to_prompt(), "\r\n\rERR 16384\r\n\r=> ", "{property:?}");
            session.wait_us(100_000);
            assert_eq!((mode(&session, 4), mode(&session, 1)), (Mode::Pid, Mode::Idle), "{property:?}");
        }
    }
}

#[test]
fn hot_hand_refuses_packets_that_move() {
    let mut session = awake(&[("PSET OTEMP 60", "")]);
    assert_eq!(session.exchange_text(&set(node(4), Property::M, 100), SILENCE_US), "|ERR 8192|=> ");
    assert_eq!(session.exchange_text(&set(node(4), Property::MODE, 0), SILENCE_US), "");
    assert_eq!(mode(&session, 4), Mode::Idle);
}

/// A grip that GOD keeps alive becomes the host's when a packet orders its motor.
#[test]
fn grip_replaced_by_a_packet_gets_no_keepalives() {
    let mut session = awake(&[("HI", ""), ("1FSET HOLD 1", ""), ("X1TC", "")]);
    session.exchange(&set(node(1), Property::T, 10), SILENCE_US);
    // Its board loses its host then, and reports the end.
    session.wait_us(3_000_000);
    let frames = session.hand.bus().stats().frames;
    session.wait_us(1_000_000);
    assert_eq!(session.hand.bus().stats().frames, frames);
}

/// The serial line sets the pace: 7 bytes a SET, 4 bytes a GET and 7 its answer, of 260 us each (docs/wire.md states these).
#[test]
fn packets_keep_up_with_38400_baud() {
    let mut session = awake(&[("PSET BAUD 384", ""), ("0 S REPLY 1", "")]);
    let mut line = Serial::new(true);
    let mut rate = |bytes: Vec<u8>, count: usize| {
        let begin_us = session.hand.now_us();
        let frames = session.hand.bus().stats().frames;
        (0..count).for_each(|_| line.put(&bytes, &mut session.hand));
        let mut heard = Vec::new();
        while session.hand.bus().stats().frames < frames + count as u64 {
            let now_us = session.hand.now_us();
            assert!(now_us < begin_us + 5_000_000, "{} frames", session.hand.bus().stats().frames - frames);
            line.run_until(&mut session.hand, now_us + 500, &mut heard, 1 << 16);
        }
        assert_eq!((session.hand.io().lost_bytes(), session.hand.io().lost_frames()), (0, 0));
        count as f64 * 1e6 / (session.hand.now_us() - begin_us) as f64
    };
    let sets = rate(set(node(1), Property::MT, 333), 500);
    let long = rate(packet(&Frame::from_raw(1, &[0x41; 8]).expect("a frame")), 300);
    println!("figure: packets at 38400 baud: {sets:.0} SETs/s of 7 bytes, {long:.0}/s of 11 bytes");
    // 3840 bytes a second; the first packet's frame and the last poll cost under 2 %.
    assert!(sets > 0.97 * 3840.0 / 7.0 && long > 0.97 * 3840.0 / 11.0, "{sets} {long}");
}

/// MODE 5 that a host orders itself, by a line or by a packet, ends in mode 3 whatever HOLD is (manual 3, step 11); GCL's motion commands and CMD
/// apply HOLD (manual 5.3.4).
#[test]
fn mode_5_of_a_host_holds_and_gcl_applies_hold() {
    for (hold, after) in [(0, Mode::Idle), (1, Mode::Pid)] {
        let mut session = awake(&[("HI", "")]);
        assert_eq!(session.run(&format!("SFSET HOLD {hold}")), "");
        assert_answers(&mut session, &[("4 S E 82", ""), ("4 S M 5", "")]);
        assert_eq!(session.read_to_prompt(), "\r\n\r4 MODE=3\r\n\r=> ", "HOLD {hold}");
        let order = [set(node(4), Property::E, 40), set(node(4), Property::MODE, 5)].concat();
        assert_eq!(session.exchange_text(&order, 3_000_000), "|4 MODE=3|4 END=1", "HOLD {hold}");
        assert_eq!(mode(&session, 4), Mode::Pid, "HOLD {hold}");
        for line in ["SM 550", "SC", "SO", "SIC 500", "SHOME", "SMDEG 20", "SMPER 30"] {
            assert_eq!(session.run(line), "", "{line}");
            assert_eq!(mode(&session, 4), after, "{line} with HOLD {hold}");
        }
        // O by CMD.
        assert_answers(&mut session, &[("4 S CMD 20", "")]);
        let report = if hold == 0 { "\r\n\r4 MODE=0\r\n\r=> " } else { "\r\n\r4 MODE=3\r\n\r=> " };
        assert_eq!(session.read_to_prompt(), report, "CMD with HOLD {hold}");
    }
}
