//! GOD's memory, which survives a power-off: its own parameters, macros, sequences and statistics.

pub mod bytes;

use core::cell::{Cell, RefCell};

use heapless::String;

use crate::motors::{COUNT, Motor};
use crate::parameter::{self, COUNTS, HAND, HandParameter, KEPT, Kept, Source};

/// Number of macros (manual 5.2.4).
pub const MACROS: usize = 20;

/// Number of sequences (manual 5.2.4).
pub const SEQUENCES: usize = 6;

/// Length of the longest sequence, line ends included (manual 5.2.4).
pub const SEQUENCE: usize = 150;

/// The parameters of a motor that GOD keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotorParameters {
    /// Values in the order of [`Kept`].
    pub kept: [u8; KEPT],
    /// Positions and distances as they were set, GCL counts; by the place in [`Source::Counts`].
    pub as_set: [i32; COUNTS],
}

impl MotorParameters {
    /// A motor's defaults.
    #[must_use]
    pub fn defaults(motor: Motor) -> Self {
        let mut of = Self { kept: [0; KEPT], as_set: [0; COUNTS] };
        for row in parameter::MOTOR {
            let default = row.default_for(motor.kind());
            match row.source {
                Source::Kept { kept, .. } => of.set(kept, default),
                Source::Counts { place, .. } => {
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
    pub fn value(&self, kept: Kept) -> u8 {
        self.kept.get(kept as usize).copied().unwrap_or(0)
    }

    /// Sets one; the range of each fits a byte.
    pub fn set(&mut self, kept: Kept, value: i64) {
        if let (Some(to), Ok(value)) = (self.kept.get_mut(kept as usize), value.try_into()) {
            *to = value;
        }
    }
}

/// The hand's own parameters that can be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HandParameters {
    /// BAUD: baud rate / 100.
    pub baud: u16,
    /// LFT.
    pub lft: bool,
    /// OTEMP, 0.1 °C.
    pub otemp: i16,
    /// LFDPD.
    pub lfdpd: bool,
}

impl Default for HandParameters {
    fn default() -> Self {
        let of = |parameter| HAND.iter().find(|row| row.parameter == parameter).map_or(0, |row| row.default);
        Self {
            baud: of(HandParameter::Baud).try_into().unwrap_or(96),
            lft: of(HandParameter::Lft) != 0,
            otemp: of(HandParameter::Otemp).try_into().unwrap_or(-551),
            lfdpd: of(HandParameter::Lfdpd) != 0,
        }
    }
}

/// Parameters of all motors and of the hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parameters {
    /// In the order of the motors.
    pub motors: [MotorParameters; COUNT],
    /// The hand's.
    pub hand: HandParameters,
}

impl Default for Parameters {
    fn default() -> Self {
        let of = |place: u8| Motor::new(place + 1).map(MotorParameters::defaults);
        let mut motors = [MotorParameters { kept: [0; KEPT], as_set: [0; COUNTS] }; COUNT];
        for (place, to) in (0..).zip(&mut motors) {
            *to = of(place).unwrap_or(*to);
        }
        Self { motors, hand: HandParameters::default() }
    }
}

/// A motor's positions in GCL counts, all seven.
pub type Positions = [i32; COUNT];

/// The content of the memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stored {
    /// Parameters as FSAVE and PSAVE stored them.
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

/// GOD's memory. The owner asks for changes and writes them where they survive.
#[derive(Debug, Default)]
pub struct Memory {
    stored: RefCell<Stored>,
    changed: Cell<bool>,
}

impl Memory {
    /// A memory with what has survived.
    #[must_use]
    pub fn new(stored: Stored) -> Self {
        Self { stored: RefCell::new(stored), changed: Cell::new(false) }
    }

    /// All of it.
    #[must_use]
    pub fn stored(&self) -> Stored {
        self.stored.borrow().clone()
    }

    /// A copy to store, if it has changed since the last call.
    pub fn changed(&self) -> Option<Stored> {
        self.changed.replace(false).then(|| self.stored.borrow().clone())
    }

    pub(crate) fn read<T>(&self, read: impl FnOnce(&Stored) -> T) -> T {
        read(&self.stored.borrow())
    }

    pub(crate) fn update<T>(&self, update: impl FnOnce(&mut Stored) -> T) -> T {
        self.changed.set(true);
        update(&mut self.stored.borrow_mut())
    }
}
