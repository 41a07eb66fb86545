//! How a motion ends: what ends it, and what follows.

use super::{DRIVEN_LAG, HOMING_TSTOP_MIN, Purpose, Servo};
use crate::command::{EndReason, Event};
use crate::config::Config;
use crate::guard::arrival::arrived;
use crate::guard::fault::Fault;
use crate::guard::hold::{After, after};
use crate::guard::limits::AppliedTorque;
use crate::mode::Mode;
use crate::motion::pid::PidState;
use crate::motion::profile::SetPoint;
use crate::num::Law;
use crate::units::{Counts, Torque};

impl Servo {
    /// Every way in which a motion ends by itself. Returns whether it has.
    pub(super) fn check_end(&mut self, counted: bool, strain: u8) -> bool {
        let driven = !counted && self.driven();
        let tstop = if driven { self.tstop() } else { 0 };
        let stalled = self.stall.step(counted, driven, tstop);
        let reason = match (self.mode, self.purpose) {
            (Mode::Trapezoidal, Purpose::Plain) => self.move_ends(strain),
            (Mode::Trapezoidal, _) => self.arrives(),
            (_, Purpose::TorqueControlled { .. }) if self.strain.excludes(strain) => Some(EndReason::Strain),
            (_, Purpose::Pressing { .. }) => return false,
            _ => None,
        };
        let Some(reason) = reason.or(stalled.then_some(EndReason::Stalled)) else { return false };
        self.finish(reason);
        true
    }

    /// Whether a move to E ends by itself.
    fn move_ends(&mut self, strain: u8) -> Option<EndReason> {
        if self.strain.excludes(strain) {
            return Some(EndReason::Strain);
        }
        // TC is asked to press; what it presses against is no breakaway.
        if self.config.bt != 0 {
            let wanted = self.setpoint.velocity;
            if self.breakaway.step(self.applied.torque, wanted, self.velocity, self.config.bt) {
                let position = self.position.round();
                self.broke_away = Some(position);
                self.report(Event::Breakaway { position, stop_tip: self.config.bs });
                return Some(EndReason::Breakaway);
            }
        }
        self.arrives()
    }

    fn arrives(&self) -> Option<EndReason> {
        let SetPoint { done, .. } = self.setpoint;
        (done && arrived(done, self.goal(), self.position.round(), self.config.mpe))
            .then_some(EndReason::Arrived)
    }

    /// Whether the motor is driven away from rest (the condition under which a stall is one).
    pub(super) fn driven(&self) -> bool {
        match self.mode {
            Mode::Idle => false,
            Mode::Torque => self.torque_wanted != Torque::ZERO,
            // TC, TO and HI go until something stops them, however little torque a low gain makes of that.
            Mode::Velocity if self.purpose != Purpose::Plain => true,
            Mode::Velocity => self.applied.limit.is_some() && self.applied.torque != Torque::ZERO,
            // ACCEL 0 cannot move: the move ends as a stall instead of never.
            Mode::Trapezoidal if self.config.accel == 0 => true,
            Mode::Pid | Mode::Trapezoidal => !self.lag().is_within(DRIVEN_LAG),
        }
    }

    pub(super) fn tstop(&self) -> u16 {
        let tstop = self.config.tstop;
        if self.purpose == Purpose::SeekStop { tstop.max(HOMING_TSTOP_MIN) } else { tstop }
    }

    /// Where the present move goes: E, or IOFF in HI. E itself is the host's.
    pub(super) fn goal(&self) -> i32 {
        if self.purpose == Purpose::LeaveStop { self.config.ioff } else { self.end }
    }

    pub(super) fn idle(&mut self) {
        self.mode = Mode::Idle;
        self.purpose = Purpose::Plain;
        self.entered = false;
        self.applied = AppliedTorque::OFF;
    }

    /// Ends the motion: HI goes on to its next step, anything else to what HOLD says.
    pub(super) fn finish(&mut self, reason: EndReason) {
        match (self.purpose, reason) {
            (Purpose::SeekStop, EndReason::Stalled) if self.presses() => {
                self.zero = self.count;
                self.position = self.position.wrapping_sub(Counts::from_int(self.position.round()));
                return self.begin(Mode::Trapezoidal, Purpose::LeaveStop);
            }
            (Purpose::LeaveStop, EndReason::Arrived) => {
                let offset = self.config.ioff;
                self.zero = self.zero.wrapping_add(offset);
                self.position = self.position.wrapping_sub(Counts::from_int(offset));
                self.homed = true;
                self.report(Event::Homed);
            }
            _ => {}
        }
        let pressing = match self.purpose {
            Purpose::TorqueControlled { closing } => Some(Purpose::Pressing { closing }),
            Purpose::Plain | Purpose::Pressing { .. } | Purpose::SeekStop | Purpose::LeaveStop => None,
        };
        match (after(reason, self.config.hold), pressing) {
            (After::Idle, _) => self.idle(),
            (After::Stay, Some(pressing)) => self.purpose = pressing,
            (After::Stay, None) | (After::Hold, _) => self.hold(reason),
        }
        self.ended = Some(reason);
        self.report(Event::Ended { reason, mode: self.mode });
    }

    /// PID at the present position. A move that arrived rests, and goes on with the torque of this moment, so
    /// that a load stays carried; any other end may come at speed or under full torque, and starts afresh.
    pub(super) fn hold(&mut self, reason: EndReason) {
        self.mode = Mode::Pid;
        self.purpose = Purpose::Plain;
        // A brake that is still letting go gets the rest of its time, and the hold is entered then.
        self.entered |= self.brake_ms >= self.config.brake_ms;
        self.position_wanted = None;
        self.profile.rest_at(self.position);
        self.setpoint = self.profile.current();
        self.stall.restart();
        self.pid_state = if reason == EndReason::Arrived {
            let (error, _) = self.errors();
            self.pid.bumpless(self.applied.torque, error, Law::ZERO, Config::torque(self.config.mt))
        } else {
            PidState::default()
        };
    }

    pub(super) fn fail(&mut self, fault: Fault) {
        self.report(Event::Fault(fault));
        if self.mode != Mode::Idle {
            self.finish(EndReason::Fault);
        }
    }
}
