//! The application. Its ticks come from SysTick; a real board binds an interrupt to each call, as `boards/tater-f103/src/app.rs` does.

#![cfg_attr(target_os = "none", no_std, no_main)]
#![forbid(unsafe_code)]

#[cfg(target_os = "none")]
#[cortex_m_rt::entry]
fn main() -> ! {
    static mut FLASH: [u16; stub::map::WORDS] = [0; stub::map::WORDS];

    use boot::storage::Progress;
    use cortex_m::peripheral::syst::SystClkSource;
    use servo_core::units::Micros;
    use stub::{Ram, Stub};
    use tater_fw::Tater;

    FLASH.fill(u16::MAX);
    let Some(peripherals) = cortex_m::Peripherals::take() else { cortex_m::peripheral::SCB::sys_reset() };
    let mut systick = peripherals.SYST;
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(16_000 - 1);
    systick.enable_counter();
    let mut now = Micros(0);
    let mut ms = 0_u32;
    let mut tater = Tater::new(Stub::new(Ram(FLASH.as_mut_slice())), now);
    loop {
        if systick.has_wrapped() {
            now = now.wrapping_add(Micros(1000));
            ms = ms.wrapping_add(1);
            if tater.tick(now) {
                tater.flush();
            }
            if ms.is_multiple_of(100) {
                tater.housekeeping(now);
            }
        }
        if let Some(frame) = tater.board_mut().receive() {
            let _ = tater.receive(&frame, now);
        }
        while tater.store() == Progress::More {}
    }
}

#[cfg(not(target_os = "none"))]
fn main() -> Result<(), &'static str> {
    Err("this program is for a board that does not exist: docs/porting.md says what it shows")
}
