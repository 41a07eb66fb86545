//! The promises of docs/safety.md that the checks measure, with their bounds.

use super::measure::Measure;
use super::{contact, meaning, person, power};

/// A promise.
pub struct Promise {
    /// What is measured.
    pub measure: Measure,
    /// Its name in `hil-sim torture --json`.
    pub name: &'static str,
    /// What it bounds, with its unit.
    pub what: &'static str,
    /// The bound.
    pub most: f64,
    /// The invariant that breaks beyond it.
    pub rule: &'static str,
    /// The test that shows it without the torture chamber.
    pub test: &'static str,
}

const fn row(
    measure: Measure,
    name: &'static str,
    what: &'static str,
    most: f64,
    rule: &'static str,
    test: &'static str,
) -> Promise {
    Promise { measure, name, what, most, rule, test }
}

/// Every promise.
pub const PROMISES: &[Promise] = &[
    row(
        Measure::AboveMs,
        "above-mt-ms",
        "a joint's stop feels more than 1.25 of MT, in HI of IHIT, for so long, ms",
        contact::ABOVE_MS as f64,
        "torque-at-contact",
        "tests/contact/torque.rs",
    ),
    row(
        Measure::AboveImpulse,
        "above-mt-mNms",
        "and in that time so much beyond it, mN·m·s",
        contact::ABOVE_M_N_M_S,
        "torque-at-contact",
        "tests/contact/torque.rs",
    ),
    row(
        Measure::AboveSoftMs,
        "above-mt-soft-ms",
        "an object, another finger or a person's feels more than 1.25 of MT for so long, ms",
        contact::ABOVE_SOFT_MS as f64,
        "torque-at-contact",
        "tests/contact/torque.rs",
    ),
    row(
        Measure::AboveSoftImpulse,
        "above-mt-soft-mNms",
        "and in that time so much beyond it, mN·m·s",
        contact::ABOVE_SOFT_M_N_M_S,
        "torque-at-contact",
        "tests/contact/torque.rs",
    ),
    row(
        Measure::AgainstMs,
        "against-t-ms",
        "a rotor is driven on against T by more than a quarter of MT for so long, ms",
        power::AGAINST_MS as f64,
        "torque-has-its-sign",
        "tests/contact/torque.rs",
    ),
    row(
        Measure::HeldMs,
        "held-beyond-tstop-ms",
        "what holds a driven motor is pressed for so long after TSTOP, ms",
        contact::STALL_SLACK_MS as f64,
        "stall-ends-force",
        "tests/contact/stalls.rs",
    ),
    row(
        Measure::FingerNewton,
        "finger-n",
        "a person's finger feels so much, at any MT, of a joint that comes with up to 1056 counts/s, N",
        person::SLOW.newton,
        "finger-energy",
        "tests/contact/force.rs",
    ),
    row(
        Measure::FingerImpulse,
        "finger-Ns",
        "and so much in half a second, N·s",
        person::SLOW.newton_seconds,
        "finger-energy",
        "tests/contact/force.rs",
    ),
    row(
        Measure::FastFingerNewton,
        "fast-finger-n",
        "and of one that comes faster, by an MCV above its default or by V in mode 4, N",
        person::FAST.newton,
        "finger-energy",
        "tests/contact/force.rs",
    ),
    row(
        Measure::FastFingerImpulse,
        "fast-finger-Ns",
        "and so much in half a second, N·s",
        person::FAST.newton_seconds,
        "finger-energy",
        "tests/contact/force.rs",
    ),
    row(
        Measure::StrainMs,
        "strained-ms",
        "a move goes on outside LSG and HSG for so long, ms",
        meaning::STRAIN_MS as f64,
        "strain-ends",
        "servo-core/src/servo/tests.rs",
    ),
    row(
        Measure::LoadedMs,
        "loaded-ms",
        "a link that stands under 1.3 of BT carries it for so long, and six counts at MV longer, ms",
        meaning::BREAKS_AWAY_MS as f64,
        "breaks-away",
        "tests/god/movement/breakaway.rs",
    ),
    row(
        Measure::Winding,
        "winding-c",
        "a winding gets so hot, C",
        power::WINDING_C,
        "winding-temperature",
        "tests/heat.rs",
    ),
    row(
        Measure::Therm,
        "therm-c",
        "THERM is off by so much, C",
        meaning::THERM_C,
        "values-are-true",
        "board-emu/src/analog.rs",
    ),
    row(
        Measure::Bus,
        "vbus-v",
        "VBUS is off by so much for longer than a page erases, V",
        meaning::BUS_V,
        "values-are-true",
        "board-emu/src/analog.rs",
    ),
    row(
        Measure::Way,
        "vel-counts",
        "the way by VEL in 0.1 s is off by so much, counts",
        meaning::WAY_COUNTS,
        "values-are-true",
        "tests/halls.rs",
    ),
];
