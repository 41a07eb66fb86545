//! The monitor of a motor board: entered at reset, it polls the bus and never moves the motor.

#![cfg_attr(target_os = "none", no_std, no_main)]
#![forbid(unsafe_code)]

#[cfg(target_os = "none")]
#[cortex_m_rt::entry]
fn main() -> ! {
    use boot::Monitor;
    use boot::monitor::Next;
    use stm32f1xx_hal::pac::Peripherals;
    use tater_f103::Metal;

    let Some(chip) = Peripherals::take() else { cortex_m::peripheral::SCB::sys_reset() };
    let mut monitor = Monitor::new(Metal::monitor(chip));
    loop {
        let now = monitor.board_mut().now();
        if let Some(frame) = monitor.board_mut().can.receive() {
            monitor.receive(&frame, now);
        }
        if monitor.step(now) == Next::Start {
            monitor.into_board().start();
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() -> Result<(), &'static str> {
    Err(
        "this program runs on a motor board: see `cargo xtask image` and `cargo xtask flash`; hil-sim simulates a board",
    )
}
