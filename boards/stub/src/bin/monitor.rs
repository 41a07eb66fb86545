//! The monitor.

#![cfg_attr(target_os = "none", no_std, no_main)]
#![forbid(unsafe_code)]

#[cfg(target_os = "none")]
#[cortex_m_rt::entry]
fn main() -> ! {
    static mut FLASH: [u16; stub::map::WORDS] = [0; stub::map::WORDS];

    use boot::Monitor;
    use boot::monitor::Next;
    use servo_core::units::Micros;
    use stub::{Ram, Stub};

    FLASH.fill(u16::MAX);
    let mut now = Micros(0);
    let mut monitor = Monitor::new(Stub::new(Ram(FLASH.as_mut_slice())));
    loop {
        now = now.wrapping_add(Micros(1));
        if let Some(frame) = monitor.board_mut().receive() {
            monitor.receive(&frame, now);
        }
        if monitor.step(now) == Next::Start {
            // A real board jumps into the application.
            cortex_m::peripheral::SCB::sys_reset();
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() -> Result<(), &'static str> {
    Err("this program is for a board that does not exist: docs/porting.md says what it shows")
}
