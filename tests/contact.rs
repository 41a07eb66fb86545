//! The true torque and force of a motor that meets a stop, an object or a person's finger, by the plant alone (docs/safety.md, docs/force.md):
//! MT bounds the torque whatever the speed and the motor's constants are, and TSTOP its time.

use std::fmt::Debug;

use hil_world::board::SimBoard;
use hil_world::hand::person::{DAMPING_S, stiffness_n_m_rad};
use hil_world::node::Node;
use hil_world::plant::{Heat, Model, PlantParams, Start};
use hil_world::rig::{Object, Rig, RigParams, Side, Truth};
use tater_wire::{Destination, Message, MotorKind, Node as Id, Property};

mod force;
mod stalls;
mod torque;

/// Torque units a N·m (decision 0003).
const UNITS: f64 = 1575.0;

/// Time between two looks at the plant, µs: a third of the winding's time constant.
const LOOK_US: u64 = 100;

const KINDS: [MotorKind; 3] = [MotorKind::Link, MotorKind::Spread, MotorKind::Tip];

/// What a closing joint meets at a count, and that gives way by a millimeter for so many N.
fn object(kind: MotorKind, from_count: f64, n_per_mm: f64) -> Object {
    let stiffness_n_m_rad = stiffness_n_m_rad(kind, n_per_mm);
    Object {
        from_count,
        stiffness_n_m_rad,
        damping_n_m_s: DAMPING_S * stiffness_n_m_rad,
        side: Side::Closing,
    }
}

/// One board that knows its motor's direction, awake.
struct Bench {
    node: Node,
    id: Id,
    now_us: u64,
}

impl Bench {
    fn new(kind: MotorKind, plant: &PlantParams, from_count: f64, objects: &[Object]) -> Self {
        let number = kind.first_node();
        let id = Id::new(number).expect("a node");
        let heat = Heat { winding_c: plant.ambient_c, housing_c: plant.ambient_c };
        let start = Start { count: from_count.round(), counts_per_s: 0.0, heat };
        let rig = Rig::new(plant.clone(), RigParams::default(), objects, Model::Averaged, start, 1);
        let mut node = Node::awake(SimBoard::new(rig.expect("in range"), id));
        node.trust_direction();
        let now_us = node.board().rig().now_us();
        Self { node, id, now_us }
    }

    fn set(&mut self, property: Property, value: i64) {
        let message = Message::set(Destination::Node(self.id), property, value).expect("a value");
        self.node.receive(&message.frame()).expect("taken");
    }

    /// Goes on by [`LOOK_US`], with a host that HOSTMS waits for and that takes each answer.
    fn look(&mut self) -> Truth {
        if self.now_us.is_multiple_of(500_000) {
            let message = Message::get(Destination::Node(self.id), Property::P);
            self.node.receive(&message.frame()).expect("taken");
        }
        while let Some(frame) = self.node.mailboxes().first().cloned() {
            self.node.sent(&frame);
        }
        self.now_us += LOOK_US;
        self.node.advance(self.now_us);
        self.node.board().rig().truth()
    }

    /// Shows `see` the plant, and the time since the rotor has first passed `stop`, ms, until that is `watched_ms`; `what` is for the panic of one
    /// that does not pass it within `within_ms`.
    fn watch(
        &mut self,
        what: &dyn Debug,
        stop: f64,
        [within_ms, watched_ms]: [f64; 2],
        mut see: impl FnMut(Truth, Option<f64>),
    ) {
        let mut contact_ms = None;
        while contact_ms.is_none_or(|at| self.ms() < at + watched_ms) {
            assert!(self.ms() < within_ms, "{what:?} never meets its stop");
            let truth = self.look();
            if truth.counts > stop && contact_ms.is_none() {
                contact_ms = Some(self.ms());
            }
            see(truth, contact_ms.map(|at| self.ms() - at));
        }
    }

    fn ms(&self) -> f64 {
        self.now_us as f64 * 1e-3
    }
}
