//! What the checks have measured at most: how near a run has come to the bounds of docs/safety.md.

/// A quantity whose greatest value is kept; [`super::promise`] says what each is.
#[derive(Clone, Copy, Debug)]
pub enum Measure {
    /// A contact feels more than 1.25 of MT, in HI of IHIT, for so long, ms.
    AboveMs,
    /// And in that time so much beyond it, mN·m·s.
    AboveImpulse,
    /// The same of a contact with something else than the joint's stop.
    AboveSoftMs,
    /// See `AboveSoftMs`.
    AboveSoftImpulse,
    /// A rotor is driven on against T for so long, ms.
    AgainstMs,
    /// What holds a driven motor is pressed for so long after TSTOP, ms.
    HeldMs,
    /// A person's finger feels so much, N, and gets so much of it in half a second, N·s.
    FingerNewton,
    /// See `FingerNewton`.
    FingerImpulse,
    /// The same of a finger that is met faster than the nominal motor turns.
    FastFingerNewton,
    /// See `FastFingerNewton`.
    FastFingerImpulse,
    /// A move goes on outside LSG and HSG for so long, ms.
    StrainMs,
    /// A link that stands under 1.3 of BT carries it for so long, and six counts at MV longer, ms.
    LoadedMs,
    /// A winding gets so hot, C.
    Winding,
    /// THERM is off by so much, C.
    Therm,
    /// VBUS is off by so much for longer than a page erases, V.
    Bus,
    /// The way by VEL in 0.1 s is off by so much, counts.
    Way,
}

/// How many there are.
const COUNT: usize = Measure::Way as usize + 1;

/// The greatest values so far, in the order of [`Measure`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Worst {
    values: [f64; COUNT],
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

    /// The greatest value of one.
    #[must_use]
    pub const fn of(&self, measure: Measure) -> f64 {
        self.values[measure as usize]
    }
}
