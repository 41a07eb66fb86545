//! The servo of one motor: commands and sensor readings in, a duty and a brake state out.
//!
//! [`Servo::command`] accepts or refuses a command at once. [`Servo::tick`] is the one place that fixes the order of
//! sensing, guards, control law and limits. What the motor is doing is a private enum, `Motion`, whose variants own
//! the data of their motion; the mode that hosts read is derived from it (decision 0044).

use crate::command::{Command, Drive, EndReason, Event, Refusal, Sense, Telemetry};
use crate::config::{self, Config};
use crate::guard::arrival::{Arrival, Rest, arrived};
use crate::guard::breakaway::Breakaway;
use crate::guard::direction::{Direction, Starts, Verdict};
use crate::guard::fault::{Condition, Fault, Faults};
use crate::guard::limits::{AppliedTorque, LastTick, Scale, TorqueEnvelope, TorqueLimiter};
use crate::guard::stall::Stall;
use crate::guard::strain::Window;
use crate::guard::thermal::{HotMark, Start, Thermal, Winding};
use crate::mode::Mode;
use crate::motion::pid::{Errors, Gains, Pid, PidState, Stage};
use crate::motion::profile::{MoveLimits, Profile, Ramps, Reach, SetPoint};
use crate::motion::torque::{damped, emf, sure_emf};
use crate::motion::velocity_loop::VelocityLoop;
use crate::motor::{BoardFigures, Motor, Unfit};
use crate::num::{Law, TICK_HZ, mul_clamped, mul_low, mul_low_unsigned, saturating_i16, times};
use crate::sense::hall::{HallEdge, HallEvent};
use crate::sense::observer::{Model, Observer, Push};
use crate::units::{Counts, CountsPerSec, Torque};
use crate::way::Way;
use heapless::Deque;

#[cfg(test)]
mod tests;

/// The profile waits while the rotor lags the set-point by more than this, so that it does not run away from a motor
/// at its torque limit. At the default KP six counts ask for half of MT (decision 0006).
const WAIT_LAG: Counts = Counts::from_int(6);

/// From this lag on a position-controlled motor counts as driven, and the stall timer runs.
const DRIVEN_LAG: Counts = Counts::from_int(1);

/// Least stall time in HI: hosts poll slowly and must see mode 4 (decision 0009). TSTOP 0 would let a stage wait forever.
const HOMING_TSTOP_MIN: u16 = 250;

/// In HI the motor leaves the stop by this many counts to prove that it can turn, and returns to it: two thirds of a motor
/// revolution, more than a held worm or a compressed stop springs back (decision 0048).
const PROOF_WAY: i32 = 12;

/// Largest distance between the two contacts of HI, in counts: the stop may lie on the boundary of two.
const SAME_STOP: i32 = 1;

/// Longest way that HI orders towards a stop: four times the widest joint, a tip with 508 counts.
const SEEK_WAY: u32 = 2048;

/// Longest way that HI orders from the stop or back to it. At IVEL the motor needs a tenth of it.
const PROVE_WAY: u32 = 128;

/// Speeds of IVEL beyond this count as this when HI measures the way it has ordered, in counts/s: a weak motor is slower.
const SURE_SPEED: u16 = 100;

/// Counts that V orders within TSTOP from which a missing one is a stall in mode 4: a slower rotor may stick for as long. V 26 at TSTOP 300
/// presses with 2·26 of its gain, 81 of friction and 40 of load.
const STALL_WAY: i32 = 8;

/// Events that wait to be fetched; the oldest is dropped when a host never asks.
const EVENTS: usize = 8;

const IDLE: Drive = Drive { duty: None, brake_released: false };

/// Acceleration of mode 3 of the hand's motor, 2^-26 counts a tick²: 15,000 counts/s² (ACCEL 125), a quarter of what it can do.
const STEP_ACCEL: u32 = 1_000_000;
/// MKA of the hand's motor.
const HAND_GAIN: u32 = 1454;

/// Torque that the profile leaves to the feedback, torque units, and the share of the deceleration of full torque that it plans with,
/// 0.38 in 2^-16: the last count before the end is not seen before the next edge.
const RESERVE: i32 = 20;
const BRAKING: i32 = 24_903;
const HARD_BRAKING: i32 = 52_429;

/// Least accelerations of a set-point of the hand's motor, 2^-26 counts a tick² (500 counts/s², 0.7 % of what it can do): one that waits for a weak
/// motor shows that it lags.
const LEAST_REACH: u32 = 33_554;

/// Least position error towards the set-point's cell while the rotor is in another one: the model may take the rotor to be there, counts.
const LEAST_ERROR: Law = Law::lit("0.25");

/// How long a motor stays shorted once it is, ms: a return to the profile in between returns as much as it has saved.
const SHORTED_MS: u8 = 4;

/// Braking beyond what the law asks for that is the supply's, torque units.
const FORCED: i32 = 64;

/// Velocity below which the set-point of a motor without torque to spare still speeds up, as a share of the no-load speed: 50 counts/s of 1056.
const STARTING_SHARE: u32 = 21;

/// What follows from the motor and its board.
#[derive(Clone, Copy, Debug)]
struct Figures {
    /// Friction at rest. A motor that stands still under more torque than this has met its stop; under less it may be stuck anywhere.
    friction: Torque,
    model: Model,
    scale: Scale,
    winding: Winding,
    starts: Starts,
    rest: Rest,
    step_accel: i32,
    least_reach: i32,
    /// Share of the deceleration of full torque that the profile plans with, 2^-16.
    braking: i32,
    starting: CountsPerSec,
    /// Largest velocity of a motion, counts/s: see [`Motor::most_speed`].
    fastest: u16,
}

/// Least torque that is taken for a push on a stop.
const LEAST_FRICTION: u16 = 8;

impl Figures {
    /// Of a motor that fits its board.
    #[inline(never)]
    fn new(motor: &Motor, board: &BoardFigures) -> Self {
        let (gain, friction) = (u32::from(motor.mka), motor.stiction().max(LEAST_FRICTION));
        let fastest = motor.most_speed(board);
        let of_gain = |hands: u32| mul_low_unsigned(hands, (gain << 15) / HAND_GAIN, 15).cast_signed();
        let starting = saturating_i16((motor.no_load() / STARTING_SHARE).cast_signed());
        Self {
            friction: config::torque(friction),
            model: Model::new(motor),
            scale: Scale::new(motor, board),
            winding: Winding::new(motor),
            starts: Starts::new(motor),
            rest: Rest::new(motor),
            step_accel: of_gain(STEP_ACCEL),
            least_reach: of_gain(LEAST_REACH),
            braking: if fastest.is_some() { HARD_BRAKING } else { BRAKING },
            starting: CountsPerSec::from_int(starting),
            fastest: fastest.unwrap_or(u16::MAX),
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct PositionLoop {
    setpoint: SetPoint,
    profile: Profile,
    pid: PidState,
    /// The bus takes no more returned current: the motor brakes with its terminals shorted for so long, and does not speed up again.
    shorted: bool,
    shorted_ms: u8,
}

impl PositionLoop {
    const fn at_rest(position: Counts, pid: PidState) -> Self {
        Self {
            setpoint: SetPoint::at_rest(position),
            profile: Profile::at_rest(position),
            pid,
            shorted: false,
            shorted_ms: 0,
        }
    }

    /// Takes another end; the set-point goes on from where it is.
    fn set_end(&mut self, end: Counts) {
        (self.shorted, self.shorted_ms) = (false, 0);
        self.profile.set_end(end);
        self.setpoint = self.profile.current();
    }

    fn lag(&self, position: Counts) -> Counts {
        self.setpoint.position.wrapping_sub(position)
    }

    /// The profile does not wait for a rotor that is nearer to its end than the set-point: the set-point catches up with it, or returns
    /// from an obstacle.
    fn must_wait(&self, position: Counts) -> bool {
        let (lag, left) = (self.lag(position), self.profile.end().wrapping_sub(self.setpoint.position));
        if left > Counts::ZERO {
            lag > WAIT_LAG
        } else {
            left < Counts::ZERO && lag.wrapping_neg() > WAIT_LAG
        }
    }
}

/// A stage of HI at IVEL.
#[derive(Clone, Copy, Debug)]
enum Homing {
    /// Towards the stop, at IVEL.
    Seek,
    /// Away from the stop, which is position 0, to prove that the motor can turn. `stop`: the way that it ends.
    Leave { stop: Way },
    /// Back to the stop.
    Return { stop: Way },
}

/// What the motor does, or will do once its brake has released (`Servo::releasing`).
#[derive(Clone, Copy, Debug)]
enum Motion {
    /// Bridge off, brake engaged.
    Idle,
    /// Mode 2.
    Torque(Torque),
    /// Mode 3: P, or a hold after the end of a motion. `to`: where it heads from its start on; without it it stays in its cell.
    Position { control: PositionLoop, to: Option<i32> },
    /// Mode 4: V.
    Velocity,
    /// TC or TO.
    TorqueControlled { way: Way },
    /// After TC or TO stalled with HOLD: keeps pressing with MT and cannot stall again.
    Pressing { way: Way },
    /// Mode 5: a move to E. `holds`: its end is a hold whatever HOLD is, because MODE ordered it (decision 0069).
    Move { control: PositionLoop, breakaway: Breakaway, arrival: Arrival, holds: bool },
    /// FIND: the legs of one sector are held with this torque.
    Field(Torque),
    /// HI, until the second contact with the stop. `way`: what the stage has ordered, in counts/s · ms; it bounds its time.
    Home { stage: Homing, way: u32 },
    /// HI, from the stop to zero.
    Zero { control: PositionLoop, arrival: Arrival },
}

/// What a host has to do with a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Host {
    /// Nothing: it lasts until it is replaced.
    Free,
    /// It closes the loop: mode 2 or 4 that it has set. HI, TC and TO are in mode 4 too, but end by themselves.
    Steers,
    /// It waits for the end, which the motion finds by itself.
    Waits,
}

/// What a motion wants of a tick.
#[derive(Clone, Copy, Debug)]
struct Demand {
    law: Wanted,
    /// Most torque, beside what all motions are limited to.
    ceiling: Torque,
    emf: Emf,
    pushes: Pushes,
}

#[derive(Clone, Copy, Debug)]
enum Wanted {
    Torque(Torque),
    Velocity(CountsPerSec, Presses),
    /// Of the motion's [`PositionLoop`].
    Position,
}

/// When a motion at a velocity applies all of its ceiling, or nothing.
#[derive(Clone, Copy, Debug)]
enum Presses {
    /// Never.
    No,
    /// All, while the rotor is slower than half its approach speed; if the object gives way, the velocity loop takes over.
    Against(Way),
    /// All, before a missing count is taken for a stall: a joint that is wedged may need more than the loop asks for.
    BeforeStall,
    /// Nothing, right after a stall: RealTime enters mode 4 again at once, and must rest so that it can press again at all.
    AfterRest,
}

/// Which EMF is compensated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Emf {
    /// None: a field that does not follow the rotor, counted by a wiring that is to be replaced.
    None,
    /// Of a rotor under the torque of mode 2: its model runs on at an obstacle.
    Under,
    /// Of a rotor that may stand: it is not faster because its motor pushes, and MT and IHIT hold for what it feels.
    Standing,
    /// Of a rotor that moves, unless a limit acts.
    Moving,
}

/// Which way a motion pushes, so that a missing hall count is a stall.
#[derive(Clone, Copy, Debug)]
enum Pushes {
    /// However little torque a low gain asks for; `None`: neither way, and nothing stalls.
    Along(Option<Way>),
    /// Where its torque does: mode 4, which runs until something stops it.
    ByTorque,
    /// Where its [`PositionLoop`] does. ACCEL 0 cannot move: a move ends as a stall then, instead of never, this way.
    OnLoop(Option<Way>),
}

impl Motion {
    const fn kind(&self) -> (Mode, Host) {
        match self {
            Self::Idle => (Mode::Idle, Host::Free),
            Self::Torque(_) => (Mode::Torque, Host::Steers),
            Self::Position { .. } => (Mode::Pid, Host::Free),
            Self::Velocity => (Mode::Velocity, Host::Steers),
            Self::Pressing { .. } => (Mode::Velocity, Host::Free),
            Self::TorqueControlled { .. } | Self::Home { .. } => (Mode::Velocity, Host::Waits),
            Self::Move { .. } | Self::Zero { .. } | Self::Field(_) => (Mode::Trapezoidal, Host::Waits),
        }
    }

    const fn mode(&self) -> Mode {
        self.kind().0
    }

    const fn is_awaited(&self) -> bool {
        matches!(self.kind().1, Host::Waits)
    }

    const fn needs_host(&self) -> bool {
        matches!(self.kind().1, Host::Steers)
    }

    const fn position_loop(&self) -> Option<&PositionLoop> {
        match self {
            Self::Position { control, .. } | Self::Move { control, .. } | Self::Zero { control, .. } => {
                Some(control)
            }
            Self::Idle
            | Self::Torque(_)
            | Self::Velocity
            | Self::TorqueControlled { .. }
            | Self::Pressing { .. }
            | Self::Field(_)
            | Self::Home { .. } => None,
        }
    }
}

/// What a motor can do with the torque that the limits, the bus and its load leave.
fn reach(figures: &Figures, observer: &Observer, control: &PositionLoop, envelope: &TorqueEnvelope) -> Reach {
    let velocity = control.setpoint.velocity;
    let closes = control.profile.closes();
    let (back, load) = (emf(observer.emf(), velocity), i32::from(Torque::from_fixed(observer.load()).0));
    let (back, load) = if closes { (back, load) } else { (-back, -load) };
    // Torques are below 2^14, at 4080 counts/s too, and the gain below 2^15.
    let (gain, friction) = (observer.sure_gain(), observer.friction().to_bits() >> 16);
    let up = envelope.forward(back) - friction + load.min(0) - RESERVE;
    let down = envelope.most_units() + friction - load.max(0) - RESERVE;
    let starting = velocity > figures.starting.saturating_neg() && velocity < figures.starting;
    let up = if starting {
        (up * gain).max(figures.least_reach)
    } else if control.shorted {
        0
    } else {
        (up * gain).max(0)
    };
    Reach { up, down: mul_low(down * gain, figures.braking, 16).max(figures.least_reach) }
}

/// What the set-point does, and the position error that counts, of a rotor that the halls have in the cell of `position`.
fn stage(setpoint: &SetPoint, position: Counts, error: Law) -> (Stage, Law) {
    match setpoint.position.round().wrapping_sub(position.round()) {
        _ if !setpoint.done => (Stage::Move, error),
        0 => (Stage::Cell, error),
        // The halls are sure of the cell, not the model.
        1.. => (Stage::Rest, error.max(LEAST_ERROR)),
        _ => (Stage::Rest, error.min(-LEAST_ERROR)),
    }
}

/// Friction in the direction of the set-point's velocity `goal`, or of the error at its end, and the observed load; torque units.
fn carried(observer: &Observer, stage: Stage, goal: Law, error: Law) -> (Law, Law) {
    const ONE: i32 = Law::ONE.to_bits();
    let friction = observer.friction() + observer.kick();
    let load = observer.load();
    let friction = match stage {
        Stage::Move if goal != Law::ZERO => {
            let share = goal.to_bits() >> 1;
            if share >= ONE {
                friction
            } else if share <= -ONE {
                -friction
            } else {
                times(friction, Law::from_bits(share))
            }
        }
        // Friction holds a resting rotor with what is too little, or too much: half of it lets neither a wrong load nor a missing one move it.
        Stage::Cell => {
            let held = Law::from_bits(observer.friction().to_bits() >> 1);
            return (Law::ZERO, load - load.max(-held).min(held));
        }
        Stage::Move | Stage::Rest if error < Law::ZERO => -friction,
        Stage::Move | Stage::Rest => friction,
    };
    (friction, load)
}

/// Most torque of a motion and of HI.
fn limits(config: &Config, limit: Torque) -> (Torque, Torque) {
    (config::torque(config.mt).min(limit), config::torque(config.ihit.min(config.mt)).min(limit))
}

#[derive(Debug)]
struct Tuning {
    config: Config,
    /// Of the last motor that fitted.
    figures: Figures,
    /// Why the present one does not: nothing moves then.
    unfit: Option<Unfit>,
    pid: Pid,
    velocity_loop: VelocityLoop,
    strain: Window,
    ramps: Ramps,
    step_ramps: Ramps,
    most: Torque,
    homing_most: Torque,
}

impl Tuning {
    #[inline(never)]
    fn new(config: Config, unfit: Option<Unfit>, figures: Figures, direction: &Direction) -> Self {
        let Config { mv, mcv, mov, accel, ki, hsg, lsg, .. } = config;
        let gains = Gains::new(&config);
        let mv = mv.min(figures.fastest);
        let (closing, opening) = (config::speed(mv.min(mcv)), config::speed(mv.min(mov)));
        let (most, homing_most) = limits(&config, direction.limit(&figures.starts));
        Self {
            config,
            unfit,
            figures,
            pid: gains.build(ki),
            velocity_loop: VelocityLoop::new(gains.kpv, &config.motor),
            strain: Window::new(hsg, lsg),
            ramps: MoveLimits { accel, closing, opening }.build(),
            step_ramps: Ramps::as_fast_as(figures.step_accel),
            most,
            homing_most,
        }
    }

    /// Limits the torque until the direction is known.
    #[inline(never)]
    fn limit(&mut self, limit: Torque) {
        (self.most, self.homing_most) = limits(&self.config, limit);
    }

    fn can_home(&self) -> bool {
        self.config.ivel != 0 && config::torque(self.config.ihit.min(self.config.mt)) >= self.figures.friction
    }

    fn press_speed(&self, way: Way) -> CountsPerSec {
        match way {
            Way::Closing => config::speed(self.config.mcv),
            Way::Opening => config::speed(self.config.mov).saturating_neg(),
        }
    }
}

/// The servo of one motor.
#[derive(Debug)]
pub struct Servo {
    tuning: Tuning,
    motion: Motion,
    /// How long the brake has been energized, ms, while the motion waits for its release; `None` once it has started, and in idle.
    releasing: Option<u16>,
    observer: Observer,
    /// Hall count at the last tick.
    count: i32,
    /// Hall count that is position 0.
    zero: i32,
    position: Counts,
    velocity: CountsPerSec,
    /// Property E.
    end: i32,
    /// Property V, for the present mode 4 or the next. The end of a motion clears it, so that no host starts at the
    /// velocity of another (decision 0050).
    velocity_wanted: CountsPerSec,
    stall: Stall,
    thermal: Thermal,
    limiter: TorqueLimiter,
    faults: Faults,
    applied: AppliedTorque,
    /// The last tick braked harder than the law wanted.
    forced: bool,
    /// An edge shows a load rather than a motion that was ordered.
    resting: bool,
    ended: Option<EndReason>,
    homed: bool,
    /// Whether the wiring and the direction of closing are known. HI is refused before.
    wired: bool,
    direction: Direction,
    broke_away: Option<i32>,
    events: Deque<Event, EVENTS>,
}

impl Servo {
    /// A servo in idle, at rest in the cell `count` of the hall decoder; that cell is position `count`.
    #[must_use]
    pub fn new(config: Config, count: i32) -> Self {
        let unfit = config.motor.check(config.board).err();
        let figures = Figures::new(if unfit.is_none() { &config.motor } else { &Motor::HAND }, config.board);
        let direction = Direction::at_rest(&figures.starts, count);
        Self {
            tuning: Tuning::new(config, unfit, figures, &direction),
            motion: Motion::Idle,
            releasing: None,
            observer: Observer::new(figures.model, count),
            count,
            zero: 0,
            position: Counts::from_int(count),
            velocity: CountsPerSec::ZERO,
            end: count,
            velocity_wanted: CountsPerSec::ZERO,
            stall: Stall::default(),
            thermal: Thermal::default(),
            limiter: TorqueLimiter::default(),
            faults: Faults::default(),
            applied: AppliedTorque::OFF,
            forced: false,
            resting: false,
            ended: None,
            homed: false,
            wired: true,
            direction,
            broke_away: None,
            events: Deque::new(),
        }
    }

    // --- inputs besides commands and the tick ----------------------------------------------------------------

    /// Marks the position as known, as after HI: it was stored and the rotor has not moved since.
    pub const fn trust_position(&mut self) {
        self.homed = true;
    }

    /// Marks the position as unknown: HI is needed.
    pub const fn doubt_position(&mut self) {
        self.homed = false;
    }

    /// Takes another wiring. `known`: also its direction of closing; without it HI is refused.
    pub fn set_wired(&mut self, known: bool) {
        self.wired = known;
        self.set_direction(self.at_rest());
    }

    const fn at_rest(&self) -> Direction {
        Direction::at_rest(&self.tuning.figures.starts, self.count)
    }

    fn set_direction(&mut self, direction: Direction) {
        self.direction = direction;
        self.tuning.limit(direction.limit(&self.tuning.figures.starts));
    }

    /// Marks the direction as seen to be right, as after the first counts: for tests of what comes later.
    pub fn trust_direction(&mut self) {
        self.set_direction(Direction::Right);
    }

    /// Sets the torque of FIND's field, from the next tick on, if its bridge is on; limits apply.
    pub const fn set_field(&mut self, torque: Torque) {
        if self.has_field() {
            self.motion = Motion::Field(torque);
        }
    }

    /// Ends FIND; `found`: with a wiring.
    pub fn end_field(&mut self, found: bool) {
        if self.is_finding() {
            let reason = if found { EndReason::Arrived } else { EndReason::Aborted };
            self.idle();
            self.ended = Some(reason);
            self.report(Event::Ended { reason, mode: Mode::Idle });
        }
    }

    /// Whether FIND's bridge is on.
    #[must_use]
    pub const fn has_field(&self) -> bool {
        self.is_finding() && self.releasing.is_none()
    }

    /// Whether FIND is under way.
    #[must_use]
    pub const fn is_finding(&self) -> bool {
        matches!(self.motion, Motion::Field(_))
    }

    /// Sets what is known of the winding's heat, before the first tick.
    pub const fn start_warm(&mut self, start: Start) {
        self.thermal.start(start);
    }

    /// Reports whether the flash has the hot mark: see [`Thermal::set_marked`].
    pub const fn set_hot_mark(&mut self, stored: bool) {
        self.thermal.set_marked(stored);
    }

    /// One step of the hall count. Called in the hall interrupt, so that a tick costs the same with and without edges.
    #[inline]
    pub fn edge(&mut self, edge: &HallEdge) {
        if edge.uncertain {
            self.homed = false;
        }
        self.observer.edge(edge);
    }

    /// One event of the hall decoder, when it happens.
    pub fn hall(&mut self, event: &HallEvent) {
        match *event {
            HallEvent::Step(edge) => self.edge(&edge),
            HallEvent::Glitch(glitch) => self.report(Event::Glitch(glitch)),
            // The decoder's wiring is the one that FIND is to replace.
            HallEvent::Fault(_) if self.is_finding() => {}
            HallEvent::Fault(_) => {
                // The count may have slipped by an electrical revolution.
                self.homed = false;
                self.faults.raise(Condition::HALLS);
            }
        }
    }

    /// The break input has switched the bridge off. Latches [`Fault::Bridge`] at the next tick.
    pub const fn bridge_fault(&mut self) {
        self.faults.raise(Condition::BRIDGE);
    }

    /// A host has ordered something: clears [`Fault::HostLost`].
    pub const fn host_is_back(&mut self) {
        self.faults.host_is_back();
    }

    // --- outputs besides the drive ---------------------------------------------------------------------------

    /// The next report, oldest first.
    pub fn event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Whether a report waits.
    #[must_use]
    pub fn has_event(&self) -> bool {
        !self.events.is_empty()
    }

    /// The present state.
    #[must_use]
    pub fn telemetry(&self) -> Telemetry {
        Telemetry {
            mode: self.motion.mode(),
            position: self.position,
            velocity: self.velocity,
            setpoint: match self.motion.position_loop() {
                Some(control) if self.releasing.is_none() => control.setpoint.position,
                _ => self.position,
            },
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

    /// Whether the hot mark in the flash is as it should be.
    #[must_use]
    pub const fn hot_mark(&self) -> HotMark {
        self.thermal.hot_mark(&self.tuning.figures.winding, !matches!(self.motion, Motion::Idle))
    }

    /// The winding's rise over the thermistor, to be kept over a reset, 0.1 K; `None` before the first tick.
    #[must_use]
    pub fn rise(&self) -> Option<u16> {
        self.thermal.rise()
    }

    /// What an interrupted program may have heated the winding beyond [`Self::rise`], 0.1 K.
    #[must_use]
    pub const fn uncounted(&self) -> u16 {
        self.tuning.figures.winding.uncounted()
    }

    /// Why the board cannot drive the motor as it is described; nothing moves then.
    #[must_use]
    pub const fn unfit(&self) -> Option<Unfit> {
        self.tuning.unfit
    }

    /// The torque limits of a motor whose wiring is not known: FIND's.
    #[must_use]
    pub const fn starts(&self) -> &Starts {
        &self.tuning.figures.starts
    }

    /// The present configuration.
    #[must_use]
    pub const fn config(&self) -> &Config {
        &self.tuning.config
    }

    /// Property E as it was set.
    #[must_use]
    pub const fn end(&self) -> i32 {
        self.end
    }

    /// Property V as it was set, if no motion has ended since: the velocity of mode 4, now or once it starts.
    #[must_use]
    pub const fn velocity_wanted(&self) -> CountsPerSec {
        self.velocity_wanted
    }

    /// What property T reads: in mode 2 the commanded torque, unless a limit reduced it, which MT does before the first tick; elsewhere the torque
    /// applied.
    #[must_use]
    pub fn torque(&self) -> Torque {
        match self.motion {
            Motion::Torque(wanted) if self.applied.limit.is_none() => wanted.clamp_abs(self.tuning.most),
            _ => self.applied.torque,
        }
    }

    // --- commands --------------------------------------------------------------------------------------------

    /// Accepts and executes a command, or refuses it.
    ///
    /// # Errors
    /// Why the command was refused; nothing has changed then.
    // Compiled with its caller, for size: it is not part of the tick.
    #[inline]
    pub fn command(&mut self, command: Command) -> Result<(), Refusal> {
        self.check(&command)?;
        if command.moves() || matches!(command, Command::Mode(_) | Command::Terminate) {
            self.faults.host_is_back();
        }
        match command {
            Command::Mode(mode) => self.set_mode(mode),
            Command::Torque(torque) => self.set_torque(torque),
            Command::Velocity(velocity) => self.set_velocity(velocity),
            Command::Position(position) => self.set_position(position),
            Command::End(end) => self.set_end(end),
            Command::Move(end) => {
                self.set_end(end);
                self.move_to_end(false);
            }
            Command::MoveToEnd => self.enter_mode_5(false),
            Command::TorqueControlled { way } => self.replace(Motion::TorqueControlled { way }),
            Command::Home => {
                self.homed = false;
                self.replace(Motion::Home { stage: Homing::Seek, way: 0 });
            }
            Command::Find => {
                self.homed = false;
                self.faults.clear();
                self.begin(Motion::Field(Torque::ZERO));
            }
            Command::Terminate => self.terminate(),
            Command::Configure(config) => self.configure(config),
            Command::ClearFault => {
                self.faults.clear();
                self.thermal.look_next();
            }
            Command::ClearBreakaway => self.broke_away = None,
        }
        Ok(())
    }

    fn check(&self, command: &Command) -> Result<(), Refusal> {
        if let Some(fault) = self.faults.forbidding()
            && command.moves()
        {
            let of_wires = matches!(fault, Fault::Halls | Fault::Wiring | Fault::Jammed);
            if !(of_wires && matches!(command, Command::Find)) {
                return Err(Refusal::Fault(fault));
            }
        }
        if let Some(unfit) = self.tuning.unfit
            && command.moves()
        {
            return Err(Refusal::Motor(unfit));
        }
        if !self.wired && matches!(command, Command::Home) {
            return Err(Refusal::Wiring);
        }
        let mode = self.motion.mode();
        if !command.allowed_in(mode) {
            return Err(Refusal::Mode(mode));
        }
        if !command.is_representable() {
            return Err(Refusal::Range);
        }
        // Without velocity or torque HI would take any place for the stop.
        let can_home = self.tuning.can_home();
        if matches!(command, Command::Home) && !can_home { Err(Refusal::Homing) } else { Ok(()) }
    }

    fn set_mode(&mut self, mode: Mode) {
        match mode {
            Mode::Trapezoidal => self.enter_mode_5(true),
            _ if mode == self.motion.mode() => {}
            Mode::Idle => self.terminate(),
            Mode::Torque => self.replace(Motion::Torque(Torque::ZERO)),
            Mode::Pid => {
                self.replace(Motion::Position { control: self.at_rest_with(self.carried_pid()), to: None })
            }
            Mode::Velocity => self.replace(Motion::Velocity),
        }
    }

    /// HI and FIND are in mode 5 at times, and go on.
    fn enter_mode_5(&mut self, holds: bool) {
        match self.motion {
            Motion::Zero { .. } | Motion::Field(_) => {}
            _ => self.move_to_end(holds),
        }
    }

    /// A move under way goes on; it ends as its last order says.
    fn move_to_end(&mut self, holds: bool) {
        match &mut self.motion {
            Motion::Move { holds: held, .. } => *held = holds,
            _ => self.replace(Motion::Move {
                control: self.at_rest_with(self.carried_pid()),
                breakaway: Breakaway::default(),
                arrival: Arrival::of(false),
                holds,
            }),
        }
    }

    /// Between hold and move the load stays carried; from any other motion the integrator starts empty.
    fn carried_pid(&self) -> PidState {
        self.motion.position_loop().map_or(PidState::default(), |control| control.pid)
    }

    const fn at_rest_with(&self, pid: PidState) -> PositionLoop {
        PositionLoop::at_rest(self.position, pid)
    }

    /// Idles at once, regardless of HOLD; if a host awaits the motion, reports it as aborted.
    fn terminate(&mut self) {
        let awaited = self.motion.is_awaited();
        self.idle();
        if awaited {
            self.ended = Some(EndReason::Aborted);
            self.report(Event::Ended { reason: EndReason::Aborted, mode: Mode::Idle });
        }
    }

    /// Replaces the present motion; if a host awaits it, reports it as aborted.
    fn replace(&mut self, motion: Motion) {
        if self.motion.is_awaited() {
            self.report(Event::Ended { reason: EndReason::Aborted, mode: motion.mode() });
        }
        if matches!(self.motion, Motion::Velocity) {
            self.velocity_wanted = CountsPerSec::ZERO;
        }
        self.begin(motion);
    }

    fn begin(&mut self, motion: Motion) {
        let brake_ms = match self.motion {
            Motion::Idle => 0,
            _ => self.releasing.unwrap_or(self.tuning.config.brake_ms),
        };
        self.ended = None;
        self.motion = motion;
        self.releasing = Some(brake_ms);
    }

    fn set_position(&mut self, position: i32) {
        match &mut self.motion {
            Motion::Position { to, .. } if self.releasing.is_some() => *to = Some(position),
            Motion::Position { control, .. } => control.set_end(Counts::from_int(position)),
            Motion::Idle => {
                self.zero = self.count.wrapping_sub(position);
                let shift = position.wrapping_sub(self.position.round());
                self.position = self.position.wrapping_add(Counts::from_int(shift));
            }
            // Refused by `Command::allowed_in`.
            _ => {}
        }
    }

    fn set_torque(&mut self, torque: Torque) {
        // `Command::allowed_in` refuses it in the others.
        if let Motion::Torque(wanted) = &mut self.motion {
            *wanted = torque;
        }
    }

    /// Writing the same E again does not re-plan.
    fn set_end(&mut self, end: i32) {
        let changed = end != self.end;
        self.end = end;
        if changed && matches!(self.motion, Motion::Move { .. }) {
            self.plan();
        }
    }

    /// V takes over from TC and TO; it does not disturb HI.
    fn set_velocity(&mut self, velocity: CountsPerSec) {
        self.velocity_wanted = velocity;
        if let Motion::TorqueControlled { .. } | Motion::Pressing { .. } = self.motion {
            self.motion = Motion::Velocity;
        }
    }

    fn configure(&mut self, config: Config) {
        let old = self.tuning.config;
        let shape = |c: &Config| (c.accel, c.mv, c.mcv, c.mov);
        let reshaped = match self.motion {
            Motion::Move { .. } => shape(&config) != shape(&old),
            Motion::Zero { .. } => (shape(&config), config.ioff) != (shape(&old), old.ioff),
            _ => false,
        };
        let (mut figures, mut unfit) = (self.tuning.figures, self.tuning.unfit);
        if config.motor != old.motor {
            unfit = config.motor.check(config.board).err();
            // The thresholds of the motor before hold for one that is not driven.
            if unfit.is_none() {
                figures = Figures::new(&config.motor, config.board);
                self.observer.set_model(figures.model);
            } else if !matches!(self.motion, Motion::Idle) {
                self.terminate();
            }
        }
        self.tuning = Tuning::new(config, unfit, figures, &self.direction);
        self.thermal.look_next();
        if reshaped {
            self.plan();
        }
    }

    // --- the tick, step by step ------------------------------------------------------------------------------

    /// One control tick, 1 ms after the last: sense, guard, law, limits, in this order.
    pub fn tick(&mut self, sense: &Sense) -> Drive {
        let drive = self.control(sense);
        let is_field = matches!(self.motion, Motion::Field(_));
        self.observer.predict(match drive.duty {
            Some(_) if !is_field => Push::Volts { volts: self.applied.volts, resting: self.resting },
            _ => Push::Off,
        });
        drive
    }

    /// Sense, judge, demand, law, limit, drive.
    fn control(&mut self, sense: &Sense) -> Drive {
        let (counted, due) = self.sense(sense);
        if let Some(drive) = self.judge(sense, counted, due) {
            return drive;
        }
        // What is demanded is read anew for each: kept, it would cost the tick 20 instructions.
        let (ceiling, emf) = ((self.demand().ceiling, self.thermal.most()), self.emf(self.demand().emf));
        let last = LastTick { current: sense.current, applied: &self.applied, counted };
        let scale = &self.tuning.figures.scale;
        let envelope = self.limiter.envelope(scale, ceiling, emf, sense.bus, &last);
        let wanted = self.law(self.demand().law, &envelope);
        let scale = &self.tuning.figures.scale;
        self.applied = envelope.bound(scale, wanted, self.applied.torque);
        self.forced = sense.bus > scale.bus().return_from && self.is_forced(wanted);
        self.drive()
    }

    /// Position, velocity, heat and faults. Returns whether the count changed, and whether the motion was due to start.
    #[inline(always)]
    fn sense(&mut self, sense: &Sense) -> (bool, bool) {
        if sense.host_lost && self.motion.needs_host() {
            self.faults.raise(Condition::HOST_LOST);
        }
        let counted = self.observe(sense);
        let due = self.is_due();
        if self.thermal.step(
            &self.tuning.figures.winding,
            self.applied.torque,
            sense.motor_temp,
            self.tuning.config.otemp,
        ) {
            self.faults.raise(Condition::HOT);
        }
        if let Some(fault) = self.faults.check(sense.bus) {
            self.fail(fault);
        }
        (counted, due)
    }

    /// What starts, stops or ends the motion. Returns the drive of a tick without a law.
    #[inline(always)]
    fn judge(&mut self, sense: &Sense, counted: bool, due: bool) -> Option<Drive> {
        const OPEN: Drive = Drive { duty: None, brake_released: true };
        if matches!(self.motion, Motion::Idle) {
            self.rest(counted);
            self.limiter.idle(&self.tuning.figures.scale, sense.bus);
            return Some(IDLE);
        }
        if let Some(brake_ms) = self.releasing {
            if !due {
                self.rest(counted);
                self.releasing = Some(brake_ms.saturating_add(1));
                self.applied = AppliedTorque::OFF;
                return Some(OPEN);
            }
            self.start();
            if matches!(self.motion, Motion::Idle) {
                return Some(IDLE);
            }
        } else if self.is_finding() {
            // Counted by the wiring that is to be replaced.
            self.velocity = CountsPerSec::ZERO;
        }
        if !self.direction.is_right() && self.watches(counted) && self.watch_direction() {
            self.applied = AppliedTorque::OFF;
            return Some(OPEN);
        }
        if !self.check_end(counted, sense) {
            return None;
        }
        if matches!(self.motion, Motion::Idle) {
            return Some(IDLE);
        }
        // HI goes on from its second contact: the bridge keeps its state for a tick.
        self.releasing.map(|_| {
            self.resting = false;
            self.drive()
        })
    }

    /// Whether the bus takes no more returned current, so that the motor brakes harder than the law wants.
    fn is_forced(&self, wanted: Torque) -> bool {
        let torque = i32::from(self.applied.torque.0);
        let more = if torque > 0 { torque - i32::from(wanted.0) } else { i32::from(wanted.0) - torque };
        more >= FORCED && Way::of(-torque) == Way::of(self.velocity.0.to_bits())
    }

    /// Whether this tick may change what is known of the direction.
    fn watches(&self, counted: bool) -> bool {
        !self.has_field() && (counted || !self.direction.is_settled())
    }

    /// Returns whether the bridge must be open.
    #[inline(never)]
    fn watch_direction(&mut self) -> bool {
        match self.direction.step(&self.tuning.figures.starts, self.count, self.applied.torque) {
            Verdict::Limit(limit) => self.tuning.limit(limit),
            // Without a known direction of closing the motor may be right in itself and yet the mirror image.
            Verdict::Right if self.wired => self.trust_direction(),
            Verdict::Right => self.set_direction(self.at_rest()),
            Verdict::Open => return true,
            Verdict::Wrong => {
                self.faults.raise(Condition::WIRING);
                return true;
            }
        }
        false
    }

    /// Halls → position and velocity. Returns whether the count changed.
    fn observe(&mut self, sense: &Sense) -> bool {
        self.observer.tick(sense.now);
        self.position = self.observer.position().wrapping_sub(Counts::from_int(self.zero));
        self.velocity = self.observer.velocity();
        if self.limiter.watch_current(&self.tuning.figures.scale, sense.current, self.applied.duty) {
            self.faults.raise(Condition::SHORT);
        }
        let before = core::mem::replace(&mut self.count, self.observer.count());
        self.count != before
    }

    const fn drive(&self) -> Drive {
        Drive { duty: Some(self.applied.duty), brake_released: true }
    }

    /// Whether a motion starts in this tick: its brake has released.
    fn is_due(&self) -> bool {
        let Some(brake_ms) = self.releasing else { return false };
        // HI must press for a while to find a stop, also after a motion that has just stalled there; and a zero in the stop is reached
        // by a rotor that has just pressed.
        let presses = match self.motion {
            Motion::Home { .. } => true,
            Motion::Zero { .. } => self.tuning.config.ioff == 0,
            _ => false,
        };
        let rests = presses && self.stall.is_over_half(self.tstop());
        brake_ms >= self.tuning.config.brake_ms && !rests
    }

    /// Starts the motion: its brake has released.
    #[inline(never)]
    fn start(&mut self) {
        self.releasing = None;
        if !self.direction.is_right() && self.applied == AppliedTorque::OFF {
            self.set_direction(self.at_rest());
        }
        // What a hold has taken for a load may be friction.
        match self.motion.mode() {
            Mode::Trapezoidal => self.observer.leave_rest(),
            Mode::Pid => {}
            _ => self.observer.forget_load(),
        }
        let (position, cell) = (self.exact_position(), self.cell());
        match &mut self.motion {
            Motion::Position { control, to } => {
                *control = PositionLoop::at_rest(if to.is_some() { position } else { cell }, control.pid);
                if let Some(to) = *to {
                    control.set_end(Counts::from_int(to));
                }
            }
            // A hold's torque would hide that the motion must rest.
            Motion::Velocity => self.applied = AppliedTorque::OFF,
            Motion::Field(_) => {
                self.set_direction(Direction::standing(&self.tuning.figures.starts, self.count));
            }
            Motion::Move { control, .. } => *control = PositionLoop::at_rest(position, control.pid),
            Motion::Zero { control, .. } => {
                // An IOFF that leads into the stop does not leave it: it would press for another TSTOP.
                self.stall.forget(Way::closing_if(self.tuning.config.ioff < 0));
                *control = PositionLoop::at_rest(position, control.pid);
            }
            Motion::Idle
            | Motion::Torque(_)
            | Motion::TorqueControlled { .. }
            | Motion::Pressing { .. }
            | Motion::Home { .. } => {}
        }
        // Into the obstacle at which the last motion has just stalled, a move would push until its set-point is a count ahead.
        let here = self.position.round();
        let ahead = match self.motion {
            Motion::Move { .. } => Some(self.end),
            Motion::Position { to, .. } => to.filter(|&to| to != here),
            _ => None,
        };
        if ahead.is_some_and(|end| self.stall.is_over(Way::closing_if(end > here), self.tuning.config.tstop))
        {
            self.finish(EndReason::Stalled);
        } else {
            self.plan();
        }
    }

    /// Heads for the end from the present set-point, once the motion has started.
    fn plan(&mut self) {
        if self.releasing.is_some() {
            return;
        }
        let (control, arrival, end) = match &mut self.motion {
            Motion::Move { control, arrival, .. } => (control, arrival, self.end),
            Motion::Zero { control, arrival } => (control, arrival, self.tuning.config.ioff),
            _ => return,
        };
        control.set_end(Counts::from_int(end));
        *arrival = Arrival::of(self.applied.torque != Torque::ZERO);
    }

    /// Middle of the rotor's cell, which is P: a place near a boundary would have the law pull to and fro over it.
    const fn cell(&self) -> Counts {
        Counts::from_int(self.position.round())
    }

    /// Position of the rotor as the law needs it: a misplaced sensor may say another cell.
    fn exact_position(&self) -> Counts {
        self.observer.exact_position().wrapping_sub(Counts::from_int(self.zero))
    }

    /// What the motion wants of this tick.
    #[inline(always)]
    fn demand(&self) -> Demand {
        let most = self.tuning.most;
        let torque = |torque: Torque, emf, pushes| Demand {
            law: Wanted::Torque(torque),
            ceiling: most,
            emf,
            pushes: Pushes::Along(pushes),
        };
        let velocity = |goal, presses, pushes| Demand {
            law: Wanted::Velocity(goal, presses),
            ceiling: most,
            emf: Emf::Moving,
            pushes,
        };
        let position = |stuck| Demand {
            law: Wanted::Position,
            ceiling: most,
            emf: Emf::Moving,
            pushes: Pushes::OnLoop(stuck),
        };
        match self.motion {
            Motion::Idle => torque(Torque::ZERO, Emf::None, None),
            Motion::Field(wanted) => torque(wanted, Emf::None, None),
            Motion::Torque(wanted) => torque(wanted, Emf::Under, Way::of(i32::from(wanted.0))),
            Motion::Velocity => velocity(self.velocity_wanted, Presses::AfterRest, Pushes::ByTorque),
            Motion::TorqueControlled { way } => {
                velocity(self.tuning.press_speed(way), Presses::No, Pushes::Along(Some(way)))
            }
            Motion::Pressing { way } => {
                velocity(self.tuning.press_speed(way), Presses::Against(way), Pushes::Along(Some(way)))
            }
            Motion::Home { stage, .. } => {
                let goal = self.homing_velocity(stage);
                let way = Way::closing_if(goal > CountsPerSec::ZERO);
                Demand {
                    law: Wanted::Velocity(goal, Presses::BeforeStall),
                    ceiling: self.homing_ceiling(stage),
                    emf: Emf::Standing,
                    pushes: Pushes::Along(Some(way)),
                }
            }
            Motion::Position { .. } => position(None),
            Motion::Move { .. } => position(Some(Way::closing_if(self.end > self.position.round()))),
            Motion::Zero { .. } => position(Some(Way::closing_if(self.tuning.config.ioff > 0))),
        }
    }

    /// The EMF that is compensated, in torque units.
    #[inline(always)]
    fn emf(&self, of: Emf) -> i32 {
        match of {
            Emf::None => 0,
            Emf::Under => {
                let Motion::Torque(wanted) = self.motion else { return 0 };
                let used = emf(self.observer.emf(), self.observer.sure_coming_velocity());
                let shown = emf(self.observer.nominal_emf(), self.observer.shown_coming_velocity());
                sure_emf(used, shown, wanted)
            }
            // Until the direction is known, no EMF adds to the limit of the torque: the model of a wrongly wired motor runs on alone.
            _ if !self.direction.is_right() => {
                let torque = i32::from(self.applied.torque.0);
                let emf = emf(self.observer.emf(), self.observer.sure_velocity());
                if (emf < 0) == (torque < 0) { 0 } else { emf }
            }
            Emf::Moving if self.applied.limit.is_none() => emf(self.observer.emf(), self.velocity),
            Emf::Moving | Emf::Standing => emf(self.observer.emf(), self.observer.sure_velocity()),
        }
    }

    /// Includes the damping that the control law lacks.
    #[inline(always)]
    fn law(&mut self, wanted: Wanted, envelope: &TorqueEnvelope) -> Torque {
        match wanted {
            Wanted::Torque(torque) => {
                self.resting = true;
                torque
            }
            Wanted::Velocity(goal, presses) => {
                self.resting = false;
                let torque = self.velocity_torque(goal, presses, envelope.most());
                let missing = self.tuning.velocity_loop.missing_damping();
                // Most gains damp enough.
                if missing == Law::ZERO {
                    return torque;
                }
                // Damps what is faster than wanted, or turns the other way.
                let (wanted, velocity) = (goal.0, self.velocity.0);
                let ordered = velocity.max(wanted.min(Law::ZERO)).min(wanted.max(Law::ZERO));
                let beyond = CountsPerSec(velocity.saturating_sub(ordered));
                damped(torque, beyond, missing)
            }
            Wanted::Position => self.position_torque(envelope),
        }
    }

    /// Modes 3 and 5. The profile advances by a tick unless the rotor lags too far.
    fn position_torque(&mut self, envelope: &TorqueEnvelope) -> Torque {
        let position = self.exact_position();
        let (control, arrival, ramps) = match &mut self.motion {
            Motion::Position { control, .. } => (control, None, &self.tuning.step_ramps),
            Motion::Move { control, arrival, .. } | Motion::Zero { control, arrival } => {
                arrival.push(&self.tuning.figures.rest, self.applied.torque);
                (control, Some(arrival), &self.tuning.ramps)
            }
            _ => return Torque::ZERO,
        };
        control.setpoint.change = Law::ZERO;
        if self.forced {
            (control.shorted, control.shorted_ms) = (true, SHORTED_MS);
        }
        if control.shorted_ms > 0 {
            // Each return to the set-point would send the braking current through the bridge into the bus.
            control.shorted_ms -= 1;
            control.setpoint = control.profile.follow(ramps, position, self.velocity);
            self.resting = control.setpoint.done;
            return envelope.short(&self.tuning.figures.scale);
        }
        if control.setpoint.done {
            // It rests on its end.
        } else if control.must_wait(position) {
            if let Some(arrival) = arrival {
                arrival.wait(control.profile.end().wrapping_sub(position).round(), self.tuning.config.tstop);
            }
        } else {
            let closes = control.setpoint.velocity > CountsPerSec::ZERO;
            control.setpoint =
                control.profile.step(ramps, reach(&self.tuning.figures, &self.observer, control, envelope));
            if control.setpoint.done {
                self.observer.end_motion(Way::closing_if(closes));
            }
        }
        let setpoint = &control.setpoint;
        self.resting = setpoint.done;
        let error = setpoint.position.wrapping_sub(position).saturating_error();
        let goal = setpoint.velocity.0;
        let (stage, error) = stage(setpoint, self.position, error);
        let (friction, load) = carried(&self.observer, stage, goal, error);
        let feed = mul_clamped(setpoint.change, self.observer.inertia()) + friction - load;
        let errors = Errors {
            stage,
            position: error,
            velocity: goal - self.velocity.0,
            emf: self.observer.emf(),
            feed,
        };
        self.tuning.pid.step(&mut control.pid, &errors, envelope.bounds())
    }

    /// The velocity loop's torque, or all of the ceiling, or nothing.
    fn velocity_torque(&self, goal: CountsPerSec, presses: Presses, most: Torque) -> Torque {
        let fastest = config::speed(self.tuning.figures.fastest);
        let goal = goal.max(fastest.saturating_neg()).min(fastest);
        let half = goal.0 >> 1;
        match presses {
            Presses::Against(Way::Closing) if self.velocity.0 < half => most,
            Presses::Against(Way::Opening) if self.velocity.0 > half => most.saturating_neg(),
            Presses::BeforeStall
                if half != Law::ZERO
                    && self.stall.is_over(Way::closing_if(half > Law::ZERO), HOMING_TSTOP_MIN / 2) =>
            {
                if half < Law::ZERO { most.saturating_neg() } else { most }
            }
            Presses::AfterRest if self.applied.torque == Torque::ZERO && self.must_rest(goal) => Torque::ZERO,
            _ => {
                let friction = self.observer.friction() + self.observer.kick();
                self.tuning.velocity_loop.step(goal, self.velocity, (friction, self.observer.load()), most)
            }
        }
    }

    /// Whether the motor has stalled in this direction and not rested since.
    fn must_rest(&self, goal: CountsPerSec) -> bool {
        Way::of(goal.0.to_bits()).is_some_and(|way| self.stall.is_over(way, self.tuning.config.tstop))
    }

    /// The velocity of the set-point, for telemetry.
    fn velocity_goal(&self) -> CountsPerSec {
        match (self.demand().law, self.motion.position_loop()) {
            (Wanted::Velocity(goal, _), _) => goal,
            (Wanted::Position, Some(control)) => control.setpoint.velocity,
            (Wanted::Torque(_) | Wanted::Position, _) => CountsPerSec::ZERO,
        }
    }

    /// Towards the stop once it is known: a new sign of IVEL does not turn HI round.
    fn homing_velocity(&self, stage: Homing) -> CountsPerSec {
        let velocity = CountsPerSec::from_int(self.tuning.config.ivel);
        let way = match stage {
            Homing::Seek => return velocity,
            Homing::Leave { stop } => stop.back(),
            Homing::Return { stop } => stop,
        };
        let opens = velocity < CountsPerSec::ZERO;
        if opens == way.is_closing() { velocity.saturating_neg() } else { velocity }
    }

    /// To leave a stop it has all of MT: a motion may have wedged the joint in it.
    #[inline(never)]
    const fn homing_ceiling(&self, stage: Homing) -> Torque {
        match stage {
            Homing::Seek | Homing::Return { .. } => self.tuning.homing_most,
            Homing::Leave { .. } => self.tuning.most,
        }
    }

    // --- the end of a motion ---------------------------------------------------------------------------------

    /// The stall time of a tick in which nothing is driven: a rotor that springs back from a stop meanwhile has left it.
    fn rest(&mut self, counted: bool) {
        if !(counted && self.stall.count(self.count)) {
            self.stall.rest(self.tstop());
        }
    }

    /// Ends the motion if a condition for that is met. Returns whether it ended.
    fn check_end(&mut self, counted: bool, sense: &Sense) -> bool {
        // Nothing is starting here, and each comparison counts.
        let homes = matches!(self.motion, Motion::Home { .. } | Motion::Zero { .. });
        let tstop = if homes { self.tstop() } else { self.tuning.config.tstop };
        let stalled = if counted && self.stall.count(self.count) {
            false
        } else if let Some(way) = self.drives(self.demand().pushes, tstop) {
            self.stall.drive(way, tstop)
        } else {
            self.stall.rest(tstop);
            false
        };
        let reason = match &self.motion {
            Motion::Move { .. } => self.move_end(sense),
            Motion::Home { stage, way } => return self.step_homing(*stage, *way, stalled),
            Motion::Zero { control, arrival } if control.setpoint.done || arrival.is_given_up() => {
                self.settle()
            }
            Motion::Zero { .. } => None,
            Motion::TorqueControlled { .. } if self.tuning.strain.excludes(sense.strain) => {
                Some(EndReason::Strain)
            }
            Motion::Pressing { .. } => return false,
            Motion::Idle
            | Motion::Field(_)
            | Motion::Torque(_)
            | Motion::Position { .. }
            | Motion::Velocity
            | Motion::TorqueControlled { .. } => None,
        };
        let Some(reason) = reason.or(stalled.then_some(EndReason::Stalled)) else { return false };
        self.finish(reason);
        true
    }

    /// HI until the second contact (decision 0048). Returns whether its motion ended.
    #[inline(never)]
    fn step_homing(&mut self, stage: Homing, way: u32, stalled: bool) -> bool {
        let way = way + u32::from(self.tuning.config.ivel.unsigned_abs().clamp(1, SURE_SPEED));
        self.motion = Motion::Home { stage, way };
        let is_over = |most: u32| way >= most * TICK_HZ;
        let at = self.count.wrapping_sub(self.zero);
        match stage {
            Homing::Seek if stalled && self.presses() => {
                self.zero = self.count;
                self.position = self.position.wrapping_sub(Counts::from_int(self.position.round()));
                let stop = Way::closing_if(self.applied.torque > Torque::ZERO);
                self.enter(Homing::Leave { stop });
            }
            Homing::Seek if stalled => {
                self.finish(EndReason::Stalled);
                return true;
            }
            Homing::Seek if is_over(SEEK_WAY) => self.faults.raise(Condition::JAMMED),
            Homing::Leave { stop } if stop.back().along(at) >= PROOF_WAY => {
                self.enter(Homing::Return { stop });
            }
            Homing::Return { .. } if stalled && self.presses() && at.abs() <= SAME_STOP => {
                self.begin(Motion::Zero {
                    control: self.at_rest_with(PidState::default()),
                    arrival: Arrival::of(false),
                });
                return true;
            }
            Homing::Leave { .. } | Homing::Return { .. } if stalled || is_over(PROVE_WAY) => {
                self.faults.raise(Condition::JAMMED);
            }
            // The first contact was none.
            Homing::Return { stop } if stop.along(at) > SAME_STOP => {
                self.faults.raise(Condition::JAMMED);
            }
            Homing::Seek | Homing::Leave { .. } | Homing::Return { .. } => {}
        }
        false
    }

    fn enter(&mut self, stage: Homing) {
        self.motion = Motion::Home { stage, way: 0 };
    }

    /// Why a move to E ends in this tick, other than by a stall.
    fn move_end(&mut self, sense: &Sense) -> Option<EndReason> {
        let Motion::Move { control, breakaway, arrival, .. } = &mut self.motion else { return None };
        if self.tuning.strain.excludes(sense.strain) {
            return Some(EndReason::Strain);
        }
        let Config { bt, bs, .. } = self.tuning.config;
        // TC and TO are asked to press, so they never break away.
        if bt != 0 && breakaway.step(self.applied.torque, control.setpoint.velocity, self.velocity, bt) {
            let position = self.position.round();
            self.broke_away = Some(position);
            self.report(Event::Breakaway { position, stop_tip: bs });
            return Some(EndReason::Breakaway);
        }
        let settles = control.setpoint.done || arrival.is_given_up();
        if settles { self.settle() } else { None }
    }

    /// Why a move ends whose set-point rests on its end, or has waited for too long.
    #[inline(never)]
    fn settle(&mut self) -> Option<EndReason> {
        let Config { mpe, tstop, .. } = self.tuning.config;
        let quiet = self.observer.quiet();
        let (Motion::Move { control, arrival, .. } | Motion::Zero { control, arrival }) = &mut self.motion
        else {
            return None;
        };
        let left = control.profile.end().round().wrapping_sub(self.position.round());
        if control.setpoint.done {
            let of = &self.tuning.figures.rest;
            let rests = arrival.rests(of, left, self.velocity, quiet);
            let ticks = control.profile.ticks();
            let quiet = arrival.settle(quiet, ticks);
            let settled = ticks == 0 || arrival.has_settled();
            let rests =
                rests || arrival.hunts(of, left, self.velocity) && left.unsigned_abs() <= u32::from(mpe);
            // What had nothing to do shows nothing of what may have driven it.
            let rests = rests && ticks > 0;
            if rests || settled && arrived(of, left, mpe, self.velocity, quiet) {
                return Some(EndReason::Arrived);
            }
            arrival.wait(left, tstop);
        }
        arrival.is_given_up().then_some(EndReason::Stalled)
    }

    /// The way in which the motor is driven away from rest, so that a missing hall count is a stall.
    #[inline(always)]
    fn drives(&self, pushes: Pushes, tstop: u16) -> Option<Way> {
        match pushes {
            Pushes::Along(way) => way,
            Pushes::ByTorque if self.presses_by_velocity(tstop) => self.torque_way(),
            Pushes::ByTorque => None,
            Pushes::OnLoop(stuck @ Some(_)) if self.tuning.config.accel == 0 => stuck,
            Pushes::OnLoop(_) => {
                let control = self.motion.position_loop()?;
                if self.stall.may_be_over(tstop)
                    && let way @ Some(_) = self.is_blocked(control, tstop)
                {
                    return way;
                }
                // A high KD may press a rotor on a stop that its set-point has not reached yet.
                if self.presses() && self.torque_way() == Way::of(control.setpoint.velocity.round().into()) {
                    return self.torque_way();
                }
                let elsewhere =
                    control.setpoint.done && control.setpoint.position.round() != self.position.round();
                if elsewhere && self.applied.torque.saturating_abs() >= self.tuning.figures.friction {
                    return self.torque_way();
                }
                let lag = control.lag(self.position);
                let is_driven = lag <= DRIVEN_LAG.wrapping_neg() || lag >= DRIVEN_LAG;
                is_driven.then_some(Way::closing_if(lag > Counts::ZERO))
            }
        }
    }

    fn torque_way(&self) -> Option<Way> {
        Way::of(i32::from(self.applied.torque.0))
    }

    /// Whether a missing count in mode 4 is a stall: the torque is at a limit, or would move a joint and V would have moved it by some counts.
    fn presses_by_velocity(&self, tstop: u16) -> bool {
        let way = i32::from(self.velocity_wanted.0.to_num::<i16>()).abs() * i32::from(tstop);
        self.applied.limit.is_some()
            || self.applied.torque.saturating_abs() >= self.tuning.figures.friction
                && way >= STALL_WAY * TICK_HZ.cast_signed()
    }

    /// The direction of an end behind an obstacle that has just stalled the motor: the set-point has only begun to move towards it.
    #[inline(never)]
    fn is_blocked(&self, control: &PositionLoop, tstop: u16) -> Option<Way> {
        // By cells: a rotor on the boundary of its own is at its end.
        let ahead = Counts::from_int(control.profile.end().round()).wrapping_sub(self.cell());
        Way::of(ahead.0.to_bits()).filter(|&way| self.stall.is_over(way, tstop))
    }

    fn tstop(&self) -> u16 {
        let tstop = self.tuning.config.tstop;
        let homes = matches!(self.motion, Motion::Home { .. } | Motion::Zero { .. });
        if homes { tstop.max(HOMING_TSTOP_MIN) } else { tstop }
    }

    /// Whether the motor pushes as hard as a limit allows, and harder than friction: standing still, it has met its stop.
    fn presses(&self) -> bool {
        self.applied.limit.is_some() && self.applied.torque.saturating_abs() >= self.tuning.figures.friction
    }

    fn idle(&mut self) {
        self.velocity_wanted = CountsPerSec::ZERO;
        (self.motion, self.releasing) = (Motion::Idle, None);
        self.applied = AppliedTorque::OFF;
    }

    /// Ends the motion as HOLD says, or in a hold if MODE 5 ordered it.
    fn finish(&mut self, reason: EndReason) {
        let mut pressing = None;
        match (&self.motion, reason) {
            (Motion::Zero { .. }, EndReason::Arrived) => {
                let offset = self.tuning.config.ioff;
                self.zero = self.zero.wrapping_add(offset);
                self.position = self.position.wrapping_sub(Counts::from_int(offset));
                self.homed = true;
                self.report(Event::Homed);
            }
            (&Motion::TorqueControlled { way }, EndReason::Stalled) => {
                pressing = Some(Motion::Pressing { way });
            }
            _ => {}
        }
        let holds = match self.motion {
            Motion::Move { holds: true, .. } => true,
            _ => self.tuning.config.hold,
        };
        // Every fault idles, and so does any other end with HOLD 0 (manual 5.5).
        self.velocity_wanted = CountsPerSec::ZERO;
        if reason == EndReason::Fault || !holds {
            self.idle();
        } else if let Some(pressing) = pressing {
            self.motion = pressing;
        } else {
            self.hold(reason);
        }
        self.ended = Some(reason);
        self.report(Event::Ended { reason, mode: self.motion.mode() });
    }

    /// Holds the present count. After an arrival the observed load stays carried.
    fn hold(&mut self, reason: EndReason) {
        let arrived = reason == EndReason::Arrived;
        if !arrived {
            // It was pushing, against an obstacle maybe.
            self.observer.forget_load();
        }
        let pid = match self.motion {
            Motion::Move { control, .. } if arrived => control.pid,
            _ => PidState::default(),
        };
        self.motion = Motion::Position { control: PositionLoop::at_rest(self.cell(), pid), to: None };
    }

    fn fail(&mut self, fault: Fault) {
        self.report(Event::Fault(fault));
        if !matches!(self.motion, Motion::Idle) {
            self.finish(EndReason::Fault);
        }
    }

    fn report(&mut self, event: Event) {
        if self.events.is_full() {
            self.events.pop_front();
        }
        let _ = self.events.push_back(event);
    }
}
