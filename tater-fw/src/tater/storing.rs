//! SAVE, LOAD and DEF, and whether the stored position may be trusted.

use super::kept;
use super::{OFF, Refused, Tater};
use crate::board::Board;
use crate::motion;
use servo_core::mode::Mode;
use servo_core::{Command, Refusal};
use tater_wire::Property;
use tater_wire::property::{Access, Rules, Stored};

/// The id that stands for all properties.
pub(super) const ALL: i64 = -1;

impl<B: Board> Tater<B> {
    /// SAVE: takes effect in RAM now; [`Tater::store`] puts it into flash.
    ///
    /// # Errors
    /// Not a property, or not one that is stored.
    pub(super) fn save(&mut self, id: i64) -> Result<(), Refused> {
        match stored_property(Property::SAVE, id)? {
            Some(property) => self.save_one(property),
            None => {
                motion::each(self.servo.config(), |property, value| self.store.set(property, value));
                kept::each(&self.kept, |property, value| {
                    let rules = property.rules();
                    if rules.access != Access::Locked {
                        self.store.set_by(rules, value);
                    }
                });
                self.save_one(Property::P);
                for property in [Property::ROLE, Property::SN, Property::ID] {
                    if self.is_own(property) {
                        self.save_one(property);
                    }
                }
            }
        }
        Ok(())
    }

    /// Whether a property is another than without storage, or is stored already: what straps and chip say goes on being
    /// theirs to say.
    fn is_own(&self, property: Property) -> bool {
        self.store.get(property).is_some() || self.read(property) != self.unstored(property.rules())
    }

    fn save_one(&mut self, property: Property) {
        let Some(value) = self.read(property) else { return };
        if property == Property::P
            && self.knows_position()
            && property.rules().admits(value)
            && let Ok(position) = i32::try_from(value)
        {
            self.store.save_position(position, self.board.halls() & 7);
            self.trusted_at = Some(self.commutator.count());
            return;
        }
        // It takes nothing that is out of range, which is not worth keeping (a position far outside any joint, the ID of a
        // board that has none), and nothing that is always stored, which needs no saving.
        self.store.set(property, value);
    }

    /// Whether the position is that of a homed motor that stands: only then can it be trusted at the next start (manual 7,
    /// saveParameters: in idle).
    fn knows_position(&self) -> bool {
        self.servo.telemetry().homed && self.stands()
    }

    /// LOAD: the stored value, or the default where there is none.
    ///
    /// # Errors
    /// Not a property, not one that is stored, locked, or the position while not in idle.
    pub(super) fn load(&mut self, id: i64) -> Result<(), Refused> {
        match stored_property(Property::LOAD, id)? {
            Some(property) => {
                self.unlock(property)?;
                // What is always stored is as it is stored.
                if property.rules().stored == Stored::Always { Ok(()) } else { self.load_one(property) }
            }
            None => {
                self.load_all(false);
                // Nothing has moved since it was stored, so this only undoes a renaming.
                match self.store.trusted_position() {
                    Some((position, _)) if self.servo.telemetry().mode == Mode::Idle => {
                        self.command(Command::Position(position))
                    }
                    _ => Ok(()),
                }
            }
        }
    }

    /// DEF: the default, and no stored value any more. DEF of all leaves the locked ones and what the present position
    /// is called.
    ///
    /// # Errors
    /// As those of LOAD.
    pub(super) fn factory(&mut self, id: i64) -> Result<(), Refused> {
        match stored_property(Property::DEF, id)? {
            Some(property) => {
                self.unlock(property)?;
                // A board without straps would have no number.
                if !self.unstored(property.rules()).is_some_and(|value| property.rules().admits(value)) {
                    return Err(Refused::Range(property));
                }
                if property == Property::P {
                    self.in_idle()?;
                    self.distrust();
                }
                self.store.forget(property);
                self.load_one(property)
            }
            None => {
                self.distrust();
                self.store.forget_open();
                self.load_all(false);
                Ok(())
            }
        }
    }

    /// At the start, and LOAD of all but the position: stored or default, of locked ones too or not.
    #[inline(never)]
    pub(super) fn load_all(&mut self, locked: bool) {
        let mut config = *self.servo.config();
        // Defaults are in range, and `stored` gives nothing else.
        motion::fill(&mut config, |property| narrow(self.stored(property.rules())));
        let _ = self.servo.command(Command::Configure(config));
        let mut kept = self.kept;
        kept::fill(&mut kept, |property| {
            let rules = property.rules();
            let wanted = rules.stored == Stored::Yes && (locked || rules.access != Access::Locked);
            if wanted { narrow(self.stored(rules)) } else { None }
        });
        self.kept = kept;
        self.listen();
    }

    fn load_one(&mut self, property: Property) -> Result<(), Refused> {
        let Some(value) = self.stored(property.rules()) else { return Err(Refused::Access(property)) };
        if property == Property::P {
            self.in_idle()?;
        }
        self.put(property, value)?;
        if property == Property::P && self.trusted_at.is_none() {
            // So it is called now, wherever it is.
            self.servo.doubt_position();
        }
        Ok(())
    }

    /// The stored value, or the default if there is none in range.
    fn stored(&self, rules: &Rules) -> Option<i64> {
        self.store.get_by(rules).or_else(|| self.unstored(rules))
    }

    /// What it is where nothing is stored.
    fn unstored(&self, rules: &Rules) -> Option<i64> {
        match rules.property {
            Property::ID => Some(i64::from(self.board.straps().number())),
            Property::SN => Some(i64::from(self.board.serial_number())),
            _ => rules.default_for(self.node),
        }
    }

    /// # Errors
    /// The property is locked, and LOCK has not been opened for this one SET.
    pub(super) fn unlock(&mut self, property: Property) -> Result<(), Refused> {
        match property.rules().access {
            Access::Locked if !self.lock.take() => Err(Refused::Access(property)),
            Access::Locked | Access::ReadWrite | Access::WriteOnly | Access::ReadOnly => Ok(()),
        }
    }

    /// P has another meaning elsewhere.
    fn in_idle(&self) -> Result<(), Refused> {
        match self.servo.telemetry().mode {
            Mode::Idle => Ok(()),
            mode => Err(Refused::Servo(Refusal::Mode(mode))),
        }
    }

    /// Consumes the stored position's mark. If the flash does not take it, the motor must not move: the next start
    /// would trust a position that is not true any more.
    pub(super) fn distrust(&mut self) {
        if self.trusted_at.is_none() {
            return;
        }
        match self.store.distrust(self.board.flash()) {
            Ok(()) => self.trusted_at = None,
            Err(_) => {
                self.storage_error = true;
                self.drive = OFF;
                let _ = self.servo.command(Command::Terminate);
            }
        }
    }
}

/// The property that SAVE, LOAD or DEF names, one that is stored; `None` for all.
fn stored_property(by: Property, id: i64) -> Result<Option<Property>, Refused> {
    if id == ALL {
        return Ok(None);
    }
    let property = u8::try_from(id).ok().and_then(Property::of).ok_or(Refused::Range(by))?;
    if property.rules().stored == Stored::No { Err(Refused::Access(property)) } else { Ok(Some(property)) }
}

/// A value of a property that is stored.
fn narrow(value: Option<i64>) -> Option<i32> {
    value.and_then(|value| i32::try_from(value).ok())
}
