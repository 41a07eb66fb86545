//! Property LOCK: five numbers in sequence unlock one SET of a locked property.

/// The sequence (property table).
const KEYS: [i64; 5] = [18384, 23, 3145, 1024, 1];

/// The sequence as far as it has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lock {
    /// Correct numbers in a row; open when all five are.
    right: usize,
}

impl Lock {
    /// A wrong number restarts the sequence, and counts if it is its first number; so does any number once the lock is open.
    pub fn key(&mut self, value: i64) {
        self.right = match KEYS.get(self.right) {
            Some(&key) if key == value => self.right.saturating_add(1),
            _ => usize::from(KEYS.first() == Some(&value)),
        };
    }

    /// A SET of another property: restarts the sequence; an open lock stays open.
    pub const fn interrupt(&mut self) {
        if self.right < KEYS.len() {
            self.right = 0;
        }
    }

    /// Whether the lock is open; closes it.
    pub const fn take(&mut self) -> bool {
        let open = self.right == KEYS.len();
        self.right = 0;
        open
    }
}
