//! The same calls over a hand's TCP port, over its serial port, and by CAN, where no GOD is (manual 1.5: "in one of three ways").

#![cfg(unix)]

mod served;

use std::ops::ControlFlow;
use std::time::Duration;

use served::{HANGS, Served};
use wraptor::{
    BoardState, Boards, Bus, CallError, Cause, Connect, Control, Deadline, Failure, Format, Hand, Node,
    Property, no_progress,
};

/// The three ways to a hand, as fast as the machine can where GOD is simulated. By CAN this program's GOD runs in real time.
fn ways() -> [(Served, Connect); 3] {
    let tcp = Served::fast_hand();
    let serial = Served::new(&["hand", "--pty", "--speed", "max"], 1);
    let can = Served::new(&["bus", "--nodes", "1-7", "--slcan", "127.0.0.1:0"], 1);
    let over_tcp = Connect::tcp(tcp.place("gcl"));
    let over_serial = Connect::serial(serial.place("pty"), 9600);
    let by_can = Connect::can(can.place("slcan"));
    [(tcp, over_tcp), (serial, over_serial), (can, by_can)]
}

fn node(number: u8) -> Node {
    Node::new(number).expect("a node")
}

fn failure<T: std::fmt::Debug>(result: Result<T, CallError>) -> Failure {
    result.expect_err("it fails").failure
}

/// Positions of nodes, each within MPE, 4 hall counts, of where it was sent.
fn stand(hand: &mut Hand, goals: &[(u8, i64)]) {
    let nodes: String = goals.iter().map(|(number, _)| number.to_string()).collect();
    let found = hand.get(&nodes, Property::P, HANGS).expect("positions");
    for ((found_node, halls), (number, goal)) in found.iter().zip(goals) {
        assert!(*found_node == node(*number) && (halls - goal).abs() <= 4, "{found:?}, expected {goals:?}");
    }
}

/// Each of the manual's functions that has a hand, in the order of a first session; then the hand's language and RealTime.
#[test]
fn every_call_does_the_same_on_every_way() {
    std::thread::scope(|scope| {
        for (served, connect) in ways() {
            scope.spawn(move || {
                session(&connect.boards(Boards::Any));
                drop(served);
            });
        }
    });
}

/// Boards whose HOSTUNITS is another hand's, asleep and awake: a hand that took its positions in those units would never come home.
#[test]
fn hand_by_can_makes_boards_of_another_host_speak_its_units() {
    let served = Served::new(&["bus", "--nodes", "1-7", "--slcan", "127.0.0.1:0", "--host-units", "280"], 1);
    let awake: Vec<Node> = (1..=3).map(node).collect();
    Bus::slcan(served.place("slcan"), HANGS)
        .expect("the adapter is free")
        .wake(&awake, HANGS)
        .expect("awake");
    let mut hand = Connect::can(served.place("slcan")).connect(HANGS).expect("connected");
    let units = hand.get("1234567", Property::HOSTUNITS, HANGS).expect("units");
    assert_eq!(units.iter().map(|(_, units)| *units).collect::<Vec<_>>(), [0; 7]);
    hand.find_zero("X1234567", HANGS, &mut no_progress).expect("homed");
    hand.move_halls("12", 250, HANGS, &mut no_progress).expect("moved");
    stand(&mut hand, &[(1, 250), (2, 250), (5, 66)]);
}

fn session(connect: &Connect) {
    let mut hand = connect.connect(HANGS).expect("connected");
    assert_eq!(hand.version(), 600);
    assert_eq!(hand.boards(HANGS).expect("states"), [BoardState::Asleep; 7]);
    hand.wake(HANGS).expect("awake");
    assert_eq!(hand.boards(HANGS).expect("states"), [BoardState::Ready; 7]);
    let unhomed = failure(hand.close("1", HANGS, &mut no_progress));
    assert!(matches!(unhomed, Failure::Status(status) if status.code() == 4), "{unhomed:?}");
    hand.find_zero("X1234567", HANGS, &mut no_progress).expect("homed");
    stand(&mut hand, &[(1, 0), (2, 0), (3, 0), (4, 0), (5, 0), (6, 0), (7, 0)]);
    let warm = hand.get("567", Property::TEMP, HANGS).expect("temperatures");
    assert!(warm.iter().all(|(_, tenths)| (0..600).contains(tenths)), "{warm:?}");
    let mut seen = 0;
    hand.move_halls("12", 250, HANGS, &mut |progress| {
        seen += progress.values.len();
        ControlFlow::Continue(())
    })
    .expect("moved");
    assert!(seen > 0);
    stand(&mut hand, &[(1, 250), (2, 250), (5, 66)]);
    hand.open_fingers("1", HANGS, &mut no_progress).expect("open");
    stand(&mut hand, &[(1, 0), (5, 0)]);
    hand.close_fingers("4", HANGS, &mut no_progress).expect("closed");
    stand(&mut hand, &[(4, 166)]);
    hand.command_and_wait("4 S E 82", HANGS, &mut no_progress).expect("set");
    hand.command_and_wait("4 S M 5", HANGS, &mut no_progress).expect("moved");
    stand(&mut hand, &[(4, 82)]);
    hand.set("7", Property::MT, 550, HANGS).expect("set");
    assert_eq!(hand.get("7", Property::MT, HANGS), Ok(vec![(node(7), 550)]));
    hand.wait_for("7", Property::MT, 550, HANGS, &mut no_progress).expect("it is");
    hand.set("1234567", Property::MODE, 0, HANGS).expect("idle");
    hand.save_nodes("1234567", HANGS).expect("saved");
    hand.write(b"1 G AP", HANGS).expect("taken");
    hand.command("VERS", HANGS).expect("a version");
    let reports = hand.take_reports();
    assert!(reports.iter().any(|line| line.starts_with("1 P=")), "{reports:?}");
    // The language.
    hand.move_to("12", 5500, HANGS, &mut no_progress).expect("moved");
    let positions = hand.parameter("12", "P", HANGS).expect("positions");
    assert!(positions.len() == 2 && positions.iter().all(|p| (5300..=5700).contains(p)), "{positions:?}");
    let wrong = failure(hand.command("FROB", HANGS));
    assert!(matches!(wrong, Failure::Status(status) if status.code() == 32), "{wrong:?}");
    hand.set_parameter("S", "DS", 900, HANGS).expect("set");
    assert_eq!(hand.parameter("S", "DS", HANGS), Ok(vec![900]));
    let mut realtime = hand.realtime("G", Format::default(), HANGS).expect("begun");
    let feedback = realtime.exchange(&[Control { velocity: 40, gain: 0 }; 3], HANGS).expect("a block");
    assert_eq!(feedback.axes.len(), 3);
    realtime.end(HANGS).expect("ended");
    let canceller = hand.canceller();
    let cancelled = hand.command_with("WAIT 60000", HANGS, &mut |_| {
        canceller.cancel().expect("sent");
        ControlFlow::Continue(())
    });
    assert_eq!(failure(cancelled), Failure::Cancelled);
    hand.command("VERS", HANGS).expect("the next call is answered");
}

/// What the board GOD has of its own is missing by CAN, and said so; nothing is sent.
#[test]
fn call_that_needs_the_board_god_is_refused_by_can() {
    let served = Served::new(&["bus", "--nodes", "1-7", "--slcan", "127.0.0.1:0"], 1);
    let mut hand = Connect::can(served.place("slcan")).connect(HANGS).expect("connected, and awake");
    for refused in [
        hand.temperature(HANGS).map(drop),
        hand.hand_parameter("ptemp", HANGS).map(drop),
        hand.save_nodes("10", HANGS),
        hand.realtime("4", Format { feeds_temperature: true, ..Format::default() }, HANGS).map(drop),
    ] {
        let Failure::Invalid(expected) = failure(refused) else { panic!("not refused") };
        assert!(expected.contains("by CAN there is no GOD"), "{expected}");
    }
    // SAVE stores the boards; what only GOD could keep is reported once it differs from what GOD begins with.
    hand.prepare_power_off(HANGS).expect("stored");
    hand.command("PSET LFT 1", HANGS).expect("set");
    let unstored = failure(hand.command("PSAVE", HANGS));
    assert!(matches!(unstored, Failure::Status(status) if status.code() == 512), "{unstored:?}");
    assert_eq!(hand.hand_parameter("LFT", HANGS), Ok(1));
}

/// Boards by CAN stop with the orderly end of the connection, as those of a hand do.
#[test]
fn end_of_a_connection_by_can_stops_motors() {
    let served = Served::new(&["bus", "--nodes", "1-7", "--slcan", "127.0.0.1:0"], 1);
    let connect = Connect::can(served.place("slcan"));
    let mut hand = connect.connect(HANGS).expect("connected");
    let slowly = [
        (Property::MOV, 30),
        (Property::MCV, 30),
        (Property::MV, 30),
        (Property::E, 250),
        (Property::MODE, 5),
    ];
    for (property, value) in slowly {
        hand.set("1", property, value, HANGS).expect("set");
    }
    drop(hand);
    let mut bus = Bus::slcan(served.place("slcan"), HANGS).expect("the adapter is free");
    assert_eq!(bus.get(node(1), Property::MODE, HANGS), Ok(0), "it stands");
    drop(bus);
    // Bytes that come last are finished, and nobody stops what they begin.
    let mut hand = connect.connect(HANGS).expect("connected");
    hand.write(b"1 S M 5\r", HANGS).expect("taken");
    drop(hand);
    let mut bus = Bus::slcan(served.place("slcan"), HANGS).expect("the adapter is free");
    assert_eq!(bus.get(node(1), Property::MODE, HANGS), Ok(5), "it moves");
}

/// GOD is its bus's host: an adapter beside it only watches.
#[test]
fn hand_whose_god_runs_is_in_use_by_can() {
    let served = Served::new(&["hand", "--listen", "127.0.0.1:0", "--slcan", "127.0.0.1:0"], 2);
    for boards in [Boards::Any, Boards::Wake] {
        let refused = Connect::can(served.place("slcan")).boards(boards).connect(HANGS);
        assert!(matches!(refused.map(drop).expect_err("it only watches").cause, Cause::InUse(_)));
    }
}

#[test]
fn place_by_can_is_an_interface_an_address_or_a_port() {
    let cause = |place: &str| Connect::can(place).connect(HANGS).map(drop).expect_err("there is none").cause;
    assert!(matches!(cause("127.0.0.1:1"), Cause::NoAdapter(_)));
    assert!(matches!(cause("/dev/no-such-port"), Cause::NoSuchPort(_)));
    assert!(matches!(cause("/dev/no-such-port@fast"), Cause::BadAddress(_)));
    #[cfg(target_os = "linux")]
    assert!(matches!(cause("nocan9"), Cause::NoSuchPort(_)));
}

/// Links open, and stand at their stops while the others are homed (manual 7, findZero). They begin at 0, 25 hall counts from it.
#[test]
fn find_zero_returns_links_last() {
    let served = Served::hand();
    let mut hand = Hand::connect(served.place("gcl"), HANGS).expect("connected");
    let mut late = 0;
    // A second of HI of the others, which has no positions: 50 ms each.
    let cancelled = hand.find_zero("", HANGS, &mut |progress| {
        late = if progress.values.is_empty() { late + 1 } else { 0 };
        if late < 20 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    assert_eq!(failure(cancelled), Failure::Cancelled);
    let found = hand.get("1235", Property::P, HANGS).expect("positions");
    let halls: Vec<i64> = found.into_iter().map(|(_, halls)| halls).collect();
    assert!(halls[..3].iter().all(|halls| (-28..=-22).contains(halls)) && halls[3] > 20, "{halls:?}");
    hand.find_zero("", HANGS, &mut no_progress).expect("homed");
    stand(&mut hand, &[(1, 0), (2, 0), (3, 0), (4, 0), (5, 0), (6, 0), (7, 0)]);
}

/// A link that does not find its stop is named at the end, and the others are homed.
#[test]
fn find_zero_reports_a_motor_after_the_others_are_homed() {
    let served = Served::fast_hand();
    let mut hand = Hand::connect(served.place("gcl"), HANGS).expect("connected");
    // HI of this link, and of this tip, is refused.
    hand.set("26", Property::IVEL, 0, HANGS).expect("set");
    let unfound = failure(hand.find_zero("", HANGS, &mut no_progress));
    assert!(matches!(unfound, Failure::Status(status) if status.code() == 4), "{unfound:?}");
    hand.move_to("X13457", 500, HANGS, &mut no_progress).expect("the others are homed");
}

/// A peer that ends, or that falls silent, ends each call within its limit.
#[cfg(target_os = "linux")]
#[test]
fn lost_peer_ends_each_call_in_time_on_every_way() {
    type Call = fn(&mut Hand) -> Result<(), CallError>;
    const LIMIT: Duration = Duration::from_millis(300);
    /// The limit, and a second for a busy machine.
    const OVER: Duration = Duration::from_millis(1300);
    const CALLS: [Call; 9] = [
        |hand| hand.wake(LIMIT),
        |hand| hand.get("5", Property::MT, LIMIT).map(drop),
        |hand| hand.set("5", Property::MT, 500, LIMIT),
        |hand| hand.wait_for("5", Property::STAT, 1, LIMIT, &mut no_progress),
        |hand| hand.move_halls("4", 9, LIMIT, &mut no_progress),
        |hand| hand.find_zero("", LIMIT, &mut no_progress),
        |hand| hand.command_and_wait("4 S M 5", LIMIT, &mut no_progress).map(drop),
        |hand| hand.save_nodes("4", LIMIT),
        |hand| hand.realtime("1", Format::default(), LIMIT).map(|_| ()),
    ];
    for signal in ["KILL", "STOP"] {
        for (served, connect) in ways() {
            let mut hand = connect.connect(HANGS).expect("connected");
            let id = served.process.lock().expect("unpoisoned").id().to_string();
            let sent = std::process::Command::new("kill").args(["-s", signal, &id]).status().expect("kill");
            assert!(sent.success());
            for (number, call) in CALLS.into_iter().enumerate() {
                let deadline = Deadline::after(OVER);
                let failure = failure(call(&mut hand));
                let what = format!("{}, {signal}, call {number}: {failure:?}", hand.place());
                assert!(!deadline.is_over(), "{what}, {:?}", deadline.elapsed());
                assert!(signal == "STOP" || matches!(failure, Failure::Lost(_)), "{what}");
            }
            let deadline = Deadline::after(OVER);
            drop(hand);
            assert!(!deadline.is_over(), "{signal}: the end, {:?}", deadline.elapsed());
        }
    }
}
