//! A motor board without hardware (`docs/porting.md`): it compiles for a Cortex-M4 and a Cortex-M0+, and shows what a port writes.
//!
//! Its chip is one that programs 8 bytes at once and erases 2 KiB, like an STM32G0 or G4. The flash is an array in RAM, a frame that is sent
//! comes back, and the motor stands still.
#![no_std]
#![forbid(unsafe_code)]

pub mod board;
pub mod map;

pub use board::{Ram, Stub};

/// Nothing has been switched on, so nothing is to be switched off.
#[cfg(target_os = "none")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}
