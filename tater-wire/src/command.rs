//! The actions of a SET of CMD, with Barrett's numbers.

/// `Cmd = number, "NAME", "meaning";`
macro_rules! table {
    ($($cmd:ident = $number:literal, $name:literal, $meaning:literal;)*) => {
        /// A value of property CMD.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum Cmd {
            $(#[doc = $meaning] $cmd = $number,)*
        }

        /// Every command, by ascending number.
        pub const ROWS: &[CmdSpec] =
            &[$(CmdSpec { number: $number, cmd: Cmd::$cmd, name: $name, meaning: $meaning },)*];

        impl Cmd {
            /// The command of a value of CMD; `None` if there is none.
            #[must_use]
            pub const fn of(number: i64) -> Option<Self> {
                // Without the rows: a board has no room for their texts.
                match number {
                    $($number => Some(Self::$cmd),)*
                    _ => None,
                }
            }
        }
    };
}

/// A command's row.
#[derive(Clone, Copy, Debug)]
pub struct CmdSpec {
    /// Value of CMD.
    pub number: u8,
    /// The command.
    pub cmd: Cmd,
    /// Its name, as in the manual.
    pub name: &'static str,
    /// Its action.
    pub meaning: &'static str,
}

table! {
    Load = 0, "LOAD", "takes the stored values of all properties";
    Save = 1, "SAVE", "stores the present values of all properties";
    Reset = 2, "RESET", "resets into the monitor";
    Def = 3, "DEF", "resets all properties, and their stored values, to their defaults";
    Home = 7, "HOME", "moves to position 0";
    Hi = 13, "HI", "finds the stop (IVEL, IHIT), leaves it by 12 counts and returns to it, or else is jammed; goes IOFF away and calls that place 0";
    Ic = 14, "IC", "closes by DS";
    Io = 15, "IO", "opens by DS";
    Tc = 16, "TC", "closes at MCV with torque up to MT, until stalled";
    To = 17, "TO", "opens at MOV with torque up to MT, until stalled";
    C = 18, "C", "moves to CT";
    M = 19, "M", "moves to DP";
    O = 20, "O", "moves to OT, and forgets a breakaway";
    T = 21, "T", "terminates power: idle, whatever HOLD says";
}

impl Cmd {
    /// The value of CMD.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }
}

impl From<Cmd> for i64 {
    fn from(cmd: Cmd) -> Self {
        cmd.number().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Property;

    #[test]
    fn command_numbers_ascend_and_fit_the_property() {
        for pair in ROWS.windows(2) {
            assert!(pair[0].number < pair[1].number);
        }
        for row in ROWS {
            assert!(Property::CMD.row().admits(i64::from(row.number)), "{}", row.name);
            assert_eq!(Cmd::of(i64::from(row.number)), Some(row.cmd));
            assert_eq!((row.cmd.number(), i64::from(row.cmd)), (row.number, i64::from(row.number)));
        }
        assert_eq!(Cmd::of(4), None);
        assert_eq!(Cmd::of(-1), None);
    }
}
