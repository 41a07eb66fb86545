//! A host on the bus that knows frames only, and boards of a hand beside an arm: nodes 11 to 14, in group 5.

use std::f64::consts::TAU;

use board_emu::board::Board;
use board_emu::image::Programs;
use boot::Chip as _;
use boot::storage::{Progress, Store};
use hil_world::board::SimBoard;
use hil_world::bus::{Adapter, Bus, Stamped, Station};
use hil_world::hand::Motorized;
use hil_world::node::{Node, shipped_storage, store};
use hil_world::plant::Model;
use hil_world::rig::Truth;
use hil_world::rig::flash::SimFlash;
use tater_f103::map::{FLASH, STORAGE};
use tater_wire::property::host_units::{BH8_280, OWN};
use tater_wire::{Frame, MotorKind, Node as Id, Property};

use crate::emulated::bench::flashed;

pub const FINGERS: [u16; 3] = [11, 12, 13];
pub const SPREAD: u16 = 14;
pub const HAND: [u16; 4] = [11, 12, 13, 14];

/// Group 5, and all boards.
pub const GROUP: u16 = 0x405;
pub const ALL: u16 = 0x400;

/// Barrett's 32-bit properties, as pyHand lists them.
const WIDE: [u8; 12] = [48, 50, 52, 54, 56, 58, 66, 68, 74, 88, 96, 98];

pub struct Host<S: Station> {
    pub bus: Bus<S>,
    nodes: Vec<u16>,
    /// Where each joint truly was when its board was at P 0: its rotor, and the count of its sensors.
    zeros: Vec<(f64, i64)>,
}

fn id(number: u16) -> Id {
    u8::try_from(number).ok().and_then(Id::new).expect("a node")
}

/// Native boards in their monitors.
pub fn native(nodes: &[u16]) -> Host<Node> {
    native_in(nodes, OWN)
}

/// The same in the units of a BH8-280.
pub fn native_280(nodes: &[u16]) -> Host<Node> {
    native_in(nodes, BH8_280)
}

fn native_in(nodes: &[u16], host_units: i64) -> Host<Node> {
    let node = |&n: &u16| {
        let mut board = SimBoard::standard(id(n), Model::Averaged, u64::from(n));
        store(board.flash(), Property::HOSTUNITS, host_units);
        Node::new(board)
    };
    Host::new(nodes, nodes.iter().map(node).collect())
}

/// Emulated boards in their monitors. Straps have three bits, so the node is stored, as `cargo xtask flash --node` does it.
pub fn emulated(programs: &Programs, nodes: &[u16]) -> Host<Board> {
    emulated_in(programs, nodes, OWN)
}

/// The same in the units of a BH8-280.
pub fn emulated_280(programs: &Programs, nodes: &[u16]) -> Host<Board> {
    emulated_in(programs, nodes, BH8_280)
}

fn emulated_in(programs: &Programs, nodes: &[u16], host_units: i64) -> Host<Board> {
    let board = |&node: &u16| {
        let straps = u8::try_from(node % 10).expect("1 to 7");
        let mut board = flashed(programs, straps);
        let mut flash = SimFlash::default();
        flash.load(STORAGE.start, &shipped_storage());
        let mut store = Store::open(&flash);
        store.set(Property::ID, node.into());
        while store.step(&mut flash, true) != Progress::Done {}
        self::store(&mut flash, Property::HOSTUNITS, host_units);
        let storage = &flash.bytes()[(STORAGE.start - FLASH.start) as usize..][..STORAGE.len as usize];
        board.machine_mut().chip_mut().flash.load(STORAGE.start, storage);
        board.power_on();
        board
    };
    Host::new(nodes, nodes.iter().map(board).collect())
}

impl<S: Station> Host<S> {
    fn new(nodes: &[u16], boards: Vec<S>) -> Self {
        let mut bus = Bus::new(boards);
        bus.plug_host("host", Adapter::default()).expect("the first host");
        let mut host = Self { bus, nodes: nodes.to_vec(), zeros: vec![(0.0, 0); nodes.len()] };
        host.sleep_ms(200);
        host
    }

    pub fn sleep_ms(&mut self, ms: u64) {
        let until = self.bus.now_us() + 1_000 * ms;
        self.bus.run_until(until);
    }

    pub fn send(&mut self, to: u16, data: &[u8]) {
        self.bus.send(Frame::from_raw(to, data).expect("a frame")).expect("plugged");
    }

    pub fn set(&mut self, to: u16, property: u8, value: i32) {
        let [a, b, c, d] = value.to_le_bytes();
        if WIDE.contains(&property) {
            self.send(to, &[0x80 | property, 0, a, b, c, d]);
        } else {
            self.send(to, &[0x80 | property, 0, a, b]);
        }
    }

    /// The next frame, within so many ms.
    pub fn read(&mut self, ms: u64) -> Option<Stamped> {
        let deadline = self.bus.now_us() + 1_000 * ms;
        self.bus.wait(deadline)
    }

    pub fn clear(&mut self) {
        while self.bus.receive().is_some() {}
    }

    /// The value of a property, signed; `None` if no frame comes within so many ms. Any other frame than the answer is an error: these
    /// hosts take the next frame for it.
    pub fn get_within(&mut self, node: u16, property: u8, ms: u64) -> Option<i32> {
        self.clear();
        self.send(node, &[property]);
        let frame = self.read(ms)?.frame;
        let value = match *frame.data() {
            [high, middle, low] if frame.raw_id() == 0x403 | node << 5 => {
                // 22 bits, signed.
                (i32::from_be_bytes([0, high, middle, low]) << 10) >> 10
            }
            [id, 0, a, b] if frame.raw_id() == 0x406 | node << 5 && id == 0x80 | property => {
                i32::from(i16::from_le_bytes([a, b]))
            }
            [id, 0, a, b, c, d] if frame.raw_id() == 0x406 | node << 5 && id == 0x80 | property => {
                i32::from_le_bytes([a, b, c, d])
            }
            _ => panic!("GET {property} of {node}: {frame:?}"),
        };
        Some(value)
    }

    pub fn get(&mut self, node: u16, property: u8) -> i32 {
        self.get_within(node, property, 50).unwrap_or_else(|| panic!("GET {property} of {node}: no answer"))
    }

    pub fn get_all<const N: usize>(&mut self, nodes: [u16; N], property: u8) -> [i32; N] {
        nodes.map(|node| self.get(node, property))
    }

    /// Asks the group once; the answers of its members by node.
    pub fn get_group(&mut self, property: u8, members: &[u16]) -> Vec<i32> {
        self.clear();
        self.send(GROUP, &[property]);
        let mut values = vec![None; members.len()];
        for _ in members {
            let frame = self.read(10).expect("an answer of each member").frame;
            let &[id, 0, a, b] = frame.data() else { panic!("{frame:?}") };
            assert_eq!((id, frame.raw_id() & 0x41F), (0x80 | property, 0x406), "{frame:?}");
            let node = frame.raw_id() >> 5 & 31;
            let place = members.iter().position(|&member| member == node).expect("a member");
            values[place] = Some(i32::from(i16::from_le_bytes([a, b])));
        }
        values.into_iter().map(|value| value.expect("each once")).collect()
    }
}

impl<S: Motorized> Host<S> {
    fn place(&self, node: u16) -> usize {
        self.nodes.iter().position(|&own| own == node).expect("a board of this bus")
    }

    fn truth(&self, node: u16) -> Truth {
        self.bus.stations().nth(self.place(node)).expect("as many as nodes").rig().truth()
    }

    /// Takes the present place of a board that HI has left at P 0 for the zero of [`Self::joint_rad`]: HI presses the stop, whose gear
    /// gives way by a count or two, so that its zero is that far from the drawing's.
    pub fn mark_zeros(&mut self, nodes: &[u16]) {
        for &node in nodes {
            // The position frame, in either unit.
            assert_eq!(self.get(node, 48), 0, "node {node} after HI");
            let place = self.place(node);
            let cell = self.bus.stations().nth(place).expect("as many as nodes").rig().hall_cell();
            self.zeros[place] = (self.truth(node).counts, cell);
        }
    }

    /// Where the joint truly is, radians from the marked zero.
    pub fn joint_rad(&self, node: u16) -> f64 {
        (self.truth(node).counts - self.zeros[self.place(node)].0) * self.rad_per_count(node)
    }

    /// The motor's true torque, at the joint behind a gear without loss.
    pub fn joint_torque_n_m(&self, node: u16) -> f64 {
        self.truth(node).torque_n_m * gear(node)
    }

    /// How many counts of its sensors the rotor has truly passed since the marked zero.
    pub fn counts(&self, node: u16) -> i64 {
        let place = self.place(node);
        self.bus.stations().nth(place).expect("as many as nodes").rig().hall_cell() - self.zeros[place].1
    }

    /// How far a joint that has arrived may be from where it was sent: half a count that the goal is rounded by, and half a count at each
    /// end, within which the rotor may stand.
    pub fn arrival_rad(&self, node: u16) -> f64 {
        1.5 * self.rad_per_count(node)
    }

    /// The angle of the joint between two hall counts.
    #[allow(clippy::unused_self, reason = "reads as the others do")]
    pub fn rad_per_count(&self, node: u16) -> f64 {
        TAU / (18.0 * gear(node))
    }
}

/// Revolutions of the motor for one of the joint (manual 1.3.2, table 2).
fn gear(node: u16) -> f64 {
    MotorKind::of(id(node)).gear_hundredths() as f64 / 100.0
}
