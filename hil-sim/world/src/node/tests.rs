use super::*;
use crate::bus::{Adapter, Bus, Stamped};
use crate::plant::Model;
use tater_wire::{Body, Destination, Group, Message, Property};

fn to(number: u8) -> Destination {
    Destination::Node(tater_wire::Node::new(number).expect("a node"))
}

fn bus(nodes: &[u8]) -> Bus<Node> {
    let board = |&n: &u8| {
        SimBoard::standard(tater_wire::Node::new(n).expect("a node"), Model::Averaged, u64::from(n))
    };
    let mut bus = Bus::new(nodes.iter().map(board).map(Node::new).collect());
    bus.plug_host("tests", Adapter::default()).expect("the first host");
    bus
}

fn set(bus: &mut Bus<Node>, node: u8, property: Property, value: i64) {
    bus.send(Message::set(to(node), property, value).expect("fits").frame()).expect("plugged");
}

fn get(bus: &mut Bus<Node>, node: u8, property: Property) {
    bus.send(Message::get(to(node), property).frame()).expect("plugged");
}

/// All frames that the host receives during a wake and a move.
fn heard(slice_us: u64) -> Vec<Stamped> {
    let mut bus = bus(&[4, 5]);
    let mut heard = Vec::new();
    for ms in 0..1_500 {
        match ms {
            20 => set(&mut bus, 4, Property::STAT, 2),
            100 => set(&mut bus, 4, Property::M, 100),
            _ if ms % 10 == 0 => get(&mut bus, 4, Property::P),
            _ => get(&mut bus, 5, Property::STAT),
        }
        while bus.now_us() < 1_000 * (ms + 1) {
            bus.run_until((bus.now_us() + slice_us).min(1_000 * (ms + 1)));
        }
        heard.extend(std::iter::from_fn(|| bus.receive()));
    }
    heard
}

fn said(stamped: &Stamped) -> Option<Body> {
    Message::parse(&stamped.frame).map(|message| message.body)
}

#[test]
fn time_slices_do_not_change_the_result() {
    let whole = heard(1_000);
    assert!(whole.len() > 1_000, "{}", whole.len());
    for slice_us in [7, 130, 333] {
        let sliced = heard(slice_us);
        assert_eq!(sliced.len(), whole.len(), "in slices of {slice_us} us");
        // A plant step ends with its slice, so an edge may round to the next microsecond and a poll at that time may
        // read the previous count: with 148 polls and 90 edges in 900,000 µs, in one of 70 runs.
        let apart: Vec<_> = sliced.iter().zip(&whole).filter(|(a, b)| a != b).collect();
        assert!(apart.len() <= 1, "in slices of {slice_us} us: {apart:?}");
        for (a, b) in apart {
            let (Some(Body::Position(a)), Some(Body::Position(b))) = (said(a), said(b)) else {
                panic!("in slices of {slice_us} us: {a:?}, {b:?}");
            };
            assert_eq!(a.abs_diff(b), 1, "in slices of {slice_us} us");
        }
    }
}

#[test]
fn checksum_of_the_application_takes_time() {
    let mut bus = bus(&[4]);
    bus.run_until(50_000);
    set(&mut bus, 4, Property::STAT, 2);
    let awake_us = (50_000u64..)
        .step_by(100)
        .find(|&at| {
            bus.run_until(at);
            bus.stations().all(|node| node.application().is_some())
        })
        .expect("it wakes");
    // The placeholder has 1 KiB: four slices.
    assert!((50_600..51_400).contains(&awake_us), "{awake_us}");
}

#[test]
fn board_in_reset_neither_receives_nor_acknowledges() {
    let mut pair = bus(&[4, 5]);
    pair.run_until(20_000);
    pair.station_mut(0).expect("node 4").power_on();
    get(&mut pair, 4, Property::STAT);
    pair.run_until(40_000);
    assert_eq!(pair.receive(), None, "node 5 has acknowledged it, node 4 was not there");
    get(&mut pair, 4, Property::STAT);
    pair.run_until(60_000);
    assert!(pair.receive().is_some());

    let mut alone = bus(&[4]);
    alone.run_until(20_000);
    alone.station_mut(0).expect("node 4").power_off();
    get(&mut alone, 4, Property::STAT);
    alone.run_until(40_000);
    assert_eq!(alone.waiting(), 1, "nobody acknowledges");
    alone.station_mut(0).expect("node 4").power_on();
    alone.run_until(60_000);
    assert!(alone.receive().is_some(), "sent until somebody did");
}

#[test]
fn unfed_watchdog_resets_the_board() {
    let mut node = Node::awake(SimBoard::standard(tater_wire::Node::new(4).expect("4"), Model::Averaged, 1));
    node.advance(3_000_000);
    assert_eq!(node.watchdog_resets(), 0, "it is fed");
    // A program that its flash stalls forever feeds no watchdog.
    node.busy_until_us = u64::MAX;
    node.advance(4_000_000);
    assert_eq!(node.watchdog_resets(), 1);
    assert!(node.application().is_none(), "back in the monitor");
    node.advance(4_020_000);
    assert_eq!(error(&mut node), Some(i64::from(FaultCode::Watchdog.code())));
    node.power_on();
    node.advance(4_040_000);
    assert_eq!(error(&mut node), Some(0), "power-up");
}

#[test]
fn ordered_reset_is_no_error() {
    let mut node = Node::awake(SimBoard::standard(tater_wire::Node::new(4).expect("4"), Model::Averaged, 1));
    node.reset(Some(FaultCode::Watchdog));
    node.start_application();
    let reset = Message::set(to(4), Property::STAT, 0).expect("fits").frame();
    node.receive(&reset).expect("taken");
    assert!(node.application().is_none(), "in the monitor");
    assert_eq!(error(&mut node), Some(0));
}

#[test]
fn filters_drop_frames_for_other_boards() {
    let mut node = Node::new(SimBoard::standard(tater_wire::Node::new(5).expect("5"), Model::Averaged, 1));
    let group = |number| Destination::Group(Group::new(number).expect("a group"));
    let heard = |node: &Node| -> Vec<u8> {
        (0..32).filter(|&n| node.board().accepts(&Message::get(group(n), Property::P).frame())).collect()
    };
    assert_eq!(heard(&node), [0, 2, 4]);
    node.start_application();
    node.receive(&Message::set(to(5), Property::GRPA, 17).expect("fits").frame()).expect("taken");
    assert_eq!(heard(&node), [0, 2, 4, 17]);
    let nodes = |n: &u8| node.board().accepts(&Message::get(to(*n), Property::P).frame());
    assert_eq!((0..32).filter(nodes).collect::<Vec<_>>(), [5]);
    node.power_off();
    assert_eq!(heard(&node), [0], "until a program has said what it listens to");
}

fn error(node: &mut Node) -> Option<i64> {
    node.receive(&Message::get(to(4), Property::ERROR).frame()).expect("heard");
    let frame = *node.mailboxes().first()?;
    node.sent(&frame);
    match Message::parse(&frame)?.body {
        Body::Set { value, .. } => Some(Property::ERROR.read(value)),
        _ => None,
    }
}
