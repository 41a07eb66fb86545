//! A whole hand: GOD, the bus and seven boards with their motors, in simulated time.

pub mod scene;
pub mod serial;
pub mod state;

use std::convert::Infallible;
use std::future::Future;
use std::pin::Pin;
use std::rc::Rc;

use god::{Io, Memory};
use tater_fw::Board;
use tater_wire::Node as Id;
use tater_wire::memory::FLASH;

use crate::world::board::SimBoard;
use crate::world::bus::{Adapter, Bus};
use crate::world::node::Node;
use crate::world::plant::{Model, ParamError};
use scene::{Pose, Scene};
use state::{Kept, State};

const GOD: &str = "GOD";

/// Temperature of GOD's board, 0.1 °C: the lower end of normal use (manual 2).
const TEMPERATURE: i16 = 350;

const STANDSTILL_COUNTS_PER_S: f64 = 1.0;

/// Interval at which contacts are computed, us.
const SCENE_US: u64 = 1_000;

fn id(number: u8) -> Id {
    Id::new(number).expect("1 to 7 are nodes")
}

/// Transmit mailboxes of GOD's CAN controller (bxCAN: three). The other frames wait in GOD.
const MAILBOXES: usize = 3;

/// Poll interval of GOD while its mailboxes are full, us: a frame is sent by then.
const MAILBOX_POLL_US: u64 = 100;

/// GOD and its boards. Bytes go in and come out; the caller advances time.
pub struct Hand {
    bus: Bus<Node>,
    io: Rc<Io>,
    memory: Rc<Memory>,
    god: Pin<Box<dyn Future<Output = Infallible>>>,
    /// Next time at which GOD may act by itself, us.
    next_us: u64,
    /// Changes outside the boards' flashes; see [`Self::revision`].
    changes: u64,
    /// The motors' positions at the last change.
    stood: Pose,
    /// The scene, the time of its next evaluation, us, and which motors touch something.
    scene: Option<(Scene, u64, [bool; 7])>,
}

impl Hand {
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

    /// A hand at power-up with the given boards, nodes 1 to 7.
    #[must_use]
    pub fn with(boards: Vec<Node>, memory: Memory) -> Self {
        let mut bus = Bus::new(boards);
        bus.plug_host(GOD, Adapter::default()).expect("the bus is new");
        let (io, memory) = (Rc::new(Io::default()), Rc::new(memory));
        io.set_temperature(TEMPERATURE);
        let (ports, kept) = (Rc::clone(&io), Rc::clone(&memory));
        let god = Box::pin(async move { god::run(&ports, &kept).await });
        Self { bus, io, memory, god, next_us: 0, changes: 0, stood: Pose::default(), scene: None }
    }

    /// Puts objects between the fingers. Without a scene each motor meets only its stops.
    pub fn set_scene(&mut self, scene: Scene) {
        self.scene = Some((scene, self.bus.now_us(), [true; 7]));
    }

    /// The scene, if there is one.
    #[must_use]
    pub fn scene(&self) -> Option<&Scene> {
        self.scene.as_ref().map(|(scene, ..)| scene)
    }

    /// The rotors' positions.
    #[must_use]
    pub fn pose(&self) -> Pose {
        let mut pose = Pose::default();
        for (to, node) in pose.iter_mut().zip(self.bus.stations()) {
            *to = node.board().rig().truth().counts;
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
        for (index, (contacts, touched)) in scene.contacts(&pose).iter().zip(touching).enumerate() {
            let touches = !contacts.is_empty();
            if (touches || *touched)
                && let Some(node) = self.bus.station_mut(index)
            {
                node.rig_mut().set_objects(contacts);
            }
            *touched = touches;
        }
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
            if now >= self.next_us {
                self.poll();
            }
            if now >= until_us {
                return;
            }
            if let Some(stamped) = self.bus.wait(self.next_us.min(self.scene_us()).clamp(now, until_us)) {
                self.io.push_frame(&stamped.frame);
                self.next_us = self.bus.now_us();
            }
        }
    }

    fn scene_us(&self) -> u64 {
        self.scene.as_ref().map_or(u64::MAX, |(_, next_us, _)| *next_us)
    }

    fn poll(&mut self) {
        self.next_us = god::io::poll(self.god.as_mut(), &self.io, self.bus.now_us());
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

    /// The state that would remain if the power failed now.
    #[must_use]
    pub fn state(&self) -> State {
        let kept = |node: &Node| Kept {
            flash: node.board().sim_flash().bytes().to_vec(),
            counts: node.board().rig().truth().counts,
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
    pub fn bus(&self) -> &Bus<Node> {
        &self.bus
    }

    /// The bus, to inject faults.
    pub fn bus_mut(&mut self) -> &mut Bus<Node> {
        &mut self.bus
    }

    /// The present time, us.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        self.bus.now_us()
    }
}
