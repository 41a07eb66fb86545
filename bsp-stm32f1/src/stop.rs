//! What survives a reset, and fatal errors: bridge off first, then the board's other safe state, the reason into RAM that survives the reset, then reset. The
//! monitor reports the reason (ERROR).
//!
//! The board's linker script says where and what, by symbols, because nothing may be read from RAM or called by then:
//! `_safe_register` and `_safe_value` (a word that engages the brake), `_kept` (12 bytes that survive a reset), `_heat` (a word of the application that does),
//! `_stack_start` and `_stack_end`.

use core::arch::naked_asm;

use cortex_m_rt::{ExceptionFrame, exception};
use stm32f1xx_hal::pac::{RCC, TIM1};
use tater_wire::FaultCode;

/// TIM1's BDTR: 0 switches the outputs off, and changes nothing else there, because LOCK is set.
const BDTR: u32 = 0x4001_2C44;

/// The reason, its complement (RAM is anything after power-up), and where it happened.
type Words = [u32; 3];

// SAFETY: the linker script of each board defines them, with room for these types.
unsafe extern "C" {
    static mut _safe_register: u32;
    static _safe_value: u8;
    static mut _kept: Words;
    static mut _heat: u32;
}

/// The word kept by [`retain`]; anything after power-up.
pub fn retained() -> u32 {
    // SAFETY: the linker places nothing there, and every word is a value.
    unsafe { (&raw const _heat).read_volatile() }
}

/// Keeps a word over a reset.
pub fn retain(word: u32) {
    // SAFETY: the linker places nothing there; a fatal error writes other words.
    unsafe { (&raw mut _heat).write_volatile(word) }
}

/// Ends the program. `at` is an address or a source line, to be read with a probe.
pub fn stop(reason: FaultCode, at: u32) -> ! {
    // A task may not switch the bridge on again.
    cortex_m::interrupt::disable();
    // SAFETY: from here on nothing else of this program runs, so the registers and the kept words are ours; the linker places
    // nothing there. The value is a symbol's address.
    unsafe {
        (*TIM1::ptr()).bdtr().write(|w| w.bits(0));
        (&raw mut _safe_register).write_volatile(u32::try_from((&raw const _safe_value).addr()).unwrap_or(0));
        (&raw mut _kept).write_volatile([reason.code().into(), !u32::from(reason.code()), at]);
    }
    cortex_m::peripheral::SCB::sys_reset()
}

/// The cause of an unexpected reset: the reason stored by [`stop`], or a watchdog. Clears it, so call it once per start.
pub fn reset_cause(rcc: &RCC) -> Option<FaultCode> {
    // SAFETY: as in `stop`; interrupts are not on yet.
    let [code, complement, _] = unsafe { (&raw const _kept).read_volatile() };
    // SAFETY: the same.
    unsafe { (&raw mut _kept).write_volatile([0; 3]) };
    let flags = rcc.csr().read();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    // Only `stop` writes a word and its complement.
    let told = [FaultCode::Panic, FaultCode::HardFault, FaultCode::Clock]
        .into_iter()
        .find(|reason| u32::from(reason.code()) == code && code == !complement);
    let bitten = flags.iwdgrstf().bit_is_set() || flags.wwdgrstf().bit_is_set();
    told.or(bitten.then_some(FaultCode::Watchdog))
}

/// Bytes of an exception frame.
const FRAME: u32 = 32;
/// Bytes of stack that the rest of a hard fault may take; it takes 40 (`cargo xtask size`).
const ROOM: u32 = 256;

/// Whatever the stack pointer is, no word is pushed before the board is safe.
///
/// # Safety
/// Entered by the hardware: cortex-m-rt 0.7.7 has the vector point here, with no trampoline between.
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
#[unsafe(link_section = ".HardFault.naked")]
unsafe extern "C" fn hard_fault() -> ! {
    naked_asm!(
        "ldr r1, ={bdtr}",
        "movs r2, #0",
        "str r2, [r1]",
        "ldr r1, =_safe_register",
        "ldr r2, =_safe_value",
        "str r2, [r1]",
        // An exception frame that is whole, with room below it, stays as it is. Otherwise the stack itself may have failed:
        // there is no frame to read, and the stack is begun anew. Both programs have this one stack.
        "mrs r0, msp",
        "ldr r1, =_stack_end + {room}",
        "cmp r0, r1",
        "blo 1f",
        "ldr r1, =_stack_start - {frame}",
        "cmp r0, r1",
        "bls 2f",
        "1:",
        "ldr r1, =_stack_start",
        "mov sp, r1",
        "movs r0, #0",
        "2:",
        "b {told}",
        room = const ROOM,
        frame = const FRAME,
        bdtr = const BDTR,
        told = sym faulted,
    )
}

extern "C" fn faulted(frame: *const ExceptionFrame) -> ! {
    // SAFETY: null, or eight words of the stack, where the hardware has put them, aligned to words.
    let at = unsafe { frame.as_ref() }.map_or(0, ExceptionFrame::pc);
    stop(FaultCode::HardFault, at)
}

/// The crystal has stopped (clock security system); TIM1's break has switched the bridge off already.
///
/// # Safety
/// Entered by the hardware.
#[exception]
unsafe fn NonMaskableInt() -> ! {
    stop(FaultCode::Clock, 0)
}

/// An interrupt that no task binds: as a hard fault, with its number.
///
/// # Safety
/// Entered by the hardware.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    stop(FaultCode::HardFault, u32::from(number.cast_unsigned()))
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    stop(FaultCode::Panic, info.location().map_or(0, core::panic::Location::line))
}
