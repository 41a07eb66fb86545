//! The conformance test of `docs/porting.md` on the board, in the monitor's place: flash and journal. It overwrites everything behind it. (A download is shown
//! by the monitor itself.)
//!
//! It ends with frames of node 31 to the host: the promise that is broken, eight characters each; or a single empty one.

#![cfg_attr(target_os = "none", no_std, no_main)]
#![forbid(unsafe_code)]

#[cfg(target_os = "none")]
#[cortex_m_rt::entry]
fn main() -> ! {
    use boot::Chip;
    use boot::conformance::{flash, journal};
    use stm32f1xx_hal::pac::Peripherals;
    use tater_f103::Metal;
    use tater_wire::{Destination, Frame, Identifier, Node};

    let Some(chip) = Peripherals::take() else { cortex_m::peripheral::SCB::sys_reset() };
    let mut metal = Metal::monitor(chip);
    let done = flash(&mut metal).and_then(|()| journal(&mut metal));
    let text = done.err().map_or("", |broken| broken.promise);
    let id = Identifier { from: Node::new(31).unwrap_or(Node::HOST), to: Destination::Node(Node::HOST) };
    let mut parts = text.as_bytes().chunks(8);
    let mut next = Some(parts.next().unwrap_or_default());
    loop {
        metal.feed_watchdog();
        if let Some(bytes) = next
            && let Some(frame) = Frame::new(id, bytes)
            && metal.transmit(&frame)
        {
            next = parts.next();
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() -> Result<(), &'static str> {
    Err("this program runs on a motor board: docs/porting.md")
}
