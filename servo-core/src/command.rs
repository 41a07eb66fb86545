//! The words of the one mouth: what a host may ask, what the sensors say, what the servo answers.

use crate::config::{Config, ConfigError};
use crate::guard::fault::{Fault, LimitCause};
use crate::mode::Mode;
use crate::sense::hall::{Glitch, HallEvent};
use crate::units::{Counts, CountsPerSec, DeciCelsius, Duty, Micros, MilliAmps, MilliVolts, Torque};

/// All that the servo is told at a control tick.
#[derive(Clone, Copy, Debug)]
pub struct Sense<'a> {
    /// The time of this tick.
    pub now: Micros,
    /// What the commutator saw since the last tick and [`Servo::hall`](crate::Servo::hall) has not been told, oldest first.
    pub halls: &'a [HallEvent],
    /// Bus voltage.
    pub bus: MilliVolts,
    /// Bus current (not phase current), positive into the bridge.
    pub current: MilliAmps,
    /// Motor thermistor.
    pub motor_temp: DeciCelsius,
    /// Strain gauge, 0..=255.
    pub strain: u8,
    /// The gate driver's break input has switched the bridge off.
    pub bridge_fault: bool,
    /// The host has not been heard for too long; matters in modes 2 and 4, where it steers.
    pub host_lost: bool,
}

/// All that the servo asks for at a control tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drive {
    /// Signed duty, or `None`: bridge off.
    pub duty: Option<Duty>,
    /// Brake energised, which frees the spread. Ignored by motors without a brake.
    pub brake_released: bool,
}

/// What a host may ask of a motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Property MODE. Writing the present mode does nothing.
    Mode(Mode),
    /// Property T: torque of mode 2, ±990.
    Torque(Torque),
    /// Property V: velocity of mode 4.
    Velocity(CountsPerSec),
    /// Property P: in idle, what the present position is called; in mode 3, where to go. Whole counts.
    Position(i32),
    /// Property E: end of a move in whole counts; during a move it re-plans.
    End(i32),
    /// Property M: E and mode 5 in one.
    Move(i32),
    /// Close (`true`) or open under torque control: TC, TO. Ends by stall; with HOLD keeps pressing with MT.
    TorqueControlled {
        /// Towards higher counts.
        closing: bool,
    },
    /// HI: find the stop, go to zero, call it zero.
    Home,
    /// End the motion now: END 3, then HOLD decides.
    Abort,
    /// Terminate power (T): idle now, whatever HOLD says.
    Terminate,
    /// Replace the configuration, also in mid-move; MV, MCV, MOV and ACCEL re-plan.
    Configure(Config),
    /// Forget a latched fault (STAT := 2).
    ClearFault,
    /// Forget a breakaway (BD := 0; the O command).
    ClearBreakaway,
}

/// Velocity commands: ±4080 counts/s (property V).
const MAX_SPEED: CountsPerSec = CountsPerSec::from_int(4080);

/// Torque commands: ±990 (property T).
const MAX_TORQUE: Torque = Torque(990);

/// Positions: ±32767 counts (properties P, E, M).
const MAX_POSITION: u32 = 32_767;

impl Command {
    /// Whether the value is inside its property's range.
    ///
    /// # Errors
    /// [`Refusal::Range`] or [`Refusal::Config`].
    pub fn in_range(&self) -> Result<(), Refusal> {
        let fits = match self {
            Self::Torque(torque) => torque.saturating_abs() <= MAX_TORQUE,
            Self::Velocity(velocity) => velocity.0.saturating_abs() <= MAX_SPEED.0,
            Self::Position(counts) | Self::End(counts) | Self::Move(counts) => {
                counts.unsigned_abs() <= MAX_POSITION
            }
            Self::Configure(config) => return config.validate().map_err(Refusal::Config),
            Self::Mode(_)
            | Self::TorqueControlled { .. }
            | Self::Home
            | Self::Abort
            | Self::Terminate
            | Self::ClearFault
            | Self::ClearBreakaway => true,
        };
        if fits { Ok(()) } else { Err(Refusal::Range) }
    }

    /// Whether the command starts or steers a motion, which a latched fault forbids.
    #[must_use]
    pub const fn moves(&self) -> bool {
        match self {
            Self::Mode(mode) => !matches!(mode, Mode::Idle),
            Self::Torque(_) | Self::Move(_) | Self::TorqueControlled { .. } | Self::Home => true,
            Self::Velocity(_)
            | Self::Position(_)
            | Self::End(_)
            | Self::Abort
            | Self::Terminate
            | Self::Configure(_)
            | Self::ClearFault
            | Self::ClearBreakaway => false,
        }
    }
}

/// Why a command was not taken; nothing has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// A fault is latched.
    Fault(Fault),
    /// The command does nothing in this mode.
    Mode(Mode),
    /// The value is outside its range.
    Range,
    /// A configuration value is outside its range.
    Config(ConfigError),
}

/// Why a move ended: property END.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndReason {
    /// 1: the profile has ended and the error is within MPE.
    Arrived,
    /// 2: no count for TSTOP.
    Stalled,
    /// 3: told to.
    Aborted,
    /// 4: strain outside LSG..HSG.
    Strain,
    /// 5: the link met an object.
    Breakaway,
    /// 6: a fault.
    Fault,
}

impl EndReason {
    /// The property value.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::Arrived => 1,
            Self::Stalled => 2,
            Self::Aborted => 3,
            Self::Strain => 4,
            Self::Breakaway => 5,
            Self::Fault => 6,
        }
    }
}

/// What the servo reports on its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A motion ended; `mode` is the one that follows it.
    Ended {
        /// Why.
        reason: EndReason,
        /// Idle, or what holds the position.
        mode: Mode,
    },
    /// The link met an object.
    Breakaway {
        /// Where (BP), in whole counts.
        position: i32,
        /// BS: the finger's tip must stop too.
        stop_tip: bool,
    },
    /// A fault latched.
    Fault(Fault),
    /// The hall lines lied.
    Glitch(Glitch),
    /// HI is done: position zero is known.
    Homed,
}

/// What can be read of a servo at any time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Telemetry {
    /// Present mode.
    pub mode: Mode,
    /// Estimated position.
    pub position: Counts,
    /// Estimated velocity.
    pub velocity: CountsPerSec,
    /// Position set-point in modes 3 and 5; the position elsewhere.
    pub setpoint: Counts,
    /// The velocity the motion wants: the profile's in mode 5, V in mode 4, else 0.
    pub setpoint_velocity: CountsPerSec,
    /// Torque applied after every clamp.
    pub torque: Torque,
    /// Duty applied.
    pub duty: Duty,
    /// Latched fault.
    pub fault: Option<Fault>,
    /// LimitCause that bounded the last tick.
    pub limit: Option<LimitCause>,
    /// Why the last motion ended.
    pub end: Option<EndReason>,
    /// Whether HI has found zero.
    pub homed: bool,
    /// BP of a breakaway not yet cleared (BD = 1).
    pub breakaway: Option<i32>,
}
