//! Who the board is: the properties ROLE, SN and ID, which change only after the sequence of LOCK, once.

use crate::lock::Lock;
use crate::storage::Store;
use tater_wire::property::Default;
use tater_wire::{Node, Property};

/// The properties.
const PROPERTIES: [Property; 3] = [Property::ROLE, Property::SN, Property::ID];

/// ROLE, SN and ID as they are now, and how far the lock before them has been opened.
#[derive(Debug)]
pub(super) struct Identity {
    values: [i64; PROPERTIES.len()],
    defaults: [i64; PROPERTIES.len()],
    /// Told of every SET that the board hears.
    pub(super) lock: Lock,
}

impl Identity {
    /// From storage, or by default: SN is then the chip's, ID the straps'.
    pub(super) fn new(store: &Store, straps: Node, serial_number: u16) -> Self {
        let role = match Property::ROLE.spec().default {
            Default::Same(role) => i64::from(role),
            _ => 0,
        };
        let defaults = [role, i64::from(serial_number), i64::from(straps.number())];
        let mut identity = Self { values: defaults, defaults, lock: Lock::default() };
        for property in PROPERTIES {
            identity.restore(store, property.id());
        }
        identity
    }

    fn slot(&mut self, id: u8) -> Option<(&mut i64, Property)> {
        self.values.iter_mut().zip(PROPERTIES).find(|(_, property)| property.id() == id)
    }

    /// The value of one of the three properties; `None` for another.
    pub(super) fn get(&self, id: u8) -> Option<i64> {
        self.values.iter().zip(PROPERTIES).find(|(_, property)| property.id() == id).map(|(value, _)| *value)
    }

    /// A SET of one of the three properties: taken only if unlocked and in range; locks again in any case.
    pub(super) fn set(&mut self, id: u8, value: i64) {
        if self.get(id).is_some()
            && self.lock.take()
            && let Some((slot, property)) = self.slot(id)
            && property.spec().admits(value)
        {
            *slot = value;
        }
    }

    /// A SET of SAVE: the present value of the property of this number, or of all for −1, is to be stored.
    pub(super) fn save(&self, store: &mut Store, number: i64) {
        let rows = self.values.iter().zip(self.defaults).zip(PROPERTIES);
        for ((&value, default), property) in rows {
            // Of all: what nobody has set stays the straps' and the chip's.
            let of_all = number == -1 && (value != default || store.get(property).is_some());
            // A board without straps that nobody has named has no ID to store: that is out of range, and not taken.
            if of_all || number == i64::from(property.id()) {
                store.set(property, value);
            }
        }
    }

    /// A SET of LOAD: back to the stored value, or the default, of the property of this number, only if unlocked; locks
    /// again in any case. −1 leaves the locked ones, as in the application; here that is all.
    pub(super) fn load(&mut self, store: &Store, number: i64) {
        if let Ok(id) = u8::try_from(number)
            && self.get(id).is_some()
            && self.lock.take()
        {
            self.restore(store, id);
        }
    }

    /// Takes the stored value, or the default.
    fn restore(&mut self, store: &Store, id: u8) {
        let rows = self.values.iter_mut().zip(self.defaults).zip(PROPERTIES);
        for ((value, default), property) in rows.filter(|(_, property)| property.id() == id) {
            *value = store.get(property).unwrap_or(default);
        }
    }
}
