//! Sender and destination: an 11-bit CAN identifier is `G FFFFF TTTTT`, a group flag, the sender's node and
//! the destination's node or group. The lower identifier wins the bus, so the host (node 0) goes before the
//! boards.

/// A node of the bus, 0..=31: 0 is the host (or GOD in its place), Taters are 1 to 7, or 11 to 17 beside an arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Node(u8);

impl Node {
    /// The host, or GOD in its place.
    pub const HOST: Self = Self(0);

    /// `None` above 31.
    #[must_use]
    pub const fn new(number: u8) -> Option<Self> {
        if number < 32 { Some(Self(number)) } else { None }
    }

    /// 0..=31.
    #[must_use]
    pub const fn number(self) -> u8 {
        self.0
    }
}

/// A group of the bus, 0..=31.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Group(u8);

impl Group {
    /// To every board.
    pub const ALL: Self = Self(0);
    /// To boards 1 to 4; packed torques.
    pub const LOW: Self = Self(1);
    /// To boards 5 to 7; packed torques.
    pub const HIGH: Self = Self(2);
    /// To the host: 22-bit positions.
    pub const POSITIONS: Self = Self(3);
    /// To all seven Taters.
    pub const TATERS: Self = Self(4);
    /// To the boards of a hand on an arm (decision 0058); packed torques.
    pub const HAND: Self = Self(5);
    /// To the host: every other reply.
    pub const REPLIES: Self = Self(6);

    /// `None` above 31.
    #[must_use]
    pub const fn new(number: u8) -> Option<Self> {
        if number < 32 { Some(Self(number)) } else { None }
    }

    /// 0..=31.
    #[must_use]
    pub const fn number(self) -> u8 {
        self.0
    }

    /// Whether boards may receive it: not groups 3 and 6, whose replies look like a SET (decision 0015).
    #[must_use]
    pub const fn is_for_boards(self) -> bool {
        !matches!(self, Self::POSITIONS | Self::REPLIES)
    }
}

/// The destination of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Destination {
    /// One node.
    Node(Node),
    /// All nodes that receive the group.
    Group(Group),
}

/// A decoded 11-bit CAN identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Identifier {
    /// The sender.
    pub from: Node,
    /// The destination.
    pub to: Destination,
}

/// Bit 10: the destination is a group.
const GROUP: u16 = 0x400;

impl Identifier {
    /// From the 11 bits on the bus; `None` above 0x7FF.
    #[must_use]
    pub const fn from_raw(raw: u16) -> Option<Self> {
        if raw > 0x7FF {
            return None;
        }
        let low = (raw & 31) as u8;
        let from = Node((raw >> 5 & 31) as u8);
        let to = if raw & GROUP == 0 { Destination::Node(Node(low)) } else { Destination::Group(Group(low)) };
        Some(Self { from, to })
    }

    /// The 11 bits on the bus.
    #[must_use]
    pub const fn raw(self) -> u16 {
        let to = match self.to {
            Destination::Node(node) => node.0 as u16,
            Destination::Group(group) => GROUP | group.0 as u16,
        };
        (self.from.0 as u16) << 5 | to
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_2048_identifiers_round_trip() {
        for raw in 0..0x800 {
            assert_eq!(Identifier::from_raw(raw).map(Identifier::raw), Some(raw));
        }
        assert_eq!(Identifier::from_raw(0x800), None);
    }

    #[test]
    fn groups_are_for_boards_except_those_of_replies() {
        for number in 0..32 {
            let group = Group::new(number).expect("a group");
            assert_eq!((group.number(), group.is_for_boards()), (number, number != 3 && number != 6));
        }
        assert_eq!(Group::new(32), None);
    }

    #[test]
    fn reply_identifiers_match_published_hosts() {
        let node = Node::new(3).expect("3 is a node");
        let reply = |group| Identifier { from: node, to: Destination::Group(group) }.raw();
        assert_eq!(reply(Group::REPLIES), 0x406 | 3 << 5);
        assert_eq!(reply(Group::POSITIONS), 0x403 | 3 << 5);
        let request = Identifier { from: node, to: Destination::Node(Node::HOST) };
        assert_eq!(request.raw(), 3 << 5);
    }
}
