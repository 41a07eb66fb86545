//! The interface of every block of registers, and the results of an access.

use crate::time::{NEVER, Time};

/// The result of an access to a register; the error names what is not modeled.
pub type RegisterResult<T> = Result<T, String>;

/// A block of registers. Accesses have 32 bits at offsets that are multiples of four; `now` is their time.
pub trait Peripheral {
    /// Reads a register, with its side effects.
    ///
    /// # Errors
    /// The register or bit is not modeled.
    fn read(&mut self, offset: u32, now: Time) -> RegisterResult<u32>;

    /// Writes a register.
    ///
    /// # Errors
    /// The register or bit is not modeled, but has an effect on the chip.
    fn write(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()>;

    /// Time of the next event that is visible outside: an interrupt, a trigger, a pin.
    fn next_event(&self) -> Time {
        NEVER
    }

    /// Advances to `now`, which is not past [`Self::next_event`].
    fn advance(&mut self, now: Time) {
        let _ = now;
    }
}

/// Why an access failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AccessError {
    /// The bus answers with an error (a BusFault): nothing is at the address, or the flash is locked.
    Bus,
    /// The model lacks it: the run ends.
    NotModeled(String),
}

/// Width of an access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// 8 bits.
    Byte,
    /// 16 bits.
    Half,
    /// 32 bits.
    Word,
}

impl Size {
    /// Bytes of it.
    #[must_use]
    pub const fn bytes(self) -> u32 {
        match self {
            Self::Byte => 1,
            Self::Half => 2,
            Self::Word => 4,
        }
    }
}

/// Cause of a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// The supply came up, or sagged below the threshold of power-on reset.
    Power,
    /// The reset pin.
    Pin,
    /// AIRCR.SYSRESETREQ.
    Software,
    /// The independent watchdog.
    Watchdog,
    /// The window watchdog.
    WindowWatchdog,
}
