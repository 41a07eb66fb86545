//! What identifies a board: ROLE, SN and ID, the kind of its motor, and the groups that it listens to. Monitor and application read them here.
//!
//! The stored value counts; where none is stored, straps give ID and the kind of motor, and the chip gives SN.

use crate::chip::Chip;
use crate::storage::Store;
use tater_wire::property::{Default, Rules};
use tater_wire::{Group, MotorKind, Node, Property};

/// One of the properties that identify a board. A SET of it takes LOCK's sequence.
#[derive(Debug)]
pub struct Identifying {
    /// ROLE, SN or ID.
    pub rules: &'static Rules,
    /// Its value now.
    pub value: i32,
    /// The value if none is stored. The ID of a board without straps is 0, which is out of its range.
    pub default: i32,
}

impl Identifying {
    /// ROLE, SN and ID of a board.
    pub fn all<B: Chip>(board: &B, store: &Store) -> [Self; 3] {
        let role = match Property::ROLE.rules().default {
            Default::Same(role) => i32::from(role),
            _ => 0,
        };
        let defaults = [
            (Property::ROLE.rules(), role),
            (Property::SN.rules(), i32::from(board.serial_number())),
            (Property::ID.rules(), i32::from(board.straps().number())),
        ];
        defaults.map(|(rules, default)| {
            let mut own = Self { rules, value: default, default };
            own.restore(store);
            own
        })
    }

    /// The stored value, or the default.
    pub fn restore(&mut self, store: &Store) {
        self.value = store.get_by(self.rules).unwrap_or(self.default);
    }

    /// Whether a SAVE of all stores the value. One that nobody has set stays the straps' or the chip's.
    #[must_use]
    pub fn is_saved(&self, store: &Store) -> bool {
        self.value != self.default || store.get_by(self.rules).is_some()
    }
}

/// [`Node::HOST`] for a board with neither an ID nor straps.
#[must_use]
pub fn node([_, _, id]: &[Identifying; 3]) -> Node {
    u8::try_from(id.value).ok().and_then(Node::new).unwrap_or(Node::HOST)
}

/// The kind of the board's motor if none is stored: straps tell it of a board whose ID is another (decision 0058).
pub fn default_kind<B: Chip>(board: &B, node: Node) -> MotorKind {
    match board.straps() {
        Node::HOST => MotorKind::of(node),
        straps => MotorKind::of(straps),
    }
}

/// The kind of the board's motor.
pub fn kind<B: Chip>(board: &B, store: &Store, node: Node) -> MotorKind {
    let stored = store.get_by(Property::KIND.rules()).map(i64::from).and_then(MotorKind::from_code);
    stored.unwrap_or_else(|| default_kind(board, node))
}

/// `None` if boards may not listen to the group.
#[must_use]
pub fn group(number: i32) -> Option<Group> {
    Group::new(u8::try_from(number).ok()?).filter(|group| group.is_for_boards())
}
