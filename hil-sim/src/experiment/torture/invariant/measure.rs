//! What the checks have measured at most: how near a run has come to its bounds.

/// `Name = "name", "unit and meaning";`
macro_rules! measures {
    ($($name:ident = $key:literal, $what:literal;)*) => {
        /// A quantity whose greatest value is kept.
        #[derive(Clone, Copy, Debug)]
        pub enum Measure { $(#[doc = $what] $name,)* }

        /// Name on the command line and meaning of each, in order.
        pub const ROWS: &[(&str, &str)] = &[$(($key, $what),)*];
    };
}

measures! {
    AboveMs = "above-mt-ms", "time of a contact above 1.25 MT or IHIT, ms";
    AboveImpulse = "above-mt-mNms", "torque beyond MT or IHIT in that time, mN·m·s";
    HeldMs = "held-beyond-tstop-ms", "time for which something has held a driven motor, less TSTOP, ms";
    StrainMs = "strained-ms", "time of a move outside LSG and HSG, ms";
    LoadedMs = "loaded-ms", "time of a link that stands under more than 1.3 BT, ms";
    Therm = "therm-c", "error of THERM, C";
    Bus = "vbus-v", "error of VBUS, V";
    Velocity = "vel-counts-s", "error of VEL, counts/s";
    Winding = "winding-c", "temperature of a winding, C";
    Dent = "dent-counts", "way into a stop, counts";
}

/// The greatest values so far, in the order of [`ROWS`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Worst {
    values: [f64; ROWS.len()],
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
        ROWS.iter().map(|(name, _)| *name).zip(self.values)
    }
}
