//! What survives a reset, and fatal errors: bridge off first, brake engaged, reason into RAM that survives the reset, then reset. The monitor reports the
//! reason (ERROR).

use core::arch::naked_asm;

use cortex_m_rt::{ExceptionFrame, exception};
use stm32f1xx_hal::pac::{GPIOB, RCC, TIM1};
use tater_wire::FaultCode;
use tater_wire::memory::{HEAT, KEPT, STACK};

use super::address::pointer;

/// TIM1's BDTR: 0 switches the outputs off, and changes nothing else there, because LOCK is set.
const BDTR: u32 = 0x4001_2C44;
/// Port B's BRR: pin 5 low engages the brake.
const BRR: u32 = 0x4001_0C14;
const BRAKE: u32 = 1 << 5;

/// Words of [`KEPT`]: the reason, its complement (RAM is anything after power-up), and where it happened.
type Words = [u32; 3];

const _: () = assert!(KEPT.start + 12 <= HEAT.start && KEPT.start.is_multiple_of(4));

/// The word kept by [`retain`]; anything after power-up.
pub fn retained() -> u32 {
    // SAFETY: the linker places nothing in KEPT, and every word is a value.
    unsafe { pointer::<u32>(HEAT.start).read_volatile() }
}

/// Keeps a word over a reset.
pub fn retain(word: u32) {
    // SAFETY: the linker places nothing in KEPT; a fatal error writes other words of it.
    unsafe { pointer::<u32>(HEAT.start).write_volatile(word) }
}

fn kept() -> *mut Words {
    pointer(KEPT.start)
}

/// Ends the program. `at` is an address or a source line, to be read with a probe.
pub fn stop(reason: FaultCode, at: u32) -> ! {
    // A task may not switch the bridge on again.
    cortex_m::interrupt::disable();
    // SAFETY: from here on nothing else of this program runs, so the registers and the kept words are ours; the linker places
    // nothing in KEPT.
    unsafe {
        (*TIM1::ptr()).bdtr().write(|w| w.bits(0));
        (*GPIOB::ptr()).brr().write(|w| w.bits(BRAKE));
        kept().write_volatile([reason.code().into(), !u32::from(reason.code()), at]);
    }
    cortex_m::peripheral::SCB::sys_reset()
}

/// The cause of an unexpected reset: the reason stored by [`stop`], or a watchdog. Clears it, so call it once per start.
pub fn reset_cause(rcc: &RCC) -> Option<FaultCode> {
    // SAFETY: as in `stop`; interrupts are not on yet.
    let [code, complement, _] = unsafe { kept().read_volatile() };
    // SAFETY: the same.
    unsafe { kept().write_volatile([0; 3]) };
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

const _: () = assert!(STACK.len > ROOM + FRAME);

/// Whatever the stack pointer is, no word is pushed before the bridge is off and the brake engaged.
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
        "ldr r1, ={brr}",
        "movs r2, #{brake}",
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
        brr = const BRR,
        brake = const BRAKE,
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
