//! What the checks of one motor see and remember.

use std::collections::VecDeque;

use tater_wire::{Cmd, EndCode, ModeCode, MotorKind, Property};

use super::measure::Worst;
use crate::case::{World, kind};
use crate::kinds::Kinds;
use crate::shadow::Values;
use hil_world::plant::{PlantParams, RAD_PER_COUNT};
use hil_world::rig::{Bridge, Truth};

/// Time after a fault's end during which it still excuses, ms: a rotor comes to rest, a latched reading expires.
pub(crate) const AFTERMATH_MS: u64 = 1_000;

/// Ticks over which a limit may have been higher: the thermistor is read every 16 ticks, a tick that plans a move still applies the
/// torque of the tick before.
pub(crate) const MEMORY: usize = 40;

/// Power of a source that seven motors at the torque that is free cannot exhaust, W: they take 370 W, 520 W if each had the least resistance
/// (decision 0053). And the current that it needs however high its voltage is, A: motors that have pulled it down to 20 V draw that much there.
const SOURCE_W: f64 = 500.0;
const SOURCE_A: f64 = 22.0;

/// What a board has done, in the terms of the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// It has obeyed a SET. Those of T and V, which hosts stream, and of LOCK are not among them.
    Order {
        /// The property.
        property: Property,
        /// Its new value.
        value: i64,
    },
    /// A frame changed nothing. Repeated ones are seen once.
    Refused,
    /// A motion has ended.
    Ended {
        /// END.
        end: EndCode,
        /// MODE after it.
        mode: ModeCode,
    },
    /// MODE has changed.
    Mode(ModeCode),
    /// HI has called a place zero.
    Homed,
    /// Something else, which takes its place among the 32 that a board remembers.
    Other,
}

impl Seen {
    /// Property and value of an order.
    pub const fn order(&self) -> Option<(Property, i64)> {
        match *self {
            Self::Order { property, value } => Some((property, value)),
            _ => None,
        }
    }
}

/// What the world knows of a board.
#[derive(Clone, Copy, Debug)]
pub struct Ground {
    /// Starts of the application since power was first applied.
    pub starts: u32,
    /// When the last frame passed the receive filters, simulated time in us.
    pub heard_us: u64,
    /// How often the watchdog has reset the board.
    pub watchdog_resets: u32,
    /// Operations of the flash so far, and erases with the bridge on.
    pub flash_operations: u64,
    /// See `flash_operations`.
    pub erased_while_driven: u32,
    /// Whether the flash has the hot mark (decision 0051), as the application has read it; true without one.
    pub is_marked_hot: bool,
}

/// One motor at one tick.
pub struct View<'a> {
    /// Simulated time, ms.
    pub ms: u64,
    /// The plant.
    pub truth: Truth,
    /// The true count of the sensors.
    pub cell: i64,
    /// Bus voltage, V.
    pub volts: f64,
    /// The bridge.
    pub bridge: Bridge,
    /// Whether the brake is commanded to release.
    pub brake_released: bool,
    /// What the world knows of a native board; `None` of an emulated one.
    pub ground: Option<Ground>,
    /// Answers a GET, in the units of docs/properties.md; `None` without an application, and of an emulated board.
    pub answer: Option<&'a dyn Fn(Property) -> Option<i64>>,
    /// What the board has done since the last tick, oldest first.
    pub seen: &'a [Seen],
    /// Faults of this motor or of the hand that are active or ended within `AFTERMATH_MS`.
    pub faults: Kinds,
    /// The faults that are active now.
    pub active: Kinds,
    /// Faults of any motor that are active or ended within `AFTERMATH_MS`.
    pub anywhere: Kinds,
}

impl View<'_> {
    /// Whether the bridge is on.
    pub fn driven(&self) -> bool {
        self.bridge != Bridge::Off
    }

    /// Whether a native board's application runs.
    pub const fn runs(&self) -> bool {
        self.answer.is_some()
    }

    /// The answer to a GET; `None` without an application, or if the property has no value.
    pub fn property(&self, property: Property) -> Option<i64> {
        (self.answer?)(property)
    }

    /// MODE.
    pub fn mode(&self) -> Option<ModeCode> {
        ModeCode::of(self.property(Property::MODE)?)
    }

    /// Whether the position is known: bit 30 of HALLH.
    pub fn is_homed(&self) -> bool {
        self.property(Property::HALLH).is_some_and(|halls| halls >> 30 & 1 == 1)
    }

    /// How often the application has started.
    pub fn starts(&self) -> u32 {
        self.ground.map_or(0, |ground| ground.starts)
    }

    /// The SETs that were obeyed since the last tick, oldest first. Those of T and V, which hosts stream, and of LOCK are not among them.
    pub fn orders(&self) -> impl Iterator<Item = (Property, i64)> + '_ {
        self.seen.iter().filter_map(Seen::order)
    }
}

/// What the checks of one motor remember.
pub struct Joint {
    pub(super) kind: MotorKind,
    pub(super) plant: PlantParams,
    /// The source has the power that the boards may take without fold-back.
    pub(super) has_strong_source: bool,
    /// Highest speed so far, counts/s, which bounds how deep a stop is dented.
    pub(super) fastest: f64,
    /// Bus voltage that may have driven it to its speed: a sagging bus falls faster than a rotor slows down.
    pub(super) driving_v: f64,
    /// It is pushed from outside faster than its voltage could drive it.
    pub(super) pushed: bool,
    pub(super) power: Power,
    pub(super) contact: Contact,
    pub(super) touch: Touch,
    pub(super) ending: Ending,
    pub(super) keeping: Keeping,
    pub(super) truth: Trust,
    pub(super) meaning: Meaning,
    /// What the checks have measured at most.
    pub worst: Worst,
}

#[derive(Debug)]
pub struct Power {
    /// It was so at the last tick: a command takes effect at the next.
    pub was_idle: bool,
    pub was_low: bool,
    pub was_faulty: bool,
    pub was_engaged: bool,
    pub limits: [i64; MEMORY],
    pub next: usize,
    pub watchdog_resets: u32,
    pub erased: u32,
    /// Highest limit by MV with MCV and MOV since mode 5 began, counts/s, and for how many ticks the rotor has been beyond it.
    pub allowed: i64,
    pub fast_ms: u32,
    /// T at the last tick, and for how many ticks the rotor has been driven on against it.
    pub torque: i64,
    pub against_ms: u32,
}

impl Default for Power {
    fn default() -> Self {
        Self {
            was_idle: false,
            was_low: false,
            was_faulty: false,
            was_engaged: false,
            limits: [0; MEMORY],
            next: 0,
            watchdog_resets: 0,
            erased: 0,
            allowed: 0,
            fast_ms: 0,
            torque: 0,
            against_ms: 0,
        }
    }
}

/// Who has ordered the motion under way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Orderer {
    /// M, CMD and others: HOLD says what follows.
    #[default]
    Other,
    /// MODE 5: a hold follows (decision 0069).
    Mode,
    /// MODE 5 in mode 5, where it may have met a move or a part of HI or FIND.
    Unknown,
}

/// Whether a value of CMD begins or ends a motion; LOAD, SAVE, RESET and DEF do neither.
fn moves(cmd: i64) -> bool {
    !matches!(Cmd::of(cmd), Some(Cmd::Load | Cmd::Save | Cmd::Reset | Cmd::Def))
}

impl Orderer {
    /// The one after an order, given in mode `before`.
    pub fn after(self, property: Property, value: i64, before: Option<ModeCode>) -> Self {
        match property {
            Property::MODE if value != 5 => Self::Other,
            Property::MODE if before != Some(ModeCode::Trapezoidal) || self == Self::Mode => Self::Mode,
            Property::MODE => Self::Unknown,
            Property::CMD if moves(value) => Self::Other,
            Property::M | Property::FIND => Self::Other,
            _ => self,
        }
    }
}

/// What the checks of a motor's contacts remember.
#[derive(Debug, Default)]
pub struct Contact {
    /// MT, torque units, and the one before with the time of the change.
    pub mt: f64,
    pub earlier: (f64, u64),
    pub above_ms: u32,
    pub above_m_n_m_s: f64,
    pub apart_ms: u32,
    /// Whether this impact is with something else than the joint's stop.
    pub is_soft: bool,
    /// Ticks for which something has held the driven rotor, and the largest TSTOP meanwhile, and what else a move may have taken.
    pub held_ms: u64,
    pub tstop: u64,
    pub waits_ms: u64,
    pub cell: i64,
    /// END at the last tick, and what ended the last motion.
    pub told: Option<EndCode>,
    pub end: Option<EndCode>,
}

/// A person's finger that the joint touches.
#[derive(Debug, Default)]
pub struct Touch {
    /// Where the rotor was at the last tick without a touch, counts, and its speed, rad/s.
    pub from: f64,
    pub speed: f64,
    /// The greatest torque that has been permitted since, N·m.
    pub permitted_n_m: f64,
    pub touched_ms: u32,
    pub apart_ms: u32,
    pub impulse_n_s: f64,
}

#[derive(Debug, Default)]
pub struct Ending {
    /// Ends since the last order that may begin a motion.
    pub ends: u32,
    /// The last end was followed by a hold.
    pub holds: bool,
    /// Who has ordered the motion under way, and the mode of the last tick.
    pub orderer: Orderer,
    pub mode: Option<ModeCode>,
    pub speed: f64,
    /// Where the rotor has been of late: least and largest place, counts, and for how many ticks.
    pub stayed: (f64, f64),
    pub stayed_ms: u64,
    /// When the motion that is to end began, ms; and the longest time that it may take, ms, taken anew at each order.
    pub begun_ms: Option<u64>,
    pub within_ms: f64,
    pub hindered: bool,
    /// The last order began a procedure of the board's own, which needs no host.
    pub own: bool,
    /// MODE was set, and the mode has not changed yet.
    pub asked: bool,
}

#[derive(Debug, Default)]
pub struct Keeping {
    pub counters: [i64; 3],
    pub starts: u32,
    /// The last start.
    pub since_ms: u64,
    /// Values saved by SAVE and not yet in the flash; and those that are.
    pub queued: Values,
    pub stored: Values,
    pub operations: u64,
    pub quiet_ms: u64,
    /// Values that a new start has not shown, and the time of that start.
    pub missing: Option<(u64, Values)>,
    /// Every settable value, as of the last order or start.
    pub present: Option<Values>,
    /// The flash was damaged since the last start.
    pub damaged: bool,
    /// STAT 0 has ended a program since the last start; and a fault has.
    pub slept: bool,
    pub cut: bool,
    /// ERROR at the last tick.
    pub error: i64,
}

#[derive(Debug, Default)]
pub struct Trust {
    pub starts: u32,
    /// The reported position less the true one, whole counts, while the position is known.
    pub offset: Option<i64>,
    /// It was found while the lines lied, which may show a neighbor of the true cell.
    pub blind: bool,
    /// The same at the last SAVE, and when the program ended.
    pub at_save: Option<i64>,
    pub at_end: Option<i64>,
    /// A start has trusted its position, and nothing has confirmed it.
    pub restored: bool,
    pub off_ms: u32,
    /// Loads or lying halls have met the motor: it may have homed at another place than its stop.
    pub hindered: bool,
    /// Whether something jams the motor, and how often that has begun in this HI.
    pub jammed: bool,
    pub jams: u32,
    /// How far the rotor of the last HI may have entered its stop, counts.
    pub dent: f64,
    /// Where the rotor was when this drive began, and the direction of its torque.
    pub began: Option<(f64, bool)>,
}

/// What a board does on its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Errand {
    /// Nothing that HSG, LSG or BT end.
    #[default]
    None,
    Homes,
    Presses,
    Moves,
}

impl Errand {
    fn after(self, property: Property, value: i64) -> Self {
        match property {
            Property::FIND => Self::None,
            Property::M => Self::Moves,
            // It may have met a part of HI.
            Property::MODE if self == Self::Homes || value != i64::from(ModeCode::Trapezoidal) => Self::None,
            Property::MODE => Self::Moves,
            Property::CMD => match Cmd::of(value) {
                Some(Cmd::Hi) => Self::Homes,
                Some(Cmd::Tc | Cmd::To) => Self::Presses,
                Some(Cmd::Load | Cmd::Save | Cmd::Def) => self,
                Some(Cmd::Reset | Cmd::T) | None => Self::None,
                Some(Cmd::Home | Cmd::Ic | Cmd::Io | Cmd::C | Cmd::M | Cmd::O) => Self::Moves,
            },
            _ => self,
        }
    }
}

/// What these checks of a motor remember.
#[derive(Debug, Default)]
pub struct Meaning {
    pub errand: Errand,
    pub starts: u32,
    pub strained_ms: u32,
    pub loaded_ms: u32,
    /// The true count at the last ticks in which the bridge was on, the newest first: the time of a stall waits while it is off (decision 0049).
    pub cells: VecDeque<i64>,
    /// Ticks since the motor last pushed against a contact with more than half of BT.
    pub since_load_ms: u64,
    pub end: i64,
    pub was_driven: bool,
    pub reported: Reported,
}

/// What values-are-true remembers of a motor.
#[derive(Debug, Default)]
pub struct Reported {
    pub wrong_ms: u32,
    /// Since when VEL is added up, ms; its sum; the place then, counts.
    pub way: Option<(u64, f64, f64)>,
    /// For how long the motor has stood and pressed, ms.
    pub steady_ms: u64,
}

impl Joint {
    /// Follows what the motor was ordered to do.
    pub fn follow(&mut self, view: &View) {
        let meaning = &mut self.meaning;
        if meaning.starts != view.starts() || !view.runs() {
            *meaning = Meaning { starts: view.starts(), ..Meaning::default() };
        }
        for (property, value) in view.orders() {
            meaning.errand = meaning.errand.after(property, value);
        }
    }
}

impl Joint {
    /// Motor 0 to 6 of a hand at power-up.
    ///
    /// # Panics
    /// The world has no such motor.
    #[must_use]
    pub fn new(world: &World, motor: usize) -> Self {
        let of = kind(motor as u8 + 1);
        Self {
            kind: of,
            has_strong_source: world.source.1 >= SOURCE_A && world.source.0 * world.source.1 >= SOURCE_W,
            plant: world.plants[motor].clone(),
            fastest: 0.0,
            driving_v: 0.0,
            pushed: false,
            power: Power::default(),
            contact: Contact::default(),
            touch: Touch::default(),
            ending: Ending::default(),
            keeping: Keeping::default(),
            meaning: Meaning::default(),
            worst: Worst::default(),
            // HI cannot tell an object that it presses on from a stop.
            truth: Trust { hindered: world.object.is_some(), ..Trust::default() },
        }
    }

    /// How far a torque at the motor turns its gear and a stop, counts.
    pub fn twist(&self, n_m: f64) -> f64 {
        n_m * self.plant.stop_rad_n_m() / RAD_PER_COUNT
    }

    /// How far a rotor that arrives with this speed would enter a stop without a damper, counts: v·√(J/k).
    pub(crate) fn blow(&self, counts_per_s: f64) -> f64 {
        (self.plant.j_kg_m2 * self.plant.stop_rad_n_m()).sqrt() * counts_per_s
    }

    /// Speed at which the EMF takes all of the voltage, counts/s.
    pub fn no_load(&self, bus_v: f64) -> f64 {
        bus_v / self.plant.ke_v_s / RAD_PER_COUNT
    }
}
