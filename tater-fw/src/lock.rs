//! Property LOCK: five numbers in a row open the way for one SET of a locked property.

/// The numbers, in this order (property table).
const KEYS: [i64; 5] = [18384, 23, 3145, 1024, 1];

/// How far the lock has been opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lock {
    /// Right numbers in a row; all of them: open.
    right: usize,
}

impl Lock {
    /// A SET of LOCK. A wrong number begins anew, as the first one does if it is the first; so does any number once
    /// the lock is open.
    pub fn key(&mut self, value: i64) {
        self.right = match KEYS.get(self.right) {
            Some(&key) if key == value => self.right.saturating_add(1),
            _ => usize::from(KEYS.first() == Some(&value)),
        };
    }

    /// A SET of anything else: the sequence begins anew, an open lock stays open.
    pub const fn interrupt(&mut self) {
        if self.right < KEYS.len() {
            self.right = 0;
        }
    }

    /// Whether a locked property may be set, this once.
    pub const fn take(&mut self) -> bool {
        let open = self.right == KEYS.len();
        self.right = 0;
        open
    }
}
