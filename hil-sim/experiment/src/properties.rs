//! The servo's properties by name, for `set` in a scenario and `--set` on the command line. Name, range and meaning come from
//! the wire's table; the firmware ([`tater_fw::motion`]) maps each property to its field of [`Config`].

use servo_core::Config;
use tater_fw::motion;
pub use tater_fw::motion::defaults;
use tater_wire::property::PropertySpec;

/// One property of the servo.
#[derive(Clone, Copy)]
pub struct Property {
    /// Name as in the property table, upper case.
    pub name: &'static str,
    /// Meaning, for help.
    pub about: &'static str,
    /// The property on the wire.
    pub property: tater_wire::Property,
    row: &'static PropertySpec,
}

impl std::fmt::Debug for Property {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

impl Property {
    const fn new(property: tater_wire::Property) -> Self {
        let row = property.row();
        Self { name: row.name, about: row.meaning, property, row }
    }
}

/// Every property that shapes a motion.
pub const PROPERTIES: [Property; motion::PROPERTIES.len()] = {
    let mut all = [Property::new(motion::PROPERTIES[0]); motion::PROPERTIES.len()];
    let mut i = 1;
    while i < all.len() {
        all[i] = Property::new(motion::PROPERTIES[i]);
        i += 1;
    }
    all
};

/// Reason why a property was not set. Displays found and expected.
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
    /// The value found, for an error message.
    #[must_use]
    pub fn found(&self) -> String {
        match self {
            Self::Unknown { name } => format!("{name:?}"),
            Self::Range { name, found, .. } => format!("{name} = {found}"),
        }
    }

    /// The allowed values, for an error message.
    #[must_use]
    pub fn expected(&self) -> String {
        match self {
            Self::Unknown { .. } => format!("one of {}", names()),
            Self::Range { name, min, max, .. } => {
                let about =
                    find(name).map_or_else(String::new, |Property { about, row, .. }| match row.unit {
                        "-" => format!(" ({about})"),
                        unit => format!(" ({about}; {unit})"),
                    });
                format!("{name} from {min} to {max}{about}")
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

/// The property of that name, case-insensitive.
#[must_use]
pub fn find(name: &str) -> Option<&'static Property> {
    const ROWS: &[Property] = &PROPERTIES;
    ROWS.iter().find(|property| property.name.eq_ignore_ascii_case(name))
}

/// Sets a property by name.
///
/// # Errors
/// The name is unknown, or the value is out of range; `config` is unchanged.
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
        // Every row here is a field.
        motion::get(config, self.row.property).unwrap_or_default().into()
    }

    /// Sets the property.
    ///
    /// # Errors
    /// The value is out of range; `config` is unchanged.
    pub fn set(&self, config: &mut Config, value: i64) -> Result<(), PropertyError> {
        if let Ok(narrow) = i32::try_from(value)
            && self.row.admits(value)
            && motion::set(config, self.row.property, narrow)
        {
            return Ok(());
        }
        let (min, max) = self.range();
        Err(PropertyError::Range { name: self.name, found: value, min, max })
    }

    /// Its unit; empty for a plain number.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        if self.row.unit == "-" { "" } else { self.row.unit }
    }

    /// Smallest and largest value.
    #[must_use]
    pub const fn range(&self) -> (i64, i64) {
        (self.row.min, self.row.max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tater_wire::MotorKind;

    #[test]
    fn range_ends_read_back_and_values_beyond_are_refused() {
        for property in &PROPERTIES {
            let (min, max) = property.range();
            for value in [min, max] {
                let mut config = tater_fw::motion::defaults(MotorKind::Spread);
                property.set(&mut config, value).expect(property.name);
                assert_eq!(property.get(&config), value, "{}", property.name);
            }
            for value in [min - 1, max + 1] {
                let mut config = tater_fw::motion::defaults(MotorKind::Spread);
                assert!(property.set(&mut config, value).is_err(), "{} = {value}", property.name);
                assert_eq!(config, tater_fw::motion::defaults(MotorKind::Spread));
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
    fn property_sets_its_own_field_only() {
        for property in &PROPERTIES {
            let mut config = tater_fw::motion::defaults(MotorKind::Link);
            let (min, max) = property.range();
            let value = if property.get(&config) == max { min } else { max };
            property.set(&mut config, value).expect(property.name);
            let changed: Vec<&str> = PROPERTIES
                .iter()
                .filter(|row| row.get(&config) != row.get(&tater_fw::motion::defaults(MotorKind::Link)))
                .map(|row| row.name)
                .collect();
            assert_eq!(changed, [property.name]);
        }
    }

    #[test]
    fn unknown_name_lists_known_names() {
        let mut config = tater_fw::motion::defaults(MotorKind::Link);
        let error = set(&mut config, "KQ", 1).expect_err("no KQ");
        assert!(error.to_string().contains("KQ") && error.to_string().contains("KPV"), "{error}");
    }
}
