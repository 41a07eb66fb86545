//! The jump into the application, and the chip's number.

use tater_wire::map::Area;

use crate::address::pointer;

/// Jumps to the application in an area, which sets up everything that it uses. The monitor must have verified it, and no interrupt
/// be enabled.
pub fn start(application: Area) -> ! {
    // SAFETY: the monitor has verified the application: its vector table begins there, with a stack in RAM and a reset
    // vector inside. No interrupt is enabled, so none meets the new table too early.
    unsafe {
        (*cortex_m::peripheral::SCB::PTR).vtor.write(application.start);
        cortex_m::asm::bootload(pointer(application.start))
    }
}

/// Address of the chip's 96-bit unique ID (RM0008 30.2).
const UNIQUE_ID: u32 = 0x1FFF_F7E8;

/// A number derived from the unique ID, 0..=32767.
#[must_use]
pub fn serial_number() -> u16 {
    // SAFETY: six half-words of the system memory, which every program may read.
    let words: [u16; 6] = unsafe { pointer::<[u16; 6]>(UNIQUE_ID).read() };
    words.iter().fold(0, |sum: u16, word| sum.rotate_left(3) ^ word) & 0x7FFF
}
