//! Why a board did not do what a frame asked for.

use servo_core::Refusal;
use tater_wire::{FaultCode, Property};

/// Why a frame changed nothing. The bus carries no refusals: logs and simulators show them, and a refused motion sets END
/// (decision 0036).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SetError {
    /// The frame is no message, or names no property.
    Unknown,
    /// The property may not be written, or read, or only after LOCK's sequence.
    Access(Property),
    /// The value is out of the property's range.
    Range(Property),
    /// The board has no number on the bus yet, and so does not move.
    Unnamed,
    /// ERROR is not 0: a SET of P in idle would rename the position, where its host may mean a goal of mode 3 that was refused.
    Fault(FaultCode),
    /// The servo refused the command.
    Servo(Refusal),
    /// The outbox has no room for the answer.
    Busy(Property),
}
