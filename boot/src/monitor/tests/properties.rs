use super::*;
use crate::tests::STORAGE;
use tater_wire::Torques;

const UNLOCK: [i32; 5] = [18384, 23, 3145, 1024, 1];
const ROLE: u8 = 1;
const SN: u8 = 2;
const ID: u8 = 3;

fn unlock(bench: &mut Bench) {
    for number in UNLOCK {
        bench.set(3, LOCK, number);
    }
}

#[test]
fn monitor_answers_six_properties_and_0_for_memory() {
    let mut bench = Bench::strapped(3);
    let answers: Vec<_> = (0..0x80).filter_map(|id| Some((id, bench.get(3, id)?))).collect();
    assert_eq!(answers, [(0, 600), (1, 2051), (2, 4711), (3, 3), (4, 0), (5, 0), (6, 0), (7, 0)]);
}

#[test]
fn monitor_answers_host_and_boards_in_their_groups() {
    let mut bench = Bench::strapped(3);
    let id = |from: u8, to| Identifier { from: Node::new(from).expect("a node"), to }.raw();
    let node = |n| Destination::Node(Node::new(n).expect("a node"));
    let answer = bench.say(id(9, node(3)), &[1]);
    let reply = Frame::from_raw(3 << 5 | 9, &[0x87, 0, 0x03, 0x08]).expect("a frame");
    assert_eq!(answer, [reply], "SET of VALUE to the node that asked");
    assert_eq!(bench.say(id(0, node(4)), &[1]), [], "another node's");
    // Group 0, GRPB 1 for nodes 1 to 4, GRPC 4; not the other half's group, nor replies to the host.
    let heard: Vec<_> = (0..32).filter(|g| !bench.say(0x400 | g, &[5]).is_empty()).collect();
    assert_eq!(heard, [0, 1, 4]);
}

#[test]
fn groups_and_node_come_from_storage_and_replies_are_ignored() {
    let mut bench = Bench::strapped(3);
    bench.monitor.store.set(Property::GRPA, 9);
    bench.monitor.store.set(Property::GRPB, 6);
    bench.monitor.store.set(Property::ID, 12);
    bench.monitor.saving = true;
    bench.settle();
    let mut bench = bench.reset();
    let heard: Vec<_> = (0..32).filter(|g| !bench.say(0x400 | g, &[5]).is_empty()).collect();
    assert_eq!(heard, [0, 5, 9]);
    assert_eq!((bench.get(12, 3), bench.say(3, &[3]).len()), (Some(12), 0));
}

#[test]
fn monitor_sets_the_can_filters() {
    let groups = |numbers: [u8; 3]| numbers.map(Group::new);
    let mut bench = Bench::strapped(3);
    assert_eq!(bench.board().listens, Some((Node::new(3).expect("3"), groups([0, 1, 4]))));
    bench.monitor.store.set(Property::GRPA, 3);
    bench.monitor.store.set(Property::GRPB, 9);
    bench.monitor.store.set(Property::ID, 12);
    bench.monitor.saving = true;
    bench.settle();
    let listens = bench.reset().board().listens;
    assert_eq!(listens, Some((Node::new(12).expect("12"), [None, Group::new(9), Group::new(5)])));
    let listens = Bench::strapped(0).board().listens;
    assert_eq!(listens, Some((Node::HOST, groups([0, 1, 4]))), "nobody has named it");
}

#[test]
fn error_gives_the_reset_reason_until_wake() {
    for cause in [FaultCode::Watchdog, FaultCode::Panic, FaultCode::HardFault, FaultCode::Clock] {
        let mut bench = Bench::strapped(3);
        bench.board().chip.load(APPLICATION.start, &image(2000, 1));
        bench.board().cause = Some(cause);
        let mut bench = bench.reset();
        assert_eq!((bench.settle(), bench.get(3, 4)), (Next::Stay, Some(u16::from(cause.code()))));
        bench.set(3, 5, 2);
        assert_eq!((bench.get(3, 4), bench.settle()), (Some(0), Next::Start));
    }
}

#[test]
fn board_without_straps_is_silent_until_it_has_an_id() {
    let mut bench = Bench::strapped(0);
    for id in [0, 0x400, 0x404] {
        for property in 0..0x80 {
            assert_eq!(bench.say(id, &[property]), []);
        }
    }
    bench.set(0, 0, 0xAA);
    bench.set(0x400, 0, 0xAA);
    assert_eq!((bench.settle(), bench.board().sent.len()), (Next::Stay, 0));
    assert!(bench.board().chip.erased.is_empty(), "no download has begun");
    for value in UNLOCK {
        bench.set(0x400, LOCK, value);
    }
    bench.set(0x400, 3, 6);
    bench.set(0x400, SAVE, -1);
    bench.settle();
    assert_eq!(bench.reset().get(6, 3), Some(6));
}

#[test]
fn locked_property_changes_once_after_the_sequence() {
    for (property, value) in [(1, 3), (2, 1234), (3, 5)] {
        let mut bench = Bench::strapped(3);
        let before = bench.get(3, property);
        bench.set(3, property, value);
        assert_eq!(bench.get(3, property), before, "locked");
        for upset in 0..UNLOCK.len() {
            for (i, number) in UNLOCK.into_iter().enumerate() {
                bench.set(3, LOCK, if i == upset { number ^ 0x4000 } else { number });
            }
            bench.set(3, property, value);
            assert_eq!(bench.get(3, property), before, "number {upset} was wrong");
        }
        for number in [18384, 23].into_iter().chain(UNLOCK) {
            bench.set(3, LOCK, number);
        }
        bench.set(3, property, value);
        assert_eq!(bench.get(3, property).map(i32::from), Some(value));
        bench.set(3, property, value + 1);
        assert_eq!(bench.get(3, property).map(i32::from), Some(value), "once");
    }
}

#[test]
fn other_set_interrupts_the_sequence_but_not_an_open_lock() {
    let locked = [ROLE, SN, ID];
    for other in (0..0x80).filter(|id| *id != LOCK && !locked.contains(id)) {
        for done in 1..=UNLOCK.len() {
            let mut bench = Bench::strapped(3);
            UNLOCK[..done].iter().for_each(|&number| bench.set(3, LOCK, number));
            bench.set(3, other, 77);
            UNLOCK[done..].iter().for_each(|&number| bench.set(3, LOCK, number));
            bench.set(3, SN, 99);
            let open = done == UNLOCK.len();
            assert_eq!(bench.get(3, SN), Some(if open { 99 } else { 4711 }), "{other} after {done}");
        }
    }
    // Packed torques are a SET too.
    let mut bench = Bench::strapped(3);
    UNLOCK[..2].iter().for_each(|&number| bench.set(3, LOCK, number));
    let body = Body::Torques(Torques::new(&[5]).expect("one"));
    let torques = Message { from: Node::HOST, to: Destination::Group(Group::LOW), body }.frame();
    bench.say(torques.raw_id(), torques.data());
    UNLOCK[2..].iter().for_each(|&number| bench.set(3, LOCK, number));
    bench.set(3, SN, 99);
    assert_eq!(bench.get(3, SN), Some(4711), "torques");
}

#[test]
fn out_of_range_value_is_refused_and_relocks() {
    for (property, value) in [(1, -1), (1, 32768), (2, 32768), (3, 0), (3, 32)] {
        let mut bench = Bench::strapped(3);
        let before = bench.get(3, property);
        unlock(&mut bench);
        bench.set(3, property, value);
        bench.set(3, property, 2);
        assert_eq!(bench.get(3, property), before, "{property} {value}");
    }
}

#[test]
fn save_stores_and_load_restores() {
    let mut bench = Bench::strapped(3);
    let change = |bench: &mut Bench, property, value| {
        unlock(bench);
        bench.set(3, property, value);
    };
    change(&mut bench, 2, 77);
    bench.set(3, SAVE, 1);
    bench.set(3, SAVE, 5);
    bench.settle();
    let mut bench = bench.reset();
    assert_eq!(bench.get(3, 2), Some(4711), "another property was stored");
    change(&mut bench, 2, 77);
    bench.set(3, SAVE, 2);
    change(&mut bench, 2, 78);
    bench.settle();
    let mut bench = bench.reset();
    assert_eq!(bench.get(3, 2), Some(77));
    change(&mut bench, 1, 3);
    change(&mut bench, 2, 78);
    for property in [1, 2, -1] {
        bench.set(3, LOAD, property);
    }
    assert_eq!((bench.get(3, 1), bench.get(3, 2)), (Some(3), Some(78)), "locked");
    change(&mut bench, LOAD, 1);
    bench.set(3, LOAD, 2);
    assert_eq!((bench.get(3, 1), bench.get(3, 2)), (Some(2051), Some(78)), "the default; once");
    change(&mut bench, LOAD, 2);
    assert_eq!(bench.get(3, 2), Some(77), "what is stored");
    change(&mut bench, 2, 79);
    change(&mut bench, LOAD, -1);
    assert_eq!(bench.get(3, 2), Some(79), "all does not mean the locked ones");
}

#[test]
fn new_id_takes_effect_at_the_next_reset() {
    let mut bench = Bench::strapped(3);
    unlock(&mut bench);
    bench.set(3, 3, 5);
    assert_eq!((bench.get(3, 3), bench.get(5, 3)), (Some(5), None));
    bench.set(3, SAVE, 3);
    bench.settle();
    let mut bench = bench.reset();
    assert_eq!((bench.get(3, 3), bench.get(5, 3)), (None, Some(5)));
}

#[test]
fn answers_wait_for_the_controller() {
    let mut bench = Bench::strapped(3);
    bench.board().room = 1;
    assert_eq!(bench.say(3, &[0]).len(), 1);
    bench.board().room = 0;
    for property in 1..6 {
        assert_eq!(bench.say(3, &[property]), []);
    }
    bench.board().room = 10;
    bench.settle();
    let order: Vec<_> = bench.board().sent.iter().map(|frame| frame.data()[0]).collect();
    assert_eq!(order, [0x81, 0x82, 0x83, 0x84, 0x85]);
}

#[test]
fn only_a_verified_application_starts() {
    let mut bench = Bench::strapped(3);
    bench.set(3, 5, 2);
    assert_eq!((bench.settle(), bench.get(3, 4)), (Next::Stay, Some(16)), "there is none");
    let good = image(2000, 1);
    for at in [0, 0x1C, 0x20, 0x24, 0x28, 999, 1999] {
        let mut bad = good.clone();
        bad[at] ^= 0x10;
        bench.board().chip.load(APPLICATION.start, &bad);
        bench.set(3, 5, 2);
        assert_eq!((bench.settle(), bench.get(3, 4)), (Next::Stay, Some(16)), "byte {at} is wrong");
    }
    bench.board().chip.load(APPLICATION.start, &good);
    assert_eq!((bench.settle(), bench.get(3, 5)), (Next::Stay, Some(0)), "nobody asked");
    bench.set(3, 5, 1);
    assert_eq!(bench.settle(), Next::Stay, "STAT 1 cannot be asked for");
    bench.set(0x404, 5, 2);
    assert_eq!(bench.settle(), Next::Start, "a group can");
}

#[test]
fn repeated_start_requests_do_not_restart_the_check() {
    let mut bench = Bench::strapped(3);
    bench.board().chip.load(APPLICATION.start, &image(48 * 1024, 1));
    // Verification takes 192 steps of 256 bytes, so two rounds of 100; plus some for the rest.
    let started = (0..5).any(|_| {
        bench.set(3, 5, 2);
        (0..100).any(|_| {
            bench.now = bench.now.wrapping_add(100);
            bench.monitor.step(Micros(bench.now)) == Next::Start
        })
    });
    assert!(started);
}

#[test]
fn pending_values_are_stored_before_a_download() {
    let mut bench = Bench::strapped(3);
    unlock(&mut bench);
    bench.set(3, SN, 99);
    bench.set(3, SAVE, -1);
    bench.set(3, 0, 0xAA);
    let mut asked = false;
    for _ in 0..1000 {
        bench.now = bench.now.wrapping_add(100);
        assert_eq!(bench.monitor.step(Micros(bench.now)), Next::Stay);
        asked |= !std::mem::take(&mut bench.board().sent).is_empty();
    }
    assert!(asked, "the download goes on");
    assert_eq!(bench.reset().get(3, SN), Some(99));
}

#[test]
fn pending_values_are_stored_before_the_application_starts() {
    let mut bench = Bench::strapped(3);
    bench.board().chip.load(APPLICATION.start, &image(2000, 1));
    unlock(&mut bench);
    bench.set(3, 2, 99);
    bench.set(3, SAVE, -1);
    bench.set(3, 5, 2);
    assert_eq!(bench.settle(), Next::Start);
    assert_eq!(bench.reset().get(3, 2), Some(99));
}

#[test]
fn failed_save_raises_an_error() {
    let mut bench = Bench::strapped(3);
    bench.board().chip.worn = true;
    unlock(&mut bench);
    bench.set(3, SN, 99);
    bench.set(3, SAVE, -1);
    assert_eq!((bench.settle(), bench.get(3, 4)), (Next::Stay, Some(8)));
}

/// A SAVE of a host that takes the hand for awake reaches the monitor too.
#[test]
fn save_leaves_what_cannot_be_read_to_the_application() {
    let mut bench = Bench::strapped(3);
    unlock(&mut bench);
    bench.set(3, SN, 99);
    bench.set(3, SAVE, SN.into());
    bench.settle();
    let first = STORAGE.start + 2;
    assert_ne!(bench.board().chip.half_word(first), u16::MAX, "a record");
    bench.board().chip.program(first, &[0]).expect("zeros are always taken");
    let mut bench = bench.reset();
    bench.set(3, SAVE, -1);
    bench.settle();
    let chip = &bench.board().chip;
    assert!(Store::open(chip).is_damaged(chip));
}

#[test]
fn stat_0_resets_so_that_a_new_id_takes_effect() {
    let mut bench = Bench::strapped(3);
    for key in [18384, 23, 3145, 1024, 1] {
        bench.set(3, 8, key);
    }
    bench.set(3, 3, 14);
    bench.set(3, 9, 3);
    bench.set(3, 5, 0);
    assert_eq!(bench.board().resets, 0, "first what is to be stored");
    bench.settle();
    assert_eq!(bench.board().resets, 1);
    let mut bench = bench.reset();
    assert_eq!((bench.get(3, 5), bench.get(14, 5), bench.get(14, 3)), (None, Some(0), Some(14)));
    // GRPB and GRPC of a node of an arm's hand.
    let groups = [Group::new(0), Group::new(7), Group::new(5)];
    assert_eq!(bench.board().listens, Node::new(14).map(|node| (node, groups)));
}
