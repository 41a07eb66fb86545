//! Movement commands (manual 5.2.1, 5.5), from what is typed to where the seven rotors really are.

mod breakaway;
pub mod ends;
mod former;
mod goals;
mod homing;
mod refusals;
mod silence;

use hil_sim::board::SimBoard;
use hil_sim::node::Node;
use hil_sim::plant::Model;
use hil_sim::rig::{Object, RigParams, Side};
use servo_core::{Config, Telemetry};
use tater_wire::{Destination, Message, Property};

use super::Session;

/// How far a rotor may really be from where it is to be, hall counts: its stop stands on the boundary of two counts (1), and it comes to rest as
/// near to its goal as friction lets it (1).
pub(super) const NEAR: i32 = 2;

/// Longest wait of a test for something that is to happen, ms.
const SOON_MS: usize = 5_000;

/// Where the motors really are, hall counts, rounded.
pub(super) fn counts(session: &Session) -> [i32; 7] {
    let mut counts = [0; 7];
    for (count, station) in counts.iter_mut().zip(session.hand.bus().stations()) {
        *count = station.board().rig().truth().counts.round() as i32;
    }
    counts
}

/// Asserts where the motors really are.
pub(super) fn assert_near(session: &Session, expected: [i32; 7], why: &str) {
    let found = counts(session);
    let near = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= NEAR);
    assert!(near, "{why}: {found:?}, not {expected:?}");
}

/// A hand that has been initialised.
fn initialized() -> Session {
    let mut session = Session::new();
    assert_eq!(session.line("HI"), "");
    session
}

/// A hand with something hard in the way of a motor that closes, from a count on, which has been initialised.
fn with_object(motor: u8, from_count: f64) -> Session {
    // As in the scenario breakaway-link: hard enough that full torque dents it by 3 counts.
    let object = Object { from_count, stiffness_n_m_rad: 0.5, damping_n_m_s: 0.005, side: Side::Closing };
    let mut session = Session::of_boards(|number, node| {
        let objects = if number == motor { vec![object] } else { vec![] };
        SimBoard::with(0.0, node, RigParams::default(), &objects, Model::Averaged, number.into())
            .expect("in range")
    });
    assert_eq!(session.line("HI"), "");
    session
}

fn node(session: &mut Session, motor: u8) -> &mut Node {
    session.hand.bus_mut().station_mut(usize::from(motor) - 1).expect("1 to 7")
}

/// Sets a property of a board that is awake, as if by the bus.
pub(super) fn set(session: &mut Session, motor: u8, property: Property, value: i64) {
    let to = Destination::Node(tater_wire::Node::new(motor).expect("a node"));
    let frame = Message::set(to, property, value).expect("it fits").frame();
    node(session, motor).receive(&frame).expect("it is taken");
}

pub(super) fn status(session: &mut Session, motor: u8) -> Telemetry {
    node(session, motor).application().expect("it is awake").status()
}

pub(super) fn config(session: &mut Session, motor: u8) -> Config {
    *node(session, motor).application().expect("it is awake").config()
}

/// Types a line, and waits until `happened` says so. The command goes on.
pub(super) fn line_until(session: &mut Session, line: &str, happened: impl FnMut(&mut Session) -> bool) {
    session.hand.push_rx(line.as_bytes());
    session.hand.push_rx(b"\r");
    until(session, line, happened);
}

/// Waits until `happened` says so; it is asked each millisecond.
fn until(session: &mut Session, what: &str, mut happened: impl FnMut(&mut Session) -> bool) {
    for _ in 0..SOON_MS {
        if happened(session) {
            return;
        }
        session.wait_us(1000);
    }
    panic!("{what}: it never happened: {:?}", counts(session));
}

/// Types ^C; what is said then.
fn abort(session: &mut Session) -> String {
    session.hand.take_tx();
    session.hand.push_rx(b"\x03");
    session.until_prompt()
}
