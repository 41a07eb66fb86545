//! GOD's memory: the parameters in use; and what survives a power-off, which are parameters, macros, sequences and statistics.

pub mod bytes;

use core::cell::Cell;

use heapless::String;

use crate::io::Io;
use crate::motors::{COUNT, Motor};
use crate::parameter::{self, COUNTS, HAND, HandParameter, KEPT, Kept, Source};
use crate::shared::Shared;
use crate::status::Status;

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
    /// COMPAT is 262.
    pub compat_262: bool,
}

impl Default for HandParameters {
    fn default() -> Self {
        let of = |parameter| HAND.iter().find(|row| row.parameter == parameter).map_or(0, |row| row.default);
        Self {
            baud: of(HandParameter::Baud).try_into().unwrap_or(96),
            lft: of(HandParameter::Lft) != 0,
            otemp: of(HandParameter::Otemp).try_into().unwrap_or(-551),
            lfdpd: of(HandParameter::Lfdpd) != 0,
            compat_262: of(HandParameter::Compat) != 0,
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
    /// SN; 0: not set yet.
    pub serial: u32,
    /// PTEMP, 0.1 °C.
    pub peak_temperature: i16,
    /// UPSECS.
    pub up_seconds: u32,
}

/// Longest wait for the owner to write, µs: a flash erases the pages for all of it in a fraction of this.
const WRITE_US: u64 = 1_000_000;

/// How a save becomes permanent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Write {
    /// By itself: no owner reports.
    #[default]
    Unreported,
    /// The owner has nothing to write for a command.
    Idle,
    /// A command waits for [`Memory::written`].
    Wanted,
    /// The owner has answered it: whether it is stored.
    Done(bool),
}

/// GOD's memory. The owner asks for changes and writes them where they survive.
#[derive(Debug, Default)]
pub struct Memory {
    in_use: Shared<Parameters>,
    stored: Shared<Stored>,
    changed: Cell<bool>,
    /// A command has saved something since the last commit.
    uncommitted: Cell<bool>,
    write: Cell<Write>,
}

impl Memory {
    /// A memory with what has survived.
    #[must_use]
    pub fn new(stored: Stored) -> Self {
        Self { in_use: Shared::new(stored.parameters), stored: Shared::new(stored), ..Self::default() }
    }

    /// The parameters in use; those that are stored are what FLOAD and PLOAD restore.
    #[must_use]
    pub fn parameters(&self) -> Parameters {
        self.in_use.with(|in_use| *in_use)
    }

    pub(crate) fn change_parameters(&self, change: impl FnOnce(&mut Parameters)) {
        self.in_use.with(change);
    }

    /// From now on a command that saves waits until the owner has written it, and ends with [`Status::NOT_STORED`] if that fails: see
    /// [`Memory::wants_write`] and [`Memory::written`].
    pub fn report_writes(&self) {
        self.write.set(Write::Idle);
    }

    /// Whether a command waits until everything is written.
    #[must_use]
    pub fn wants_write(&self) -> bool {
        self.write.get() == Write::Wanted
    }

    /// The owner has tried to write everything.
    pub fn written(&self, is_stored: bool) {
        if self.wants_write() {
            self.write.set(Write::Done(is_stored));
        }
    }

    /// All of it.
    #[must_use]
    pub fn stored(&self) -> Stored {
        self.stored.with(|stored| stored.clone())
    }

    /// A copy to store, if it has changed since the last call.
    pub fn changed(&self) -> Option<Stored> {
        self.changed.replace(false).then(|| self.stored())
    }

    pub(crate) fn read<T: Default>(&self, read: impl FnOnce(&Stored) -> T) -> T {
        self.stored.with(|stored| read(stored))
    }

    /// Saves something for a command; see [`Memory::commit`].
    pub(crate) fn update<T: Default>(&self, update: impl FnOnce(&mut Stored) -> T) -> T {
        self.uncommitted.set(true);
        self.note(update)
    }

    /// Stores something that no command waits for.
    pub(crate) fn note<T: Default>(&self, update: impl FnOnce(&mut Stored) -> T) -> T {
        self.changed.set(true);
        self.stored.with(update)
    }

    /// Waits until the owner has written what commands have saved.
    pub(crate) async fn commit(&self, io: &Io) -> Status {
        if !self.uncommitted.replace(false) || self.write.get() == Write::Unreported {
            return Status::OK;
        }
        self.write.set(Write::Wanted);
        let done = io.wait_until(io.after_us(WRITE_US), || match self.write.get() {
            Write::Done(is_stored) => Some(is_stored),
            _ => None,
        });
        let is_stored = done.await == Some(true);
        self.write.set(Write::Idle);
        if is_stored { Status::OK } else { Status::NOT_STORED }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::pin::pin;
    use std::string::String;

    use crate::io;

    /// Types a line to a hand whose owner writes after 5 ms with this result, or never. Returns the answer and its time, ms.
    fn type_line(line: &str, result: Option<bool>) -> (String, u64) {
        let (io, memory) = (Io::default(), Memory::default());
        memory.report_writes();
        let mut god = pin!(crate::run(&io, &memory));
        let (mut text, mut wanted) = (String::new(), 0);
        line.bytes().chain([b'\r']).for_each(|byte| io.push_rx(byte));
        for ms in 0..10_000 {
            io::poll(god.as_mut(), &io, ms * 1000);
            wanted += u64::from(memory.wants_write());
            if let Some(is_stored) = result.filter(|_| wanted == 5) {
                assert!(memory.changed().is_some(), "there is something to write");
                memory.written(is_stored);
                wanted += 1;
            }
            text.extend(core::iter::from_fn(|| io.pop_tx()).map(char::from));
            if let Some((_, answer)) = text.rsplit_once(line)
                && answer.ends_with("=> ")
            {
                return (answer.into(), ms);
            }
        }
        panic!("no prompt: {text:?}");
    }

    #[test]
    fn save_ends_with_the_result_of_the_write() {
        for line in ["PSAVE", "REC 1"] {
            assert_eq!(type_line(line, Some(true)), ("\r\n\r=> ".into(), 5), "{line}");
            assert_eq!(type_line(line, Some(false)), ("\r\n\rERR 512\r\n\r=> ".into(), 5), "{line}");
            assert_eq!(type_line(line, None), ("\r\n\rERR 512\r\n\r=> ".into(), WRITE_US / 1000), "{line}");
        }
    }

    #[test]
    fn command_that_saves_nothing_does_not_wait() {
        assert_eq!(type_line("PSET LFT 0", None), ("\r\n\r=> ".into(), 0));
    }

    #[test]
    fn owner_gets_each_change_once() {
        let memory = Memory::new(Stored { serial: 7, ..Stored::default() });
        assert_eq!((memory.stored().serial, memory.changed()), (7, None));
        memory.note(|stored| stored.up_seconds = 9);
        let expected = Stored { serial: 7, up_seconds: 9, ..Stored::default() };
        assert_eq!((memory.changed(), memory.changed()), (Some(expected.clone()), None));
        assert_eq!(memory.update(|stored| stored.up_seconds), 9);
        assert_eq!((memory.changed(), memory.stored()), (Some(expected.clone()), expected));
        memory.written(true);
        assert!(!memory.wants_write());
    }

    #[test]
    fn defaults_of_motors_are_those_of_the_table() {
        let Parameters { motors, hand } = Parameters::default();
        for motor in crate::Motors::ALL.iter() {
            let of = motors[motor.index()];
            assert_eq!(of, MotorParameters::defaults(motor));
            assert_eq!((of.value(Kept::Lcv), of.value(Kept::Lcvc), of.value(Kept::Lct)), (1, 8, 0));
        }
        assert_eq!(
            (motors[0].as_set, motors[3].as_set),
            ([8500, 1400, 18_200, 200, 0], [1575, 800, 9300, 200, 0])
        );
        assert_eq!(
            (hand.baud, hand.lft, hand.otemp, hand.lfdpd, hand.compat_262),
            (96, false, -551, false, false)
        );
    }
}
