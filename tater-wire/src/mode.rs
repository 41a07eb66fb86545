//! The values of MODE, Barrett's numbers. 1 was the duty mode of older boards; a SET of it is refused.

/// `Mode = number, "NAME", "meaning";`
macro_rules! table {
    ($($mode:ident = $number:literal, $name:literal, $meaning:literal;)*) => {
        /// A value of property MODE.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum ModeCode {
            $(#[doc = $meaning] $mode = $number,)*
        }

        /// Every mode, by ascending number.
        pub const ROWS: &[ModeSpec] =
            &[$(ModeSpec { code: ModeCode::$mode, name: $name, meaning: $meaning },)*];

        impl ModeCode {
            /// The mode of a value of MODE; `None` for 1 and for values outside 0..=5.
            #[must_use]
            pub const fn of(number: i64) -> Option<Self> {
                match number {
                    $($number => Some(Self::$mode),)*
                    _ => None,
                }
            }
        }
    };
}

/// A mode's row.
#[derive(Clone, Copy, Debug)]
pub struct ModeSpec {
    /// The mode.
    pub code: ModeCode,
    /// Its name.
    pub name: &'static str,
    /// What the motor does in it.
    pub meaning: &'static str,
}

table! {
    Idle = 0, "idle", "bridge off, brake engaged";
    Torque = 2, "torque", "drives with torque T";
    Pid = 3, "position", "holds or follows position P by the PID loop";
    Velocity = 4, "velocity", "follows velocity V with gain KPV";
    Trapezoidal = 5, "move", "moves to E with a trapezoidal velocity profile";
}

impl ModeCode {
    /// The value of MODE.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }
}

impl From<ModeCode> for i64 {
    fn from(code: ModeCode) -> Self {
        code.number().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_inverts_number_and_refuses_the_rest() {
        for number in -1..=6 {
            let listed = ROWS.iter().find(|row| i64::from(row.code.number()) == number).map(|row| row.code);
            assert_eq!(ModeCode::of(number), listed, "{number}");
            assert!(listed.is_none_or(|code| i64::from(code) == number), "{number}");
        }
        assert_eq!(ModeCode::of(1), None);
    }
}
