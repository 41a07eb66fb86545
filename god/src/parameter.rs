//! The tables of parameters (manual 5.3 and 5.4): name, access, range, defaults, help, and where the value is.
//!
//! Range and defaults of a parameter that is a board's property come from the property's row in `tater_wire`. Only what the language states in
//! its own units is stated here: positions and distances in GCL counts, RealTime's formats, and the hand's parameters.

use crate::units::gcl_thousands_from_revolutions;
use tater_wire::{MotorKind, Property};

/// The manual's section of a parameter.
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
    /// Parameters of later hands, which their clients set here too: no list shows them.
    Later,
}

/// Parameters of a motor that GOD keeps itself: they shape RealTime, and no board has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs, reason = "each is the parameter of that name")]
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
    Lct,
}

/// Number of parameters in [`Kept`].
pub const KEPT: usize = 10;

/// Farthest position and longest distance of the language, GCL counts (manual 5.3).
const MAX_COUNTS: i64 = 32_767;

/// The place of a motor parameter's value, with its range and defaults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A property of its board, in the same unit, with its range and defaults.
    Board(Property),
    /// A property of its board in hall counts, set in GCL counts. GOD keeps the value as it was set while the property is its rounding
    /// (decision 0027).
    Counts {
        /// The property.
        property: Property,
        /// The place in the list of kept values.
        place: u8,
        /// The language's defaults of link, spread and tip, GCL counts (manual 5.3): the boards' are their rounding.
        defaults: [i64; 3],
    },
    /// A position that the board measures, in hall counts; or OD, in motor revolutions.
    Measured(Property),
    /// GOD's.
    Kept {
        /// The parameter.
        kept: Kept,
        /// Smallest value.
        min: u8,
        /// Largest value.
        max: u8,
        /// Default.
        default: u8,
    },
    /// The status of the motor.
    Status,
    /// Always this value.
    Fixed(i64),
}

/// Number of parameters that are [`Source::Counts`].
pub const COUNTS: usize = 5;

/// A motor parameter's row.
#[derive(Clone, Copy, Debug)]
pub struct ParameterSpec {
    /// Its name, as typed.
    pub name: &'static str,
    /// Its category.
    pub category: Category,
    /// Whether it can be set.
    pub writable: bool,
    /// The place of its value.
    pub source: Source,
    /// Help text.
    pub help: &'static str,
}

impl ParameterSpec {
    /// Smallest value.
    #[must_use]
    pub const fn min(&self) -> i64 {
        match self.source {
            Source::Board(property) => property.rules().min(),
            Source::Measured(Property::OD) => 0,
            Source::Counts { .. } | Source::Measured(_) => -MAX_COUNTS,
            Source::Kept { min, .. } => min as i64,
            Source::Status => 0,
            Source::Fixed(value) => value,
        }
    }

    /// Largest value.
    #[must_use]
    pub const fn max(&self) -> i64 {
        match self.source {
            Source::Board(property) => property.rules().max(),
            Source::Measured(Property::OD) => gcl_thousands_from_revolutions(Property::OD.rules().max()),
            Source::Counts { .. } | Source::Measured(_) => MAX_COUNTS,
            Source::Kept { max, .. } => max as i64,
            // All status codes at once.
            Source::Status => 32_767,
            Source::Fixed(value) => value,
        }
    }

    /// Smallest and largest value with COMPAT 262, where that hand's hosts set others: LCVC 0, and LCT.
    #[must_use]
    pub const fn limits(&self, compat_262: bool) -> (i64, i64) {
        match self.source {
            Source::Kept { kept: Kept::Lcvc, .. } if compat_262 => (0, self.max()),
            Source::Kept { kept: Kept::Lct, .. } if !compat_262 => (0, 0),
            _ => (self.min(), self.max()),
        }
    }

    /// The default for a kind of motor; 0 for what cannot be set.
    #[must_use]
    pub fn default_for(&self, kind: MotorKind) -> i64 {
        match self.source {
            Source::Board(property) => property.rules().default_for_motor(kind).map_or(0, i64::from),
            Source::Counts { defaults: [link, spread, tip], .. } => match kind {
                MotorKind::Link => link,
                MotorKind::Spread => spread,
                MotorKind::Tip => tip,
            },
            Source::Kept { default, .. } => default.into(),
            Source::Fixed(value) => value,
            Source::Measured(_) | Source::Status => 0,
        }
    }
}

const RW: bool = true;
const RO: bool = false;

/// `"NAME", category, access, source, "help";`
macro_rules! motor {
    ($($name:literal, $category:ident, $writable:ident, $source:expr, $help:literal;)*) => {
        /// Every motor parameter, in the manual's order.
        pub const MOTOR: &[ParameterSpec] = &[$(ParameterSpec {
            name: $name,
            category: Category::$category,
            writable: $writable,
            source: $source,
            help: $help,
        },)*];
    };
}

use Source::{Board, Counts, Fixed, Measured};

motor! {
    "BS", Movement, RW, Board(Property::BS), "1: a finger stops where it breaks away";
    "DP", Movement, RW, Counts { property: Property::DP, place: 0, defaults: [8500, 1575, 8500] }, "where M goes without an argument, counts";
    "DS", Movement, RW, Counts { property: Property::DS, place: 1, defaults: [1400, 800, 1400] }, "how far IC and IO go without an argument, counts";
    "HSG", Movement, RW, Board(Property::HSG), "strain above which a motion ends; 0, 255 and 256: never";
    "LSG", Movement, RW, Board(Property::LSG), "strain below which a motion ends; 0, 255 and 256: never";
    "MOV", Movement, RW, Board(Property::MOV), "greatest velocity of opening, hall counts/s";
    "MCV", Movement, RW, Board(Property::MCV), "greatest velocity of closing, hall counts/s";
    "MSG", Movement, RW, Board(Property::HSG), "the same as HSG";
    "BD", Status, RO, Board(Property::BD), "whether the finger has broken away";
    "BP", Status, RO, Measured(Property::BP), "where the finger broke away last, counts";
    "OD", Status, RO, Measured(Property::OD), "how far the motor has turned, 1000 counts";
    "P", Status, RO, Measured(Property::P), "position, counts";
    "S", Status, RO, Source::Status, "0: ready; otherwise a sum of status codes";
    "SG", Status, RO, Board(Property::SG), "strain";
    "LCV", RealTime, RW, Source::Kept { kept: Kept::Lcv, min: 0, max: 1, default: 1 }, "1: control blocks have the motor's velocity";
    "LCVC", RealTime, RW, Source::Kept { kept: Kept::Lcvc, min: 1, max: 255, default: 8 }, "what that velocity is multiplied by";
    "LCPG", RealTime, RW, Source::Kept { kept: Kept::Lcpg, min: 0, max: 1, default: 1 }, "1: control blocks have the motor's proportional gain";
    "LFV", RealTime, RW, Source::Kept { kept: Kept::Lfv, min: 0, max: 1, default: 1 }, "1: feedback blocks have the motor's velocity";
    "LFVC", RealTime, RW, Source::Kept { kept: Kept::Lfvc, min: 1, max: 255, default: 8 }, "what that velocity is divided by";
    "LFS", RealTime, RW, Source::Kept { kept: Kept::Lfs, min: 0, max: 1, default: 1 }, "1: feedback blocks have the motor's strain";
    "LFAP", RealTime, RW, Source::Kept { kept: Kept::Lfap, min: 0, max: 2, default: 1 }, "1: feedback blocks have the motor's position, 4 bytes; 2: 2 bytes";
    "LFDP", RealTime, RW, Source::Kept { kept: Kept::Lfdp, min: 0, max: 1, default: 1 }, "1: feedback blocks have the change of the motor's position";
    "LFDPC", RealTime, RW, Source::Kept { kept: Kept::Lfdpc, min: 1, max: 255, default: 1 }, "what that change is divided by";
    "ACCEL", Advanced, RW, Board(Property::ACCEL), "greatest acceleration, sqrt(hall counts)/ms/1024";
    "CT", Advanced, RW, Counts { property: Property::CT, place: 2, defaults: [18_200, 9300, 18_200] }, "where C goes, counts";
    "EN", Advanced, RW, Board(Property::EN), "1: a command without a motor prefix moves it";
    "HOLD", Advanced, RW, Board(Property::HOLD), "1: the motor holds its position after a motion";
    "MPE", Advanced, RW, Counts { property: Property::MPE, place: 3, defaults: [200, 200, 200] }, "how far from its goal a motion may end, counts";
    "OT", Advanced, RW, Counts { property: Property::OT, place: 4, defaults: [0, 0, 0] }, "where O goes, counts";
    "SAMPLE", Advanced, RO, Fixed(31), "sample time of the motor's controller";
    "TSTOP", Advanced, RW, Board(Property::TSTOP), "how long a motor may be stopped before its motion ends, ms; 0: for ever";
    "LCT", Later, RW, Source::Kept { kept: Kept::Lct, min: 0, max: 1, default: 0 }, "1: control blocks have the spread's torque, with COMPAT 262";
    "LFBP", Later, RW, Fixed(0), "0: feedback blocks have no breakaway position";
    "LFAIN", Later, RW, Fixed(0), "0: feedback blocks have no analog input";
}

/// The parameters of the hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "each is the parameter of that name")]
pub enum HandParameter {
    Baud,
    Lft,
    Otemp,
    Temp,
    Ptemp,
    Upsecs,
    Sn,
    Lfdpd,
    Compat,
}

/// A row of a parameter of the hand.
#[derive(Clone, Copy, Debug)]
pub struct HandParameterSpec {
    /// Its name, as typed.
    pub name: &'static str,
    /// Its category.
    pub category: Category,
    /// The parameter.
    pub parameter: HandParameter,
    /// Whether it can be set.
    pub writable: bool,
    /// Smallest value.
    pub min: i64,
    /// Largest value.
    pub max: i64,
    /// Default; 0 for what cannot be set.
    pub default: i64,
    /// Help text.
    pub help: &'static str,
}

/// The values of COMPAT: RealTime by the manual's table 5, or as hosts of the BH8-262 expect it (decision 0056).
pub const COMPATS: [i64; 2] = [0, 262];

/// The values of BAUD: baud rate / 100.
pub const BAUDS: [i64; 7] = [6, 12, 24, 48, 96, 192, 384];

/// `"NAME", category, which, access, range, default, "help";`
macro_rules! hand {
    ($($name:literal, $category:ident, $parameter:ident, $writable:ident, $min:literal..=$max:literal, $default:literal, $help:literal;)*) => {
        /// Every parameter of the hand, in the manual's order.
        pub const HAND: &[HandParameterSpec] = &[$(HandParameterSpec {
            name: $name,
            category: Category::$category,
            parameter: HandParameter::$parameter,
            writable: $writable,
            min: $min,
            max: $max,
            default: $default,
            help: $help,
        },)*];
    };
}

hand! {
    "BAUD", Global, Baud, RW, 6..=384, 96, "baud rate / 100: 6, 12, 24, 48, 96, 192 or 384";
    "LFT", Global, Lft, RW, 0..=1, 0, "1: feedback blocks have the hand's temperature";
    "OTEMP", Global, Otemp, RW, -551..=1250, -551, "temperature above which no motor moves, 0.1 C; -551: none";
    "TEMP", GlobalStatus, Temp, RO, -550..=1250, 0, "temperature of this board, 0.1 C";
    "PTEMP", GlobalStatus, Ptemp, RO, 0..=1250, 0, "its highest ever, 0.1 C";
    "UPSECS", GlobalStatus, Upsecs, RO, 0..=4_294_967_295, 0, "how long the hand has been on in its life, s";
    "SN", GlobalStatus, Sn, RW, 1..=4_294_967_295, 0, "serial number of the hand, which can be set once";
    "LFDPD", Advanced, Lfdpd, RW, 0..=1, 0, "1: a change of position that does not fit its byte is forgotten, not sent later";
    "COMPAT", Advanced, Compat, RW, 0..=262, 0, "262: RealTime as hosts of the BH8-262 expect it; 0: as the manual has it";
}

/// The motor parameter of that name, in upper case.
#[must_use]
pub fn motor(name: &str) -> Option<&'static ParameterSpec> {
    MOTOR.iter().find(|row| row.name == name)
}

/// The hand's parameter of that name, in upper case.
#[must_use]
pub fn hand(name: &str) -> Option<&'static HandParameterSpec> {
    HAND.iter().find(|row| row.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motors::Motors;
    use crate::units;

    #[test]
    fn names_are_unique_and_defaults_in_range() {
        for (i, row) in MOTOR.iter().enumerate() {
            assert!(MOTOR[..i].iter().all(|other| other.name != row.name), "{}", row.name);
            for kind in [MotorKind::Link, MotorKind::Spread, MotorKind::Tip] {
                let default = row.default_for(kind);
                assert!(!row.writable || (row.min()..=row.max()).contains(&default), "{}", row.name);
            }
        }
        // SN has none.
        for row in HAND.iter().filter(|row| row.parameter != HandParameter::Sn) {
            assert!(!row.writable || (row.min..=row.max).contains(&row.default), "{}", row.name);
        }
        let counts: std::vec::Vec<u8> = MOTOR
            .iter()
            .filter_map(|row| if let Counts { place, .. } = row.source { Some(place) } else { None })
            .collect();
        assert_eq!(counts, [0, 1, 2, 3, 4]);
    }

    #[test]
    fn defaults_in_counts_round_to_the_boards_defaults() {
        for motor in Motors::ALL.iter() {
            for row in MOTOR.iter().filter(|row| row.writable) {
                let Counts { property, .. } = row.source else { continue };
                assert_eq!(
                    property.rules().default_for(motor.node()),
                    Some(units::halls_from_gcl(row.default_for(motor.kind()))),
                    "{} of {motor:?}",
                    row.name
                );
            }
        }
    }
}
