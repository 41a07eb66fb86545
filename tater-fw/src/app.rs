//! The application's interrupts and their priorities: a hall edge before a break of the bridge before the control tick before
//! the bus before what is slow; the flash in between. Each is one call into [`Tater`].
//!
//! One resource has them all: who calls into it keeps the others waiting for so long. Why that is short enough is in
//! `docs/board.md`.

#[rtic::app(device = stm32f1xx_hal::pac, peripherals = true)]
mod app {
    use core::mem::MaybeUninit;

    use cortex_m::peripheral::syst::SystClkSource;
    use stm32f1xx_hal::pac::Peripherals;
    use tater_fw::Tater;
    use tater_fw::bsp::Metal;
    use tater_fw::bsp::metal::{Armed, Ticker};
    use tater_fw::bsp::timing::tick::{SLOW_DIVISION, SLOW_RELOAD};
    use tater_fw::storage::Progress;

    use crate::log;

    #[shared]
    struct Shared {
        tater: &'static mut Tater<Metal<Armed>>,
    }

    #[local]
    struct Local {
        ticker: Ticker,
    }

    #[init(local = [place: MaybeUninit<Tater<Metal<Armed>>> = MaybeUninit::uninit()])]
    fn init(cx: init::Context) -> (Shared, Local, init::Monotonics) {
        let (tater, ticker) = board(cx.device, cx.local.place);
        let mut systick = cx.core.SYST;
        let of_the_core = SLOW_DIVISION == 1;
        systick.set_clock_source(if of_the_core { SystClkSource::Core } else { SystClkSource::External });
        systick.set_reload(SLOW_RELOAD);
        systick.clear_current();
        systick.enable_counter();
        systick.enable_interrupt();
        tater.wake();
        log::started(tater.node(), tater.status().homed);
        (Shared { tater }, Local { ticker }, init::Monotonics())
    }

    /// The board, made where it stays. RTIC lets interrupts in while what `init` has on the stack is still there, and `init` with
    /// two boards in the making under the deepest of each interrupt is more than the stack (`cargo xtask size`): so not inlined.
    #[inline(never)]
    fn board(
        chip: Peripherals,
        place: &'static mut MaybeUninit<Tater<Metal<Armed>>>,
    ) -> (&'static mut Tater<Metal<Armed>>, Ticker) {
        let (mut metal, ticker) = Metal::application(chip);
        let now = metal.now();
        (place.write(Tater::asleep(metal, now)), ticker)
    }

    /// An edge of a hall line.
    #[task(binds = TIM4, priority = 5, shared = [tater])]
    fn hall(mut cx: hall::Context) {
        cx.shared.tater.lock(|tater| {
            tater.board_mut().sample_halls();
            let at = tater.board_mut().edge();
            tater.hall(at);
        });
    }

    /// The break input has switched the bridge off.
    #[task(binds = TIM1_BRK, priority = 4, shared = [tater])]
    fn bridge_fault(mut cx: bridge_fault::Context) {
        cx.shared.tater.lock(|tater| {
            tater.board_mut().broken();
            tater.bridge_fault();
        });
    }

    /// The control tick. What it has to report goes out behind it.
    #[task(binds = TIM3, priority = 3, local = [ticker], shared = [tater])]
    fn tick(mut cx: tick::Context) {
        cx.local.ticker.seen();
        let reports = cx.shared.tater.lock(|tater| {
            tater.board_mut().sample_halls();
            let now = tater.board_mut().now();
            tater.tick(now)
        });
        if reports {
            rtic::pend(stm32f1xx_hal::pac::Interrupt::USB_LP_CAN_RX0);
        }
    }

    /// A frame has come: one a call, the interrupt stays until there is none. Also asked for without one: by the tick, to report,
    /// and by the slow task, to see that the bus is served.
    #[task(binds = USB_LP_CAN_RX0, priority = 2, shared = [tater])]
    fn receive(mut cx: receive::Context) {
        cx.shared.tater.lock(|tater| {
            let now = tater.board_mut().now();
            match tater.board_mut().can.receive() {
                // A refusal is in the event ring.
                Some(frame) => drop(tater.receive(&frame, now)),
                None => tater.flush(),
            }
        });
    }

    /// A frame has gone: there is room for the next.
    #[task(binds = USB_HP_CAN_TX, priority = 2, shared = [tater])]
    fn sent(mut cx: sent::Context) {
        cx.shared.tater.lock(|tater| {
            tater.board_mut().can.sent();
            tater.flush();
        });
    }

    /// Ten times a second.
    #[task(binds = SysTick, priority = 1, shared = [tater])]
    fn housekeeping(mut cx: housekeeping::Context) {
        rtic::pend(stm32f1xx_hal::pac::Interrupt::USB_LP_CAN_RX0);
        cx.shared.tater.lock(|tater| {
            let now = tater.board_mut().now();
            tater.housekeeping(now);
        });
    }

    /// What is to be stored, one flash operation at a time.
    #[idle(shared = [tater])]
    fn idle(mut cx: idle::Context) -> ! {
        loop {
            let (progress, entry) = cx.shared.tater.lock(|tater| (tater.store(), tater.next_event()));
            if let Some(entry) = entry {
                log::event(entry);
            } else if progress != Progress::More {
                cortex_m::asm::wfi();
            }
        }
    }
}
