//! Barrett's API 4.4.3 for the BH8-280 by CAN: it sends as node 6, so that answers come as a SET of VALUE to node 6. Compared with the
//! plant.

use hil_world::bus::Station;
use hil_world::hand::Motorized;

use super::can::{FINGERS, HAND, Host, SPREAD, emulated_280, native_280};
use crate::emulated::bench::production;

/// The API's own node.
const PC: u16 = 6;

const STAT: u8 = 5;
const MODE: u8 = 8;
const TEMP: u8 = 9;
const OTEMP: u8 = 11;
const SG: u8 = 25;
const CMD: u8 = 29;
const SAVE: u8 = 30;
const T: u8 = 42;
const MT: u8 = 43;
const V: u8 = 44;
const MV: u8 = 45;
const MCV: u8 = 46;
const MOV: u8 = 47;
const P: u8 = 48;
const DP: u8 = 50;
const OT: u8 = 54;
const CT: u8 = 56;
const M: u8 = 58;
const DS: u8 = 60;
const CTS: u8 = 68;
const PIDX: u8 = 70;
const HSG: u8 = 71;
const LSG: u8 = 72;
const IVEL: u8 = 73;
const IOFF: u8 = 74;
const HOLD: u8 = 77;
const TSTOP: u8 = 78;
const KP: u8 = 79;
const KD: u8 = 80;
const KI: u8 = 81;
const ACCEL: u8 = 82;
const JIDX: u8 = 85;
const IPNM: u8 = 86;
const POLES: u8 = 90;
const GRPA: u8 = 26;
const PTEMP: u8 = 10;
const IKP: u8 = 91;
const IKI: u8 = 92;
const IKCOR: u8 = 93;
const TIE: u8 = 100;

const RESET: u8 = 2;
const HOME: u8 = 7;
const HI: u8 = 13;
const IC: u8 = 14;
const TC: u8 = 16;
const C: u8 = 18;
const GO_DEFAULT: u8 = 19;
const O: u8 = 20;

/// The values that `Default` writes, in its order.
const DEFAULTS: [(u8, i32); 31] = [
    (TIE, 0),
    (ACCEL, 200),
    (P, 0),
    (CT, 195_000),
    (OT, 0),
    (CTS, 4096),
    (DP, 45_000),
    (MT, 3300),
    (MV, 200),
    (MCV, 200),
    (MOV, 200),
    (HOLD, 0),
    (TSTOP, 250),
    (OTEMP, 60),
    (PTEMP, 0),
    (POLES, 6),
    (IKI, 204),
    (IKP, 500),
    (IKCOR, 102),
    (IOFF, 0),
    (IVEL, -75),
    (DS, 25_600),
    (KP, 500),
    (KD, 5000),
    (KI, 0),
    (IPNM, 20_000),
    (HSG, 0),
    (LSG, 0),
    (GRPA, 0),
    (GRPA + 1, 7),
    (GRPA + 2, 8),
];

const SPREAD_DEFAULTS: [(u8, i32); 6] = [(CT, 35_950), (DP, 17_975), (MV, 50), (HSG, 0), (LSG, 0), (HOLD, 1)];

struct Api<'a, S: Station> {
    host: &'a mut Host<S>,
    nodes: &'a [u16],
}

impl<S: Motorized> Api<'_, S> {
    fn set(&mut self, node: u16, property: u8, value: i32) {
        let [a, b, c, d] = value.to_le_bytes();
        self.host.send(PC << 5 | node, &[0x80 | property, 0, a, b, c, d]);
    }

    fn command(&mut self, node: u16, cmd: u8) {
        self.host.send(PC << 5 | node, &[0x80 | CMD, 0, cmd, 0]);
    }

    /// It takes the next frame of that node to its own for the answer, within a second.
    fn get(&mut self, node: u16, property: u8) -> i32 {
        self.host.clear();
        self.host.send(PC << 5 | node, &[property]);
        let frame = self.host.read(1000).unwrap_or_else(|| panic!("GET {property} of {node}")).frame;
        assert_eq!(frame.raw_id(), node << 5 | PC, "{frame:?}");
        match *frame.data() {
            [0x87, 0, a, b] => i16::from_le_bytes([a, b]).into(),
            [0x87, 0, a, b, c, d] => i32::from_le_bytes([a, b, c, d]),
            _ => panic!("{frame:?}"),
        }
    }

    fn modes(&mut self, nodes: &[u16]) -> Vec<i32> {
        nodes.iter().map(|&node| self.get(node, MODE)).collect()
    }

    /// RESET of each, a second, and STAT until all are awake.
    fn reset(&mut self) {
        for &node in self.nodes {
            self.command(node, RESET);
        }
        self.host.sleep_ms(1000);
        let awake = (0..3).any(|_| {
            let asleep: Vec<u16> =
                self.nodes.iter().copied().filter(|&node| self.get(node, STAT) != 2).collect();
            for &node in &asleep {
                self.host.send(PC << 5 | node, &[0x80 | STAT, 0, 2, 0]);
            }
            self.host.sleep_ms(1000);
            asleep.is_empty()
        });
        assert!(awake, "all pucks should be awake after a reset");
        for &node in self.nodes {
            self.set(node, DP, 0);
            self.set(node, TSTOP, 250);
        }
    }

    /// HI of the fingers, 6 s at most, then of the spread, 4 s at most.
    fn init(&mut self) {
        let nodes = self.nodes;
        self.modes(nodes);
        let fingers: Vec<u16> = nodes.iter().copied().filter(|&node| node != SPREAD).collect();
        for &node in &fingers {
            self.command(node, HI);
        }
        let done = (0..60).any(|_| {
            self.host.sleep_ms(100);
            self.modes(&fingers).iter().all(|&mode| mode == 0)
        });
        assert!(done, "HI of the fingers");
        self.command(SPREAD, HI);
        let done = (0..40).any(|_| {
            self.host.sleep_ms(100);
            matches!(self.get(SPREAD, MODE), 0 | 3)
        });
        assert!(done, "HI of the spread");
    }

    /// The defaults of each, and SAVE of all.
    fn default(&mut self) {
        for (place, &node) in self.nodes.iter().enumerate() {
            let own: &[(u8, i32)] = if node == SPREAD { &SPREAD_DEFAULTS } else { &[] };
            let index = [3, 4, 1, 2][usize::from(node - 11)];
            for &(property, value) in
                DEFAULTS.iter().chain(own).chain(&[(JIDX, 8 + place as i32), (PIDX, index)])
            {
                self.set(node, property, value);
                self.host.sleep_ms(1);
            }
            self.set(node, SAVE, -1);
        }
        self.host.sleep_ms(100);
    }

    fn wait_for_stop(&mut self, nodes: &[u16]) {
        for &node in nodes {
            assert_ne!(self.get(node, TSTOP), 0, "it would wait forever");
        }
        let done = (0..200).any(|_| {
            self.host.sleep_ms(50);
            self.modes(nodes).iter().all(|mode| matches!(mode, 0 | 3))
        });
        assert!(done, "{:?}", self.modes(nodes));
    }

    fn all(&mut self, nodes: &[u16], cmd: u8) {
        for &node in nodes {
            self.command(node, cmd);
        }
        self.wait_for_stop(nodes);
    }

    /// Counts of the API against the plant's joint, from where IOFF 0 has put the zero: the open stop.
    fn is_at(&self, node: u16, counts: i32, what: &str) {
        let (at, wanted) = (self.host.joint_rad(node), f64::from(counts) / counts_per_rad(node));
        println!(
            "figure: {what} of Barrett's API, node {node}: {wanted:.4} rad asked, {at:.4} rad of the joint"
        );
        assert!(
            (at - wanted).abs() <= self.host.arrival_rad(node),
            "{what}, node {node}: {at} of {wanted} rad"
        );
    }
}

fn counts_per_rad(node: u16) -> f64 {
    4096.0 * if node == SPREAD { 17.5 } else { 125.0 } / std::f64::consts::TAU
}

fn drives<S: Motorized>(host: &mut Host<S>, nodes: &[u16]) {
    let mut api = Api { host, nodes };
    api.reset();
    api.init();
    api.default();
    for &node in nodes {
        let expected: Vec<(u8, i32)> =
            vec![(HSG, 0), (LSG, 0), (MCV, 200), (KP, 500), (OTEMP, 60), (GRPA + 1, 7), (GRPA + 2, 8)];
        for (property, value) in expected {
            assert_eq!(api.get(node, property), value, "{property} of {node}");
        }
    }
    // With IOFF 0 the zero is at the stop.
    api.init();
    let at_stop = api.host.joint_rad(nodes[0]) / api.host.rad_per_count(nodes[0]);
    assert!((at_stop + 25.0).abs() < 3.0, "{at_stop} counts from the zero of the default IOFF");
    api.host.mark_zeros(nodes);
    supervises(&mut api);
    runs_realtime(&mut api);
}

fn supervises<S: Motorized>(api: &mut Api<'_, S>) {
    let nodes = api.nodes;
    let fingers: Vec<u16> = nodes.iter().copied().filter(|node| FINGERS.contains(node)).collect();
    api.all(nodes, C);
    for &node in nodes {
        api.is_at(node, if node == SPREAD { 35_950 } else { 195_000 }, "Close");
    }
    api.all(nodes, O);
    for &node in nodes {
        api.is_at(node, 0, "Open");
    }
    for &node in &fingers {
        api.set(node, M, 81_487);
    }
    api.wait_for_stop(&fingers);
    for &node in &fingers {
        api.is_at(node, 81_487, "GoToPosition");
    }
    api.all(&fingers, IC);
    for &node in &fingers {
        // From where it stood, which is a whole hall count.
        api.is_at(node, 81_270 + 25_600, "StepClose");
    }
    api.all(nodes, GO_DEFAULT);
    for &node in nodes {
        api.is_at(node, if node == SPREAD { 17_975 } else { 45_000 }, "GoToDefault");
        let read = api.get(node, P);
        assert!((read - if node == SPREAD { 17_975 } else { 45_000 }).abs() <= 600, "node {node}: {read}");
    }
    api.all(nodes, HOME);
    // To the stop or as far as the torque takes it, and no further than TSTOP.
    api.all(&fingers, TC);
    for &node in &fingers {
        assert!(api.host.joint_rad(node) > 2.5, "TorqueClose, node {node}: {} rad", api.host.joint_rad(node));
    }
    api.all(&fingers, O);
    for &node in nodes {
        assert!((15..60).contains(&api.get(node, TEMP)), "°C");
        assert!((0..4096).contains(&api.get(node, SG)), "12 bits");
    }
}

/// Velocity, then position, 100 times a second, with positions as feedback.
fn runs_realtime<S: Motorized>(api: &mut Api<'_, S>) {
    let nodes = api.nodes;
    for &node in nodes {
        for (property, value) in [(TSTOP, 250), (V, 0), (MODE, 4)] {
            api.set(node, property, value);
        }
        assert_eq!(api.get(node, MODE), 4);
    }
    let speed = |node| if node == SPREAD { 5 } else { 41 };
    let mut begin = Vec::new();
    for block in 0..130 {
        if block == 30 {
            begin = nodes.iter().map(|&node| api.host.joint_rad(node)).collect();
        }
        for &node in nodes {
            api.set(node, V, speed(node));
            api.get(node, P);
        }
        let next = api.host.bus.now_us().next_multiple_of(10_000);
        api.host.bus.run_until(next);
    }
    for (&node, begin) in nodes.iter().zip(begin) {
        let (moved, wanted) =
            (api.host.joint_rad(node) - begin, f64::from(speed(node)) * 1000.0 / counts_per_rad(node));
        assert!((moved / wanted - 1.0).abs() <= 0.03, "node {node}: {moved} of {wanted} rad in a second");
    }
    for &node in nodes {
        for (property, value) in [(TSTOP, 250), (MODE, 0), (MT, 3300), (MODE, 3)] {
            api.set(node, property, value);
        }
        let from = api.get(node, P);
        for step in 1..=50 {
            api.set(node, P, from + 200 * step);
            api.host.sleep_ms(10);
        }
        api.host.sleep_ms(300);
        let at = api.get(node, P);
        assert!((at - from - 10_000).abs() <= 4 * 581, "node {node}: {at}, from {from}");
        for (property, value) in [(MODE, 0), (MODE, 2), (T, 0), (MODE, 0)] {
            api.set(node, property, value);
        }
        assert_eq!(api.get(node, MODE), 0);
    }
}

#[test]
fn barretts_api_as_node_6_drives_native_boards() {
    drives(&mut native_280(&HAND), &HAND);
}

#[test]
fn barretts_api_as_node_6_drives_emulated_boards() {
    let Some(programs) = production() else { return };
    let nodes = [11, SPREAD];
    drives(&mut emulated_280(&programs, &nodes), &nodes);
}
