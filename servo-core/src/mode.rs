//! The control modes of the manual (property MODE) and the table of which command each mode takes.

use crate::command::Command;

/// What a motor is doing. Numbers are the property's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// 0: bridge off, brake engaged.
    #[default]
    Idle,
    /// 2: torque as commanded by T.
    Torque,
    /// 3: hold or follow the position P.
    Pid,
    /// 4: velocity V with proportional gain (RealTime, TC, TO).
    Velocity,
    /// 5: trapezoidal move to E.
    Trapezoidal,
}

impl Mode {
    /// All modes, for tests and tables.
    pub const ALL: [Self; 5] = [Self::Idle, Self::Torque, Self::Pid, Self::Velocity, Self::Trapezoidal];

    /// The property value.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::Idle => 0,
            Self::Torque => 2,
            Self::Pid => 3,
            Self::Velocity => 4,
            Self::Trapezoidal => 5,
        }
    }

    /// The mode of a property value; `None` for 1 (duty, refused by the manual's firmware too) and above 5.
    #[must_use]
    pub const fn from_number(number: i32) -> Option<Self> {
        match number {
            0 => Some(Self::Idle),
            2 => Some(Self::Torque),
            3 => Some(Self::Pid),
            4 => Some(Self::Velocity),
            5 => Some(Self::Trapezoidal),
            _ => None,
        }
    }
}

/// The mode table: whether a command means something in a mode.
///
/// V and E may be written before the mode that uses them (hosts write V, then MODE 4). T starts at 0 with
/// mode 2, so it is refused elsewhere; P is a command in mode 3, redefines the position in idle, and would
/// pull the rug from under a motion in any other mode.
#[must_use]
pub const fn admits(mode: Mode, command: &Command) -> bool {
    match command {
        Command::Torque(_) => match mode {
            Mode::Torque => true,
            Mode::Idle | Mode::Pid | Mode::Velocity | Mode::Trapezoidal => false,
        },
        Command::Position(_) => match mode {
            Mode::Idle | Mode::Pid => true,
            Mode::Torque | Mode::Velocity | Mode::Trapezoidal => false,
        },
        Command::Mode(_)
        | Command::Velocity(_)
        | Command::End(_)
        | Command::Move(_)
        | Command::TorqueControlled { .. }
        | Command::Home
        | Command::Abort
        | Command::Terminate
        | Command::Configure(_)
        | Command::ClearFault
        | Command::ClearBreakaway => true,
    }
}
