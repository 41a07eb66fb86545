//! A whole hand: GOD, the bus and seven boards with their motors, in simulated time.

pub mod palm;
pub mod person;
pub mod scene;
pub mod serial;
pub mod state;

use std::convert::Infallible;
use std::future::Future;
use std::pin::Pin;
use std::rc::Rc;

use boot::Chip;
use god::{Io, Memory};
use tater_f103::map::FLASH;
use tater_wire::Node as Id;

use crate::board::SimBoard;
use crate::bus::{Adapter, Bus, Station};
use crate::node::Node;
use crate::plant::{Contact, Model, ParamError, RAD_PER_COUNT, SharedSupply, Supply};
use crate::rig::Rig;
use palm::Palm;
use scene::{Pose, SPREAD, Scene};
use state::{Kept, State};

const GOD: &str = "GOD";

/// The hand's supply, V (manual 1.4).
const SUPPLY_V: f64 = 24.0;

const STANDSTILL_COUNTS_PER_S: f64 = 1.0;

/// Interval at which contacts are computed, us.
const SCENE_US: u64 = 1_000;

fn started(io: &Rc<Io>, memory: &Rc<Memory>) -> Pin<Box<dyn Future<Output = Infallible>>> {
    let (io, memory) = (Rc::clone(io), Rc::clone(memory));
    Box::pin(async move { god::run(&io, &memory).await })
}

fn id(number: u8) -> Id {
    Id::new(number).expect("1 to 7 are nodes")
}

/// Transmit mailboxes of GOD's CAN controller (bxCAN: three). The other frames wait in GOD.
const MAILBOXES: usize = 3;

/// Poll interval of GOD while its mailboxes are full, us: a frame is sent by then.
const MAILBOX_POLL_US: u64 = 100;

/// Keeps the contacts of the spread passive. They are made anew once a millisecond, each time linear about another pose. Between
/// two of them the spread's springs may hold more energy at the same position, which would drive it from nothing. So new
/// springs may hold what the old ones held, and besides what the other motors have pressed into theirs. Fingers need no
/// such limit: their worms let no contact drive them.
#[derive(Clone, Copy, Debug, Default)]
struct Pushed {
    /// Energy in each motor's contacts after the last update, J.
    stored: Pose,
    /// Work of the other motors that has not reached the spread, J.
    credit_j: f64,
}

impl Pushed {
    /// Moves the spread's new `contacts` away from it, if needed; `now` is the energy in each motor's old ones. Their stiffness
    /// remains, so that the spread does not sink in.
    fn limit(&mut self, now: &Pose, pose: &Pose, contacts: &mut [Contact]) {
        let others = now.iter().zip(&self.stored).enumerate().filter(|(motor, _)| *motor != SPREAD);
        self.credit_j += others.map(|(_, (now, then))| (now - then).max(0.0)).sum::<f64>();
        if contacts.is_empty() {
            // What the others pressed does not wait for the spread to come back.
            self.credit_j = 0.0;
            return;
        }
        let theta = pose[SPREAD] * RAD_PER_COUNT;
        let wanted: f64 = contacts.iter().map(|contact| contact.stored_j(theta)).sum();
        let allowed = now[SPREAD] + self.credit_j;
        if wanted > allowed {
            let share = (allowed / wanted).sqrt();
            for contact in contacts.iter_mut().filter(|contact| contact.stored_j(theta) > 0.0) {
                contact.from = theta - share * (theta - contact.from);
            }
        }
        self.credit_j -= (wanted.min(allowed) - now[SPREAD]).max(0.0);
    }
}

/// A board with its motor.
pub trait Motorized: Station {
    /// The motor and its sensors.
    fn rig(&self) -> &Rig;

    /// The motor and its sensors, to disturb or replace them.
    fn rig_mut(&mut self) -> &mut Rig;

    /// Switches the board's power. A board that has power already is reset.
    fn set_power(&mut self, on: bool);
}

impl Motorized for Node {
    fn rig(&self) -> &Rig {
        self.board().rig()
    }

    fn rig_mut(&mut self) -> &mut Rig {
        Self::rig_mut(self)
    }

    fn set_power(&mut self, on: bool) {
        if on { self.power_on() } else { self.power_off() }
    }
}

/// GOD and its boards, native ones if nothing else is said. Bytes go in and come out; the caller advances time.
pub struct Hand<S = Node> {
    bus: Bus<S>,
    supply: SharedSupply,
    palm: Palm,
    io: Rc<Io>,
    memory: Rc<Memory>,
    /// `None` without power.
    god: Option<Pin<Box<dyn Future<Output = Infallible>>>>,
    /// Next time at which GOD may act by itself, us.
    next_us: u64,
    /// Changes outside the boards' flashes; see [`Self::revision`].
    changes: u64,
    /// The motors' positions at the last change.
    stood: Pose,
    /// The scene, the time of its next evaluation, us, and which motors touch something.
    scene: Option<(Scene, u64, [bool; 7])>,
    pushed: Pushed,
}

impl Hand<Node> {
    /// A hand at power-up: boards in their monitors, every motor at its default position.
    #[must_use]
    pub fn new(model: Model, seed: u64, memory: Memory) -> Self {
        let board = |number| SimBoard::standard(id(number), model, seed.wrapping_add(u64::from(number)));
        Self::with((1..=7).map(|number| Node::new(board(number))).collect(), memory)
    }

    /// A hand at power-up with a stored state.
    ///
    /// # Errors
    /// A stored position is beyond the motor's stops.
    pub fn restore(model: Model, seed: u64, state: &State) -> Result<Self, ParamError> {
        let board = |(number, kept): (u8, &Kept)| {
            let seed = seed.wrapping_add(number.into());
            let mut board = SimBoard::at_position(kept.counts, id(number), model, seed)?;
            board.flash().load(FLASH.start, &kept.flash);
            Ok(Node::with_flash_kept(board))
        };
        let boards = (1..).zip(&state.boards).map(board).collect::<Result<_, _>>()?;
        Ok(Self::with(boards, Memory::new(state.god.clone())))
    }

    /// The state that would remain if the power failed now.
    #[must_use]
    pub fn state(&self) -> State {
        let kept = |node: &Node| Kept {
            flash: node.board().sim_flash().bytes().to_vec(),
            counts: node.board().rig().settled_counts(),
        };
        State { boards: self.bus.stations().map(kept).collect(), god: self.memory.stored() }
    }

    /// A number that grows with every change to keep: values stored, and motors at rest at a new position.
    pub fn revision(&mut self) -> u64 {
        self.changes += u64::from(self.memory.changed().is_some());
        let motors = self.bus.stations().map(|node| node.board().rig().truth());
        for (stood, now) in self.stood.iter_mut().zip(motors) {
            if now.counts_per_s.abs() < STANDSTILL_COUNTS_PER_S && (now.counts - *stood).abs() >= 1.0 {
                *stood = now.counts;
                self.changes += 1;
            }
        }
        self.changes + self.bus.stations().map(|node| node.board().sim_flash().operations()).sum::<u64>()
    }
}

impl<S: Motorized> Hand<S> {
    /// A hand at power-up with the given boards, nodes 1 to 7, which one supply feeds.
    #[must_use]
    pub fn with(mut boards: Vec<S>, memory: Memory) -> Self {
        let count = u8::try_from(boards.len()).expect("seven boards");
        let supply = SharedSupply::new(Supply::new(SUPPLY_V, count));
        for board in &mut boards {
            board.rig_mut().share(&supply);
        }
        let mut bus = Bus::new(boards);
        bus.plug_host(GOD, Adapter::default()).expect("the bus is new");
        let (io, memory) = (Rc::new(Io::default()), Rc::new(memory));
        let palm = Palm::default();
        io.set_temperature(palm.tenths());
        Self {
            bus,
            supply,
            palm,
            god: Some(started(&io, &memory)),
            io,
            memory,
            next_us: 0,
            changes: 0,
            stood: Pose::default(),
            scene: None,
            pushed: Pushed::default(),
        }
    }

    /// Puts objects between the fingers. Without a scene each motor meets only its stops.
    pub fn set_scene(&mut self, scene: Scene) {
        self.scene = Some((scene, self.bus.now_us(), [true; 7]));
    }

    /// Takes the objects out of the hand; the fingers still meet each other.
    pub fn take_objects(&mut self) {
        if let Some((scene, ..)) = &mut self.scene {
            scene.objects.clear();
        }
    }

    /// The scene, if there is one.
    #[must_use]
    pub fn scene(&self) -> Option<&Scene> {
        self.scene.as_ref().map(|(scene, ..)| scene)
    }

    /// The joints' positions behind their gears, counts of the motors.
    #[must_use]
    pub fn pose(&self) -> Pose {
        let mut pose = Pose::default();
        for (to, node) in pose.iter_mut().zip(self.bus.stations()) {
            *to = node.rig().joint_counts();
        }
        pose
    }

    fn update_contacts(&mut self) {
        let now_us = self.bus.now_us();
        let pose = self.pose();
        let Some((scene, next_us, touching)) = &mut self.scene else { return };
        if now_us < *next_us {
            return;
        }
        *next_us = now_us + SCENE_US;
        let mut all = scene.contacts(&pose);
        let stored = |bus: &Bus<S>| {
            let mut stored = Pose::default();
            for (to, node) in stored.iter_mut().zip(bus.stations()) {
                *to = node.rig().objects_j();
            }
            stored
        };
        self.pushed.limit(&stored(&self.bus), &pose, &mut all[SPREAD]);
        for (index, (contacts, touched)) in all.iter().zip(touching).enumerate() {
            let touches = !contacts.is_empty();
            if (touches || *touched)
                && let Some(node) = self.bus.station_mut(index)
            {
                node.rig_mut().set_objects(contacts);
            }
            *touched = touches;
        }
        self.pushed.stored = stored(&self.bus);
    }

    /// Bytes from the host.
    pub fn push_rx(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.io.push_rx(byte);
        }
        self.next_us = self.bus.now_us();
    }

    /// Everything that GOD has sent since the last call.
    pub fn take_tx(&mut self) -> Vec<u8> {
        std::iter::from_fn(|| self.pop_tx()).collect()
    }

    /// The next byte that GOD has sent.
    pub fn pop_tx(&mut self) -> Option<u8> {
        let byte = self.io.pop_tx()?;
        // GOD may wait for this room.
        self.next_us = self.bus.now_us();
        Some(byte)
    }

    /// ^C of the host, ahead of all bytes that GOD has not read.
    pub fn interrupt(&mut self) {
        self.io.interrupt();
        self.next_us = self.bus.now_us();
    }

    /// A break condition of the serial line, or what stands for one: aborts, also in a packet and in RealTime.
    pub fn push_break(&mut self) {
        self.io.push_break();
        self.next_us = self.bus.now_us();
    }

    /// The host disconnects: GOD discards what was not read and aborts what is running.
    pub fn hang_up(&mut self) {
        self.io.hang_up();
        self.next_us = self.bus.now_us();
    }

    /// Advances time.
    pub fn run_until(&mut self, until_us: u64) {
        loop {
            let now = self.bus.now_us();
            if now >= self.scene_us() {
                self.update_contacts();
            }
            if now >= self.palm.next_us() {
                self.update_temperature();
            }
            if now >= self.next_us {
                self.poll();
            }
            if now >= until_us {
                return;
            }
            if let Some(stamped) = self.bus.wait(self.wakes_us().clamp(now, until_us))
                && self.is_on()
            {
                self.io.push_frame(&stamped.frame);
                self.next_us = self.bus.now_us();
            }
        }
    }

    /// The next time at which something but the bus is due.
    fn wakes_us(&self) -> u64 {
        self.next_us.min(self.scene_us()).min(self.palm.next_us())
    }

    fn update_temperature(&mut self) {
        let copper_j = self.bus.stations().map(|board| board.rig().truth().ledger.copper_j).sum();
        let tenths = self.palm.advance(copper_j, self.bus.now_us());
        if tenths != self.io.temperature() {
            self.io.set_temperature(tenths);
            // GOD keeps the highest.
            self.next_us = self.bus.now_us();
        }
    }

    /// Forces the reading of GOD's temperature sensor, °C; `None`: it follows the heat of the hand.
    pub fn fix_temperature(&mut self, celsius: Option<f64>) {
        self.palm.fix(celsius);
        self.io.set_temperature(self.palm.tenths());
        self.next_us = self.bus.now_us();
    }

    fn scene_us(&self) -> u64 {
        self.scene.as_ref().map_or(u64::MAX, |(_, next_us, _)| *next_us)
    }

    /// Switches the power of the whole hand. Without power GOD forgets what it has not stored, and takes no bytes.
    pub fn set_power(&mut self, on: bool) {
        for index in 0..self.bus.stations().count() {
            if let Some(board) = self.bus.station_mut(index) {
                board.set_power(on);
            }
        }
        self.bus.abort_pending();
        self.memory = Rc::new(Memory::new(self.memory.stored()));
        self.io = Rc::new(Io::default());
        self.io.set_temperature(self.palm.tenths());
        self.god = on.then(|| started(&self.io, &self.memory));
        self.next_us = self.bus.now_us();
    }

    /// Whether GOD has power.
    #[must_use]
    pub const fn is_on(&self) -> bool {
        self.god.is_some()
    }

    /// Changes the source's voltage and current limit (see [`Supply::set_source`]).
    pub fn set_source(&mut self, volts: f64, limit_a: f64) {
        self.supply.set_source(volts, limit_a);
    }

    fn poll(&mut self) {
        let Some(god) = &mut self.god else {
            self.next_us = u64::MAX;
            return;
        };
        self.next_us = god::io::poll(god.as_mut(), &self.io, self.bus.now_us());
        if self.io.take_cancel() {
            self.bus.abort_pending();
        }
        while self.bus.waiting() < MAILBOXES
            && let Some(frame) = self.io.pop_frame()
        {
            self.bus.send(frame).expect("GOD is connected");
            // GOD may wait for this room.
            self.next_us = self.bus.now_us() + 1;
        }
        if self.bus.waiting() >= MAILBOXES {
            self.next_us = self.next_us.min(self.bus.now_us() + MAILBOX_POLL_US);
        }
    }

    /// GOD's owner has tried to write [`Self::state`]: see [`Memory::wants_write`].
    pub fn state_written(&mut self, is_stored: bool) {
        self.memory.written(is_stored);
        self.next_us = self.bus.now_us();
    }

    /// GOD's ports.
    #[must_use]
    pub fn io(&self) -> &Io {
        &self.io
    }

    /// GOD's memory.
    #[must_use]
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// The bus and its boards.
    #[must_use]
    pub fn bus(&self) -> &Bus<S> {
        &self.bus
    }

    /// The bus, to inject faults.
    pub fn bus_mut(&mut self) -> &mut Bus<S> {
        &mut self.bus
    }

    /// The supply of the seven boards.
    #[must_use]
    pub fn supply(&self) -> Supply {
        self.supply.read()
    }

    /// The present time, us.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        self.bus.now_us()
    }
}
