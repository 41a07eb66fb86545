//! The servo's inputs and outputs: commands, sensor readings, drive, events and telemetry.

use crate::config::Config;
use crate::guard::fault::{Fault, LimitCause};
use crate::mode::Mode;
use crate::motor::Unfit;
use crate::sense::hall::Glitch;
use crate::units::{Counts, CountsPerSec, DeciCelsius, Duty, Micros, MilliAmps, MilliVolts, Torque};
use crate::way::Way;

/// The sensor readings of one control tick; hall edges and trips of the gate driver arrive when they happen.
#[derive(Clone, Copy, Debug)]
pub struct Sense {
    /// Time of this tick.
    pub now: Micros,
    /// Bus voltage.
    pub bus: MilliVolts,
    /// Bus current (not phase current), positive into the bridge.
    pub current: MilliAmps,
    /// Motor thermistor.
    pub motor_temp: DeciCelsius,
    /// Strain gauge, 0..=255.
    pub strain: u8,
    /// No frame from the host for too long. Faults in modes 2 and 4, where the host closes the loop.
    pub host_lost: bool,
}

/// The outputs of one control tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drive {
    /// Signed duty; `None` switches the bridge off.
    pub duty: Option<Duty>,
    /// Energizes the brake, which frees the spread. Motors without a brake ignore it.
    pub brake_released: bool,
}

/// A host's command to a motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Property MODE. Writing the current mode has no effect, but that a move which MODE 5 has ordered, or continued, ends in a hold
    /// (decision 0069).
    Mode(Mode),
    /// MODE 5 of a host that expects HOLD to say what follows, as with [`Command::Move`].
    MoveToEnd,
    /// Property T: torque of mode 2.
    Torque(Torque),
    /// Property V: velocity of mode 4.
    Velocity(CountsPerSec),
    /// Property P in whole counts: renames the current position in idle, sets the set-point in mode 3.
    Position(i32),
    /// Property E: end position of a move in whole counts; re-plans a move under way.
    End(i32),
    /// Property M: sets E and enters mode 5; HOLD says what follows.
    Move(i32),
    /// TC or TO: closes or opens until the motor stalls; with HOLD it then keeps pressing with MT.
    TorqueControlled {
        /// TC closes, TO opens.
        way: Way,
    },
    /// HI: seeks the joint's stop, moves IOFF away from it and defines that position as zero.
    Home,
    /// CMD T, terminate power: idle at once, regardless of HOLD.
    Terminate,
    /// Replaces the configuration, also during a motion; ACCEL, MV, MCV and MOV re-plan a move.
    Configure(Config),
    /// FIND: takes field torques ([`crate::Servo::set_field`]) while the wiring is learned; a latched fault of the halls or the
    /// wiring does not forbid it.
    Find,
    /// Clears a latched fault (STAT 2).
    ClearFault,
    /// Clears a breakaway (BD := 0; the O command).
    ClearBreakaway,
}

/// Largest position of a command, in whole counts: half of what [`Counts`] holds, so that no distance wraps.
const MAX_POSITION: u32 = 1 << 20;

impl Command {
    /// Whether the position of a command is within ±2^20 counts.
    #[must_use]
    pub const fn is_representable(&self) -> bool {
        match self {
            Self::Position(counts) | Self::End(counts) | Self::Move(counts) => {
                counts.unsigned_abs() <= MAX_POSITION
            }
            Self::Torque(_)
            | Self::Velocity(_)
            | Self::Configure(_)
            | Self::Mode(_)
            | Self::MoveToEnd
            | Self::TorqueControlled { .. }
            | Self::Home
            | Self::Find
            | Self::Terminate
            | Self::ClearFault
            | Self::ClearBreakaway => true,
        }
    }

    /// Whether the command means something in a mode.
    ///
    /// V and E are accepted in every mode, because hosts write them before the mode that uses them. T is reset when
    /// mode 2 starts. Renaming the position under a running motion would move the goal.
    #[must_use]
    pub const fn allowed_in(&self, mode: Mode) -> bool {
        match self {
            Self::Torque(_) => matches!(mode, Mode::Torque),
            Self::Find => matches!(mode, Mode::Idle),
            Self::Position(_) => matches!(mode, Mode::Idle | Mode::Pid),
            Self::Mode(_)
            | Self::MoveToEnd
            | Self::Velocity(_)
            | Self::End(_)
            | Self::Move(_)
            | Self::TorqueControlled { .. }
            | Self::Home
            | Self::Terminate
            | Self::Configure(_)
            | Self::ClearFault
            | Self::ClearBreakaway => true,
        }
    }

    /// Whether the command starts a motion or sets its torque. A latched fault forbids these.
    #[must_use]
    pub const fn moves(&self) -> bool {
        match self {
            Self::Mode(mode) => !matches!(mode, Mode::Idle),
            Self::Torque(_)
            | Self::MoveToEnd
            | Self::Move(_)
            | Self::TorqueControlled { .. }
            | Self::Home
            | Self::Find => true,
            Self::Velocity(_)
            | Self::Position(_)
            | Self::End(_)
            | Self::Terminate
            | Self::Configure(_)
            | Self::ClearFault
            | Self::ClearBreakaway => false,
        }
    }
}

/// Why a command was refused. A refused command changes nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// A fault is latched.
    Fault(Fault),
    /// The command is not allowed in this mode.
    Mode(Mode),
    /// The position is beyond ±2^20 counts.
    Range,
    /// How the motor is wired, or which direction closes, is not known: FIND is needed.
    Wiring,
    /// The board cannot drive the motor as it is described.
    Motor(Unfit),
    /// HI cannot find a stop with this configuration: IVEL is 0, or IHIT or MT is below the joint's friction.
    Homing,
}

/// Why a motion ended: property END.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EndReason {
    /// 1: the profile is complete and the error is within MPE.
    Arrived,
    /// 2: no hall count for TSTOP.
    Stalled,
    /// 3: by a command.
    Aborted,
    /// 4: strain outside LSG..HSG.
    Strain,
    /// 5: a link broke away.
    Breakaway,
    /// 6: a fault.
    Fault,
}

/// A report of the servo, fetched by [`Servo::event`](crate::Servo::event).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event {
    /// A motion ended.
    Ended {
        /// Cause.
        reason: EndReason,
        /// Mode after the end: idle, or the one that holds.
        mode: Mode,
    },
    /// A link broke away.
    Breakaway {
        /// Position (BP) in whole counts.
        position: i32,
        /// BS: the finger's tip must stop as well.
        stop_tip: bool,
    },
    /// A fault was latched.
    Fault(Fault),
    /// Invalid hall transition.
    Glitch(Glitch),
    /// HI is complete: zero is known.
    Homed,
}

/// The servo's readable state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Telemetry {
    /// Current mode.
    pub mode: Mode,
    /// Estimated position.
    pub position: Counts,
    /// Estimated velocity.
    pub velocity: CountsPerSec,
    /// Position set-point in modes 3 and 5; equal to `position` elsewhere.
    pub setpoint: Counts,
    /// Velocity set-point: the profile's in mode 5, V in mode 4, else 0.
    pub setpoint_velocity: CountsPerSec,
    /// Torque applied, after every limit.
    pub torque: Torque,
    /// Duty applied.
    pub duty: Duty,
    /// Latched fault.
    pub fault: Option<Fault>,
    /// Limit that was active at the last tick.
    pub limit: Option<LimitCause>,
    /// Why the last motion ended; `None` while one is under way.
    pub end: Option<EndReason>,
    /// Whether zero is known.
    pub homed: bool,
    /// BP of a breakaway not yet cleared (BD = 1).
    pub breakaway: Option<i32>,
}
