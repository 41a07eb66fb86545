//! GOD: the future, polled for each byte, frame and deadline. Its ports end in this file.

#![cfg_attr(target_os = "none", no_std, no_main)]
#![forbid(unsafe_code)]

// Its panic handler.
#[cfg(target_os = "none")]
use stub as _;

#[cfg(target_os = "none")]
#[cortex_m_rt::entry]
fn main() -> ! {
    use core::pin::pin;
    use god::{Io, Memory};

    let (ports, memory) = (Io::default(), Memory::default());
    let mut god = pin!(god::run(&ports, &memory));
    let mut now_us = 0;
    loop {
        now_us = poll(god.as_mut(), &ports, now_us).max(now_us + 1);
        // A real board hands these to its serial port and its CAN controller, and what it receives to `push_rx` and `push_frame`.
        while ports.pop_tx().is_some() {}
    }
}

/// A call of its own, so that `cargo xtask size` can tell what a turn of GOD takes of the stack from what lasts.
#[cfg(target_os = "none")]
#[inline(never)]
fn poll(
    god: core::pin::Pin<&mut impl Future<Output = core::convert::Infallible>>,
    ports: &god::Io,
    now_us: u64,
) -> u64 {
    god::io::poll(god, ports, now_us)
}

#[cfg(not(target_os = "none"))]
fn main() -> Result<(), &'static str> {
    Err("this program is for a board that does not exist: docs/porting.md says what it shows")
}
