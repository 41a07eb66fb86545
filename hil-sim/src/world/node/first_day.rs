//! A board as it leaves the bench: an application in its flash, its storage prepared.

use tater_fw::Board;
use tater_fw::storage::{Progress, Store};
use tater_wire::image::seal;
use tater_wire::memory::{APPLICATION, RAM};

use crate::world::board::SimBoard;

/// An application for the flash of a simulated board: enough of one for the monitor to verify and start it.
#[must_use]
pub fn placeholder_application() -> Vec<u8> {
    let mut image = vec![0u8; 1024];
    image[..4].copy_from_slice(&RAM.end().to_le_bytes());
    image[4..8].copy_from_slice(&(APPLICATION.start + 0x101).to_le_bytes());
    let version = tater_wire::Property::VERS.row().max as u32;
    // Its length and vectors are right by the lines above.
    let _ = seal(&mut image, version);
    image
}

/// Flash operations that prepare the storage of a board on its first day: 8 erases and a few half-words.
const FIRST_OPERATIONS: usize = 1000;

/// A board as it is after its first day: an application in its flash, its storage prepared (which takes a third of a
/// second of page erases, once).
pub(super) fn in_use(mut board: SimBoard) -> SimBoard {
    let flash = board.flash();
    flash.load(APPLICATION.start, &placeholder_application());
    let mut store = Store::open(flash);
    for _ in 0..FIRST_OPERATIONS {
        if store.step(flash, true) == Progress::Done {
            break;
        }
    }
    flash.take_busy_us();
    board
}
