use super::*;
use crate::{Node, Value};

#[test]
fn property_numbers_and_names_are_unique_and_ascend() {
    for pair in ROWS.windows(2) {
        assert!(pair[0].property.id() < pair[1].property.id(), "{} {}", pair[0].name, pair[1].name);
    }
    for row in ROWS {
        assert!(row.property.id() < 128, "{}: bit 7 is SET's", row.name);
        assert_eq!(Property::of(row.property.id()), Some(row.property));
        assert_eq!(Property::named(row.name), Some(row.property), "twice: {}", row.name);
        assert_eq!(row.property.row().name, row.name);
    }
}

#[test]
fn defaults_are_in_range_on_every_board() {
    for row in ROWS {
        assert!(row.min <= row.max && [16, 32].contains(&row.bits), "{}", row.name);
        for number in 0..32 {
            let node = Node::new(number).expect("a node");
            // Straps may give node 0, which is not valid; such a board is silent.
            if number == 0 && row.default == Default::Node {
                continue;
            }
            let Some(default) = row.default_for(node) else { continue };
            assert!(row.admits(default), "{} on node {number}: {default}", row.name);
        }
    }
}

#[test]
fn stored_properties_can_be_set_and_have_a_default() {
    for row in ROWS {
        if row.stored != Stored::No {
            assert!(matches!(row.access, Access::ReadWrite | Access::Locked), "{}", row.name);
            assert_ne!(row.default, Default::None, "{}", row.name);
        }
    }
}

#[test]
fn values_round_trip_in_their_width() {
    for row in ROWS {
        let middle = row.min.midpoint(row.max);
        for value in [row.min, row.min + 1, -1, 0, 1, middle, row.max - 1, row.max] {
            let Some(value) = Some(value).filter(|&value| row.admits(value)) else { continue };
            let wire = row.property.write(value).expect("fits 32 bits");
            assert_eq!(row.property.read(wire), value, "{} {wire:?}", row.name);
            let narrow = row.bits == 16 && i16::try_from(value).is_ok();
            assert_eq!(matches!(wire, Value::Short(_)), narrow, "{} {value}", row.name);
        }
    }
}

#[test]
fn short_ffff_is_65535_for_unsigned_properties_and_minus_one_for_others() {
    assert_eq!(Property::TSTOP.read(Value::Short(0xFFFF)), 65535);
    assert_eq!(Property::ACCEL.read(Value::Short(0xFFFF)), 65535);
    assert_eq!(Property::OD.read(Value::Short(0xFFFF)), 65535);
    assert_eq!(Property::OD.read(Value::Long(0xFFFF_FFFF)), 4_294_967_295);
    assert_eq!(Property::E.read(Value::Short(0xFFFF)), -1);
    assert_eq!(Property::E.read(Value::Long(0xFFFF_FFFF)), -1);
    assert_eq!(Property::X0.write(1 << 33), None);
}
