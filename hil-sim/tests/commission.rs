//! Writing properties to boards, on all or on none: simulated boards behind a link that loses what a test picks.

use commission::apply::{Board, Change, State, compare, meet, write};
use commission::excite::{Failure, Link};
use hil_sim::simulated::Simulated;
use hil_world::board::SimBoard;
use hil_world::node::Node;
use hil_world::plant::Model;
use tater_wire::{Body, Destination, Frame, Message, MotorKind, Node as Id, Property};

const VALUES: [(Property, i64); 2] = [(Property::KP, 150), (Property::KPV, 40)];
/// Defaults of the table.
const OLD: [i64; 2] = [120, 32];

fn id(node: u8) -> Id {
    Id::new(node).expect("a node")
}

fn set(bench: &mut Bench, node: Id, property: Property, value: i64) {
    let message = Message::set(Destination::Node(node), property, value).expect("a value with a frame");
    bench.send(&message.frame()).expect("sent");
}

fn get(bench: &mut Bench, node: Id, property: Property) -> i64 {
    bench.send(&Message::get(Destination::Node(node), property).frame()).expect("sent");
    let until_us = bench.now_us() + 100_000;
    while let Some((_, frame)) = bench.receive(until_us).expect("it never fails") {
        match Message::parse(&frame).and_then(|message| message.answered()) {
            Some((from, of, Some(value))) if (from, of) == (node, property) => return value,
            _ => {}
        }
    }
    panic!("node {}: no answer about {property:?}", node.number());
}

fn pause(bench: &mut Bench, us: u64) {
    let until_us = bench.now_us() + us;
    while bench.receive(until_us).expect("it never fails").is_some() {}
}

/// Frames of a link that a test loses: from the one on that it picks, or that one alone.
#[derive(Clone, Copy)]
enum Loss {
    None,
    /// Each SET of a property.
    Sets(Property),
    /// Each frame to a node from the first SAVE on.
    FromSave(u8),
    /// The user's ^C at the first SAVE.
    InterruptAtSave,
}

struct Bench {
    bus: Simulated,
    loss: Loss,
    saves: usize,
}

impl Bench {
    fn new(nodes: &[u8]) -> Self {
        let board = |node: &u8| Node::awake(SimBoard::standard(id(*node), Model::Averaged, 1));
        Self { bus: Simulated::with(nodes.iter().map(board).collect()), loss: Loss::None, saves: 0 }
    }

    fn boards(&mut self, nodes: &[u8]) -> Vec<Board> {
        let meet = |node: &u8| {
            let present = meet(self, id(*node), &mut |_| {}).expect("it rests");
            compare(self, present, &VALUES).expect("it answers")
        };
        nodes.iter().map(meet).collect()
    }

    fn held(&mut self, node: u8) -> [i64; 2] {
        VALUES.map(|(property, _)| get(self, id(node), property))
    }

    /// What a board holds after a reset.
    fn stored(&mut self, node: u8) -> [i64; 2] {
        for (property, _) in VALUES {
            set(self, id(node), Property::LOAD, property.id().into());
        }
        self.held(node)
    }
}

impl Link for Bench {
    fn now_us(&self) -> u64 {
        self.bus.now_us()
    }

    fn send(&mut self, frame: &Frame) -> Result<(), String> {
        let message = Message::parse(frame).expect("ours");
        let of = |property: Property| matches!(message.body, Body::Set { property: of, .. } if of == property.id());
        self.saves += usize::from(of(Property::SAVE));
        let is_lost = match self.loss {
            Loss::None | Loss::InterruptAtSave => false,
            Loss::Sets(property) => of(property),
            Loss::FromSave(node) => message.to == Destination::Node(id(node)) && self.saves > 0,
        };
        if is_lost { Ok(()) } else { self.bus.send(frame) }
    }

    fn receive(&mut self, until_us: u64) -> Result<Option<(u64, Frame)>, String> {
        self.bus.receive(until_us)
    }

    fn is_interrupted(&self) -> bool {
        matches!(self.loss, Loss::InterruptAtSave) && self.saves > 0
    }
}

#[test]
fn written_values_are_stored_and_old_ones_come_back() {
    let mut bench = Bench::new(&[1, 5]);
    let boards = bench.boards(&[1, 5]);
    assert_eq!(boards[0].present.kind, MotorKind::Link);
    assert_eq!(boards[1].changes[0], Change { property: Property::KP, old: 120, new: 150 });
    // What another host has set for a while must not be stored with it.
    set(&mut bench, id(1), Property::MV, 321);
    write(&mut bench, &boards, &mut |_| {}).expect("nothing is in the way");
    for node in [1, 5] {
        assert_eq!(bench.stored(node), [150, 40], "node {node}");
    }
    set(&mut bench, id(1), Property::LOAD, Property::MV.id().into());
    assert_ne!(get(&mut bench, id(1), Property::MV), 321, "stored what it was not asked to store");
    let back = |board: &Board| Board {
        changes: board.changes.iter().map(|c| Change { old: c.new, new: c.old, ..*c }).collect(),
        ..board.clone()
    };
    let boards: Vec<Board> = boards.iter().map(back).collect();
    write(&mut bench, &boards, &mut |_| {}).expect("nothing is in the way");
    for node in [1, 5] {
        assert_eq!(bench.stored(node), OLD, "node {node}");
    }
}

#[test]
fn refused_value_restores_every_board() {
    let mut bench = Bench::new(&[1, 2]);
    let boards = bench.boards(&[1, 2]);
    bench.loss = Loss::Sets(Property::KPV);
    let broken = write(&mut bench, &boards, &mut |_| {}).expect_err("KPV keeps its value");
    assert_eq!(broken.states, [State::Restored, State::Untouched]);
    let Failure::Failed(text) = &broken.failure else { panic!("{broken:?}") };
    assert!(text.contains("node 1: KPV reads 32 after SET, expected 40") && text.contains("next:"), "{text}");
    assert_eq!(bench.saves, 0);
    for node in [1, 2] {
        assert_eq!(bench.held(node), OLD, "node {node}");
    }
}

#[test]
fn board_that_vanishes_before_its_save_is_named_and_the_others_get_their_old_values() {
    let mut bench = Bench::new(&[1, 2, 3]);
    let boards = bench.boards(&[1, 2, 3]);
    bench.loss = Loss::FromSave(2);
    let broken = write(&mut bench, &boards, &mut |_| {}).expect_err("node 2 is silent");
    assert_eq!(broken.states, [State::Restored, State::Unknown { may_be_stored: true }, State::Restored]);
    bench.loss = Loss::None;
    assert_eq!(bench.stored(1), OLD, "what was stored is taken back");
    assert_eq!(bench.held(2), [150, 40], "as it says: it may hold new values");
    assert_eq!(bench.held(3), OLD);
}

#[test]
fn interrupt_between_two_boards_leaves_no_half() {
    let mut bench = Bench::new(&[1, 2]);
    let boards = bench.boards(&[1, 2]);
    bench.loss = Loss::InterruptAtSave;
    let broken = write(&mut bench, &boards, &mut |_| {}).expect_err("^C");
    assert_eq!((broken.failure, broken.states), (Failure::Interrupted, vec![State::Restored; 2]));
    for node in [1, 2] {
        assert_eq!(bench.stored(node), OLD, "node {node}");
    }
}

#[test]
fn missing_moving_and_sleeping_boards_are_explained() {
    let mut bench = Bench::new(&[1]);
    let Err(Failure::Failed(text)) = meet(&mut bench, id(2), &mut |_| {}) else {
        panic!("there is no node 2")
    };
    assert!(text.contains("node 2: no answer about STAT") && text.contains("power"), "{text}");
    for (property, value, what) in [(Property::MODE, 4, "MODE 4"), (Property::CMD, 13, "drives its motor")] {
        let mut bench = Bench::new(&[1]);
        meet(&mut bench, id(1), &mut |_| {}).expect("it rests");
        set(&mut bench, id(1), property, value);
        pause(&mut bench, 50_000);
        let Err(Failure::Failed(text)) = meet(&mut bench, id(1), &mut |_| {}) else { panic!("{property:?}") };
        assert!(text.contains(what) && text.contains("SET MODE 0"), "{text}");
    }
    // It coasts.
    set(&mut bench, id(1), Property::MODE, 4);
    set(&mut bench, id(1), Property::V, 600);
    pause(&mut bench, 150_000);
    set(&mut bench, id(1), Property::MODE, 0);
    let Err(Failure::Failed(text)) = meet(&mut bench, id(1), &mut |_| {}) else { panic!("it turns") };
    assert!(text.contains("its motor turns"), "{text}");
    // In its monitor, as after power-up.
    let node = Node::new(SimBoard::standard(id(1), Model::Averaged, 1));
    let mut bench = Bench { bus: Simulated::new(node), loss: Loss::None, saves: 0 };
    pause(&mut bench, 100_000);
    let mut told = Vec::new();
    meet(&mut bench, id(1), &mut |step| told.push(step.to_owned())).expect("woken");
    assert!(told.len() == 1 && told[0].contains("node 1 is asleep"), "{told:?}");
}
