//! The parameters, a row each (manual 5.3 and 5.4): name, access, range, defaults, help, and where the value is.

use tater_wire::MotorKind;
use tater_wire::Property;

/// Where the manual lists a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Category {
    /// 5.3.1.
    Movement,
    /// 5.3.2.
    Status,
    /// 5.3.3.
    RealTime,
    /// 5.3.4, 5.4.3: FLIST and PLIST do not list them.
    Advanced,
    /// 5.4.1.
    Global,
    /// 5.4.2.
    GlobalStatus,
    /// Of later hands, whose clients set them here too: no list has them.
    Later,
}

/// What of a motor GOD keeps itself: it shapes RealTime, and no board knows of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs, reason = "the parameter of that name says it")]
pub enum Kept {
    Lcv,
    Lcvc,
    Lcpg,
    Lfv,
    Lfvc,
    Lfs,
    Lfap,
    Lfdp,
    Lfdpc,
}

/// How many of [`Kept`] there are.
pub const KEPT: usize = 9;

/// Where the value of a motor's parameter is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A property of its board, in the same unit.
    Board(Property),
    /// A property of its board in hall counts. GOD keeps the value as it was set while the property is its rounding (DESIGN 6); that is
    /// the place in the list of those.
    Counts(Property, u8),
    /// A position that the board measures.
    Measured(Property),
    /// GOD's.
    Kept(Kept),
    /// The status of the motor.
    Status,
    /// Always this.
    Fixed(i64),
}

/// How many parameters are [`Source::Counts`].
pub const COUNTS: usize = 5;

/// A motor parameter's row.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// As it is typed.
    pub name: &'static str,
    /// Where the manual lists it.
    pub category: Category,
    /// Whether it can be set.
    pub writable: bool,
    /// Least value.
    pub min: i64,
    /// Greatest value.
    pub max: i64,
    /// Defaults of link, spread and tip; of what cannot be set: none.
    pub defaults: [i64; 3],
    /// Where the value is.
    pub source: Source,
    /// What it is for.
    pub help: &'static str,
}

impl Row {
    /// The default for a kind of motor.
    #[must_use]
    pub const fn default_for(&self, kind: MotorKind) -> i64 {
        let [link, spread, tip] = self.defaults;
        match kind {
            MotorKind::Link => link,
            MotorKind::Spread => spread,
            MotorKind::Tip => tip,
        }
    }
}

const RW: bool = true;
const RO: bool = false;

/// `"NAME", category, access, range, [link, spread, tip], source, "help";`
macro_rules! motor {
    ($($name:literal, $category:ident, $writable:ident, $min:literal..=$max:literal, $defaults:expr, $source:expr, $help:literal;)*) => {
        /// Every motor parameter, in the manual's order.
        pub const MOTOR: &[Row] = &[$(Row {
            name: $name,
            category: Category::$category,
            writable: $writable,
            min: $min,
            max: $max,
            defaults: $defaults,
            source: $source,
            help: $help,
        },)*];
    };
}

use Source::{Board, Counts, Fixed, Measured};

motor! {
    "BS", Movement, RW, 0..=1, [0, 0, 0], Board(Property::BS), "1: a finger stops where it breaks away";
    "DP", Movement, RW, -32_767..=32_767, [8500, 1575, 8500], Counts(Property::DP, 0), "where M goes without an argument, counts";
    "DS", Movement, RW, -32_767..=32_767, [1400, 800, 1400], Counts(Property::DS, 1), "how far IC and IO go without an argument, counts";
    "HSG", Movement, RW, 0..=256, [256, 256, 256], Board(Property::HSG), "strain above which a motion ends; 255 and 256: never";
    "LSG", Movement, RW, 0..=256, [256, 256, 256], Board(Property::LSG), "strain below which a motion ends; 255 and 256: never";
    "MOV", Movement, RW, 16..=4080, [1000, 1000, 1000], Board(Property::MOV), "greatest velocity of opening, hall counts/s";
    "MCV", Movement, RW, 16..=4080, [1000, 1000, 1000], Board(Property::MCV), "greatest velocity of closing, hall counts/s";
    "MSG", Movement, RW, 0..=256, [256, 256, 256], Board(Property::HSG), "the same as HSG";
    "BD", Status, RO, 0..=1, [0, 0, 0], Board(Property::BD), "whether the finger has broken away";
    "BP", Status, RO, -32_767..=32_767, [0, 0, 0], Measured(Property::BP), "where the finger broke away last, counts";
    "OD", Status, RO, 0..=4_294_967_295, [0, 0, 0], Board(Property::OD), "how far the motor has turned, 1000 hall counts";
    "P", Status, RO, -32_767..=32_767, [0, 0, 0], Measured(Property::P), "position, counts";
    "S", Status, RO, 0..=32_767, [0, 0, 0], Source::Status, "0: ready; otherwise a sum of status codes";
    "SG", Status, RO, 0..=255, [0, 0, 0], Board(Property::SG), "strain";
    "LCV", RealTime, RW, 0..=1, [1, 1, 1], Source::Kept(Kept::Lcv), "1: control blocks have the motor's velocity";
    "LCVC", RealTime, RW, 1..=255, [8, 8, 8], Source::Kept(Kept::Lcvc), "what that velocity is multiplied by";
    "LCPG", RealTime, RW, 0..=1, [1, 1, 1], Source::Kept(Kept::Lcpg), "1: control blocks have the motor's proportional gain";
    "LFV", RealTime, RW, 0..=1, [1, 1, 1], Source::Kept(Kept::Lfv), "1: feedback blocks have the motor's velocity";
    "LFVC", RealTime, RW, 1..=255, [8, 8, 8], Source::Kept(Kept::Lfvc), "what that velocity is divided by";
    "LFS", RealTime, RW, 0..=1, [1, 1, 1], Source::Kept(Kept::Lfs), "1: feedback blocks have the motor's strain";
    "LFAP", RealTime, RW, 0..=2, [1, 1, 1], Source::Kept(Kept::Lfap), "1: feedback blocks have the motor's position, 4 bytes; 2: 2 bytes";
    "LFDP", RealTime, RW, 0..=1, [1, 1, 1], Source::Kept(Kept::Lfdp), "1: feedback blocks have the change of the motor's position";
    "LFDPC", RealTime, RW, 1..=255, [1, 1, 1], Source::Kept(Kept::Lfdpc), "what that change is divided by";
    "ACCEL", Advanced, RW, 0..=65_535, [40, 30, 30], Board(Property::ACCEL), "greatest acceleration, sqrt(hall counts)/ms/1024";
    "CT", Advanced, RW, -32_767..=32_767, [18_200, 9300, 18_200], Counts(Property::CT, 2), "where C goes, counts";
    "EN", Advanced, RW, 0..=1, [1, 1, 1], Board(Property::EN), "1: a command without a motor prefix moves it";
    "HOLD", Advanced, RW, 0..=1, [0, 1, 0], Board(Property::HOLD), "1: the motor holds its position after a motion";
    "MPE", Advanced, RW, -32_767..=32_767, [200, 200, 200], Counts(Property::MPE, 3), "how far from its goal a motion may end, counts";
    "OT", Advanced, RW, -32_767..=32_767, [0, 0, 0], Counts(Property::OT, 4), "where O goes, counts";
    "SAMPLE", Advanced, RO, 31..=31, [31, 31, 31], Fixed(31), "sample time of the motor's controller";
    "TSTOP", Advanced, RW, 0..=65_535, [300, 400, 300], Board(Property::TSTOP), "how long a motor may be stopped before its motion ends, ms; 0: for ever";
    "LCT", Later, RW, 0..=0, [0, 0, 0], Fixed(0), "0: control blocks have no torque";
    "LFBP", Later, RW, 0..=0, [0, 0, 0], Fixed(0), "0: feedback blocks have no breakaway position";
    "LFAIN", Later, RW, 0..=0, [0, 0, 0], Fixed(0), "0: feedback blocks have no analog input";
}

/// Which parameter of the hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the parameter of that name says it")]
pub enum Global {
    Baud,
    Lft,
    Otemp,
    Temp,
    Ptemp,
    Upsecs,
    Sn,
    Lfdpd,
}

/// A parameter of the hand.
#[derive(Clone, Copy, Debug)]
pub struct GlobalRow {
    /// As it is typed.
    pub name: &'static str,
    /// Where the manual lists it.
    pub category: Category,
    /// Which.
    pub global: Global,
    /// Whether it can be set.
    pub writable: bool,
    /// Least value.
    pub min: i64,
    /// Greatest value.
    pub max: i64,
    /// Default; of what cannot be set: none.
    pub default: i64,
    /// What it is for.
    pub help: &'static str,
}

/// What BAUD may be: baud rate / 100.
pub const BAUDS: [i64; 7] = [6, 12, 24, 48, 96, 192, 384];

/// `"NAME", category, which, access, range, default, "help";`
macro_rules! global {
    ($($name:literal, $category:ident, $global:ident, $writable:ident, $min:literal..=$max:literal, $default:literal, $help:literal;)*) => {
        /// Every parameter of the hand, in the manual's order.
        pub const GLOBAL: &[GlobalRow] = &[$(GlobalRow {
            name: $name,
            category: Category::$category,
            global: Global::$global,
            writable: $writable,
            min: $min,
            max: $max,
            default: $default,
            help: $help,
        },)*];
    };
}

global! {
    "BAUD", Global, Baud, RW, 6..=384, 96, "baud rate / 100: 6, 12, 24, 48, 96, 192 or 384";
    "LFT", Global, Lft, RW, 0..=1, 0, "1: feedback blocks have the hand's temperature";
    "OTEMP", Global, Otemp, RW, -551..=1250, -551, "temperature above which no motor moves, 0.1 C; -551: none";
    "TEMP", GlobalStatus, Temp, RO, -550..=1250, 0, "temperature of this board, 0.1 C";
    "PTEMP", GlobalStatus, Ptemp, RO, 0..=1250, 0, "its highest ever, 0.1 C";
    "UPSECS", GlobalStatus, Upsecs, RO, 0..=4_294_967_295, 0, "how long the hand has been on in its life, s";
    "SN", GlobalStatus, Sn, RO, 0..=4_294_967_295, 0, "serial number of the hand";
    "LFDPD", Advanced, Lfdpd, RW, 0..=1, 0, "1: a change of position that does not fit its byte is forgotten, not sent later";
}

/// The motor parameter of that name, in upper case.
#[must_use]
pub fn motor(name: &str) -> Option<&'static Row> {
    MOTOR.iter().find(|row| row.name == name)
}

/// The hand's parameter of that name, in upper case.
#[must_use]
pub fn global(name: &str) -> Option<&'static GlobalRow> {
    GLOBAL.iter().find(|row| row.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motors::Motors;
    use crate::units;

    #[test]
    fn rows_are_sound() {
        for (i, row) in MOTOR.iter().enumerate() {
            assert!(MOTOR[..i].iter().all(|other| other.name != row.name), "{}", row.name);
            assert!(
                !row.writable || row.defaults.iter().all(|d| (row.min..=row.max).contains(d)),
                "{}",
                row.name
            );
        }
        for row in GLOBAL {
            assert!(!row.writable || (row.min..=row.max).contains(&row.default), "{}", row.name);
        }
        let counts: std::vec::Vec<u8> = MOTOR
            .iter()
            .filter_map(|row| if let Counts(_, place) = row.source { Some(place) } else { None })
            .collect();
        assert_eq!(counts, [0, 1, 2, 3, 4]);
    }

    /// A board that nobody has set anything on has what the language's default rounds to.
    #[test]
    fn defaults_are_the_boards() {
        for motor in Motors::ALL.iter() {
            for row in MOTOR.iter().filter(|row| row.writable) {
                let (property, default) = match row.source {
                    Board(property) => (property, row.default_for(motor.kind())),
                    Counts(property, _) => (property, units::halls(row.default_for(motor.kind()))),
                    _ => continue,
                };
                assert_eq!(
                    property.row().default_for(motor.node()),
                    Some(default),
                    "{} of {motor:?}",
                    row.name
                );
            }
        }
    }
}
