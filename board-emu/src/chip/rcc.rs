//! Clocks and the cause of the last reset (RM0008 7).
//!
//! Modeled: HSI, HSE and PLL with their start-up times, the system clock and its dividers, the clock security
//! system, clock enable and reset bits of peripherals, the LSI as CSR shows it, and the reset flags. Not
//! modeled: LSE and RTC, ready interrupts, MCO.

#[cfg(test)]
mod tests;
mod tree;

use super::Reset;
use super::{Peripheral, RegisterResult};
use crate::time::{NEVER, Time, US};
use tree::{Source, Tree};

/// Start-up of the crystal: 2 ms (DS5319 table 22, typical).
pub const HSE_START: Time = 2000 * US;
/// The PLL's lock time: 200 us (DS5319 table 28, maximum).
pub const PLL_LOCK: Time = 200 * US;
/// The RC oscillator's start-up: 2 us (DS5319 table 24, maximum).
pub const HSI_START: Time = 2 * US;
/// The slow RC oscillator's start-up: 85 us (DS5319 table 25, maximum).
pub const LSI_START: Time = 85 * US;

/// Bits of CR (RM0008 7.3.1).
mod cr {
    pub const HSION: u32 = 1;
    pub const HSIRDY: u32 = 1 << 1;
    pub const HSITRIM: u32 = 0x1F << 3;
    pub const HSEON: u32 = 1 << 16;
    pub const HSERDY: u32 = 1 << 17;
    pub const HSEBYP: u32 = 1 << 18;
    pub const CSSON: u32 = 1 << 19;
    pub const PLLON: u32 = 1 << 24;
    pub const PLLRDY: u32 = 1 << 25;
}

/// Bits of CFGR (RM0008 7.3.2).
mod cfgr {
    pub const SW: u32 = 3;
    pub const SWS: u32 = 3 << 2;
    /// Fields that may be written only while the PLL is off: source, divider of the crystal, factor.
    pub const PLL: u32 = 0x3F << 16;
    pub const MCO: u32 = 7 << 24;
    /// Reserved bits.
    pub const NONE: u32 = 1 << 23 | 0xF8 << 24;
}

/// Bits of CIR (RM0008 7.3.3).
mod cir {
    pub const CSSF: u32 = 1 << 7;
    pub const ENABLES: u32 = 0x1F << 8;
    pub const CSSC: u32 = 1 << 23;
}

/// Bits of CSR (RM0008 7.3.10).
mod csr {
    pub const LSION: u32 = 1;
    pub const LSIRDY: u32 = 1 << 1;
    pub const RMVF: u32 = 1 << 24;
    pub const PINRSTF: u32 = 1 << 26;
    pub const PORRSTF: u32 = 1 << 27;
    pub const SFTRSTF: u32 = 1 << 28;
    pub const IWDGRSTF: u32 = 1 << 29;
    pub const WWDGRSTF: u32 = 1 << 30;
}

/// Clocks and reset.
#[derive(Clone, Debug)]
pub struct Rcc {
    crystal: bool,
    /// CR as written, without the ready bits.
    cr: u32,
    /// When each oscillator is ready; [`NEVER`] if it is off.
    hsi_ready: Time,
    hse_ready: Time,
    pll_ready: Time,
    lsi_ready: Time,
    /// CFGR without SWS.
    cfgr: u32,
    source: Source,
    clock_failed: bool,
    apb2rstr: u32,
    apb1rstr: u32,
    ahbenr: u32,
    apb2enr: u32,
    apb1enr: u32,
    flags: u32,
    /// Blocks to be reset.
    resets: Vec<u32>,
    tree: Tree,
}

impl Default for Rcc {
    fn default() -> Self {
        let mut rcc = Self {
            crystal: true,
            cr: 0,
            hsi_ready: 0,
            hse_ready: NEVER,
            pll_ready: NEVER,
            lsi_ready: NEVER,
            cfgr: 0,
            source: Source::Hsi,
            clock_failed: false,
            apb2rstr: 0,
            apb1rstr: 0,
            ahbenr: 0,
            apb2enr: 0,
            apb1enr: 0,
            flags: 0,
            resets: Vec::new(),
            tree: Tree::RESET,
        };
        rcc.reset(Reset::Power);
        rcc
    }
}

impl Rcc {
    /// Resets all registers and sets the flag of the cause. PINRSTF is always set, because the chip pulls its
    /// own NRST low at every reset (RM0008 7.1.1, figure 4). Flags accumulate until RMVF or a power-on reset.
    pub fn reset(&mut self, cause: Reset) {
        let flags = csr::PINRSTF
            | match cause {
                Reset::Power => csr::PORRSTF,
                Reset::Pin => 0,
                Reset::Software => csr::SFTRSTF,
                Reset::Watchdog => csr::IWDGRSTF,
                Reset::WindowWatchdog => csr::WWDGRSTF,
            };
        self.flags = if cause == Reset::Power { flags } else { self.flags | flags };
        // Middle of the trimming; the RC oscillator runs (RM0008 7.3.1).
        self.cr = cr::HSION | 16 << 3;
        (self.hsi_ready, self.hse_ready, self.pll_ready, self.lsi_ready) = (0, NEVER, NEVER, NEVER);
        (self.cfgr, self.source, self.tree) = (0, Source::Hsi, Tree::RESET);
        self.clock_failed = false;
        (self.apb2rstr, self.apb1rstr) = (0, 0);
        // Clocks of RAM and flash interface in sleep mode (RM0008 7.3.6).
        (self.ahbenr, self.apb2enr, self.apb1enr) = (0x14, 0, 0);
        self.resets.clear();
    }

    /// Whether the peripheral at an address is clocked and not held in reset.
    #[must_use]
    pub fn is_clocked(&self, address: u32) -> bool {
        match tree::switch(address) {
            None => true,
            Some(tree::Switch::Ahb(bit)) => self.ahbenr >> bit & 1 == 1,
            Some(tree::Switch::Apb1(bit)) => (self.apb1enr & !self.apb1rstr) >> bit & 1 == 1,
            Some(tree::Switch::Apb2(bit)) => (self.apb2enr & !self.apb2rstr) >> bit & 1 == 1,
        }
    }

    /// Takes the start addresses of the blocks that APB1RSTR or APB2RSTR resets.
    pub fn take_peripheral_reset(&mut self) -> Option<u32> {
        self.resets.pop()
    }

    /// Ticks ([`crate::time`]) a cycle of the core: 2 at 72 MHz, 18 at 8 MHz.
    #[must_use]
    pub const fn core_cycle(&self) -> Time {
        self.tree.core
    }

    /// Ticks per cycle of TIM1's clock: APB2's, twice as fast if that is divided (RM0008 7.2, figure 8).
    #[must_use]
    pub const fn timer1_cycle(&self) -> Time {
        self.tree.timer1
    }

    /// Ticks per cycle of TIM2's, TIM3's and TIM4's clock: APB1's, twice as fast if that is divided.
    #[must_use]
    pub const fn timer_cycle(&self) -> Time {
        self.tree.timer
    }

    /// Ticks per cycle of the converter; it checks the limit of 14 MHz itself.
    #[must_use]
    pub const fn adc_cycle(&self) -> Time {
        self.tree.adc
    }

    /// Ticks per cycle of the clock of bxCAN and of the window watchdog: APB1's.
    #[must_use]
    pub const fn can_cycle(&self) -> Time {
        self.tree.apb1
    }

    /// Wait states that the flash needs for the present and the selected clock (PM0075 3.1: one above 24 MHz,
    /// two above 48 MHz).
    #[must_use]
    pub fn wait_states(&self) -> u32 {
        let coming = Tree::new(Source::from_bits(self.cfgr & cfgr::SW), self.cfgr);
        let hz = self.tree.core_hz.max(coming.map_or(0, |tree| tree.core_hz));
        u32::from(hz > 24_000_000) + u32::from(hz > 48_000_000)
    }

    /// Whether the RC oscillator runs: programming and erasing the flash needs it (PM0075 2.3).
    #[must_use]
    pub const fn is_hsi_on(&self) -> bool {
        self.cr & cr::HSION != 0
    }

    /// Whether the core has no clock, because its crystal failed without the clock security system.
    /// Everything but the watchdog stops.
    #[must_use]
    pub const fn is_stopped(&self) -> bool {
        !self.crystal && self.runs_from_crystal()
    }

    /// Whether the clock security system has detected a failure of the crystal: an NMI until it is cleared.
    #[must_use]
    pub const fn clock_failed(&self) -> bool {
        self.clock_failed
    }

    const fn runs_from_crystal(&self) -> bool {
        match self.source {
            Source::Hsi => false,
            Source::Hse => true,
            Source::Pll => tree::is_pll_from_crystal(self.cfgr),
        }
    }

    /// Makes the crystal fail or work again. A detected failure costs the start-up time again.
    pub fn set_crystal(&mut self, alive: bool, now: Time) {
        if self.crystal == alive {
            return;
        }
        self.crystal = alive;
        if alive {
            if self.cr & cr::HSEON != 0 && self.hse_ready == NEVER {
                self.hse_ready = now + HSE_START;
                self.start_pll(now);
            }
            return;
        }
        // The security system watches a crystal once it is ready (RM0008 7.2.7).
        if self.cr & cr::CSSON != 0 && self.hse_ready <= now {
            self.clock_failed = true;
            self.cr &= !cr::HSEON;
            self.hse_ready = NEVER;
            if self.runs_from_crystal() {
                self.cr = (self.cr | cr::HSION) & !(cr::PLLON * u32::from(self.source == Source::Pll));
                self.hsi_ready = self.hsi_ready.min(now + HSI_START);
                if self.source == Source::Pll {
                    self.pll_ready = NEVER;
                }
                self.cfgr &= !cfgr::SW;
                self.switch_to(Source::Hsi);
            }
        } else if self.hse_ready > now {
            self.hse_ready = NEVER;
            self.start_pll(now);
        }
    }

    /// When the PLL is locked after a change of it or of its input.
    fn start_pll(&mut self, now: Time) {
        let input = if tree::is_pll_from_crystal(self.cfgr) { self.hse_ready } else { self.hsi_ready };
        let on = self.cr & cr::PLLON != 0 && input != NEVER;
        self.pll_ready = if on { input.max(now) + PLL_LOCK } else { NEVER };
    }

    const fn ready(&self, source: Source) -> Time {
        match source {
            Source::Hsi => self.hsi_ready,
            Source::Hse => self.hse_ready,
            Source::Pll => self.pll_ready,
        }
    }

    const fn wanted(&self) -> Source {
        Source::from_bits(self.cfgr & cfgr::SW)
    }

    fn switch_to(&mut self, source: Source) {
        // A write rejects what is not allowed.
        if let Ok(tree) = Tree::new(source, self.cfgr) {
            (self.source, self.tree) = (source, tree);
        }
    }

    fn read_cr(&self, now: Time) -> u32 {
        let bit = |ready: Time, bit: u32| if ready <= now { bit } else { 0 };
        self.cr
            | bit(self.hsi_ready, cr::HSIRDY)
            | bit(self.hse_ready, cr::HSERDY)
            | bit(self.pll_ready, cr::PLLRDY)
    }

    /// The present or selected source of the system clock cannot be switched off (RM0008 7.3.1).
    fn write_cr(&mut self, value: u32, now: Time) -> RegisterResult<()> {
        let ours = cr::HSION | cr::HSITRIM | cr::HSEON | cr::HSEBYP | cr::CSSON | cr::PLLON;
        let mut new = value & ours;
        if new & cr::HSEBYP != 0 {
            return Err("RCC_CR.HSEBYP: there is a crystal, and no clock from outside".to_owned());
        }
        let used = [self.source, self.wanted()];
        let pll = used.contains(&Source::Pll);
        let crystal = used.contains(&Source::Hse) || pll && tree::is_pll_from_crystal(self.cfgr);
        let rc = used.contains(&Source::Hsi) || pll && !tree::is_pll_from_crystal(self.cfgr);
        for (bit, stays) in [(cr::PLLON, pll), (cr::HSION, rc), (cr::HSEON, crystal)] {
            new |= if stays { self.cr & bit } else { 0 };
        }
        let changed = new ^ self.cr;
        self.cr = new;
        if changed & cr::HSION != 0 {
            self.hsi_ready = if new & cr::HSION != 0 { now + HSI_START } else { NEVER };
        }
        if changed & cr::HSEON != 0 {
            let on = new & cr::HSEON != 0 && self.crystal;
            self.hse_ready = if on { now + HSE_START } else { NEVER };
        }
        if changed & (cr::PLLON | cr::HSEON | cr::HSION) != 0 && !pll {
            self.start_pll(now);
        }
        self.advance(now);
        Ok(())
    }

    fn write_cfgr(&mut self, value: u32, now: Time) -> RegisterResult<()> {
        if value & (cfgr::MCO | cfgr::NONE) != 0 {
            return Err(
                "RCC_CFGR: no clock comes out of the chip (MCO), and bits 23 and 27 to 31 are reserved"
                    .to_owned(),
            );
        }
        if value & cfgr::SW == cfgr::SW {
            return Err("RCC_CFGR.SW = 3: not allowed (RM0008 7.3.2)".to_owned());
        }
        let value = value & !cfgr::SWS;
        if self.cr & cr::PLLON != 0 && (value ^ self.cfgr) & cfgr::PLL != 0 {
            return Err("RCC_CFGR: the PLL is changed while it runs (RM0008 7.3.2)".to_owned());
        }
        let present = Tree::new(self.source, value)?;
        Tree::new(Source::from_bits(value & cfgr::SW), value)?;
        self.cfgr = value;
        self.tree = present;
        self.advance(now);
        Ok(())
    }

    fn write_cir(&mut self, value: u32) -> RegisterResult<()> {
        if value & cir::ENABLES != 0 {
            return Err("RCC_CIR: no interrupt of a clock that gets ready".to_owned());
        }
        self.clock_failed &= value & cir::CSSC == 0;
        Ok(())
    }

    fn write_csr(&mut self, value: u32, now: Time) {
        if value & csr::RMVF != 0 {
            self.flags = 0;
        }
        match (value & csr::LSION != 0, self.lsi_ready) {
            (true, NEVER) => self.lsi_ready = now + LSI_START,
            (true, _) => {}
            (false, _) => self.lsi_ready = NEVER,
        }
    }

    fn read_csr(&self, now: Time) -> u32 {
        let on = if self.lsi_ready == NEVER { 0 } else { csr::LSION };
        let ready = if self.lsi_ready <= now { csr::LSIRDY } else { 0 };
        self.flags | on | ready
    }
}

impl Peripheral for Rcc {
    fn read(&mut self, offset: u32, now: Time) -> RegisterResult<u32> {
        self.advance(now);
        Ok(match offset {
            0x00 => self.read_cr(now),
            0x04 => self.cfgr | self.source.bits() << 2,
            0x08 => cir::CSSF * u32::from(self.clock_failed),
            0x0C => self.apb2rstr,
            0x10 => self.apb1rstr,
            0x14 => self.ahbenr,
            0x18 => self.apb2enr,
            0x1C => self.apb1enr,
            // The backup domain is off.
            0x20 => 0,
            0x24 => self.read_csr(now),
            _ => return Err(format!("RCC has no register at offset {offset:#x}")),
        })
    }

    fn write(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()> {
        self.advance(now);
        match offset {
            0x00 => self.write_cr(value, now)?,
            0x04 => self.write_cfgr(value, now)?,
            0x08 => self.write_cir(value)?,
            0x0C => {
                self.resets.extend(tree::blocks(value & !self.apb2rstr, tree::Switch::Apb2));
                self.apb2rstr = value;
            }
            0x10 => {
                self.resets.extend(tree::blocks(value & !self.apb1rstr, tree::Switch::Apb1));
                self.apb1rstr = value;
            }
            0x14 => self.ahbenr = value,
            0x18 => self.apb2enr = value,
            0x1C => self.apb1enr = value,
            0x20 if value == 0 => {}
            0x20 => return Err("RCC_BDCR: the backup domain (LSE, RTC) is not modeled".to_owned()),
            0x24 => self.write_csr(value, now),
            _ => return Err(format!("RCC has no register at offset {offset:#x}")),
        }
        Ok(())
    }

    /// When the selected source becomes ready.
    fn next_event(&self) -> Time {
        let wanted = self.wanted();
        if wanted == self.source { NEVER } else { self.ready(wanted) }
    }

    fn advance(&mut self, now: Time) {
        let wanted = self.wanted();
        if wanted != self.source && self.ready(wanted) <= now {
            self.switch_to(wanted);
        }
    }
}
