//! The examples of docs/wire.md.

use tater_wire::{Body, Cmd, Destination, Frame, Group, Message, Node, Property, Torques};

/// The frames of the page: lines that begin with three hexadecimal digits and bytes.
fn examples(page: &str) -> Vec<Frame> {
    page.lines()
        .filter_map(|line| {
            let (id, rest) = line.split_at_checked(3)?;
            let bytes = rest.strip_prefix("  ")?.split("  ").next()?.split(' ');
            let bytes: Option<Vec<u8>> = bytes.map(|byte| u8::from_str_radix(byte, 16).ok()).collect();
            Frame::from_raw(u16::from_str_radix(id, 16).ok()?, &bytes?)
        })
        .collect()
}

#[test]
fn examples_of_the_page_are_the_frames_of_their_messages() {
    let node = Node::new(4).expect("a node");
    let to = Destination::Node(node);
    let all = Destination::Group(Group::TATERS);
    let set = |to, property, value| Message::set(to, property, value).expect("it fits").frame();
    let short = |property: Property, value: u8| {
        Frame::new(Message::get(to, property).frame().id(), &[0x80 | property.id(), 0, value, 0])
            .expect("4 bytes")
    };
    let torques = Body::Torques(Torques::new(&[100, -100]).expect("two"));
    let expected = [
        set(to, Property::STAT, 2),
        set(to, Property::CMD, Cmd::Hi.into()),
        short(Property::M, 160),
        Message::get(to, Property::P).frame(),
        Message::reply(node, Property::P, 160).expect("it fits").frame(),
        Message::get(to, Property::MODE).frame(),
        Message::reply(node, Property::MODE, 5).expect("it fits").frame(),
        set(all, Property::V, 0),
        Message { from: Node::HOST, to: Destination::Group(Group::LOW), body: torques }.frame(),
    ];
    let found = examples(include_str!("../../docs/wire.md"));
    assert_eq!(found, expected);
    assert!(found.iter().all(|frame| Message::parse(frame).is_some()));
}
