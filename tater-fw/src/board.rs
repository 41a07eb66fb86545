//! The hardware of a motor board: registers on the metal, the plant in the simulator.

use embedded_storage::nor_flash::{NorFlashError, NorFlashErrorKind};
use servo_core::motor::BoardFigures;
use servo_core::sense::commutation::Bridge;
use servo_core::units::{DeciCelsius, MilliAmps, MilliVolts};
use tater_wire::{FaultCode, Frame, Group, Node};

/// The latest analog readings.
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

    /// What it is built of: limits of the motor follow from it.
    const FIGURES: BoardFigures;

    /// Sets the three legs of the bridge.
    fn bridge(&mut self, bridge: Bridge);

    /// Energizes the brake's coil, which frees the spread, or releases it. Boards without a brake ignore it.
    fn brake(&mut self, released: bool);

    /// The debounced hall lines, bits 2..0.
    fn halls(&self) -> u8;

    /// A single recent sample of the hall lines, which may be a spike: enough to see that nothing changed.
    fn raw_halls(&self) -> u8 {
        self.halls()
    }

    /// The analog readings.
    fn analog(&self) -> Analog;

    /// Queues a frame in the CAN controller; `false` if it has no free mailbox.
    fn transmit(&mut self, frame: &Frame) -> bool;

    /// Sets the CAN filters: frames to group 0, to these groups, and to the node, unless it is [`Node::HOST`] (a board without a
    /// number). A hint: the program checks each frame itself.
    fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]);

    /// The flash.
    fn flash(&mut self) -> &mut Self::Flash;

    /// Feeds the watchdog.
    fn feed_watchdog(&mut self);

    /// Feeds the watchdog of the control tick: the board is reset 60 ms after the last call at the latest, once there was one.
    fn feed_tick_watchdog(&mut self);

    /// The word of the last [`Self::retain`] if only resets came since; anything after power-up.
    fn retained(&self) -> u32;

    /// Keeps a word over a reset.
    fn retain(&mut self, word: u32);

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
    /// The half-word was neither erased nor programmed to 0.
    NotErased,
    /// The address is odd, not the start of a page, or outside the flash.
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

/// Flash like an STM32F103's: pages of 1 KiB are erased to ones, half-words are programmed once each; only 0 may overwrite
/// anything. The processor stalls meanwhile, 52 µs for a half-word and 20 to 40 ms for a page, so pages are erased only with
/// the bridge off.
///
/// If the power fails during an operation, a half-word may lack any of its zeros, and a page may hold anything.
pub trait Flash {
    /// The half-word at an even address; all ones outside the flash.
    fn half_word(&self, address: u32) -> u16;

    /// Programs a half-word and reads it back.
    ///
    /// # Errors
    /// The operation failed.
    fn program(&mut self, address: u32, value: u16) -> Result<(), FlashError>;

    /// Erases the page that starts at an address, and reads it back.
    ///
    /// # Errors
    /// The operation failed.
    fn erase(&mut self, page: u32) -> Result<(), FlashError>;
}
