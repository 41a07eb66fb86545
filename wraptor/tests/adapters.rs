//! SLCAN adapters of every dialect: each opens, carries calls, and carries a download.

mod dialect;
mod served;

use std::net::TcpListener;
use std::ops::ControlFlow;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use dialect::{Dialect, serve};
use served::{HANGS, Served, firmware};
use wraptor::{Bus, CallError, Cause, Failure, Health, Node, Property};

const LIMIT: Duration = Duration::from_secs(120);

fn node() -> Node {
    Node::new(4).expect("a node")
}

fn bus() -> Served {
    Served::new(&["bus", "--node", "4", "--slcan", "127.0.0.1:0"], 1)
}

/// Opens, asks, sets and downloads through an adapter. Returns its refusals, and how often the board had to ask again.
fn works(dialect: Dialect, len: usize) -> (Health, usize) {
    let served = bus();
    let adapter = serve(served.place("slcan"), dialect);
    let mut bus = Bus::slcan(&adapter.address, HANGS).unwrap_or_else(|error| panic!("{dialect:?}: {error}"));
    let failed = |error: CallError| panic!("{dialect:?}: {error}");
    bus.wake(&[node()], HANGS).unwrap_or_else(failed);
    for kp in 100..130 {
        bus.set(node(), Property::KP, kp, HANGS).unwrap_or_else(failed);
        assert_eq!(bus.get(node(), Property::KP, HANGS), Ok(kp), "{dialect:?}");
    }
    bus.download(node(), &firmware(len), LIMIT, &mut |_| ControlFlow::Continue(())).unwrap_or_else(failed);
    assert_eq!(bus.get(node(), Property::STAT, HANGS), Ok(2), "{dialect:?}");
    (bus.health(), adapter.repeated.load(Ordering::SeqCst))
}

#[test]
fn adapters_that_acknowledge_in_their_own_ways_work() {
    use Dialect::{CapitalZ, CrLf, Feedback, Joined, Lawicel, LfEnds, Stamped, WithoutZ};
    for dialect in [Lawicel, Feedback, CrLf, LfEnds, WithoutZ, CapitalZ, Joined, Stamped] {
        assert_eq!(works(dialect, 1024).0, Health::default(), "{dialect:?}");
    }
}

#[test]
fn adapters_without_acknowledgments_work() {
    for dialect in [Dialect::Canable, Dialect::Canable25, Dialect::Mute] {
        assert_eq!(works(dialect, 1024).0, Health::default(), "{dialect:?}");
    }
}

/// Two rounds of commands are lost: each has an empty line, V, C, S8, O and a question to the boards.
#[test]
fn adapter_that_starts_anew_when_opened_works() {
    for deaf in [1, 3, 11, 12, 13] {
        assert_eq!(works(Dialect::Boots(deaf), 1024).0, Health::default(), "{deaf}");
    }
}

/// A board drops what follows a missing frame of a download and asks again after 200 ms, 16 frames later: with a refusal in each
/// of 1,400 frames of 5 that was 88 times and more. What the first refusals cost stays below a tenth of that.
#[test]
fn refused_frames_are_sent_again_at_once_and_counted() {
    for (dialect, least) in
        [(Dialect::Refuses(5), 200), (Dialect::Refuses(50), 20), (Dialect::RefusesAlone(5), 200)]
    {
        let (health, repeated) = works(dialect, 4096);
        assert!(health.refusals >= least, "{dialect:?}: {health:?}");
        assert!(repeated <= 8, "{dialect:?}: the board asked {repeated} times again");
    }
}

#[test]
fn adapter_that_has_left_the_bus_is_closed_and_opened() {
    for dialect in [Dialect::BusOff(40), Dialect::SilentBusOff(40)] {
        let served = bus();
        let adapter = serve(served.place("slcan"), dialect);
        let mut bus = Bus::slcan(&adapter.address, HANGS).expect("connected");
        bus.wake(&[node()], HANGS).expect("awake");
        for kp in 100..150 {
            bus.set(node(), Property::KP, kp, HANGS).unwrap_or_else(|error| panic!("{dialect:?}: {error}"));
        }
        let refusals = bus.health().refusals;
        assert_eq!(refusals > 0, matches!(dialect, Dialect::BusOff(_)), "{dialect:?}: {refusals}");
    }
}

#[test]
fn damaged_answer_is_no_value() {
    let served = bus();
    let adapter = serve(served.place("slcan"), Dialect::Damages(3));
    let mut bus = Bus::slcan(&adapter.address, HANGS).expect("connected");
    bus.wake(&[node()], HANGS).expect("awake");
    for _ in 0..60 {
        assert_eq!(bus.get(node(), Property::KP, HANGS), Ok(120));
    }
    assert!(bus.health().damaged >= 10, "{:?}", bus.health());
}

/// Neither the adapter nor a board answers.
#[test]
fn adapter_that_never_answers_is_named_as_an_adapter() {
    let peer = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = peer.local_addr().expect("its address").to_string();
    let limit = Duration::from_millis(300);
    let error = Bus::slcan(&address, limit).map(|_| ()).expect_err("it is silent");
    assert_eq!(error.cause, Cause::SilentAdapter(limit));
    drop(peer);
    let peer = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = peer.local_addr().expect("its address").to_string();
    thread::spawn(move || drop(peer.accept()));
    let gone = Bus::slcan(&address, HANGS).map(|_| ()).expect_err("it closes");
    assert!(matches!(gone.cause, Cause::AdapterGone(_)), "{gone}");
    let free = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("its address");
    let none = Bus::slcan(&free.to_string(), HANGS).map(|_| ()).expect_err("nothing listens");
    assert!(matches!(none.cause, Cause::NoAdapter(_)), "{none}");
    for text in [error.to_string(), gone.to_string(), none.to_string()] {
        assert!(text.contains("adapter") && !text.contains("hand"), "{text}");
    }
}

/// A frame that stays refused is the call's failure, not a silent board.
#[test]
fn adapter_that_refuses_every_frame_is_the_failure() {
    let served = bus();
    let adapter = serve(served.place("slcan"), Dialect::Refuses(1));
    let mut bus = Bus::slcan(&adapter.address, HANGS).expect("connected");
    let error = bus.get(node(), Property::P, Duration::from_millis(500)).expect_err("nothing is sent");
    assert_eq!(error.failure, Failure::Refused);
    assert!(adapter.sent.load(Ordering::SeqCst) >= 8);
}
