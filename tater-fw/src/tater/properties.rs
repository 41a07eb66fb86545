//! What a GET of each property reads and what a SET of it does. Both matches are exhaustive: a new row of the property
//! table does not compile until it is served here.

use super::kept::{self, kept};
use super::{Refused, Tater};
use crate::board::Board;
use crate::codes::{self, end_code, fault_code, mode_code};
use crate::motion::{self, motion};
use crate::storage::Counters;
use servo_core::mode::Mode;
use servo_core::servo::COUNTS_PER_REV;
use servo_core::units::{CountsPerSec, Torque};
use servo_core::{Command, Refusal};
use tater_wire::{FaultCode, Node, Property};

/// Counts a motor revolution.
const REV: i32 = 18;
const _: () = assert!(REV == 18 && COUNTS_PER_REV == 18, "the estimator's");

/// STAT of a board that is awake, and the STAT that wakes it or clears ERROR.
const READY: i64 = 2;

/// The STAT that resets it into the monitor.
const MONITOR: i64 = 0;

impl<B: Board> Tater<B> {
    /// The value of a property, within its row's range; `None` if it can only be set.
    pub(super) fn read(&self, property: Property) -> Option<i64> {
        match property {
            motion!() => motion::get(self.servo.config(), property),
            // As set; the ID of a board that has none is 0.
            kept!() => kept::get(&self.kept, property),
            // Looks at the inputs: not for each of a SAVE of all.
            _ => self.observe(property),
        }
    }

    /// The latched fault. A fault of the servo goes before one of the flash, which does not stop the motor; STAT 2 clears
    /// both.
    pub(super) fn error(&self) -> Option<FaultCode> {
        let storage = self.storage_error.then_some(FaultCode::Storage);
        self.servo.telemetry().fault.map(fault_code).or(storage)
    }

    /// [`Self::read`] of what is not as a SET has left it.
    fn observe(&self, property: Property) -> Option<i64> {
        use Property as P;
        let status = self.servo.telemetry();
        let analog = self.board.analog();
        let counters = self.store.counters();
        let value = match property {
            P::VERS | P::CTS | P::IPNM | P::POLES => property.rules().min(),
            P::ERROR => self.error().map_or(0, FaultCode::into),
            P::STAT => READY,
            P::MODE => mode_code(status.mode).into(),
            P::TEMP => i64::from(analog.board_temp.0),
            P::PTEMP => i64::from(counters.ptemp),
            P::B => i64::from(self.drive.brake_released),
            P::ANA0 => i64::from(analog.raw[0]),
            P::ANA1 => i64::from(analog.raw[1]),
            P::THERM => i64::from(analog.motor_temp.0),
            P::VBUS => (i64::from(analog.bus.0) + 50) / 100,
            P::IMOTOR => i64::from(analog.current.0),
            P::SG => i64::from(analog.strain),
            P::T => i64::from(self.servo.torque().0),
            P::V if status.mode == Mode::Velocity => i64::from(status.setpoint_velocity.round()),
            P::V | P::VEL => i64::from(status.velocity.round()),
            // 22 bits go out, whatever a SET may say.
            P::P => return Some(i64::from(status.position.round())),
            P::E => i64::from(self.servo.end()),
            P::UPSECS => i64::from(counters.upsecs),
            P::OD => i64::from(counters.odometer),
            P::MECH => i64::from(self.commutator.count().rem_euclid(REV)),
            P::HALLS => i64::from(self.board.halls() & 7),
            // Ten codes are 30 bits; the next one tells GOD whether HI is needed.
            P::HALLH => i64::from(self.hall_history | u32::from(status.homed) << 30),
            P::BD => i64::from(status.breakaway.is_some()),
            P::BP => i64::from(self.breakaway_position),
            P::END => status.end.map_or(0, |reason| end_code(reason).into()),
            P::LOCK | P::CMD | P::SAVE | P::LOAD | P::DEF | P::M | motion!() | kept!() => return None,
        };
        let rules = property.rules();
        Some(value.max(rules.min()).min(rules.max()))
    }

    /// Sets a property that may be set.
    ///
    /// # Errors
    /// Why not; nothing has changed then.
    pub(super) fn write(&mut self, property: Property, value: i64) -> Result<(), Refused> {
        use Property as P;
        let out_of_range = Refused::Range(property);
        if !property.rules().admits(value) {
            return Err(out_of_range);
        }
        match property {
            motion!() | kept!() | P::P | P::PTEMP | P::UPSECS | P::OD => self.put(property, value),
            P::STAT if value == READY => {
                self.storage_error = false;
                self.command(Command::ClearFault)
            }
            P::STAT if value == MONITOR => {
                self.reset();
                Ok(())
            }
            P::MODE => {
                let mode = codes::mode(value).ok_or(out_of_range)?;
                self.command(Command::Mode(mode))
            }
            P::T => self.command(Command::Torque(Torque(narrow(value)?))),
            P::V => self.command(Command::Velocity(CountsPerSec::from_int(narrow(value)?))),
            P::E => self.command(Command::End(narrow(value)?)),
            P::M => self.command(Command::Move(narrow(value)?)),
            P::CMD => self.cmd(value),
            P::SAVE => self.save(value),
            P::LOAD => self.load(value),
            P::DEF => self.factory(value),
            // `set` has turned the key, also for numbers out of range.
            P::LOCK => Ok(()),
            P::STAT => Err(out_of_range),
            P::VERS
            | P::ERROR
            | P::TEMP
            | P::B
            | P::ANA0
            | P::ANA1
            | P::THERM
            | P::VBUS
            | P::IMOTOR
            | P::SG => Err(Refused::Access(property)),
            P::MECH | P::CTS | P::IPNM | P::HALLS | P::HALLH | P::POLES | P::BD | P::BP | P::END | P::VEL => {
                Err(Refused::Access(property))
            }
        }
    }

    /// Sets a property that flash keeps. LOAD and DEF come this way: through [`Self::write`] they could come to themselves
    /// again, and nobody could say how deep the stack gets.
    ///
    /// # Errors
    /// As those of [`Self::write`].
    pub(super) fn put(&mut self, property: Property, value: i64) -> Result<(), Refused> {
        use Property as P;
        let out_of_range = Refused::Range(property);
        if !property.rules().admits(value) {
            return Err(out_of_range);
        }
        match property {
            motion!() => {
                let mut config = *self.servo.config();
                if !motion::set(&mut config, property, value) {
                    return Err(out_of_range);
                }
                self.command(Command::Configure(config))
            }
            kept!() if kept::set(&mut self.kept, property, value) => {
                if matches!(property, P::GRPA | P::GRPB | P::GRPC) {
                    self.listen();
                }
                Ok(())
            }
            P::P => self.command(Command::Position(narrow(value)?)),
            P::PTEMP => self.reset_counters(Counters { ptemp: narrow(value)?, ..self.store.counters() }),
            P::UPSECS => self.reset_counters(Counters { upsecs: narrow(value)?, ..self.store.counters() }),
            P::OD => self.reset_counters(Counters { odometer: narrow(value)?, ..self.store.counters() }),
            _ => Err(out_of_range),
        }
    }

    pub(super) fn command(&mut self, command: Command) -> Result<(), Refused> {
        // Nobody could tell it alone to stop.
        if self.node == Node::HOST && command.moves() {
            return Err(Refused::Unnamed);
        }
        self.servo.command(command).map_err(Refused::Servo)
    }

    fn reset_counters(&mut self, counters: Counters) -> Result<(), Refused> {
        self.store.reset_counters(counters);
        Ok(())
    }
}

/// A value that its row's range has bounded, in the servo's width.
fn narrow<T: TryFrom<i64>>(value: i64) -> Result<T, Refused> {
    T::try_from(value).map_err(|_| Refused::Servo(Refusal::Range))
}
