//! 128 KiB of flash in pages of 1 KiB: programming by half-words, page erase, busy times (RM0008 3, PM0075).
//!
//! An operation takes effect when it begins; until [`Flash::busy_until`] the core stalls on the flash. If a
//! reset or power failure comes before, a random (seeded) part of the effect is undone. Not modeled: option
//! bytes, write and read protection, the FPEC's interrupt.

#[cfg(test)]
mod tests;

use super::{AccessError, Size};
use super::{Peripheral, RegisterResult};
use crate::time::{Time, US};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_f103::map::{FLASH, PAGE};

/// Programming a half-word: 52.5 us (DS5319 5.3.9, typical; 40 to 70).
pub const PROGRAM: Time = 105 * US / 2;

/// Erasing a page, or all of them: 40 ms (DS5319 5.3.9, maximum).
pub const ERASE: Time = 40_000 * US;

/// The keys that unlock CR, in order (PM0075 2.3.2).
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// Bits of ACR (PM0075 3.1): latency, half-cycle access, prefetch buffer, and its state.
mod acr {
    pub const LATENCY: u32 = 7;
    pub const PRFTBE: u32 = 1 << 4;
    pub const PRFTBS: u32 = 1 << 5;
    pub const RESET: u32 = PRFTBE;
}

/// Bits of SR (PM0075 3.4).
mod sr {
    pub const BSY: u32 = 1;
    pub const PGERR: u32 = 1 << 2;
    pub const WRPRTERR: u32 = 1 << 4;
    pub const EOP: u32 = 1 << 5;
}

/// Bits of CR (PM0075 3.5).
mod cr {
    pub const PG: u32 = 1;
    pub const PER: u32 = 1 << 1;
    pub const MER: u32 = 1 << 2;
    pub const STRT: u32 = 1 << 6;
    pub const LOCK: u32 = 1 << 7;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lock {
    /// Number of correct keys so far.
    Keys(usize),
    /// A wrong key: locked until the next reset (PM0075 2.3.2; its bus error is not modeled).
    Jammed,
}

/// Kind of operation, with its offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Program a half-word.
    Program(u32, u16),
    /// Erase the page that begins here.
    Erase(u32),
    /// Erase all pages.
    EraseAll,
}

#[derive(Clone, Debug)]
struct Begun {
    number: u64,
    /// Offset and former contents.
    at: usize,
    old: Vec<u8>,
    erase: bool,
}

/// A planned power failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cut {
    None,
    At(u64),
    /// It has happened: operations have no effect.
    Dead,
}

/// The flash and its registers.
#[derive(Clone, Debug)]
pub struct Flash {
    /// Contents.
    pub bytes: Vec<u8>,
    /// End of the present operation: fetches and reads stall until then.
    pub busy_until: Time,
    acr: u32,
    lock: Lock,
    /// SR without BSY.
    sr: u32,
    cr: u32,
    ar: u32,
    log: Vec<Operation>,
    /// The last operation, until another begins or it is interrupted.
    last: Option<Begun>,
    cut: Cut,
    /// State of the random numbers for interrupted operations.
    seed: u64,
}

impl Default for Flash {
    fn default() -> Self {
        Self {
            bytes: vec![0xFF; FLASH.len as usize],
            busy_until: 0,
            acr: acr::RESET,
            lock: Lock::Keys(0),
            sr: 0,
            cr: cr::LOCK,
            ar: 0,
            log: Vec::new(),
            last: None,
            cut: Cut::None,
            seed: 0,
        }
    }
}

impl Flash {
    /// Resets the registers: locked. An operation in progress stays half done. After a power failure the
    /// flash works again; a planned one stays planned.
    pub fn reset(&mut self, now: Time) {
        if self.busy_until > now {
            self.interrupt();
        }
        self.last = None;
        if self.is_cut() {
            self.cut = Cut::None;
        }
        self.busy_until = now.min(self.busy_until);
        self.acr = acr::RESET;
        self.lock = Lock::Keys(0);
        (self.sr, self.cr, self.ar) = (0, cr::LOCK, 0);
    }

    /// Operations (half-words programmed, pages erased) since the flash was made; a mass erase is one.
    #[must_use]
    pub const fn operations(&self) -> u64 {
        self.log.len() as u64
    }

    /// The same, including those after a power failure.
    #[must_use]
    pub fn log(&self) -> &[Operation] {
        &self.log
    }

    /// Plans a power failure in the middle of the operation after `operations` more; `seed` decides what that
    /// leaves. From then on operations have no effect until [`Self::reset`]: the caller switches the power
    /// off when [`Self::is_cut`].
    pub const fn cut_after(&mut self, operations: u64, seed: u64) {
        self.cut = Cut::At(self.operations() + operations);
        self.seed = seed;
    }

    /// Whether the planned power failure has happened.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.cut == Cut::Dead
    }

    /// Writes without timing or rules, as a programmer on the bench. Bytes beyond the flash are ignored.
    pub fn load(&mut self, address: u32, bytes: &[u8]) {
        let at = address.wrapping_sub(FLASH.start) as usize;
        for (to, from) in self.bytes.iter_mut().skip(at).zip(bytes) {
            *to = *from;
        }
    }

    /// Wait states of accesses (ACR.LATENCY).
    #[must_use]
    pub const fn wait_states(&self) -> u32 {
        self.acr & acr::LATENCY
    }

    /// Reads at an offset within the flash.
    ///
    /// # Errors
    /// None at present.
    pub fn read(&mut self, offset: u32, size: Size) -> Result<u32, AccessError> {
        let at = offset as usize;
        let byte = |i: usize| u32::from(self.bytes.get(at + i).copied().unwrap_or(0xFF)) << (8 * i);
        Ok((0..size.bytes() as usize).map(byte).sum())
    }

    /// Writes to the flash: programs if the registers allow it (PM0075 2.3.3). A half-word that is not erased
    /// keeps its value and sets PGERR, unless 0 is written.
    ///
    /// # Errors
    /// A bus error: a width other than 16 bits, an odd offset, or CR.PG not set.
    pub fn program(&mut self, offset: u32, size: Size, value: u32, now: Time) -> Result<(), AccessError> {
        if size != Size::Half || !offset.is_multiple_of(2) || self.cr & cr::PG == 0 {
            return Err(AccessError::Bus);
        }
        if self.cr & (cr::PER | cr::MER) != 0 {
            return Err(AccessError::NotModeled("programming with FLASH_CR.PER or MER set".to_owned()));
        }
        let at = offset as usize;
        let [low, high, ..] = value.to_le_bytes();
        let new = [low, high];
        if self.bytes.get(at..at + 2) != Some(&[0xFF, 0xFF]) && new != [0, 0] {
            self.sr |= sr::PGERR;
            return Ok(());
        }
        self.log.push(Operation::Program(FLASH.start + offset, u16::from_le_bytes(new)));
        self.begin(at, &new, now + PROGRAM);
        Ok(())
    }

    /// CR.STRT: erases by PER or MER (PM0075 2.3.4).
    fn start(&mut self, now: Time) -> RegisterResult<()> {
        let (at, len, operation) = match self.cr & (cr::PER | cr::MER | cr::PG) {
            cr::PER if FLASH.holds(self.ar.into(), 1) => {
                let page = (self.ar - FLASH.start) / PAGE * PAGE;
                (page as usize, PAGE as usize, Operation::Erase(FLASH.start + page))
            }
            cr::PER => return Err(format!("FLASH_AR: no page at {:#010x}", self.ar)),
            cr::MER => (0, FLASH.len as usize, Operation::EraseAll),
            bits => {
                return Err(format!(
                    "FLASH_CR.STRT with {bits:#x} of PG, PER and MER: one of the last two alone"
                ));
            }
        };
        self.log.push(operation);
        self.begin(at, &vec![0xFF; len], now + ERASE);
        Ok(())
    }

    fn begin(&mut self, at: usize, new: &[u8], until: Time) {
        let number = self.operations() - 1;
        let erase = !matches!(self.log.last(), Some(Operation::Program(..)));
        self.busy_until = until;
        self.sr |= sr::EOP;
        if self.is_cut() {
            return;
        }
        let Some(bytes) = self.bytes.get_mut(at..at + new.len()) else { return };
        self.last = Some(Begun { number, at, old: bytes.to_vec(), erase });
        bytes.copy_from_slice(new);
        if self.cut == Cut::At(number) {
            self.interrupt();
            self.cut = Cut::Dead;
        }
    }

    /// Leaves the last operation half done, by the same rules as the simulated boards' flash
    /// (`hil_world::rig::flash`).
    fn interrupt(&mut self) {
        let Some(Begun { number, at, old, erase }) = self.last.take() else { return };
        let mut rng = Pcg64Mcg::new(u128::from(self.seed) << 64 | u128::from(number));
        let Some(bytes) = self.bytes.get_mut(at..at + old.len()) else { return };
        if !erase {
            // Some bits did not fall.
            let kept = rng.random::<u16>().to_le_bytes();
            for ((byte, old), kept) in bytes.iter_mut().zip(old).zip(kept) {
                *byte = old & (*byte | kept);
            }
            return;
        }
        match rng.random_range(0..4) {
            // Interrupted early, late, or in between: some bits, all, or none are erased.
            0 => bytes.copy_from_slice(&old),
            1 => {}
            2 => bytes.iter_mut().zip(old).for_each(|(byte, old)| *byte = old | rng.random::<u8>()),
            _ => bytes.iter_mut().for_each(|byte| *byte = rng.random()),
        }
    }

    fn write_key(&mut self, key: u32) {
        self.lock = match self.lock {
            Lock::Keys(right) if self.cr & cr::LOCK != 0 && KEYS.get(right) == Some(&key) => {
                Lock::Keys(right + 1)
            }
            _ => Lock::Jammed,
        };
        if self.lock == Lock::Keys(KEYS.len()) {
            self.cr &= !cr::LOCK;
        }
    }

    /// A write without lock; LOCK can only be set here (PM0075 3.5).
    fn write_cr(&mut self, value: u32, now: Time) -> RegisterResult<()> {
        if self.cr & cr::LOCK != 0 {
            return Ok(());
        }
        let modeled = cr::PG | cr::PER | cr::MER | cr::STRT | cr::LOCK;
        if value & !modeled != 0 {
            return Err("FLASH_CR: option bytes and interrupts are not there".to_owned());
        }
        if now < self.busy_until {
            return Err("FLASH_CR is written during an operation".to_owned());
        }
        self.cr = value & !cr::STRT;
        if value & cr::LOCK != 0 && self.lock != Lock::Jammed {
            self.lock = Lock::Keys(0);
        }
        if value & cr::STRT != 0 { self.start(now) } else { Ok(()) }
    }
}

impl Peripheral for Flash {
    fn read(&mut self, offset: u32, now: Time) -> RegisterResult<u32> {
        let busy = now < self.busy_until;
        Ok(match offset {
            0x00 => self.acr | if self.acr & acr::PRFTBE != 0 { acr::PRFTBS } else { 0 },
            // Write-only.
            0x04 | 0x08 => 0,
            0x0C if busy => self.sr & !sr::EOP | sr::BSY,
            0x0C => self.sr,
            0x10 if busy && self.last.as_ref().is_some_and(|last| last.erase) => self.cr | cr::STRT,
            0x10 => self.cr,
            0x14 => 0,
            _ => {
                return Err(format!(
                    "not even a register of the flash at offset {offset:#x}: option bytes are not there"
                ));
            }
        })
    }

    fn write(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()> {
        match offset {
            0x00 => {
                let (latency, half_cycle) = (value & acr::LATENCY, value >> 3 & 1);
                if latency > 2 || half_cycle == 1 || value >> 6 != 0 {
                    return Err(format!("FLASH_ACR = {value:#x}: up to 2 wait states, no half-cycle access"));
                }
                self.acr = value & !acr::PRFTBS;
            }
            0x04 => self.write_key(value),
            0x0C => self.sr &= !(value & (sr::EOP | sr::PGERR | sr::WRPRTERR)),
            0x10 => self.write_cr(value, now)?,
            // Write-protected during an operation (PM0075 3.6).
            0x14 if now < self.busy_until => {}
            0x14 => self.ar = value,
            _ => {
                return Err(format!(
                    "the flash has no register at offset {offset:#x}: option bytes are not there"
                ));
            }
        }
        Ok(())
    }
}
