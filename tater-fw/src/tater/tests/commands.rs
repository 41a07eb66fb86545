//! CMD, groups, packed torques, and the destinations of answers.

use super::board::{Bench, FakeBoard};
use crate::SetError;
use servo_core::mode::Mode;
use servo_core::units::Torque;
use servo_core::{EndReason, Refusal};
use std::vec::Vec;
use tater_wire::property::Access;
use tater_wire::{Body, Destination, Group, Node, Property, Torques, Value, command};

fn group(number: u8) -> Destination {
    Destination::Group(Group::new(number).expect("a group"))
}

fn node(number: u8) -> Node {
    Node::new(number).expect("a node")
}

fn cmd(bench: &mut Bench, number: i64) -> Result<(), SetError> {
    bench.set(Property::CMD, number)
}

#[test]
fn move_commands_go_to_their_property() {
    let mut bench = Bench::new(2);
    let set = |bench: &mut Bench, property, value| bench.set(property, value).expect("in range");
    set(&mut bench, Property::P, 100);
    set(&mut bench, Property::OT, -7);
    bench.tick();
    for (number, end) in [(7, 0), (14, 100 + 25), (15, 100 - 25), (18, 331), (19, 155), (20, -7)] {
        cmd(&mut bench, number).expect("moves");
        assert_eq!((bench.get(Property::E), bench.get(Property::MODE)), (Some(end), Some(5)), "CMD {number}");
        cmd(&mut bench, 21).expect("T");
        assert_eq!(bench.get(Property::MODE), Some(0));
    }
    // From the present position, also during a move.
    cmd(&mut bench, 14).expect("IC");
    bench.ticks(10);
    let count = bench.count;
    bench.tick_to(count + 6);
    cmd(&mut bench, 14).expect("IC");
    assert_eq!(bench.get(Property::E), Some(106 + 25));
}

#[test]
fn tc_to_and_hi_are_mode_4() {
    for (number, velocity) in [(16, 1000), (17, -1000), (13, -200)] {
        let mut bench = Bench::new(1);
        cmd(&mut bench, number).expect("moves");
        bench.tick();
        assert_eq!(bench.get(Property::MODE), Some(4), "CMD {number}");
        assert_eq!(bench.get(Property::V), Some(velocity), "CMD {number}");
    }
}

#[test]
fn cmd_without_a_row_is_refused() {
    for number in -1..=22 {
        let mut bench = Bench::new(3);
        let known = command::ROWS.iter().any(|row| i64::from(row.number) == number);
        let answer = cmd(&mut bench, number);
        assert_eq!(answer, if known { Ok(()) } else { Err(SetError::Range(Property::CMD)) }, "CMD {number}");
        let resets = bench.board().resets.len();
        assert_eq!(resets, usize::from(number == 2), "CMD {number}");
    }
}

#[test]
fn breakaway_flag_lasts_until_o_or_hi_and_its_position_for_good() {
    for (number, cleared) in [(20, true), (13, true), (19, false), (21, false)] {
        let mut bench = Bench::new(1);
        bench.set(Property::P, 40).expect("idle");
        cmd(&mut bench, 18).expect("C");
        bench.ticks(200);
        assert_eq!(bench.tater.status().end, Some(EndReason::Breakaway));
        assert_eq!((bench.get(Property::BD), bench.get(Property::BP)), (Some(1), Some(40)));
        assert_eq!(bench.get(Property::END), Some(5));
        cmd(&mut bench, number).expect("taken");
        assert_eq!(bench.get(Property::BD), Some(i64::from(!cleared)), "CMD {number}");
        assert_eq!(bench.get(Property::BP), Some(40), "CMD {number}");
    }
}

#[test]
fn groups_reach_their_members_and_reply_groups_nobody() {
    for (number, low, high) in [(0, true, true), (1, true, false), (2, false, true), (3, false, false)]
        .into_iter()
        .chain([(4, true, true), (5, false, false), (6, false, false), (31, false, false)])
    {
        for (straps, heard) in [(1, low), (4, low), (5, high), (7, high)] {
            let mut bench = Bench::new(straps);
            let x0 = |value| Body::Set { property: Property::X0.id(), value: Value::Short(value) };
            assert_eq!(bench.say(group(number), 0, x0(9)), Ok(()));
            assert_eq!(
                bench.get(Property::X0),
                Some(if heard { 9 } else { 0 }),
                "group {number}, node {straps}"
            );
            bench.say(group(number), 0, Body::Get(Property::X0.id())).expect("heard or skipped");
            assert_eq!(bench.said().len(), usize::from(heard), "group {number}, node {straps}");
        }
    }
    let mut bench = Bench::new(1);
    for (property, number) in [(Property::GRPA, 9), (Property::GRPB, 3), (Property::GRPC, 6)] {
        bench.set(property, number).expect("a group");
        let number = u8::try_from(number).expect("a group");
        bench.say(group(number), 0, Body::Get(Property::STAT.id())).expect("heard or skipped");
        // A reply of another board is no order, even to a board that has joined the host's groups.
        assert_eq!(bench.said().len(), usize::from(number == 9), "group {number}");
    }
    bench.say(group(1), 0, Body::Get(Property::STAT.id())).expect("skipped");
    assert!(bench.said().is_empty());
}

#[test]
fn frames_for_others_are_skipped() {
    let mut bench = Bench::new(3);
    for number in (0..32).filter(|&number| number != 3) {
        let to = Destination::Node(node(number));
        assert_eq!(bench.say(to, 0, Body::Get(Property::STAT.id())), Ok(()));
        assert_eq!(bench.say(to, 0, Body::Set { property: 34, value: Value::Short(1) }), Ok(()));
    }
    assert!(bench.said().is_empty());
    assert_eq!(bench.get(Property::X0), Some(0));
}

#[test]
fn get_by_another_board_is_answered_by_set_of_value() {
    let mut bench = Bench::new(3);
    bench.set(Property::P, -2).expect("idle");
    let ask = |bench: &mut Bench, to, property: Property| {
        bench.say(to, 5, Body::Get(property.id())).expect("answered");
        let said = bench.said();
        assert_eq!(said.len(), 1);
        (said[0].from, said[0].to, said[0].body)
    };
    let value = |value| (node(3), Destination::Node(node(5)), Body::Set { property: 7, value });
    let own = bench.own();
    assert_eq!(ask(&mut bench, own, Property::MT), value(Value::Short(750)));
    assert_eq!(ask(&mut bench, group(4), Property::CT), value(Value::Long(331)));
    assert_eq!(ask(&mut bench, own, Property::P), value(Value::Long(0xFFFF_FFFE)));
    let to_value = Body::Set { property: 7, value: Value::Short(1) };
    assert_eq!(bench.say(own, 5, to_value), Err(SetError::Unknown));
}

#[test]
fn packed_torque_is_taken_from_the_own_slot_in_mode_2() {
    for (straps, to, slot) in [(1, 1, 1), (2, 1, 2), (4, 1, 4), (5, 2, 1), (7, 2, 3)] {
        let mut bench = Bench::new(straps);
        let torques = Torques::new(&[11, -22, 33, -44]).expect("four");
        let packed = Body::Torques(torques);
        let refused = Err(SetError::Servo(Refusal::Mode(Mode::Idle)));
        assert_eq!(bench.say(group(to), 0, packed), refused, "not in mode 2");
        bench.set(Property::MODE, 2).expect("mode 2");
        assert_eq!(bench.say(group(to), 0, packed), Ok(()));
        bench.ticks(40);
        assert_eq!(bench.get(Property::T), torques.slot(slot).map(i64::from), "node {straps}");
        bench.say(group(3 - to), 0, Body::Torques(Torques::new(&[500; 4]).expect("four"))).expect("skipped");
        bench.tick();
        assert_eq!(bench.get(Property::T), torques.slot(slot).map(i64::from), "node {straps}");
        // A frame without its slot has no effect.
        let short = Torques::new(&[500; 4][..usize::from(slot) - 1]);
        if let Some(short) = short {
            assert_eq!(bench.say(group(to), 0, Body::Torques(short)), Err(SetError::Range(Property::T)));
        }
    }
}

#[test]
fn packed_torque_saturates_at_mt_and_pidx_can_be_set() {
    let mut bench = Bench::new(1);
    bench.set(Property::MT, 300).expect("in range");
    bench.set(Property::PIDX, 3).expect("in range");
    bench.set(Property::MODE, 2).expect("mode 2");
    for (torque, taken) in [(8191, 300), (-8191, -300), (301, 300), (-299, -299)] {
        bench.say(group(1), 0, Body::Torques(Torques::new(&[7, 7, torque]).expect("three"))).expect("taken");
        bench.tick();
        assert_eq!(bench.tater.servo.torque(), Torque(taken));
        assert_eq!(bench.set(Property::T, 991), Err(SetError::Range(Property::T)));
        assert_eq!(bench.tater.servo.torque(), Torque(taken));
    }
}

#[test]
fn board_without_node_obeys_groups_and_sends_nothing() {
    let mut bench = Bench::on(FakeBoard::new(0), 0);
    bench.say(group(0), 0, Body::Get(Property::STAT.id())).expect("heard");
    bench.say(Destination::Node(Node::HOST), 5, Body::Get(Property::STAT.id())).expect("skipped");
    assert!(bench.said().is_empty());
    // Node 0 is the host's.
    let x0 = Body::Set { property: Property::X0.id(), value: Value::Short(1) };
    bench.say(Destination::Node(Node::HOST), 5, x0).expect("skipped");
    assert_eq!(bench.tater.read(Property::X0), Some(0));
    let set = |bench: &mut Bench, property: Property, value| {
        let value = property.write(value).expect("fits");
        bench.say(group(0), 0, Body::Set { property: property.id(), value })
    };
    for key in [18384, 23, 3145, 1024, 1] {
        set(&mut bench, Property::LOCK, key).expect("a key");
    }
    set(&mut bench, Property::ID, 6).expect("unlocked");
    set(&mut bench, Property::SAVE, 3).expect("saved");
    assert_eq!(bench.tater.node(), Node::HOST, "from the next start on");
    bench.settle();
    let mut bench = bench.restart();
    assert_eq!((bench.tater.node(), bench.get(Property::ID)), (node(6), Some(6)));
    assert_eq!(bench.get(Property::IOFF), Some(-350), "a tip's defaults");
}

#[test]
fn save_all_gives_no_node_to_a_board_without_one() {
    let mut bench = Bench::new(0);
    let all = Body::Set { property: Property::SAVE.id(), value: Value::Short(0xFFFF) };
    bench.say(group(0), 0, all).expect("saved");
    bench.settle();
    assert_eq!(bench.restart().tater.node(), Node::HOST);
}

#[test]
fn meaningless_frames_change_nothing() {
    let mut bench = Bench::new(4);
    let own = bench.own();
    let bodies = [
        Body::Get(109 + 4),
        Body::Set { property: 109 + 4, value: Value::Short(1) },
        Body::Set { property: 6, value: Value::Long(0x2000_0000) },
        Body::Set { property: 12, value: Value::Short(1) },
    ];
    let refused: Vec<_> = bodies.into_iter().map(|body| bench.say(own, 0, body)).collect();
    assert_eq!(refused, [Err(SetError::Unknown); 4]);
    assert!(bench.said().is_empty());
}

/// A host of Barrett's waits for each answer without a time limit (btutil: IKP, VALUE): every number of its table has one.
#[test]
fn get_of_every_number_of_barretts_table_is_answered() {
    let wide =
        |id: u8| Property::of(id).map_or([96, 98].contains(&id), |property| property.rules().bits == 32);
    for straps in (1..=7).chain(11..=17) {
        let mut bench = Bench::new(straps);
        bench.tick();
        for id in 0..=127 {
            let own = bench.own();
            let result = bench.say(own, 0, Body::Get(id));
            let said = bench.said();
            let known = Property::of(id);
            if id >= 109 && known.is_none() {
                assert_eq!((result, said.len()), (Err(SetError::Unknown), 0), "{id}");
                continue;
            }
            assert_eq!((result, said.len()), (Ok(()), 1), "{id}");
            if known == Some(Property::P) {
                continue;
            }
            let Body::Set { property, value } = said[0].body else { panic!("{id}: {said:?}") };
            let long = matches!(value, Value::Long(_));
            assert!(property == id && (long == wide(id) || known.is_some()), "{id}: {value:?}");
            if known.is_none_or(|known| known.rules().access == Access::WriteOnly) {
                assert!(matches!(value, Value::Short(0) | Value::Long(0)), "{id}: {value:?}");
            }
        }
    }
}

/// A board without a node number cannot be stopped over the bus either: it never moves, but receives.
#[test]
fn board_without_node_does_not_move() {
    let mut bench = Bench::new(0);
    let all = group(0);
    let steers = [
        (Property::M, 200),
        (Property::MODE, 2),
        (Property::MODE, 3),
        (Property::MODE, 4),
        (Property::MODE, 5),
        (Property::CMD, 13),
        (Property::CMD, 16),
        (Property::CMD, 18),
    ];
    for (property, value) in steers {
        let value = property.write(value).expect("fits 32 bits");
        let body = Body::Set { property: property.id(), value };
        assert_eq!(bench.say(all, 0, body), Err(SetError::Unnamed), "{body:?}");
        bench.ticks(3);
        assert_eq!((bench.tater.drive().duty, bench.tater.status().mode), (None, Mode::Idle));
    }
    for property in [Property::MODE, Property::E, Property::V] {
        let value = property.write(0).expect("fits 32 bits");
        assert_eq!(bench.say(all, 0, Body::Set { property: property.id(), value }), Ok(()));
    }
}

const LINK_GOALS: [i64; 2] = [-33, 346];

#[test]
fn goals_end_at_the_joints_range_and_a_margin() {
    for (straps, [low, high]) in [(1, LINK_GOALS), (4, [-8, 174]), (6, [-166, 358])] {
        let mut bench = Bench::new(straps);
        for property in [Property::E, Property::P] {
            for good in [low, high] {
                assert_eq!(bench.set(property, good), Ok(()), "{property:?} {good}");
                assert_eq!(bench.get(property), Some(good));
            }
            for bad in [low - 1, high + 1, 3995, -32_767, 32_768, 81_487] {
                assert_eq!(bench.set(property, bad), Err(SetError::Range(property)), "{property:?} {bad}");
                assert_eq!(bench.get(property), Some(high), "{property:?} {bad}");
            }
        }
    }
}

#[test]
fn mode_5_is_refused_after_a_refused_goal_until_a_good_one() {
    for bad in [Property::E, Property::M, Property::P] {
        for good in [Property::E, Property::P, Property::CMD] {
            let mut bench = Bench::new(1);
            bench.set(Property::E, 100).expect("in range");
            assert_eq!(bench.set(bad, 81_487), Err(SetError::Range(bad)));
            let aborted = if bad == Property::M { 3 } else { 0 };
            assert_eq!(bench.get(Property::END), Some(aborted), "an order to move sets END");
            assert_eq!(bench.set(Property::MODE, 5), Err(SetError::Range(Property::E)));
            assert_eq!((bench.get(Property::MODE), bench.get(Property::END)), (Some(0), Some(3)));
            bench.set(good, if good == Property::CMD { command::Cmd::C.into() } else { 50 }).expect("good");
            bench.set(Property::MODE, 5).expect("moves");
            assert_eq!((bench.get(Property::MODE), bench.get(Property::END)), (Some(5), Some(0)));
        }
    }
}

#[test]
fn mode_5_after_a_refused_goal_names_a_latched_fault() {
    let mut bench = Bench::new(1);
    bench.set(Property::E, 9999).expect_err("beyond the joint");
    bench.tater.bridge_fault();
    bench.tick();
    bench.set(Property::MODE, 5).expect_err("refused");
    assert_eq!(bench.get(Property::END), Some(6));
}

/// What is stored moves to the bound instead: btutil leaves CT 750.
#[test]
fn stored_targets_are_moved_to_the_goals() {
    let mut bench = Bench::new(1);
    for (property, value, taken) in [
        (Property::CT, 750, 346),
        (Property::OT, -32_767, -33),
        (Property::DP, 347, 346),
        (Property::IOFF, 32_767, 371),
        (Property::IOFF, -372, -371),
        (Property::DS, 32_767, 32_767),
    ] {
        assert_eq!(bench.set(property, value), Ok(()));
        assert_eq!(bench.get(property), Some(taken), "{property:?} {value}");
    }
    assert_eq!(bench.set(Property::CT, 195_000), Err(SetError::Range(Property::CT)), "beyond the row");
    cmd(&mut bench, 18).expect("C");
    assert_eq!(bench.get(Property::E), Some(346));
}

#[test]
fn target_that_an_older_firmware_has_stored_is_moved_to_the_goals() {
    let mut board = FakeBoard::new(4);
    let mut store = boot::storage::Store::open(&board.flash);
    store.set(Property::CT, 750);
    while store.step(&mut board.flash, true) != boot::storage::Progress::Done {}
    let mut bench = Bench::on(board, 0);
    assert_eq!(bench.get(Property::CT), Some(174));
    bench.set(Property::CT, 20).expect("in range");
    bench.set(Property::LOAD, Property::CT.id().into()).expect("stored");
    assert_eq!(bench.get(Property::CT), Some(174));
}

#[test]
fn step_ends_at_the_goals_and_never_turns_back() {
    let mut bench = Bench::new(1);
    bench.set(Property::P, 340).expect("in range");
    bench.tick();
    cmd(&mut bench, 14).expect("IC");
    assert_eq!(bench.get(Property::E), Some(346));
    cmd(&mut bench, 21).expect("T");
    // A joint without a known zero may stand anywhere.
    bench.set(Property::P, -33).expect("in range");
    let count = bench.count;
    for step in 1..=40 {
        bench.tick_to(count - step);
    }
    assert_eq!(bench.get(Property::P), Some(-73));
    cmd(&mut bench, 15).expect("IO");
    assert_eq!(bench.get(Property::E), Some(-73), "not outwards, and not back to -33");
    cmd(&mut bench, 14).expect("IC");
    assert_eq!(bench.get(Property::E), Some(-73 + 25));
}
