//! Every property on each of the seven nodes, alone and on an arm, by frames alone. A refused frame changes nothing and is not answered.

use tater_wire::property::{Access, PropertySpec, ROWS, Stored};
use tater_wire::{Body, Destination, Group, MotorKind, Node, Property, Value};

use super::board::{Bench, SERIAL};

fn all(bench: &mut Bench) -> Vec<Option<i64>> {
    ROWS.iter().map(|row| bench.get(row.property)).collect()
}

/// A hand alone, and beside an arm.
fn nodes() -> impl Iterator<Item = (u8, Bench)> {
    (1..=7).chain(11..=17).map(|number| (number, Bench::new(number)))
}

/// The groups of both, and their members.
const GROUPS: [(Group, &[u8]); 5] = [
    (Group::ALL, &[1, 2, 3, 4, 5, 6, 7, 11, 12, 13, 14, 15, 16, 17]),
    (Group::LOW, &[1, 2, 3, 4]),
    (Group::HIGH, &[5, 6, 7]),
    (Group::TATERS, &[1, 2, 3, 4, 5, 6, 7]),
    (Group::HAND, &[11, 12, 13, 14, 15, 16, 17]),
];

/// Encodings of a value in two bytes and in four. A property that is never negative and needs all bits is unsigned.
fn widths(row: &PropertySpec, value: i64) -> Vec<Value> {
    let signed_max = if row.bits == 16 { i64::from(i16::MAX) } else { i64::from(i32::MAX) };
    let (short, long) = if row.min >= 0 && row.max > signed_max {
        (u16::try_from(value).ok(), u32::try_from(value).ok())
    } else {
        (i16::try_from(value).ok().map(i16::cast_unsigned), i32::try_from(value).ok().map(i32::cast_unsigned))
    };
    short.map(Value::Short).into_iter().chain(long.map(Value::Long)).collect()
}

fn set(bench: &mut Bench, row: &PropertySpec, value: Value) -> bool {
    if row.access == Access::Locked {
        bench.unlock();
    }
    let body = Body::Set { property: row.property.id(), value };
    let taken = bench.say(bench.own(), 0, body).is_ok();
    assert_eq!(bench.said(), [], "{} := {value:?} is answered", row.name);
    taken
}

fn kind(number: u8) -> MotorKind {
    MotorKind::of(Node::new(number).expect("a node"))
}

/// Smallest and largest value that a node takes: goals end at its joint.
fn range(row: &PropertySpec, number: u8) -> [i64; 2] {
    match row.property {
        Property::E | Property::P | Property::CT | Property::OT | Property::DP => {
            kind(number).goals().map(i64::from)
        }
        Property::IOFF => [i32::MIN, i32::MAX].map(|value| kind(number).bounded(row.property, value).into()),
        _ => [row.min, row.max],
    }
}

fn holds(row: &PropertySpec) -> bool {
    let steers =
        matches!(row.property, Property::STAT | Property::MODE | Property::T | Property::V | Property::FIND);
    // What they are written as is kept in MKE, MKA and MTE, to a step of those.
    let views = matches!(row.property, Property::MKT | Property::MJ | Property::ML);
    matches!(row.access, Access::ReadWrite | Access::Locked) && !steers && !views
}

/// What describes the motor together: a value of one reads differently after another.
fn follows(changed: Property, other: Property) -> bool {
    use Property as P;
    match changed {
        P::MR | P::MPK | P::POLES => {
            matches!(other, P::MKE | P::MKA | P::MTE | P::MKT | P::MJ | P::ML | P::IPNM | P::CTS | P::FIT)
        }
        P::MKE | P::MKA | P::MTE => matches!(other, P::MKT | P::MJ | P::ML | P::IPNM | P::FIT),
        _ => other == P::FIT,
    }
}

#[test]
fn property_reads_its_default_in_its_width() {
    for (number, mut bench) in nodes() {
        let node = Node::new(number).expect("a node");
        for row in ROWS {
            let found = bench.get(row.property);
            let default = match row.property {
                // In the monitor it would be 0.
                Property::STAT => Some(2),
                // Stored as the board is shipped.
                Property::WIRING => Some(2),
                // The chip's number, until one is stored.
                Property::SN => Some(i64::from(SERIAL)),
                _ => row.default_for(node),
            };
            assert!(found.is_some(), "{} of node {number}: a host waits", row.name);
            if row.access == Access::WriteOnly {
                assert_eq!(found, Some(0), "{} of node {number}", row.name);
                continue;
            }
            if let (Some(found), Some(default)) = (found, default) {
                assert_eq!(found, default, "{} of node {number}", row.name);
            }
            if let Some(found) = found {
                assert!(row.admits(found), "{} of node {number}: {found}", row.name);
            }
        }
    }
}

#[test]
fn property_accepts_both_ends_of_its_range_in_either_width() {
    for (number, mut bench) in nodes() {
        for row in ROWS.iter().filter(|row| holds(row)) {
            let [min, max] = range(row, number);
            for value in [min, max, min + 1, max - 1, min.midpoint(max)] {
                if !row.admits(value) {
                    continue;
                }
                for wire in widths(row, value) {
                    assert!(set(&mut bench, row, wire), "{} := {wire:?} on node {number}", row.name);
                    assert_eq!(bench.get(row.property), Some(value), "{} := {wire:?}", row.name);
                }
            }
        }
    }
}

#[test]
fn out_of_range_value_is_refused() {
    for (number, mut bench) in nodes() {
        let mut before = all(&mut bench);
        for row in ROWS {
            let goals = kind(number).goals().map(i64::from);
            let beyond_the_joint = [goals[0] - 1, goals[1] + 1];
            let is_goal = matches!(row.property, Property::E | Property::P | Property::M);
            for value in [row.min - 1, row.max + 1, i64::from(i32::MIN), i64::from(i32::MAX)]
                .into_iter()
                .chain(beyond_the_joint)
            {
                if row.admits(value) && !(is_goal && beyond_the_joint.contains(&value)) {
                    continue;
                }
                for wire in widths(row, value) {
                    assert!(!set(&mut bench, row, wire), "{} := {wire:?} on node {number}", row.name);
                }
            }
            if row.property == Property::M {
                // A refused order to move has END 3.
                let end = ROWS.iter().position(|row| row.property == Property::END).expect("a row");
                assert_eq!(before[end].replace(3), Some(0));
            }
            assert_eq!(all(&mut bench), before, "{} on node {number}", row.name);
        }
        assert!(bench.board().resets.is_empty());
    }
}

#[test]
fn read_only_or_locked_property_is_refused_in_range() {
    for (number, mut bench) in nodes() {
        let before = all(&mut bench);
        for row in ROWS.iter().filter(|row| matches!(row.access, Access::ReadOnly | Access::Locked)) {
            for value in [row.min, row.max] {
                for wire in widths(row, value) {
                    let body = Body::Set { property: row.property.id(), value: wire };
                    assert!(bench.say(bench.own(), 0, body).is_err(), "{} on node {number}", row.name);
                    assert_eq!(bench.said(), []);
                }
            }
            assert_eq!(all(&mut bench), before, "{} on node {number}", row.name);
        }
    }
}

#[test]
fn set_changes_only_its_property_and_dependents() {
    for (number, mut bench) in nodes() {
        // In other units every value reads differently.
        for row in ROWS.iter().filter(|row| holds(row) && row.property != Property::HOSTUNITS) {
            let before = all(&mut bench);
            let [min, max] = range(row, number);
            let value = if bench.get(row.property) == Some(max) { min } else { max };
            let wire = row.property.write(value).expect("fits 32 bits");
            assert!(set(&mut bench, row, wire));
            for (other, (before, after)) in ROWS.iter().zip(before.into_iter().zip(all(&mut bench))) {
                assert!(
                    other.property == row.property
                        || before == after
                        || follows(row.property, other.property),
                    "{} changes {} on node {number}",
                    row.name,
                    other.name
                );
            }
            // Leave the groups, and exceed the limit of 0 K, before continuing.
            bench = Bench::new(number);
        }
    }
}

#[test]
fn commands_read_back_in_their_mode() {
    for (_, mut bench) in nodes() {
        for (property, mode) in [(Property::V, 4), (Property::T, 2)] {
            let row = property.row();
            bench.set(Property::MT, 990).expect("in range");
            bench.set(Property::MODE, mode).expect("a mode");
            for value in [row.min, row.max, -1, 0, 1] {
                for wire in widths(row, value) {
                    assert!(set(&mut bench, row, wire), "{} := {wire:?}", row.name);
                    assert_eq!(bench.get(property), Some(value), "{}", row.name);
                }
            }
        }
        for mode in [0, 2, 3, 4, 5] {
            assert!(set(&mut bench, Property::MODE.row(), Value::Long(mode)));
            assert_eq!(bench.get(Property::MODE), Some(i64::from(mode)));
        }
    }
}

#[test]
fn sixteen_bit_values_have_the_sign_of_their_row() {
    let mut bench = Bench::new(1);
    for (property, meant) in [
        (Property::TSTOP, 65_535),
        (Property::ACCEL, 65_535),
        (Property::X0, -1),
        (Property::E, -1),
        (Property::DP, -1),
    ] {
        assert!(set(&mut bench, property.row(), Value::Short(0xFFFF)));
        // `get` expects six bytes for what does not fit a signed short.
        assert_eq!(bench.get(property), Some(meant), "{property:?}");
    }
    // In four bytes −1 and 65535 are different values.
    assert!(!set(&mut bench, Property::MPE.row(), Value::Long(0xFFFF_FFFF)));
    assert!(!set(&mut bench, Property::X0.row(), Value::Long(0xFFFF)));
}

#[test]
fn get_to_a_group_is_answered_once_by_each_member() {
    for (group, expected) in GROUPS {
        for property in [Property::STAT, Property::P] {
            let mut answers = Vec::new();
            for (_, mut bench) in nodes() {
                bench.say(Destination::Group(group), 0, Body::Get(property.id())).expect("heard or skipped");
                answers.append(&mut bench.board().sent);
            }
            let senders: Vec<u8> = answers.iter().map(|frame| frame.id().from.number()).collect();
            assert_eq!(senders, expected, "{property:?} of {group:?}");
        }
    }
}

#[test]
fn set_to_a_group_reaches_its_members() {
    for (group, members) in GROUPS {
        for (number, mut bench) in nodes() {
            for row in ROWS.iter().filter(|row| row.stored == Stored::Yes && row.access == Access::ReadWrite)
            {
                let before = bench.get(row.property);
                let [min, max] = range(row, number);
                let value = if before == Some(min) { max } else { min };
                let wire = row.property.write(value).expect("fits 32 bits");
                let body = Body::Set { property: row.property.id(), value: wire };
                bench.say(Destination::Group(group), 0, body).expect("obeyed or skipped");
                let expected = if members.contains(&number) { Some(value) } else { before };
                assert_eq!(bench.get(row.property), expected, "{} of node {number} by {group:?}", row.name);
                // Restored, so that the node stays a member.
                bench.set(row.property, before.expect("can be read")).expect("in range");
                assert_eq!(bench.said(), []);
            }
        }
    }
}
