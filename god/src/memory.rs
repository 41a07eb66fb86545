//! What GOD keeps: the parameters that are its own and no board's, as they are and as they are stored; macros and sequences.

pub mod bytes;

use core::cell::{Cell, RefCell};

use heapless::String;

use crate::motors::{COUNT, Motor};
use crate::parameter::{self, COUNTS, GLOBAL, Global, KEPT, Kept, Source};

/// Macros that the hand holds (manual 5.2.4).
pub const MACROS: usize = 20;

/// Sequences that the hand holds, and the longest, ends of lines included.
pub const SEQUENCES: usize = 6;
/// See [`SEQUENCES`].
pub const SEQUENCE: usize = 150;

/// What of a motor's parameters is GOD's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OfMotor {
    /// By [`Kept`].
    pub kept: [u8; KEPT],
    /// Positions and distances as they were set, GCL counts: by the place in [`Source::Counts`].
    pub as_set: [i32; COUNTS],
}

impl OfMotor {
    /// A motor's defaults.
    #[must_use]
    pub fn defaults(motor: Motor) -> Self {
        let mut of = Self { kept: [0; KEPT], as_set: [0; COUNTS] };
        for row in parameter::MOTOR {
            let default = row.default_for(motor.kind());
            match row.source {
                Source::Kept(kept) => of.keep(kept, default),
                Source::Counts(_, place) => {
                    if let (Some(to), Ok(value)) = (of.as_set.get_mut(usize::from(place)), default.try_into())
                    {
                        *to = value;
                    }
                }
                Source::Board(_) | Source::Measured(_) | Source::Status | Source::Fixed(_) => {}
            }
        }
        of
    }

    /// The value of one.
    #[must_use]
    pub fn of(&self, kept: Kept) -> u8 {
        self.kept.get(kept as usize).copied().unwrap_or(0)
    }

    /// Sets one; the row's range fits a byte.
    pub fn keep(&mut self, kept: Kept, value: i64) {
        if let (Some(to), Ok(value)) = (self.kept.get_mut(kept as usize), value.try_into()) {
            *to = value;
        }
    }
}

/// The hand's own parameters that can be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OfHand {
    /// BAUD: baud rate / 100.
    pub baud: u16,
    /// LFT.
    pub lft: bool,
    /// OTEMP, 0.1 °C.
    pub otemp: i16,
    /// LFDPD.
    pub lfdpd: bool,
}

impl Default for OfHand {
    fn default() -> Self {
        let of = |global| GLOBAL.iter().find(|row| row.global == global).map_or(0, |row| row.default);
        Self {
            baud: of(Global::Baud).try_into().unwrap_or(96),
            lft: of(Global::Lft) != 0,
            otemp: of(Global::Otemp).try_into().unwrap_or(-551),
            lfdpd: of(Global::Lfdpd) != 0,
        }
    }
}

/// Parameters of all motors and of the hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parameters {
    /// By the motor's place.
    pub motors: [OfMotor; COUNT],
    /// The hand's.
    pub hand: OfHand,
}

impl Default for Parameters {
    fn default() -> Self {
        let of = |place: u8| Motor::new(place + 1).map(OfMotor::defaults);
        let mut motors = [OfMotor { kept: [0; KEPT], as_set: [0; COUNTS] }; COUNT];
        for (place, to) in (0..).zip(&mut motors) {
            *to = of(place).unwrap_or(*to);
        }
        Self { motors, hand: OfHand::default() }
    }
}

/// A motor's positions in GCL counts, all seven.
pub type Positions = [i32; COUNT];

/// What survives a power-off.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stored {
    /// As FSAVE and PSAVE left them.
    pub parameters: Parameters,
    /// MACSET's.
    pub macros: [Option<Positions>; MACROS],
    /// REC's: lines, each with its CR.
    pub sequences: [String<SEQUENCE>; SEQUENCES],
    /// SN.
    pub serial: u32,
    /// PTEMP, 0.1 °C.
    pub peak_temperature: i16,
    /// UPSECS.
    pub up_seconds: u32,
}

/// GOD's memory: who owns the storage reads it when it has changed, and writes it where it survives.
#[derive(Debug, Default)]
pub struct Memory {
    stored: RefCell<Stored>,
    changed: Cell<bool>,
}

impl Memory {
    /// With what has survived.
    #[must_use]
    pub fn new(stored: Stored) -> Self {
        Self { stored: RefCell::new(stored), changed: Cell::new(false) }
    }

    /// All of it.
    #[must_use]
    pub fn stored(&self) -> Stored {
        self.stored.borrow().clone()
    }

    /// What is to be stored now, if it has changed since this was last asked.
    pub fn changed(&self) -> Option<Stored> {
        self.changed.replace(false).then(|| self.stored.borrow().clone())
    }

    /// Looks at it.
    pub(crate) fn look<T>(&self, look: impl FnOnce(&Stored) -> T) -> T {
        look(&self.stored.borrow())
    }

    /// Changes it.
    pub(crate) fn change<T>(&self, change: impl FnOnce(&mut Stored) -> T) -> T {
        self.changed.set(true);
        change(&mut self.stored.borrow_mut())
    }
}
