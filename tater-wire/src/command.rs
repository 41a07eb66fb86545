//! What a SET of CMD does, by number: Barrett's numbers.

/// A value of property CMD.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cmd {
    /// All properties from storage.
    Load,
    /// All properties to storage.
    Save,
    /// Resets into the monitor.
    Reset,
    /// All properties, and their stored values, to their defaults.
    Def,
    /// Moves to position 0.
    Home,
    /// Hand initialize: finds the stop, goes to zero, calls it zero.
    Hi,
    /// Closes by the default step DS.
    Ic,
    /// Opens by the default step DS.
    Io,
    /// Closes under torque control.
    Tc,
    /// Opens under torque control.
    To,
    /// Moves to the close target CT.
    C,
    /// Moves to the default position DP.
    M,
    /// Moves to the open target OT, and forgets a breakaway.
    O,
    /// Terminates power.
    T,
}

/// A command's row.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Value of CMD.
    pub number: u8,
    /// Which.
    pub cmd: Cmd,
    /// Its name, as in the manual.
    pub name: &'static str,
    /// What it does.
    pub meaning: &'static str,
}

const fn row(number: u8, cmd: Cmd, name: &'static str, meaning: &'static str) -> Row {
    Row { number, cmd, name, meaning }
}

/// Every command, by rising number.
pub const ROWS: &[Row] = &[
    row(0, Cmd::Load, "LOAD", "takes the stored values of all properties"),
    row(1, Cmd::Save, "SAVE", "stores the present values of all properties"),
    row(2, Cmd::Reset, "RESET", "resets into the monitor"),
    row(3, Cmd::Def, "DEF", "resets all properties, and their stored values, to their defaults"),
    row(7, Cmd::Home, "HOME", "moves to position 0"),
    row(13, Cmd::Hi, "HI", "finds the stop (IVEL, IHIT), leaves it by IOFF, and calls the place 0"),
    row(14, Cmd::Ic, "IC", "closes by DS"),
    row(15, Cmd::Io, "IO", "opens by DS"),
    row(16, Cmd::Tc, "TC", "closes at MCV with torque up to MT, until stalled"),
    row(17, Cmd::To, "TO", "opens at MOV with torque up to MT, until stalled"),
    row(18, Cmd::C, "C", "moves to CT"),
    row(19, Cmd::M, "M", "moves to DP"),
    row(20, Cmd::O, "O", "moves to OT, and forgets a breakaway"),
    row(21, Cmd::T, "T", "terminates power: idle, whatever HOLD says"),
];

impl Cmd {
    /// The value of CMD.
    #[must_use]
    pub fn number(self) -> u8 {
        // Every command has its row (tested).
        ROWS.iter().find(|row| row.cmd == self).map_or(0, |row| row.number)
    }

    /// The command of a value of CMD; `None` if there is none.
    #[must_use]
    pub fn of(number: i64) -> Option<Self> {
        ROWS.iter().find(|row| i64::from(row.number) == number).map(|row| row.cmd)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Property;

    #[test]
    fn numbers_rise_and_fit_the_property() {
        for pair in ROWS.windows(2) {
            assert!(pair[0].number < pair[1].number);
        }
        for row in ROWS {
            assert!(Property::CMD.row().admits(i64::from(row.number)), "{}", row.name);
            assert_eq!(Cmd::of(i64::from(row.number)), Some(row.cmd));
            assert_eq!(row.cmd.number(), row.number);
        }
        assert_eq!(Cmd::of(4), None);
        assert_eq!(Cmd::of(-1), None);
    }
}
