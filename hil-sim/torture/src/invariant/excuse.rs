//! Faults with which an invariant need not hold, or holds in part: a row each, with its reason. No check names a kind of fault itself
//! (tests/fences/judge.rs).

use super::joint::View;
use crate::kinds::{FaultKind as F, Kinds};

/// Where and when a fault excuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// At the motor or of the hand, while it is active.
    Now,
    /// The same, and for [`super::AFTERMATH_MS`] after its end.
    Here,
    /// The same, at any motor.
    Anywhere,
    /// Part of what is demanded: the check asks for it.
    Part,
}

/// Faults that excuse a motor.
#[derive(Clone, Copy)]
pub struct Excuse {
    /// Which.
    pub faults: Kinds,
    /// Where and when.
    pub reach: Reach,
    /// Why no board could hold it; of a part, what holds instead.
    pub why: &'static str,
}

impl Excuse {
    /// Whether the motor need not hold the invariant at all.
    pub(crate) const fn excuses(&self, view: &View) -> bool {
        match self.reach {
            Reach::Now => view.active.meets(self.faults),
            Reach::Here => view.faults.meets(self.faults),
            Reach::Anywhere => view.anywhere.meets(self.faults),
            Reach::Part => false,
        }
    }

    /// Whether the motor has one of the faults, or had within [`super::AFTERMATH_MS`].
    pub(crate) const fn is_recent(&self, view: &View) -> bool {
        view.faults.meets(self.faults)
    }

    /// Whether the motor has one of the faults.
    pub(crate) const fn is_active(&self, view: &View) -> bool {
        view.active.meets(self.faults)
    }
}

const fn here(faults: Kinds, why: &'static str) -> Excuse {
    Excuse { faults, reach: Reach::Here, why }
}

const fn anywhere(faults: &[F], why: &'static str) -> Excuse {
    Excuse { faults: Kinds::of(faults), reach: Reach::Anywhere, why }
}

const fn part(faults: Kinds, why: &'static str) -> Excuse {
    Excuse { faults, reach: Reach::Part, why }
}

/// Sensors that lie about what the guards need.
const LYING_SENSORS: Kinds = Kinds::of(&[F::AdcRail, F::AdcNoise, F::AdcDrift]);

/// Hall lines that lie.
const LYING_HALLS: Kinds = Kinds::of(&[F::HallStuck, F::HallOpen, F::HallGlitch, F::HallSwap]);

/// Loads from outside that stop or move a motor.
const LOADS: Kinds = Kinds::of(&[F::Push, F::Jam, F::BrakeStuckOn, F::BrakeStuckOff]);

/// No excuse.
pub const NONE: &[Excuse] = &[];

/// Of winding-temperature.
pub(crate) const WINDING: &[Excuse] = &[LYING_WINDING];
pub(super) const LYING_WINDING: Excuse = part(
    LYING_SENSORS.union(Kinds::of(&[F::ThermistorOpen])),
    "the winding stays below 155 C: the thermistor is the only anchor of the board's model",
);

/// Of phase-current.
pub const CURRENT: &[Excuse] = &[UNKNOWN_EMF];
pub(super) const UNKNOWN_EMF: Excuse = part(
    LYING_SENSORS.union(LYING_HALLS).union(Kinds::of(&[F::BoardHang])),
    "the current stays below the trip: a board that does not see bus and rotor, or hangs, does not know the EMF",
);

/// Of bus-voltage.
pub const BUS: &[Excuse] = &[
    here(LYING_SENSORS, "a board that does not see the bus voltage cannot keep it from rising"),
    here(Kinds::of(&[F::OverVoltage]), "the source itself is above it"),
    anywhere(
        &[F::Push],
        "a motor that is pushed beyond its no-load speed charges the bus through the diodes of a bridge that is off",
    ),
];

/// Of load-keeps-the-bus.
pub const LOAD: &[Excuse] = &[
    here(
        LYING_SENSORS,
        "a board that does not see the bus voltage does not fold back, or reports what it sees",
    ),
    here(
        Kinds::of(&[F::SupplySag, F::PowerCut, F::HandPowerCut, F::FlashCut]),
        "the source itself falls, or the board's own supply",
    ),
    anywhere(&[F::BoardHang], "a board that hangs does not fold back"),
];

/// Of no-watchdog-reset.
pub(crate) const WATCHDOG: &[Excuse] = &[here(Kinds::of(&[F::BoardHang]), "the program was hung")];

/// Of speed-limit.
pub const SPEED: &[Excuse] = &[PUSHED];
pub(super) const PUSHED: Excuse = part(
    Kinds::of(&[F::Push]),
    "a rotor that is pushed may be faster than its voltage drives it, until it has slowed down; so may one that another finger pushes",
);

/// Of within-stops and wrong-way.
pub const LOADED: &[Excuse] =
    &[here(LOADS, "a load from outside moves the motor the wrong way, and into its stop")];

/// Of stall-ends-force.
pub(crate) const STALL: &[Excuse] = &[here(LYING_HALLS, "lines that lie show counts that there are not")];

/// Of torque-at-contact.
pub(crate) const TORQUE: &[Excuse] = &[UNJUDGED_EMF, HANGS];
const UNJUDGED_EMF: Excuse = here(
    LYING_HALLS.union(LYING_SENSORS),
    "lines, a bus voltage or a current that lie leave the EMF unjudged",
);
const HANGS: Excuse = here(Kinds::of(&[F::BoardHang]), "a board that hangs keeps its bridge on");

/// Of finger-energy.
pub const FINGER: &[Excuse] =
    &[UNJUDGED_EMF, HANGS, here(Kinds::of(&[F::Push]), "the load from outside presses as well")];

/// Of breaks-away and end-is-true.
pub(crate) const UNSEEN: &[Excuse] = &[here(
    LYING_HALLS.union(LYING_SENSORS),
    "a board that does not see its rotor, bus or current does not know its load",
)];

/// Of values-are-true.
pub const VALUES: &[Excuse] = &[
    here(LYING_SENSORS.union(LYING_HALLS).union(Kinds::of(&[F::ThermistorOpen])), "the sensors lie"),
    here(Kinds::of(&[F::BoardHang]), "a board that hangs reads nothing"),
];

/// Of ends-in-time.
pub(crate) const IN_TIME: &[Excuse] =
    &[here(LYING_HALLS, "a rotor is misplaced until the lines are found out"), HINDERED];
pub(super) const HINDERED: Excuse = part(
    LYING_SENSORS.union(Kinds::of(&[F::Push, F::Jam, F::BrakeStuckOn, F::SupplySag])),
    "a motion that was hindered once has no useful bound: it may make one count each TSTOP",
);

/// Of arrived-is-true.
pub(crate) const ARRIVED: &[Excuse] =
    &[here(LYING_HALLS, "a rotor is misplaced until the lines are found out")];

/// Of counters-grow.
pub const COUNTERS: &[Excuse] = &[DAMAGED, CUT];
pub(super) const DAMAGED: Excuse = part(
    Kinds::of(&[F::BitFlip, F::WornPage, F::MarginalErase]),
    "the next start may find older counters: the flash has lost what it held",
);
pub(super) const CUT: Excuse = part(
    Kinds::of(&[F::PowerCut, F::HandPowerCut, F::FlashCut, F::BoardReset, F::BoardHang, F::HallSwap]),
    "the next start may lose what decision 0018 allows, after STAT 0 as well",
);

/// Of refusal-changes-nothing.
pub const REFUSALS: &[Excuse] = &[Excuse {
    faults: Kinds::of(&[F::FlashCut]),
    reach: Reach::Now,
    why: "its program ends in the middle of a SAVE, and the next one takes what was stored",
}];

/// Of position-is-true.
pub(crate) const POSITION: &[Excuse] = &[UNSEEN_COUNT, HOMED_ELSEWHERE, JAMMED_AGAIN];
pub(super) const UNSEEN_COUNT: Excuse = part(
    LYING_HALLS,
    "a wrong position is found out within 1 s: standing, a board cannot tell such a line from a count; a position that is named meanwhile may be off by one more",
);
pub(super) const HOMED_ELSEWHERE: Excuse = part(
    LYING_HALLS.union(Kinds::of(&[F::Push, F::Finger])),
    "from then on a zero of HI may be elsewhere: HI takes the place where it is held for its stop",
);
pub(super) const JAMMED_AGAIN: Excuse = part(
    Kinds::of(&[F::Jam, F::BrakeStuckOn]),
    "from the second one in an HI on, which may hold it in the place of the first, a zero may be elsewhere: HI takes a place that holds it twice for its stop",
);
