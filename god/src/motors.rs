//! Sets of motors, and the motors that a prefix selects (manual 5.1.2, table 3).

use tater_wire::MotorKind;
use tater_wire::Node;

/// Number of motors.
pub const COUNT: usize = 7;

/// One of the seven motors, 1 to 7.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Motor(u8);

impl Motor {
    /// The spread.
    pub const SPREAD: Self = Self(4);

    /// The motor of a number, 1 to 7.
    #[must_use]
    pub const fn new(number: u8) -> Option<Self> {
        if number >= 1 && number <= 7 { Some(Self(number)) } else { None }
    }

    /// Its number, 1 to 7.
    #[must_use]
    pub const fn number(self) -> u8 {
        self.0
    }

    /// Its place in a list of seven, 0 to 6.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize - 1
    }

    /// Its board's node on the bus.
    #[must_use]
    pub const fn node(self) -> Node {
        match Node::new(self.0) {
            Some(node) => node,
            None => Node::HOST,
        }
    }

    /// Link, spread or tip.
    #[must_use]
    pub fn kind(self) -> MotorKind {
        MotorKind::of(self.node())
    }

    /// The tip of a link's finger.
    #[must_use]
    pub const fn tip(self) -> Option<Self> {
        if self.0 <= 3 { Some(Self(self.0 + 4)) } else { None }
    }

    /// The link of a tip's finger.
    #[must_use]
    pub const fn link(self) -> Option<Self> {
        if self.0 >= 5 { Some(Self(self.0 - 4)) } else { None }
    }

    const fn bit(self) -> u8 {
        1 << (self.0 - 1)
    }
}

/// A set of motors, in the order of their numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Motors(u8);

impl Motors {
    /// No motor.
    pub const NONE: Self = Self(0);
    /// All seven.
    pub const ALL: Self = Self(0b111_1111);
    /// The inner links, 1 to 3.
    pub const LINKS: Self = Self(0b000_0111);
    /// The spread, 4.
    pub const SPREAD: Self = Self(0b000_1000);
    /// The tips, 5 to 7.
    pub const TIPS: Self = Self(0b111_0000);

    /// One motor.
    #[must_use]
    pub const fn only(motor: Motor) -> Self {
        Self(motor.bit())
    }

    /// Whether it contains a motor.
    #[must_use]
    pub const fn has(self, motor: Motor) -> bool {
        self.0 & motor.bit() != 0
    }

    /// The set with one more motor.
    #[must_use]
    pub const fn with(self, motor: Motor) -> Self {
        Self(self.0 | motor.bit())
    }

    /// The set without a motor.
    #[must_use]
    pub const fn without(self, motor: Motor) -> Self {
        Self(self.0 & !motor.bit())
    }

    /// The motors in either set.
    #[must_use]
    pub const fn union(self, others: Self) -> Self {
        Self(self.0 | others.0)
    }

    /// The motors in both sets.
    #[must_use]
    pub const fn intersection(self, others: Self) -> Self {
        Self(self.0 & others.0)
    }

    /// The motors of this set that are not in the other.
    #[must_use]
    pub const fn difference(self, others: Self) -> Self {
        Self(self.0 & !others.0)
    }

    /// Whether it is empty.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Number of motors in it.
    #[must_use]
    pub const fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Its bits: bit 0 is motor 1.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// The tips of the links in it.
    #[must_use]
    pub const fn tips(self) -> Self {
        Self((self.0 & Self::LINKS.0) << 4)
    }

    /// The links of the tips in it.
    #[must_use]
    pub const fn links(self) -> Self {
        Self((self.0 & Self::TIPS.0) >> 4)
    }

    /// Its motors by ascending number.
    pub fn iter(self) -> impl Iterator<Item = Motor> {
        (1..=7).map(Motor).filter(move |&motor| self.has(motor))
    }
}

impl FromIterator<Motor> for Motors {
    fn from_iter<T: IntoIterator<Item = Motor>>(motors: T) -> Self {
        motors.into_iter().fold(Self::NONE, Self::with)
    }
}

/// The prefix of a command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Prefix {
    /// X: exactly these motors, without simulating a BarrettHand.
    pub exclusive: bool,
    /// The motors that it names; without X a finger is its link motor, 1 to 3.
    pub named: Motors,
    /// Whether it names any; otherwise the enabled ones are selected.
    pub given: bool,
}

/// The motors that a command acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Selection {
    /// X: link and tip are separate motors, not a finger.
    pub exclusive: bool,
    /// The motors with a value of their own: without X a finger has one, its link's. With X exactly the named motors.
    pub axes: Motors,
    /// The tips that move with their links, and have no value of their own.
    pub followers: Motors,
}

impl Selection {
    /// The motors that move.
    #[must_use]
    pub const fn motors(self) -> Motors {
        self.axes.union(self.followers)
    }
}

impl Prefix {
    /// Parses a prefix in upper case, with white space between its characters: X first, then digits, G and S. `None` for X elsewhere, 5 to 7
    /// without X, a motor named twice, and any other character.
    #[must_use]
    pub fn parse(text: &[u8]) -> Option<Self> {
        let (exclusive, names) = match text {
            [b'X', names @ ..] => (true, names),
            names => (false, names),
        };
        let mut named = Motors::NONE;
        for name in names.iter().filter(|name| !name.is_ascii_whitespace()) {
            let more = match name {
                b'1'..=b'7' => {
                    let motor =
                        Motor::new(name - b'0').filter(|motor| exclusive || motor.link().is_none())?;
                    Motors::only(motor)
                }
                b'S' => Motors::SPREAD,
                // Table 3: the three fingers, whose motors with X are links and tips (decision 0001).
                b'G' if exclusive => Motors::LINKS.union(Motors::TIPS),
                b'G' => Motors::LINKS,
                _ => return None,
            };
            if !named.intersection(more).is_empty() {
                return None;
            }
            named = named.union(more);
        }
        Some(Self { exclusive, named, given: named != Motors::NONE })
    }

    /// The motors that it selects, if `enabled` are those with EN. X without a motor selects none. A finger of which only the link or only the
    /// tip is enabled is no finger: that motor moves alone.
    #[must_use]
    pub fn select(self, enabled: Motors) -> Selection {
        let (axes, followers) = match (self.given, self.exclusive) {
            (true, true) => (self.named, Motors::NONE),
            (true, false) => (self.named, self.named.tips()),
            (false, true) => (Motors::NONE, Motors::NONE),
            (false, false) => {
                let followers = enabled.intersection(enabled.tips());
                (enabled.difference(followers), followers)
            }
        };
        Selection { exclusive: self.exclusive, axes, followers }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes(text: &str) -> Option<u8> {
        Prefix::parse(text.as_bytes()).map(|prefix| prefix.select(Motors::ALL).axes.bits())
    }

    #[test]
    fn prefixes_select_motors_as_in_table_3() {
        for (text, without, with) in [
            ("1", Some(0b1), Some(0b1)),
            ("2", Some(0b10), Some(0b10)),
            ("3", Some(0b100), Some(0b100)),
            ("4", Some(0b1000), Some(0b1000)),
            ("5", None, Some(0b1_0000)),
            ("6", None, Some(0b10_0000)),
            ("7", None, Some(0b100_0000)),
            ("G", Some(0b111), Some(0b111_0111)),
            ("S", Some(0b1000), Some(0b1000)),
            ("", Some(0b1111), Some(0)),
            ("12", Some(0b11), Some(0b11)),
            ("35", None, Some(0b1_0100)),
            ("SG", Some(0b1111), Some(0b111_1111)),
            ("1X", None, None),
            ("8", None, None),
            ("0", None, None),
        ] {
            assert_eq!(axes(text), without, "{text}");
            assert_eq!(axes(&std::format!("X{text}")), with, "X{text}");
        }
    }

    #[test]
    fn finger_moves_as_one_only_if_link_and_tip_are_enabled() {
        let prefix = |text: &str| Prefix::parse(text.as_bytes()).expect("a prefix");
        let enabled = Motors::ALL.without(Motor(2)).without(Motor(7));
        let Selection { axes, followers, .. } = prefix("").select(enabled);
        assert_eq!((axes.bits(), followers.bits()), (0b010_1101, 0b001_0000));
        for bits in 0..128 {
            let selection = prefix("").select(Motors(bits));
            assert_eq!(selection.motors(), Motors(bits), "exactly the enabled ones");
            for tip in selection.followers.iter() {
                assert!(tip.link().is_some_and(|link| selection.axes.has(link)), "{bits:b}");
            }
        }
        assert_eq!(
            prefix("2").select(enabled).motors().bits(),
            0b10_0010,
            "EN matters without a prefix only"
        );
        assert_eq!(prefix("X13").select(enabled).motors().bits(), 0b101);
    }

    #[test]
    fn motors_are_sets() {
        let motor = |number| Motor::new(number).expect("a motor");
        for number in 1..=7 {
            let only = Motors::only(motor(number));
            assert_eq!((only.bits(), only.len(), only.is_empty()), (1 << (number - 1), 1, false));
            assert_eq!(only.with(motor(number)), only);
            assert_eq!(
                (only.without(motor(number)), Motors::NONE.without(motor(number))),
                Default::default()
            );
            assert_eq!(motor(number).node().number(), number);
            assert_eq!(motor(number).index(), usize::from(number) - 1);
        }
        assert_eq!((Motor::new(0), Motor::new(8), motor(4).tip(), motor(4).link()), (None, None, None, None));
        assert_eq!((motor(3).tip(), motor(7).link()), (Some(motor(7)), Some(motor(3))));
        assert_eq!((motor(5).tip(), motor(1).link()), (None, None));
        let kinds = [1, 3, 4, 5, 7].map(|number| motor(number).kind());
        assert_eq!(kinds, [1, 1, 2, 3, 3].map(|code| MotorKind::from_code(code).expect("a kind")));
        let (low, some) = (Motors::LINKS.union(Motors::SPREAD), Motors(0b110_1010));
        assert_eq!(low.union(some).bits(), 0b110_1111);
        assert_eq!(low.intersection(some).bits(), 0b000_1010);
        assert_eq!(low.difference(some).bits(), 0b000_0101);
        assert_eq!((some.len(), Motors::ALL.len(), Motors::NONE.len()), (4, 7, 0));
        assert_eq!((some.tips().bits(), some.links().bits()), (0b010_0000, 0b000_0110));
        assert_eq!(some.iter().map(Motor::number).collect::<std::vec::Vec<_>>(), [2, 4, 6, 7]);
        assert_eq!(some.iter().collect::<Motors>(), some);
    }
}
