//! Barrett's table of motor properties, where it differs from this project's: names that hosts list. Units: [`super::host_units`].
//!
//! As in libbarrett and pyHand, whose newest tables for motors end at 108.

/// Numbers below this are Barrett's. A GET of each is answered, because some hosts wait for an answer without a time limit.
pub const BARRETTS: u8 = 109;

/// The numbers of [`ABSENT`] that are 32 bits wide there.
pub(crate) const WIDE: [u8; 2] = [96, 98];

/// A name of Barrett's table that no property here has. It reads 0, and a SET of it changes nothing.
#[derive(Clone, Copy, Debug)]
pub struct Absent {
    /// Number on the wire.
    pub id: u8,
    /// Barrett's name.
    pub name: &'static str,
    /// What it is there, and what serves here in its place.
    pub meaning: &'static str,
}

macro_rules! absent {
    ($($name:literal = $id:literal, $meaning:literal;)*) => {
        &[$(Absent { id: $id, name: $name, meaning: $meaning },)*]
    };
}

/// Every name of Barrett's table without a property here, by ascending number.
pub const ABSENT: &[Absent] = absent! {
    "ADDR" = 6, "address for VALUE; memory cannot be read here";
    "VALUE" = 7, "memory at ADDR; reads 0 always";
    "BAUD" = 12, "baud rate of the board's serial port; there is none";
    "DIG0" = 14, "digital input; there is none";
    "DIG1" = 15, "digital input; there is none";
    "FET1, TENSION" = 17, "output of the arm's cable tensioner; there is none";
    "VLOGIC" = 23, "logic supply voltage; not measured";
    "ILOGIC" = 24, "logic supply current; not measured";
    "MOFST" = 61, "offset of the motor's encoder; the halls need none";
    "IOFST" = 62, "offset of the current sensor; corrected at each start";
    "MDS" = 65, "step of a move; see DS";
    "TENST" = 83, "tensioning of the arm's cables; there is none";
    "TENSO" = 84, "tensioning of the arm's cables; there is none";
    "IKP" = 91, "gain of the current loop; torque is set by voltage here";
    "IKI" = 92, "gain of the current loop; torque is set by voltage here";
    "IKCOR" = 93, "correction of the current loop; torque is set by voltage here";
    "JP" = 96, "position of the joint's encoder; there is none";
    "JOFST" = 98, "offset of the joint's encoder; there is none";
    "TIE" = 100, "ties the tip's motion to the link's; GOD does that";
    "ECMAX" = 101, "correction of the encoder; the halls need none";
    "ECMIN" = 102, "correction of the encoder; the halls need none";
    "LFLAGS" = 103, "flags of LOOP; LFLAGS of this board is 116 and means something else";
    "LCTC" = 104, "coefficient of LOOP; a parameter of GOD";
    "TACT" = 106, "tactile array; there is none";
    "TACTID" = 107, "number of the tactile array; there is none";
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Property;
    use std::vec::Vec;

    #[test]
    fn absent_numbers_ascend_are_barretts_and_have_no_row() {
        for pair in ABSENT.windows(2) {
            assert!(pair[0].id < pair[1].id, "{} {}", pair[0].name, pair[1].name);
        }
        for row in ABSENT {
            assert!(row.id < BARRETTS && Property::of(row.id).is_none(), "{}", row.name);
        }
        assert!(WIDE.iter().all(|wide| ABSENT.iter().any(|row| row.id == *wide)));
    }

    /// The rest are the upper halves of 32-bit properties.
    #[test]
    fn every_number_of_barretts_table_is_a_row_or_absent() {
        let half =
            |id: u8| Property::of(id - 1).is_some_and(|p| p.rules().bits == 32) || WIDE.contains(&(id - 1));
        let missing: Vec<u8> = (0..BARRETTS)
            .filter(|&id| Property::of(id).is_none() && ABSENT.iter().all(|row| row.id != id) && !half(id))
            .collect();
        assert_eq!(missing, []);
    }
}
