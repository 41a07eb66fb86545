//! A board as it leaves the factory: an application in its flash, its storage prepared.

use boot::Chip;
use boot::storage::{Progress, Store};
use tater_f103::map::{APPLICATION, FLASH, MAP, RAM, STORAGE};
use tater_wire::image::seal;
use tater_wire::{MotorKind, Property};

use crate::board::SimBoard;
use crate::rig::flash::SimFlash;

/// The smallest image that the monitor verifies and starts.
#[must_use]
pub fn placeholder_application() -> Vec<u8> {
    let mut image = vec![0u8; 1024];
    image[..4].copy_from_slice(&RAM.end().to_le_bytes());
    image[4..8].copy_from_slice(&(APPLICATION.start + 0x101).to_le_bytes());
    let version = tater_wire::Property::VERS.row().max as u32;
    // `seal` fails only on an invalid length or vector table.
    let _ = seal(&mut image, version, &MAP);
    image
}

/// The storage of a shipped board, for a board that is no [`SimBoard`].
#[must_use]
pub fn shipped_storage() -> Vec<u8> {
    let mut flash = SimFlash::default();
    prepare(&mut flash, true);
    let start = (STORAGE.start - FLASH.start) as usize;
    flash.bytes()[start..start + STORAGE.len as usize].to_vec()
}

/// Upper bound on the flash operations that prepare the storage: 8 erases and a few half-words.
const MAX_OPERATIONS: usize = 1000;

/// WIRING of a board with the standard wiring, whose direction of closing is known.
pub const STANDARD_WIRING: i64 = 2;

/// Skips the third of a second of page erases that preparing the storage takes. A board that is shipped has its wiring stored, as
/// `cargo xtask flash` leaves it.
pub(super) fn provisioned(mut board: SimBoard, shipped: bool) -> SimBoard {
    let flash = board.flash();
    flash.load(APPLICATION.start, &placeholder_application());
    prepare(flash, shipped);
    board
}

fn prepare(flash: &mut SimFlash, shipped: bool) {
    let mut store = Store::open(flash);
    if shipped && store.get(Property::WIRING).is_none() {
        store.set(Property::WIRING, STANDARD_WIRING);
    }
    finish(store, flash);
}

/// Stores a value in a board's flash, as its SET and SAVE do. A value that is stored already, or the default of none, changes nothing.
pub fn store(flash: &mut SimFlash, property: Property, value: i64) {
    let mut store = Store::open(flash);
    if store.get(property).or(property.rules().default_for_motor(MotorKind::Link).map(i64::from))
        != Some(value)
    {
        store.set(property, value);
        finish(store, flash);
    }
}

fn finish(mut store: Store, flash: &mut SimFlash) {
    for _ in 0..MAX_OPERATIONS {
        if store.step(flash, true) == Progress::Done {
            break;
        }
    }
    flash.take_busy_us();
}
