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

#[test]
fn kind_and_hand_defaults_follow_the_nodes_of_a_hand_alone_and_on_an_arm() {
    use MotorKind::{Link, Spread, Tip};
    let kinds = [Link, Link, Link, Spread, Tip, Tip, Tip];
    for (index, kind) in kinds.into_iter().enumerate() {
        let number = u8::try_from(index + 1).expect("seven");
        let slot = i64::from(if number > 4 { number - 4 } else { number });
        for (node, grpb, grpc) in [(number, if number > 4 { 2 } else { 1 }, 4), (number + 10, 7, 5)] {
            let node = Node::new(node).expect("a node");
            assert_eq!(MotorKind::of(node), kind, "{node:?}");
            let default = |property: Property| property.row().default_for(node);
            assert_eq!(default(Property::GRPA), Some(0));
            assert_eq!(default(Property::GRPB), Some(grpb), "{node:?}");
            assert_eq!(default(Property::GRPC), Some(grpc), "{node:?}");
            assert_eq!(default(Property::PIDX), Some(slot), "{node:?}");
            assert_eq!(default(Property::JIDX), Some(number.into()), "{node:?}");
            assert_eq!(default(Property::ID), Some(node.number().into()));
            assert_eq!(default(Property::KIND), Some(kind.code().into()), "{node:?}");
            for other in kinds {
                let ct = Property::CT.row().default_on(node, other);
                assert_eq!(ct, Property::CT.row().default_for_motor(other).map(i64::from));
            }
        }
    }
    for kind in kinds {
        assert_eq!(MotorKind::from_code(kind.code().into()), Some(kind));
    }
    // Tables 1 and 2 of the manual: 55 GCL counts a hall count.
    for (kind, gear, gcl) in
        [(Link, 4900, [-1375, 18_590]), (Spread, 1828, [0, 9130]), (Tip, 3900, [-8690, 19_250])]
    {
        let range = kind.range_counts().map(|counts| 55 * i32::from(counts));
        assert_eq!((kind.gear_hundredths(), range), (gear, gcl), "{kind:?}");
    }
    assert_eq!([0, 4, -1].map(MotorKind::from_code), [None; 3]);
    for other in (8..=10).chain(18..=31) {
        assert_eq!(MotorKind::of(Node::new(other).expect("a node")), Link, "{other}");
    }
}

#[test]
fn is_stored_agrees_with_the_table() {
    for id in 0..=u8::MAX {
        let stored = ROWS.iter().any(|row| row.property.id() == id && row.stored == Stored::Yes);
        assert_eq!(Property::is_stored(id), stored, "{id}");
    }
}

#[test]
fn otemp_admits_no_limit_and_20_c_upwards() {
    let admits = |value| Property::OTEMP.rules().admits(value);
    let refused: std::vec::Vec<i64> = (-560..=1260).filter(|&value| !admits(value)).collect();
    let expected = (-560..=-552).chain(-550..=199).chain(1251..=1260);
    assert_eq!(refused, expected.collect::<std::vec::Vec<i64>>());
}
