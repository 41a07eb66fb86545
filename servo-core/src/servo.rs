//! The servo of one motor: commands and sensor readings in, a duty and a brake out. The tick order is here and
//! nowhere else.

use crate::config::{Config, ConfigError};
use crate::guard::fault::{Fault, Limit};
use crate::mode::Mode;
use crate::sense::hall::{Glitch, HallEvent};
use crate::units::{Counts, CountsPerSec, DeciCelsius, Duty, Micros, MilliAmps, MilliVolts, Torque};

/// All that the servo is told at a control tick.
#[derive(Clone, Copy, Debug)]
pub struct Sense<'a> {
    /// The time of this tick.
    pub now: Micros,
    /// What the commutator saw since the last tick, oldest first.
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
    /// A limit began to bound the motion.
    Limited(Limit),
    /// The hall lines lied.
    Glitch(Glitch),
    /// HI is done: position zero is known.
    Homed,
}

/// What can be read of a servo at any time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Present mode.
    pub mode: Mode,
    /// Estimated position.
    pub position: Counts,
    /// Estimated velocity.
    pub velocity: CountsPerSec,
    /// Position set-point in modes 3 and 5; the position elsewhere.
    pub setpoint: Counts,
    /// Set-point's velocity in mode 5, V in mode 4, else 0.
    pub setpoint_velocity: CountsPerSec,
    /// Torque applied after every clamp.
    pub torque: Torque,
    /// Duty applied.
    pub duty: Duty,
    /// Latched fault.
    pub fault: Option<Fault>,
    /// Limit that bounded the last tick.
    pub limit: Option<Limit>,
    /// Why the last motion ended.
    pub end: Option<EndReason>,
    /// Whether HI has found zero.
    pub homed: bool,
    /// BP of a breakaway not yet cleared (BD = 1).
    pub breakaway: Option<i32>,
}

/// The servo of one motor.
#[derive(Debug)]
pub struct Servo {
    config: Config,
    status: Status,
}

impl Servo {
    /// A servo at rest in the cell `count`, in idle.
    ///
    /// # Errors
    /// The first configuration value out of range.
    pub fn new(config: Config, count: i32) -> Result<Self, ConfigError> {
        config.validate()?;
        let position = Counts::from_int(count);
        let status = Status {
            mode: Mode::Idle,
            position,
            velocity: CountsPerSec::ZERO,
            setpoint: position,
            setpoint_velocity: CountsPerSec::ZERO,
            torque: Torque::ZERO,
            duty: Duty::ZERO,
            fault: None,
            limit: None,
            end: None,
            homed: false,
            breakaway: None,
        };
        Ok(Self { config, status })
    }

    /// Asks for something.
    ///
    /// # Errors
    /// Why not; nothing has changed then.
    pub fn command(&mut self, command: Command) -> Result<(), Refusal> {
        let Command::Configure(config) = command else { return Err(Refusal::Mode(self.status.mode)) };
        config.validate().map_err(Refusal::Config)?;
        self.config = config;
        Ok(())
    }

    /// One control tick, 1 ms after the last.
    pub fn tick(&mut self, sense: &Sense<'_>) -> Drive {
        let _ = sense;
        Drive { duty: None, brake_released: false }
    }

    /// The next report, oldest first.
    pub fn event(&mut self) -> Option<Event> {
        None
    }

    /// What can be read at any time.
    #[must_use]
    pub fn status(&self) -> Status {
        self.status
    }

    /// The present configuration.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }
}
