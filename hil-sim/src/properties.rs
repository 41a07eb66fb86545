//! The servo's properties by name: what `[set]` of a scenario and `--set` on the command line speak.
//!
//! A row ties a property's name to its field of [`Config`]. Ranges stay in [`Config::validate`]: a row finds
//! its own by asking it.

use servo_core::{Config, MotorKind};

/// One property of the servo.
pub struct Property {
    /// The row of the wire's table.
    pub property: tater_wire::Property,
    /// Name as in the property table, upper case.
    pub name: &'static str,
    /// Unit and meaning, for help.
    pub about: &'static str,
    get: fn(&Config) -> i64,
    set: fn(&mut Config, i64),
}

impl std::fmt::Debug for Property {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

/// A field of [`Config`] as a property's integer; writing saturates at the field's type.
trait Raw: Copy {
    fn read(self) -> i64;
    fn saturated(value: i64) -> Self;
}

macro_rules! raw {
    ($($type:ty),*) => {$(
        impl Raw for $type {
            fn read(self) -> i64 {
                i64::from(self)
            }
            fn saturated(value: i64) -> Self {
                let bounded = value.clamp(i64::from(Self::MIN), i64::from(Self::MAX));
                Self::try_from(bounded).unwrap_or(Self::MAX)
            }
        }
    )*};
}
raw!(u16, i16, i32);

impl Raw for bool {
    fn read(self) -> i64 {
        i64::from(self)
    }
    fn saturated(value: i64) -> Self {
        value > 0
    }
}

macro_rules! row {
    ($name:ident, $field:ident, $about:literal) => {
        Property {
            property: tater_wire::Property::$name,
            name: stringify!($name),
            about: $about,
            get: |config| config.$field.read(),
            set: |config, value| config.$field = Raw::saturated(value),
        }
    };
}

/// Every property that shapes a motion.
pub const PROPERTIES: [Property; 20] = [
    row!(KP, kp, "position gain"),
    row!(KD, kd, "derivative gain"),
    row!(KI, ki, "integral gain"),
    row!(KPV, kpv, "velocity gain of mode 4"),
    row!(MT, mt, "torque limit, 1/1024 of peak"),
    row!(MV, mv, "cruise velocity, counts/s"),
    row!(MCV, mcv, "cruise velocity when closing, counts/s"),
    row!(MOV, mov, "cruise velocity when opening, counts/s"),
    row!(ACCEL, accel, "acceleration is (ACCEL/1024)^2 counts/ms^2"),
    row!(MPE, mpe, "arrival window, counts"),
    row!(HOLD, hold, "after a move: 1 holds, 0 idles"),
    row!(TSTOP, tstop, "no count for this long while driven is a stall, ms; 0 never"),
    row!(HSG, hsg, "strain above which a move ends; 255 and 256 disable"),
    row!(LSG, lsg, "strain below which a move ends; 255 and 256 disable"),
    row!(BT, bt, "load torque at which a link breaks away, 1/1024 of peak; 0 never"),
    row!(BS, bs, "a breakaway stops the tip too"),
    row!(IVEL, ivel, "velocity towards the stop in HI, counts/s"),
    row!(IOFF, ioff, "distance from the stop to zero in HI, counts"),
    row!(IHIT, ihit, "torque limit in HI, 1/1024 of peak"),
    row!(OTEMP, otemp, "motor temperature limit, 0.1 C; -551 disables"),
];

/// Why a property was not set. Displays found and expected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PropertyError {
    /// No property of that name.
    Unknown {
        /// The name found.
        name: String,
    },
    /// The value is outside the property's range.
    Range {
        /// The property's name.
        name: &'static str,
        /// The value found.
        found: i64,
        /// Smallest value allowed.
        min: i64,
        /// Largest value allowed.
        max: i64,
    },
}

impl PropertyError {
    /// What was found, for an error message.
    #[must_use]
    pub fn found(&self) -> String {
        match self {
            Self::Unknown { name } => format!("{name:?}"),
            Self::Range { name, found, .. } => format!("{name} = {found}"),
        }
    }

    /// What is allowed, for an error message.
    #[must_use]
    pub fn expected(&self) -> String {
        match self {
            Self::Unknown { .. } => format!("one of {}", names()),
            Self::Range { name, min, max, .. } => {
                let about = find(name).map_or("", |property| property.about);
                format!("{name} from {min} to {max} ({about})")
            }
        }
    }
}

impl std::fmt::Display for PropertyError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let what = match self {
            Self::Unknown { .. } => "no property has this name",
            Self::Range { .. } => "property out of range",
        };
        write!(f, "{what}: found {}, expected {}", self.found(), self.expected())
    }
}

impl std::error::Error for PropertyError {}

/// The property of that name, in any case.
#[must_use]
pub fn find(name: &str) -> Option<&'static Property> {
    const ROWS: &[Property] = &PROPERTIES;
    ROWS.iter().find(|property| property.name.eq_ignore_ascii_case(name))
}

/// Sets a property by name.
///
/// # Errors
/// No such name, or a value out of range; `config` has not changed then.
pub fn set(config: &mut Config, name: &str, value: i64) -> Result<(), PropertyError> {
    let property = find(name).ok_or_else(|| PropertyError::Unknown { name: name.to_owned() })?;
    property.set(config, value)
}

/// All names, for messages.
#[must_use]
pub fn names() -> String {
    PROPERTIES.map(|property| property.name).join(", ")
}

impl Property {
    /// The property's value.
    #[must_use]
    pub fn get(&self, config: &Config) -> i64 {
        (self.get)(config)
    }

    /// Sets the property.
    ///
    /// # Errors
    /// The value is out of range; `config` has not changed then.
    pub fn set(&self, config: &mut Config, value: i64) -> Result<(), PropertyError> {
        let (min, max) = self.range();
        if value < min || value > max {
            return Err(PropertyError::Range { name: self.name, found: value, min, max });
        }
        (self.set)(config, value);
        Ok(())
    }

    /// Smallest and largest value: those of [`Config::validate`], or of the field's type where it checks none.
    #[must_use]
    pub fn range(&self) -> (i64, i64) {
        // Ranges do not depend on the motor's kind, and the defaults are all valid, so what fails is this row.
        let mut config = Config::for_motor(MotorKind::Link);
        let mut ends = [0, 0];
        for (end, extreme) in ends.iter_mut().zip([i64::MIN, i64::MAX]) {
            (self.set)(&mut config, extreme);
            if let Err(error) = config.validate() {
                return (i64::from(error.min), i64::from(error.max));
            }
            *end = (self.get)(&config);
        }
        ends.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_reads_back_both_ends_of_its_range_and_refuses_beyond() {
        for property in &PROPERTIES {
            let (min, max) = property.range();
            for value in [min, max] {
                let mut config = Config::for_motor(MotorKind::Spread);
                property.set(&mut config, value).expect(property.name);
                assert_eq!(property.get(&config), value, "{}", property.name);
                assert_eq!(config.validate(), Ok(()), "{} = {value}", property.name);
            }
            for value in [min - 1, max + 1] {
                let mut config = Config::for_motor(MotorKind::Spread);
                assert!(property.set(&mut config, value).is_err(), "{} = {value}", property.name);
                assert_eq!(config, Config::for_motor(MotorKind::Spread));
            }
        }
    }

    #[test]
    fn ranges_are_the_property_tables() {
        let range = |name| find(name).expect(name).range();
        assert_eq!(range("MT"), (0, 990));
        assert_eq!(range("mcv"), (16, 4080));
        assert_eq!(range("TSTOP"), (0, 65535));
        assert_eq!(range("HOLD"), (0, 1));
        assert_eq!(range("IVEL"), (-4080, 4080));
        assert_eq!(range("OTEMP"), (-551, 1250));
    }

    #[test]
    fn each_row_sets_its_own_field_only() {
        for property in &PROPERTIES {
            let mut config = Config::for_motor(MotorKind::Link);
            let (min, max) = property.range();
            let value = if property.get(&config) == max { min } else { max };
            property.set(&mut config, value).expect(property.name);
            let changed: Vec<&str> = PROPERTIES
                .iter()
                .filter(|row| row.get(&config) != row.get(&Config::for_motor(MotorKind::Link)))
                .map(|row| row.name)
                .collect();
            assert_eq!(changed, [property.name]);
        }
    }

    #[test]
    fn an_unknown_name_lists_the_known() {
        let mut config = Config::for_motor(MotorKind::Link);
        let error = set(&mut config, "KQ", 1).expect_err("no KQ");
        assert!(error.to_string().contains("KQ") && error.to_string().contains("KPV"), "{error}");
    }
}
