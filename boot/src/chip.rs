//! The hardware that both programs use: registers on the metal, a rig in the simulator.

use embedded_storage::nor_flash::{NorFlashError, NorFlashErrorKind};
use tater_wire::map::Map;
use tater_wire::{FaultCode, Frame, Group, Node};

/// What every board has, with a motor or without.
pub trait Chip {
    /// Its flash.
    type Flash: Flash;

    /// Queues a frame in the CAN controller; `false` if it has no free mailbox.
    fn transmit(&mut self, frame: &Frame) -> bool;

    /// Sets the CAN filters: frames to group 0, to these groups, and to the node, unless it is [`Node::HOST`] (a board without a
    /// number). A hint: the program checks each frame itself.
    fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]);

    /// The flash.
    fn flash(&mut self) -> &mut Self::Flash;

    /// Feeds the watchdog.
    fn feed_watchdog(&mut self);

    /// Resets the board into the monitor; does not return on the metal.
    fn reset(&mut self);

    /// The cause of an unexpected reset: watchdog, panic, hard fault, crystal. `None` after power-up, NRST or an ordered reset.
    fn reset_cause(&self) -> Option<FaultCode>;

    /// The node set by the straps; node 0 without straps.
    fn straps(&self) -> Node;

    /// A number derived from the chip's unique ID, 0..=32767: the value of SN until one is stored.
    fn serial_number(&self) -> u16;
}

/// Why a flash operation failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FlashError {
    /// Read-back differs from what was written.
    Verify,
    /// The unit was neither erased nor programmed to 0.
    NotErased,
    /// The address is not the start of a unit or of a page, or outside the flash.
    Address,
    /// The power failed, or the hardware reported an error.
    Failed,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Address => NorFlashErrorKind::OutOfBounds,
            Self::Verify | Self::NotErased | Self::Failed => NorFlashErrorKind::Other,
        }
    }
}

/// Flash as microcontrollers have it: pages are erased to ones, units of [`Memories::unit`](tater_wire::map::Memories::unit) bytes
/// are programmed once each; only 0 may overwrite anything. `docs/porting.md` says what a port promises, and
/// [`conformance`](crate::conformance) tests it.
///
/// The processor may stall meanwhile: on an STM32F103 52 µs for a unit and 20 to 40 ms for a page, so pages are erased only with
/// the bridge off.
///
/// If the power fails during an operation, a unit may lack any of its zeros, or read as 0 where the chip finds it damaged (error
/// correction); a page may hold anything.
pub trait Flash {
    /// The board's memory map.
    const MAP: Map;

    /// The half-word at an even address; all ones outside the flash.
    fn half_word(&self, address: u32) -> u16;

    /// Programs a unit of half-words at its first address, and reads it back.
    ///
    /// # Errors
    /// The operation failed.
    fn program(&mut self, address: u32, unit: &[u16]) -> Result<(), FlashError>;

    /// Erases the page that starts at an address, and reads it back.
    ///
    /// # Errors
    /// The operation failed.
    fn erase(&mut self, page: u32) -> Result<(), FlashError>;
}

/// Half-words of the longest unit.
pub(crate) const MOST_UNIT: usize = 8;

/// Half-words of a unit.
pub(crate) const fn unit<F: Flash>() -> usize {
    F::MAP.of.unit_words()
}

/// Programs a unit that begins with a half-word; the rest stays erased.
pub(crate) fn put<F: Flash>(flash: &mut F, address: u32, word: u16) -> Result<(), FlashError> {
    let mut words = [u16::MAX; MOST_UNIT];
    words[0] = word;
    flash.program(address, words.get(..unit::<F>()).unwrap_or_default())
}

/// Programs a unit to 0, whatever it holds.
pub(crate) fn void<F: Flash>(flash: &mut F, address: u32) -> Result<(), FlashError> {
    flash.program(address, [0; MOST_UNIT].get(..unit::<F>()).unwrap_or_default())
}
