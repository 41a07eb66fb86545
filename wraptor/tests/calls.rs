//! Calls of a hand and of a bus, with progress, cancel and deadlines.

mod served;

use std::io::{Read, Write};
use std::net::TcpListener;
use std::ops::ControlFlow;
use std::thread;
use std::time::Duration;

use served::{HANGS, Served};
use wraptor::{
    Boards, Bus, CallError, Connect, Control, Deadline, Failure, Feedback, Format, Hand, Node, Property,
    no_progress,
};

fn fast() -> (Served, Hand) {
    let served = Served::fast_hand();
    let hand = Hand::connect(served.place("gcl"), HANGS).expect("connected");
    (served, hand)
}

fn failure<T: std::fmt::Debug>(result: Result<T, CallError>) -> Failure {
    let error = result.expect_err("it fails");
    let text = error.to_string();
    assert!(text.starts_with(error.call.trim_end()) && text.contains("\n  next: "), "{text}");
    error.failure
}

#[test]
fn hand_is_homed_moved_and_asked() {
    let (_served, mut hand) = fast();
    let unhomed = failure(hand.close("1", HANGS, &mut no_progress));
    assert!(matches!(unhomed, Failure::Status(status) if status.code() == 4), "{unhomed:?}");
    hand.init(HANGS, &mut no_progress).expect("homed");
    hand.move_to("12", 5500, HANGS, &mut no_progress).expect("moved");
    let positions = hand.parameter("12", "p", HANGS).expect("positions");
    // MPE is 200 GCL counts.
    assert!(positions.len() == 2 && positions.iter().all(|p| (5300..=5700).contains(p)), "{positions:?}");
    hand.close("G", HANGS, &mut no_progress).expect("closed");
    hand.open("G", HANGS, &mut no_progress).expect("open");
    hand.relax("G", HANGS).expect("off");
    assert!((0.0..60.0).contains(&hand.temperature(HANGS).expect("a temperature")));
    assert_eq!(hand.faults(HANGS).expect("they answer"), []);
    assert_eq!(hand.hand_parameter("baud", HANGS), Ok(96));
}

/// Limit of a call to a peer that keeps sending, and when it must be over.
const LIMIT: Duration = Duration::from_millis(300);
const OVER: Duration = Duration::from_millis(1300);

#[test]
fn flood_keeps_no_call_beyond_its_limit() {
    for flood in [&b"\r\n\r=> "[..], &[0], b"ERR 1\r\n", b"x", &[4, 0x85, 1, 1]] {
        let address = served::flooding(flood, false);
        let mut hand = Connect::tcp(&address).boards(Boards::Any).connect(HANGS).expect("like a hand");
        let calls: [fn(&mut Hand); 6] = [
            |hand| assert!(hand.set("4", Property::MT, 500, LIMIT).is_err()),
            |hand| assert!(hand.get("4", Property::P, LIMIT).is_err()),
            |hand| assert!(hand.save_nodes("4", LIMIT).is_err()),
            |hand| assert!(hand.find_zero("4", LIMIT, &mut no_progress).is_err()),
            |hand| assert!(hand.realtime("4", Format::default(), LIMIT).is_err()),
            // A packet, nothing, or too much text.
            |hand| _ = hand.receive(LIMIT),
        ];
        for (i, call) in calls.into_iter().enumerate() {
            let deadline = Deadline::after(OVER);
            call(&mut hand);
            assert!(!deadline.is_over(), "call {i}, {flood:?}: {:?}", deadline.elapsed());
        }
    }
}

#[test]
fn flood_of_an_adapter_keeps_no_call_beyond_its_limit() {
    for flood in [&b"t0851\r"[..], b"\r", b"\x07", b"x", b"V0100\r\r\r"] {
        let deadline = Deadline::after(OVER);
        if let Ok(mut bus) = Bus::slcan(&served::flooding(flood, true), LIMIT) {
            let deadline = Deadline::after(OVER);
            let _ = bus.receive(LIMIT);
            assert!(!deadline.is_over(), "receive, {flood:?}: {:?}", deadline.elapsed());
            let deadline = Deadline::after(OVER);
            assert!(bus.get(Node::new(4).expect("a node"), Property::P, LIMIT).is_err());
            assert!(!deadline.is_over(), "get, {flood:?}: {:?}", deadline.elapsed());
        } else {
            assert!(!deadline.is_over(), "{flood:?}: {:?}", deadline.elapsed());
        }
    }
}

/// A hand that is told nothing goes on: a move that a SET began, and a wait for its end. Read and waited for in vain, and read to its end.
#[test]
fn end_of_a_connection_stops_motors_and_end_of_a_wait_does_not() {
    let served = Served::hand();
    let connect = || Hand::connect(served.place("gcl"), HANGS).expect("connected");
    let mut hand = connect();
    for (property, value) in [
        (Property::MOV, 30),
        (Property::MCV, 30),
        (Property::MV, 30),
        (Property::E, 250),
        (Property::MODE, 5),
    ] {
        hand.set("1", property, value, HANGS).expect("set");
    }
    assert!(matches!(failure(hand.get("1", Property::P, Duration::from_nanos(1))), Failure::TimedOut(_)));
    let waits = hand.wait_for("1", Property::P, 250, Duration::from_millis(200), &mut no_progress);
    assert!(matches!(failure(waits), Failure::TimedOut(_)));
    assert_eq!(hand.get("1", Property::MODE, HANGS).expect("a mode")[0].1, 5);
    drop(hand);
    // A hand that is told nothing finishes what it does for 2 s, 60 counts.
    let place = connect().get("1", Property::P, HANGS).expect("a position")[0].1;
    assert!((1..40).contains(&place), "{place}");
}

/// A board that does not answer ends the wait for a move, and the others are told to stop. The hand is played: it answers no GET.
#[test]
fn move_that_cannot_be_watched_is_aborted() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address").to_string();
    let peer = thread::spawn(move || {
        let (mut host, _) = listener.accept().expect("a host");
        let (mut seen, mut line, mut byte) = (Vec::new(), Vec::new(), [0]);
        while matches!(host.read(&mut byte), Ok(1)) {
            seen.extend(byte);
            line.extend(byte);
            if byte[0] == b'\r' {
                let text = String::from_utf8_lossy(&line).trim().to_owned();
                let answer = if text == "VERS" { "\r\n\r600" } else { "" };
                let _ = host.write_all(format!("{text}{answer}\r\n\r=> ").as_bytes());
                line.clear();
            }
        }
        seen
    });
    let mut hand = Connect::tcp(&address).boards(Boards::Any).connect(HANGS).expect("connected");
    let silent = failure(hand.move_halls("1", 300, HANGS, &mut no_progress));
    assert!(matches!(silent, Failure::Silent(_)), "{silent:?}");
    drop(hand);
    let seen = peer.join().expect("it ends");
    // At once, and at the end of the connection.
    assert!(seen.ends_with(b"15 G MODE\r\x03\x03"), "{}", String::from_utf8_lossy(&seen));
}

/// After REPLY 1 boards answer by packets, which are read as well.
#[test]
fn values_in_packets_are_read() {
    let (_served, mut hand) = fast();
    hand.set_packets(true, HANGS).expect("set");
    assert_eq!(hand.get("47", Property::STAT, HANGS).map(|values| values.len()), Ok(2));
    hand.wait_for("4", Property::STAT, 2, HANGS, &mut no_progress).expect("it is");
    let impossible = hand.wait_for("4", Property::STAT, 99, HANGS, &mut no_progress);
    assert!(matches!(failure(impossible), Failure::Invalid(_)));
}

#[test]
fn properties_are_set_and_read_by_the_table() {
    let (_served, mut hand) = fast();
    hand.set("57", Property::MT, 550, HANGS).expect("set");
    let node = |number| Node::new(number).expect("a node");
    let torques = hand.get("57", Property::MT, HANGS);
    assert_eq!(torques, Ok(vec![(node(5), 550), (node(7), 550)]));
    hand.set_parameter("S", "DS", 900, HANGS).expect("set");
    assert_eq!(hand.parameter("S", "DS", HANGS), Ok(vec![900]));
    hand.save_parameters(HANGS).expect("saved");
    // Nothing is sent for these.
    for refused in [
        hand.set("5", Property::MT, 1 << 20, HANGS),
        hand.set("5", Property::TEMP, 1, HANGS),
        hand.set("8", Property::MT, 1, HANGS),
        hand.set("", Property::MT, 1, HANGS),
        hand.set_parameter("S", "FROB", 1, HANGS),
        hand.set_parameter("S", "P", 1, HANGS),
        hand.set_hand_parameter("BAUD", 1, HANGS),
        hand.close("11", HANGS, &mut no_progress),
        hand.command("HI\r", HANGS).map(drop),
        hand.command("1loop ", HANGS).map(drop),
        hand.set("5", Property::MODE, 1, HANGS),
        hand.set("5", Property::STAT, 1, HANGS),
        hand.set("55", Property::MT, 1, HANGS),
    ] {
        assert!(matches!(failure(refused), Failure::Invalid(_)));
    }
    // Locked.
    let untaken = failure(hand.set("45", Property::UPSECS, 0x7FFF_FFFF, HANGS));
    assert!(matches!(untaken, Failure::NotTaken { node: first, .. } if first == node(4)), "{untaken:?}");
    let wrong = failure(hand.command("FROB", HANGS));
    assert!(matches!(wrong, Failure::Status(status) if status.code() == 32), "{wrong:?}");
}

#[test]
fn cancel_ends_a_move_of_fingers_and_soon_a_call_to_a_silent_hand() {
    let served = Served::hand();
    let mut hand = Hand::connect(served.place("gcl"), HANGS).expect("connected");
    let canceller = hand.canceller();
    let cancelled = hand.move_halls("4", 160, HANGS, &mut |_| {
        canceller.cancel().expect("sent");
        ControlFlow::Continue(())
    });
    assert_eq!(failure(cancelled), Failure::Cancelled);
    let proxy = served::Proxy::new(&served, b"SHI\r", served::Cut::Silence);
    drop(hand);
    let mut hand = Hand::connect(&proxy.address, HANGS).expect("connected");
    let deadline = Deadline::after(Duration::from_secs(10));
    let cancelled = hand.find_zero("S", HANGS, &mut |_| ControlFlow::Break(()));
    assert!(failure(cancelled) == Failure::Cancelled && !deadline.is_over(), "{:?}", deadline.elapsed());
}

#[test]
fn realtime_wants_a_control_for_each_motor() {
    let (_served, mut hand) = fast();
    hand.init(HANGS, &mut no_progress).expect("homed");
    let mut realtime = hand.realtime("G", Format::default(), HANGS).expect("begun");
    for wrong in [0, 1, 4] {
        let refused = failure(realtime.exchange(&vec![Control::default(); wrong], HANGS));
        assert!(matches!(refused, Failure::Invalid(_)), "{refused:?}");
    }
    realtime.exchange(&[Control::default(); 3], HANGS).expect("it goes on");
}

#[test]
fn fingers_move_in_hall_counts_with_positions_as_progress() {
    let (_served, mut hand) = fast();
    hand.init(HANGS, &mut no_progress).expect("homed");
    let mut last = Vec::new();
    hand.move_halls("14", 100, HANGS, &mut |progress| {
        last = progress.values.iter().map(|(node, halls)| (node.number(), *halls)).collect();
        ControlFlow::Continue(())
    })
    .expect("moved");
    // Arrival is within MPE, 4 hall counts; the tip follows by 13/49.
    for ((node, halls), (of, goal)) in last.iter().zip([(1, 100), (4, 100), (5, 26)]) {
        assert!(*node == of && (halls - goal).abs() <= 4, "{last:?}");
    }
    assert_eq!(last.len(), 3);
    hand.wait_for("145", Property::END, 1, HANGS, &mut no_progress).expect("arrived");
    hand.open("1", HANGS, &mut no_progress).expect("the language goes on");
}

#[test]
fn motion_is_cancelled_by_its_progress_and_from_another_thread() {
    let served = Served::hand();
    let mut hand = Hand::connect(served.place("gcl"), HANGS).expect("connected");
    // HI takes seconds; progress comes every 50 ms.
    let cancelled = hand.init(HANGS, &mut |_| ControlFlow::Break(()));
    assert_eq!(failure(cancelled), Failure::Cancelled);
    assert_eq!(hand.command("VERS", HANGS), Ok(vec!["600".to_owned()]));
    let canceller = hand.canceller();
    let mut other = None;
    let cancelled = hand.command_with("WAIT 60000", HANGS, &mut |_| {
        let canceller = canceller.clone();
        other.get_or_insert_with(|| thread::spawn(move || canceller.cancel()));
        ControlFlow::Continue(())
    });
    assert_eq!(failure(cancelled), Failure::Cancelled);
    other.expect("progress came").join().expect("it ends").expect("sent");
    drop(hand);
    canceller.cancel().expect("nothing to cancel");
}

#[test]
fn call_that_times_out_is_aborted_and_the_next_one_answered() {
    let served = Served::hand();
    let mut hand = Hand::connect(served.place("gcl"), HANGS).expect("connected");
    let limit = Duration::from_millis(100);
    for _ in 0..3 {
        // The second one is not answered by the end of the first.
        assert_eq!(failure(hand.command("WAIT 60000", limit)), Failure::TimedOut(limit));
        assert_eq!(failure(hand.command("WAIT 60000", limit)), Failure::TimedOut(limit));
        assert_eq!(hand.command("VERS", HANGS), Ok(vec!["600".to_owned()]));
    }
}

#[test]
fn realtime_exchanges_blocks_and_leaves_a_prompt() {
    let (_served, mut hand) = fast();
    let format =
        Format { feeds_velocity: Some(8), feeds_strain: true, feeds_temperature: true, ..Format::default() };
    let unhomed = failure(hand.realtime("X1234567", format, HANGS).map(|_| ()));
    assert!(matches!(unhomed, Failure::Status(status) if status.code() == 4), "{unhomed:?}");
    hand.init(HANGS, &mut no_progress).expect("homed");
    let mut realtime = hand.realtime("X1234567", format, HANGS).expect("begun");
    assert_eq!(realtime.axes(), 7);
    let closing = vec![Control { velocity: 80, gain: 0 }; 7];
    let mut last = Feedback::default();
    let statistics = realtime.run(100.0, HANGS, |number, feedback| {
        last = feedback.clone();
        if number < 30 { ControlFlow::Continue(closing.clone()) } else { ControlFlow::Break(()) }
    });
    assert_eq!(statistics.expect("it runs").blocks, 30);
    assert_eq!(last.axes.len(), 7);
    assert!(last.axes.iter().all(|axis| axis.position.is_some() && axis.strain.is_some()), "{last:?}");
    assert!(last.axes[0].position > Some(0), "closing: {last:?}");
    assert!(last.temperature.is_some_and(|celsius| (0.0..60.0).contains(&celsius)), "{last:?}");
    realtime.end(HANGS).expect("ended");
    assert_eq!(hand.command("VERS", HANGS), Ok(vec!["600".to_owned()]));
    // Dropped in the middle: the next call finds the prompt.
    drop(hand.realtime("12", Format::default(), HANGS).expect("begun"));
    assert_eq!(hand.command("VERS", HANGS), Ok(vec!["600".to_owned()]));
    assert!(matches!(failure(hand.realtime("", format, HANGS).map(|_| ())), Failure::Invalid(_)));
}

#[test]
fn board_on_the_bus_is_homed_moved_and_cancelled() {
    let served = Served::new(&["bus", "--node", "4", "--slcan", "127.0.0.1:0"], 1);
    let mut bus = Bus::slcan(served.place("slcan"), HANGS).expect("connected");
    let node = Node::new(4).expect("a node");
    bus.wake(&[node], HANGS).expect("awake");
    bus.find_zero(node, HANGS, &mut no_progress).expect("homed");
    bus.set(node, Property::MT, 500, HANGS).expect("set");
    assert_eq!(bus.get(node, Property::MT, HANGS), Ok(500));
    let refused = bus.set(node, Property::MT, -1, HANGS);
    assert!(matches!(failure(refused), Failure::Invalid(_)));
    let mut seen = Vec::new();
    bus.move_to(node, 100, HANGS, &mut |progress| {
        seen.push(progress.values[0].1);
        ControlFlow::Continue(())
    })
    .expect("moved");
    assert!(seen.len() > 2 && seen.is_sorted(), "{seen:?}");
    let cancelled = bus.move_to(node, 10, HANGS, &mut |_| ControlFlow::Break(()));
    assert_eq!(failure(cancelled), Failure::Cancelled);
    assert_eq!(bus.get(node, Property::MODE, HANGS), Ok(0), "idle after a cancel");
}

#[test]
fn boards_are_reached_by_packets_through_a_hand() {
    let served = Served::fast_hand();
    let hand = Connect::tcp(served.place("gcl")).boards(Boards::Wake).connect(HANGS).expect("connected");
    let mut bus = Bus::through(hand, HANGS).expect("packets");
    let node = Node::new(2).expect("a node");
    assert_eq!(bus.get(node, Property::STAT, HANGS), Ok(2));
    bus.set(node, Property::MT, 432, HANGS).expect("set");
    assert_eq!(bus.get(node, Property::MT, HANGS), Ok(432));
}

#[test]
fn fingers_open_and_close_with_their_tips() {
    let (_served, mut hand) = fast();
    hand.init(HANGS, &mut no_progress).expect("homed");
    // The closed position of the spread lies beyond its stop.
    hand.close_fingers("14", HANGS, &mut no_progress).expect("closed");
    let positions = |hand: &mut Hand| {
        let found = hand.get("1245", Property::P, HANGS).expect("positions");
        found.into_iter().map(|(_, halls)| halls).collect::<Vec<_>>()
    };
    // 331 and a third of its joint angle; the spread's stop.
    let closed = positions(&mut hand);
    let is_near =
        |found: &[i64], goals: [i64; 4]| found.iter().zip(goals).all(|(p, goal)| (p - goal).abs() <= 4);
    assert!(is_near(&closed, [331, 0, 166, 88]), "{closed:?}");
    hand.open_fingers("14", HANGS, &mut no_progress).expect("open");
    let open = positions(&mut hand);
    assert!(is_near(&open, [0, 0, 0, 0]), "{open:?}");
    assert!(matches!(failure(hand.close_fingers("5", HANGS, &mut no_progress)), Failure::Invalid(_)));
}

#[test]
fn command_waits_for_the_moves_that_it_starts() {
    let (_served, mut hand) = fast();
    hand.init(HANGS, &mut no_progress).expect("homed");
    hand.command("4 S E 82", HANGS).expect("set");
    hand.command_and_wait("4 S M 5", HANGS, &mut no_progress).expect("moved");
    let node = |number| Node::new(number).expect("a node");
    assert_eq!(hand.get("4", Property::END, HANGS), Ok(vec![(node(4), 1)]));
    hand.command("4 S E 20", HANGS).expect("set");
    let cancelled = hand.command_and_wait("4 s mode 5", HANGS, &mut |progress| match &progress.values[..] {
        [] => ControlFlow::Continue(()),
        _ => ControlFlow::Break(()),
    });
    assert_eq!(failure(cancelled), Failure::Cancelled);
    assert_ne!(hand.get("4", Property::END, HANGS), Ok(vec![(node(4), 1)]), "it was stopped");
}

#[test]
fn line_without_its_end_runs_with_the_next_call() {
    let (_served, mut hand) = fast();
    hand.write(b"1 S MT 55", HANGS).expect("taken");
    hand.write(b"0\r1 G MT", HANGS).expect("taken");
    assert_eq!(hand.command("VERS", HANGS), Ok(vec!["600".to_owned()]));
    let reports = hand.take_reports();
    assert!(reports.contains(&"1 MT=550".to_owned()), "{reports:?}");
}

#[test]
fn parameters_are_saved_by_board_and_of_the_hand() {
    let (_served, mut hand) = fast();
    hand.set("7", Property::MT, 550, HANGS).expect("set");
    hand.save_nodes("70", HANGS).expect("saved");
    hand.set("7", Property::MT, 600, HANGS).expect("set");
    hand.set("7", Property::LOAD, i64::from(Property::MT.id()), HANGS).expect("loaded");
    let node = Node::new(7).expect("a node");
    assert_eq!(hand.get("7", Property::MT, HANGS), Ok(vec![(node, 550)]));
    for nodes in ["", "8", "x"] {
        assert!(matches!(failure(hand.save_nodes(nodes, HANGS)), Failure::Invalid(_)), "{nodes}");
    }
}

/// A link that is sent beyond its stop stands there: that is no object. One step before it a move arrives.
#[test]
fn move_that_ends_at_the_joints_own_stop_says_so() {
    let (_served, mut hand) = fast();
    hand.init(HANGS, &mut no_progress).expect("homed");
    let ended = hand.move_halls("1", 345, HANGS, &mut no_progress);
    let ended = ended.expect_err("the stop stands at 338").to_string();
    assert!(ended.contains("node 1: its joint's own stop ended the move, at 338 hall counts"), "{ended}");
    assert!(!ended.contains("object"), "{ended}");
}

#[test]
fn sleeping_board_is_told_from_a_silent_one() {
    let served = Served::fast_hand();
    let mut hand = Connect::tcp(served.place("gcl")).boards(Boards::Any).connect(HANGS).expect("connected");
    let asleep = hand.get("34", Property::TEMP, HANGS).expect_err("they sleep");
    let node = |number| Node::new(number).expect("a node");
    assert_eq!(asleep.failure, Failure::Asleep(vec![node(3), node(4)]));
    assert!(asleep.to_string().contains("wake them (WAKE)"), "{asleep}");
}

#[test]
fn tabs_are_blanks() {
    let (_served, mut hand) = fast();
    assert_eq!(hand.command("4\tS\tMT\t500", HANGS), Ok(vec![]));
    assert_eq!(hand.command("4\tG\tMT", HANGS), Ok(vec!["4 MT=500".to_owned()]));
}
