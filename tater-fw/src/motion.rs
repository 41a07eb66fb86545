//! The properties that shape a motion, each with its field of the servo's configuration. Range, unit and meaning are
//! the property's row; the servo checks the same ranges, because it trusts nobody.

use crate::bind::bind;
use servo_core::{Config, MotorKind};
use tater_wire::property::Kind;

bind! { motion for Config:
    KP = kp,
    KD = kd,
    KI = ki,
    KPV = kpv,
    MT = mt,
    MV = mv,
    MCV = mcv,
    MOV = mov,
    ACCEL = accel,
    MPE = mpe,
    HOLD = hold,
    TSTOP = tstop,
    HSG = hsg,
    LSG = lsg,
    BT = bt,
    BS = bs,
    IVEL = ivel,
    IOFF = ioff,
    IHIT = ihit,
    OTEMP = otemp,
}

/// The servo's word for a kind of motor.
#[must_use]
pub const fn motor(kind: Kind) -> MotorKind {
    match kind {
        Kind::Link => MotorKind::Link,
        Kind::Spread => MotorKind::Spread,
        Kind::Tip => MotorKind::Tip,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;
    use tater_wire::{Node, Property};

    #[test]
    fn the_servo_has_the_table_s_defaults() {
        for number in 1..=7 {
            let node = Node::new(number).expect("a node");
            let config = Config::for_motor(motor(Kind::of(node)));
            for property in PROPERTIES {
                let (found, expected) = (get(&config, property), property.row().default_for(node));
                assert_eq!(found, expected, "{property:?} of node {number}");
            }
        }
    }

    #[test]
    fn the_servo_has_the_table_s_ranges() {
        for property in PROPERTIES {
            let row = property.row();
            for value in [row.min, row.max] {
                let mut config = Config::for_motor(MotorKind::Spread);
                assert!(set(&mut config, property, value), "{property:?} {value}");
                assert_eq!(config.validate(), Ok(()), "{property:?} {value}");
                assert_eq!(get(&config, property), Some(value));
            }
            for value in [row.min - 1, row.max + 1, i64::MIN, i64::MAX] {
                let mut config = Config::for_motor(MotorKind::Spread);
                assert!(!set(&mut config, property, value), "{property:?} {value}");
                assert_eq!(config, Config::for_motor(MotorKind::Spread), "{property:?} {value}");
            }
        }
    }

    /// One beyond each end, past the table's guard: either the field cannot hold it, or the servo refuses it and
    /// names the table's range.
    #[test]
    fn beyond_the_table_s_range_the_servo_refuses() {
        for property in PROPERTIES {
            let row = property.row();
            for value in [row.min - 1, row.max + 1] {
                let mut config = Config::for_motor(MotorKind::Link);
                if put(&mut config, property, value) {
                    let error = config.validate().expect_err(row.name);
                    let range = (i64::from(error.min), i64::from(error.max));
                    assert_eq!((error.property, range), (row.name, (row.min, row.max)));
                }
            }
        }
    }

    #[test]
    fn each_property_sets_its_own_field_only() {
        let plain = Config::for_motor(MotorKind::Link);
        for property in PROPERTIES {
            let mut config = plain;
            let row = property.row();
            let value = if get(&config, property) == Some(row.max) { row.min } else { row.max };
            assert!(set(&mut config, property, value), "{property:?}");
            let changed: Vec<Property> =
                PROPERTIES.into_iter().filter(|&p| get(&config, p) != get(&plain, p)).collect();
            assert_eq!(changed, [property]);
        }
    }

    #[test]
    fn all_at_once_are_as_each_alone() {
        fills_and_tells_each(Config::for_motor(MotorKind::Link));
    }
}
