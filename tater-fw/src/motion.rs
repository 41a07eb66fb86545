//! Binds the properties that shape a motion to the servo's configuration. Their rows are in tater-wire.

use crate::bind::bind;
use servo_core::Config;
use servo_core::motor::BoardFigures;
use tater_wire::MotorKind;

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
    KBW = kbw,
    POLES = motor.poles,
    MR = motor.mr,
    MPK = motor.mpk,
    MVN = motor.mvn,
    MWX = motor.mwx,
    MWJ = motor.mwj,
    MWR = motor.mwr,
    MKA = motor.mka,
    MKE = motor.mke,
    MFC = motor.mfc,
    MFS = motor.mfs,
    MTE = motor.mte,
}

/// Cannot move until it is configured, but knows its brake: the spread's power-off brake releases in 10 to 30 ms.
#[must_use]
pub(crate) fn unconfigured(motor: MotorKind, board: &'static BoardFigures) -> Config {
    let brake_ms = match motor {
        MotorKind::Spread => 30,
        MotorKind::Link | MotorKind::Tip => 0,
    };
    Config { brake_ms, board, ..Config::default() }
}

/// The configuration of a motor of the hand's board on which nothing has been set: the property table's defaults.
#[must_use]
pub fn defaults(motor: MotorKind) -> Config {
    let mut config = unconfigured(motor, &BoardFigures::TATER);
    fill(&mut config, |property| property.rules().default_for_motor(motor).map(i32::from));
    config
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;
    use tater_wire::{Node, Property};

    #[test]
    fn defaults_are_the_tables_for_every_property() {
        for number in 1..=7 {
            let node = Node::new(number).expect("a node");
            let config = defaults(MotorKind::of(node));
            for property in PROPERTIES {
                let (found, expected) = (get(&config, property), property.row().default_for(node));
                assert!(
                    expected.is_some() && found.map(i64::from) == expected,
                    "{property:?} of node {number}"
                );
            }
        }
    }

    /// So the one check of a SET, against the table, is enough: a field takes the low bits of a value without another check, and the
    /// servo is safe with whatever its fields hold.
    #[test]
    fn every_value_of_the_tables_ranges_fits_its_field() {
        for property in PROPERTIES {
            let row = property.row();
            for value in [row.min, row.max].map(|value| i32::try_from(value).expect("32 bits")) {
                let mut config = defaults(MotorKind::Spread);
                assert!(set(&mut config, property, value), "{property:?} {value}");
                assert_eq!(get(&config, property), Some(value));
            }
        }
    }

    #[test]
    fn each_property_sets_its_own_field_only() {
        let plain = defaults(MotorKind::Link);
        for property in PROPERTIES {
            let mut config = plain;
            let row = property.row();
            let is_max = get(&config, property).map(i64::from) == Some(row.max);
            let value = i32::try_from(if is_max { row.min } else { row.max }).expect("32 bits");
            assert!(set(&mut config, property, value), "{property:?}");
            let changed: Vec<Property> =
                PROPERTIES.into_iter().filter(|&p| get(&config, p) != get(&plain, p)).collect();
            assert_eq!(changed, [property]);
        }
    }

    #[test]
    fn all_at_once_are_as_each_alone() {
        fills_and_tells_each(defaults(MotorKind::Link));
    }
}
