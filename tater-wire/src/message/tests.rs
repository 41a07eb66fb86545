use super::*;
use proptest::prelude::*;
use std::vec::Vec;

fn node(number: u8) -> Node {
    Node::new(number).expect("a node")
}

fn of_host(to: Destination, body: Body) -> Vec<u8> {
    Message { from: Node::HOST, to, body }.frame().data().to_vec()
}

#[test]
fn frame_bytes_match_published_hosts() {
    let four = Destination::Node(node(4));
    assert_eq!(of_host(four, Body::Get(5)), [5]);
    let set = |property, value| Message::set(four, property, value).expect("fits").frame().data().to_vec();
    assert_eq!(set(Property::MODE, 5), [0x88, 0, 5, 0]);
    let high = Body::Set { property: 0x88, value: Value::Short(5) };
    assert_eq!(of_host(four, high), [0x88, 0, 5, 0], "bit 7 says SET, whatever the number");
    assert_eq!(set(Property::E, -85), [0x80 | 52, 0, 0xAB, 0xFF, 0xFF, 0xFF]);
    assert_eq!(set(Property::TSTOP, 65535), [0x80 | 78, 0, 0xFF, 0xFF, 0, 0], "does not fit 16 bits signed");
    let reply = Message::reply(node(3), Property::P, -1).expect("fits").frame();
    assert_eq!((reply.raw_id(), reply.data()), (0x463, &[0xBF, 0xFF, 0xFF][..]));
    let reply = Message::reply(node(3), Property::STAT, 2).expect("fits").frame();
    assert_eq!((reply.raw_id(), reply.data()), (0x466, &[0x85, 0, 2, 0][..]));
}

#[test]
fn number_that_only_barrett_has_is_answered_with_0_in_its_width() {
    let answer = |to, number| {
        Message::absent(node(3), to, number)
            .map(|message| (message.frame().raw_id(), message.frame().data().to_vec()))
    };
    let wide = WIDE[0];
    assert_eq!(answer(Node::HOST, wide), Some((0x466, [&[0x80 | wide, 0][..], &[0; 4]].concat())));
    let short = (0..BARRETTS).find(|number| !WIDE.contains(number)).expect("most of them");
    assert_eq!(answer(Node::HOST, short), Some((0x466, [0x80 | short, 0, 0, 0].to_vec())));
    // Another node gets it as its VALUE.
    assert_eq!(answer(node(5), short), Some((0x065, [0x80 | VALUE, 0, 0, 0].to_vec())));
    assert_eq!(answer(Node::HOST, BARRETTS), None);
}

/// A host for the BH8-282 sends `01 00` for ROLE, and waits for the answer without a limit.
#[test]
fn frame_without_the_bit_of_set_is_a_get_of_any_length() {
    for id in [0x004, 0x404, 0x0C4] {
        for number in [0, 1, 5, 127] {
            for len in 1..=8 {
                for rest in [0, 0x85] {
                    let data = [number, rest, rest, rest, rest, rest, rest, rest];
                    let frame = Frame::from_raw(id, &data[..len]).expect("a frame");
                    let found = Message::parse(&frame).map(|message| message.body);
                    assert_eq!(found, Some(Body::Get(number)), "{frame:?}");
                }
            }
        }
    }
    let frame = Frame::from_raw(0x080, &[0, 16, 8, 0, 0]).expect("a frame");
    let more = Body::More { frames: 16, received: 8 };
    assert_eq!(Message::parse(&frame).map(|message| message.body), Some(more), "to the host");
}

#[test]
fn torques_are_packed_without_gaps() {
    let low = Destination::Group(Group::LOW);
    let packed = |torques: &[i16]| of_host(low, Body::Torques(Torques::new(torques).expect("one to four")));
    // 14 bits of 1, -1, 2, -2: 00000000000001 11111111111111 00000000000010 11111111111110
    assert_eq!(packed(&[1, -1, 2, -2]), [0xAA, 0x00, 0x07, 0xFF, 0xF0, 0x00, 0xBF, 0xFE]);
    assert_eq!(packed(&[1]), [0xAA, 0x00, 0x04]);
    assert_eq!(packed(&[-1, 1]).len(), 5);
    assert_eq!(packed(&[0, 0, 0]).len(), 7);
    assert!(Torques::new(&[]).is_none() && Torques::new(&[0; 5]).is_none());
    assert_eq!(Torques::new(&[9000]).and_then(|t| t.slot(1)), Some(8191));
    for (dlc, slots) in [(2, 0), (3, 1), (4, 1), (5, 2), (6, 2), (7, 3), (8, 4)] {
        let mut data = [0xFF; 8];
        data[0] = 0xAA;
        let frame = Frame::from_raw(0x401, &data[..dlc]).expect("a frame");
        let found = Message::parse(&frame).map(|message| message.body);
        // Bits of an incomplete slot belong to none.
        let whole = Torques::new(&[-1; SLOTS][..slots]).map(Body::Torques);
        assert_eq!(found, whole, "DLC {dlc}");
    }
}

/// pyHand sets T of group 5 in four bytes, libbarrett packs the torques of its four motors into eight.
#[test]
fn frame_of_t_to_the_hand_is_packed_unless_it_has_the_length_of_a_set() {
    for (dlc, expected) in [
        (3, Some(Body::Torques(Torques::new(&[0]).expect("one")))),
        (4, Some(Body::Set { property: 42, value: Value::Short(0) })),
        (5, Some(Body::Torques(Torques::new(&[0; 2]).expect("two")))),
        (6, Some(Body::Set { property: 42, value: Value::Long(0) })),
        (7, Some(Body::Torques(Torques::new(&[0; 3]).expect("three")))),
        (8, Some(Body::Torques(Torques::new(&[0; 4]).expect("four")))),
    ] {
        let frame = Frame::from_raw(0x405, &[0xAA, 0, 0, 0, 0, 0, 0, 0][..dlc]).expect("a frame");
        assert_eq!(Message::parse(&frame).map(|message| message.body), expected, "DLC {dlc}");
    }
}

#[test]
fn invalid_frames_do_not_parse() {
    for (id, data) in [
        (4u16, &[][..]),
        (4, &[0x85]),             // a SET without a value
        (4, &[0x85, 0, 1]),       // three bytes
        (4, &[0x85, 1, 1, 0]),    // byte 1 is not 0
        (4, &[0x85, 0, 1, 0, 0]), // five
        (4, &[0x85, 0, 1, 0, 0, 0, 0]),
        (0x463, &[0xC0, 0, 0]), // bit 6 of a position
        (0x401, &[0xAA, 0]),    // no torque has its 14 bits
    ] {
        let frame = Frame::from_raw(id, data).expect("a frame");
        assert_eq!(Message::parse(&frame), None, "{frame:?}");
    }
}

fn message() -> impl Strategy<Value = Message> {
    let node = || (0u8..32).prop_map(node);
    let anywhere = prop_oneof![
        (0u8..32).prop_map(|n| Destination::Node(Node::new(n).expect("a node"))),
        (0u8..32).prop_map(|n| Destination::Group(Group::new(n).expect("a group"))),
    ];
    let value = prop_oneof![any::<u16>().prop_map(Value::Short), any::<u32>().prop_map(Value::Long)];
    let torque_group =
        prop_oneof![Just(Group::LOW), Just(Group::HIGH), Just(Group::HAND)].prop_map(Destination::Group);
    let is_torques = |to, property| {
        property == 42 && [Destination::Group(Group::LOW), Destination::Group(Group::HIGH)].contains(&to)
    };
    prop_oneof![
        (node(), anywhere.clone(), 0u8..128).prop_map(|(from, to, id)| Message {
            from,
            to,
            body: Body::Get(id)
        }),
        (node(), anywhere.clone(), 0u8..128, value)
            .prop_filter("packed torques there", move |&(_, to, property, _)| !is_torques(to, property))
            .prop_map(|(from, to, property, value)| Message {
                from,
                to,
                body: Body::Set { property, value }
            }),
        (node(), -0x20_0000i32..0x20_0000).prop_map(|(from, counts)| Message {
            from,
            to: Destination::Group(Group::POSITIONS),
            body: Body::Position(counts)
        }),
        (node(), torque_group, prop::collection::vec(-8191i16..=8191, 1..=4)).prop_map(
            |(from, to, torques)| {
                Message { from, to, body: Body::Torques(Torques::new(&torques).expect("one to four")) }
            }
        ),
        (node(), any::<u8>(), 0u32..1 << 24).prop_map(|(from, frames, received)| Message {
            from,
            to: Destination::Node(Node::HOST),
            body: Body::More { frames, received }
        }),
    ]
}

proptest! {
    #[test]
    fn parse_of_frame_is_identity(message in message()) {
        let frame = message.frame();
        prop_assert_eq!(Message::parse(&frame), Some(message), "{:?}", frame);
    }

    #[test]
    fn any_frame_that_parses_emits_the_same_bytes(
        id in 0u16..0x800, data in prop::collection::vec(any::<u8>(), 0..=8)
    ) {
        let frame = Frame::from_raw(id, &data).expect("a frame");
        if let Some(message) = Message::parse(&frame) {
            prop_assert_eq!(Message::parse(&message.frame()), Some(message));
        }
    }
}

#[test]
fn answer_beyond_its_row_has_no_value() {
    let node = Node::new(4).expect("a node");
    let set = |property: Property, value| Message {
        from: node,
        to: Destination::Group(Group::REPLIES),
        body: Body::Set { property: property.id(), value },
    };
    let read = |property, value| set(property, value).answered();
    // KP 120 with a digit too many is −32729, DP in 16 bits has lost four digits, KP in 32 bits has got four.
    for (property, value, expected) in [
        (Property::KP, Value::Short(120), Some(120)),
        (Property::KP, Value::Short(0x8027), None),
        (Property::KP, Value::Long(120), None),
        (Property::DP, Value::Short(120), None),
        (Property::DP, Value::Long(120), Some(120)),
        (Property::OTEMP, Value::Short(150), None),
        (Property::TSTOP, Value::Long(65535), Some(65535)),
        (Property::TSTOP, Value::Long(65536), None),
        (Property::P, Value::Long(5), None),
        (Property::VERS, Value::Short(601), Some(601)),
        (Property::ID, Value::Short(0), Some(0)),
        (Property::ID, Value::Short(32), None),
    ] {
        assert_eq!(read(property, value), Some((node, property, expected)), "{property:?} {value:?}");
    }
    let position =
        Message { from: node, to: Destination::Group(Group::POSITIONS), body: Body::Position(-40_000) };
    assert_eq!(position.answered(), Some((node, Property::P, Some(-40_000))));
    // A host's SET, and the answer to another board, are none.
    let order = Message::set(Destination::Node(node), Property::KP, 120).expect("it fits");
    assert_eq!(order.answered(), None);
    let host = Message { to: Destination::Node(node), ..set(Property::KP, Value::Short(120)) };
    assert_eq!(host.answered(), None);
}
