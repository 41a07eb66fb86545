//! Boards on a bus: waking, finding their stops, moving, and every fault that bus, board and flash can have.

use crate::Record;
use flate2::Crc;
use hil_world::board::SimBoard;

use hil_world::bus::{Adapter, Bus, Noise};
use hil_world::node::{Node, store};
use hil_world::plant::Model;
use hil_world::rig::{Object, RigParams, Side};
use tater_f103::map::STORAGE;
use tater_wire::{Cmd, Destination, Frame, Group, Identifier, Message, MotorKind, Property};

fn id(number: u8) -> tater_wire::Node {
    tater_wire::Node::new(number).expect("a node")
}

fn bus(nodes: &[u8], model: Model) -> Bus<Node> {
    let board = |&number: &u8| SimBoard::standard(id(number), model, u64::from(number));
    let mut bus = Bus::new(nodes.iter().map(board).map(Node::new).collect());
    bus.plug_host("record", Adapter { out_us: 125, in_us: 250 }).expect("the first host");
    bus.tap(true);
    bus
}

fn to(number: u8) -> Destination {
    Destination::Node(id(number))
}

fn set(bus: &mut Bus<Node>, to: Destination, property: Property, value: i64) {
    bus.send(Message::set(to, property, value).expect("fits").frame()).expect("plugged");
}

/// Advances by `ms`, asking every board for its place and mode, and notes what was heard every 20 ms.
fn watch(record: &mut Record, what: &str, bus: &mut Bus<Node>, ms: u64) {
    let begin_us = bus.now_us();
    for part in 1..=ms.div_ceil(20) {
        for number in 1..=7 {
            for property in [Property::P, Property::MODE, Property::STAT] {
                bus.send(Message::get(to(number), property).frame()).expect("plugged");
            }
        }
        bus.run_until(begin_us + 20_000 * part);
        let heard: Vec<_> = std::iter::from_fn(|| bus.receive()).collect();
        let tapped: Vec<_> = std::iter::from_fn(|| bus.tapped()).collect();
        let stats = bus.stats().clone();
        let nodes: Vec<_> = bus.stations().map(of_node).collect();
        let events: Vec<_> = (0..nodes.len())
            .filter_map(|index| {
                let node = bus.station_mut(index)?;
                Some(std::iter::from_fn(|| node.board_event()).collect::<Vec<_>>())
            })
            .collect();
        let places = bus.stations().map(|node| format!("{:.2}", node.board().rig().truth().counts));
        let places = places.collect::<Vec<_>>().join(" ");
        let shown = format!(
            "{what} {} ms: {} heard, {} frames, {} errors, at {places}",
            bus.now_us() / 1000,
            heard.len(),
            stats.frames,
            stats.errors
        );
        record.note(shown, &(heard, tapped, stats, nodes, events, bus.waiting(), bus.strangers_waiting()));
    }
}

/// All that a board shows.
fn of_node(node: &Node) -> String {
    let board = node.board();
    let flash = board.sim_flash();
    let sample = node.sample();
    let mut stored = Crc::new();
    stored.update(flash.bytes());
    let estimates = sample.map(|sample| (sample.estimated_counts(), sample.setpoint_counts()));
    format!(
        "{sample:?} {estimates:?} {:?}",
        (
            (board.rig().truth(), board.bridge_now(), board.driven_since_us(), board.is_brake_released()),
            (board.resets(), board.feeds(), board.tick_feeds(), board.mailboxes()),
            (flash.operations(), flash.is_dead(), flash.is_busy(), flash.was_damaged(), flash.erases()),
            (flash.erased_while_driven(), flash.page_in_use(), stored.sum()),
            (node.starts(), node.is_on(), node.watchdog_resets(), node.heard_us(), node.stamp()),
        )
    )
}

/// Three boards live through a day.
fn day(model: Model) -> Record {
    let mut record = Record::new(&format!("boards, {model:?}"));
    let bus = &mut bus(&[1, 4, 5], model);
    watch(&mut record, "asleep", bus, 40);
    set(bus, Destination::Group(Group::ALL), Property::STAT, 2);
    watch(&mut record, "waking", bus, 60);
    for node in [1, 4, 5] {
        set(bus, to(node), Property::CMD, i64::from(Cmd::Hi.number()));
    }
    watch(&mut record, "finding their stops", bus, 1_600);
    for (node, goal) in [(1, 200), (4, 120), (5, 60)] {
        set(bus, to(node), Property::M, goal);
    }
    watch(&mut record, "moving", bus, 400);
    set(bus, to(1), Property::MODE, 4);
    set(bus, to(1), Property::V, -60);
    set(bus, to(4), Property::MODE, 2);
    set(bus, to(4), Property::T, 120);
    watch(&mut record, "velocity and torque", bus, 200);
    record
}

/// Of the bus: noise, a cut cable, a station off the bus or held, strangers, a guest, a host that leaves.
fn bad_bus() -> Record {
    let mut record = Record::new("a bad bus");
    let bus = &mut bus(&[2, 6], Model::Averaged);
    bus.run_until(30_000);
    set(bus, Destination::Group(Group::ALL), Property::STAT, 2);
    watch(&mut record, "waking", bus, 60);
    bus.set_medium(Noise::new(5, 0.05, 0.1));
    watch(&mut record, "noise", bus, 100);
    bus.cut(0, true);
    watch(&mut record, "cut", bus, 40);
    bus.cut(0, false);
    bus.put_bus_off(1);
    watch(&mut record, "bus-off", bus, 40);
    bus.hold(0, bus.now_us() + 15_000);
    watch(&mut record, "held", bus, 40);
    for data in 0..40 {
        let frame = Frame::new(Identifier { from: id(3), to: to(2) }, &[0x80 | data, 1, 2]);
        bus.intrude(frame.expect("three bytes"));
    }
    bus.run_until(bus.now_us() + 3_000);
    bus.silence_strangers();
    watch(&mut record, "strangers", bus, 40);
    bus.plug_guest(Node::awake(SimBoard::standard(id(6), Model::Averaged, 99).with_chip(77)));
    watch(&mut record, "a second node 6", bus, 60);
    let guest = bus.unplug_guest().map(|guest| of_node(&guest));
    record.note("the guest", &guest);
    bus.unplug_host();
    bus.plug_host("another", Adapter::default()).expect("the place is free");
    watch(&mut record, "another host", bus, 40);
    record
}

/// Of the boards: a hang, a loss of power, a clock that drifts, a cut in the flash, flipped bits, worn pages, other wiring.
fn bad_boards() -> Record {
    let mut record = Record::new("bad boards");
    let bus = &mut bus(&[3, 4, 7], Model::Averaged);
    for index in 0..3 {
        let flash = bus.station_mut(index).expect("a board").board_mut();
        store(boot::Chip::flash(flash), Property::MV, 50);
    }
    set(bus, Destination::Group(Group::ALL), Property::STAT, 2);
    watch(&mut record, "waking", bus, 60);
    let board =
        |bus: &mut Bus<Node>, index, act: &dyn Fn(&mut Node)| act(bus.station_mut(index).expect("a board"));
    for node in [3, 4, 7] {
        set(bus, to(node), Property::MODE, 4);
        set(bus, to(node), Property::V, 40);
    }
    watch(&mut record, "turning", bus, 100);
    board(bus, 0, &|node| node.set_drift_ppm(20_000));
    board(bus, 1, &|node| node.rig_mut().trip());
    board(bus, 2, &Node::power_off);
    watch(&mut record, "drift, trip, no power", bus, 100);
    board(bus, 2, &Node::power_on);
    board(bus, 1, &|node| node.keep_heat(0x1234_5678));
    set(bus, to(3), Property::MV, 70);
    set(bus, to(3), Property::SAVE, i64::from(Property::MV as u8));
    watch(&mut record, "power again, stored", bus, 200);
    board(bus, 0, &|node| boot::Chip::flash(node.board_mut()).cut_at(40, 8));
    board(bus, 1, &|node| {
        let flash = boot::Chip::flash(node.board_mut());
        flash.flip(STORAGE.start + 20, 3);
        flash.weaken(STORAGE.start + 24, 0x00F0);
        flash.set_worn_pages(1);
    });
    for (node, property) in [(3, Property::KP), (3, Property::KD), (4, Property::KP), (4, Property::MV)] {
        set(bus, to(node), property, 33);
        set(bus, to(node), Property::SAVE, i64::from(property as u8));
    }
    watch(&mut record, "cut, flipped, worn", bus, 400);
    board(bus, 0, &Node::power_on);
    board(bus, 1, &|node| node.hang(300_000));
    watch(&mut record, "a hang", bus, 460);
    record
}

/// Boards that wake without knowing their wiring, or against an object.
fn unwired() -> Record {
    let mut record = Record::new("unwired");
    let sensors = RigParams {
        phases: [2, 0, 1],
        halls: [1, 0, 2],
        inverted: [false, true, false],
        ..RigParams::default()
    };
    let unwired = SimBoard::with(30.0, id(5), sensors, &[], Model::Averaged, 4).expect("in range");
    let object =
        Object { from_count: 90.0, stiffness_n_m_rad: 0.5, damping_n_m_s: 1e-4, side: Side::Closing };
    let pressed = SimBoard::with(60.0, id(4), RigParams::default(), &[object], Model::Averaged, 4);
    let mut pressed = Node::awake(pressed.expect("in range"));
    pressed.trust_direction();
    let bus = &mut Bus::new(vec![Node::unwired(unwired), pressed]);
    bus.plug_host("record", Adapter::default()).expect("the first host");
    bus.run_until(20_000);
    set(bus, to(5), Property::FIND, 1);
    set(bus, to(4), Property::MODE, 4);
    set(bus, to(4), Property::V, 50);
    watch(&mut record, "finding", bus, 2_000);
    let stored = bus.stations().map(|node| node.board().sim_flash().bytes().to_vec()).collect::<Vec<_>>();
    record.note(format!("a {:?} board's flash", MotorKind::of(id(5))), &stored);
    record
}

pub fn scenes() -> Vec<Record> {
    vec![day(Model::Averaged), day(Model::Switched), bad_bus(), bad_boards(), unwired()]
}
