//! The servo of one motor: commands and sensor readings in, a duty and a brake out. The tick order is
//! [`Servo::tick`], here and nowhere else.

pub use crate::command::{Command, Drive, EndReason, Event, Refusal, Sense, Status};
use crate::config::{Config, ConfigError, MotorKind};
use crate::guard::arrival::arrived;
use crate::guard::breakaway::Breakaway;
use crate::guard::fault::{Fault, Faults};
use crate::guard::hold::{After, after};
use crate::guard::limits::{Bounded, Envelope, Limits};
use crate::guard::stall::Stall;
use crate::guard::strain;
use crate::guard::thermal::Thermal;
use crate::mode::Mode;
use crate::motion::pid::{Pid, PidConfig, PidState};
use crate::motion::profile::{self, Profile, SetPoint};
use crate::motion::torque::drag;
use crate::motion::velocity_loop::VelocityLoop;
use crate::num::Law;
use crate::sense::hall::HallEvent;
use crate::sense::velocity::Estimator;
use crate::units::{Counts, CountsPerSec, Torque};
use heapless::Deque;

mod commanded;
#[cfg(test)]
mod tests;

/// Hall counts a motor revolution: three pole pairs times six steps (manual 1.3.3).
pub const COUNTS_PER_REV: usize = 18;

/// The profile waits while the position lags this far: a saturated motor must not be run away from, and six
/// counts are under what KP turns into full torque (DESIGN 4.3).
const WAIT_LAG: Law = Law::lit("6");

/// From this lag on a position-controlled motor is driven away from rest, and the stall timer runs.
const DRIVEN_LAG: Law = Law::ONE;

/// Least stall time in HI: hosts poll slowly and must see mode 4 (DESIGN 5).
const HOMING_TSTOP_MIN: u16 = 250;

/// Reports that may wait; the oldest is dropped when a host never asks.
const EVENTS: usize = 8;

/// What a motion in some mode is for, which decides how it ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    /// What the mode says, or holding after an end.
    Plain,
    /// TC or TO.
    TorqueControlled { closing: bool },
    /// TC or TO ended with HOLD: presses on, and cannot stall again.
    Pressing { closing: bool },
    /// HI, towards the stop.
    SeekStop,
    /// HI, from the stop to zero.
    LeaveStop,
}

/// The servo of one motor.
#[derive(Debug)]
pub struct Servo {
    config: Config,
    pid: Pid,
    velocity_loop: VelocityLoop,
    estimator: Estimator<COUNTS_PER_REV>,
    /// Decoder count that is called position 0.
    zero: i32,
    /// Decoder count.
    count: i32,
    mode: Mode,
    purpose: Purpose,
    /// Whether the mode's entry actions have run: they wait for the brake.
    entered: bool,
    /// Ticks since the brake was asked to release.
    brake_ms: u32,
    profile: Profile,
    setpoint: SetPoint,
    pid_state: PidState,
    torque_wanted: Torque,
    velocity_wanted: CountsPerSec,
    /// P written before mode 3's entry actions.
    position_wanted: Option<i32>,
    end: i32,
    stall: Stall,
    breakaway: Breakaway,
    thermal: Thermal,
    limits: Limits,
    faults: Faults,
    applied: Bounded,
    position: Counts,
    velocity: CountsPerSec,
    ended: Option<EndReason>,
    homed: bool,
    broke_away: Option<i32>,
    events: Deque<Event, EVENTS>,
}

impl Servo {
    /// A servo at rest in the cell `count` of the hall decoder, called position `count`, in idle.
    ///
    /// # Errors
    /// The first configuration value out of range.
    pub fn new(config: Config, count: i32) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self::with(config, count))
    }

    /// The same with a motor's defaults, which are in range.
    #[must_use]
    pub fn for_motor(kind: MotorKind, count: i32) -> Self {
        Self::with(Config::for_motor(kind), count)
    }

    fn with(config: Config, count: i32) -> Self {
        let position = Counts::from_int(count);
        Self {
            config,
            pid: pid_of(&config),
            velocity_loop: VelocityLoop::new(config.kpv),
            estimator: Estimator::new(count),
            zero: 0,
            count,
            mode: Mode::Idle,
            purpose: Purpose::Plain,
            entered: false,
            brake_ms: 0,
            profile: Profile::at_rest(position),
            setpoint: SetPoint::at_rest(position),
            pid_state: PidState::default(),
            torque_wanted: Torque::ZERO,
            velocity_wanted: CountsPerSec::ZERO,
            position_wanted: None,
            end: count,
            stall: Stall::default(),
            breakaway: Breakaway::default(),
            thermal: Thermal::default(),
            limits: Limits::default(),
            faults: Faults::default(),
            applied: Bounded::OFF,
            position,
            velocity: CountsPerSec::ZERO,
            ended: None,
            homed: false,
            broke_away: None,
            events: Deque::new(),
        }
    }

    /// The position it stands at is known to be right, as after HI: it was stored, and nothing has moved since.
    pub const fn trust_position(&mut self) {
        self.homed = true;
    }

    /// The position it stands at may not be right: HI is needed.
    pub const fn doubt_position(&mut self) {
        self.homed = false;
    }

    /// One control tick, 1 ms after the last: sense, guard, law, limits, in this order.
    pub fn tick(&mut self, sense: &Sense<'_>) -> Drive {
        let counted = self.observe(sense);
        let heat = (sense.motor_temp, self.config.otemp);
        let (short, host_lost) = (self.limits.short(), sense.host_lost && self.is_steered());
        if let Some(fault) = self.faults.check(sense.bus, heat, sense.bridge_fault, short, host_lost) {
            self.fail(fault);
        }
        let thermal = self.thermal.step(self.applied.torque, sense.motor_temp, self.config.otemp);
        self.brake_ms = if self.mode == Mode::Idle { 0 } else { self.brake_ms.saturating_add(1) };
        if self.ready() {
            self.enter();
            self.check_end(counted, sense.strain);
        }
        // The end of one motion may have begun another (HI), or led to idle.
        if self.ready() {
            self.enter();
            let envelope = self.limits.envelope(self.torque_ceiling(), thermal, self.velocity, sense.bus);
            self.applied = envelope.bound(self.law(&envelope));
        } else {
            self.applied = Bounded::OFF;
            self.setpoint = SetPoint::at_rest(self.position);
        }
        let duty = self.ready().then_some(self.applied.duty);
        Drive { duty, brake_released: self.mode != Mode::Idle }
    }

    /// The next report, oldest first.
    pub fn event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// What can be read at any time.
    #[must_use]
    pub fn status(&self) -> Status {
        Status {
            mode: self.mode,
            position: self.position,
            velocity: self.velocity,
            setpoint: self.setpoint.position,
            setpoint_velocity: self.velocity_goal(),
            torque: self.applied.torque,
            duty: self.applied.duty,
            fault: self.faults.latched(),
            limit: self.applied.limit,
            end: self.ended,
            homed: self.homed,
            breakaway: self.broke_away,
        }
    }

    /// The present configuration.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// E as it was set.
    #[must_use]
    pub const fn end(&self) -> i32 {
        self.end
    }

    /// T of mode 2 after the limits: what was set, or as much of it as they left; elsewhere the torque applied.
    #[must_use]
    pub const fn torque(&self) -> Torque {
        match self.mode {
            Mode::Torque if self.applied.limit.is_none() => self.torque_wanted,
            _ => self.applied.torque,
        }
    }

    // --- the tick, step by step -------------------------------------------------------------------------

    /// Halls → position and velocity. Returns whether the count moved.
    fn observe(&mut self, sense: &Sense<'_>) -> bool {
        let before = self.count;
        for event in sense.halls {
            match *event {
                HallEvent::Step(edge) => {
                    self.estimator.edge(&edge);
                    self.count = edge.count;
                }
                HallEvent::Glitch(glitch) => self.report(Event::Glitch(glitch)),
                HallEvent::Fault(_) => {
                    // The count may have slipped by an electrical revolution.
                    self.homed = false;
                    self.faults.halls();
                }
            }
        }
        let (position, velocity) = self.estimator.at(sense.now);
        self.position = position.wrapping_sub(Counts::from_int(self.zero));
        self.velocity = velocity;
        self.limits.watch_current(sense.current, self.applied.duty);
        self.count != before
    }

    /// Whether the bridge may drive: a mode that drives, and the brake has let go.
    fn ready(&self) -> bool {
        self.mode != Mode::Idle && self.brake_ms > u32::from(self.config.brake_ms)
    }

    /// Entry actions of the mode, at its first driven tick.
    fn enter(&mut self) {
        if self.entered {
            return;
        }
        self.entered = true;
        self.stall.restart();
        self.breakaway.restart();
        let position = self.position_wanted.take().map_or(self.position, Counts::from_int);
        self.profile = Profile::at_rest(position);
        self.setpoint = self.profile.current();
        if self.mode == Mode::Trapezoidal {
            self.plan();
        }
    }

    /// Every way in which a motion ends by itself.
    fn check_end(&mut self, counted: bool, strain: u8) {
        let stalled = self.stall.step(counted, self.driven(), self.tstop());
        let move_to_end = self.purpose == Purpose::Plain && self.mode == Mode::Trapezoidal;
        let torque_controlled = matches!(self.purpose, Purpose::TorqueControlled { .. });
        if (move_to_end || torque_controlled) && strain::outside(strain, self.config.hsg, self.config.lsg) {
            return self.finish(EndReason::Strain);
        }
        // TC is asked to press; what it presses against is no breakaway.
        if move_to_end {
            let wanted = self.setpoint.velocity;
            if self.breakaway.step(self.applied.torque, wanted, self.velocity, self.config.bt) {
                let position = self.position.round();
                self.broke_away = Some(position);
                self.report(Event::Breakaway { position, stop_tip: self.config.bs });
                return self.finish(EndReason::Breakaway);
            }
        }
        if self.mode == Mode::Trapezoidal
            && arrived(self.setpoint.done, self.goal(), self.position.round(), self.config.mpe)
        {
            self.finish(EndReason::Arrived);
        } else if stalled && !matches!(self.purpose, Purpose::Pressing { .. }) {
            self.finish(EndReason::Stalled);
        }
    }

    /// The torque that the mode's law wants, damped.
    fn law(&mut self, envelope: &Envelope) -> Torque {
        if matches!(self.mode, Mode::Torque | Mode::Velocity) {
            self.setpoint = SetPoint::at_rest(self.position);
        }
        let (torque, damping) = match self.mode {
            Mode::Idle => (Torque::ZERO, Law::ZERO),
            Mode::Torque => (self.torque_wanted, Law::ZERO),
            Mode::Velocity => (self.velocity_torque(envelope.most()), self.velocity_loop.damping()),
            Mode::Pid | Mode::Trapezoidal => {
                if self.mode == Mode::Trapezoidal && !self.left_behind() {
                    self.setpoint = self.profile.step();
                }
                let (error, velocity_error) = self.errors();
                let range = envelope.range();
                (self.pid.step(&mut self.pid_state, error, velocity_error, range), self.pid.damping())
            }
        };
        torque.saturating_add(drag(self.velocity, damping))
    }

    /// Mode 4's torque. Pressing takes all of MT while the rotor is slower than half the speed it came with; if
    /// the object gives way, the velocity loop is back.
    fn velocity_torque(&self, most: Torque) -> Torque {
        let goal = self.velocity_goal();
        let half = goal.0 >> 1;
        match self.purpose {
            Purpose::Pressing { closing: true } if self.velocity.0 < half => most,
            Purpose::Pressing { closing: false } if self.velocity.0 > half => most.saturating_neg(),
            _ => self.velocity_loop.step(goal, self.velocity, most),
        }
    }

    // --- pieces -------------------------------------------------------------------------------------------

    /// How far the position lags behind the set-point, counts.
    fn lag(&self) -> Law {
        self.setpoint.position.wrapping_sub(self.position).saturating_error()
    }

    /// Whether the position lags too far behind a moving set-point, which then waits. A rotor that is ahead is
    /// not waited for: the set-point catches up with it.
    fn left_behind(&self) -> bool {
        let lag = self.lag();
        let lag = if self.setpoint.velocity < CountsPerSec::ZERO { lag.saturating_neg() } else { lag };
        lag > WAIT_LAG
    }

    /// Errors of the position loop. At rest in the cell of a resting set-point the error is nought: the halls
    /// cannot tell more, and an integrator on half a count would hunt.
    fn errors(&self) -> (Law, Law) {
        let resting = self.setpoint.velocity == CountsPerSec::ZERO;
        let same_cell = self.setpoint.position.round() == self.position.round();
        let error = if resting && same_cell { Law::ZERO } else { self.lag() };
        (error, self.setpoint.velocity.0.saturating_sub(self.velocity.0))
    }

    /// Whether the host steers the motion from moment to moment, and must be there to end it.
    const fn is_steered(&self) -> bool {
        matches!(self.mode, Mode::Torque | Mode::Velocity)
    }

    /// Whether the motor is driven away from rest (the condition under which a stall is one).
    fn driven(&self) -> bool {
        match self.mode {
            Mode::Idle => false,
            Mode::Torque => self.torque_wanted != Torque::ZERO,
            // TC, TO and HI go until something stops them, however little torque a low gain makes of that.
            Mode::Velocity if self.purpose != Purpose::Plain => true,
            Mode::Velocity => self.applied.limit.is_some() && self.applied.torque != Torque::ZERO,
            // ACCEL 0 cannot move: the move ends as a stall instead of never.
            Mode::Trapezoidal if self.config.accel == 0 => true,
            Mode::Pid | Mode::Trapezoidal => self.lag().saturating_abs() >= DRIVEN_LAG,
        }
    }

    fn tstop(&self) -> u16 {
        let tstop = self.config.tstop;
        if self.purpose == Purpose::SeekStop { tstop.max(HOMING_TSTOP_MIN) } else { tstop }
    }

    fn torque_ceiling(&self) -> Torque {
        if self.purpose == Purpose::SeekStop { self.homing_torque() } else { Config::torque(self.config.mt) }
    }

    /// The velocity that the present motion wants.
    fn velocity_goal(&self) -> CountsPerSec {
        match self.purpose {
            Purpose::Plain if self.mode == Mode::Velocity => self.velocity_wanted,
            Purpose::Plain | Purpose::LeaveStop => self.setpoint.velocity,
            Purpose::TorqueControlled { closing } | Purpose::Pressing { closing } => {
                if closing {
                    Config::speed(self.config.mcv)
                } else {
                    Config::speed(self.config.mov).saturating_neg()
                }
            }
            Purpose::SeekStop => CountsPerSec::from_int(self.config.ivel),
        }
    }

    /// Where the present move goes: E, or IOFF in HI. E itself is the host's.
    fn goal(&self) -> i32 {
        if self.purpose == Purpose::LeaveStop { self.config.ioff } else { self.end }
    }

    /// Plans the profile to the goal from the present set-point.
    fn plan(&mut self) {
        let config = &self.config;
        let limits = profile::Limits {
            accel: config.accel,
            closing: Config::speed(config.mv.min(config.mcv)),
            opening: Config::speed(config.mv.min(config.mov)),
        };
        self.profile.plan(Counts::from_int(self.goal()), limits);
        self.setpoint = self.profile.current();
        self.stall.restart();
    }

    fn idle(&mut self) {
        self.mode = Mode::Idle;
        self.purpose = Purpose::Plain;
        self.entered = false;
        self.applied = Bounded::OFF;
    }

    /// Ends the motion: HI goes on to its next step, anything else to what HOLD says.
    fn finish(&mut self, reason: EndReason) {
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
    fn hold(&mut self, reason: EndReason) {
        self.mode = Mode::Pid;
        self.purpose = Purpose::Plain;
        self.entered = true;
        self.profile = Profile::at_rest(self.position);
        self.setpoint = self.profile.current();
        self.stall.restart();
        self.pid_state = if reason == EndReason::Arrived {
            let (error, _) = self.errors();
            self.pid.bumpless(self.applied.torque, error, Law::ZERO, Config::torque(self.config.mt))
        } else {
            PidState::default()
        };
    }

    fn fail(&mut self, fault: Fault) {
        self.report(Event::Fault(fault));
        if self.mode != Mode::Idle {
            self.finish(EndReason::Fault);
        }
    }

    fn report(&mut self, event: Event) {
        if self.events.is_full() {
            self.events.pop_front();
        }
        // Room was made above.
        let _ = self.events.push_back(event);
    }
}

fn pid_of(config: &Config) -> Pid {
    PidConfig { kp: config.kp, ki: config.ki, kd: config.kd }.build()
}
