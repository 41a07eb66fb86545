//! What each command does to the servo; the tick does the rest.

use super::{Purpose, Servo, pid_of};
use crate::command::{Command, EndReason, Refusal};
use crate::config::Config;
use crate::mode::{Mode, admits};
use crate::motion::pid::PidState;
use crate::motion::profile::Profile;
use crate::motion::velocity_loop::VelocityLoop;
use crate::units::{Counts, CountsPerSec, Torque};

impl Servo {
    /// Asks for something.
    ///
    /// # Errors
    /// Why not; nothing has changed then.
    pub fn command(&mut self, command: Command) -> Result<(), Refusal> {
        if let Some(fault) = self.faults.latched()
            && command.moves()
        {
            return Err(Refusal::Fault(fault));
        }
        if !admits(self.mode, &command) {
            return Err(Refusal::Mode(self.mode));
        }
        command.in_range()?;
        match command {
            Command::Mode(mode) => self.switch_to(mode),
            Command::Torque(torque) => self.torque_wanted = torque,
            Command::Velocity(velocity) => self.take_velocity(velocity),
            Command::Position(position) => self.take_position(position),
            Command::End(end) => self.take_end(end),
            Command::Move(end) => {
                self.take_end(end);
                if self.mode != Mode::Trapezoidal || self.purpose != Purpose::Plain {
                    self.begin(Mode::Trapezoidal, Purpose::Plain);
                }
            }
            Command::TorqueControlled { closing } => {
                self.begin(Mode::Velocity, Purpose::TorqueControlled { closing });
            }
            Command::Home => {
                self.homed = false;
                self.begin(Mode::Velocity, Purpose::SeekStop);
            }
            Command::Abort => {
                if self.mode != Mode::Idle {
                    self.finish(EndReason::Aborted);
                }
            }
            Command::Terminate => self.idle(),
            Command::Configure(config) => self.configure(config),
            Command::ClearFault => self.faults.clear(),
            Command::ClearBreakaway => self.broke_away = None,
        }
        Ok(())
    }

    /// A host's new mode; the mode it is in does nothing.
    fn switch_to(&mut self, mode: Mode) {
        if mode == self.mode {
            return;
        }
        match mode {
            Mode::Idle => self.idle(),
            Mode::Torque | Mode::Pid | Mode::Velocity | Mode::Trapezoidal => self.begin(mode, Purpose::Plain),
        }
    }

    /// Starts a motion; its entry actions run at the first driven tick.
    pub(super) fn begin(&mut self, mode: Mode, purpose: Purpose) {
        let positioned = matches!(self.mode, Mode::Pid | Mode::Trapezoidal);
        if self.mode == Mode::Idle {
            self.brake_ms = 0;
        }
        // From hold to move and back the load stays carried; from any other mode the integrator starts empty.
        if !(positioned && matches!(mode, Mode::Pid | Mode::Trapezoidal)) {
            self.pid_state = PidState::default();
        }
        self.torque_wanted = Torque::ZERO;
        self.ended = None;
        self.mode = mode;
        self.purpose = purpose;
        self.entered = false;
    }

    fn take_position(&mut self, position: i32) {
        match self.mode {
            Mode::Pid => {
                self.profile = Profile::at_rest(Counts::from_int(position));
                self.setpoint = self.profile.current();
                self.stall.restart();
            }
            Mode::Idle | Mode::Torque | Mode::Velocity | Mode::Trapezoidal => {
                self.zero = self.count.wrapping_sub(position);
                let shift = position.wrapping_sub(self.position.round());
                self.position = self.position.wrapping_add(Counts::from_int(shift));
            }
        }
    }

    fn take_end(&mut self, end: i32) {
        self.end = end;
        if self.mode == Mode::Trapezoidal && self.purpose == Purpose::Plain && self.entered {
            self.plan();
        }
    }

    /// V; during TC or TO it takes over, during HI it waits.
    fn take_velocity(&mut self, velocity: CountsPerSec) {
        self.velocity_wanted = velocity;
        if matches!(self.purpose, Purpose::TorqueControlled { .. } | Purpose::Pressing { .. }) {
            self.purpose = Purpose::Plain;
        }
    }

    fn configure(&mut self, config: Config) {
        self.config = config;
        self.pid = pid_of(&config);
        self.velocity_loop = VelocityLoop::new(config.kpv);
        if self.mode == Mode::Trapezoidal && self.entered {
            self.plan();
        }
    }
}
