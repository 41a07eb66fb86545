//! What the application says to a debug probe (RTT) with feature `log`; nothing without it. Said from low priorities only.

use servo_core::Event;
use tater_fw::storage::Progress;
use tater_fw::tater::Refused;
use tater_wire::{Frame, Node};

#[cfg(feature = "log")]
use defmt_rtt as _;

#[cfg(feature = "log")]
defmt::timestamp!("{=u32:us}", tater_fw::bsp::metal::logged_at());

/// The program has started.
#[cfg(feature = "log")]
pub fn started(node: Node, homed: bool) {
    defmt::info!(
        "node {=u8} awake, position {=str}",
        node.number(),
        if homed { "trusted" } else { "unknown" }
    );
}

/// A frame changed nothing.
#[cfg(feature = "log")]
pub fn refused(frame: &Frame, why: Refused) {
    defmt::warn!(
        "{=u16:#x} {=[u8]:02x} refused: {}",
        frame.id().raw(),
        frame.data(),
        defmt::Debug2Format(&why)
    );
}

/// The servo reports.
#[cfg(feature = "log")]
pub fn event(event: Event) {
    match event {
        Event::Fault(fault) => defmt::error!("{}", defmt::Debug2Format(&fault)),
        Event::Glitch(glitch) => defmt::debug!("{}", defmt::Debug2Format(&glitch)),
        other => defmt::info!("{}", defmt::Debug2Format(&other)),
    }
}

/// The flash has worked, or failed.
#[cfg(feature = "log")]
pub fn stored(progress: Progress) {
    if let Progress::Failed(why) = progress {
        defmt::error!("flash: {}", defmt::Debug2Format(&why));
    }
}

#[cfg(not(feature = "log"))]
mod silent {
    use super::{Event, Frame, Node, Progress, Refused};

    /// Says nothing.
    pub fn started(_: Node, _: bool) {}

    /// Says nothing.
    pub fn refused(_: &Frame, _: Refused) {}

    /// Says nothing.
    pub fn event(_: Event) {}

    /// Says nothing.
    pub fn stored(_: Progress) {}
}
#[cfg(not(feature = "log"))]
pub use silent::{event, refused, started, stored};
