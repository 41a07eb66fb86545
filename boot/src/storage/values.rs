//! Values by property number.

use super::numbers::Numbers;

/// All numbers on the wire.
pub const NUMBERS: usize = 128;

/// Indexed by number: a lookup takes the same few instructions for each, because a SAVE of all does it for
/// each while hall edges wait.
#[derive(Debug)]
pub struct Values {
    values: [i32; NUMBERS],
    numbers: Numbers,
}

impl Values {
    pub const fn new() -> Self {
        Self { values: [0; NUMBERS], numbers: Numbers::NONE }
    }

    pub const fn clear(&mut self) {
        self.numbers = Numbers::NONE;
    }

    pub fn get(&self, number: u8) -> Option<i32> {
        self.values.get(usize::from(number)).filter(|_| self.numbers.contains(number)).copied()
    }

    /// Ignores numbers above 127.
    pub fn insert(&mut self, number: u8, value: i32) {
        if let Some(place) = self.values.get_mut(usize::from(number)) {
            *place = value;
            self.numbers.insert(number);
        }
    }

    pub fn remove(&mut self, number: u8) {
        self.numbers.remove(number);
    }

    /// Returns those that had a value.
    pub fn forget(&mut self, numbers: Numbers) -> Numbers {
        let forgotten = self.numbers.both(numbers);
        self.numbers = self.numbers.without(numbers);
        forgotten
    }

    pub const fn numbers(&self) -> Numbers {
        self.numbers
    }
}
