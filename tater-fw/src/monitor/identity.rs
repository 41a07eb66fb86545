//! Who the board is: the properties ROLE, SN and ID, which change only after the sequence of LOCK, once.

use crate::lock::Lock;
use crate::storage::Store;
use tater_wire::property::{Default, Row};
use tater_wire::{Node, Property};

/// The rows. Named one by one, so that the monitor's program need not hold the table of all properties.
const ROWS: [&Row; 3] = [Property::ROLE.row(), Property::SN.row(), Property::ID.row()];

/// ROLE, SN and ID as they are now, and how far the lock before them has been opened.
#[derive(Debug)]
pub(super) struct Identity {
    values: [i64; ROWS.len()],
    defaults: [i64; ROWS.len()],
    /// Told of every SET that the board hears.
    pub(super) lock: Lock,
}

impl Identity {
    /// From storage, or by default: SN is then the chip's, ID the straps'.
    pub(super) fn new(store: &Store, straps: Node, serial_number: u16) -> Self {
        let role = match Property::ROLE.row().default {
            Default::Same(role) => i64::from(role),
            _ => 0,
        };
        let defaults = [role, i64::from(serial_number), i64::from(straps.number())];
        let mut identity = Self { values: defaults, defaults, lock: Lock::default() };
        for row in ROWS {
            identity.restore(store, row.property.id());
        }
        identity
    }

    fn slot(&mut self, id: u8) -> Option<(&mut i64, &'static Row)> {
        self.values.iter_mut().zip(ROWS).find(|(_, row)| row.property.id() == id)
    }

    /// The value of one of the three properties; `None` for another.
    pub(super) fn get(&self, id: u8) -> Option<i64> {
        self.values.iter().zip(ROWS).find(|(_, row)| row.property.id() == id).map(|(value, _)| *value)
    }

    /// A SET of one of the three properties: taken only if unlocked and in range; locks again in any case.
    pub(super) fn set(&mut self, id: u8, value: i64) {
        if self.get(id).is_some()
            && self.lock.take()
            && let Some((slot, row)) = self.slot(id)
            && row.admits(value)
        {
            *slot = value;
        }
    }

    /// A SET of SAVE: the present value of the property of this number, or of all for −1, is to be stored.
    pub(super) fn save(&self, store: &mut Store, number: i64) {
        let meant = |row: &Row| number == -1 || number == i64::from(row.property.id());
        for (value, row) in self.values.iter().zip(ROWS).filter(|(_, row)| meant(row)) {
            // A board without straps that nobody has named has no ID to store.
            if row.admits(*value) {
                store.set(row.property, *value);
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
        let rows = self.values.iter_mut().zip(self.defaults).zip(ROWS);
        for ((value, default), row) in rows.filter(|(_, row)| row.property.id() == id) {
            *value = store.get(row.property).filter(|&stored| row.admits(stored)).unwrap_or(default);
        }
    }
}
