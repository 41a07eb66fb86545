//! Two boards with one number: the hand names them, moves neither, and the documented ways lead out (docs/hand.md).

use hil_world::board::SimBoard;
use hil_world::node::Node;
use hil_world::plant::Model;
use tater_wire::Node as Id;

use super::Session;

/// A spare link's board that is set to this number by its straps.
fn plug_spare(session: &mut Session, number: u8) {
    let id = Id::new(number).expect("a node");
    let board = SimBoard::standard(id, Model::Averaged, 9).with_chip(4711);
    session.hand.bus_mut().plug_guest(Node::new(board));
}

/// The lines that open LOCK for one SET of these boards.
fn unlock(session: &mut Session, nodes: &str) {
    for key in [18384, 23, 3145, 1024, 1] {
        assert_eq!(session.run(&format!("{nodes} S LOCK {key}")), "");
    }
}

fn positions(session: &Session) -> Vec<f64> {
    let bus = session.hand.bus();
    bus.stations().chain(bus.guests()).map(|node| node.board().rig().truth().counts.round()).collect()
}

const NAMED: &str = "two boards, SN 1002 and SN 4711";

#[test]
fn second_board_is_named_moves_nothing_and_is_unplugged() {
    let mut session = Session::new();
    assert_eq!(session.run("WAKE"), "");
    plug_spare(&mut session, 2);
    // Its board sleeps: the answer with more dominant bits is the first one.
    assert_eq!(session.run("2 G STAT"), "2 STAT=0\nERR 1");
    assert_eq!(session.run("WAKE"), "ERR 1");
    assert_eq!(session.run("2 G STAT"), "2 STAT=2\nERR 1", "both answer the same");
    assert_eq!(session.run("1 G STAT"), "1 STAT=2");
    let before = positions(&session);
    for line in ["HI", "2HI", "C", "X2M 1000", "S2C", "FGET S"] {
        let answer = session.run(line);
        let expected = if line == "FGET S" { "4 5 4 4" } else { "ERR 1" };
        assert!(answer == expected || answer == "ERR 5", "{line}: {answer}");
    }
    assert_eq!(positions(&session), before, "nothing has moved");
    let named = session.run("ERR 1");
    assert!(named.contains(&format!("motor 2: {NAMED}\n  Unplug one")), "{named}");
    assert!(!named.contains("motor 1") && !named.contains("motor 3"), "{named}");
    assert!(session.hand.bus_mut().unplug_guest().is_some());
    for line in ["2 G STAT", "WAKE", "HI", "C"] {
        assert!(!session.run(line).contains("ERR"), "{line}");
    }
    assert_eq!(session.run("ERR 1").lines().count(), 1);
}

#[test]
fn second_board_that_is_plugged_in_between_motions_is_found_by_its_other_answers() {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    plug_spare(&mut session, 3);
    // It sleeps, and STAT is asked before each motion.
    assert_eq!(session.run("M 2000"), "ERR 1");
    assert!(session.run("ERR 1").contains("motor 3: two boards, SN 1003 and SN 4711"));
}

#[test]
fn wrong_id_is_given_back_to_the_straps_without_unplugging() {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    unlock(&mut session, "3");
    assert_eq!(session.run("3 S ID 2"), "");
    assert_eq!(session.run("3 S SAVE 3"), "");
    assert_eq!(session.run("HI"), "", "it is heard from the next start on");
    assert_eq!(session.run("3 S STAT 0"), "");
    assert_eq!(session.run("WAKE"), "ERR 1");
    assert_eq!(session.run("HI"), "ERR 1");
    let named = session.run("ERR 1");
    assert!(named.contains("motor 3: no answer"), "{named}");
    assert!(named.contains("motor 2: two boards, SN 1002 and SN 1003"), "{named}");
    // Both obey.
    unlock(&mut session, "2");
    assert_eq!(session.run("2 S DEF 3"), "");
    assert_eq!(session.run("2 S STAT 0"), "");
    for line in ["WAKE", "123 G STAT", "HI", "C"] {
        assert!(!session.run(line).contains("ERR"), "{line}");
    }
}
