//! What must hold in a hand, whatever its host sends and whatever breaks: each invariant with its name, the section that demands
//! it, and its check. The checks run at each millisecond, which is each control tick of a board.
//!
//! A check sees the true state of the plant and, of native boards, what a host could read on the wire. It names nothing of the firmware
//! (tests/fences/judge.rs); `torture/observe.rs` translates. Some faults excuse a check, because no board could hold it then: `excuse.rs` has
//! a row for each, with its reason.

mod contact;
mod ending;
pub(crate) mod excuse;
mod joint;
mod keeping;
mod meaning;
pub mod measure;
mod person;
mod power;
pub mod promise;
mod truth;

pub(crate) use contact::MAY_PRESS;
use excuse::Excuse;
pub(crate) use joint::AFTERMATH_MS;
pub use joint::{Ground, Joint, Seen, View};

/// An invariant.
#[derive(Clone, Copy)]
pub struct Invariant {
    /// Its name on the command line and in reports.
    pub name: &'static str,
    /// What it demands.
    pub demands: &'static str,
    /// Where that is demanded.
    pub source: &'static str,
    /// Faults with which it need not hold, or holds in part.
    pub excused_by: &'static [Excuse],
    check: Check,
}

#[derive(Clone, Copy)]
enum Check {
    /// Of one motor, at each tick, by what is seen from outside its board: it holds for emulated boards as well.
    Motor(fn(&mut Joint, &View) -> Option<String>),
    /// Of one motor, at each tick, by the state of its program, which only native boards show.
    Program(fn(&mut Joint, &View) -> Option<String>),
    /// Elsewhere: of the hand, by [`super::play`] and [`super::recovery`].
    Hand,
}

const fn row(
    name: &'static str,
    demands: &'static str,
    source: &'static str,
    excused_by: &'static [Excuse],
    check: Check,
) -> Invariant {
    Invariant { name, demands, source, excused_by, check }
}

const fn hand(name: &'static str, demands: &'static str, source: &'static str) -> Invariant {
    Invariant { name, demands, source, excused_by: excuse::NONE, check: Check::Hand }
}

/// A prompt within its time.
pub const PROMPT: &str = "prompt";
/// ^C brings the prompt.
pub const ABORT: &str = "abort";
/// GOD's mailboxes and queues.
pub(crate) const QUEUES: &str = "queues";
/// Energy balance of the simulated motors.
pub(crate) const ENERGY: &str = "energy";
/// The image on the emulated processor neither stops nor drives both switches of a leg.
pub const IMAGE: &str = "image-runs";
/// Settings come back.
pub(crate) const GIVES_BACK: &str = "gives-back";
/// Nothing panics.
pub(crate) const NO_PANIC: &str = "no-panic";
/// Liveness: the hand homes.
pub(crate) const HOMES: &str = "homes-again";
/// Liveness: the hand moves.
pub const MOVES: &str = "moves-again";
/// Liveness: RealTime tells the truth.
pub(crate) const STREAMS: &str = "streams-again";

/// Every invariant.
pub const INVARIANTS: &[Invariant] = &[
    row(
        "no-shoot-through",
        "one leg floats, and of the others at most one is switched",
        "docs/board.md, Bridge",
        excuse::NONE,
        Check::Motor(power::legs),
    ),
    row(
        "idle-undriven",
        "no drive in mode 0",
        "docs/properties.md, modes",
        excuse::NONE,
        Check::Program(power::idle),
    ),
    row(
        "monitor-undriven",
        "no drive without an application",
        "docs/download.md",
        excuse::NONE,
        Check::Program(power::monitor),
    ),
    row(
        "fault-undriven",
        "no drive with a latched fault",
        "manual 7; docs/properties.md, faults",
        excuse::NONE,
        Check::Program(power::fault),
    ),
    row(
        "brake-undriven",
        "no drive against a brake that is commanded to engage",
        "docs/board.md, brake",
        excuse::NONE,
        Check::Motor(power::brake),
    ),
    row(
        "torque-within-mt",
        "the torque is at most MT, derated near OTEMP",
        "docs/properties.md, MT and OTEMP; decision 0014",
        excuse::NONE,
        Check::Program(power::torque),
    ),
    row("duty-limit", "duty is at most 97 %", "decision 0005", excuse::NONE, Check::Program(power::duty)),
    row(
        "winding-temperature",
        "the winding stays below 135 C, without the hot mark below 110 C; with a lying sensor below 155 C",
        "decisions 0014 and 0051",
        excuse::WINDING,
        Check::Motor(power::winding),
    ),
    row(
        "phase-current",
        "the phase current stays below that of full torque at standstill and an impact; with lying sensors below the trip",
        "docs/board.md, bridge",
        excuse::CURRENT,
        Check::Motor(power::current),
    ),
    row(
        "bus-voltage",
        "motors do not raise the bus above 31 V",
        "decision 0053",
        excuse::BUS,
        Check::Motor(power::bus),
    ),
    row(
        "load-keeps-the-bus",
        "motors do not pull a source of 22 A and 500 W below 16 V: their torque folds back before",
        "docs/properties.md, ERROR 5; decision 0053",
        excuse::LOAD,
        Check::Program(power::load),
    ),
    row(
        "no-erase-while-driven",
        "no page is erased while the bridge is on",
        "decision 0012",
        excuse::NONE,
        Check::Program(power::erase),
    ),
    row(
        "no-watchdog-reset",
        "no watchdog bites a program that was not hung",
        "decision 0052",
        excuse::WATCHDOG,
        Check::Program(power::watchdog),
    ),
    row(
        "speed-limit",
        "no motor is faster than its voltage can drive it, no move faster than MV by 50 counts/s for 100 ms",
        "manual 5.3.1 (MCV, MOV); docs/properties.md, MV",
        excuse::SPEED,
        Check::Motor(power::speed),
    ),
    row(
        "within-stops",
        "a stop is dented no deeper than peak torque and speed can",
        "manual table 1",
        excuse::LOADED,
        Check::Motor(power::stops),
    ),
    row(
        "stall-ends-force",
        "a motor that a stop, an object or a finger holds is driven no longer than TSTOP and 40 ms at a time; within two counts of E, and in a move of HI, 2 s more",
        "manual 5.3.4 (TSTOP); decisions 0049 and 0077",
        excuse::STALL,
        Check::Program(contact::time),
    ),
    row(
        "torque-at-contact",
        "what holds a motor feels more than MT for a few milliseconds only, by the plant's torque",
        "docs/safety.md; decision 0076",
        excuse::TORQUE,
        Check::Program(contact::torque),
    ),
    row(
        "torque-has-its-sign",
        "no rotor is driven on against T by more than a quarter of MT for more than a few milliseconds, by the plant's torque",
        "docs/properties.md, T; decision 0076",
        excuse::TORQUE,
        Check::Program(power::sign),
    ),
    row(
        "finger-energy",
        "a person's finger, 30 N/mm, takes no more energy than the rotor brings to it and MT gives, in HI IHIT, and feels at most 420 N, and 450 N of a joint that is faster than the nominal motor",
        "docs/force.md; docs/safety.md",
        excuse::FINGER,
        Check::Program(person::energy),
    ),
    row(
        "strain-ends",
        "a move, TC and TO end at once outside LSG and HSG",
        "manual 5.3.1 (HSG, LSG); docs/properties.md, END",
        excuse::NONE,
        Check::Program(meaning::strain),
    ),
    row(
        "breaks-away",
        "a link that stands under more than BT in the middle of a move breaks away within 100 ms and six counts of MV",
        "manual 5.1.2 (BT); docs/safety.md",
        excuse::UNSEEN,
        Check::Program(meaning::breakaway),
    ),
    row(
        "end-is-true",
        "a stall means TSTOP without a count, a breakaway a load of BT",
        "docs/properties.md, END",
        excuse::UNSEEN,
        Check::Program(meaning::end),
    ),
    row(
        "values-are-true",
        "THERM, VBUS, B, SG, VEL and T are those of the plant, within stated errors",
        "docs/properties.md",
        excuse::VALUES,
        Check::Program(meaning::values),
    ),
    row(
        "host-watched",
        "no motor is driven in mode 2 or 4 that has heard no frame for longer than HOSTMS",
        "docs/properties.md, HOSTMS; decision 0013",
        excuse::NONE,
        Check::Program(ending::host),
    ),
    row(
        "v-ends-with-its-motion",
        "V is 0 when a motion has ended",
        "docs/properties.md, VSET",
        excuse::NONE,
        Check::Program(ending::velocity),
    ),
    row(
        "ends-once",
        "a motion ends once, for one reason",
        "docs/properties.md, END; decision 0007",
        excuse::NONE,
        Check::Program(ending::once),
    ),
    row(
        "ends-in-time",
        "a motion ends within the time of its profile and its stalls",
        "decision 0049",
        excuse::IN_TIME,
        Check::Program(ending::in_time),
    ),
    row(
        "arrived-is-true",
        "\"arrived\" means at rest within MPE",
        "manual 5.3.4 (MPE); decision 0049",
        excuse::ARRIVED,
        Check::Program(ending::arrived),
    ),
    row(
        "hold-as-ordered",
        "after a motion HOLD 1 holds, HOLD 0 idles; a move that MODE 5 ordered holds with either",
        "manual 5.5",
        excuse::NONE,
        Check::Program(ending::hold),
    ),
    row(
        "counters-grow",
        "UPSECS, OD and PTEMP never decrease, nor does STAT 0 lose any",
        "manual 5.4.2; decision 0018",
        excuse::COUNTERS,
        Check::Program(keeping::counters),
    ),
    row(
        "saves-survive",
        "an acknowledged SAVE survives, or ERROR 8 reports its loss",
        "manual 7 (saveParameters); decision 0018",
        excuse::NONE,
        Check::Program(keeping::saves),
    ),
    row(
        "refusal-changes-nothing",
        "a refused SET changes nothing, and SET P is refused with a latched ERROR",
        "decisions 0036 and 0037",
        excuse::REFUSALS,
        Check::Program(keeping::refusals),
    ),
    row(
        "position-is-true",
        "a position that is known is within a count of the rotor, and the zero of HI is IOFF from a stop, or from the dent that IVEL and IHIT press into it",
        "manual 7; decision 0010",
        excuse::POSITION,
        Check::Program(truth::position),
    ),
    row(
        "trust-is-true",
        "a position that a start trusts is that of the last run",
        "decision 0010",
        excuse::NONE,
        Check::Program(truth::trust),
    ),
    row(
        "wrong-way",
        "no motor runs more than a third of a turn against its own torque",
        "decision 0047",
        excuse::LOADED,
        Check::Program(truth::wrong_way),
    ),
    hand(
        QUEUES,
        "GOD fills three mailboxes at most, loses no byte that it had room for and, during a command, no frame",
        "decision 0035",
    ),
    hand(
        PROMPT,
        "every command ends in a prompt within the time of its motions",
        "manual 5.1; decision 0035",
    ),
    hand(
        ABORT,
        "^C brings the prompt within 0.6 s, and the motors of the host's commands to rest",
        "manual 5.1.2; decision 0035",
    ),
    hand(
        GIVES_BACK,
        "a command that moves or asks leaves every setting of the boards and every parameter of GOD as it was, after ^C as well",
        "docs/hand.md, Motions; manual 5.5",
    ),
    hand(ENERGY, "the simulated motors create no energy", "docs/simulator.md"),
    hand(IMAGE, "the flashed image neither stops nor drives both switches of a leg", "docs/emulation.md"),
    hand(NO_PANIC, "no arithmetic overflows, no assertion fails", "invariant 8 of ARCHITECTURE.md"),
    hand(HOMES, "once the faults have healed, HI succeeds", "manual 5.2 (HI)"),
    hand(MOVES, "then C and O reach their goals, and a link alone does", "manual 5.2 (C, O), 5.1.1 (X)"),
    hand(
        STREAMS,
        "then LOOP answers each block by the true position and velocity, and by changes whose sum is the position; it drives on for 0.1 s for a host that does not read, and not for 0.35 s",
        "manual 6.2.3; decision 0026",
    ),
];

/// An invariant by its name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Invariant> {
    INVARIANTS.iter().find(|invariant| invariant.name == name)
}

impl Invariant {
    /// Whether it is checked on emulated boards as well, whose program is not seen.
    #[must_use]
    pub(crate) const fn is_seen_from_outside(&self) -> bool {
        !matches!(self.check, Check::Program(_))
    }
}

impl Joint {
    /// Checks every invariant of the motor; returns the first that does not hold, and how.
    pub fn check(&mut self, view: &View) -> Option<(&'static Invariant, String)> {
        let mut broken = None;
        for invariant in INVARIANTS {
            let check = match invariant.check {
                Check::Program(check) if view.ground.is_some() => check,
                Check::Motor(check) => check,
                Check::Program(_) | Check::Hand => continue,
            };
            self.worst.is_excused = invariant.excused_by.iter().any(|excuse| excuse.excuses(view));
            let found = check(self, view);
            if let Some(found) = found
                && !self.worst.is_excused
                && broken.is_none()
            {
                broken = Some((invariant, found));
            }
        }
        broken
    }
}
