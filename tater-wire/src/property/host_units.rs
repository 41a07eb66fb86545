//! HOSTUNITS: the units of values on the wire. 0 are this project's own; 280 are those of Barrett's BH8-280, for its hosts.
//!
//! A board keeps its values in its own units and translates where a value enters or leaves by a frame: positions and velocities of
//! a motor become those of a motor that moves the same joint through the other hand's gears, and its torques those that press as
//! hard at the joint. Decision 0070.
//!
//! Sources, by their public programs: libbarrett 3.0 (`products/hand.h`: finger joint 125:1, spread 17.5:1, velocities in
//! counts/ms, torques as IPNM / ratio), the property list of Barrett's API 4.4.3 for the BH8-280 (`BHandBH8_280`: ACCEL, SG and
//! temperatures), the default tables of btutil, pyHand and that API (CTS 4096, IPNM 20000, KP, KD), and OWD (`CANbus.cc`:
//! 199,111 counts for 140° of a finger and 35,840 for 180° of the spread, which are those ratios).

use super::{MotorKind, Property};

/// The value of HOSTUNITS for the units of this project.
pub const OWN: i64 = 0;

/// The value of HOSTUNITS for those of a BH8-280.
pub const BH8_280: i64 = 280;

/// How a property's values are translated: first those with a row in [`SCALES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Unit {
    /// Encoder counts, for hall counts.
    Counts,
    /// Encoder counts/ms, for hall counts/s.
    CountsPerMs,
    /// Units of the other motor's current, for 1/1024 of this one's peak torque.
    Current,
    /// KP, as a part of its default there.
    Kp,
    /// KD, as a part of its default there.
    Kd,
    /// Whole °C or V, for tenths.
    Tenths,
    /// 12 bits, for 8.
    Strain,
    /// Encoder counts of one revolution, for hall counts of it.
    Revolution,
    /// A converter's reading with zero in its middle, for mA.
    Centered,
    /// 1/256 encoder count/ms², for (ACCEL/1024)² hall counts/ms².
    Accel,
    /// [`IPNM`].
    PerNewtonMeter,
    /// The same on both sides.
    Own,
}

/// A property whose unit on the wire follows HOSTUNITS.
#[derive(Clone, Copy, Debug)]
pub struct HostUnit {
    /// The property.
    pub property: Property,
    /// Its unit in a BH8-280.
    pub theirs: &'static str,
    /// Where that is published, or why it was chosen.
    pub source: &'static str,
}

macro_rules! host_units {
    ($($name:ident = $unit:ident, $theirs:literal, $source:literal;)*) => {
        /// Every property that HOSTUNITS translates.
        pub const ROWS: &[HostUnit] = &[
            $(HostUnit { property: Property::$name, theirs: $theirs, source: $source },)*
        ];

        /// By number, without the texts, which a board does not link.
        #[allow(clippy::indexing_slicing, reason = "evaluated by the compiler, which refuses a number beyond 127")]
        static UNITS: [Unit; 128] = {
            let mut units = [Unit::Own; 128];
            $(units[Property::$name.id() as usize] = Unit::$unit;)*
            units
        };
    };
}

host_units! {
    P = Counts, "encoder counts, 4096 a motor revolution, 125 or 17.5 a joint's", "libbarrett hand.h";
    DP = Counts, "encoder counts", "API, property list";
    E = Counts, "encoder counts", "libbarrett, trapezoidalMove";
    OT = Counts, "encoder counts", "API, property list";
    CT = Counts, "encoder counts", "API, property list";
    M = Counts, "encoder counts", "API, HandGoToPosition";
    DS = Counts, "encoder counts", "API, property list";
    IOFF = Counts, "encoder counts", "API, property list";
    MPE = Counts, "encoder counts", "API, property list (a comment)";
    BP = Counts, "encoder counts", "as P; no property there";
    T = Current, "units of motor current, 20,000 a N m at the motor", "libbarrett, setTorqueCommand";
    MT = Current, "as T", "btutil, API: 2200, 3300";
    IHIT = Current, "as T", "btutil: 1700, 2200";
    BT = Current, "as T", "as T; no property there";
    V = CountsPerMs, "encoder counts/ms", "libbarrett, velocityMove";
    MV = CountsPerMs, "encoder counts/ms", "API, property list";
    MCV = CountsPerMs, "encoder counts/ms", "API, property list";
    MOV = CountsPerMs, "encoder counts/ms", "API, property list";
    IVEL = CountsPerMs, "encoder counts/ms", "API, property list; btutil: -75";
    VEL = CountsPerMs, "encoder counts/ms", "as V; no property there";
    VSET = CountsPerMs, "encoder counts/ms", "as V; no property there";
    ACCEL = Accel, "1/256 encoder count/ms2", "API, property list";
    KP = Kp, "500 there are 120 here; of the spread 1000", "btutil, pyHand: defaults; the scale is not published";
    KD = Kd, "2500 there are 640 here; of the spread 10000", "btutil, pyHand: defaults; the scale is not published";
    TEMP = Tenths, "C", "API, property list";
    PTEMP = Tenths, "C", "as TEMP";
    OTEMP = Tenths, "C; -55 disables", "API, property list; btutil: 60";
    THERM = Tenths, "C", "OWD";
    VBUS = Tenths, "V", "btutil: limits of the safety board";
    IMOTOR = Centered, "0 to 4095, 2048 is none, 10 mA a count", "12-bit converter; the scale is not published, 10 mA is chosen for ±20 A";
    SG = Strain, "0 to 4095", "API: 12 bits, of which it shows the upper 8";
    HSG = Strain, "0 to 4095; 0 disables", "API, property list";
    LSG = Strain, "0 to 4095; 0 disables", "API, property list";
    MECH = Revolution, "encoder counts", "as CTS";
    CTS = Revolution, "4096", "btutil, pyHand, API: default";
    IPNM = PerNewtonMeter, "20000", "btutil, pyHand, API: default";
}

fn unit(property: Property) -> Unit {
    UNITS.get(usize::from(property.id())).copied().unwrap_or(Unit::Own)
}

/// IPNM of this hand's motor.
const HAND_IPNM: u64 = match Property::IPNM.rules().default_for_motor(MotorKind::Link) {
    Some(units) => units as u64,
    None => 1,
};

/// IPNM of a BH8-280, units of T a N·m at its motor.
const IPNM: i32 = 20_000;

/// Encoder counts of a revolution of its motor.
const CTS: u64 = 4096;

/// Its motor's revolutions for 100 of the joint. It has no motor for the tips: they count as its fingers do, because its hosts
/// take every motor but the spread's for a finger's.
const fn gear_hundredths(kind: MotorKind) -> u64 {
    match kind {
        MotorKind::Link | MotorKind::Tip => 12_500,
        MotorKind::Spread => 1750,
    }
}

/// A factor with [`TO_HOST`] fractional bits, and its inverse with [`TO_BOARD`].
struct Scale {
    to_host: i32,
    to_board: i32,
}

/// Fractional bits of the factors 0.1 to 728.
const TO_HOST: u32 = 20;

/// Fractional bits of the factors 0.0014 to 10.
const TO_BOARD: u32 = 27;

impl Scale {
    /// `host` units there are `board` units here.
    const fn of(host: u64, board: u64) -> Self {
        Self {
            to_host: Self::quotient(host, board, TO_HOST),
            to_board: Self::quotient(board, host, TO_BOARD),
        }
    }

    /// Rounded; wraps in a direction that no value takes.
    const fn quotient(numerator: u64, denominator: u64, shift: u32) -> i32 {
        let (numerator, denominator) = ((numerator as u128) << shift, denominator as u128);
        ((numerator + denominator / 2) / denominator) as i32
    }

    const fn between(unit: Unit, kind: MotorKind) -> Self {
        let (theirs, ours) = (gear_hundredths(kind), kind.gear_hundredths() as u64);
        let rev = MotorKind::COUNTS_PER_TURN as u64;
        let is_spread = matches!(kind, MotorKind::Spread);
        match unit {
            // A turn of the joint.
            Unit::Counts => Self::of(theirs * CTS, ours * rev),
            Unit::CountsPerMs => Self::of(theirs * CTS, 1000 * ours * rev),
            // A N·m at the joint: IPNM / ratio of each.
            Unit::Current => Self::of(IPNM as u64 * ours, HAND_IPNM * theirs),
            Unit::Kp => Self::of(if is_spread { 1000 } else { 500 }, 120),
            Unit::Kd => Self::of(if is_spread { 10_000 } else { 2500 }, 640),
            _ => Self::of(1, 1),
        }
    }

    const fn of_kinds(unit: Unit) -> [Self; 3] {
        [
            Self::between(unit, MotorKind::Link),
            Self::between(unit, MotorKind::Spread),
            Self::between(unit, MotorKind::Tip),
        ]
    }

    /// Of a unit with a row.
    fn get(unit: Unit, kind: MotorKind) -> Option<&'static Self> {
        // KIND counts from 1.
        SCALES.get(unit as usize)?.get(usize::from(kind.code()).wrapping_sub(1))
    }
}

const TENTH: i32 = Scale::of(1, 10).to_host;
const REVOLUTION: i32 = Scale::of(CTS, MotorKind::COUNTS_PER_TURN as u64).to_host;

/// By unit and by kind of motor.
static SCALES: [[Scale; 3]; 5] = [
    Scale::of_kinds(Unit::Counts),
    Scale::of_kinds(Unit::CountsPerMs),
    Scale::of_kinds(Unit::Current),
    Scale::of_kinds(Unit::Kp),
    Scale::of_kinds(Unit::Kd),
];

/// The product, rounded to the nearest multiple of 2^`shift`, of which it is the number.
const fn product(value: i32, factor: i32, shift: u32) -> i64 {
    (value as i64 * factor as i64 + (1 << (shift - 1))) >> shift
}

/// OTEMP that disables the limit, here and there.
const NO_LIMIT: (i64, i32) = (-551, -55);

/// The reading of IMOTOR without a current.
const CENTER: i32 = 2048;

/// The value of HSG and LSG that no strain reaches.
const STRAIN_OFF: i64 = Property::HSG.rules().max();

/// Largest position that its 22-bit frame holds.
const FARTHEST: i32 = (1 << 21) - 1;

/// Largest ACCEL, there and here.
const MOST_ACCEL: i32 = 65_535;

/// A board's value in the units of a BH8-280.
#[must_use]
#[inline(never)]
pub fn to_host(property: Property, kind: MotorKind, value: i64) -> i64 {
    // Of what has another unit nothing is beyond 32 bits.
    let Ok(ours) = i32::try_from(value) else { return value };
    let unit = unit(property);
    let by_joint = |row| Scale::get(row, kind).map_or(0, |scale| scale.to_host);
    let (ours, factor, shift) = match unit {
        Unit::Own => return value,
        Unit::PerNewtonMeter => return IPNM.into(),
        Unit::Centered => (ours + 10 * CENTER, TENTH, TO_HOST),
        Unit::Tenths => (ours, TENTH, TO_HOST),
        Unit::Strain => (ours, 16 << TO_HOST, TO_HOST),
        Unit::Revolution => (ours, REVOLUTION, TO_HOST),
        // 256 (ACCEL / 1024)² = ACCEL² / 2^12. Above 2^11 it is beyond 16 bits of theirs on every joint.
        Unit::Accel => (ours.min(1 << 11) * ours.min(1 << 11), by_joint(Unit::Counts), TO_HOST + 12),
        Unit::Counts | Unit::CountsPerMs | Unit::Current | Unit::Kp | Unit::Kd => {
            (ours, by_joint(unit), TO_HOST)
        }
    };
    let most = if unit == Unit::Accel { MOST_ACCEL } else { FARTHEST };
    // Of the others only a position comes near it.
    product(ours, factor, shift).clamp(-i64::from(FARTHEST), most.into())
}

/// A value in the units of a BH8-280 as the board's own, rounded to the nearest. One that does not fit the board is out of the
/// property's range.
#[must_use]
#[inline(never)]
pub fn to_board(property: Property, kind: MotorKind, value: i64) -> i64 {
    let Ok(theirs) = i32::try_from(value) else { return value };
    let (unit, min) = (unit(property), property.find_rules().min());
    if theirs < 0 && min == 0 {
        // A small one would round to 0.
        return value;
    }
    let (shift, row) = match unit {
        Unit::Tenths if theirs == NO_LIMIT.1 => return NO_LIMIT.0,
        Unit::Tenths => return value * 10,
        // Up, so that 1 does not become 0, which disables. Beyond the gauge's range nothing ends a move.
        Unit::Strain => return i64::from((theirs >> 4) + i32::from(theirs & 15 != 0)).min(STRAIN_OFF),
        Unit::Accel if theirs > MOST_ACCEL => return i64::MAX,
        // The inverse of the above: the square root of 2^12 of theirs.
        Unit::Accel => (TO_BOARD - 12, Unit::Counts),
        _ => (TO_BOARD, unit),
    };
    let Some(scale) = Scale::get(row, kind) else { return value };
    let scaled = product(theirs, scale.to_board, shift);
    match unit {
        Unit::Accel => root(scaled as u32).into(),
        // Slower moves do not exist, and a refusal would leave a faster one in force.
        Unit::CountsPerMs if theirs > 0 => scaled.max(min),
        _ => scaled,
    }
}

/// The nearest integer to the square root, for 0 to 2^31.
fn root(square: u32) -> u32 {
    let mut root = 0_u32;
    for bit in (0..16).rev() {
        let next = root | 1 << bit;
        if next * next <= square {
            root = next;
        }
    }
    root + u32::from(square > root * root + root)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const KINDS: [MotorKind; 3] = [MotorKind::Link, MotorKind::Spread, MotorKind::Tip];

    #[test]
    fn defaults_of_barretts_hosts_fit_and_read_back() {
        use Property as P;
        let cases = [
            (P::MT, 2200),
            (P::IHIT, 1700),
            (P::MV, 200),
            (P::MCV, 200),
            (P::MOV, 200),
            (P::IVEL, -75),
            (P::OTEMP, 60),
            (P::KP, 500),
            (P::KD, 2500),
            (P::HSG, 0),
            (P::LSG, 0),
            (P::IOFF, 0),
            (P::OT, 0),
            (P::KP, 125),
            (P::KD, 1250),
        ];
        for kind in KINDS {
            for (property, theirs) in cases {
                let ours = to_board(property, kind, theirs);
                assert!(property.rules().admits(ours), "{property:?} {theirs} is {ours}");
                let back = to_host(property, kind, ours);
                // A unit here is 5 or 13 of the current's there.
                let unit = if matches!(property, P::MT | P::IHIT) { 7 } else { 0 };
                assert!((back - theirs).abs() <= unit, "{kind:?}: {property:?} {theirs} reads {back}");
            }
        }
        assert_eq!(to_board(P::KP, MotorKind::Link, 500), 120);
        assert_eq!(to_board(P::KD, MotorKind::Spread, 10_000), 640);
    }

    /// Whatever a value was rounded to stays: a host that writes back what it has read changes nothing.
    #[test]
    fn value_read_and_written_back_reads_the_same() {
        for kind in KINDS {
            for row in ROWS {
                let rules = row.property.rules();
                let steps = (rules.max() - rules.min()).clamp(1, 3000);
                let values = (0..=steps).map(|step| rules.min() + (rules.max() - rules.min()) * step / steps);
                for ours in values.filter(|&value| rules.admits(value)) {
                    let theirs = to_host(row.property, kind, ours);
                    let is_beyond = match unit(row.property) {
                        Unit::Counts => theirs.abs() == i64::from(FARTHEST),
                        Unit::Accel => theirs == i64::from(MOST_ACCEL),
                        // Read only.
                        Unit::Centered | Unit::PerNewtonMeter | Unit::Revolution => true,
                        _ => false,
                    };
                    let again = to_host(row.property, kind, to_board(row.property, kind, theirs));
                    assert!(
                        is_beyond || again == theirs,
                        "{kind:?}: {:?} {ours} reads {theirs}, then {again}",
                        row.property
                    );
                }
            }
        }
    }

    /// Where a unit here is finer than one there.
    #[test]
    fn value_set_reads_the_same_where_the_board_resolves_it() {
        use Property as P;
        for kind in KINDS {
            for (property, range) in [
                (P::V, -2000..=2000),
                (P::MV, 12..=800),
                (P::IVEL, -800..=800),
                (P::TEMP, -55..=125),
                (P::OTEMP, 20..=125),
                (P::VBUS, 0..=60),
            ] {
                for theirs in range {
                    let ours = to_board(property, kind, theirs);
                    assert!(
                        !property.rules().admits(ours) || to_host(property, kind, ours) == theirs,
                        "{kind:?} {property:?} {theirs}"
                    );
                }
            }
            for sixteenth in 0..=255 {
                assert_eq!(to_host(P::HSG, kind, to_board(P::HSG, kind, 16 * sixteenth)), 16 * sixteenth);
            }
            assert_eq!((to_host(P::OTEMP, kind, -551), to_board(P::OTEMP, kind, -55)), (-55, -551));
        }
    }

    #[test]
    fn values_that_do_not_fit_the_board_are_out_of_range() {
        use Property as P;
        let extremes = [i64::from(i32::MIN), -(1 << 26), 1 << 26, i64::from(i32::MAX), i64::from(u32::MAX)];
        for kind in KINDS {
            for row in ROWS {
                let rules = row.property.rules();
                for theirs in extremes {
                    let ours = to_board(row.property, kind, theirs);
                    let never_ends = unit(row.property) == Unit::Strain && theirs > 0;
                    let is_constant = matches!(row.property, P::IPNM);
                    assert!(
                        never_ends || is_constant || !rules.admits(ours),
                        "{kind:?} {:?} {theirs}: {ours}",
                        row.property
                    );
                }
                if rules.min() == 0 {
                    assert!(!rules.admits(to_board(row.property, kind, -1)), "{:?}", row.property);
                }
            }
            assert!(!P::MT.rules().admits(to_board(P::MT, kind, 22_200)), "{kind:?}");
        }
        // The slowest there is.
        assert_eq!([0, 1, 9, 10].map(|v| to_board(P::MV, MotorKind::Link, v)), [0, 16, 16, 17]);
        assert_eq!(
            [1, 15, 16, 17, 4080, 20_000].map(|v| to_board(P::HSG, MotorKind::Link, v)),
            [1, 1, 1, 2, 255, 256]
        );
        assert_eq!(to_host(P::IMOTOR, MotorKind::Tip, -1230), 2048 - 123);
    }

    /// Every property of Barrett's table in a unit that a motor's gears, its current or a converter decides.
    #[test]
    fn properties_without_a_row_have_no_unit_of_their_own() {
        let plain = ["-", "bits", "code", "id", "ms", "s", "us", "ADC", "revolutions"];
        use Property as P;
        // Gains, and what describes the motor: in the board's own units whatever its host.
        let own = [
            [P::KI, P::KPV, P::KBW, P::MKA, P::MKE, P::MFC, P::MFS, P::MR, P::MPK],
            [P::MKT, P::MJ, P::ML, P::MVN, P::MWX, P::MWJ, P::MWR, P::JLO, P::JHI],
        ];
        let missing: Vec<Property> = crate::property::ROWS
            .iter()
            .filter(|row| !plain.contains(&row.unit) && ROWS.iter().all(|own| own.property != row.property))
            .map(|row| row.property)
            .collect();
        assert!(
            missing.iter().all(|property| own.iter().flatten().any(|own| own == property)),
            "{missing:?}"
        );
        assert!(ROWS.iter().all(|row| unit(row.property) != Unit::Own));
    }
}
