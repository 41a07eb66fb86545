//! Properties that are neither measured nor part of the servo's configuration: the board stores what was set.

use crate::bind::bind;

/// Meaning, unit and range are in the property table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    role: u16,
    sn: u16,
    id: u8,
    /// Groups received besides 0.
    pub grpa: u8,
    pub grpb: u8,
    pub grpc: u8,
    x0: i16,
    x1: i16,
    x2: i16,
    x3: i16,
    x4: i16,
    x5: i16,
    x6: i16,
    x7: i16,
    pub dp: i32,
    pub ot: i32,
    pub ct: i32,
    pub ds: i16,
    pub pidx: u8,
    jidx: u8,
    en: bool,
    pub lflags: u8,
    lcvc: u8,
    pub wiring: u8,
    pub hostms: u16,
    kind: u8,
    pub jlo: i16,
    pub jhi: i16,
    pub hostunits: u16,
}

bind! { settings for Settings:
    ROLE = role,
    SN = sn,
    ID = id,
    GRPA = grpa,
    GRPB = grpb,
    GRPC = grpc,
    X0 = x0,
    X1 = x1,
    X2 = x2,
    X3 = x3,
    X4 = x4,
    X5 = x5,
    X6 = x6,
    X7 = x7,
    DP = dp,
    OT = ot,
    CT = ct,
    DS = ds,
    PIDX = pidx,
    JIDX = jidx,
    EN = en,
    LFLAGS = lflags,
    LCVC = lcvc,
    WIRING = wiring,
    HOSTMS = hostms,
    KIND = kind,
    JLO = jlo,
    JHI = jhi,
    HOSTUNITS = hostunits,
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;
    use tater_wire::Property;

    #[test]
    fn each_property_has_a_field_of_its_own_that_holds_its_range() {
        for property in PROPERTIES {
            let row = property.row();
            for value in [row.min, row.max].map(|value| i32::try_from(value).expect("32 bits")) {
                let mut settings = Settings::default();
                assert!(set(&mut settings, property, value), "{property:?} {value}");
                assert_eq!(get(&settings, property), Some(value), "{property:?}");
                let changed: Vec<Property> = PROPERTIES
                    .into_iter()
                    .filter(|&p| get(&settings, p) != get(&Settings::default(), p))
                    .collect();
                assert!(changed.iter().all(|&p| p == property), "{property:?} changes {changed:?}");
            }
        }
    }

    #[test]
    fn all_at_once_are_as_each_alone() {
        fills_and_tells_each(Settings::default());
    }
}
