//! What every block of registers implements, and the words for an access to it.

use crate::time::{NEVER, Time};

/// The result of an access to a register; the error says what is not modelled.
pub type RegisterResult<T> = Result<T, String>;

/// A block of registers. All accesses are of 32 bits, at offsets that are multiples of four; `now` is when.
pub trait Peripheral {
    /// Reads a register, with what reading does to it.
    ///
    /// # Errors
    /// What is not modelled.
    fn read(&mut self, offset: u32, now: Time) -> RegisterResult<u32>;

    /// Writes a register.
    ///
    /// # Errors
    /// What is not modelled: also bits that the real one obeys and this one does not.
    fn write(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()>;

    /// When it next does something by itself that anybody can notice: an interrupt, a trigger, a pin.
    fn next_event(&self) -> Time {
        NEVER
    }

    /// Lets time pass to `now`, which is not past [`Self::next_event`].
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
    NotModelled(String),
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

/// Why the chip starts again.
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
}
