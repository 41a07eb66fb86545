//! Who the board is: the properties ROLE, SN and ID, which change only after the sequence of LOCK, once.

use crate::storage::Store;
use tater_wire::property::Default;
use tater_wire::{Node, Property};

/// The properties.
const PROPERTIES: [Property; 3] = [Property::ROLE, Property::SN, Property::ID];

/// Values of LOCK that unlock, in this order.
const SEQUENCE: [i64; 5] = [18384, 23, 3145, 1024, 1];

/// ROLE, SN and ID as they are now, and how far the sequence has come.
#[derive(Debug)]
pub(super) struct Identity {
    values: [i64; PROPERTIES.len()],
    defaults: [i64; PROPERTIES.len()],
    /// Values of the sequence that came; all of them: unlocked.
    unlocked: usize,
}

impl Identity {
    /// From storage, or by default: SN is then the chip's, ID the straps'.
    pub(super) fn new(store: &Store, straps: Node, serial_number: u16) -> Self {
        let role = match Property::ROLE.spec().default {
            Default::Same(role) => i64::from(role),
            _ => 0,
        };
        let defaults = [role, i64::from(serial_number), i64::from(straps.number())];
        let mut identity = Self { values: defaults, defaults, unlocked: 0 };
        identity.load(store, -1);
        identity
    }

    fn slot(&mut self, id: u8) -> Option<(&mut i64, Property)> {
        self.values.iter_mut().zip(PROPERTIES).find(|(_, property)| property.id() == id)
    }

    /// The value of one of the three properties; `None` for another.
    pub(super) fn get(&self, id: u8) -> Option<i64> {
        self.values.iter().zip(PROPERTIES).find(|(_, property)| property.id() == id).map(|(value, _)| *value)
    }

    /// A SET of LOCK.
    pub(super) fn unlock(&mut self, value: i64) {
        self.unlocked = match SEQUENCE.get(self.unlocked) {
            Some(&next) if next == value => self.unlocked.saturating_add(1),
            _ => usize::from(SEQUENCE.first() == Some(&value)),
        };
    }

    /// A SET of one of the three properties: taken only if unlocked and in range; locks again in any case.
    pub(super) fn set(&mut self, id: u8, value: i64) {
        let unlocked = self.unlocked == SEQUENCE.len();
        let Some((slot, property)) = self.slot(id) else { return };
        if unlocked && property.spec().admits(value) {
            *slot = value;
        }
        self.unlocked = 0;
    }

    /// A SET of SAVE: the present value of the property of this number, or of all for −1, is to be stored.
    pub(super) fn save(&self, store: &mut Store, number: i64) {
        for (value, property) in self.values.iter().zip(PROPERTIES).filter(|&(_, one)| is_meant(one, number))
        {
            // A board without straps that nobody has named has no ID to store: that is out of range, and not taken.
            store.set(property, *value);
        }
    }

    /// A SET of LOAD: back to the stored value, or the default, of the property of this number, or of all for −1.
    pub(super) fn load(&mut self, store: &Store, number: i64) {
        let rows = self.values.iter_mut().zip(self.defaults).zip(PROPERTIES);
        for ((value, default), property) in rows.filter(|&(_, one)| is_meant(one, number)) {
            *value = store.get(property).unwrap_or(default);
        }
    }
}

fn is_meant(property: Property, number: i64) -> bool {
    number == -1 || number == i64::from(property.id())
}
