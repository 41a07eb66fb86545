//! A hand that dies or a cable that is pulled during each call: an error within the limit, no thread and no socket left. The only test of this
//! program, because it counts both.

#![cfg(target_os = "linux")]

mod served;

use std::ops::ControlFlow;
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use served::{Cut, HANGS, Proxy, Served, left};
use wraptor::{Boards, Bus, CallError, Connect, Control, Failure, Format, Hand, Node, Property, no_progress};

/// Limit of each call.
const LIMIT: Duration = Duration::from_millis(300);

/// A call is over by then: its limit, and a second for a machine that runs something else.
const OVER: Duration = Duration::from_millis(1300);

type Call = fn(&mut Hand) -> Result<(), CallError>;

/// Each call with the bytes at which the connection is cut.
const CALLS: [(&str, &[u8], Call); 25] = [
    ("command", b"PLIST\r", |hand| hand.command("PLIST", LIMIT).map(drop)),
    ("wake", b"WAKE\r", |hand| hand.wake(LIMIT)),
    ("boards", b"G STAT\r", |hand| hand.boards(LIMIT).map(drop)),
    ("faults", b"G ERROR\r", |hand| hand.faults(LIMIT).map(drop)),
    ("init", b"HI\r", |hand| hand.init(LIMIT, &mut no_progress)),
    ("find_zero", b"4HI\r", |hand| hand.find_zero("4", LIMIT, &mut no_progress)),
    ("close", b"GC\r", |hand| hand.close("G", LIMIT, &mut no_progress)),
    ("open", b"GO\r", |hand| hand.open("G", LIMIT, &mut no_progress)),
    ("grasp", b"GTC\r", |hand| hand.grasp("G", LIMIT, &mut no_progress)),
    ("relax", b"GT\r", |hand| hand.relax("G", LIMIT)),
    ("move_to", b"1M 500\r", |hand| hand.move_to("1", 500, LIMIT, &mut no_progress)),
    ("move_halls", b"4 S E 9\r", |hand| hand.move_halls("4", 9, LIMIT, &mut no_progress)),
    ("get", b"5 G MT\r", |hand| hand.get("5", Property::MT, LIMIT).map(drop)),
    ("set", b"5 S MT 500\r", |hand| hand.set("5", Property::MT, 500, LIMIT)),
    ("wait_for", b"5 G STAT\r", |hand| hand.wait_for("5", Property::STAT, 1, LIMIT, &mut no_progress)),
    ("parameter", b"SFGET P\r", |hand| hand.parameter("S", "P", LIMIT).map(drop)),
    ("temperature", b"PGET TEMP\r", |hand| hand.temperature(LIMIT).map(drop)),
    ("save", b"FSAVE\r", |hand| hand.save_parameters(LIMIT)),
    ("command_and_wait", b"4 S M 5\r", |hand| {
        hand.command_and_wait("4 S M 5", LIMIT, &mut no_progress).map(drop)
    }),
    ("close_fingers", b"S E 331\r", |hand| hand.close_fingers("1", LIMIT, &mut no_progress)),
    ("open_fingers", b"S E 0\r", |hand| hand.open_fingers("1", LIMIT, &mut no_progress)),
    ("save_nodes", b"S SAVE -1\r", |hand| hand.save_nodes("4", LIMIT)),
    ("receive", b"PLIST\r", |hand| {
        hand.write(b"PLIST\r", LIMIT)?;
        hand.receive(LIMIT)?;
        // Time alone is no failure of this one.
        hand.command("PLIST", LIMIT).map(drop)
    }),
    ("download", &[0, 5, 4], |hand| {
        hand.download("5", &served::firmware(2048), LIMIT, &mut |_| ControlFlow::Continue(()))
    }),
    ("realtime", b"1FSET LCV", |hand| hand.realtime("1", Format::default(), LIMIT).map(|_| ())),
];

/// Runs a call in a thread and returns its outcome if it is over in time.
fn in_time(
    name: &str,
    cut: Cut,
    mut hand: Hand,
    call: impl FnOnce(&mut Hand) -> Result<(), CallError> + Send + 'static,
) -> Failure {
    let (sender, outcome) = channel();
    let thread = thread::spawn(move || {
        let outcome = call(&mut hand);
        let _ = sender.send(outcome);
    });
    let outcome = outcome.recv_timeout(OVER).unwrap_or_else(|_| panic!("{name}, {cut:?}: no end in time"));
    thread.join().expect("it ends");
    // The hand is dropped, while the other side of a cut cable still holds its end.
    assert_eq!(left().0, 0, "{name}, {cut:?}: threads of the library");
    outcome.expect_err("the hand is gone").failure
}

fn is_right(cut: Cut, failure: &Failure) -> bool {
    match cut {
        Cut::Kill => matches!(failure, Failure::Lost(_)),
        Cut::Silence => matches!(failure, Failure::TimedOut(_)),
    }
}

#[test]
fn lost_hand_ends_each_call_in_time_and_leaves_nothing() {
    let before = left();
    assert_eq!(before.0, 0);
    for cut in [Cut::Kill, Cut::Silence] {
        for (name, trigger, call) in CALLS {
            let served = Served::fast_hand();
            let proxy = Proxy::new(&served, trigger, cut);
            let hand = Connect::tcp(&proxy.address).boards(Boards::Any).connect(HANGS).expect("connected");
            let failure = in_time(name, cut, hand, call);
            assert!(is_right(cut, &failure), "{name}, {cut:?}: {failure:?}");
            drop((proxy, served));
            assert_eq!(left(), before, "{name}, {cut:?}: threads of the library, sockets");
        }
        // In RealTime: the cut comes with the first block.
        let served = Served::fast_hand();
        let proxy = Proxy::new(&served, b"LOOP\rC", cut);
        let mut hand = Connect::tcp(&proxy.address).connect(HANGS).expect("connected");
        hand.init(HANGS, &mut no_progress).expect("homed");
        let failure = in_time("exchange", cut, hand, |hand| {
            let mut realtime = hand.realtime("1", Format::default(), HANGS)?;
            realtime.exchange(&[Control::default()], LIMIT).map(drop)
        });
        assert!(is_right(cut, &failure), "exchange, {cut:?}: {failure:?}");
        drop((proxy, served));
        assert_eq!(left(), before, "exchange, {cut:?}: threads of the library, sockets");
    }
    lost_bus_ends_a_motion();
    serial_reader_ends_with_its_hand();
    assert_eq!(left(), before, "threads of the library, sockets");
}

/// The bus dies during a motion.
fn lost_bus_ends_a_motion() {
    let served = Served::new(&["bus", "--node", "4", "--slcan", "127.0.0.1:0"], 1);
    let mut bus = Bus::slcan(served.place("slcan"), HANGS).expect("connected");
    let node = Node::new(4).expect("a node");
    bus.wake(&[node], HANGS).expect("awake");
    let (sender, outcome) = channel();
    let process = served.process.clone();
    let thread = thread::spawn(move || {
        let outcome = bus.find_zero(node, HANGS, &mut |_| {
            served::end(&process);
            ControlFlow::Continue(())
        });
        let gone = bus.get(node, Property::P, LIMIT).expect_err("the bus is gone").failure;
        let _ = sender.send((outcome.expect_err("the bus is gone").failure, gone));
    });
    let (during, after) = outcome.recv_timeout(OVER + HANGS).expect("an end");
    thread.join().expect("it ends");
    assert!(matches!(during, Failure::Lost(_)), "{during:?}");
    assert!(matches!(after, Failure::Lost(_)), "{after:?}");
    assert_eq!(left().0, 0, "threads of the library");
}

/// A serial port has no end of its own: nothing arrives while the hand is dropped.
fn serial_reader_ends_with_its_hand() {
    let served = Served::new(&["hand", "--pty", "--speed", "max"], 1);
    let hand = Connect::serial(served.place("pty"), 9600).boards(Boards::Any).connect(HANGS);
    let mut hand = hand.expect("connected");
    let (sender, over) = channel();
    let thread = thread::spawn(move || {
        let before = hand.command("VERS", HANGS);
        drop(hand);
        let _ = sender.send(before.is_ok());
    });
    assert_eq!(over.recv_timeout(HANGS), Ok(true), "an end");
    thread.join().expect("it ends");
    assert_eq!(left().0, 0, "threads of the library");
    drop(served);
}
