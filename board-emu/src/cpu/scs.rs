//! The private peripheral bus: system control space and a few debug registers (PM0056 4, ARMv7-M B3.2).
//!
//! Access to any other register ends the run.

use super::control::{CCR_BITS, SEV_ON_PEND, SLEEP_ON_EXIT};
use super::fault::Trap;
use super::nvic::number::{BUS_FAULT, IRQ, MEM_MANAGE, NMI, PEND_SV, SV_CALL, SYS_TICK, USAGE_FAULT};
use super::nvic::{ALL_LINES, LINES, bit};
use super::state::Cpu;
use crate::chip::Size;
use crate::stop::Problem;

/// Cortex-M3 r1p1 (PM0056 4.4.1).
const CPUID: u32 = 0x411F_C231;
/// DBGMCU_IDCODE: medium density, revision Y (RM0008 31.6.1).
const DEVICE: u32 = 0x2003_6410;
/// AIRCR.VECTKEY, as written and as read.
const KEY: u32 = 0x05FA;
const KEY_READ: u32 = 0xFA05;

/// Exceptions by bit of SHCSR: active, pending, enabled (PM0056 4.4.9).
const ACTIVE: [(u32, u32); 6] =
    [(0, MEM_MANAGE), (1, BUS_FAULT), (3, USAGE_FAULT), (7, SV_CALL), (10, PEND_SV), (11, SYS_TICK)];
const PENDING: [(u32, u32); 4] = [(12, USAGE_FAULT), (13, MEM_MANAGE), (14, BUS_FAULT), (15, SV_CALL)];
const ENABLED: [(u32, u32); 3] = [(16, MEM_MANAGE), (17, BUS_FAULT), (18, USAGE_FAULT)];

fn not_modeled(address: u32, value: Option<u32>, what: &str) -> Trap {
    Trap::Stop(Problem::NotModeled { address, value, what: what.to_owned() })
}

/// Registers with byte and half-word access: NVIC_IPR, SHPR, CFSR.
const fn is_narrow(address: u32) -> bool {
    matches!(address, 0xE000_E400..0xE000_E4F0 | 0xE000_ED18..0xE000_ED24 | 0xE000_ED28..0xE000_ED2C)
}

impl Cpu {
    pub(super) fn read_private(&mut self, address: u32, size: Size) -> Result<u32, Trap> {
        if size != Size::Word && !is_narrow(address) {
            return Err(not_modeled(address, None, "a register of the core, narrower than a word"));
        }
        let word = self.read_word(address & !3)?;
        let value = word >> (8 * (address & 3));
        Ok(match size {
            Size::Byte => value & 0xFF,
            Size::Half => value & 0xFFFF,
            Size::Word => value,
        })
    }

    pub(super) fn write_private(&mut self, address: u32, size: Size, value: u32) -> Result<(), Trap> {
        self.chip.touched = true;
        if is_narrow(address) {
            for (i, byte) in (0..size.bytes()).zip(value.to_le_bytes()) {
                self.write_byte(address + i, byte);
            }
            return Ok(());
        }
        if size != Size::Word {
            return Err(not_modeled(address, Some(value), "a register of the core, narrower than a word"));
        }
        self.write_word(address, value)
    }

    fn read_word(&mut self, address: u32) -> Result<u32, Trap> {
        let nvic = &self.sys.nvic;
        let lines = |set: u128, first: u32| ((set & ALL_LINES) >> IRQ >> (32 * first)) as u32;
        let priorities = |first: u32| {
            (0..4).map(|i| u32::from(nvic.priority_byte(first + i)) << (8 * i)).fold(0, |all, one| all | one)
        };
        let faults = self.sys.faults;
        Ok(match address {
            0xE000_1000 => u32::from(self.sys.control.counting) | 0x4000_0000,
            0xE000_1004 => self.cycle_count(),
            0xE000_E004 => LINES.div_ceil(32) - 1,
            0xE000_E010..0xE000_E020 => {
                self.advance();
                self.sys.systick.read((address >> 2) & 3)
            }
            0xE000_E100..0xE000_E108 | 0xE000_E180..0xE000_E188 => lines(nvic.enabled, address >> 2 & 1),
            0xE000_E200..0xE000_E208 | 0xE000_E280..0xE000_E288 => lines(nvic.pending, address >> 2 & 1),
            0xE000_E300..0xE000_E308 => lines(nvic.active, address >> 2 & 1),
            0xE000_E400..0xE000_E4F0 => priorities(IRQ + address - 0xE000_E400),
            0xE000_ED00 => CPUID,
            0xE000_ED04 => self.interrupt_control(),
            0xE000_ED08 => self.sys.vectors,
            0xE000_ED0C => KEY_READ << 16 | u32::from(nvic.group) << 8,
            0xE000_ED10 => self.sys.control.sleep,
            0xE000_ED14 => self.sys.control.config,
            0xE000_ED18..0xE000_ED24 => priorities(4 + address - 0xE000_ED18),
            0xE000_ED24 => self.handler_control(),
            0xE000_ED28 => faults.configurable,
            0xE000_ED2C => faults.hard,
            0xE000_ED30 => faults.debug,
            0xE000_ED34 => faults.memory_address,
            0xE000_ED38 => faults.bus_address,
            // Not implemented: auxiliary faults and a debugger.
            0xE000_ED3C | 0xE000_EDF0 => 0,
            0xE000_EDFC => self.sys.control.debug,
            0xE004_2000 => DEVICE,
            0xE004_2004 => self.sys.control.device_debug,
            _ => return Err(not_modeled(address, None, "no such register of the core")),
        })
    }

    fn write_byte(&mut self, address: u32, byte: u8) {
        match address {
            0xE000_E400..0xE000_E4F0 => self.sys.nvic.set_priority(IRQ + address - 0xE000_E400, byte),
            0xE000_ED28..0xE000_ED2C => {
                // Write 1 to clear.
                self.sys.faults.configurable &= !(u32::from(byte) << (8 * (address & 3)));
            }
            _ => self.sys.nvic.set_priority(4 + address - 0xE000_ED18, byte),
        }
    }

    fn write_word(&mut self, address: u32, value: u32) -> Result<(), Trap> {
        let lines = (u128::from(value) << (32 * (address >> 2 & 1)) << IRQ) & ALL_LINES;
        let now = self.chip.now;
        match address {
            0xE000_1000 if value & !1 & !0x4000_0000 == 0 => self.count_cycles(value & 1 == 1),
            0xE000_1004 => self.set_cycle_count(value),
            0xE000_E010..0xE000_E020 => {
                self.advance();
                self.sys.systick.write((address >> 2) & 3, value, now);
            }
            0xE000_E100..0xE000_E108 => self.sys.nvic.enabled |= lines,
            0xE000_E180..0xE000_E188 => self.sys.nvic.enabled &= !lines,
            0xE000_E200..0xE000_E208 => self.sys.nvic.pend(lines),
            0xE000_E280..0xE000_E288 => self.sys.nvic.unpend(lines),
            0xE000_ED04 => self.set_interrupt_control(value),
            0xE000_ED08 => self.sys.vectors = value & 0x3FFF_FF80,
            0xE000_ED0C => self.set_reset_control(address, value)?,
            0xE000_ED10 if value & !(SLEEP_ON_EXIT | SEV_ON_PEND) == 0 => self.sys.control.sleep = value,
            0xE000_ED14 if value & !CCR_BITS == 0 => self.sys.control.config = value,
            0xE000_ED24 => self.set_handler_control(value),
            0xE000_ED2C => self.sys.faults.hard &= !value,
            0xE000_ED30 => self.sys.faults.debug &= !value,
            0xE000_ED34 => self.sys.faults.memory_address = value,
            0xE000_ED38 => self.sys.faults.bus_address = value,
            // Only TRCENA, for the DWT, is modeled.
            0xE000_EDFC if value & !(1 << 24) == 0 => self.sys.control.debug = value,
            // Peripherals that stop while a debugger halts the core (RM0008 31.16): there is no debugger.
            0xE004_2004 => self.sys.control.device_debug = value,
            0xE000_EF00 => self.sys.nvic.pend(bit(IRQ + (value & 0x1FF)) & ALL_LINES),
            _ => return Err(not_modeled(address, Some(value), "no such register or bit of the core")),
        }
        self.sys.nvic.changed = true;
        Ok(())
    }

    /// ICSR (PM0056 4.4.3).
    fn interrupt_control(&self) -> u32 {
        let nvic = &self.sys.nvic;
        let flag = |set: bool, at: u32| u32::from(set) << at;
        let is_pending = |exception| nvic.pending & bit(exception) != 0;
        let this = u32::from(self.registers.psr.exception_number());
        let alone = nvic.active & !bit(this) == 0;
        this | flag(alone, 11)
            | nvic.most_urgent().unwrap_or(0) << 12
            | flag(nvic.pending & ALL_LINES != 0, 22)
            | flag(is_pending(SYS_TICK), 26)
            | flag(is_pending(PEND_SV), 28)
            | flag(is_pending(NMI), 31)
    }

    fn set_interrupt_control(&mut self, value: u32) {
        let nvic = &mut self.sys.nvic;
        let asked = |at: u32| value >> at & 1 == 1;
        for (set, exception) in [(31, NMI), (28, PEND_SV), (26, SYS_TICK)] {
            if asked(set) {
                nvic.pend(bit(exception));
            }
        }
        for (clear, exception) in [(27, PEND_SV), (25, SYS_TICK)] {
            if asked(clear) {
                nvic.unpend(bit(exception));
            }
        }
    }

    /// AIRCR (PM0056 4.4.5); ignores a write without its key.
    fn set_reset_control(&mut self, address: u32, value: u32) -> Result<(), Trap> {
        if value >> 16 != KEY {
            return Ok(());
        }
        if value & 0b011 != 0 {
            return Err(not_modeled(address, Some(value), "a reset of the core alone"));
        }
        self.sys.nvic.group = (value >> 8 & 7) as u8;
        self.sys.reset_request |= value & 0b100 != 0;
        Ok(())
    }

    fn handler_control(&self) -> u32 {
        let nvic = &self.sys.nvic;
        let gather = |pairs: &[(u32, u32)], set: u128| {
            pairs.iter().fold(0, |all, &(at, exception)| all | ((set >> exception & 1) as u32) << at)
        };
        gather(&ACTIVE, nvic.active) | gather(&PENDING, nvic.pending) | gather(&ENABLED, nvic.enabled)
    }

    fn set_handler_control(&mut self, value: u32) {
        let nvic = &mut self.sys.nvic;
        for (at, exception) in ENABLED {
            nvic.enable_fault(exception, value >> at & 1 == 1);
        }
        let scatter = |pairs: &[(u32, u32)], set: &mut u128| {
            for &(at, exception) in pairs {
                *set = *set & !bit(exception) | u128::from(value >> at & 1) << exception;
            }
        };
        scatter(&ACTIVE, &mut nvic.active);
        scatter(&PENDING, &mut nvic.pending);
    }

    fn cycle_count(&self) -> u32 {
        let control = &self.sys.control;
        if !control.counting {
            return control.cycles_from as u32;
        }
        let chip = &self.chip;
        (chip.now.wrapping_sub(control.cycles_from) / chip.rcc.core_cycle()) as u32
    }

    fn set_cycle_count(&mut self, value: u32) {
        let chip = &self.chip;
        let control = &mut self.sys.control;
        control.cycles_from = if control.counting {
            chip.now.wrapping_sub(u64::from(value) * chip.rcc.core_cycle())
        } else {
            u64::from(value)
        };
    }

    /// DWT_CYCCNT uses the core's clock at the time of reading.
    fn count_cycles(&mut self, on: bool) {
        let value = self.cycle_count();
        self.sys.control.counting = on;
        self.set_cycle_count(value);
    }
}
