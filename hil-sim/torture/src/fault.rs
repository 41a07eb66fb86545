//! Raises and heals faults in a hand.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use boot::{Chip, Flash};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_f103::map::{PAGE, STORAGE};
use tater_wire::{Frame, Message, Node as Id, Property};

use super::case::{Case, Fault, MOTORS, kind, rng};
use super::invariant::AFTERMATH_MS;
use super::kinds::{FaultKind, Kinds, Place};
use super::lines::one;
use super::program;
use hil_world::board::SimBoard;
use hil_world::bus::{Fate, Medium};
use hil_world::hand::{Hand, Motorized, person};
use hil_world::node::Node;
use hil_world::plant::Model;
use hil_world::rig::flash::SimFlash;
use hil_world::rig::{HallGlitch, Input, InputFault, Rig};

/// A board of a tortured hand: its motor, and its program if that is native.
pub trait Subject: Motorized {
    /// The board with its program; `None` if an emulated one runs it, which has only the faults of its motor, its cable and its power.
    fn native(&self) -> Option<&Node>;

    /// See [`Self::native`].
    fn native_mut(&mut self) -> Option<&mut Node>;

    /// A spare board with the same straps and another chip, at power-up, with a motor of its own; `None` if an emulated one runs it.
    fn spare(&self) -> Option<Self>
    where
        Self: Sized,
    {
        None
    }

    /// The state of the bridge.
    fn bridge(&self) -> hil_world::rig::Bridge;

    /// Whether the brake is commanded to release.
    fn is_brake_released(&self) -> bool;

    /// Why the emulator has stopped the board, if it has.
    fn problem(&self) -> Option<String> {
        None
    }
}

impl Subject for Node {
    fn native(&self) -> Option<&Node> {
        Some(self)
    }

    fn native_mut(&mut self) -> Option<&mut Node> {
        Some(self)
    }

    fn spare(&self) -> Option<Self> {
        let board = SimBoard::standard(self.straps(), Model::Averaged, 1);
        Some(Self::new(board.with_chip(SPARE_CHIP)))
    }

    fn bridge(&self) -> hil_world::rig::Bridge {
        self.board().bridge_now()
    }

    fn is_brake_released(&self) -> bool {
        self.board().is_brake_released()
    }
}

/// Above this speed a joint moves, counts/s.
const MOVING: f64 = 20.0;

/// Most counts from a joint to a finger in its way: what it does in half a second at full speed.
const FINGER_COUNTS: f64 = 500.0;

/// The softest of what is in a joint's way, N/mm: foam.
const SOFTEST_N_PER_MM: f64 = 2.0;

/// The serial number of a spare board's chip; those of the hand's are below it.
const SPARE_CHIP: u16 = 4711;

/// Shares of the frames that the cable loses, duplicates and corrupts.
#[derive(Clone, Copy, Debug, Default)]
struct Rates {
    lost: f64,
    duplicated: f64,
    corrupted: f64,
}

/// A cable whose faults come and go.
#[derive(Clone, Debug)]
struct Cable {
    rates: Arc<Mutex<Rates>>,
    rng: Pcg64Mcg,
}

fn lock(rates: &Mutex<Rates>) -> MutexGuard<'_, Rates> {
    rates.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Medium for Cable {
    fn fate(&mut self, _: &Frame, bits: u64, _: u64) -> Fate {
        let Rates { duplicated, corrupted, .. } = *lock(&self.rates);
        if corrupted > 0.0 && self.rng.random_bool(corrupted) {
            return Fate::Corrupted { at_bit: self.rng.random_range(1..=bits.max(1)) };
        }
        if duplicated > 0.0 && self.rng.random_bool(duplicated) { Fate::Duplicated } else { Fate::Delivered }
    }

    fn delivers(&mut self, _: &Frame, _: Option<usize>) -> bool {
        let lost = lock(&self.rates).lost;
        lost == 0.0 || !self.rng.random_bool(lost)
    }
}

struct Active {
    fault: Fault,
    rng: Pcg64Mcg,
}

/// The faults of a run.
pub struct Faults {
    /// Those to come, the next one last.
    planned: Vec<Fault>,
    active: Vec<Active>,
    /// Kind, place and end of those that have ended.
    ended: Vec<(FaultKind, usize, u64)>,
    rates: Arc<Mutex<Rates>>,
    source: (f64, f64),
    /// Whether the host neither reads nor sends; whether it holds back the rest of a line.
    pub host_silent: bool,
    /// See `host_silent`.
    pub holds_line: bool,
    /// The host must hang up at its next chance.
    pub hangs_up: bool,
}

fn kinds(places: impl Iterator<Item = (FaultKind, usize)>) -> Kinds {
    places.map(|(kind, _)| kind).collect()
}

/// Whether a fault meets a motor: it is there, or of the whole hand.
fn meets(motor: usize) -> impl Fn(&(FaultKind, usize)) -> bool {
    move |&(kind, place)| kind.row().place != Place::Motor || place == motor
}

impl Faults {
    /// The faults of a case, for its hand.
    pub fn new<S: Subject>(case: &Case, hand: &mut Hand<S>) -> Self {
        let mut planned = case.faults.clone();
        planned.sort_by_key(|fault| std::cmp::Reverse(fault.from_ms));
        let rates = Arc::new(Mutex::new(Rates::default()));
        hand.bus_mut().set_medium(Cable { rates: Arc::clone(&rates), rng: rng(case.seed, 2) });
        Self {
            planned,
            active: Vec::new(),
            ended: Vec::new(),
            rates,
            source: case.world.source,
            host_silent: false,
            holds_line: false,
            hangs_up: false,
        }
    }

    /// Raises what begins at `ms`, heals what ends, and continues the rest.
    pub fn step<S: Subject>(&mut self, hand: &mut Hand<S>, ms: u64) {
        while let Some(fault) = self.planned.pop_if(|fault| fault.from_ms <= ms) {
            let mut active = Active { rng: rng(fault.seed, 3), fault };
            self.raise(hand, &mut active);
            self.active.push(active);
        }
        let mut at = 0;
        while at < self.active.len() {
            let ends_ms = self.active[at].fault.from_ms + self.active[at].fault.for_ms;
            if ends_ms <= ms {
                let done = self.active.remove(at);
                self.heal(hand, &done, ms);
                continue;
            }
            let mut active = self.active.remove(at);
            self.continues(hand, &mut active, ms);
            self.active.insert(at, active);
            at += 1;
        }
        self.ended.retain(|&(.., end_ms)| ms < end_ms + AFTERMATH_MS);
    }

    /// Heals everything, and raises no more.
    pub(crate) fn heal_all<S: Subject>(&mut self, hand: &mut Hand<S>, ms: u64) {
        self.planned.clear();
        for active in std::mem::take(&mut self.active) {
            self.heal(hand, &active, ms);
        }
    }

    /// The kinds that are active at a motor.
    pub(crate) fn active_at(&self, motor: usize) -> Kinds {
        kinds(self.places().filter(meets(motor)))
    }

    /// Those, and those that ended within [`AFTERMATH_MS`].
    pub(crate) fn recent_at(&self, motor: usize) -> Kinds {
        kinds(self.recent_places().filter(meets(motor)))
    }

    /// Those of any motor.
    pub fn recent(&self) -> Kinds {
        kinds(self.recent_places())
    }

    /// Kind and motor of each active fault.
    fn places(&self) -> impl Iterator<Item = (FaultKind, usize)> {
        self.active.iter().map(|active| (active.fault.kind, active.fault.motor))
    }

    fn recent_places(&self) -> impl Iterator<Item = (FaultKind, usize)> {
        self.places().chain(self.ended.iter().map(|&(kind, motor, _)| (kind, motor)))
    }

    fn others(&self, kind: FaultKind, motor: usize) -> impl Iterator<Item = &Fault> {
        let meets = meets(motor);
        let active = self.active.iter().map(|active| &active.fault);
        active.filter(move |fault| fault.kind == kind && meets(&(kind, fault.motor)))
    }

    fn raise<S: Subject>(&mut self, hand: &mut Hand<S>, active: &mut Active) {
        let (kind, motor) = (active.fault.kind, active.fault.motor);
        let rng = &mut active.rng;
        match kind {
            FaultKind::FrameLost => lock(&self.rates).lost = rng.random_range(0.01..0.33),
            FaultKind::FrameDuplicated => lock(&self.rates).duplicated = rng.random_range(0.01..0.5),
            FaultKind::FrameCorrupted => lock(&self.rates).corrupted = rng.random_range(0.01..0.5),
            FaultKind::FrameDelayed => {
                let until_us = hand.now_us() + 1_000 * active.fault.for_ms.min(300);
                hand.bus_mut().hold(motor, until_us);
            }
            FaultKind::NoAck => (0..MOTORS).for_each(|motor| hand.bus_mut().cut(motor, true)),
            FaultKind::CableCut => hand.bus_mut().cut(motor, true),
            FaultKind::SupplySag => {
                let (volts, amps) = (rng.random_range(5.0..20.0), rng.random_range(1.0..10.0));
                let (most_v, most_a) = self.source;
                if rng.random() { hand.set_source(volts, most_a) } else { hand.set_source(most_v, amps) }
            }
            FaultKind::OverVoltage => hand.set_source(rng.random_range(30.0..36.0), self.source.1),
            FaultKind::SameNumber => {
                let spare = hand.bus().stations().nth(motor).and_then(Subject::spare);
                spare.into_iter().for_each(|spare| hand.bus_mut().plug_guest(spare));
            }
            FaultKind::HandPowerCut => hand.set_power(false),
            FaultKind::GodHot => hand.fix_temperature(Some(rng.random_range(20.0..120.0))),
            FaultKind::HostSilent => self.host_silent = true,
            FaultKind::PartialLine => self.holds_line = true,
            FaultKind::HangUp => self.hangs_up = true,
            FaultKind::BusOff | FaultKind::Babble | FaultKind::SecondHost => {}
            _ => {
                let is_on = hand.is_on();
                let Some(board) = hand.bus_mut().station_mut(motor) else { return };
                raise_at_board(board, &active.fault, rng, is_on);
            }
        }
    }

    fn continues<S: Subject>(&mut self, hand: &mut Hand<S>, active: &mut Active, ms: u64) {
        let rng = &mut active.rng;
        match active.fault.kind {
            FaultKind::BusOff if ms.is_multiple_of(4) => hand.bus_mut().put_bus_off(active.fault.motor),
            FaultKind::Babble => {
                // Frames of 8 bytes that none understands: from node 0 to node 0, ahead of every other, and to group 0, which all accept.
                while hand.bus().strangers_waiting() < 8 {
                    let id = if rng.random() { 0 } else { 0x400 };
                    hand.bus_mut()
                        .intrude(Frame::from_raw(id, &rng.random::<[u8; 8]>()).unwrap_or(Frame::EMPTY));
                }
            }
            FaultKind::SecondHost if rng.random_ratio(1, 20) => hand.bus_mut().intrude(program::frame(rng)),
            FaultKind::HallGlitch if rng.random_ratio(1, 10) => {
                let glitch = HallGlitch {
                    at_us: hand.now_us() + rng.random_range(1..900),
                    code: rng.random_range(0..8),
                    duration_us: rng.random_range(1..=300),
                };
                with_rig(hand, active.fault.motor, |rig| rig.add_glitch(glitch));
            }
            FaultKind::BridgeTrip if rng.random_ratio(1, 50) => with_rig(hand, active.fault.motor, Rig::trip),
            _ => {}
        }
    }

    fn heal<S: Subject>(&mut self, hand: &mut Hand<S>, active: &Active, ms: u64) {
        let Fault { kind, motor, .. } = active.fault;
        self.ended.push((kind, motor, ms));
        // Another fault of the kind goes on.
        if self.others(kind, motor).next().is_some() {
            return;
        }
        match kind {
            FaultKind::FrameLost => lock(&self.rates).lost = 0.0,
            FaultKind::FrameDuplicated => lock(&self.rates).duplicated = 0.0,
            FaultKind::FrameCorrupted => lock(&self.rates).corrupted = 0.0,
            FaultKind::Babble | FaultKind::SecondHost => hand.bus_mut().silence_strangers(),
            FaultKind::NoAck | FaultKind::CableCut => {
                let still = |motor: usize| {
                    self.others(FaultKind::CableCut, motor).next().is_some()
                        || self.others(FaultKind::NoAck, motor).next().is_some()
                };
                let healed: Vec<usize> = (0..MOTORS).filter(|&motor| !still(motor)).collect();
                healed.into_iter().for_each(|motor| hand.bus_mut().cut(motor, false));
            }
            FaultKind::SupplySag | FaultKind::OverVoltage => {
                let (volts, amps) = self.source;
                hand.set_source(volts, amps);
            }
            FaultKind::HandPowerCut => {
                hand.set_power(true);
                // Boards whose own power is still cut stay off.
                let off: Vec<usize> = (0..MOTORS)
                    .filter(|&motor| self.others(FaultKind::PowerCut, motor).next().is_some())
                    .collect();
                for motor in off {
                    with_board(hand, motor, |board| board.set_power(false));
                }
            }
            FaultKind::SameNumber => _ = hand.bus_mut().unplug_guest(),
            FaultKind::GodHot => hand.fix_temperature(None),
            FaultKind::HostSilent => self.host_silent = false,
            FaultKind::PartialLine => self.holds_line = false,
            _ => {
                let is_on = hand.is_on();
                if let Some(board) = hand.bus_mut().station_mut(motor) {
                    heal_at_board(board, kind, is_on);
                }
            }
        }
    }
}

fn with_board<S: Subject>(hand: &mut Hand<S>, motor: usize, act: impl FnOnce(&mut S)) {
    if let Some(board) = hand.bus_mut().station_mut(motor) {
        act(board);
    }
}

/// Does something to a motor's rig.
pub(crate) fn with_rig<S: Subject>(hand: &mut Hand<S>, motor: usize, act: impl FnOnce(&mut Rig)) {
    with_board(hand, motor, |board| act(board.rig_mut()));
}

fn input(rng: &mut Pcg64Mcg) -> Input {
    Input::ALL[rng.random_range(0..Input::ALL.len())]
}

fn raise_at_board<S: Subject>(board: &mut S, fault: &Fault, rng: &mut Pcg64Mcg, is_on: bool) {
    match fault.kind {
        FaultKind::HallStuck => {
            let mut levels = [None; 3];
            levels[rng.random_range(0..3)] = Some(rng.random());
            board.rig_mut().break_hall_lines(levels);
        }
        FaultKind::HallOpen => {
            let mut levels = [Some(true); 3];
            levels[rng.random_range(0..3)] = None;
            board.rig_mut().break_hall_lines(levels);
        }
        FaultKind::HallSwap => {
            let orders = [[1, 0, 2], [0, 2, 1], [2, 1, 0], [1, 2, 0], [2, 0, 1]];
            rewire(board, orders[rng.random_range(0..orders.len())], is_on);
        }
        FaultKind::AdcRail => {
            let stuck_at = Some(if rng.random() { 0.0 } else { 1.0 });
            board.rig_mut().disturb_input(input(rng), InputFault { stuck_at, ..InputFault::default() });
        }
        FaultKind::AdcNoise => {
            let noise_lsb = rng.random_range(4.0..410.0);
            board.rig_mut().disturb_input(input(rng), InputFault { noise_lsb, ..InputFault::default() });
        }
        FaultKind::AdcDrift => {
            let offset = rng.random_range(-0.1..0.1);
            board.rig_mut().disturb_input(input(rng), InputFault { offset, ..InputFault::default() });
        }
        FaultKind::ThermistorOpen => board.rig_mut().override_thermistor(Some(-50.0)),
        FaultKind::BrakeStuckOn => board.rig_mut().stick_brake(Some(true)),
        FaultKind::BrakeStuckOff => board.rig_mut().stick_brake(Some(false)),
        FaultKind::Jam => board.rig_mut().jam(rng.random_range(0.7..5.0)),
        FaultKind::Push => board.rig_mut().set_disturbance(rng.random_range(-0.2..0.2)),
        FaultKind::Finger => place_finger(board, fault.motor, rng),
        FaultKind::PowerCut => board.set_power(false),
        FaultKind::BoardReset if is_on => board.set_power(true),
        FaultKind::ClockDrift => {
            with_native(board, |node| node.set_drift_ppm(rng.random_range(-20_000..=20_000)))
        }
        FaultKind::BoardHang => with_native(board, |node| {
            if node.is_on() {
                node.hang(1_000 * fault.for_ms.min(500));
            }
        }),
        FaultKind::BridgeTrip => board.rig_mut().trip(),
        FaultKind::FlashCut => with_native(board, |node| {
            if node.is_on() {
                let at = node.board().sim_flash().operations() + rng.random_range(0..60);
                node.board_mut().flash().cut_at(at, rng.random());
                save(node);
            }
        }),
        FaultKind::BitFlip | FaultKind::WornPage | FaultKind::MarginalErase => {
            with_native(board, |node| damage(node, fault.kind, rng));
        }
        _ => {}
    }
}

fn with_native<S: Subject>(board: &mut S, act: impl FnOnce(&mut Node)) {
    if let Some(node) = board.native_mut() {
        act(node);
    }
}

/// Puts a person's finger, or something softer, in the way of a joint: ahead of its motion, or on either side of one that stands.
fn place_finger<S: Subject>(board: &mut S, motor: usize, rng: &mut Pcg64Mcg) {
    let rig = board.rig_mut();
    let speed = rig.truth().counts_per_s;
    let side = if speed.abs() > MOVING { speed.signum() } else { *one(rng, &[-1.0, 1.0]) };
    let at_count = rig.joint_counts() + side * rng.random_range(0.0..FINGER_COUNTS);
    let softer = if rng.random() { 0.0 } else { rng.random_range(0.0..1.0) };
    let n_per_mm = person::N_PER_MM * libm::pow(SOFTEST_N_PER_MM / person::N_PER_MM, softer);
    rig.set_finger(Some(person::gives_way(kind(motor as u8 + 1), n_per_mm, at_count, side)));
}

/// SAVE of all, so that the flash is busy.
fn save(node: &mut Node) {
    let to = tater_wire::Destination::Node(node.straps());
    if let Some(message) = Message::set(to, Property::SAVE, -1) {
        let _ = node.receive(&message.frame());
    }
}

fn storage_word(rng: &mut Pcg64Mcg) -> u32 {
    STORAGE.start + 2 * rng.random_range(0..STORAGE.len / 2)
}

/// A half-word of the storage that is written; most of the storage is erased.
fn written_word(flash: &SimFlash, rng: &mut Pcg64Mcg) -> u32 {
    let words: Vec<u32> = (0..STORAGE.len / 2)
        .map(|word| STORAGE.start + 2 * word)
        .filter(|&address| flash.half_word(address) != u16::MAX)
        .collect();
    if words.is_empty() { storage_word(rng) } else { words[rng.random_range(0..words.len())] }
}

fn damage(node: &mut Node, kind: FaultKind, rng: &mut Pcg64Mcg) {
    let was_on = node.is_on();
    let flash = node.board_mut().flash();
    match kind {
        FaultKind::BitFlip => {
            for _ in 0..rng.random_range(1..=3) {
                let address = written_word(flash, rng);
                flash.flip(address, rng.random_range(0..8));
            }
        }
        FaultKind::WornPage => {
            let first = (STORAGE.start - tater_f103::map::FLASH.start) / PAGE;
            let pages = (0..STORAGE.len / PAGE)
                .filter(|_| rng.random_ratio(1, 3))
                .map(|page| 1u128 << (first + page));
            flash.set_worn_pages(pages.sum());
            save(node);
            return;
        }
        _ => {
            // As an erase leaves a page that was cut short, which is never the one in use: some bits are set, some read either way.
            let page = STORAGE.start + PAGE * rng.random_range(0..STORAGE.len / PAGE);
            if flash.page_in_use() == page {
                return;
            }
            for word in 0..PAGE / 2 {
                let address = page + 2 * word;
                let set = flash.half_word(address) | rng.random::<u16>();
                flash.load(address, &set.to_le_bytes());
                flash.weaken(address, rng.random::<u16>() & rng.random::<u16>());
            }
        }
    }
    // A program reads its storage when it starts.
    if was_on {
        node.power_on();
    }
}

fn rewire<S: Subject>(board: &mut S, halls: [u8; 3], is_on: bool) {
    board.set_power(false);
    let rig = board.rig_mut();
    let params = rig.params().clone();
    // The order is one, so this cannot fail.
    let _ = rig.rewire(params.phases, halls, params.inverted);
    if is_on {
        board.set_power(true);
    }
}

fn heal_at_board<S: Subject>(board: &mut S, kind: FaultKind, is_on: bool) {
    match kind {
        FaultKind::HallStuck | FaultKind::HallOpen => board.rig_mut().break_hall_lines([None; 3]),
        FaultKind::HallSwap => rewire(board, [0, 1, 2], is_on),
        FaultKind::AdcRail | FaultKind::AdcNoise | FaultKind::AdcDrift => {
            for input in Input::ALL {
                board.rig_mut().disturb_input(input, InputFault::default());
            }
        }
        FaultKind::ThermistorOpen => board.rig_mut().override_thermistor(None),
        FaultKind::BrakeStuckOn | FaultKind::BrakeStuckOff => board.rig_mut().stick_brake(None),
        FaultKind::Jam => board.rig_mut().jam(0.0),
        FaultKind::Push => board.rig_mut().set_disturbance(0.0),
        FaultKind::Finger => board.rig_mut().set_finger(None),
        FaultKind::PowerCut if is_on => board.set_power(true),
        FaultKind::FlashCut => with_native(board, |node| {
            node.board_mut().flash().cancel_cut();
            if is_on && !node.is_on() {
                node.power_on();
            }
        }),
        FaultKind::WornPage => with_native(board, |node| node.board_mut().flash().set_worn_pages(0)),
        FaultKind::ClockDrift => with_native(board, |node| node.set_drift_ppm(0)),
        _ => {}
    }
}

/// The node of a motor.
pub fn node_of(motor: usize) -> Id {
    // Motors are 0 to 6.
    Id::new(motor as u8 + 1).unwrap_or(Id::HOST)
}
