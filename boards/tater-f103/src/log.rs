//! Log lines of the application for a debug probe (RTT) with feature `log`; nothing without it. Written by `init` and `idle` only.

use tater_fw::events::Entry;
use tater_wire::Node;

#[cfg(feature = "log")]
use defmt_rtt as _;

#[cfg(feature = "log")]
defmt::timestamp!("{=u32:us}", bsp_stm32f1::clock::logged_at());

pub fn started(node: Node, homed: bool) {
    #[cfg(feature = "log")]
    defmt::info!("{} awake, position trusted: {=bool}", node, homed);
    #[cfg(not(feature = "log"))]
    let _ = (node, homed);
}

pub fn event(entry: Entry) {
    #[cfg(feature = "log")]
    defmt::info!("{}", entry.event);
    #[cfg(not(feature = "log"))]
    let _ = entry;
}
