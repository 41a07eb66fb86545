//! Power cuts at every flash operation from HI to the end of a session in which the rotor is driven, coasts,
//! or is turned by hand. A board that claims at the next start to know its position does know it.

use std::collections::BTreeSet;
use std::hash::{DefaultHasher, Hash, Hasher};

use boot::Chip;
use boot::storage::{Progress, Store};
use hil_world::board::SimBoard;
use hil_world::node::Node;
use hil_world::plant::Model;
use servo_core::mode::Mode;
use tater_wire::{Destination, Message, Node as Id, Property};

/// Sessions, each with its own end time and its own remains of a cut.
const SEEDS: u64 = 8;

/// Half a count of the cell in which HI ended, and half of the rotor's present cell.
const MOST_COUNTS: f64 = 1.0;

/// Torque that turns the spread against its brake, N·m at the motor: 1.5 times the holding torque.
const PUSH_N_M: f64 = 3.0;

/// Saves before the session: two pages of storage are nearly full, so that one must be erased during it.
const SAVES_BEFORE: i64 = 114;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Ending {
    /// The move arrives, the rotor stands, SAVE, STAT 0.
    Stands,
    /// CMD T during a move; SAVE and STAT 0 while it coasts.
    Coasts,
    /// Somebody turns the joint by hand and releases it only in the monitor.
    Turned,
}

fn board(number: u8) -> SimBoard {
    let id = Id::new(number).expect("a node");
    let mut board = SimBoard::standard(id, Model::Averaged, u64::from(number));
    let flash = board.flash();
    let mut store = Store::open(flash);
    for round in 0..SAVES_BEFORE {
        store.set(Property::X0, round);
        let done = (0..1_000).any(|_| store.step(flash, true) == Progress::Done);
        assert!(done, "storing does not end");
    }
    flash.take_busy_us();
    board
}

/// A board in use. After its power has failed, further commands do nothing.
struct Session {
    node: Node,
    to: Destination,
    /// Error of HI's zero, in counts; `None` before its end.
    zero: Option<f64>,
}

impl Session {
    fn is_on(&self) -> bool {
        !self.node.board().sim_flash().is_dead()
    }

    fn set(&mut self, property: Property, value: i64) {
        if self.is_on() {
            let frame = Message::set(self.to, property, value).expect("fits 32 bits").frame();
            self.node.receive(&frame).expect("taken");
        }
    }

    fn wait(&mut self, ms: u32) {
        for _ in 0..ms {
            if self.is_on() {
                self.node.step();
            }
        }
    }

    fn finish(&mut self) {
        for _ in 0..3_000 {
            self.wait(1);
            if self.node.sample().is_none_or(|sample| sample.status.mode == Mode::Idle) {
                return;
            }
        }
        panic!("it does not end: {:?}", self.node.sample());
    }

    /// Error of the position, in counts; `None` unless the application runs.
    fn error(&self) -> Option<f64> {
        self.node.sample().map(|sample| sample.estimated_counts() - sample.truth.counts)
    }

    fn play(&mut self, ending: Ending, later_ms: u32) {
        self.set(Property::HOLD, 0);
        self.set(Property::CMD, 13);
        self.finish();
        self.wait(300);
        self.zero = self.error();
        self.set(Property::SAVE, -1);
        self.wait(60);
        match ending {
            Ending::Stands => {
                self.set(Property::M, 12);
                self.finish();
                self.wait(300);
            }
            Ending::Coasts => {
                self.set(Property::M, 150);
                self.wait(250 + later_ms);
                self.set(Property::CMD, 21);
                self.wait(2);
            }
            Ending::Turned => {
                self.node.rig_mut().set_disturbance(PUSH_N_M);
                self.wait(10 + later_ms);
            }
        }
        self.set(Property::SAVE, -1);
        self.set(Property::STAT, 0);
        self.wait(50);
    }

    /// Cuts the power until the rotor stands. Returns whether the board then reports its position as known, and its
    /// error against continuous counting.
    fn restart(&mut self) -> (bool, f64) {
        self.node.rig_mut().set_disturbance(0.0);
        self.node.power_off();
        for _ in 0..500 {
            self.node.step();
        }
        self.node.power_on();
        self.wait(20);
        self.set(Property::STAT, 2);
        self.wait(100);
        let error = self.error().expect("the application runs");
        let homed = self.node.sample().is_some_and(|sample| sample.status.homed);
        (homed, self.zero.map_or(f64::INFINITY, |zero| (error - zero).abs()))
    }
}

/// Plays a session, with a power cut in one flash operation or none; returns the number of operations begun.
fn session(board: SimBoard, ending: Ending, cut: Option<u64>, seed: u64) -> (Session, u64) {
    let to = Destination::Node(board.straps());
    let mut node = Node::awake(board);
    let start = node.board().sim_flash().operations();
    if let Some(cut) = cut {
        node.board_mut().flash().cut_at(start + cut, seed);
    }
    let mut session = Session { node, to, zero: None };
    session.play(ending, seed as u32);
    let operations = session.node.board().sim_flash().operations() - start;
    (session, operations)
}

#[test]
fn trusted_position_is_true_after_any_power_cut() {
    let (mut cuts, mut states, mut known) = (0, BTreeSet::new(), 0);
    let cases = [(1, Ending::Stands), (1, Ending::Coasts), (4, Ending::Coasts), (4, Ending::Turned)];
    for ((number, ending), seed) in
        cases.into_iter().flat_map(|case| (0..SEEDS).map(move |seed| (case, seed)))
    {
        let before = board(number);
        let erases = |board: &SimBoard| board.sim_flash().erases().iter().sum::<u32>();
        let (mut whole, operations) = session(before.clone(), ending, None, seed);
        assert!(erases(whole.node.board()) > erases(&before), "no page is erased in {operations} operations");
        let (homed, error) = whole.restart();
        assert_eq!(homed, ending == Ending::Stands, "node {number}, {ending:?}, seed {seed}");
        assert!(!homed || error <= MOST_COUNTS, "node {number}, {ending:?}, seed {seed}: {error}");
        for cut in 0..operations {
            let (mut session, _) = session(before.clone(), ending, Some(cut), seed);
            assert!(!session.is_on(), "cut {cut} of {operations} was not reached");
            let mut hasher = DefaultHasher::new();
            session.node.board().sim_flash().bytes().hash(&mut hasher);
            states.insert(hasher.finish());
            let (homed, error) = session.restart();
            let case = format!("node {number}, {ending:?}, cut {cut}, seed {seed}");
            assert!(!homed || error <= MOST_COUNTS, "{case}: {error}");
            cuts += 1;
            known += u32::from(homed);
        }
    }
    println!(
        "figure: {cuts} power cuts from HI to STAT 0, {} distinct flash states: {known} starts trust their position, \
         and all of them are within {MOST_COUNTS} count",
        states.len()
    );
    assert!(known > 0 && known < cuts, "{known} of {cuts}");
}
