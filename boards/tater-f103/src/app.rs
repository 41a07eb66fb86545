//! The application's interrupts by priority: hall edge, bridge break, control tick, bus, housekeeping; idle writes the flash.
//! Each is one call into [`Tater`].
//!
//! All share one resource, so each call delays the others. `docs/board.md` gives the latencies.

#[rtic::app(device = stm32f1xx_hal::pac, peripherals = true)]
mod app {
    use core::mem::MaybeUninit;

    use boot::storage::Progress;
    use bsp_stm32f1::clock::Ticker;
    use bsp_stm32f1::timing::tick::{SLOW_DIVISION, SLOW_RELOAD};
    use cortex_m::peripheral::syst::SystClkSource;
    use stm32f1xx_hal::pac::Peripherals;
    use tater_f103::Metal;
    use tater_f103::metal::Armed;
    use tater_fw::Tater;

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

    /// Builds the board in place. Not inlined: RTIC enables interrupts while the frame of `init` is still on the stack, and two
    /// boards under construction plus the deepest interrupts would overflow it (`cargo xtask size`).
    #[inline(never)]
    fn board(
        chip: Peripherals,
        place: &'static mut MaybeUninit<Tater<Metal<Armed>>>,
    ) -> (&'static mut Tater<Metal<Armed>>, Ticker) {
        let (mut metal, ticker) = Metal::application(chip);
        let now = metal.now();
        (place.write(Tater::asleep(metal, now)), ticker)
    }

    #[task(binds = TIM4, priority = 5, shared = [tater])]
    fn hall(mut cx: hall::Context) {
        cx.shared.tater.lock(|tater| {
            tater.board_mut().sample_halls();
            let at = tater.board_mut().edge();
            tater.hall(at);
        });
    }

    #[task(binds = TIM1_BRK, priority = 4, shared = [tater])]
    fn bridge_fault(mut cx: bridge_fault::Context) {
        cx.shared.tater.lock(|tater| {
            tater.board_mut().broken();
            tater.bridge_fault();
        });
    }

    /// The control tick. Its reports are sent by `receive`, right after it.
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

    /// A frame arrived. One frame per call: the interrupt stays pending until the FIFO is empty. The tick pends it to send reports,
    /// housekeeping to check that the bus is served.
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

    #[task(binds = USB_HP_CAN_TX, priority = 2, shared = [tater])]
    fn sent(mut cx: sent::Context) {
        cx.shared.tater.lock(|tater| {
            tater.board_mut().can.sent();
            tater.flush();
        });
    }

    #[task(binds = SysTick, priority = 1, shared = [tater])]
    fn housekeeping(mut cx: housekeeping::Context) {
        rtic::pend(stm32f1xx_hal::pac::Interrupt::USB_LP_CAN_RX0);
        cx.shared.tater.lock(|tater| {
            let now = tater.board_mut().now();
            tater.housekeeping(now);
        });
    }

    /// One flash operation per lock.
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
