//! The table of commands (manual 5.2): name, arguments, category, help. Parser, help and dispatch use it.

/// The manual's section of a command (5.2.1 to 5.2.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Category {
    /// 5.2.1.
    Movement,
    /// 5.2.2.
    MotorParameters,
    /// 5.2.3.
    GlobalParameters,
    /// 5.2.4.
    Sequences,
    /// 5.2.5.
    Administration,
    /// 5.2.6: `?` does not list them.
    Advanced,
}

/// A command's row.
#[derive(Clone, Copy, Debug)]
pub struct CommandSpec {
    /// Its name, as typed.
    pub name: &'static str,
    /// The command.
    pub command: GclCommand,
    /// Its category.
    pub category: Category,
    /// Whether it takes a motor prefix.
    pub prefix: bool,
    /// Its arguments, as help shows them; `[]` around those that may be missing.
    pub arguments: &'static str,
    /// Help text.
    pub help: &'static str,
}

/// `Command = "NAME", category, takes a prefix, "arguments", "help";`
macro_rules! table {
    ($($command:ident = $name:literal, $category:ident, $prefix:literal, $arguments:literal, $help:literal;)*) => {
        /// A command.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum GclCommand {
            $(#[doc = $help] $command,)*
        }

        /// Every command, in the manual's order.
        pub const ROWS: &[CommandSpec] = &[$(CommandSpec {
            name: $name,
            command: GclCommand::$command,
            category: Category::$category,
            prefix: $prefix,
            arguments: $arguments,
            help: $help,
        },)*];
    };
}

table! {
    C = "C", Movement, true, "", "closes to CT, or until it is stopped";
    Hi = "HI", Movement, true, "", "finds the stops, and so where the motors are; then goes to 0";
    Home = "HOME", Movement, true, "", "moves to position 0";
    Io = "IO", Movement, true, "[counts 0..20000]", "opens by so many counts, or by DS";
    Ic = "IC", Movement, true, "[counts 0..20000]", "closes by so many counts, or by DS";
    Loop = "LOOP", Movement, true, "", "begins RealTime control; ^C ends it";
    M = "M", Movement, true, "[position 0..20000]", "moves to a position in counts, or to DP";
    Mdeg = "MDEG", Movement, true, "[degrees]", "moves a joint to an angle, or to DP (counts)";
    Mper = "MPER", Movement, true, "[percent]", "moves to a percentage of CT, or to DP (counts)";
    O = "O", Movement, true, "", "opens to OT, or until it is stopped; forgets a breakaway";
    Ptm = "PTM", Movement, true, "[counts -20000..20000]", "moves tips by so many counts, or DS, so that parallel ones stay parallel";
    T = "T", Movement, true, "", "switches the motors' power off";
    Tc = "TC", Movement, true, "", "closes with limited torque until stalled";
    To = "TO", Movement, true, "", "opens with limited torque until stalled";
    Wm = "WM", Movement, true, "[position 0..20000]", "moves links to a position in counts, or DP, while the tips keep their direction";
    Fset = "FSET", MotorParameters, true, "<name> <value> ...", "sets parameters of motors; without a prefix EN of all";
    Fget = "FGET", MotorParameters, true, "<name> ...", "prints parameters of motors";
    Fload = "FLOAD", MotorParameters, true, "", "takes the stored parameters of motors";
    Fsave = "FSAVE", MotorParameters, true, "", "stores the parameters of motors";
    Fdef = "FDEF", MotorParameters, true, "", "sets the parameters of motors to their defaults; without a prefix EN of all, so that disabled ones move again";
    Flist = "FLIST", MotorParameters, false, "", "lists the motor parameters";
    Flistv = "FLISTV", MotorParameters, true, "", "lists the motor parameters with their values";
    Pset = "PSET", GlobalParameters, false, "<name> <value> ...", "sets parameters of the hand";
    Pget = "PGET", GlobalParameters, false, "<name> ...", "prints parameters of the hand";
    Pload = "PLOAD", GlobalParameters, false, "", "takes the stored parameters of the hand";
    Psave = "PSAVE", GlobalParameters, false, "", "stores the parameters of the hand";
    Pdef = "PDEF", GlobalParameters, false, "", "sets the parameters of the hand to their defaults";
    Plist = "PLIST", GlobalParameters, false, "", "lists the hand's parameters";
    Plistv = "PLISTV", GlobalParameters, false, "", "lists the hand's parameters with their values";
    Mac = "MAC", Sequences, true, "<macro 0..19>", "moves to the positions of a macro";
    Macset = "MACSET", Sequences, false, "<macro 0..19>", "stores the present positions as a macro";
    Rec = "REC", Sequences, false, "[sequence 0..5]", "begins to record commands; without a number ends that, or records sequence 0";
    Play = "PLAY", Sequences, false, "[sequence 0..5]", "does the recorded commands, of sequence 0 without a number";
    Wait = "WAIT", Sequences, false, "<milliseconds>", "does nothing for so long";
    Help = "?", Administration, false, "[command]", "lists the commands, or tells what one does";
    Reset = "RESET", Administration, false, "", "starts the hand's software anew";
    Err = "ERR", Administration, false, "[number]", "tells what a status means, or what there are";
    Vers = "VERS", Administration, false, "", "prints the version of the software";
    HelpAll = "A?", Advanced, false, "", "lists the commands, the advanced ones as well";
    Flista = "FLISTA", Advanced, false, "", "lists the motor parameters, the advanced ones as well";
    Flistav = "FLISTAV", Advanced, true, "", "lists the motor parameters with their values, the advanced ones as well";
    Plista = "PLISTA", Advanced, false, "", "lists the hand's parameters, the advanced ones as well";
    Plistav = "PLISTAV", Advanced, false, "", "lists the hand's parameters with their values, the advanced ones as well";
}

/// The command of that name, in upper case.
#[must_use]
pub fn find(name: &str) -> Option<GclCommand> {
    ROWS.iter().find(|row| row.name == name).map(|row| row.command)
}

impl GclCommand {
    /// Its row in the table.
    #[must_use]
    pub fn row(self) -> Option<&'static CommandSpec> {
        ROWS.iter().find(|row| row.command == self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motors::Prefix;

    #[test]
    fn names_are_unique_and_none_begins_with_a_prefix() {
        for (i, row) in ROWS.iter().enumerate() {
            assert_eq!(find(row.name), Some(row.command), "{}", row.name);
            assert!(ROWS[..i].iter().all(|other| other.name != row.name));
            assert_eq!(row.command.row().map(|row| row.name), Some(row.name));
            // Or a line could be read in two ways.
            assert_eq!(Prefix::parse(&row.name.as_bytes()[..1]), None, "{}", row.name);
            assert!(!row.help.is_empty());
        }
    }
}
