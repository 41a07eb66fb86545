//! `apply` and its undo through a link that loses, doubles and damages lines and characters, is cut off, or meets ^C: two native boards
//! in simulated time behind the codec of both sides.
//!
//! Afterwards a board holds its old values or the new ones, in RAM and in its storage, and in all other stored properties what it held before.
//! Otherwise the run says so of this board, and its file leads back.
//!
//! `EFFORT=84 cargo test --release -p system-tests bad_link` makes 10,000 runs; `SEED=N` repeats one.

use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use tater_wire::property::{Access, Stored};
use tater_wire::{Destination, Frame, Message, Node as Id, Property};
use wraptor::slcan::line::{self, Lines, Said};

use crate::effort::seeds;
use commission::adapter::Adapter;
use commission::apply::{Broken, State};
use commission::excite::Link;
use commission::undo::{Kept, Undo, read_boards, write_back, write_kept};
use hil_sim::simulated::Simulated;
use hil_sim::slcan::Slcan;
use hil_world::board::SimBoard;
use hil_world::node::Node;
use hil_world::plant::Model;

/// Runs of the default: each damage alone and all together, with every rate, several times.
const RUNS: u64 = 120;

const NODES: [u8; 2] = [1, 2];

/// In 16 and 32 bits, near both ends of their ranges, and one that stays as it is.
const NEW: [(Property, i64); 6] = [
    (Property::KP, 150),
    (Property::KD, 700),
    (Property::KPV, 255),
    (Property::HOLD, 1),
    (Property::DP, -30),
    (Property::MPE, 4),
];

/// What a link does to a line, each with its probability.
#[derive(Clone, Copy, Debug, Default)]
struct Rates {
    lost: f64,
    doubled: f64,
    /// A second copy comes after some later lines.
    late: f64,
    /// A character is lost, doubled, added, or another one.
    damaged: f64,
    /// The adapter is gone after so many lines.
    cut: Option<u64>,
    /// ^C after so many.
    interrupt: Option<u64>,
}

impl Rates {
    fn draw(rng: &mut Pcg64Mcg) -> Self {
        let mut rate = |bit: bool| if bit { [0.002, 0.01, 0.03][rng.random_range(0..3)] } else { 0.0 };
        let [lost, doubled, late, damaged] = [true; 4].map(&mut rate);
        let mut keep = |rate: f64| if rng.random_bool(0.5) { rate } else { 0.0 };
        let [lost, doubled, late, damaged] = [lost, doubled, late, damaged].map(&mut keep);
        let cut = rng.random_bool(0.2).then(|| rng.random_range(1..1500));
        let interrupt = rng.random_bool(0.1).then(|| rng.random_range(1..1500));
        Self { lost, doubled, late, damaged, cut, interrupt }
    }
}

/// Two boards, an adapter, and a line between the adapter and its host.
struct Bench {
    bus: Simulated,
    adapter: Slcan,
    to_host: Lines,
    inbox: Vec<(u64, Frame)>,
    /// Copies that come later, with the lines that come before: to the adapter, to the host.
    late: [Vec<(u8, Vec<u8>)>; 2],
    rates: Rates,
    rng: Pcg64Mcg,
    lines: u64,
}

impl Bench {
    fn new(seed: u64) -> Self {
        let board = |node: u8| {
            Node::awake(SimBoard::standard(Id::new(node).expect("a node"), Model::Averaged, u64::from(node)))
        };
        Self {
            bus: Simulated::with(NODES.map(board).into()),
            adapter: Slcan::default(),
            to_host: Lines::default(),
            inbox: Vec::new(),
            late: [Vec::new(), Vec::new()],
            rates: Rates::default(),
            rng: Pcg64Mcg::seed_from_u64(seed),
            lines: 0,
        }
    }

    /// As each program does: a digit may have become the command that closes the channel.
    fn open(&mut self) {
        for byte in b"\rC\rS8\rO\r" {
            assert_eq!(self.adapter.push(*byte, &mut Vec::new()), None);
        }
    }

    /// What arrives of a line.
    fn pass(&mut self, line: &str, side: usize) -> Vec<u8> {
        let mut out = Vec::new();
        for (after, copy) in &mut self.late[side] {
            *after = after.saturating_sub(1);
            if *after == 0 {
                out.append(copy);
            }
        }
        self.late[side].retain(|(_, copy)| !copy.is_empty());
        let mut bytes = line.as_bytes().to_vec();
        if self.rng.random_bool(self.rates.damaged) {
            let at = self.rng.random_range(0..bytes.len());
            let other = b"0123456789ABCDEFt+\rz "[self.rng.random_range(0..21)];
            match self.rng.random_range(0..4) {
                0 => _ = bytes.remove(at),
                1 => bytes.insert(at, bytes[at]),
                2 => bytes.insert(at, other),
                _ => bytes[at] = other,
            }
        }
        let is_lost = self.rng.random_bool(self.rates.lost);
        if self.rng.random_bool(self.rates.late) {
            let after = self.rng.random_range(1..20);
            self.late[side].push((after, bytes.clone()));
        }
        if !is_lost {
            out.extend(&bytes);
        }
        if self.rng.random_bool(self.rates.doubled) {
            out.extend(&bytes);
        }
        out
    }

    fn count(&mut self) -> Result<(), String> {
        self.lines += 1;
        if self.rates.cut.is_some_and(|cut| self.lines >= cut) { Err("cut off".to_owned()) } else { Ok(()) }
    }
}

impl Link for Bench {
    fn now_us(&self) -> u64 {
        self.bus.now_us()
    }

    fn send(&mut self, frame: &Frame) -> Result<(), String> {
        self.count()?;
        let arrived = self.pass(&(line::format(frame, None) + "\r"), 0);
        for byte in arrived {
            if let Some(frame) = self.adapter.push(byte, &mut Vec::new()) {
                self.bus.send(&frame)?;
            }
        }
        Ok(())
    }

    fn receive(&mut self, until_us: u64) -> Result<Option<(u64, Frame)>, String> {
        loop {
            if !self.inbox.is_empty() {
                return Ok(Some(self.inbox.remove(0)));
            }
            let Some((at_us, frame)) = self.bus.receive(until_us)? else { return Ok(None) };
            self.count()?;
            let mut text = Vec::new();
            self.adapter.frame(&hil_world::bus::Stamped { at_us, frame }, &mut text);
            let text = String::from_utf8(text).expect("ASCII");
            for byte in self.pass(&text, 1) {
                let inbox = &mut self.inbox;
                self.to_host.push(byte, &mut |said| {
                    if let Said::Frame(frame) = said {
                        inbox.push((at_us, frame));
                    }
                });
            }
        }
    }

    fn is_interrupted(&self) -> bool {
        self.rates.interrupt.is_some_and(|lines| self.lines >= lines)
    }
}

/// What the boards hold, asked without the link: in RAM, and then what a reset would bring.
struct Truth {
    ram: Vec<Vec<i64>>,
    stored: Vec<Vec<i64>>,
    rest: Vec<Vec<i64>>,
}

fn truth(bench: &mut Bench) -> Truth {
    // What is on its way arrives first.
    bench.rates = Rates::default();
    bench.late = [Vec::new(), Vec::new()];
    bench.to_host = Lines::default();
    bench.adapter.push(b'\r', &mut Vec::new());
    bench.inbox.clear();
    let until_us = bench.now_us() + 300_000;
    while bench.bus.receive(until_us).expect("in memory").is_some() {}
    let read = |bench: &mut Bench, node: u8, property: Property| {
        let to = Destination::Node(Id::new(node).expect("a node"));
        for _ in 0..50 {
            bench.bus.send(&Message::get(to, property).frame()).expect("in memory");
            let until_us = bench.now_us() + 100_000;
            while let Some((_, frame)) = bench.bus.receive(until_us).expect("in memory") {
                match Message::parse(&frame).and_then(|message| message.answered()) {
                    Some((from, of, Some(value))) if (from.number(), of) == (node, property) => return value,
                    _ => {}
                }
            }
        }
        panic!("node {node} is silent about {property:?}")
    };
    let is_rest = |property: &&Property| {
        let rules = property.rules();
        let is_stored = rules.stored == Stored::Yes && rules.access == Access::ReadWrite;
        is_stored && **property != Property::P && NEW.iter().all(|(of, _)| of != *property)
    };
    let all = |bench: &mut Bench, node: u8| NEW.map(|(property, _)| read(bench, node, property)).to_vec();
    let ram = NODES.map(|node| all(bench, node)).to_vec();
    let rest = NODES
        .map(|node| {
            Property::ALL.iter().filter(is_rest).map(|property| read(bench, node, *property)).collect()
        })
        .to_vec();
    let stored = NODES
        .map(|node| {
            let was = all(bench, node);
            let mut set = |property: Property, value| {
                let to = Destination::Node(Id::new(node).expect("a node"));
                let message = Message::set(to, property, value).expect("it fits");
                bench.bus.send(&message.frame()).expect("in memory");
            };
            NEW.iter().for_each(|(property, _)| set(Property::LOAD, property.id().into()));
            let stored = all(bench, node);
            let mut set = |property: Property, value| {
                let to = Destination::Node(Id::new(node).expect("a node"));
                let message = Message::set(to, property, value).expect("it fits");
                bench.bus.send(&message.frame()).expect("in memory");
            };
            NEW.iter().zip(&was).for_each(|((property, _), value)| set(*property, *value));
            assert_eq!(all(bench, node), was);
            stored
        })
        .to_vec();
    Truth { ram, stored, rest }
}

fn ids() -> Vec<Id> {
    NODES.iter().filter_map(|node| Id::new(*node)).collect()
}

/// `None`: nothing was written.
fn apply_once(bench: &mut Bench, path: &Path) -> Option<Result<(), Broken>> {
    let before = Undo::load(path).unwrap_or_else(|error| panic!("its own file: {error}"));
    bench.open();
    let mut boards = read_boards(bench, &ids(), &|_| Ok(NEW.to_vec()), &mut |_| {}).ok()?;
    let mut undo = before.clone().unwrap_or_else(|| Undo::new(Adapter::Slcan("fuzz".to_owned())));
    undo.keep(path, &boards).expect("the same boards");
    undo.keep_others(&mut boards);
    Some(write_kept(bench, path, (before, undo), &boards, &mut |_| {}).expect("the folder can be written"))
}

/// `None`: nothing was written.
fn undo_once(bench: &mut Bench, path: &Path) -> Option<Result<(), Broken>> {
    let mut undo = Undo::load(path).unwrap_or_else(|error| panic!("its own file: {error}"))?;
    let nodes: Vec<Id> = undo.boards.iter().map(Kept::node).collect();
    bench.open();
    let mut boards = match read_boards(bench, &nodes, &|present| undo.values(path, present), &mut |_| {}) {
        Ok(boards) => boards,
        Err(error) => {
            println!("nothing undone: {error}");
            return None;
        }
    };
    undo.keep_others(&mut boards);
    Some(write_back(bench, path, &mut undo, &boards, &mut |_| {}).expect("the folder can be written"))
}

fn agrees(states: Option<&[State]>, found: &Truth, old: &Truth, seed: &str) {
    let new: Vec<i64> = NEW.iter().map(|(_, value)| *value).collect();
    for (index, node) in NODES.iter().enumerate() {
        let (ram, stored) = (&found.ram[index], &found.stored[index]);
        let expected = match states.map(|states| states[index]) {
            None | Some(State::New) => [&new, &new],
            Some(State::Untouched | State::Restored) => [&old.ram[index], &old.stored[index]],
            // It says so, and the file leads back.
            Some(State::Unknown { .. }) => continue,
        };
        assert_eq!([ram, stored], expected, "{seed}, node {node}, {states:?}: a mixture");
        assert_eq!(found.rest[index], old.rest[index], "{seed}, node {node}, {states:?}: another property");
    }
}

/// One run; returns how it ended.
fn run(seed: u64, folder: &Path) -> &'static str {
    let path = folder.join(format!("{seed}.undo.json"));
    let _ = std::fs::remove_file(&path);
    let mut bench = Bench::new(seed);
    let old = truth(&mut bench);
    bench.rates = Rates::draw(&mut bench.rng);
    let mark = format!("SEED={seed} {:?}", bench.rates);
    bench.lines = 0;
    let applied = apply_once(&mut bench, &path);
    let found = truth(&mut bench);
    let (end, is_kept) = match &applied {
        None => ("nothing written", false),
        Some(Ok(())) => ("new values", true),
        Some(Err(broken)) if broken.states.iter().any(|state| matches!(state, State::Unknown { .. })) => {
            ("not known, and said so", true)
        }
        Some(Err(_)) => ("old values again", false),
    };
    let untouched = [State::Untouched; NODES.len()];
    agrees(
        match &applied {
            None => Some(&untouched),
            Some(Ok(())) => None,
            Some(Err(broken)) => Some(&broken.states),
        },
        &found,
        &old,
        &mark,
    );
    assert_eq!(path.exists(), is_kept, "{mark}: {applied:?}");
    // The way back, first through the same link, then through one in order.
    bench.rates = Rates { cut: None, interrupt: None, ..Rates::draw(&mut bench.rng) };
    let mark = format!("{mark}, undone over {:?}", bench.rates);
    let undone = undo_once(&mut bench, &path);
    let found = truth(&mut bench);
    if let Some(Ok(())) = undone {
        agrees(Some(&untouched), &found, &old, &mark);
    }
    // As the text of a motor that moves advises: one digit makes a SET of M from one of DP.
    for node in NODES {
        let message = Message::set(Destination::Node(Id::new(node).expect("a node")), Property::MODE, 0);
        bench.bus.send(&message.expect("it fits").frame()).expect("in memory");
    }
    let until_us = bench.now_us() + 2_000_000;
    while bench.bus.receive(until_us).expect("in memory").is_some() {}
    if path.exists() {
        let undone = undo_once(&mut bench, &path);
        assert_eq!(undone, Some(Ok(())), "{mark}");
    }
    agrees(Some(&untouched), &truth(&mut bench), &old, &mark);
    end
}

#[test]
fn apply_and_undo_over_a_bad_link_leave_old_values_or_new_ones() {
    let folder: PathBuf = std::env::temp_dir().join(format!("bad-link-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("the temporary folder can be written");
    let seeds = seeds(1, RUNS);
    let runs = seeds.end - seeds.start;
    let ends: Vec<&str> = seeds.into_par_iter().map(|seed| run(seed, &folder)).collect();
    let count = |end: &str| ends.iter().filter(|found| **found == end).count();
    for end in ["new values", "old values again", "nothing written", "not known, and said so"] {
        println!("{:>6} {end}", count(end));
    }
    assert!(
        runs < RUNS || count("new values") > 0 && count("nothing written") > 0,
        "the link is no test: {ends:?}"
    );
    std::fs::remove_dir_all(&folder).expect("ours");
}
