//! What the application says to a debug probe (RTT) with feature `log`; nothing without it. Said from low priorities only, and
//! in numbers that the tables explain: `Debug` texts would be 10 KiB of formatting.

use servo_core::Event;
use tater_fw::storage::Progress;
use tater_fw::tater::SetError;
use tater_wire::{Frame, Node};

#[cfg(feature = "log")]
use defmt_rtt as _;
#[cfg(feature = "log")]
use tater_fw::codes;

#[cfg(feature = "log")]
defmt::timestamp!("{=u32:us}", tater_fw::bsp::metal::logged_at());

/// The program has started.
#[cfg(feature = "log")]
pub fn started(node: Node, homed: bool) {
    defmt::info!("node {=u8} awake, position trusted: {=bool}", node.number(), homed);
}

/// A frame changed nothing.
#[cfg(feature = "log")]
pub fn refused(frame: &Frame, why: SetError) {
    let (reason, property) = match why {
        SetError::Unknown => ("it means nothing", None),
        SetError::Access(property) => ("no access to property", Some(property)),
        SetError::Range(property) => ("out of range: property", Some(property)),
        SetError::Unnamed => ("the board has no number", None),
        SetError::Servo(_) => ("not in this mode, or a fault stands", None),
        SetError::Busy(property) => ("no room to answer: property", Some(property)),
    };
    let number = property.map_or(0, tater_wire::Property::id);
    defmt::warn!(
        "{=u16:#x} {=[u8]:02x} refused: {=str} {=u8}",
        frame.id().raw(),
        frame.data(),
        reason,
        number
    );
}

/// The servo reports.
#[cfg(feature = "log")]
pub fn event(event: Event) {
    match event {
        Event::Ended { reason, mode } => {
            defmt::info!("END {=u8}, MODE {=u8}", codes::end_code(reason).number(), codes::mode_code(mode).number())
        }
        Event::Breakaway { position, .. } => defmt::info!("breakaway at {=i32}", position),
        Event::Fault(fault) => defmt::error!("ERROR {=u8}", codes::fault_code(fault).code()),
        Event::Glitch(_) => defmt::debug!("the hall lines lied"),
        Event::Homed => defmt::info!("homed"),
    }
}

/// The flash has worked, or failed.
#[cfg(feature = "log")]
pub fn stored(progress: Progress) {
    if let Progress::Failed(_) = progress {
        defmt::error!("the flash did not take what was written");
    }
}

#[cfg(not(feature = "log"))]
mod silent {
    use super::{Event, Frame, Node, Progress, SetError};

    /// Says nothing.
    pub fn started(_: Node, _: bool) {}

    /// Says nothing.
    pub fn refused(_: &Frame, _: SetError) {}

    /// Says nothing.
    pub fn event(_: Event) {}

    /// Says nothing.
    pub fn stored(_: Progress) {}
}
#[cfg(not(feature = "log"))]
pub use silent::{event, refused, started, stored};
