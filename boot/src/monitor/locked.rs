//! The monitor's ROLE, SN and ID, which change only after LOCK's sequence, once.

use crate::identity::Identifying;
use crate::lock::Lock;
use crate::storage::Store;
use tater_wire::property::Rules;

#[derive(Debug)]
pub(super) struct Locked {
    own: [Identifying; 3],
    /// Must see every SET that the board receives.
    pub(super) lock: Lock,
}

impl Locked {
    pub(super) fn new(own: [Identifying; 3]) -> Self {
        Self { own, lock: Lock::default() }
    }

    fn find(&mut self, id: u8) -> Option<&mut Identifying> {
        self.own.iter_mut().find(|own| own.rules.property.id() == id)
    }

    pub(super) fn get(&self, id: u8) -> Option<(&'static Rules, i32)> {
        self.own.iter().find(|own| own.rules.property.id() == id).map(|own| (own.rules, own.value))
    }

    /// Consumes an open lock if the property is one of the three.
    fn unlock(&mut self, id: u8) -> Option<&mut Identifying> {
        self.find(id)?;
        if self.lock.take() { self.find(id) } else { None }
    }

    /// SET of one of the three: ignored if locked or out of range.
    pub(super) fn set(&mut self, id: u8, value: i32) {
        if let Some(own) = self.unlock(id)
            && own.rules.admits_word(value)
        {
            own.value = value;
        }
    }

    /// SET of SAVE: stores the property of this number, or all for −1.
    pub(super) fn save(&self, store: &mut Store, number: i32) {
        for own in &self.own {
            let of_all = number == -1 && own.is_saved(store);
            if of_all || number == i32::from(own.rules.property.id()) {
                // The store ignores what is out of range: the ID 0 of a board that nobody has named.
                store.set_by(own.rules, own.value);
            }
        }
    }

    /// SET of LOAD: the stored value, or the default, if unlocked. −1 leaves locked properties alone, and there are no others.
    pub(super) fn load(&mut self, store: &Store, number: i32) {
        if let Ok(id) = u8::try_from(number)
            && let Some(own) = self.unlock(id)
        {
            own.restore(store);
        }
    }
}
