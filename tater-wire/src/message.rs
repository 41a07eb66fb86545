//! What a frame means. Parsing never panics, and `Message::parse` of `Message::frame` is the same message.
//!
//! Formats (Barrett's host software): GET `[id, ...]`, of which hosts send 1 to 8 bytes; SET and its reply `[0x80|id, 0, v0, v1(, v2, v3)]`, little-endian;
//! a position to the host `[0x80 | bits 21..16, 15..8, 7..0]`; packed torques `[0x80|42, ...]`, 14 bits each, most
//! significant bit first, which to group 5 have the length that no SET has. Our own: `[0, n, o0, o1, o2]` to the host asks for more of a download, and a board
//! whose first request has that form takes up to eight characters a frame.

use crate::frame::Frame;
use crate::id::{Destination, Group, Identifier, Node};
use crate::property::barrett::{BARRETTS, WIDE};
use crate::property::{Property, Rules};
use crate::value::Value;

/// Bit 7 of the first byte: a value follows.
const SET: u8 = 0x80;

/// Number of VALUE, in the answer to a GET by another board. It is no property of a Tater; Barrett's boards
/// access raw memory with it.
pub const VALUE: u8 = 7;

/// Torque slots in a packed frame.
pub const SLOTS: usize = 4;

/// The meaning of a frame, with sender and destination.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Message {
    /// The sender.
    pub from: Node,
    /// The destination.
    pub to: Destination,
    /// The content.
    pub body: Body,
}

/// The content of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Body {
    /// Requests a property, 0..=127; in a download the same frame carries a character.
    Get(u8),
    /// Sets a property, or answers a GET (to group 6, or to the node that sent it).
    Set {
        /// Number of the property, 0..=127, known or not.
        property: u8,
        /// Its value.
        value: Value,
    },
    /// A position to the host: 22 bits, −2^21..2^21 counts.
    Position(i32),
    /// Torques for the slots of group 1, 2 or 5.
    Torques(Torques),
    /// Extension: a monitor requests the next characters of a download from the host, node 0.
    More {
        /// Number of frames of up to eight characters that the host may send now.
        frames: u8,
        /// Characters received so far (24 bits): the offset to continue from.
        received: u32,
    },
}

/// One to four packed torques, ±8191 (14 bits; −8192 parses too).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Torques {
    len: u8,
    torques: [i16; SLOTS],
}

impl Torques {
    /// `None` unless there are one to four; values beyond ±8191 saturate, as in hosts.
    #[must_use]
    pub fn new(torques: &[i16]) -> Option<Self> {
        let mut all = [0; SLOTS];
        for (to, from) in all.get_mut(..torques.len())?.iter_mut().zip(torques) {
            *to = (*from).clamp(-8191, 8191);
        }
        let len = u8::try_from(torques.len()).ok().filter(|&len| len > 0)?;
        Some(Self { len, torques: all })
    }

    /// The torque of a slot, 1..=4 (property PIDX).
    #[must_use]
    pub fn slot(&self, slot: u8) -> Option<i16> {
        let index = usize::from(slot.checked_sub(1)?);
        self.torques.get(..usize::from(self.len))?.get(index).copied()
    }

    /// Parses the bytes after the first: as many slots as have all 14 bits.
    fn parse(bytes: &[u8]) -> Option<Self> {
        let mut bits = 0u64;
        for byte in bytes.iter().chain(core::iter::repeat(&0)).take(7) {
            bits = bits << 8 | u64::from(*byte);
        }
        let len = (bytes.len() * 8 / 14).min(SLOTS);
        let mut torques = [0; SLOTS];
        for (slot, torque) in torques.iter_mut().enumerate().rev() {
            if slot < len {
                // Move 14 bits to the top of 16, and back with the sign.
                *torque = (((bits & 0x3FFF) << 2) as u16).cast_signed() >> 2;
            }
            bits >>= 14;
        }
        u8::try_from(len).ok().filter(|&len| len > 0).map(|len| Self { len, torques })
    }

    fn bytes(&self) -> ([u8; 8], usize) {
        let mut bits = 0u64;
        for torque in self.torques {
            bits = bits << 14 | u64::from(torque.cast_unsigned() & 0x3FFF);
        }
        let mut bytes = (bits & 0x00FF_FFFF_FFFF_FFFF).to_be_bytes();
        bytes[0] = SET | Property::T.id();
        // 1 + 2n bytes hold 14·n bits for n < 4; four torques are exactly 7 bytes.
        (bytes, (1 + 2 * usize::from(self.len)).min(8))
    }
}

impl Message {
    /// Parses a frame; `None` if it is not valid, and then nobody answers it.
    #[must_use]
    pub fn parse(frame: &Frame) -> Option<Self> {
        let Identifier { from, to } = frame.id();
        let to_group = |group| to == Destination::Group(group);
        let body = match *frame.data() {
            [high, middle, low] if to_group(Group::POSITIONS) && high & 0xC0 == SET => {
                let bits = u32::from(high & 0x3F) << 16 | u32::from(middle) << 8 | u32::from(low);
                Body::Position((bits << 10).cast_signed() >> 10)
            }
            [id, ref packed @ ..]
                if id == SET | Property::T.id()
                    && (to_group(Group::LOW)
                        || to_group(Group::HIGH)
                        || to_group(Group::HAND) && !matches!(packed.len(), 3 | 5)) =>
            {
                Body::Torques(Torques::parse(packed)?)
            }
            // To a board the same bytes are a GET of VERS.
            [0, frames, a, b, c] if to == Destination::Node(Node::HOST) => {
                Body::More { frames, received: u32::from_le_bytes([a, b, c, 0]) }
            }
            // A host for the BH8-282 sends two bytes. What follows the number means nothing.
            [id, ..] if id & SET == 0 => Body::Get(id),
            [id, 0, a, b] if id & SET != 0 => {
                Body::Set { property: id & !SET, value: Value::Short(u16::from_le_bytes([a, b])) }
            }
            [id, 0, a, b, c, d] if id & SET != 0 => {
                Body::Set { property: id & !SET, value: Value::Long(u32::from_le_bytes([a, b, c, d])) }
            }
            _ => return None,
        };
        Some(Self { from, to, body })
    }

    /// The frame of this message. Bits beyond a number's 7, a position's 22 and `received`'s 24 are dropped.
    #[must_use]
    pub fn frame(&self) -> Frame {
        let id = Identifier { from: self.from, to: self.to };
        let (bytes, len) = match self.body {
            Body::Get(property) => ([property & !SET, 0, 0, 0, 0, 0, 0, 0], 1),
            Body::Set { property, value } => {
                let property = SET | property;
                match value {
                    Value::Short(bits) => {
                        let [a, b] = bits.to_le_bytes();
                        ([property, 0, a, b, 0, 0, 0, 0], 4)
                    }
                    Value::Long(bits) => {
                        let [a, b, c, d] = bits.to_le_bytes();
                        ([property, 0, a, b, c, d, 0, 0], 6)
                    }
                }
            }
            Body::Position(counts) => {
                let [_, high, middle, low] = counts.to_be_bytes();
                ([SET | high & 0x3F, middle, low, 0, 0, 0, 0, 0], 3)
            }
            Body::Torques(torques) => torques.bytes(),
            Body::More { frames, received } => {
                let [a, b, c, _] = received.to_le_bytes();
                ([0, frames, a, b, c, 0, 0, 0], 5)
            }
        };
        // `len` is at most 8 by the arms above, so the frame exists.
        Frame::new(id, bytes.get(..len).unwrap_or(&[])).unwrap_or(Frame::EMPTY)
    }

    /// A host's GET.
    #[must_use]
    pub const fn get(to: Destination, property: Property) -> Self {
        Self { from: Node::HOST, to, body: Body::Get(property.id()) }
    }

    /// A host's SET, in the width of the property; `None` if the value does not fit 32 bits.
    #[must_use]
    pub fn set(to: Destination, property: Property, value: i64) -> Option<Self> {
        let value = property.write(value)?;
        Some(Self { from: Node::HOST, to, body: Body::Set { property: property.id(), value } })
    }

    /// A board's answer to a GET of node `to`: the host gets a reply, another board a SET of VALUE. `None` if the value does
    /// not fit 32 bits.
    #[must_use]
    pub fn answer(from: Node, to: Node, of: &Rules, value: i64) -> Option<Self> {
        if to == Node::HOST && of.property == Property::P {
            let to = Destination::Group(Group::POSITIONS);
            return Some(Self { from, to, body: Body::Position(i32::try_from(value).ok()?) });
        }
        Some(Self::answer_number(from, to, of.property.id(), of.write(value)?))
    }

    /// A board's answer to a GET of a number of Barrett's table that no property here has: 0 in Barrett's width. `None` beyond that
    /// table, where nobody answers.
    #[must_use]
    pub fn absent(from: Node, to: Node, number: u8) -> Option<Self> {
        let value = if WIDE.contains(&number) { Value::Long(0) } else { Value::Short(0) };
        (number < BARRETTS).then(|| Self::answer_number(from, to, number, value))
    }

    const fn answer_number(from: Node, to: Node, number: u8, value: Value) -> Self {
        let (to, property) = match to {
            Node::HOST => (Destination::Group(Group::REPLIES), number),
            node => (Destination::Node(node), VALUE),
        };
        Self { from, to, body: Body::Set { property, value } }
    }

    /// The board, the property and its value, if this is a board's answer to a GET of the host; [`None`] as the value where the property's
    /// row has another range or another width: the frame was damaged on the way.
    #[must_use]
    pub fn answered(&self) -> Option<(Node, Property, Option<i64>)> {
        match self.body {
            // 22 bits, beyond what can be set.
            Body::Position(counts) if self.to == Destination::Group(Group::POSITIONS) => {
                Some((self.from, Property::P, Some(i64::from(counts))))
            }
            Body::Set { property, value: sent } if self.to == Destination::Group(Group::REPLIES) => {
                let property = Property::of(property)?;
                let (rules, value) = (property.find_rules(), property.read(sent));
                let is_admitted = match property {
                    // Of any firmware.
                    Property::VERS => true,
                    // A board has none of its own until it is set.
                    Property::ID => value == 0 || rules.admits(value),
                    // Positions have a frame of their own.
                    Property::P => false,
                    _ => rules.admits(value),
                };
                // A board sends what its row's `write` makes.
                let is_whole = is_admitted && rules.write(value) == Some(sent);
                Some((self.from, property, is_whole.then_some(value)))
            }
            _ => None,
        }
    }

    /// A board's answer to the host: positions to group 3, everything else to group 6. `None` if the value
    /// does not fit 32 bits.
    #[must_use]
    pub fn reply(from: Node, property: Property, value: i64) -> Option<Self> {
        Self::answer(from, Node::HOST, property.find_rules(), value)
    }
}

#[cfg(test)]
mod tests;
