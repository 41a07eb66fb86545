//! An emulated board on a bus with a host.

use std::path::{Path, PathBuf};

use board_emu::board::Board;
use board_emu::image::Programs;
use hil_world::bus::{Adapter, Bus, Station};
use hil_world::rig::Bridge;
use tater_wire::{Destination, Message, Node as Id, Property};

use crate::protocol::hosts::answer;

/// The spread's node: the board with a brake.
pub const NODE: u8 = 4;

pub fn folder(profile: &str) -> PathBuf {
    let root =
        Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package is a folder of the workspace");
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    root.join(target).join("image").join(profile)
}

/// Prints `skipped` without an image, which continuous integration does not accept.
pub fn production() -> Option<Programs> {
    let programs = Programs::load(&folder("production")).ok();
    if programs.is_none() {
        println!("skipped: no image; cargo xtask image makes it");
    }
    programs
}

pub fn id(number: u8) -> Id {
    Id::new(number).expect("a node")
}

pub fn flashed(programs: &Programs, node: u8) -> Board {
    board_emu::hand::flashed(programs, id(node))
}

pub struct Bench {
    pub bus: Bus<Board>,
    node: u8,
}

impl Bench {
    pub fn awake(programs: &Programs) -> Self {
        Self::with(flashed(programs, NODE))
    }

    pub fn powered(mut board: Board) -> Self {
        board.power_on();
        let node = board.node().number();
        let mut bus = Bus::new(vec![board]);
        bus.plug_host("test", Adapter::default()).expect("the first host");
        Self { bus, node }
    }

    pub fn with(board: Board) -> Self {
        let mut bench = Self::powered(board);
        bench.answering();
        bench.wake();
        // The first start erases eight pages.
        bench.wait_ms(1000);
        bench
    }

    pub fn in_monitor(programs: &Programs) -> Self {
        let mut bench = Self::powered(flashed(programs, NODE));
        bench.answering();
        bench
    }

    fn answering(&mut self) {
        self.wait_ms(100);
        assert_eq!(self.get(Property::STAT), Some(0), "the monitor answers: {:?}", self.board().problem());
    }

    pub fn wake(&mut self) {
        self.set(Property::STAT, 2);
        self.wait_ms(100);
        assert_eq!(
            self.get(Property::STAT),
            Some(2),
            "the application answers: {:?}",
            self.board().problem()
        );
    }

    pub fn board(&self) -> &Board {
        self.bus.stations().next().expect("the board")
    }

    pub fn board_mut(&mut self) -> &mut Board {
        self.bus.station_mut(0).expect("the board")
    }

    pub fn set(&mut self, property: Property, value: i64) {
        let message = Message::set(Destination::Node(id(self.node)), property, value).expect("fits");
        self.bus.send(message.frame()).expect("plugged");
    }

    /// Sends a request without waiting for the answer.
    pub fn ask(&mut self, property: Property) {
        self.bus.send(Message::get(Destination::Node(id(self.node)), property).frame()).expect("plugged");
    }

    pub fn get(&mut self, property: Property) -> Option<i64> {
        self.ask(property);
        let (deadline, node) = (self.bus.now_us() + 50_000, self.node);
        std::iter::from_fn(|| self.bus.wait(deadline)).find_map(|s| answer(&s.frame, node, property))
    }

    pub fn wait_us(&mut self, us: u64) {
        let until = self.bus.now_us() + us;
        self.bus.run_until(until);
        while self.bus.receive().is_some() {}
    }

    pub fn wait_ms(&mut self, ms: u64) {
        self.wait_us(1000 * ms);
    }

    pub fn moving(programs: &Programs) -> Self {
        let mut bench = Self::awake(programs);
        bench.set(Property::M, 160);
        bench.wait_ms(300);
        assert!(bench.is_driven() && bench.board().rig().truth().counts_per_s > 50.0, "under way");
        bench
    }

    pub fn is_driven(&self) -> bool {
        self.board().bridge() != Bridge::Off
    }

    pub fn is_safe(&self) -> bool {
        !self.is_driven() && !self.board().brake_released()
    }

    /// Waits until the board is safe; returns the time in us, in steps of 10.
    pub fn safe_after_us(&mut self, most_us: u64) -> Option<u64> {
        let begin = self.board().now_us();
        while !self.is_safe() {
            if self.board().now_us() - begin > most_us {
                return None;
            }
            self.wait_us(10);
        }
        Some(self.board().now_us() - begin)
    }

    pub fn resets(&self) -> usize {
        self.board().machine().resets.len()
    }
}
