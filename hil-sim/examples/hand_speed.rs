//! Simulation speed of seven boards with their motors and the bus, averaged model, on one core: asleep, idle,
//! holding, moving. `cargo run --release -p hil-sim --example hand_speed`

use std::time::Instant;

use hil_world::board::SimBoard;
use hil_world::bus::{Adapter, Bus};
use hil_world::node::Node;
use hil_world::plant::Model;
use tater_wire::{Destination, Message, Node as Id, Property};

const SECONDS: u64 = 20;

fn nodes(awake: bool) -> Bus<Node> {
    let boards = (1..=7).filter_map(Id::new).map(|id| {
        let board = SimBoard::standard(id, Model::Averaged, id.number().into());
        if awake { Node::awake(board) } else { Node::new(board) }
    });
    let mut bus = Bus::new(boards.collect());
    bus.plug_host("host", Adapter::default()).expect("the first");
    bus.run_until(100_000);
    bus
}

fn set(bus: &mut Bus<Node>, property: Property, value: impl Fn(u8) -> i64) {
    for id in (1..=7).filter_map(Id::new) {
        let message = Message::set(Destination::Node(id), property, value(id.number())).expect("in range");
        bus.send(message.frame()).expect("plugged");
    }
    bus.run_until(bus.now_us() + 2_000);
}

fn measure(name: &str, bus: &mut Bus<Node>, mut each_s: impl FnMut(&mut Bus<Node>, u64)) {
    let begun = Instant::now();
    for second in 0..SECONDS {
        each_s(bus, second);
        bus.run_until(bus.now_us() + 1_000_000);
        while bus.receive().is_some() {}
    }
    println!("{name:<8} {:6.1} x real time", SECONDS as f64 / begun.elapsed().as_secs_f64());
}

fn main() {
    measure("asleep", &mut nodes(false), |_, _| {});
    let mut bus = nodes(true);
    measure("idle", &mut bus, |_, _| {});
    set(&mut bus, Property::MODE, |_| 3);
    measure("holding", &mut bus, |_, _| {});
    measure("moving", &mut bus, |bus, second| {
        set(bus, Property::M, |number| {
            if second % 2 == 1 {
                10
            } else if number == 4 {
                150
            } else {
                300
            }
        });
    });
}
