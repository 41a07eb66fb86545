//! The production image on an emulated board: power cuts in flash operations that its own instructions start.
//!
//! A story runs once, with a log of the flash's operations. As in `monitor.rs`, the flash after a cut is the flash before
//! the operation, with the operation half done. Each board boots from it, with random RAM.

mod download;
mod storage;

use board_emu::chip::flash as chip;
use board_emu::image::Programs;
use boot::storage::Store;
use hil_world::rig::flash::SimFlash;
use tater_f103::map::FLASH;
use tater_wire::{FaultCode, Property};

use super::monitor::rig::Operation;
use super::storage::State;
use crate::emulated::bench::{Bench, NODE, flashed};

struct Story {
    initial: Vec<u8>,
    log: Vec<Operation>,
}

impl Story {
    fn of(initial: Vec<u8>, bench: &Bench) -> Self {
        let chip = bench.board().machine().chip();
        let log = chip.flash.log().iter().map(|operation| match *operation {
            chip::Operation::Program(address, value) => Operation::Program(address, value),
            chip::Operation::Erase(page) => Operation::Erase(page),
            chip::Operation::EraseAll => panic!("no program erases itself"),
        });
        let story = Self { initial, log: log.collect() };
        assert!(story.before(story.log.len()).bytes() == chip.flash.bytes, "the log tells all");
        story
    }

    /// Checks the computed flash against a real cut: the same story on a board whose power fails in an operation.
    fn really_cut(&self, programs: &Programs, operation: usize, seed: u64, act: fn(&mut Bench)) {
        let mut board = flashed(programs, NODE);
        board.machine_mut().chip_mut().flash.load(FLASH.start, &self.initial);
        board.machine_mut().chip_mut().flash.cut_after(operation as u64, seed);
        let mut bench = Bench::powered(board);
        act(&mut bench);
        assert!(is_cut(&bench), "operation {operation} did not come");
        bench.board_mut().power_off();
        let same = flash_of(&bench).bytes() == self.cut(operation, seed).bytes();
        assert!(same, "operation {operation}: a real cut leaves something else");
    }

    fn before(&self, operation: usize) -> SimFlash {
        let mut flash = SimFlash::default();
        flash.load(FLASH.start, &self.initial);
        for operation in &self.log[..operation] {
            operation.apply(&mut flash).expect("there is power");
        }
        flash
    }

    fn cut(&self, operation: usize, seed: u64) -> SimFlash {
        let mut flash = self.before(operation);
        flash.cut_at(operation as u64, seed);
        assert!(self.log[operation].apply(&mut flash).is_err() && flash.is_dead());
        flash.power_up();
        flash
    }
}

fn initial(programs: &Programs) -> Vec<u8> {
    flashed(programs, NODE).machine().chip().flash.bytes.clone()
}

fn start(programs: &Programs, bytes: &[u8]) -> Bench {
    let mut board = flashed(programs, NODE);
    board.machine_mut().chip_mut().flash.load(FLASH.start, bytes);
    Bench::powered(board)
}

fn is_cut(bench: &Bench) -> bool {
    bench.board().machine().chip().flash.is_cut()
}

fn flash_of(bench: &Bench) -> SimFlash {
    let mut flash = SimFlash::default();
    flash.load(FLASH.start, &bench.board().machine().chip().flash.bytes);
    flash
}

fn state_of(flash: &SimFlash) -> State {
    State::of(&Store::open(flash))
}

fn monitor(bench: &mut Bench) {
    // The crystal runs after 2 ms, the bus after 3.
    bench.wait_ms(4);
    wait_for(bench, Property::STAT, 0, 5_000);
    assert_eq!(bench.get(Property::ERROR), Some(0));
}

/// From the monitor to the application; a copy may come first.
fn wake(bench: &mut Bench) {
    let flash = flash_of(bench);
    // A record that was cut is reported (decision 0061).
    let error = if Store::open(&flash).is_damaged(&flash) { FaultCode::Storage.into() } else { 0 };
    bench.set(Property::STAT, 2);
    bench.wait_ms(30);
    wait_for(bench, Property::STAT, 2, 10_000);
    assert_eq!(bench.get(Property::ERROR), Some(error));
}

/// A board may be busy for 40 ms and not answer meanwhile.
fn wait_for(bench: &mut Bench, property: Property, value: i64, most_ms: u64) {
    let end = bench.bus.now_us() + 1000 * most_ms;
    while bench.get(property) != Some(value) {
        assert!(bench.board().problem().is_none(), "{:?}", bench.board().problem());
        assert!(bench.bus.now_us() < end, "{property:?} is not {value} after {most_ms} ms");
        bench.wait_ms(2);
    }
}
