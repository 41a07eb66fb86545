//! What the checks have measured at most, beside the bound that docs/safety.md promises: how near a run has come to it.

use super::{contact, meaning, power};

/// A promise of docs/safety.md that a check measures.
pub struct Promise {
    /// Name in `hil-sim torture --json`.
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

/// `Name = "name", "quantity and unit", bound, "invariant", "test";`
macro_rules! promises {
    ($($name:ident = $key:literal, $what:literal, $most:expr, $rule:literal, $test:literal;)*) => {
        /// A quantity whose greatest value is kept.
        #[derive(Clone, Copy, Debug)]
        pub enum Measure { $(#[doc = $what] $name,)* }

        /// Every promise, in the order of [`Measure`].
        pub const PROMISES: &[Promise] =
            &[$(Promise { name: $key, what: $what, most: $most, rule: $rule, test: $test },)*];
    };
}

promises! {
    AboveMs = "above-mt-ms", "a contact feels more than 1.25 of MT, in HI of IHIT, for so long, ms",
        contact::ABOVE_MS as f64, "torque-at-contact", "tests/contact/torque.rs";
    AboveImpulse = "above-mt-mNms", "and in that time so much beyond it, mN·m·s",
        contact::ABOVE_M_N_M_S, "torque-at-contact", "tests/contact/torque.rs";
    HeldMs = "held-beyond-tstop-ms", "what holds a driven motor is pressed for so long after TSTOP, ms",
        contact::STALL_SLACK_MS as f64, "stall-ends-force", "tests/contact/stalls.rs";
    StrainMs = "strained-ms", "a move goes on outside LSG and HSG for so long, ms",
        meaning::STRAIN_MS as f64, "strain-ends", "servo-core/src/servo/tests.rs";
    LoadedMs = "loaded-ms", "a link that stands under 1.3 of BT carries it for so long, and six counts at MV longer, ms",
        meaning::BREAKS_AWAY_MS as f64, "breaks-away", "tests/god/movement/breakaway.rs";
    Winding = "winding-c", "a winding gets so hot, C",
        power::WINDING_C, "winding-temperature", "tests/heat.rs";
    Therm = "therm-c", "THERM is off by so much, C",
        meaning::THERM_C, "values-are-true", "board-emu/src/analog.rs";
    Bus = "vbus-v", "VBUS is off by so much for longer than a page erases, V",
        meaning::BUS_V, "values-are-true", "board-emu/src/analog.rs";
    Way = "vel-counts", "the way by VEL in 0.1 s is off by so much, counts",
        meaning::WAY_COUNTS, "values-are-true", "tests/halls.rs";
    Torque = "t-share", "T of a motor that stands and presses with 100 units or more is off by so much, of 1",
        meaning::TORQUE_SHARE, "values-are-true", "tests/contact/torque.rs";
}

/// The greatest values so far, in the order of [`PROMISES`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Worst {
    values: [f64; PROMISES.len()],
    /// A fault excuses the check that measures now.
    pub is_excused: bool,
}

impl Worst {
    /// Keeps a value if it is the greatest and nothing excuses it.
    pub fn note(&mut self, of: Measure, value: f64) {
        if !self.is_excused {
            let kept = &mut self.values[of as usize];
            *kept = kept.max(value);
        }
    }

    /// Keeps the greater of each two.
    pub fn merge(&mut self, other: &Self) {
        for (kept, value) in self.values.iter_mut().zip(other.values) {
            *kept = kept.max(value);
        }
    }

    /// Names and values.
    pub fn rows(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        PROMISES.iter().map(|promise| promise.name).zip(self.values)
    }
}
