//! The byte format of GOD's memory.
//!
//! All numbers little-endian, one after the other:
//!
//! | bytes | content |
//! |---|---|
//! | 2 | [`VERSION`] |
//! | 7 × (10 + 5 × 4) | of each motor the parameters of [`Kept`](crate::parameter::Kept), then the counts as they were set |
//! | 2, 1, 2, 1, 1 | BAUD, LFT, OTEMP, LFDPD, whether COMPAT is 262 |
//! | 20 × (1 + 7 × 4) | of each macro whether there is one, and positions |
//! | 6 × (1 + 150) | of each sequence its length, and its text with zeros after it |
//! | 4, 2, 4 | SN, PTEMP, UPSECS |
//! | 4 | CRC-32 (ISO-HDLC) of the bytes before it |
//!
//! Version 1 has no COMPAT, and no LCT at the end of each motor's parameters; both are 0 then.

use heapless::String;
use tater_wire::image::Crc32;

use super::{HandParameters, MACROS, MotorParameters, Positions, SEQUENCE, SEQUENCES, Stored};
use crate::motors::COUNT;
use crate::parameter::{self, BAUDS, COUNTS, HAND, HandParameter, KEPT, Source};

/// Version of the layout: a hand reads this one and 1.
pub const VERSION: u16 = 2;

/// LCT of seven motors and COMPAT.
const NEW_IN_2: usize = COUNT + 1;

const CRC: usize = 4;

/// Length in bytes.
pub const LEN: usize = 2
    + COUNT * (KEPT + COUNTS * 4)
    + (2 + 1 + 2 + 1 + 1)
    + MACROS * (1 + COUNT * 4)
    + SEQUENCES * (1 + SEQUENCE)
    + (4 + 2 + 4)
    + CRC;

/// Why bytes cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damaged {
    /// Not [`LEN`] bytes.
    Length {
        /// Bytes.
        found: usize,
    },
    /// Written by another version.
    Version {
        /// Its number.
        found: u16,
    },
    /// The CRC-32 does not agree.
    Crc {
        /// Computed.
        found: u32,
        /// In the bytes.
        expected: u32,
    },
    /// A value is out of range.
    Value {
        /// The name of the parameter, or of another field.
        of: &'static str,
    },
}

impl core::fmt::Display for Damaged {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Length { found } => write!(f, "{found} bytes, expected {LEN}"),
            Self::Version { found } => {
                write!(f, "written as version {found}, expected {VERSION}; delete it to begin with defaults")
            }
            Self::Crc { found, expected } => {
                write!(f, "the CRC-32 is {found:#010x}, but the bytes say {expected:#010x}")
            }
            Self::Value { of } => write!(f, "the value of {of} is out of range"),
        }
    }
}

impl core::error::Error for Damaged {}

impl Stored {
    /// Serializes it.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; LEN] {
        let mut to = Writer { bytes: [0; LEN], at: 0 };
        to.put(&VERSION.to_le_bytes());
        for motor in &self.parameters.motors {
            to.put(&motor.kept);
            motor.as_set.iter().for_each(|counts| to.put(&counts.to_le_bytes()));
        }
        let HandParameters { baud, lft, otemp, lfdpd, compat_262 } = self.parameters.hand;
        to.put(&baud.to_le_bytes());
        to.put(&[lft.into()]);
        to.put(&otemp.to_le_bytes());
        to.put(&[lfdpd.into(), compat_262.into()]);
        for positions in &self.macros {
            to.put(&[positions.is_some().into()]);
            positions.unwrap_or_default().iter().for_each(|counts| to.put(&counts.to_le_bytes()));
        }
        for sequence in &self.sequences {
            to.put(&[u8::try_from(sequence.len()).unwrap_or(u8::MAX)]);
            to.put(sequence.as_bytes());
            (sequence.len()..SEQUENCE).for_each(|_| to.put(&[0]));
        }
        to.put(&self.serial.to_le_bytes());
        to.put(&self.peak_temperature.to_le_bytes());
        to.put(&self.up_seconds.to_le_bytes());
        let crc = crc(to.bytes.get(..to.at).unwrap_or(&[]));
        to.put(&crc.to_le_bytes());
        to.bytes
    }

    /// Parses bytes of [`Stored::to_bytes`].
    ///
    /// # Errors
    /// The first defect found.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Damaged> {
        let length = Damaged::Length { found: bytes.len() };
        let (content, sum) = bytes.split_last_chunk::<CRC>().ok_or(length)?;
        let mut from = Reader { left: content, version: VERSION };
        from.version = u16::from_le_bytes(from.take()?);
        let expected = match from.version {
            VERSION => LEN,
            1 => LEN - NEW_IN_2,
            found => return Err(Damaged::Version { found }),
        };
        if bytes.len() != expected {
            return Err(length);
        }
        let (found, expected) = (crc(content), u32::from_le_bytes(*sum));
        if found != expected {
            return Err(Damaged::Crc { found, expected });
        }
        let mut stored = Self::default();
        for motor in &mut stored.parameters.motors {
            *motor = from.motor()?;
        }
        stored.parameters.hand = from.hand()?;
        for positions in &mut stored.macros {
            *positions = from.positions()?;
        }
        for sequence in &mut stored.sequences {
            *sequence = from.sequence()?;
        }
        stored.serial = u32::from_le_bytes(from.take()?);
        stored.peak_temperature = i16::from_le_bytes(from.take()?);
        stored.up_seconds = u32::from_le_bytes(from.take()?);
        Ok(stored)
    }
}

fn crc(bytes: &[u8]) -> u32 {
    let mut crc = Crc32::default();
    crc.update(bytes);
    crc.finish()
}

struct Writer {
    bytes: [u8; LEN],
    at: usize,
}

impl Writer {
    fn put(&mut self, bytes: &[u8]) {
        // LEN is the sum of all fields.
        if let Some(to) = self.bytes.get_mut(self.at..self.at + bytes.len()) {
            to.copy_from_slice(bytes);
        }
        self.at += bytes.len();
    }
}

struct Reader<'a> {
    left: &'a [u8],
    version: u16,
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], Damaged> {
        let (first, left) =
            self.left.split_first_chunk().ok_or(Damaged::Length { found: LEN - self.left.len() })?;
        self.left = left;
        Ok(*first)
    }

    fn flag(&mut self, of: &'static str) -> Result<bool, Damaged> {
        match self.take()? {
            [0] => Ok(false),
            [1] => Ok(true),
            [_] => Err(Damaged::Value { of }),
        }
    }

    fn motor(&mut self) -> Result<MotorParameters, Damaged> {
        let [lcv, lcvc, lcpg, lfv, lfvc, lfs, lfap, lfdp, lfdpc] = self.take()?;
        let [lct] = if self.version > 1 { self.take()? } else { [0] };
        let kept = [lcv, lcvc, lcpg, lfv, lfvc, lfs, lfap, lfdp, lfdpc, lct];
        let mut as_set = [0; COUNTS];
        for counts in &mut as_set {
            *counts = i32::from_le_bytes(self.take()?);
        }
        let motor = MotorParameters { kept, as_set };
        for row in parameter::MOTOR {
            let value = match row.source {
                Source::Kept { kept, .. } => motor.value(kept).into(),
                Source::Counts { place, .. } => {
                    motor.as_set.get(usize::from(place)).copied().unwrap_or(0).into()
                }
                Source::Board(_) | Source::Measured(_) | Source::Status | Source::Fixed(_) => continue,
            };
            let (min, max) = row.limits(true);
            if !(min..=max).contains(&value) {
                return Err(Damaged::Value { of: row.name });
            }
        }
        Ok(motor)
    }

    fn hand(&mut self) -> Result<HandParameters, Damaged> {
        let hand = HandParameters {
            baud: u16::from_le_bytes(self.take()?),
            lft: self.flag("LFT")?,
            otemp: i16::from_le_bytes(self.take()?),
            lfdpd: self.flag("LFDPD")?,
            compat_262: self.version > 1 && self.flag("COMPAT")?,
        };
        let otemp = HAND.iter().find(|row| row.parameter == HandParameter::Otemp);
        if !BAUDS.contains(&hand.baud.into()) {
            return Err(Damaged::Value { of: "BAUD" });
        }
        if !otemp.is_some_and(|row| (row.min..=row.max).contains(&hand.otemp.into())) {
            return Err(Damaged::Value { of: "OTEMP" });
        }
        Ok(hand)
    }

    fn positions(&mut self) -> Result<Option<Positions>, Damaged> {
        let is_set = self.flag("a macro")?;
        let mut positions = Positions::default();
        for counts in &mut positions {
            *counts = i32::from_le_bytes(self.take()?);
        }
        Ok(is_set.then_some(positions))
    }

    fn sequence(&mut self) -> Result<String<SEQUENCE>, Damaged> {
        let none = Damaged::Value { of: "a sequence" };
        let [len] = self.take()?;
        let text: [u8; SEQUENCE] = self.take()?;
        let text = text.get(..usize::from(len)).filter(|text| text.is_ascii()).ok_or(none)?;
        let text = core::str::from_utf8(text).map_err(|_| none)?;
        String::try_from(text).map_err(|_| none)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn motor_parameters() -> impl Strategy<Value = MotorParameters> {
        let rows: Vec<_> = parameter::MOTOR.iter().map(|row| row.min()..=row.max()).collect();
        rows.prop_map(|values| {
            let mut of = MotorParameters { kept: [0; KEPT], as_set: [0; COUNTS] };
            for (row, value) in parameter::MOTOR.iter().zip(values) {
                match row.source {
                    Source::Kept { kept, .. } => of.set(kept, value),
                    Source::Counts { place, .. } => of.as_set[usize::from(place)] = value.try_into().unwrap(),
                    _ => {}
                }
            }
            of
        })
    }

    fn stored() -> impl Strategy<Value = Stored> {
        let motors = proptest::collection::vec(motor_parameters(), COUNT);
        let hand = (0..BAUDS.len(), any::<bool>(), -551..=1250_i16, any::<bool>(), any::<bool>());
        let macros = proptest::collection::vec(any::<Option<Positions>>(), MACROS);
        let sequences = proptest::collection::vec("[ -~\r]{0,150}", SEQUENCES);
        (motors, hand, macros, sequences, any::<(u32, i16, u32)>()).prop_map(
            |(motors, (baud, lft, otemp, lfdpd, compat_262), macros, sequences, (serial, peak, up))| {
                let mut stored = Stored::default();
                stored.parameters.motors = motors.try_into().unwrap();
                let baud = BAUDS[baud].try_into().unwrap();
                stored.parameters.hand = HandParameters { baud, lft, otemp, lfdpd, compat_262 };
                stored.macros = macros.try_into().unwrap();
                for (to, text) in stored.sequences.iter_mut().zip(&sequences) {
                    *to = String::try_from(text.as_str()).unwrap();
                }
                (stored.serial, stored.peak_temperature, stored.up_seconds) = (serial, peak, up);
                stored
            },
        )
    }

    fn sealed(mut bytes: [u8; LEN]) -> [u8; LEN] {
        let sum = crc(&bytes[..LEN - CRC]);
        bytes[LEN - CRC..].copy_from_slice(&sum.to_le_bytes());
        bytes
    }

    proptest! {
        #[test]
        fn to_bytes_and_from_bytes_are_inverse(stored in stored()) {
            prop_assert_eq!(Stored::from_bytes(&stored.to_bytes()), Ok(stored));
        }

        #[test]
        fn flipped_bit_is_an_error(stored in stored(), at in 0..LEN * 8) {
            let mut bytes = stored.to_bytes();
            bytes[at / 8] ^= 1 << (at % 8);
            prop_assert!(Stored::from_bytes(&bytes).is_err());
        }

        #[test]
        fn arbitrary_bytes_are_an_error_or_round_trip(
            mut bytes in proptest::collection::vec(any::<u8>(), LEN),
            like in stored(),
            mutations in proptest::collection::vec((0..LEN, any::<u8>()), 0..3),
        ) {
            bytes[..2].copy_from_slice(&VERSION.to_le_bytes());
            let mut near = like.to_bytes();
            mutations.into_iter().for_each(|(at, byte)| near[at] = byte);
            for bytes in [sealed(bytes.try_into().unwrap()), sealed(near)] {
                if let Ok(stored) = Stored::from_bytes(&bytes) {
                    prop_assert_eq!(Stored::from_bytes(&stored.to_bytes()), Ok(stored));
                }
            }
        }
    }

    #[test]
    fn value_out_of_range_names_its_field() {
        let hand = 2 + COUNT * (KEPT + COUNTS * 4);
        let macros = hand + 7;
        let sequences = macros + MACROS * 29;
        let rows: [(usize, &[u8], &str); 13] = [
            (2, &[2], "LCV"),
            (2 + 6, &[3], "LFAP"),
            (2 + 30 + 4, &[0], "LFVC"),
            (2 + 9, &[2], "LCT"),
            (2 + KEPT, &32_768_i32.to_le_bytes(), "DP"),
            (hand, &[97, 0], "BAUD"),
            (hand + 2, &[2], "LFT"),
            (hand + 3, &1251_i16.to_le_bytes(), "OTEMP"),
            (hand + 5, &[255], "LFDPD"),
            (hand + 6, &[2], "COMPAT"),
            (macros + 29, &[2], "a macro"),
            (sequences, &[151], "a sequence"),
            (sequences, &[1, 0x80], "a sequence"),
        ];
        for (at, bytes, of) in rows {
            let mut whole = Stored::default().to_bytes();
            whole[at..at + bytes.len()].copy_from_slice(bytes);
            assert_eq!(Stored::from_bytes(&sealed(whole)), Err(Damaged::Value { of }), "{at}");
        }
    }

    #[test]
    fn wrong_length_version_or_sum_is_an_error() {
        let whole = Stored::default().to_bytes();
        for len in [0, 1, LEN - 1] {
            assert_eq!(Stored::from_bytes(&whole[..len]), Err(Damaged::Length { found: len }));
        }
        let mut other = whole;
        other[0] = 3;
        assert_eq!(Stored::from_bytes(&sealed(other)), Err(Damaged::Version { found: 3 }));
        let mut other = whole;
        other[LEN - 1] ^= 1;
        assert!(matches!(Stored::from_bytes(&other), Err(Damaged::Crc { .. })));
    }

    #[test]
    fn version_1_is_read_without_compat_and_lct() {
        let mut stored = Stored { serial: 7, ..Stored::default() };
        stored.parameters.hand.baud = 384;
        let whole = stored.to_bytes();
        let hand = 2 + COUNT * (KEPT + COUNTS * 4);
        let is_old = |at: &usize| *at != hand + 6 && !(*at >= 2 && *at < hand && (at - 2) % 30 == KEPT - 1);
        let mut old: Vec<u8> = (0..LEN - CRC).filter(is_old).map(|at| whole[at]).collect();
        assert_eq!(old.len(), LEN - CRC - NEW_IN_2);
        old[0] = 1;
        old.extend(crc(&old).to_le_bytes());
        assert_eq!(Stored::from_bytes(&old), Ok(stored));
    }

    #[test]
    fn layout_is_the_tables() {
        assert_eq!(LEN, 2 + 7 * 30 + 7 + 20 * 29 + 6 * 151 + 10 + 4);
        let mut stored =
            Stored { serial: 0x0102_0304, peak_temperature: -2, up_seconds: 5, ..Stored::default() };
        stored.macros[1] = Some([1, 2, 3, 4, 5, 6, -7]);
        stored.sequences[0] = String::try_from("C\r").unwrap();
        let bytes = stored.to_bytes();
        assert_eq!(bytes[..12], [2, 0, 1, 8, 1, 1, 8, 1, 1, 1, 1, 0]);
        assert_eq!(bytes[12..20], [0x34, 0x21, 0, 0, 0x78, 5, 0, 0], "DP 8500, DS 1400");
        assert_eq!(bytes[212..219], [96, 0, 0, 0xD9, 0xFD, 0, 0], "BAUD 96, LFT 0, OTEMP -551");
        assert_eq!(bytes[219 + 29..][..9], [1, 1, 0, 0, 0, 2, 0, 0, 0]);
        assert_eq!(bytes[219 + 580..][..5], [2, b'C', b'\r', 0, 0]);
        assert_eq!(bytes[LEN - 14..LEN - 4], [4, 3, 2, 1, 0xFE, 0xFF, 5, 0, 0, 0]);
    }

    #[test]
    fn damage_is_explained() {
        for (damage, text) in [
            (Damaged::Length { found: 3 }, std::format!("3 bytes, expected {LEN}")),
            (
                Damaged::Version { found: 7 },
                "written as version 7, expected 2; delete it to begin with defaults".into(),
            ),
            (
                Damaged::Crc { found: 1, expected: 2 },
                "the CRC-32 is 0x00000001, but the bytes say 0x00000002".into(),
            ),
            (Damaged::Value { of: "LCV" }, "the value of LCV is out of range".into()),
        ] {
            assert_eq!(std::format!("{damage}"), text);
        }
    }
}
