//! The hardware of a motor board, as small as it can be: what the metal implements with registers in a few lines each,
//! and the simulator with its plant. Nothing here decides anything.

use embedded_storage::nor_flash::{NorFlashError, NorFlashErrorKind};
use servo_core::sense::commutation::Bridge;
use servo_core::units::{DeciCelsius, MilliAmps, MilliVolts};
use tater_wire::{FaultCode, Frame, Group, Node};

/// Analog readings, as converted last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Analog {
    /// Bus voltage.
    pub bus: MilliVolts,
    /// Bus current, positive into the bridge.
    pub current: MilliAmps,
    /// Motor thermistor (THERM).
    pub motor_temp: DeciCelsius,
    /// Board temperature (TEMP).
    pub board_temp: DeciCelsius,
    /// Strain gauge, 0..=255 (SG).
    pub strain: u8,
    /// The raw inputs behind ANA0 (strain gauge) and ANA1 (motor thermistor), 0..=4095.
    pub raw: [u16; 2],
    /// The break input has switched the bridge off; it stays so until the bridge is commanded off. Where an interrupt calls
    /// [`Tater::bridge_fault`](crate::Tater::bridge_fault), it may be `false` always.
    pub bridge_fault: bool,
}

/// One motor board.
pub trait Board {
    /// Its flash.
    type Flash: Flash;

    /// Sets the three legs of the bridge.
    fn bridge(&mut self, bridge: Bridge);

    /// Energises the brake's coil, which frees the spread, or not. Boards without a brake ignore it.
    fn brake(&mut self, released: bool);

    /// The hall lines now, bits 2..0.
    fn halls(&self) -> u8;

    /// The hall lines now or just before, which may show a spike: enough to see that nothing has changed.
    fn raw_halls(&self) -> u8 {
        self.halls()
    }

    /// The analog readings.
    fn analog(&self) -> Analog;

    /// Hands a frame to the CAN controller; `false`, and nothing done, if it has no room now.
    fn transmit(&mut self, frame: &Frame) -> bool;

    /// Which frames the CAN controller lets through besides those to group 0: those to the node, unless it is
    /// [`Node::HOST`] (nobody has named the board), and those to these groups. A hint to hardware filters: the program
    /// checks each frame itself.
    fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]);

    /// The flash.
    fn flash(&mut self) -> &mut Self::Flash;

    /// Feeds the watchdog.
    fn feed_watchdog(&mut self);

    /// Resets the board into the monitor: on the metal this does not return.
    fn reset(&mut self);

    /// Why the board was reset, if nobody asked for it: watchdog, panic, hard fault, crystal. `None` after power-up, the
    /// reset line or an ordered reset.
    fn reset_cause(&self) -> Option<FaultCode>;

    /// The node that the straps say; node 0 where they say none.
    fn straps(&self) -> Node;

    /// A number of this chip's own, 0..=32767, from its unique id: what SN says until one is stored.
    fn serial_number(&self) -> u16;
}

/// Why the flash did not do as told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FlashError {
    /// What was read back is not what was written.
    Verify,
    /// A half-word to program was neither erased nor was it to become 0.
    NotErased,
    /// The address is odd, no page's start, or outside the flash.
    Address,
    /// The power failed, or the hardware gave up.
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

/// Flash as in an STM32F103: erased by pages of 1 KiB to ones, programmed by half-words, each once; only 0 may be
/// written over anything. While it works, nothing is fetched from it: 52 us a half-word, 20 to 40 ms a page, so pages are
/// erased only with the bridge off.
///
/// When the power fails in the middle, a half-word may have any of its zeros missing, and a page any content.
pub trait Flash {
    /// The half-word at an even address; all ones outside the flash.
    fn half_word(&self, address: u32) -> u16;

    /// Programs a half-word and reads it back.
    ///
    /// # Errors
    /// Why it did not.
    fn program(&mut self, address: u32, value: u16) -> Result<(), FlashError>;

    /// Erases the page that starts at an address, and reads it back.
    ///
    /// # Errors
    /// Why it did not.
    fn erase(&mut self, page: u32) -> Result<(), FlashError>;
}
