//! The values of END: why the last motion ended. 0 means that it has not ended, or that there was none.

/// `Reason = number, "meaning";`
macro_rules! table {
    ($($end:ident = $number:literal, $meaning:literal;)*) => {
        /// A value of property END other than 0.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum EndCode {
            $(#[doc = $meaning] $end = $number,)*
        }

        /// Every reason, by ascending number.
        pub const ROWS: &[EndSpec] = &[$(EndSpec { code: EndCode::$end, meaning: $meaning },)*];

        impl EndCode {
            /// The reason of a value of END; `None` for 0 and for values above the last.
            #[must_use]
            pub const fn of(number: i64) -> Option<Self> {
                match number {
                    $($number => Some(Self::$end),)*
                    _ => None,
                }
            }
        }
    };
}

/// A reason's row.
#[derive(Clone, Copy, Debug)]
pub struct EndSpec {
    /// The reason.
    pub code: EndCode,
    /// What happened.
    pub meaning: &'static str,
}

table! {
    Arrived = 1, "arrived: the profile has ended and the position error is at most MPE";
    Stalled = 2, "stalled: no hall count for TSTOP";
    Aborted = 3, "aborted by the host: another MODE or command during the move";
    Strain = 4, "strain outside LSG..HSG";
    Breakaway = 5, "the link met an object (breakaway)";
    Fault = 6, "a fault, see ERROR";
}

impl EndCode {
    /// The value of END.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }
}

impl From<EndCode> for i64 {
    fn from(code: EndCode) -> Self {
        code.number().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Property;

    #[test]
    fn of_inverts_number_within_the_propertys_range() {
        let rules = Property::END.rules();
        for number in rules.min()..=rules.max() {
            assert_eq!(EndCode::of(number).map_or(0, EndCode::number), number as u8, "{number}");
        }
        assert_eq!(ROWS.len() as i64, rules.max());
        assert_eq!(EndCode::of(7), None);
        for row in ROWS {
            assert_eq!(i64::from(row.code), i64::from(row.code.number()), "as a property's value");
        }
    }
}
