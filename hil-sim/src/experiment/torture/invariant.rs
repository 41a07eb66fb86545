//! What must hold in a hand, whatever its host sends and whatever breaks: each invariant with its name, the section that demands
//! it, and its check. The checks run at each millisecond, which is each control tick of a board.
//!
//! A check sees the true state of the plant and, of native boards, the state of their program. Some faults excuse a check, because
//! no board could hold it then; `excused_by` names them, and the comment of the check says why.

mod ending;
mod keeping;
mod power;
mod truth;

use servo_core::guard::fault::LimitCause;
use servo_core::mode::Mode;
use tater_fw::events::BoardEvent;
use tater_wire::MotorKind;

use super::kinds::{FaultKind, Kinds};
use crate::world::node::{Node, Sample};
use crate::world::plant::{PlantParams, RAD_PER_COUNT};
use crate::world::rig::{Bridge, Truth};

/// An invariant.
#[derive(Clone, Copy)]
pub struct Invariant {
    /// Its name on the command line and in reports.
    pub name: &'static str,
    /// What it demands.
    pub demands: &'static str,
    /// Where that is demanded.
    pub source: &'static str,
    /// Faults, now or within the last [`AFTERMATH_MS`], with which it need not hold.
    pub excused_by: Kinds,
    check: Check,
}

#[derive(Clone, Copy)]
enum Check {
    /// Of one motor, at each tick.
    Motor(fn(&mut Joint, &View) -> Option<String>),
    /// Elsewhere: of the hand, by [`super::play`] and [`super::recovery`].
    Hand,
}

/// Time after a fault's end during which it still excuses, ms: a rotor comes to rest, a latched reading expires.
pub const AFTERMATH_MS: u64 = 1_000;

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
    /// The board, if it is a native one.
    pub node: Option<&'a Node>,
    /// State of its application, if that runs.
    pub sample: Option<Sample>,
    /// What the board has recorded since the last tick.
    pub events: &'a [BoardEvent],
    /// Faults of this motor or of the hand that are active or ended within [`AFTERMATH_MS`].
    pub faults: Kinds,
    /// The faults that are active now.
    pub active: Kinds,
}

impl View<'_> {
    fn driven(&self) -> bool {
        self.bridge != Bridge::Off
    }

    fn application(&self) -> Option<(&tater_fw::Tater<crate::world::board::SimBoard>, &Sample)> {
        Some((self.node?.application()?, self.sample.as_ref()?))
    }
}

/// What the checks of one motor remember.
pub struct Joint {
    plant: PlantParams,
    has_brake: bool,
    /// Highest speed so far, counts/s, which bounds how deep a stop is dented.
    fastest: f64,
    /// It is pushed from outside faster than its voltage could drive it.
    pushed: bool,
    power: power::Power,
    ending: ending::Ending,
    keeping: keeping::Keeping,
    pub(super) truth: truth::Trust,
}

const fn row(
    name: &'static str,
    demands: &'static str,
    source: &'static str,
    excused_by: Kinds,
    check: fn(&mut Joint, &View) -> Option<String>,
) -> Invariant {
    Invariant { name, demands, source, excused_by, check: Check::Motor(check) }
}

const fn hand(name: &'static str, demands: &'static str, source: &'static str) -> Invariant {
    Invariant { name, demands, source, excused_by: Kinds::NONE, check: Check::Hand }
}

/// A prompt within its time.
pub const PROMPT: &str = "prompt";
/// ^C brings the prompt.
pub const ABORT: &str = "abort";
/// GOD loses nothing.
pub const QUEUES: &str = "queues";
/// Energy balance of the simulated motors.
pub const ENERGY: &str = "energy";
/// The image on the emulated processor neither stops nor drives both switches of a leg.
pub const IMAGE: &str = "image-runs";
/// Liveness: the hand homes.
pub const HOMES: &str = "homes-again";
/// Liveness: the hand moves.
pub const MOVES: &str = "moves-again";

/// Sensors that lie about what the guards need.
const LYING_SENSORS: Kinds = Kinds::of(&[FaultKind::AdcRail, FaultKind::AdcNoise, FaultKind::AdcDrift]);

/// Hall lines that lie.
const LYING_HALLS: Kinds =
    Kinds::of(&[FaultKind::HallStuck, FaultKind::HallOpen, FaultKind::HallGlitch, FaultKind::HallSwap]);

/// Loads from outside that stop or move a motor.
const LOADS: Kinds =
    Kinds::of(&[FaultKind::Push, FaultKind::Jam, FaultKind::BrakeStuckOn, FaultKind::BrakeStuckOff]);

/// Every invariant.
pub const INVARIANTS: &[Invariant] = &[
    row(
        "no-shoot-through",
        "one leg is switched, one is low, one floats",
        "docs/board.md, Bridge",
        Kinds::NONE,
        power::legs,
    ),
    row("idle-undriven", "no drive in mode 0", "manual 6.1", Kinds::NONE, power::idle),
    row(
        "monitor-undriven",
        "no drive without an application",
        "DESIGN, faults; docs/download.md",
        Kinds::NONE,
        power::monitor,
    ),
    row(
        "fault-undriven",
        "no drive with a latched fault",
        "manual 7; docs/properties.md, faults",
        Kinds::NONE,
        power::fault,
    ),
    row(
        "brake-undriven",
        "no drive against a brake that is commanded to engage",
        "manual 4.2; DESIGN, brake",
        Kinds::NONE,
        power::brake,
    ),
    row(
        "torque-within-mt",
        "|T| is at most MT, derated near OTEMP",
        "manual 5.4.1 (MT, OTEMP)",
        Kinds::NONE,
        power::torque,
    ),
    row("duty-limit", "duty is at most 97 %", "decision 0003", Kinds::NONE, power::duty),
    row(
        "winding-temperature",
        "the winding stays below 135 C; with a lying sensor below 155 C",
        "decision 0014",
        Kinds::NONE,
        power::winding,
    ),
    row(
        "phase-current",
        "the phase current stays below the trip of the bridge",
        "decision 0003",
        Kinds::NONE,
        power::current,
    ),
    // A board that does not see the bus voltage cannot keep it from rising; nor can it with a source that is above it.
    row(
        "bus-voltage",
        "motors do not raise the bus above 32 V",
        "decision 0053",
        LYING_SENSORS.union(Kinds::of(&[FaultKind::OverVoltage])),
        power::bus,
    ),
    row(
        "no-erase-while-driven",
        "no page is erased while the bridge is on",
        "decision 0012",
        Kinds::NONE,
        power::erase,
    ),
    row(
        "no-watchdog-reset",
        "no watchdog bites a program that was not hung",
        "decision 0052",
        Kinds::NONE,
        power::watchdog,
    ),
    // Pushed by another finger or by hand, a rotor may be faster than its voltage drives it; the check knows that itself.
    row(
        "speed-limit",
        "no motor is faster than its voltage can drive it, no set-point faster than MV",
        "manual 5.4.1 (MV, MCV, MOV)",
        Kinds::NONE,
        power::speed,
    ),
    row(
        "within-stops",
        "a stop is dented no deeper than peak torque and speed can",
        "manual table 1",
        LOADS,
        power::stops,
    ),
    row(
        "stall-ends-force",
        "a motor that a stop holds is driven no longer than TSTOP and 40 ms at a time",
        "manual 5.4.1 (TSTOP); decision 0049",
        LYING_HALLS,
        ending::stall,
    ),
    row(
        "ends-once",
        "a motion ends once, for one reason",
        "manual 6.1 (END); DESIGN, end of a move",
        Kinds::NONE,
        ending::once,
    ),
    row(
        "ends-in-time",
        "a motion ends within the time of its profile and its stalls",
        "decision 0049",
        LYING_HALLS,
        ending::in_time,
    ),
    // Halls that lie misplace the rotor until they are found out.
    row(
        "arrived-is-true",
        "\"arrived\" means at rest within MPE",
        "manual 5.4.1 (MPE); decision 0049",
        LYING_HALLS,
        ending::arrived,
    ),
    row(
        "hold-as-ordered",
        "after a motion HOLD 1 holds, HOLD 0 idles",
        "manual 5.5",
        Kinds::NONE,
        ending::hold,
    ),
    row(
        "counters-grow",
        "UPSECS, OD and PTEMP never decrease",
        "manual 5.4.2; decision 0018",
        Kinds::NONE,
        keeping::counters,
    ),
    row(
        "saves-survive",
        "an acknowledged SAVE survives, or ERROR 8 reports its loss",
        "manual 7 (saveParameters); decision 0018",
        Kinds::NONE,
        keeping::saves,
    ),
    row(
        "refusal-changes-nothing",
        "a refused SET changes nothing",
        "DESIGN, properties; decision 0036",
        Kinds::NONE,
        keeping::refusals,
    ),
    row(
        "position-is-true",
        "a position that is known is within a count of the rotor",
        "manual 7; decision 0010",
        Kinds::NONE,
        truth::position,
    ),
    row(
        "trust-is-true",
        "a position that a start trusts is that of the last run",
        "decision 0010",
        Kinds::NONE,
        truth::trust,
    ),
    // Loads move a motor the wrong way as well.
    row(
        "wrong-way",
        "no motor runs more than a third of a turn against its own torque",
        "decision 0047",
        LOADS,
        truth::wrong_way,
    ),
    hand(
        QUEUES,
        "GOD loses no byte and no frame, and queues at most three frames in its mailboxes",
        "decision 0035",
    ),
    hand(
        PROMPT,
        "every command ends in a prompt within the time of its motions",
        "manual 5.1; decision 0035",
    ),
    hand(ABORT, "^C brings the prompt within 0.6 s", "manual 5.1.2; decision 0035"),
    hand(ENERGY, "the simulated motors create no energy", "docs/simulator.md"),
    hand(IMAGE, "the flashed image neither stops nor drives both switches of a leg", "docs/emulation.md"),
    hand(HOMES, "once the faults have healed, HI succeeds", "manual 5.2 (HI)"),
    hand(MOVES, "then C and O reach their goals", "manual 5.2 (C, O)"),
];

/// An invariant by its name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Invariant> {
    INVARIANTS.iter().find(|invariant| invariant.name == name)
}

impl Joint {
    /// A motor of a hand at power-up.
    #[must_use]
    pub fn new(kind: MotorKind, plant: &PlantParams) -> Self {
        Self {
            has_brake: kind == MotorKind::Spread,
            plant: plant.clone(),
            fastest: 0.0,
            pushed: false,
            power: power::Power::default(),
            ending: ending::Ending::default(),
            keeping: keeping::Keeping::default(),
            truth: truth::Trust::default(),
        }
    }

    /// Speed at which the EMF takes all of the voltage, counts/s.
    fn no_load(&self, bus_v: f64) -> f64 {
        bus_v / self.plant.ke_v_s / RAD_PER_COUNT
    }

    /// Checks every invariant of the motor; returns the first that does not hold, and how.
    pub fn check(&mut self, view: &View) -> Option<(&'static Invariant, String)> {
        let mut broken = None;
        for invariant in INVARIANTS {
            let Check::Motor(check) = invariant.check else { continue };
            let found = check(self, view);
            if let Some(found) = found
                && !view.faults.meets(invariant.excused_by)
                && broken.is_none()
            {
                broken = Some((invariant, found));
            }
        }
        broken
    }
}

/// Whether the torque is the duty limit's, which may brake harder than MT.
fn is_by_duty(sample: &Sample) -> bool {
    sample.status.limit == Some(LimitCause::Duty)
}

fn is_idle(sample: &Sample) -> bool {
    sample.status.mode == Mode::Idle
}
