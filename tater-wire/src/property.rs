//! Every property of a Tater, once: number, name, width, access, storage, unit, range, defaults, meaning.
//! Range checks, storage, refusals and documents all come from the row.
//!
//! Numbers below 109 are Barrett's, for motor firmware from 175 on; 109 and up are this project's.

mod table;

pub use table::{Property, ROWS};

use crate::id::Node;
use crate::value::Value;
use core::ops::Deref;

/// What a host may do with a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// GET only.
    ReadOnly,
    /// GET and SET.
    ReadWrite,
    /// SET only.
    WriteOnly,
    /// GET; SET once after the sequence of LOCK.
    Locked,
}

/// Whether a value is nonvolatile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stored {
    /// No.
    No,
    /// By SAVE.
    Yes,
    /// By itself, as it changes.
    Always,
}

/// The default of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Default {
    /// Measured, or write-only.
    None,
    /// The same on every board.
    Same(i16),
    /// For links (nodes 1 to 3), the spread (4) and tips (5 to 7).
    Kinds(i16, i16, i16),
    /// The node's number.
    Node,
    /// The node's slot in packed torques: 1 to 4 for nodes 1 to 4, 1 to 3 for nodes 5 to 7.
    Slot,
}

/// The kind of joint that a motor drives; it decides the defaults. By node: 1 to 3 are links, 4 is the
/// spread, 5 to 7 are tips, and a node beyond the hand's seven has a link's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MotorKind {
    /// Inner joint of a finger.
    Link,
    /// Finger spread.
    Spread,
    /// Outer joint of a finger.
    Tip,
}

impl MotorKind {
    /// The kind of a node's motor.
    #[must_use]
    pub const fn of(node: Node) -> Self {
        match node.number() {
            4 => Self::Spread,
            5..=7 => Self::Tip,
            _ => Self::Link,
        }
    }
}

/// A property's row: the texts for people, and by [`Deref`] its [`Rules`].
#[derive(Clone, Copy, Debug)]
pub struct PropertySpec {
    /// Its name, as in the manual.
    pub name: &'static str,
    /// The part that a board enforces.
    pub rules: &'static Rules,
    /// Unit, or "-".
    pub unit: &'static str,
    /// Smallest value.
    pub min: i64,
    /// Largest value.
    pub max: i64,
    /// Its meaning.
    pub meaning: &'static str,
}

impl Deref for PropertySpec {
    type Target = Rules;

    fn deref(&self) -> &Rules {
        self.rules
    }
}

/// The part of a property's row that a board enforces: without the texts, for which a board has no room. A
/// program that names properties only as constants links only their rules: [`Property::rules`] of a variable,
/// and [`Property::of`], link those of all.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    /// The property.
    pub property: Property,
    /// Width on the wire, 16 or 32 bits.
    pub bits: u8,
    /// What a host may do with it.
    pub access: Access,
    /// Whether it is nonvolatile.
    pub stored: Stored,
    /// The default.
    pub default: Default,
    min: i32,
    max: u32,
}

impl Rules {
    /// Smallest value.
    #[must_use]
    pub const fn min(&self) -> i64 {
        self.min as i64
    }

    /// Largest value.
    #[must_use]
    pub const fn max(&self) -> i64 {
        self.max as i64
    }

    /// Whether a value is in range.
    #[must_use]
    pub const fn admits(&self, value: i64) -> bool {
        self.min() <= value && value <= self.max()
    }

    /// The default for a kind of motor; `None` if there is none, or if it depends on the node.
    #[must_use]
    pub const fn default_for_motor(&self, motor: MotorKind) -> Option<i16> {
        match self.default {
            Default::Same(value) => Some(value),
            Default::Kinds(link, spread, tip) => Some(match motor {
                MotorKind::Link => link,
                MotorKind::Spread => spread,
                MotorKind::Tip => tip,
            }),
            Default::None | Default::Node | Default::Slot => None,
        }
    }

    /// The default on a node's board; `None` if there is none.
    #[must_use]
    pub fn default_for(&self, node: Node) -> Option<i64> {
        let number = node.number();
        match self.default {
            // A board beyond the hand's seven still has a slot and a joint.
            Default::Node => Some(i64::from(number).max(self.min()).min(self.max())),
            Default::Slot => Some(i64::from(match number {
                0 => 1,
                1..=4 => number,
                _ => (number - 5) % 4 + 1,
            })),
            Default::None | Default::Same(_) | Default::Kinds(..) => {
                self.default_for_motor(MotorKind::of(node)).map(i64::from)
            }
        }
    }

    /// A value on the wire: in the property's width, or 32 bits if it does not fit signed 16; `None` if it
    /// does not fit 32.
    #[must_use]
    pub fn write(&self, value: i64) -> Option<Value> {
        match i16::try_from(value) {
            Ok(short) if self.bits == 16 => Some(Value::Short(short.cast_unsigned())),
            _ if i64::from(i32::MIN) <= value && value <= i64::from(u32::MAX) => {
                Some(Value::Long(value as u32))
            }
            _ => None,
        }
    }

    /// Whether its values are unsigned on the wire.
    #[must_use]
    const fn unsigned(&self) -> bool {
        self.min >= 0 && self.max > if self.bits == 16 { i16::MAX as u32 } else { i32::MAX as u32 }
    }
}

impl Property {
    /// The property of a name, case-insensitive.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        ROWS.iter().find(|row| row.name.eq_ignore_ascii_case(name)).map(|row| row.property)
    }

    /// The property's value from the wire: signed, unless its row is unsigned.
    #[must_use]
    pub fn read(self, value: Value) -> i64 {
        let unsigned = self.rules().unsigned();
        match value {
            Value::Short(bits) if unsigned => i64::from(bits),
            Value::Short(bits) => i64::from(bits.cast_signed()),
            Value::Long(bits) if unsigned => i64::from(bits),
            Value::Long(bits) => i64::from(bits.cast_signed()),
        }
    }

    /// A value on the wire: see [`Rules::write`].
    #[must_use]
    pub fn write(self, value: i64) -> Option<Value> {
        self.rules().write(value)
    }

    /// Whether SAVE stores the property of a number; `false` if it does not exist.
    #[must_use]
    pub fn is_stored(id: u8) -> bool {
        // One bit per number, which is smaller than all rules.
        const STORED: &[u8; 16] = &{
            let (mut bits, mut rest) = (0_u128, Property::ALL);
            while let [property, others @ ..] = rest {
                if matches!(property.rules().stored, Stored::Yes) {
                    bits |= 1 << property.id();
                }
                rest = others;
            }
            bits.to_le_bytes()
        };
        STORED.get(usize::from(id / 8)).is_some_and(|byte| byte >> (id % 8) & 1 != 0)
    }
}

#[cfg(test)]
mod tests;
