//! The end of a program that cannot go on: the bridge off first, the brake engaged, the reason into RAM that survives the
//! reset, and the reset. The monitor tells the reason (ERROR).

use core::arch::naked_asm;

use cortex_m_rt::{ExceptionFrame, exception};
use stm32f1xx_hal::pac::{GPIOB, RCC, TIM1};
use tater_wire::FaultCode;
use tater_wire::memory::{KEPT, STACK};

use super::pointer;

/// TIM1's BDTR: 0 switches the outputs off, and changes nothing else there, because LOCK is set.
const BDTR: u32 = 0x4001_2C44;
/// Port B's BRR: pin 5 low engages the brake.
const BRR: u32 = 0x4001_0C14;
/// See [`BRR`].
const BRAKE: u32 = 1 << 5;

/// Words of [`KEPT`]: the reason, its complement (RAM is anything after power-up), and where it happened.
type Words = [u32; 3];

const _: () = assert!(12 <= KEPT.len && KEPT.start.is_multiple_of(4));

/// The kept words, as memory.
fn kept() -> *mut Words {
    pointer(KEPT.start)
}

/// Ends the program for a reason; `at` is an address or a line, for whoever looks with a probe.
pub fn stop(reason: FaultCode, at: u32) -> ! {
    // SAFETY: nothing else of this program runs any more, so the registers and the kept words are ours; the linker places
    // nothing in KEPT.
    unsafe {
        (*TIM1::ptr()).bdtr().write(|w| w.bits(0));
        (*GPIOB::ptr()).brr().write(|w| w.bits(BRAKE));
        kept().write_volatile([reason.code().into(), !u32::from(reason.code()), at]);
    }
    cortex_m::peripheral::SCB::sys_reset()
}

/// Why the board was reset, if nobody asked for it: what [`stop`] has left, or the watchdog. Asked once a start: it is
/// forgotten then.
pub fn reset_cause(rcc: &RCC) -> Option<FaultCode> {
    // SAFETY: as in `stop`; interrupts are not on yet.
    let [code, complement, _] = unsafe { kept().read_volatile() };
    // SAFETY: the same.
    unsafe { kept().write_volatile([0; 3]) };
    let flags = rcc.csr().read();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    // A word that has its complement beside it was written by `stop`.
    let told = [FaultCode::Panic, FaultCode::HardFault, FaultCode::Clock]
        .into_iter()
        .find(|reason| u32::from(reason.code()) == code && code == !complement);
    told.or_else(|| flags.iwdgrstf().bit_is_set().then_some(FaultCode::Watchdog))
}

/// A hard fault: whatever the stack pointer is, no word is pushed before the bridge is off and the brake engaged. Then the
/// stack is begun anew, because it may be what has failed.
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
        // The exception frame, where the hardware has put it: both programs have this one stack.
        "mrs r0, msp",
        "ldr r1, =_stack_start",
        "mov sp, r1",
        "b {told}",
        bdtr = const BDTR,
        brr = const BRR,
        brake = const BRAKE,
        told = sym faulted,
    )
}

/// The rest of a hard fault.
extern "C" fn faulted(frame: *const ExceptionFrame) -> ! {
    let address = u32::try_from(frame.addr()).unwrap_or(0);
    let at = if address.is_multiple_of(4) && STACK.holds(address.into(), 32) {
        // SAFETY: eight words of the stack, where the hardware has put them.
        unsafe { &*frame }.pc()
    } else {
        0
    };
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
