//! The rows. To add one: a free number (never one that was used before) and a line here; documents, range,
//! storage and defaults follow. Then add the board's part in tater-fw.

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
    /// The motor's number in the hand, 1 to 7.
    Motor,
    /// The motor's slot in packed torques: 1 to 4 for motors 1 to 4, 1 to 3 for motors 5 to 7.
    Slot,
    /// For nodes 1 to 4, for 5 to 7, and for a hand on an arm, where groups 1 to 4 are the arm's (nodes 11 to 17).
    Groups(i16, i16, i16),
}

/// The number of a node's motor in the hand: nodes 1 to 7, and 11 to 17 of a hand on an arm (decision 0058).
const fn motor(node: Node) -> u8 {
    match node.number() {
        number @ 11..=17 => number - 10,
        number => number,
    }
}

/// The kind of joint that a motor drives; it decides the defaults. By node: 1 to 3 and 11 to 13 are links, 4 and 14 the
/// spread, 5 to 7 and 15 to 17 tips, and any other node has a link's.
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
        match motor(node) {
            4 => Self::Spread,
            5..=7 => Self::Tip,
            _ => Self::Link,
        }
    }

    /// Its name in files and on command lines.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Link => "link",
            Self::Spread => "spread",
            Self::Tip => "tip",
        }
    }

    /// The number of the first node with such a motor: that of finger 1, or the spread's.
    #[must_use]
    pub const fn first_node(self) -> u8 {
        match self {
            Self::Link => 1,
            Self::Spread => 4,
            Self::Tip => 5,
        }
    }

    /// The kind of a value of KIND.
    #[must_use]
    pub const fn from_code(code: i64) -> Option<Self> {
        match code {
            1 => Some(Self::Link),
            2 => Some(Self::Spread),
            3 => Some(Self::Tip),
            _ => None,
        }
    }

    /// The value of KIND.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Link => 1,
            Self::Spread => 2,
            Self::Tip => 3,
        }
    }

    /// Hall counts of a motor revolution, of every kind (manual 1.3.2, table 2).
    pub const COUNTS_PER_TURN: i64 = 18;

    /// Motor revolutions for 100 revolutions of the joint (manual 1.3.2, table 2).
    #[must_use]
    pub const fn gear_hundredths(self) -> i64 {
        match self {
            Self::Link => 4900,
            Self::Spread => 1828,
            Self::Tip => 3900,
        }
    }

    /// The joint's range, its lowest and highest whole hall count (manual 1.3.1, table 1); the stops stand half a count outside.
    #[must_use]
    pub const fn range_counts(self) -> [i16; 2] {
        match self {
            Self::Link => [-25, 338],
            Self::Spread => [0, 166],
            Self::Tip => [-158, 350],
        }
    }

    /// Hall counts that a goal may lie beyond the joint's range (decision 0068). The spread's default CT is 3 beyond it, HI may be off by
    /// 2, and a host that wants to press on a stop orders a goal behind it: at the default KP of 120, 8 counts ask for the motor's
    /// whole torque, 990.
    pub const GOAL_MARGIN: i16 = 8;

    /// The joint's range, as JLO and JHI have it by default.
    #[must_use]
    pub const fn range(self) -> Range {
        let [low, high] = self.range_counts();
        Range { low, high }
    }

    /// See [`Range::goals`].
    #[must_use]
    pub const fn goals(self) -> [i16; 2] {
        self.range().goals()
    }

    /// The goal nearest to a place.
    #[must_use]
    pub fn nearest_goal(self, counts: i64) -> i64 {
        let [low, high] = self.goals().map(i64::from);
        counts.max(low).min(high)
    }

    /// See [`Range::bounded`].
    #[must_use]
    pub fn bounded(self, property: Property, value: i32) -> i32 {
        self.range().bounded(property, value)
    }
}

/// A joint's range: its lowest and highest whole hall count. The stops stand half a count outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// Lowest whole count: JLO.
    pub low: i16,
    /// Highest whole count: JHI.
    pub high: i16,
}

impl Range {
    /// The lowest and the highest goal: the joint's range and a margin. A board refuses an order beyond it, and moves stored targets to it.
    #[must_use]
    pub const fn goals(self) -> [i16; 2] {
        [self.low.saturating_sub(MotorKind::GOAL_MARGIN), self.high.saturating_add(MotorKind::GOAL_MARGIN)]
    }

    /// A stored value as the board takes it: targets CT, OT and DP end at the [`Self::goals`], and IOFF, the way from a stop to zero, at the
    /// joint's width and the margin, in either direction. Any other value is itself.
    #[must_use]
    pub fn bounded(self, property: Property, value: i32) -> i32 {
        let [low, high] = self.goals().map(i32::from);
        let (low, high) = match property {
            Property::CT | Property::OT | Property::DP => (low, high),
            Property::IOFF => {
                let way = (high - low - i32::from(MotorKind::GOAL_MARGIN)).max(0);
                (-way, way)
            }
            _ => return value,
        };
        value.min(high).max(low)
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

/// The part of a property's row that a board enforces, without texts. A program that names properties only as constants
/// links only their rules; [`Property::find_rules`] and [`Property::rules`] of a variable link those of all.
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

/// Values of OTEMP between "no limit" and 20 °C are refused: hosts of Barrett's boards write 60 and mean 60 °C.
const OTEMP_GAP: (i64, i64) = (-550, 199);

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
        let is_gap = match self.property {
            Property::OTEMP => OTEMP_GAP.0 <= value && value <= OTEMP_GAP.1,
            Property::HOSTUNITS => 0 < value && value < self.max(),
            _ => false,
        };
        self.min() <= value && value <= self.max() && !is_gap
    }

    /// [`Self::admits`] of a signed 32-bit value, in half the instructions of a 32-bit processor.
    #[must_use]
    pub const fn admits_word(&self, value: i32) -> bool {
        let is_gap = matches!(self.property, Property::OTEMP)
            && OTEMP_GAP.0 <= value as i64
            && value as i64 <= OTEMP_GAP.1;
        self.min <= value && (value < 0 || value.cast_unsigned() <= self.max) && !is_gap
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
            Default::None | Default::Node | Default::Motor | Default::Slot | Default::Groups(..) => None,
        }
    }

    /// The default on a node's board, whose motor is of the node's kind; `None` if there is none.
    #[must_use]
    pub fn default_for(&self, node: Node) -> Option<i64> {
        self.default_on(node, MotorKind::of(node))
    }

    /// The default on a node's board with a motor of that kind; `None` if there is none.
    #[must_use]
    pub fn default_on(&self, node: Node, kind: MotorKind) -> Option<i64> {
        self.default_word(node, kind).map(i64::from)
    }

    /// [`Self::default_on`] in 32 bits.
    #[must_use]
    pub fn default_word(&self, node: Node, kind: MotorKind) -> Option<i32> {
        let within = |number: u8| i32::from(number).max(self.min).min(self.max.cast_signed());
        // A board that is none of the hand's seven still has a slot and a joint.
        match self.default {
            Default::Node => Some(within(node.number())),
            Default::Motor => Some(within(motor(node))),
            Default::Slot => Some(i32::from(match motor(node) {
                0 => 1,
                number @ 1..=4 => number,
                number => (number - 5) % 4 + 1,
            })),
            Default::Groups(low, high, arm) => Some(i32::from(match node.number() {
                5..=7 => high,
                11..=17 => arm,
                _ => low,
            })),
            Default::None | Default::Same(_) | Default::Kinds(..) => {
                self.default_for_motor(kind).map(i32::from)
            }
        }
    }

    /// A value on the wire: in the property's width, or 32 bits if it does not fit signed 16; `None` beyond 32.
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

/// `NAME = id, bits, access, stored, "unit", range, default, "meaning";`
macro_rules! table {
    ($($name:ident = $id:literal, $bits:literal, $access:ident, $stored:ident, $unit:literal,
        $min:literal..=$max:literal, $default:ident $(($($value:literal),*))?, $meaning:literal;)*) => {
        /// A property of a Tater, by its name in the manual. Its row's `meaning` explains it.
        #[allow(clippy::upper_case_acronyms, reason = "the manual's names")]
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        #[repr(u8)]
        pub enum Property {
            $(#[doc = $meaning] $name = $id,)*
        }

        /// Every property, by ascending number.
        pub const ROWS: &[PropertySpec] = &[$(*Property::$name.row(),)*];

        /// The rules of each, by ascending number.
        static RULES: [Rules; [$($id),*].len()] = [$(*Property::$name.rules(),)*];

        impl Property {
            /// All rows, by ascending number.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// The number on the wire.
            #[must_use]
            pub const fn id(self) -> u8 {
                self as u8
            }

            /// The name, as in the manual; without the row's other texts, for firmware that prints it.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$name => stringify!($name),)*
                }
            }

            /// The part of the row that a board enforces.
            #[must_use]
            pub const fn rules(self) -> &'static Rules {
                match self {
                    $(Self::$name => const {
                        &Rules {
                            property: Self::$name,
                            bits: $bits,
                            access: Access::$access,
                            stored: Stored::$stored,
                            default: Default::$default $(($($value),*))?,
                            min: $min,
                            max: $max,
                        }
                    },)*
                }
            }

            /// The whole row with its texts: not for firmware, which would link all of them.
            #[must_use]
            pub const fn row(self) -> &'static PropertySpec {
                match self {
                    $(Self::$name => const {
                        &PropertySpec {
                            name: Property::$name.name(),
                            rules: Property::$name.rules(),
                            unit: $unit,
                            min: $min,
                            max: $max,
                            meaning: $meaning,
                        }
                    },)*
                }
            }
        }
    };
}

table! {
    VERS = 0, 16, ReadOnly, No, "-", 600..=600, Same(600),
        "firmware version; in the monitor the monitor's; there SET 170 starts a download";
    ROLE = 1, 16, Locked, Yes, "bits", 0..=32767, Same(2051),
        "3 (this hand's motor board) | 0x0800 (has a strain gauge)";
    SN = 2, 16, Locked, Yes, "-", 0..=32767, Same(0),
        "serial number";
    ID = 3, 16, Locked, Yes, "-", 1..=31, Node,
        "the board's node on the bus; the straps' until set; a new one is heard from the next start on";
    ERROR = 4, 16, ReadOnly, No, "code", 0..=32767, Same(0),
        "latched fault, see the fault table; 0 none; SET STAT 2 clears it";
    STAT = 5, 16, ReadWrite, No, "-", 0..=2, Same(0),
        "0 in the monitor, waiting for firmware; 1 must not be used; 2 ready. SET 0 resets into the monitor, SET 2 wakes, or clears ERROR";
    MODE = 8, 16, ReadWrite, No, "-", 0..=5, Same(0),
        "control mode, see the mode table; 1 is refused; a move that 5 orders ends in 3";
    TEMP = 9, 16, ReadOnly, No, "0.1 C", -550..=1250, None,
        "temperature of the board";
    PTEMP = 10, 16, Locked, Always, "0.1 C", -550..=1250, Same(0),
        "highest TEMP ever; kept through power loss";
    OTEMP = 11, 16, ReadWrite, Yes, "0.1 C", -551..=1250, Same(700),
        "the motor's temperature limit: torque derates over the 8 C below it and is cut at it; -551 disables it and the check for a broken thermistor wire (decision 0014); -550 to 199 is refused";
    LOCK = 13, 16, WriteOnly, No, "-", 0..=32767, None,
        "18384, 23, 3145, 1024, 1 in this order unlock the next SET of a locked property, once";
    B = 16, 16, ReadOnly, No, "-", 0..=1, Same(0),
        "brake output: 1 energized, the spread is free";
    ANA0 = 18, 16, ReadOnly, No, "ADC", 0..=4095, None,
        "raw analog input 0: strain gauge";
    ANA1 = 19, 16, ReadOnly, No, "ADC", 0..=4095, None,
        "raw analog input 1: motor thermistor";
    THERM = 20, 16, ReadOnly, No, "0.1 C", -550..=1250, None,
        "motor temperature";
    VBUS = 21, 16, ReadOnly, No, "0.1 V", 0..=600, None,
        "bus voltage";
    IMOTOR = 22, 16, ReadOnly, No, "mA", -20000..=20000, None,
        "bus current; phase current is this over the duty";
    SG = 25, 16, ReadOnly, No, "-", 0..=255, None,
        "strain gauge";
    GRPA = 26, 16, ReadWrite, Yes, "-", 0..=31, Same(0),
        "first group listened to; group 0 is always heard";
    GRPB = 27, 16, ReadWrite, Yes, "-", 0..=31, Groups(1, 2, 7),
        "second group listened to: 1 for nodes 1 to 4, 2 for 5 to 7, 7 for 11 to 17 as in Barrett's hands";
    GRPC = 28, 16, ReadWrite, Yes, "-", 0..=31, Groups(4, 4, 5),
        "third group listened to: 4, or 5 for nodes 11 to 17";
    CMD = 29, 16, WriteOnly, No, "-", 0..=21, None,
        "does what the command table says";
    SAVE = 30, 16, WriteOnly, No, "id", -1..=127, None,
        "stores the present value of the property of this number; -1: of all";
    LOAD = 31, 16, WriteOnly, No, "id", -1..=127, None,
        "takes the stored value, or the default, of the property of this number; -1: of all";
    DEF = 32, 16, WriteOnly, No, "id", -1..=127, None,
        "resets the property of this number, and its stored value, to its default; -1: all";
    FIND = 33, 16, ReadWrite, No, "-", 0..=31, None,
        "SET: learns how the motor is wired, see the table of FIND; GET: what is known, or why it was refused";
    X0 = 34, 16, ReadWrite, Yes, "-", -32768..=32767, Same(0),
        "the host's to use; means nothing to the board";
    X1 = 35, 16, ReadWrite, Yes, "-", -32768..=32767, Same(0),
        "the host's to use; means nothing to the board";
    X2 = 36, 16, ReadWrite, Yes, "-", -32768..=32767, Same(0),
        "the host's to use; means nothing to the board";
    X3 = 37, 16, ReadWrite, Yes, "-", -32768..=32767, Same(0),
        "the host's to use; means nothing to the board";
    X4 = 38, 16, ReadWrite, Yes, "-", -32768..=32767, Same(0),
        "the host's to use; means nothing to the board";
    X5 = 39, 16, ReadWrite, Yes, "-", -32768..=32767, Same(0),
        "the host's to use; means nothing to the board";
    X6 = 40, 16, ReadWrite, Yes, "-", -32768..=32767, Same(0),
        "the host's to use; means nothing to the board";
    X7 = 41, 16, ReadWrite, Yes, "-", -32768..=32767, Same(0),
        "the host's to use; means nothing to the board";
    T = 42, 16, ReadWrite, No, "1/1024 peak", -990..=990, Same(0),
        "SET: torque of mode 2; GET: in mode 2 the torque commanded, after every limit, else the torque applied. Packed torques saturate at MT";
    MT = 43, 16, ReadWrite, Yes, "1/1024 peak", 0..=990, Same(750),
        "torque limit";
    V = 44, 16, ReadWrite, No, "counts/s", -4080..=4080, Same(0),
        "SET: velocity of mode 4, until a motion ends (VSET shows it); GET: in mode 4 the velocity commanded, else the measured one";
    MV = 45, 16, ReadWrite, Yes, "counts/s", 16..=4080, Same(1000),
        "cruise velocity of trapezoidal moves, together with MCV and MOV";
    MCV = 46, 16, ReadWrite, Yes, "counts/s", 16..=4080, Same(1000),
        "cruise velocity when closing";
    MOV = 47, 16, ReadWrite, Yes, "counts/s", 16..=4080, Same(1000),
        "cruise velocity when opening";
    P = 48, 32, ReadWrite, Yes, "counts", -32767..=32767, Same(0),
        "position; set in idle it says what the present position is called, in mode 3 where to go; within the goals of KIND; GET is answered by the 22-bit position frame";
    MR = 49, 32, ReadWrite, Yes, "mOhm", 20..=1000000, Same(2405),
        "motor: resistance line to line at 25 C; MKT, MJ and ML stay";
    DP = 50, 32, ReadWrite, Yes, "counts", -32767..=32767, Kinds(155, 29, 155),
        "default position: where CMD M goes; ends at the goals of KIND";
    MPK = 51, 16, ReadWrite, Yes, "mA", 50..=30000, Same(9980),
        "motor: peak current of a phase, which gives T 1024; MKT, MJ and ML stay";
    E = 52, 32, ReadWrite, No, "counts", -32767..=32767, Same(0),
        "where a trapezoidal move ends; during a move it re-plans; beyond the goals of KIND it is refused";
    MKT = 53, 32, ReadWrite, No, "uN.m/A", 1..=4000000, None,
        "motor: torque constant, which is the EMF in uV.s/rad; a view of MKE, which stores it";
    OT = 54, 32, ReadWrite, Yes, "counts", -32767..=32767, Same(0),
        "open target: where CMD O goes; ends at the goals of KIND";
    MJ = 55, 32, ReadWrite, No, "1e-11 kg.m2", 1..=2147483647, None,
        "motor: inertia with its load, at the motor; a view of MKA, which stores it";
    CT = 56, 32, ReadWrite, Yes, "counts", -32767..=32767, Kinds(331, 169, 331),
        "close target: where CMD C goes; ends at the goals of KIND";
    ML = 57, 32, ReadWrite, No, "0.1 uH", 1..=100000000, None,
        "motor: inductance line to line; a view of MTE, which stores it";
    M = 58, 32, WriteOnly, No, "counts", -32767..=32767, None,
        "E and a move to it in one, HOLD says how it ends; beyond the goals of KIND it is refused";
    MVN = 59, 16, ReadWrite, Yes, "0.1 V", 120..=480, Same(240),
        "nominal voltage of the supply";
    DS = 60, 16, ReadWrite, Yes, "counts", -32767..=32767, Kinds(25, 15, 25),
        "default step of CMD IC and IO, which end at the goals of KIND";
    UPSECS = 63, 32, Locked, Always, "s", 0..=4294967295, Same(0),
        "time with power on, ever";
    OD = 64, 32, Locked, Always, "revolutions", 0..=4294967295, Same(0),
        "odometer: way of the motor in both directions, ever; CTS counts a revolution";
    MECH = 66, 32, ReadOnly, No, "counts", 0..=119, None,
        "position within one motor revolution";
    MWX = 67, 16, ReadWrite, Yes, "0.1 C", 600..=2500, Same(1300),
        "motor: highest temperature of the winding";
    CTS = 68, 32, ReadOnly, No, "counts", 12..=120, Same(18),
        "counts a motor revolution: three times POLES";
    MWJ = 69, 16, ReadWrite, Yes, "0.01 J/K", 1..=65535, Same(1000),
        "motor: heat capacity of the winding";
    PIDX = 70, 16, ReadWrite, Yes, "-", 1..=4, Slot,
        "the board's slot in packed-torque frames";
    HSG = 71, 16, ReadWrite, Yes, "-", 0..=256, Same(256),
        "strain above which a move ends; 0, 255 and 256 disable";
    LSG = 72, 16, ReadWrite, Yes, "-", 0..=256, Same(256),
        "strain below which a move ends; 0, 255 and 256 disable";
    IVEL = 73, 16, ReadWrite, Yes, "counts/s", -4080..=4080, Kinds(-200, -200, 200),
        "velocity towards the stop in HI (tips home on their closed stop)";
    IOFF = 74, 32, ReadWrite, Yes, "counts", -32767..=32767, Kinds(25, 0, -350),
        "way from the stop to zero in HI; at most the joint's width and 8 in either direction";
    MWR = 75, 16, ReadWrite, Yes, "0.01 K/W", 1..=65535, Same(150),
        "motor: thermal resistance from winding to housing";
    MPE = 76, 16, ReadWrite, Yes, "counts", 0..=32767, Same(4),
        "arrival window";
    HOLD = 77, 16, ReadWrite, Yes, "-", 0..=1, Kinds(0, 1, 0),
        "after a motion: 1 holds the position, 0 idles; a move that MODE 5 orders holds with either, but not with HOSTUNITS 280";
    TSTOP = 78, 16, ReadWrite, Yes, "ms", 0..=65535, Kinds(300, 400, 300),
        "no count for this long while driven is a stall; 0 never";
    // Gains and BT were set by hand over plants of ±30 %; the manual has none. `hil-sim tune` keeps the gains of links and tips
    // (docs/tune.md). KP 200 lets a slow motor oscillate by 15 counts/s. The observed load takes the place of an integral.
    KP = 79, 16, ReadWrite, Yes, "1/1024 peak per count", 0..=32767, Same(120),
        "position gain";
    KD = 80, 16, ReadWrite, Yes, "1/256 of 1/1024 peak per count/s", 0..=32767, Same(640),
        "derivative gain, beyond the EMF's own damping";
    KI = 81, 16, ReadWrite, Yes, "1/1024 peak per count s", 0..=32767, Same(0),
        "integral gain; loads are carried without it";
    ACCEL = 82, 16, ReadWrite, Yes, "sqrt(counts)/ms/1024", 0..=65535, Kinds(40, 30, 30),
        "acceleration is (ACCEL/1024)^2 counts/ms^2; useful up to about 60; 0 cannot move";
    JIDX = 85, 16, ReadWrite, Yes, "-", 1..=7, Motor,
        "joint index";
    IPNM = 86, 16, ReadOnly, No, "1/N.m", 1..=32767, Same(1575),
        "torque units per newton meter at the motor";
    HALLS = 87, 16, ReadOnly, No, "bits", 0..=7, None,
        "present hall code";
    HALLH = 88, 32, ReadOnly, No, "bits", 0..=2147483647, None,
        "the last ten hall codes, the newest in the low three bits; bit 30: the position is known (HI, or stored and not moved since)";
    KBW = 89, 16, ReadWrite, Yes, "0.1 Hz", 0..=1000, Same(0),
        "bandwidth of the position loop, from which the gains are computed for the motor as it is described; 0: KP, KD and KPV hold. 166 is theirs";
    POLES = 90, 16, ReadWrite, Yes, "-", 4..=40, Same(6),
        "motor: poles of the rotor, an even number; MKT, MJ and ML stay";
    EN = 94, 16, ReadWrite, Yes, "-", 0..=1, Same(1),
        "whether the hand's commands without a motor prefix act on this motor; GOD's to obey";
    FIT = 95, 16, ReadOnly, No, "code", 0..=9, None,
        "whether the board can drive the motor as it is described: 0 it can; else why not, see the table of FIT, and nothing moves";
    JLO = 97, 16, ReadWrite, Yes, "counts", -30000..=30000, Kinds(-25, 0, -158),
        "joint: lowest whole count; goals go 8 beyond";
    JHI = 99, 16, ReadWrite, Yes, "counts", -30000..=30000, Kinds(338, 166, 350),
        "joint: highest whole count; goals go 8 beyond";
    LCVC = 105, 16, ReadWrite, Yes, "-", 1..=255, Same(8),
        "RealTime velocity bytes are multiplied by this; GOD's to obey";
    IHIT = 108, 16, ReadWrite, Yes, "1/1024 peak", 0..=990, Same(250),
        "torque limit in HI";
    KPV = 109, 16, ReadWrite, Yes, "1/16 of 1/1024 peak per count/s", 0..=255, Same(32),
        "velocity gain of mode 4 (RealTime's proportional gain)";
    BS = 110, 16, ReadWrite, Yes, "-", 0..=1, Same(0),
        "a breakaway stops the finger's tip too; GOD's to obey";
    BD = 111, 16, ReadOnly, No, "-", 0..=1, None,
        "a breakaway has been detected; CMD O clears it";
    BP = 112, 32, ReadOnly, No, "counts", -32767..=32767, None,
        "position of the last breakaway";
    BT = 114, 16, ReadWrite, Yes, "1/1024 peak", 0..=990, Kinds(400, 0, 0),
        "load torque at which a link breaks away; 0 never";
    END = 115, 16, ReadOnly, No, "-", 0..=6, None,
        "why the last motion ended, see the end table; 0 it has not";
    LFLAGS = 116, 16, ReadWrite, No, "bits", 0..=3, Same(0),
        "bit 0: report ends of moves unasked (MODE, then END); bit 1: report breakaways (BD)";
    VEL = 117, 16, ReadOnly, No, "counts/s", -32767..=32767, None,
        "the measured velocity in any mode: what RealTime feeds back, whose V is the command";
    WIRING = 118, 16, Locked, Yes, "-", 0..=192, Same(0),
        "0 unknown: the motor does not move; else 1 + 2 x the wiring's number, plus 1 if the direction of closing is known. 2 as shipped; FIND stores it";
    HOSTMS = 119, 16, ReadWrite, Yes, "ms", 0..=65535, Same(2000),
        "in mode 2 or 4 set by a host, no frame to this board or its groups for this long ends the motion with ERROR 7; 0 never";
    KIND = 120, 16, Locked, Yes, "-", 1..=3, Kinds(1, 2, 3),
        "kind of motor: 1 link, 2 spread, 3 tip; goals are -33 to 346, -8 to 174, -166 to 358; by the straps, or without straps by the node, until set; a new one counts from the next start on";
    VSET = 121, 16, ReadOnly, No, "counts/s", -4080..=4080, Same(0),
        "V as set: mode 4 runs at it, or will when it starts; 0 once any motion has ended";
    // The motor of decision 0003 with 2e-5 kg·m²: 0.6496 N·m/1024 / 2e-5 kg·m² / 0.3491 rad = 90.9 counts/s², 0.0651 V·s/rad,
    // 0.03 and 0.04 N·m, 0.8 mH / 2.4 Ω.
    MKA = 122, 16, ReadWrite, Yes, "1/16 count/s2 per 1/1024 peak", 16..=65535, Same(1454),
        "motor model: acceleration of motor and joint by torque";
    MKE = 123, 16, ReadWrite, Yes, "1/4096 of 1/1024 peak per count/s", 16..=65535, Same(3971),
        "motor model: EMF; 1024 torque units are the voltage MR MPK, 24 V";
    MFC = 124, 16, ReadWrite, Yes, "1/1024 peak", 0..=400, Same(47),
        "motor model: friction in motion";
    MFS = 125, 16, ReadWrite, Yes, "1/1024 peak", 0..=400, Same(63),
        "motor model: friction at rest; at least MFC counts";
    MTE = 126, 16, ReadWrite, Yes, "us", 0..=20000, Same(333),
        "motor model: electrical time constant";
    HOSTUNITS = 127, 16, ReadWrite, Yes, "-", 0..=280, Same(0),
        "units of values on the bus: 0 those of this table; 280 those of a BH8-280, for its hosts (decision 0070); nothing between";
}

/// The place of each number in [`RULES`]; where no property has the number, that of the first.
static PLACES: [u8; 128] = {
    let mut places = [0; 128];
    let mut at = 0;
    while at < RULES.len() {
        #[allow(
            clippy::indexing_slicing,
            reason = "evaluated by the compiler, which refuses a number beyond 127"
        )]
        {
            places[RULES[at].property.id() as usize] = at as u8;
        }
        at += 1;
    }
    places
};

impl Property {
    /// [`Self::rules`] of a property that is not a constant: a table of its own, smaller than the branches of that.
    #[inline(never)]
    #[must_use]
    pub fn find_rules(self) -> &'static Rules {
        let place = PLACES.get(usize::from(self.id())).map_or(0, |place| usize::from(*place));
        RULES.get(place).unwrap_or(const { Self::VERS.rules() })
    }

    /// The property of a number; `None` if there is none.
    #[must_use]
    pub fn of(id: u8) -> Option<Self> {
        let place = PLACES.get(usize::from(id)).map(|place| usize::from(*place));
        let rules = place.and_then(|place| RULES.get(place))?;
        (rules.property.id() == id).then_some(rules.property)
    }

    /// The property of a name, case-insensitive.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        ROWS.iter().find(|row| row.name.eq_ignore_ascii_case(name)).map(|row| row.property)
    }

    /// The property's value from the wire: signed, unless its row is unsigned.
    #[must_use]
    pub fn read(self, value: Value) -> i64 {
        let unsigned = self.find_rules().unsigned();
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
        self.find_rules().write(value)
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
