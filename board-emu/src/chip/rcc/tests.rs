use super::super::{AccessError, Chip, Size};
use super::*;

const CR: u32 = 0x00;
const CFGR: u32 = 0x04;
const CIR: u32 = 0x08;
const CSR: u32 = 0x24;

/// CR after a reset without the ready bits' changes: HSION, HSIRDY, trimming 16 (RM0008 7.3.1).
const CR_RESET: u32 = 0x83;

/// CFGR for 72 MHz from the crystal: by 9, APB1 by 2, ADC by 6; SW is 0.
const PLL_72: u32 = 7 << 18 | 1 << 16 | 2 << 14 | 4 << 8;

fn read(rcc: &mut Rcc, offset: u32, now: Time) -> u32 {
    rcc.read(offset, now).expect("a register")
}

fn write(rcc: &mut Rcc, offset: u32, value: u32, now: Time) {
    rcc.write(offset, value, now).expect("modeled");
}

fn at_72_mhz() -> (Rcc, Time) {
    let mut rcc = Rcc::default();
    write(&mut rcc, CR, CR_RESET | cr::HSEON, 0);
    write(&mut rcc, CFGR, PLL_72, HSE_START);
    write(&mut rcc, CR, CR_RESET | cr::HSEON | cr::PLLON, HSE_START);
    let now = HSE_START + PLL_LOCK;
    write(&mut rcc, CFGR, PLL_72 | 2, now);
    (rcc, now)
}

#[test]
fn reset_state_is_8_mhz_from_the_rc_oscillator() {
    let mut rcc = Rcc::default();
    assert_eq!(read(&mut rcc, CR, 0), CR_RESET);
    assert_eq!(read(&mut rcc, CFGR, 0), 0);
    assert_eq!(read(&mut rcc, 0x14, 0), 0x14, "AHBENR");
    // 144 ticks a microsecond, 8 MHz; the converter at half of it.
    let cycles = (rcc.core_cycle(), rcc.timer1_cycle(), rcc.timer_cycle(), rcc.can_cycle(), rcc.adc_cycle());
    assert_eq!(cycles, (18, 18, 18, 18, 36));
}

#[test]
fn crystal_and_pll_have_start_up_times() {
    let mut rcc = Rcc::default();
    write(&mut rcc, CR, CR_RESET | cr::HSEON, 100);
    assert_eq!(read(&mut rcc, CR, 100 + HSE_START - 1) & cr::HSERDY, 0);
    assert_ne!(read(&mut rcc, CR, 100 + HSE_START) & cr::HSERDY, 0);
    let now = 100 + HSE_START;
    write(&mut rcc, CFGR, PLL_72, now);
    write(&mut rcc, CR, CR_RESET | cr::HSEON | cr::PLLON, now);
    assert_eq!(read(&mut rcc, CR, now + PLL_LOCK - 1) & cr::PLLRDY, 0);
    assert_ne!(read(&mut rcc, CR, now + PLL_LOCK) & cr::PLLRDY, 0);
    write(&mut rcc, CSR, csr::LSION, now);
    assert_eq!(read(&mut rcc, CSR, now + LSI_START - 1) & csr::LSIRDY, 0);
    assert_ne!(read(&mut rcc, CSR, now + LSI_START) & csr::LSIRDY, 0);
}

#[test]
fn apb1_timers_run_at_twice_their_bus_clock() {
    let (mut rcc, now) = at_72_mhz();
    assert_eq!(read(&mut rcc, CFGR, now) & cfgr::SWS, 2 << 2, "SWS");
    let cycles = (rcc.core_cycle(), rcc.timer1_cycle(), rcc.timer_cycle(), rcc.can_cycle(), rcc.adc_cycle());
    assert_eq!(cycles, (2, 2, 2, 4, 12));
    assert_eq!(rcc.wait_states(), 2);
}

#[test]
fn clock_switch_waits_until_ready() {
    let mut rcc = Rcc::default();
    write(&mut rcc, CFGR, PLL_72, 0);
    write(&mut rcc, CR, CR_RESET | cr::HSEON | cr::PLLON, 0);
    write(&mut rcc, CFGR, PLL_72 | 2, 10);
    assert_eq!(read(&mut rcc, CFGR, 11) & cfgr::SWS, 0);
    let ready = HSE_START + PLL_LOCK;
    assert_eq!(rcc.next_event(), ready);
    rcc.advance(ready - 1);
    assert_eq!(rcc.core_cycle(), 18);
    rcc.advance(ready);
    assert_eq!((rcc.core_cycle(), rcc.next_event()), (2, NEVER));
}

#[test]
fn system_clock_source_cannot_be_switched_off() {
    let (mut rcc, now) = at_72_mhz();
    write(&mut rcc, CR, 0, now);
    let left = read(&mut rcc, CR, now);
    assert_eq!(left & (cr::HSEON | cr::PLLON | cr::HSION), cr::HSEON | cr::PLLON);
    assert_ne!(left & cr::PLLRDY, 0);
    assert!(!rcc.is_hsi_on());
}

#[test]
fn overclocking_and_changes_of_a_running_pll_are_rejected() {
    let mut rcc = Rcc::default();
    // APB1 by 1, and a factor of 10.
    for value in [PLL_72 & !(7 << 8) | 2, 8 << 18 | 1 << 16 | 4 << 8 | 2, 3, 1 << 24] {
        assert!(rcc.write(CFGR, value, 0).is_err(), "{value:#x}");
    }
    let (mut rcc, now) = at_72_mhz();
    assert!(rcc.write(CFGR, 4 << 18 | 1 << 16 | 4 << 8 | 2, now).is_err(), "the PLL runs");
    // 72 MHz with no or one wait state; then with two, and back to one.
    for latency in [0, 1] {
        let mut chip = Chip::new(1, [0; 3]);
        (chip.rcc, chip.now) = at_72_mhz();
        let refused = chip.write(0x4002_2000, Size::Word, 0x10 | latency);
        assert!(matches!(refused, Err(AccessError::NotModeled(_))), "{latency}");
        assert_eq!(chip.write(0x4002_2000, Size::Word, 0x12), Ok(()));
    }
}

#[test]
fn crystal_failure_with_css_falls_back_and_raises_nmi() {
    let (mut rcc, now) = at_72_mhz();
    write(&mut rcc, CR, CR_RESET | cr::HSEON | cr::PLLON | cr::CSSON, now);
    rcc.set_crystal(false, now);
    assert!(rcc.clock_failed() && !rcc.is_stopped());
    assert_eq!(rcc.core_cycle(), 18);
    assert_eq!(read(&mut rcc, CFGR, now) & (cfgr::SW | cfgr::SWS), 0);
    assert_eq!(read(&mut rcc, CR, now) & (cr::HSEON | cr::HSERDY | cr::PLLON | cr::PLLRDY), 0);
    assert_eq!(read(&mut rcc, CIR, now), cir::CSSF);
    // CSSON again: no second failure without a crystal that was ready.
    write(&mut rcc, CIR, cir::CSSC, now);
    assert!(!rcc.clock_failed());
    write(&mut rcc, CR, CR_RESET | cr::HSEON | cr::CSSON, now);
    assert_eq!(read(&mut rcc, CR, now + 10 * HSE_START) & cr::HSERDY, 0, "a dead crystal never gets ready");
    rcc.set_crystal(true, now);
    assert_ne!(read(&mut rcc, CR, now + HSE_START) & cr::HSERDY, 0);
}

#[test]
fn crystal_failure_without_css_stops_the_core() {
    let (mut rcc, now) = at_72_mhz();
    rcc.set_crystal(false, now);
    assert!(rcc.is_stopped() && !rcc.clock_failed());
    rcc.reset(Reset::Watchdog);
    assert!(!rcc.is_stopped());
}

#[test]
fn reset_flags_accumulate_until_rmvf_or_power_on() {
    let mut rcc = Rcc::default();
    assert_eq!(read(&mut rcc, CSR, 0), 0x0C00_0000, "after power-up (RM0008 7.3.10)");
    rcc.reset(Reset::Watchdog);
    assert_eq!(read(&mut rcc, CSR, 0), csr::PORRSTF | csr::PINRSTF | csr::IWDGRSTF);
    write(&mut rcc, CSR, csr::RMVF, 0);
    assert_eq!(read(&mut rcc, CSR, 0), 0);
    rcc.reset(Reset::Software);
    assert_eq!(read(&mut rcc, CSR, 0), csr::PINRSTF | csr::SFTRSTF);
    rcc.reset(Reset::Power);
    assert_eq!(read(&mut rcc, CSR, 0), 0x0C00_0000);
}

#[test]
fn peripherals_have_clock_and_reset_bits() {
    let mut rcc = Rcc::default();
    // TIM3 on APB1, TIM1 and port B on APB2; RCC, the flash, the watchdog and EXTI always.
    for (address, register, bit) in [(0x4000_0434, 0x1C, 1), (0x4001_2C00, 0x18, 11), (0x4001_0C00, 0x18, 3)]
    {
        assert!(!rcc.is_clocked(address));
        write(&mut rcc, register, 1 << bit, 0);
        assert!(rcc.is_clocked(address), "{address:#x}");
        let reset = if register == 0x1C { 0x10 } else { 0x0C };
        write(&mut rcc, reset, 1 << bit, 0);
        assert_eq!(
            (rcc.take_peripheral_reset(), rcc.take_peripheral_reset()),
            (Some(address & !0x3FF), None)
        );
        assert!(!rcc.is_clocked(address), "held in reset");
        write(&mut rcc, reset, 0, 0);
        assert!(rcc.is_clocked(address) && rcc.take_peripheral_reset().is_none());
    }
    assert!([0x4002_1000, 0x4002_2000, 0x4000_3000, 0x4001_0400].iter().all(|&at| rcc.is_clocked(at)));
}

#[test]
fn can_reset_bit_ends_in_sleep() {
    let mut chip = Chip::new(1, [0; 3]);
    let mut set = |address, value| chip.write(address, Size::Word, value).expect("modeled");
    set(0x4002_101C, 1 << 25);
    set(0x4000_6400, 1);
    set(0x4002_1010, 1 << 25);
    set(0x4002_1010, 0);
    assert_eq!(chip.read(0x4000_6400, Size::Word), Ok(0x0001_0002), "CAN_MCR (RM0008 24.9.5)");
}
