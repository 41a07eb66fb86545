//! Loads and stores: single, dual, multiple and exclusive.
//!
//! The core changes only after all loads of an instruction have succeeded, so that a faulting one can be
//! repeated.

use super::fault::{Fault, Trap};
use super::op::{Exclusive, Multiple, Offset, Pair, Transfer};
use super::registers::Reg;
use super::state::Cpu;
use crate::chip::{AccessError, Size};
use crate::stop::Problem;

/// The private peripheral bus (ARMv7-M B3.1).
const PRIVATE: u32 = 0xE000_0000;
const PRIVATE_END: u32 = 0xE010_0000;

impl Cpu {
    fn load_aligned(&mut self, address: u32, size: Size, privileged: bool) -> Result<u32, Trap> {
        if (PRIVATE..PRIVATE_END).contains(&address) {
            return if privileged { self.read_private(address, size) } else { Err(bus(address)) };
        }
        let chip = &mut self.chip;
        if let 0x2000_0000..0x2000_5000 = address {
            let at = (address - 0x2000_0000) as usize;
            let ram = chip.ram.get(at..).unwrap_or_default();
            let value = match size {
                Size::Byte => ram.first().copied().map(u32::from),
                Size::Half => ram.first_chunk().map(|bytes| u32::from(u16::from_le_bytes(*bytes))),
                Size::Word => ram.first_chunk().map(|bytes| u32::from_le_bytes(*bytes)),
            };
            return value.ok_or(bus(address));
        }
        chip.read(address, size).map_err(|refusal| refused(address, None, refusal))
    }

    fn store_aligned(&mut self, address: u32, size: Size, value: u32, privileged: bool) -> Result<(), Trap> {
        if (PRIVATE..PRIVATE_END).contains(&address) {
            return if privileged { self.write_private(address, size, value) } else { Err(bus(address)) };
        }
        let value = match size {
            Size::Byte => value & 0xFF,
            Size::Half => value & 0xFFFF,
            Size::Word => value,
        };
        let chip = &mut self.chip;
        if let 0x2000_0000..0x2000_5000 = address {
            let ram = chip.ram.get_mut((address - 0x2000_0000) as usize..).unwrap_or_default();
            let [a, b, c, d] = value.to_le_bytes();
            let stored = match size {
                Size::Byte => ram.first_mut().map(|place| *place = a),
                Size::Half => ram.first_chunk_mut().map(|place| *place = [a, b]),
                Size::Word => ram.first_chunk_mut().map(|place| *place = [a, b, c, d]),
            };
            return stored.ok_or(bus(address));
        }
        chip.write(address, size, value).map_err(|refusal| refused(address, Some(value), refusal))
    }

    /// `MemU` (ARMv7-M B2.4.4): an unaligned access is split into bytes, or a fault with CCR.UNALIGN_TRP.
    fn load(&mut self, address: u32, size: Size, privileged: bool) -> Result<u32, Trap> {
        if address.is_multiple_of(size.bytes()) {
            return self.load_aligned(address, size, privileged);
        }
        self.may_be_unaligned(address, None)?;
        let mut value = 0;
        for i in 0..size.bytes() {
            value |= self.load_aligned(address.wrapping_add(i), Size::Byte, privileged)? << (8 * i);
        }
        Ok(value)
    }

    fn store(&mut self, address: u32, size: Size, value: u32, privileged: bool) -> Result<(), Trap> {
        if address.is_multiple_of(size.bytes()) {
            return self.store_aligned(address, size, value, privileged);
        }
        self.may_be_unaligned(address, Some(value))?;
        for i in 0..size.bytes() {
            self.store_aligned(address.wrapping_add(i), Size::Byte, value >> (8 * i) & 0xFF, privileged)?;
        }
        Ok(())
    }

    fn may_be_unaligned(&self, address: u32, value: Option<u32>) -> Result<(), Trap> {
        if self.sys.control.traps_unaligned() {
            Err(Trap::Fault(Fault::Unaligned))
        } else if address >= 0x4000_0000 {
            // Unpredictable for device memory (ARMv7-M A3.2.1).
            let what = "an unaligned access to a register".to_owned();
            Err(Trap::Stop(Problem::NotModeled { address, value, what }))
        } else {
            Ok(())
        }
    }

    /// `MemA` of a word, with the privileges of the present mode.
    pub(super) fn load_word(&mut self, address: u32) -> Result<u32, Trap> {
        aligned(address, Size::Word)?;
        self.load_aligned(address, Size::Word, self.is_privileged())
    }

    pub(super) fn store_word(&mut self, address: u32, value: u32) -> Result<(), Trap> {
        aligned(address, Size::Word)?;
        self.store_aligned(address, Size::Word, value, self.is_privileged())
    }

    fn base(&self, rn: Reg) -> u32 {
        if rn.is_pc() { self.registers.pc() & !3 } else { self.get(rn) }
    }

    pub(super) fn transfer(&mut self, transfer: Transfer) -> Result<(), Trap> {
        let Transfer { load, size, signed, rt, rn, offset, index, wback, unprivileged } = transfer;
        let base = self.base(rn);
        let moved = base.wrapping_add(match offset {
            Offset::Immediate(offset) => offset,
            Offset::Register(rm, shift) => self.get(rm) << shift,
        });
        let address = if index { moved } else { base };
        let privileged = !unprivileged && self.is_privileged();
        if !load {
            self.store(address, size, self.get(rt), privileged)?;
            if wback {
                self.set(rn, moved);
            }
            return Ok(());
        }
        let value = self.load(address, size, privileged)?;
        let value = match (signed, size) {
            (true, Size::Byte) => i32::from(value as u8 as i8) as u32,
            (true, Size::Half) => i32::from(value as u16 as i16) as u32,
            _ => value,
        };
        if wback {
            self.set(rn, moved);
        }
        if rt.is_pc() {
            self.exchange(value);
        } else {
            self.set(rt, value);
        }
        Ok(())
    }

    pub(super) fn pair(&mut self, pair: Pair) -> Result<(), Trap> {
        let Pair { load, rt, second, rn, offset, index, wback } = pair;
        let base = self.base(rn);
        let moved = base.wrapping_add(offset);
        let address = if index { moved } else { base };
        if load {
            let values = (self.load_word(address)?, self.load_word(address.wrapping_add(4))?);
            self.set(rt, values.0);
            self.set(second, values.1);
        } else {
            self.store_word(address, self.get(rt))?;
            self.store_word(address.wrapping_add(4), self.get(second))?;
        }
        if wback {
            self.set(rn, moved);
        }
        Ok(())
    }

    pub(super) fn multiple(&mut self, multiple: Multiple) -> Result<(), Trap> {
        let Multiple { load, rn, list, wback, down } = multiple;
        let (base, len) = (self.get(rn), 4 * list.count_ones());
        let moved = if down { base.wrapping_sub(len) } else { base.wrapping_add(len) };
        let start = if down { moved } else { base };
        let mut values = [0; 16];
        let mut address = start;
        let mut rest = list;
        for value in &mut values {
            if rest == 0 {
                break;
            }
            if load {
                *value = self.load_word(address)?;
            } else {
                self.store_word(address, self.get(Reg::new(rest.trailing_zeros())))?;
            }
            address = address.wrapping_add(4);
            rest &= rest - 1;
        }
        if wback {
            self.set(rn, moved);
        }
        if load {
            let mut rest = list;
            for value in values {
                if rest == 0 {
                    break;
                }
                let register = Reg::new(rest.trailing_zeros());
                if register.is_pc() {
                    self.exchange(value);
                } else {
                    self.set(register, value);
                }
                rest &= rest - 1;
            }
        }
        Ok(())
    }

    /// The exclusive monitor of an STM32F103 covers all memory (PM0056 2.2.7): a store succeeds after a load
    /// of any address.
    pub(super) fn exclusive(&mut self, exclusive: Exclusive) -> Result<(), Trap> {
        let Exclusive { load, size, rt, rn, rd, offset } = exclusive;
        let address = self.get(rn).wrapping_add(offset);
        aligned(address, size)?;
        if load {
            let value = self.load_aligned(address, size, self.is_privileged())?;
            self.sys.exclusive = true;
            self.set(rt, value);
        } else if std::mem::take(&mut self.sys.exclusive) {
            self.store_aligned(address, size, self.get(rt), self.is_privileged())?;
            self.set(rd, 0);
        } else {
            self.set(rd, 1);
        }
        Ok(())
    }

    pub(super) fn table(&mut self, base: Reg, index: Reg, size: Size) -> Result<(), Trap> {
        let address = self.get(base).wrapping_add(self.get(index).wrapping_mul(size.bytes()));
        let halves = self.load(address, size, self.is_privileged())?;
        let target = self.registers.pc().wrapping_add(2 * halves);
        self.branch(target);
        Ok(())
    }
}

const fn aligned(address: u32, size: Size) -> Result<(), Trap> {
    if address.is_multiple_of(size.bytes()) { Ok(()) } else { Err(Trap::Fault(Fault::Unaligned)) }
}

const fn bus(address: u32) -> Trap {
    Trap::Fault(Fault::Bus(address))
}

fn refused(address: u32, value: Option<u32>, refusal: AccessError) -> Trap {
    match refusal {
        AccessError::Bus => bus(address),
        AccessError::NotModeled(what) => Trap::Stop(Problem::NotModeled { address, value, what }),
    }
}
