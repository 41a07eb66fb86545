//! Nonvolatile values, and the watchdog.

use super::board::{Bench, SERIAL};
use crate::SetError;
use servo_core::Refusal;
use servo_core::mode::Mode;
use servo_core::units::{DeciCelsius, Micros};
use tater_wire::{Body, Destination, FaultCode, Group, MotorKind, Node, Property};

fn id(property: Property) -> i64 {
    i64::from(property.id())
}

fn set(bench: &mut Bench, property: Property, value: i64) {
    bench.set(property, value).expect("taken");
}

/// A homed board whose position has been saved, powered up again.
fn saved(straps: u8) -> Bench {
    let mut bench = Bench::new(straps);
    bench.home();
    set(&mut bench, Property::SAVE, id(Property::P));
    bench.settle();
    bench.restart()
}

#[test]
fn save_load_and_def_of_one() {
    let rows =
        [(Property::MT, 500, 750), (Property::CT, -22, 331), (Property::HOLD, 1, 0), (Property::X5, -1, 0)];
    for (property, value, default) in rows {
        let mut bench = Bench::new(1);
        set(&mut bench, property, value);
        set(&mut bench, Property::SAVE, id(property));
        set(&mut bench, property, default);
        set(&mut bench, Property::LOAD, id(property));
        assert_eq!(bench.get(property), Some(value), "{property:?}");
        set(&mut bench, property, default);
        bench.settle();
        let mut bench = bench.restart();
        assert_eq!(bench.get(property), Some(value), "{property:?}");
        set(&mut bench, Property::DEF, id(property));
        assert_eq!(bench.get(property), Some(default), "{property:?}");
        set(&mut bench, property, value);
        set(&mut bench, Property::LOAD, id(property));
        assert_eq!(bench.get(property), Some(default), "{property:?}: DEF resets the stored copy too");
        bench.settle();
        assert_eq!(bench.restart().get(property), Some(default), "{property:?}");
    }
}

#[test]
fn save_load_and_def_of_all_by_property_and_by_command() {
    for by_cmd in [false, true] {
        let act = |bench: &mut Bench, property, number| {
            let (property, value) = if by_cmd { (Property::CMD, number) } else { (property, -1) };
            set(bench, property, value);
        };
        let mut bench = Bench::new(6);
        for (property, value) in [(Property::KP, 61), (Property::GRPA, 9), (Property::TSTOP, 65_535)] {
            set(&mut bench, property, value);
        }
        act(&mut bench, Property::SAVE, 1);
        bench.settle();
        let mut bench = bench.restart();
        let read = |bench: &mut Bench| [Property::KP, Property::GRPA, Property::TSTOP].map(|p| bench.get(p));
        assert_eq!(read(&mut bench), [Some(61), Some(9), Some(65_535)]);
        set(&mut bench, Property::KP, 1);
        act(&mut bench, Property::LOAD, 0);
        assert_eq!(read(&mut bench), [Some(61), Some(9), Some(65_535)]);
        act(&mut bench, Property::DEF, 3);
        assert_eq!(read(&mut bench), [Some(120), Some(0), Some(300)]);
        bench.settle();
        assert_eq!(read(&mut bench.restart()), [Some(120), Some(0), Some(300)]);
    }
}

#[test]
fn changed_groups_update_the_can_filters() {
    let told = |bench: &mut Bench| {
        let listened = std::mem::take(&mut bench.board().listened);
        let node = bench.tater.node();
        listened.last().map(|&(to, groups)| {
            assert_eq!(to, node);
            groups.map(|group| group.map(Group::number))
        })
    };
    let mut bench = Bench::new(6);
    assert_eq!(told(&mut bench), Some([Some(0), Some(2), Some(4)]));
    set(&mut bench, Property::GRPA, 9);
    assert_eq!(told(&mut bench), Some([Some(9), Some(2), Some(4)]));
    set(&mut bench, Property::GRPB, 3);
    assert_eq!(told(&mut bench), Some([Some(9), None, Some(4)]), "positions are for the host");
    set(&mut bench, Property::GRPC, 6);
    assert_eq!(told(&mut bench), Some([Some(9), None, None]), "so are replies");
    set(&mut bench, Property::SAVE, id(Property::GRPA));
    set(&mut bench, Property::X0, 9);
    assert_eq!(told(&mut bench), None, "nothing has changed");
    set(&mut bench, Property::LOAD, id(Property::GRPC));
    assert_eq!(told(&mut bench), Some([Some(9), None, Some(4)]));
    set(&mut bench, Property::LOAD, -1);
    assert_eq!(told(&mut bench), Some([Some(9), Some(2), Some(4)]));
    set(&mut bench, Property::DEF, id(Property::GRPA));
    assert_eq!(told(&mut bench), Some([Some(0), Some(2), Some(4)]));
    set(&mut bench, Property::GRPB, 30);
    set(&mut bench, Property::DEF, -1);
    assert_eq!(told(&mut bench), Some([Some(0), Some(2), Some(4)]));
    assert_eq!(told(&mut Bench::new(0)), Some([Some(0), Some(1), Some(4)]), "nobody has named it");
}

#[test]
fn unstored_property_cannot_be_saved_loaded_or_reset() {
    let mut bench = Bench::new(1);
    for by in [Property::SAVE, Property::LOAD, Property::DEF] {
        for property in [Property::MODE, Property::E, Property::LFLAGS, Property::VBUS, Property::CMD] {
            assert_eq!(bench.set(by, id(property)), Err(SetError::Access(property)));
        }
        for nothing in [6, 7, 12, 113] {
            assert_eq!(bench.set(by, nothing), Err(SetError::Range(by)), "{nothing}");
        }
    }
}

#[test]
fn locked_properties_are_skipped_by_all_and_need_the_sequence() {
    let mut bench = Bench::new(5);
    assert_eq!(bench.get(Property::SN), Some(i64::from(SERIAL)));
    bench.unlock();
    set(&mut bench, Property::SN, 99);
    set(&mut bench, Property::SAVE, -1);
    bench.unlock();
    set(&mut bench, Property::SN, 98);
    for by in [Property::LOAD, Property::DEF] {
        set(&mut bench, by, -1);
        assert_eq!(bench.get(Property::SN), Some(98));
        assert_eq!(bench.set(by, id(Property::SN)), Err(SetError::Access(Property::SN)));
    }
    bench.settle();
    let mut bench = bench.restart();
    assert_eq!(bench.get(Property::SN), Some(99), "DEF of all has left the stored copy too");
    bench.unlock();
    set(&mut bench, Property::DEF, id(Property::SN));
    assert_eq!(bench.get(Property::SN), Some(i64::from(SERIAL)));
    assert_eq!(bench.set(Property::DEF, id(Property::SN)), Err(SetError::Access(Property::SN)), "once");
}

/// KIND, straps and node in every combination: the kind that is stored counts, then the straps', then the node's.
#[test]
fn kind_of_motor_is_stored_or_the_straps_or_the_nodes() {
    let kinds = [None, Some(1), Some(2), Some(3)];
    for straps in [0, 1, 4, 5] {
        for node in (1..=7).chain(11..=17).chain([20]) {
            for stored in kinds {
                let mut bench = Bench::new(straps);
                let all = Destination::Group(Group::ALL);
                let mut order = |property: Property, value: i64| {
                    let value = property.write(value).expect("fits");
                    bench.say(all, 0, Body::Set { property: property.id(), value }).expect("taken");
                };
                for (property, value) in [(Property::ID, Some(i64::from(node))), (Property::KIND, stored)] {
                    let Some(value) = value else { continue };
                    for key in [18384, 23, 3145, 1024, 1] {
                        order(Property::LOCK, key);
                    }
                    order(property, value);
                    order(Property::SAVE, id(property));
                }
                bench.settle();
                let mut bench = bench.restart();
                let by = |number| i64::from(MotorKind::of(Node::new(number).expect("a node")).code());
                let kind = stored.unwrap_or(if straps == 0 { by(node) } else { by(straps) });
                let what = std::format!("straps {straps}, node {node}, KIND {stored:?}");
                assert_eq!(bench.get(Property::KIND), Some(kind), "{what}");
                let ct = [331, 169, 331][usize::try_from(kind - 1).expect("1 to 3")];
                assert_eq!(bench.get(Property::CT), Some(ct), "{what}");
                assert_eq!(bench.get(Property::HOLD), Some(i64::from(kind == 2)), "{what}");
                assert_eq!(bench.tater.config().brake_ms, if kind == 2 { 30 } else { 0 }, "{what}");
                let arm = (11..=17).contains(&node);
                assert_eq!(bench.get(Property::GRPC), Some(if arm { 5 } else { 4 }), "{what}");
                // DEF of all restores the kind's defaults and keeps KIND, which is locked; DEF of KIND forgets it.
                set(&mut bench, Property::CT, 100);
                set(&mut bench, Property::DEF, -1);
                assert_eq!(
                    (bench.get(Property::CT), bench.get(Property::KIND)),
                    (Some(ct), Some(kind)),
                    "{what}"
                );
                bench.unlock();
                set(&mut bench, Property::DEF, id(Property::KIND));
                let forgotten = if straps == 0 { by(node) } else { by(straps) };
                assert_eq!(bench.get(Property::KIND), Some(forgotten), "{what}");
                assert_eq!(bench.set(Property::KIND, 1), Err(SetError::Access(Property::KIND)), "locked");
            }
        }
    }
}

#[test]
fn new_id_takes_effect_at_the_next_start() {
    let mut bench = Bench::new(2);
    bench.unlock();
    set(&mut bench, Property::ID, 4);
    set(&mut bench, Property::SAVE, id(Property::ID));
    assert_eq!((bench.get(Property::ID), bench.tater.node().number()), (Some(4), 2));
    bench.settle();
    let mut bench = bench.restart();
    assert_eq!((bench.get(Property::ID), bench.tater.node().number()), (Some(4), 4));
    // The straps still tell the kind of motor, the node its slot.
    assert_eq!((bench.get(Property::HOLD), bench.get(Property::PIDX)), (Some(0), Some(4)));
    bench.unlock();
    set(&mut bench, Property::DEF, id(Property::ID));
    assert_eq!(bench.get(Property::ID), Some(2), "the straps'");
}

#[test]
fn saved_position_is_trusted_after_the_next_start() {
    for straps in [1, 4, 5] {
        let mut bench = Bench::new(straps);
        bench.home();
        set(&mut bench, Property::M, 7);
        bench.follow(3_000);
        set(&mut bench, Property::CMD, 21);
        bench.ticks(400);
        assert_eq!(bench.get(Property::P), Some(7));
        set(&mut bench, Property::SAVE, -1);
        bench.settle();
        let mut bench = bench.restart();
        assert_eq!((bench.get(Property::P), bench.tater.status().homed), (Some(7), true), "node {straps}");
        assert_eq!((bench.get(Property::MECH), bench.get(Property::E)), (Some(7), Some(0)));
        bench.ticks(100);
        assert!(bench.restart().tater.status().homed);
    }
}

#[test]
fn count_drive_or_other_halls_end_the_trust() {
    let untrusted = |bench: Bench| {
        let mut bench = bench.restart();
        assert_eq!((bench.get(Property::P), bench.tater.status().homed), (Some(0), false));
        bench.board().flash.operations
    };
    let mut at_once = Bench::new(1);
    at_once.home();
    set(&mut at_once, Property::SAVE, -1);
    at_once.settle();
    let back = at_once.count;
    at_once.tick_to(back + 1);
    at_once.tick_to(back);
    untrusted(at_once);

    let mut counted = saved(1);
    let back = counted.count;
    counted.tick_to(back + 1);
    counted.tick_to(back);
    assert!(counted.tater.status().homed, "this time it still knows");
    untrusted(counted);

    let mut driven = saved(1);
    let before = driven.board().flash.operations;
    set(&mut driven, Property::MODE, 3);
    driven.tick();
    let at_drive = driven.board().operations_at_drive.expect("driven");
    assert!(at_drive > before, "the mark is consumed before the bridge is on");
    untrusted(driven);

    let mut turned = saved(1);
    turned.count += 1;
    let mut turned = turned.restart();
    assert!(!turned.tater.status().homed);
    turned.count -= 1;
    untrusted(turned);
}

#[test]
fn unknown_position_is_saved_but_not_trusted() {
    let mut never_homed = Bench::new(1);
    set(&mut never_homed, Property::P, 33);
    set(&mut never_homed, Property::SAVE, id(Property::P));
    never_homed.settle();
    let mut bench = never_homed.restart();
    assert_eq!((bench.get(Property::P), bench.tater.status().homed), (Some(0), false));
    set(&mut bench, Property::LOAD, id(Property::P));
    assert_eq!((bench.get(Property::P), bench.tater.status().homed), (Some(33), false));
    set(&mut bench, Property::P, 5);
    set(&mut bench, Property::MODE, 3);
    assert!(bench.set(Property::DEF, id(Property::P)).is_err());
    set(&mut bench, Property::MODE, 0);
    set(&mut bench, Property::LOAD, id(Property::P));
    assert_eq!(bench.get(Property::P), Some(33), "what is refused forgets nothing");

    let mut powered = saved(4);
    set(&mut powered, Property::MODE, 3);
    powered.ticks(60);
    set(&mut powered, Property::SAVE, -1);
    powered.settle();
    assert!(!powered.restart().tater.status().homed);
}

#[test]
fn load_and_def_of_all_keep_the_measured_position() {
    let mut bench = saved(1);
    assert_eq!(bench.get(Property::P), Some(0));
    set(&mut bench, Property::P, 50);
    set(&mut bench, Property::LOAD, -1);
    assert_eq!(bench.get(Property::P), Some(0), "still trusted: the renaming is undone");
    bench.ticks(5);
    let count = bench.count;
    bench.tick_to(count + 3);
    set(&mut bench, Property::LOAD, -1);
    assert_eq!(bench.get(Property::P), Some(3));
    set(&mut bench, Property::DEF, -1);
    assert_eq!(bench.get(Property::P), Some(3));
    for by in [Property::LOAD, Property::DEF] {
        set(&mut bench, Property::MODE, 3);
        let refused = Err(SetError::Servo(Refusal::Mode(Mode::Pid)));
        assert_eq!(bench.set(by, id(Property::P)), refused);
        set(&mut bench, Property::MODE, 0);
        set(&mut bench, Property::P, 3);
        set(&mut bench, by, id(Property::P));
        assert_eq!(bench.get(Property::P), Some(0), "nothing is stored: the default");
    }
}

#[test]
fn unconsumable_trust_mark_keeps_the_bridge_off() {
    let mut bench = saved(1);
    bench.board().flash.broken = true;
    set(&mut bench, Property::M, 100);
    bench.ticks(5);
    assert_eq!((bench.tater.drive().duty, bench.board().operations_at_drive), (None, None));
    assert_eq!(bench.get(Property::ERROR), Some(i64::from(FaultCode::Storage.code())));
    assert_eq!(bench.get(Property::MODE), Some(0));
    bench.board().flash.broken = false;
    set(&mut bench, Property::STAT, 2);
    set(&mut bench, Property::M, 100);
    bench.ticks(5);
    assert!(bench.tater.drive().duty.is_some());
    assert!(!bench.restart().tater.status().homed);
}

#[test]
fn nothing_is_erased_while_it_drives() {
    let mut bench = Bench::new(4);
    set(&mut bench, Property::SAVE, -1);
    bench.settle();
    bench.board().flash.erases = 0;
    set(&mut bench, Property::MODE, 3);
    bench.ticks(40);
    for round in 0..600 {
        for property in [Property::X0, Property::X1, Property::X2] {
            set(&mut bench, property, round);
        }
        set(&mut bench, Property::SAVE, -1);
        for _ in 0..120 {
            bench.tater.store();
        }
        bench.tick();
    }
    let flash = &bench.board().flash;
    assert_eq!((flash.erases, flash.erased_while_driven), (0, 0));
    set(&mut bench, Property::MODE, 0);
    bench.tick();
    bench.settle();
    assert!(bench.board().flash.erases > 0);
    assert_eq!(bench.restart().get(Property::X2), Some(599));
}

fn second(bench: &mut Bench) {
    for _ in 0..10 {
        bench.ticks(100);
        let now = bench.now;
        bench.tater.housekeeping(now);
    }
}

#[test]
fn counters_grow_and_are_set_only_when_unlocked() {
    // The clock wraps within the first second.
    let mut bench = Bench::new(1);
    for _ in 0..7 {
        second(&mut bench);
    }
    assert_eq!(bench.get(Property::UPSECS), Some(7));
    for turns in [43, 88, 132, 177] {
        for _ in 0..16 {
            bench.tick_to(13);
            bench.tick_to(-12);
        }
        second(&mut bench);
        // 800 counts a time, there and back, minus the first 12.
        assert_eq!(bench.get(Property::OD), Some(turns));
    }
    for (temp, peak) in [(290, 290), (411, 411), (-100, 411)] {
        bench.board().analog.board_temp = DeciCelsius(temp);
        second(&mut bench);
        assert_eq!(bench.get(Property::PTEMP), Some(peak));
    }
    for (property, value) in [(Property::UPSECS, 4_294_967_290), (Property::OD, 1), (Property::PTEMP, -5)] {
        assert_eq!(bench.set(property, value), Err(SetError::Access(property)));
        bench.unlock();
        set(&mut bench, property, value);
        assert_eq!(bench.get(property), Some(value));
        bench.unlock();
        set(&mut bench, Property::LOAD, id(property));
        assert_eq!(bench.get(property), Some(value));
        bench.unlock();
        set(&mut bench, Property::DEF, id(property));
        assert_eq!(bench.get(property), Some(0));
        bench.unlock();
        set(&mut bench, property, value);
    }
    for _ in 0..9 {
        second(&mut bench);
    }
    assert_eq!(bench.get(Property::UPSECS), Some(4_294_967_295), "full, and stays so");
}

#[test]
fn late_housekeeping_loses_no_time() {
    let mut bench = Bench::new(1);
    for micros in [1_999_999, 1, 70 * 60 * 1_000_000, 999_999] {
        bench.now = bench.now.wrapping_add(Micros(micros));
        let now = bench.now;
        bench.tater.housekeeping(now);
    }
    assert_eq!(bench.get(Property::UPSECS), Some(2 + 4200));
}

#[test]
fn watchdog_is_fed_only_if_control_bus_and_storage_run() {
    let mut bench = Bench::new(1);
    let mut feeds = |act: fn(&mut Bench)| {
        let before = bench.board().feeds;
        act(&mut bench);
        let now = bench.now;
        bench.tater.housekeeping(now);
        bench.board().feeds - before
    };
    let store = |bench: &mut Bench| {
        bench.tater.store();
    };
    assert_eq!(feeds(|_| {}), 0);
    assert_eq!(feeds(|bench| bench.ticks(100)), 0);
    assert_eq!(feeds(|bench| bench.tater.flush()), 0, "nobody stores");
    assert_eq!(feeds(store), 1, "tick and bus were before the last time, but are not forgotten");
    assert_eq!(feeds(|bench| bench.tater.flush()), 0);
    assert_eq!(feeds(store), 0);
    assert_eq!(feeds(|bench| bench.ticks(1)), 1);
    let frame = |bench: &mut Bench| assert_eq!(bench.get(Property::STAT), Some(2));
    assert_eq!(feeds(frame), 0);
    assert_eq!(feeds(|bench| bench.ticks(1)), 0);
    assert_eq!(feeds(store), 1);
    assert_eq!(feeds(|_| {}), 0);
}

#[test]
fn save_all_stores_no_defaults_of_straps_and_chip() {
    for by_cmd in [false, true] {
        let mut bench = Bench::new(2);
        let (property, value) = if by_cmd { (Property::CMD, 1) } else { (Property::SAVE, -1) };
        set(&mut bench, property, value);
        bench.settle();
        let mut board = bench.tater.into_board();
        board.straps = Node::new(5).expect("a node");
        let mut bench = Bench::on(board, 0);
        assert_eq!((bench.tater.node().number(), bench.get(Property::ID)), (5, Some(5)));
        // Set values are reset, and the stored ones are updated.
        for stored in [6, 5] {
            bench.unlock();
            set(&mut bench, Property::ID, stored);
            set(&mut bench, Property::SAVE, -1);
            bench.settle();
            bench.board().straps = Node::new(2).expect("a node");
            bench = bench.restart();
            assert_eq!(i64::from(bench.tater.node().number()), stored);
        }
    }
}

#[test]
fn def_of_id_without_straps_is_refused() {
    let mut bench = Bench::new(2);
    bench.unlock();
    set(&mut bench, Property::ID, 3);
    bench.unlock();
    set(&mut bench, Property::SAVE, id(Property::ID));
    bench.board().straps = Node::HOST;
    bench.settle();
    let mut bench = bench.restart();
    bench.unlock();
    assert_eq!(bench.set(Property::DEF, id(Property::ID)), Err(SetError::Range(Property::ID)));
    bench.settle();
    let mut bench = bench.restart();
    assert_eq!((bench.tater.node().number(), bench.get(Property::ID)), (3, Some(3)));
}

/// LOAD and DEF of P rename the position; they do not confirm it.
#[test]
fn position_loaded_after_a_move_is_unknown() {
    for by in [Property::LOAD, Property::DEF] {
        let mut bench = saved(1);
        bench.ticks(300);
        for _ in 0..50 {
            let count = bench.count;
            bench.tick_to(count + 1);
        }
        bench.ticks(300);
        assert_eq!((bench.get(Property::P), bench.tater.status().homed), (Some(50), true));
        set(&mut bench, by, id(Property::P));
        assert_eq!((bench.get(Property::P), bench.tater.status().homed), (Some(0), false));
        set(&mut bench, Property::SAVE, id(Property::P));
        bench.settle();
        assert!(!bench.restart().tater.status().homed);
    }
    let mut bench = saved(1);
    bench.ticks(300);
    set(&mut bench, Property::LOAD, id(Property::P));
    assert!(bench.tater.status().homed);
    set(&mut bench, Property::P, 9);
    assert!(bench.tater.status().homed);
}

#[test]
fn reset_stores_the_counters() {
    let mut bench = Bench::new(1);
    second(&mut bench);
    bench.settle();
    for _ in 0..8 {
        second(&mut bench);
    }
    set(&mut bench, Property::STAT, 0);
    assert_eq!(bench.restart().get(Property::UPSECS), Some(9));
}

#[test]
fn save_stores_the_counters_before_a_power_cut() {
    for saved in [-1, id(Property::MT)] {
        let mut bench = Bench::new(1);
        for _ in 0..48 {
            bench.tick_to(13);
            bench.tick_to(-12);
        }
        for _ in 0..3 {
            second(&mut bench);
        }
        bench.settle();
        // Not due by themselves: a restart without a reset has lost them.
        set(&mut bench, Property::SAVE, saved);
        bench.settle();
        let mut bench = bench.restart();
        assert_eq!(
            (bench.get(Property::UPSECS), bench.get(Property::OD)),
            (Some(3), Some(132)),
            "SAVE {saved}"
        );
    }
}

#[test]
fn watchdog_of_the_tick_is_fed_by_each_tick_and_before_each_erase() {
    let mut bench = Bench::new(1);
    let feeds = bench.board().tick_feeds;
    bench.ticks(5);
    assert_eq!(bench.board().tick_feeds, feeds + 5);
    bench.tater.housekeeping(bench.now);
    assert_eq!(bench.board().tick_feeds, feeds + 5, "housekeeping does not stand for the tick");
    set(&mut bench, Property::SAVE, -1);
    let (feeds, operations) = (bench.board().tick_feeds, bench.board().flash.operations);
    bench.set(Property::STAT, 0).expect("a reset is always obeyed");
    let operations = bench.board().flash.operations - operations;
    assert!(operations >= 8 && bench.board().tick_feeds - feeds >= operations, "{operations}");
}

#[test]
fn watchdog_is_fed_for_each_flash_operation_before_a_reset() {
    let mut bench = Bench::new(1);
    // A record of all that is stored.
    set(&mut bench, Property::SAVE, -1);
    let (feeds, operations) = (bench.board().feeds, bench.board().flash.operations);
    bench.set(Property::STAT, 0).expect("a reset is always obeyed");
    let operations = bench.board().flash.operations - operations;
    assert!(operations >= 8, "{operations}");
    assert!(bench.board().feeds - feeds >= operations, "{operations}");
}
