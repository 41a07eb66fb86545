//! Who the board is: the properties ROLE, SN and ID, which change only after the sequence of LOCK, once.

use crate::lock::Lock;
use crate::storage::Store;
use tater_wire::property::{Default, Rules};
use tater_wire::{Node, Property};

/// One of the properties.
#[derive(Debug)]
struct Own {
    rules: &'static Rules,
    /// As it is now.
    value: i64,
    default: i64,
}

impl Own {
    /// Takes the stored value, or the default.
    fn restore(&mut self, store: &Store) {
        self.value = store.get_by(self.rules).unwrap_or(self.default);
    }
}

/// ROLE, SN and ID, and how far the lock before them has been opened.
#[derive(Debug)]
pub(super) struct Identity {
    own: [Own; 3],
    /// Told of every SET that the board hears.
    pub(super) lock: Lock,
}

impl Identity {
    /// From storage, or by default: SN is then the chip's, ID the straps'.
    pub(super) fn new(store: &Store, straps: Node, serial_number: u16) -> Self {
        let role = match Property::ROLE.rules().default {
            Default::Same(role) => i64::from(role),
            _ => 0,
        };
        let own = [
            (Property::ROLE.rules(), role),
            (Property::SN.rules(), i64::from(serial_number)),
            (Property::ID.rules(), i64::from(straps.number())),
        ];
        let own = own.map(|(rules, default)| {
            let mut own = Own { rules, value: default, default };
            own.restore(store);
            own
        });
        Self { own, lock: Lock::default() }
    }

    fn find(&mut self, id: u8) -> Option<&mut Own> {
        self.own.iter_mut().find(|own| own.rules.property.id() == id)
    }

    /// One of the three properties and its value; `None` for another number.
    pub(super) fn get(&self, id: u8) -> Option<(&'static Rules, i64)> {
        self.own.iter().find(|own| own.rules.property.id() == id).map(|own| (own.rules, own.value))
    }

    /// The property, to change it, if it is one of the three, and unlocked; locks again in that case.
    fn unlock(&mut self, id: u8) -> Option<&mut Own> {
        self.find(id)?;
        if self.lock.take() { self.find(id) } else { None }
    }

    /// A SET of one of the three properties: taken only if unlocked and in range; locks again in any case.
    pub(super) fn set(&mut self, id: u8, value: i64) {
        if let Some(own) = self.unlock(id)
            && own.rules.admits(value)
        {
            own.value = value;
        }
    }

    /// A SET of SAVE: the present value of the property of this number, or of all for −1, is to be stored.
    pub(super) fn save(&self, store: &mut Store, number: i64) {
        for own in &self.own {
            // Of all: what nobody has set stays the straps' and the chip's.
            let of_all = number == -1 && (own.value != own.default || store.get_by(own.rules).is_some());
            // A board without straps that nobody has named has no ID to store: that is out of range, and not taken.
            if of_all || number == i64::from(own.rules.property.id()) {
                store.set_by(own.rules, own.value);
            }
        }
    }

    /// A SET of LOAD: back to the stored value, or the default, of the property of this number, only if unlocked; locks
    /// again in any case. −1 leaves the locked ones, as in the application; here that is all.
    pub(super) fn load(&mut self, store: &Store, number: i64) {
        if let Ok(id) = u8::try_from(number)
            && let Some(own) = self.unlock(id)
        {
            own.restore(store);
        }
    }
}
