//! The servo of one motor: commands and sensor readings in, a duty and a brake out. The tick order is
//! [`Servo::tick`], here and nowhere else.

pub use crate::command::{Command, Drive, EndReason, Event, Refusal, Sense, Telemetry};
use crate::config::{Config, ConfigError, MotorKind};
use crate::guard::breakaway::Breakaway;
use crate::guard::fault::{Condition, Faults};
use crate::guard::limits::{AppliedTorque, TorqueEnvelope, TorqueLimiter};
use crate::guard::stall::Stall;
use crate::guard::strain::Window;
use crate::guard::thermal::Thermal;
use crate::mode::Mode;
use crate::motion::pid::{Pid, PidConfig, PidState};
use crate::motion::profile::{self, Profile, SetPoint};
use crate::motion::torque::{MIN_DAMPING, damped};
use crate::motion::velocity_loop::VelocityLoop;
use crate::num::Law;
use crate::sense::hall::{HallEdge, HallEvent};
use crate::sense::velocity::Estimator;
use crate::units::{Counts, CountsPerSec, Torque};
use heapless::Deque;

mod commanded;
mod ending;
#[cfg(test)]
mod tests;

/// Hall counts a motor revolution: three pole pairs times six steps (manual 1.3.3).
pub const COUNTS_PER_REV: usize = 18;

/// The profile waits while the position lags this far: a saturated motor must not be run away from, and six
/// counts are under what KP turns into full torque (DESIGN 4.3).
const WAIT_LAG: Counts = Counts::from_int(6);

/// From this lag on a position-controlled motor is driven away from rest, and the stall timer runs.
const DRIVEN_LAG: Counts = Counts::from_int(1);

/// Least stall time in HI: hosts poll slowly and must see mode 4 (DESIGN 5).
const HOMING_TSTOP_MIN: u16 = 250;

/// Reports that may wait; the oldest is dropped when a host never asks.
const EVENTS: usize = 8;

/// Bridge off, brake engaged.
const IDLE: Drive = Drive { duty: None, brake_released: false };

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
    strain: Window,
    bounds: profile::CruiseRamps,
    estimator: Estimator<COUNTS_PER_REV>,
    /// Decoder count that is called position 0.
    zero: i32,
    /// Decoder count.
    count: i32,
    mode: Mode,
    purpose: Purpose,
    /// Whether the mode's entry actions have run: they wait for the brake.
    entered: bool,
    /// Ticks since the brake was asked to release, until it has.
    brake_ms: u16,
    /// Whether the last tick entered a mode that plans.
    planned: bool,
    profile: Profile,
    /// Of modes 3 and 5, once entered.
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
    limits: TorqueLimiter,
    faults: Faults,
    applied: AppliedTorque,
    position: Counts,
    velocity: CountsPerSec,
    ended: Option<EndReason>,
    homed: bool,
    broke_away: Option<i32>,
    events: Deque<Event, EVENTS>,
    /// Whether there is any.
    has_event: bool,
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
            strain: Window::new(config.hsg, config.lsg),
            bounds: bounds_of(&config),
            estimator: Estimator::new(count),
            zero: 0,
            count,
            mode: Mode::Idle,
            purpose: Purpose::Plain,
            entered: false,
            brake_ms: 0,
            planned: false,
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
            limits: TorqueLimiter::default(),
            faults: Faults::default(),
            applied: AppliedTorque::OFF,
            position,
            velocity: CountsPerSec::ZERO,
            ended: None,
            homed: false,
            broke_away: None,
            events: Deque::new(),
            has_event: false,
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

    /// A step of the count, as soon as it is seen: what it tells of the motion is not the next tick's work.
    #[inline]
    pub fn edge(&mut self, edge: &HallEdge) {
        self.estimator.edge(edge);
    }

    /// What the hall decoder saw, as soon as it is seen, or in [`Sense::halls`].
    pub fn hall(&mut self, event: &HallEvent) {
        match *event {
            HallEvent::Step(edge) => self.edge(&edge),
            HallEvent::Glitch(glitch) => self.report(Event::Glitch(glitch)),
            HallEvent::Fault(_) => {
                // The count may have slipped by an electrical revolution.
                self.homed = false;
                self.faults.raise(Condition::HALLS);
            }
        }
    }

    /// The break input has switched the bridge off: a fault at the next tick.
    pub const fn bridge_fault(&mut self) {
        self.faults.raise(Condition::BRIDGE);
    }

    /// One control tick, 1 ms after the last: sense, guard, law, limits, in this order.
    pub fn tick(&mut self, sense: &Sense<'_>) -> Drive {
        // First of all, while it is at hand.
        if sense.bridge_fault {
            self.bridge_fault();
        }
        if sense.host_lost && self.is_steered() {
            self.faults.raise(Condition::HOST_LOST);
        }
        let counted = self.observe(sense);
        let enters = self.enters();
        // A tick that plans does little else. Its torque is the last motion's, or none.
        self.planned = enters && self.mode == Mode::Trapezoidal;
        if self.planned {
            self.thermal.add(self.applied.torque);
        } else if self.thermal.step(self.applied.torque, sense.motor_temp, self.config.otemp) {
            self.faults.raise(Condition::HOT);
        }
        if let Some(fault) = self.faults.check(sense.bus) {
            self.fail(fault);
        }
        if self.mode == Mode::Idle {
            return IDLE;
        }
        if !self.entered && !enters {
            self.brake_ms = self.brake_ms.saturating_add(1);
            self.applied = AppliedTorque::OFF;
            return Drive { duty: None, brake_released: true };
        }
        if !self.entered {
            self.enter();
            if !self.setpoint.done {
                // A plan was made: it sets out in the next tick, and drives as before till then.
                return self.drive_on();
            }
            // What has just begun does not end, but for a move to where it is.
        }
        if self.check_end(counted, sense.strain) && !self.entered {
            // Idle, or HI goes on: it enters its next motion in the next tick, and drives as before till then.
            return self.drive();
        }
        let most = self.thermal.most();
        let envelope = self.limits.envelope(self.torque_ceiling(), most, self.velocity, sense.bus);
        self.applied = envelope.bound(self.law(&envelope));
        Drive { duty: Some(self.applied.duty), brake_released: true }
    }

    /// The next report, oldest first.
    pub fn event(&mut self) -> Option<Event> {
        let event = self.events.pop_front();
        self.has_event = !self.events.is_empty();
        event
    }

    /// Whether there is a report: each tick asks.
    #[must_use]
    pub const fn has_event(&self) -> bool {
        self.has_event
    }

    /// What can be read at any time.
    #[must_use]
    pub fn telemetry(&self) -> Telemetry {
        Telemetry {
            mode: self.mode,
            position: self.position,
            velocity: self.velocity,
            setpoint: if self.is_positioned() { self.setpoint.position } else { self.position },
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
        for event in sense.halls {
            self.hall(event);
        }
        let (position, velocity) = self.estimator.at(sense.now);
        self.position = position.wrapping_sub(Counts::from_int(self.zero));
        self.velocity = velocity;
        if self.limits.watch_current(sense.current, self.applied.duty) {
            self.faults.raise(Condition::SHORT);
        }
        let before = core::mem::replace(&mut self.count, self.estimator.count());
        self.count != before
    }

    /// What is applied, or nothing in idle.
    fn drive(&self) -> Drive {
        if self.mode == Mode::Idle {
            return IDLE;
        }
        Drive { duty: Some(self.applied.duty), brake_released: true }
    }

    /// The same where the motion has changed and the torque not yet: nothing, if there was none before.
    fn drive_on(&self) -> Drive {
        let AppliedTorque { duty, .. } = self.applied;
        Drive { duty: (self.applied != AppliedTorque::OFF).then_some(duty), brake_released: true }
    }

    /// Whether this tick enters the mode: not while the brake lets go. Nor does it plan right after a tick that planned:
    /// a host that starts a move each millisecond gets no torque that nothing has bounded but for the first.
    fn enters(&self) -> bool {
        let again = self.planned && self.mode == Mode::Trapezoidal;
        !self.entered && self.mode != Mode::Idle && self.brake_ms >= self.config.brake_ms && !again
    }

    /// Entry actions of the mode, at its first driven tick.
    #[inline(never)]
    fn enter(&mut self) {
        self.entered = true;
        self.stall.restart();
        self.breakaway.restart();
        let position = self.position_wanted.take().map_or(self.position, Counts::from_int);
        self.profile.rest_at(position);
        self.setpoint = self.profile.current();
        if self.mode == Mode::Trapezoidal {
            self.plan();
        }
    }

    /// The torque that the mode's law wants, damped.
    fn law(&mut self, envelope: &TorqueEnvelope) -> Torque {
        let (torque, missing) = match self.mode {
            Mode::Idle => (Torque::ZERO, Law::ZERO),
            Mode::Torque => (self.torque_wanted, MIN_DAMPING),
            Mode::Velocity => (self.velocity_torque(envelope.most()), self.velocity_loop.missing_damping()),
            Mode::Pid | Mode::Trapezoidal => {
                if self.mode == Mode::Trapezoidal && !self.left_behind() {
                    self.setpoint = self.profile.step();
                }
                let (error, velocity_error) = self.errors();
                let range = envelope.range();
                let torque = self.pid.step(&mut self.pid_state, error, velocity_error, range);
                (torque, self.pid.missing_damping())
            }
        };
        damped(torque, self.velocity, missing)
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

    /// Whether there is a set-point of position.
    const fn is_positioned(&self) -> bool {
        self.entered && matches!(self.mode, Mode::Pid | Mode::Trapezoidal)
    }

    /// How far the position lags behind the set-point.
    fn lag(&self) -> Counts {
        self.setpoint.position.wrapping_sub(self.position)
    }

    /// Whether the position lags too far behind a moving set-point, which then waits. A rotor that is ahead is
    /// not waited for: the set-point catches up with it.
    fn left_behind(&self) -> bool {
        let lag = self.lag();
        let lag =
            if self.setpoint.velocity < CountsPerSec::ZERO { Counts::ZERO.wrapping_sub(lag) } else { lag };
        lag > WAIT_LAG
    }

    /// Errors of the position loop. At rest in the cell of a resting set-point the error is nought: the halls
    /// cannot tell more, and an integrator on half a count would hunt.
    fn errors(&self) -> (Law, Law) {
        let resting = self.setpoint.velocity == CountsPerSec::ZERO;
        let same_cell = self.setpoint.position.round() == self.position.round();
        let error = if resting && same_cell { Law::ZERO } else { self.lag().saturating_error() };
        // Below 2^13 and 2^14 counts/s: it does not wrap.
        (error, self.setpoint.velocity.0.wrapping_sub(self.velocity.0))
    }

    /// Whether the host steers the motion from moment to moment, and must be there to end it.
    const fn is_steered(&self) -> bool {
        matches!(self.mode, Mode::Torque | Mode::Velocity)
    }

    fn torque_ceiling(&self) -> Torque {
        if self.purpose == Purpose::SeekStop { self.homing_torque() } else { Config::torque(self.config.mt) }
    }

    /// The velocity that the present motion wants.
    fn velocity_goal(&self) -> CountsPerSec {
        match self.purpose {
            Purpose::Plain if self.mode == Mode::Velocity => self.velocity_wanted,
            Purpose::Plain | Purpose::LeaveStop if self.is_positioned() => self.setpoint.velocity,
            Purpose::Plain | Purpose::LeaveStop => CountsPerSec::ZERO,
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

    /// Plans the profile to the goal from the present set-point.
    fn plan(&mut self) {
        self.profile.plan(Counts::from_int(self.goal()), &self.bounds);
        self.setpoint = self.profile.current();
        self.stall.restart();
    }

    fn report(&mut self, event: Event) {
        if self.events.is_full() {
            self.events.pop_front();
        }
        // Room was made above.
        let _ = self.events.push_back(event);
        self.has_event = true;
    }
}

fn bounds_of(config: &Config) -> profile::CruiseRamps {
    let Config { accel, mv, mcv, mov, .. } = *config;
    let (closing, opening) = (Config::speed(mv.min(mcv)), Config::speed(mv.min(mov)));
    profile::MoveLimits { accel, closing, opening }.build()
}

fn pid_of(config: &Config) -> Pid {
    PidConfig { kp: config.kp, ki: config.ki, kd: config.kd }.build()
}
