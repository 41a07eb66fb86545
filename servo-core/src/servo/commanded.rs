//! What each command does to the servo; the tick does the rest.

use super::{Purpose, Servo, bounds_of, pid_of};
use crate::command::{Command, EndReason, Event, Refusal};
use crate::config::Config;
use crate::guard::strain::Window;
use crate::mode::{Mode, admits};
use crate::motion::pid::PidState;
use crate::motion::velocity_loop::VelocityLoop;
use crate::units::{Counts, CountsPerSec, Torque};

/// The least torque in HI under which what does not turn has met a stop: 0.04 N·m, a joint's friction (DESIGN 4.2), at
/// 1575 units per N·m.
const LEAST_PRESS: Torque = Torque(63);

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
            Command::Torque(torque) => self.take_torque(torque),
            Command::Velocity(velocity) => self.take_velocity(velocity),
            Command::Position(position) => self.take_position(position),
            Command::End(end) => self.take_end(end),
            Command::Move(end) => {
                self.take_end(end);
                if self.mode != Mode::Trapezoidal || self.purpose != Purpose::Plain {
                    self.replace(Mode::Trapezoidal, Purpose::Plain);
                }
            }
            Command::TorqueControlled { closing } => {
                self.replace(Mode::Velocity, Purpose::TorqueControlled { closing });
            }
            // Without a velocity or a torque it would find its stop wherever it stands.
            Command::Home if self.config.ivel == 0 || self.homing_torque() < LEAST_PRESS => {
                return Err(Refusal::Range);
            }
            Command::Home => {
                self.homed = false;
                self.replace(Mode::Velocity, Purpose::SeekStop);
            }
            Command::Abort => {
                if self.mode != Mode::Idle {
                    self.finish(EndReason::Aborted);
                }
            }
            Command::Terminate => self.stop(),
            Command::Configure(config) => self.configure(config),
            Command::ClearFault => {
                self.faults.clear();
                self.thermal.look_next();
            }
            Command::ClearBreakaway => self.broke_away = None,
        }
        Ok(())
    }

    /// The most torque that HI may press with.
    pub(super) fn homing_torque(&self) -> Torque {
        Config::torque(self.config.ihit.min(self.config.mt))
    }

    /// Whether the motor pushes as hard as a limit lets it, and harder than friction: if it stands still then, something
    /// is in its way.
    pub(super) fn presses(&self) -> bool {
        self.applied.limit.is_some() && self.applied.torque.saturating_abs() >= LEAST_PRESS
    }

    /// A host's new mode; the mode it is in does nothing.
    fn switch_to(&mut self, mode: Mode) {
        if mode == self.mode {
            return;
        }
        match mode {
            Mode::Idle => self.stop(),
            Mode::Torque | Mode::Pid | Mode::Velocity | Mode::Trapezoidal => {
                self.replace(mode, Purpose::Plain);
            }
        }
    }

    /// Power off, whatever HOLD says. A move that was under way has been aborted.
    fn stop(&mut self) {
        let moving = self.is_move();
        self.idle();
        if moving {
            self.ended = Some(EndReason::Aborted);
            self.report(Event::Ended { reason: EndReason::Aborted, mode: Mode::Idle });
        }
    }

    /// Another motion in place of the present one; a move that was under way has been aborted.
    fn replace(&mut self, mode: Mode, purpose: Purpose) {
        if self.is_move() {
            self.report(Event::Ended { reason: EndReason::Aborted, mode });
        }
        self.begin(mode, purpose);
    }

    /// Whether a motion is under way that ends by itself and that a host waits for: a move to E, TC, TO or HI.
    fn is_move(&self) -> bool {
        match self.purpose {
            Purpose::Plain => self.mode == Mode::Trapezoidal,
            Purpose::TorqueControlled { .. } | Purpose::SeekStop | Purpose::LeaveStop => true,
            Purpose::Pressing { .. } => false,
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
        self.position_wanted = None;
        self.ended = None;
        self.mode = mode;
        self.purpose = purpose;
        self.entered = false;
    }

    fn take_position(&mut self, position: i32) {
        match self.mode {
            // The brake still holds: entry would seed the set-point from the measurement.
            Mode::Pid if !self.entered => self.position_wanted = Some(position),
            Mode::Pid => {
                self.profile.rest_at(Counts::from_int(position));
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

    /// T; leaving zero is the start of a drive.
    fn take_torque(&mut self, torque: Torque) {
        if self.torque_wanted == Torque::ZERO {
            self.stall.restart();
        }
        self.torque_wanted = torque;
    }

    /// E; the same E again is no new move.
    fn take_end(&mut self, end: i32) {
        let changed = end != self.end;
        self.end = end;
        if changed && self.mode == Mode::Trapezoidal && self.purpose == Purpose::Plain && self.entered {
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
        let shape = |c: &Config| (c.accel, c.mv, c.mcv, c.mov, c.ioff);
        let reshaped = shape(&config) != shape(&self.config);
        self.config = config;
        self.thermal.look_next();
        self.pid = pid_of(&config);
        self.velocity_loop = VelocityLoop::new(config.kpv);
        self.strain = Window::new(config.hsg, config.lsg);
        if reshaped {
            self.bounds = bounds_of(&config);
        }
        // Anything else that is set during a blocked move must not put off its stall.
        if reshaped && self.mode == Mode::Trapezoidal && self.entered {
            self.plan();
        }
    }
}
