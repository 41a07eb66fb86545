//! Movement commands (manual 5.2.1, 5.5), from the typed line to the true positions of the seven rotors.

mod breakaway;
pub mod ends;
mod former;
mod goals;
mod homing;
mod refusals;
mod silence;

use hil_world::board::SimBoard;
use hil_world::node::Node;
use hil_world::plant::Model;
use hil_world::rig::{Object, RigParams, Side};
use servo_core::{Config, Telemetry};
use tater_wire::{Destination, Message, Property};

use super::Session;

/// Hall counts: a stop stands on the boundary of two counts (1), friction holds a rotor off its goal (1), and a relative move begins where the
/// last one has left the rotor (1).
pub(super) const TOLERANCE: i32 = 3;

const CONDITION_MS: usize = 5_000;

/// True positions, hall counts, rounded.
pub(super) fn counts(session: &Session) -> [i32; 7] {
    let mut counts = [0; 7];
    for (count, station) in counts.iter_mut().zip(session.hand.bus().stations()) {
        *count = station.board().rig().truth().counts.round() as i32;
    }
    counts
}

pub(super) fn assert_near(session: &Session, expected: [i32; 7], why: &str) {
    let found = counts(session);
    let near = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= TOLERANCE);
    assert!(near, "{why}: {found:?}, not {expected:?}");
}

fn initialized() -> Session {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    session
}

/// A hand after HI, with a hard object in the closing direction of a motor.
pub(super) fn with_object(motor: u8, from_count: f64) -> Session {
    // As in the scenario breakaway-link: full torque dents it by 3 counts.
    let object = Object { from_count, stiffness_n_m_rad: 0.5, damping_n_m_s: 0.005, side: Side::Closing };
    let mut session = Session::with_boards(|number, node| {
        let objects = if number == motor { vec![object] } else { vec![] };
        SimBoard::with(0.0, node, RigParams::default(), &objects, Model::Averaged, number.into())
            .expect("in range")
    });
    assert_eq!(session.run("HI"), "");
    session
}

fn node(session: &mut Session, motor: u8) -> &mut Node {
    session.hand.bus_mut().station_mut(usize::from(motor) - 1).expect("1 to 7")
}

/// Does not use the bus; the board must be awake.
pub(super) fn set(session: &mut Session, motor: u8, property: Property, value: i64) {
    let to = Destination::Node(tater_wire::Node::new(motor).expect("a node"));
    let frame = Message::set(to, property, value).expect("it fits").frame();
    node(session, motor).receive(&frame).expect("it is taken");
}

pub(super) fn telemetry(session: &mut Session, motor: u8) -> Telemetry {
    node(session, motor).application().expect("it is awake").status()
}

pub(super) fn config(session: &mut Session, motor: u8) -> Config {
    *node(session, motor).application().expect("it is awake").config()
}

/// Returns when `happened` returns `true`; the command is still running.
pub(super) fn run_until(session: &mut Session, line: &str, happened: impl FnMut(&mut Session) -> bool) {
    session.hand.push_rx(line.as_bytes());
    session.hand.push_rx(b"\r");
    wait_until(session, line, happened);
}

fn wait_until(session: &mut Session, what: &str, mut happened: impl FnMut(&mut Session) -> bool) {
    for _ in 0..CONDITION_MS {
        if happened(session) {
            return;
        }
        session.wait_us(1000);
    }
    panic!("{what}: it did not happen within {CONDITION_MS} ms: {:?}", counts(session));
}

fn abort(session: &mut Session) -> String {
    session.hand.take_tx();
    session.hand.push_rx(b"\x03");
    session.read_to_prompt()
}
