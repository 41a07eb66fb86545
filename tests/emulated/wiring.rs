//! Wrong wiring on the image: caught, learned by FIND, confirmed, stored; tests/wiring.rs has all orders on native boards.

use board_emu::board::Board;
use board_emu::image::Programs;
use board_emu::session::load;
use hil_world::board::SimBoard;
use hil_world::plant::Model;
use tater_f103::map::STORAGE;
use tater_wire::find::FindState;
use tater_wire::{EndCode, FaultCode, Property};

use super::bench::{Bench, id, production};

/// An odd order of the phases and an even one of the hall lines, one of them inverted.
const PHASES: [u8; 3] = [0, 2, 1];
const HALLS: [u8; 3] = [1, 2, 0];
const INVERTED: [bool; 3] = [false, false, true];

/// Link, spread and tip.
const NODES: [u8; 3] = [1, 4, 5];

/// Most counts against what the motor was told, and of FIND around its start (the requirement).
const WRONG_WAY: f64 = 6.0;

fn board(programs: &Programs, node: u8, wires: ([u8; 3], [u8; 3], [bool; 3])) -> Board {
    // Away from the stops.
    let at = if node == 4 { 83.2 } else { 120.3 };
    let mut rig = SimBoard::at_position(at, id(node), Model::Averaged, 1).expect("in range").rig().clone();
    rig.rewire(wires.0, wires.1, wires.2).expect("orders");
    let mut board = Board::new(rig, id(node), programs, 1);
    load(&mut board, programs);
    board
}

fn counts(bench: &Bench) -> f64 {
    bench.board().rig().truth().counts
}

/// Waits, a ms each, until `done`. Returns the lowest and the highest position meanwhile.
fn watch(bench: &mut Bench, most_ms: u32, mut done: impl FnMut(&mut Bench) -> bool) -> (f64, f64) {
    let (mut low, mut high) = (counts(bench), counts(bench));
    for ms in 0..most_ms {
        bench.wait_ms(1);
        (low, high) = (low.min(counts(bench)), high.max(counts(bench)));
        if ms % 50 == 49 && done(bench) {
            return (low, high);
        }
    }
    panic!("not within {most_ms} ms: ERROR {:?}", bench.get(Property::ERROR));
}

#[test]
fn image_stops_a_motor_that_runs_the_wrong_way_and_does_not_home() {
    let Some(programs) = production() else { return };
    let mut caught = 0;
    // Phases shifted by a third of an electrical revolution either way, and interchanged; all hall lines inverted.
    let wrong = [([1, 2, 0], false), ([2, 0, 1], false), ([0, 2, 1], false), ([0, 1, 2], true)];
    for (node, (phases, inverted)) in NODES.into_iter().flat_map(|node| wrong.map(|wires| (node, wires))) {
        let mut bench = Bench::with(board(&programs, node, (phases, [0, 1, 2], [inverted; 3])));
        for (property, value) in [(Property::M, 30), (Property::CMD, 13)] {
            let start = counts(&bench);
            bench.set(property, value);
            let (low, high) = watch(&mut bench, 8_000, |bench| bench.get(Property::END) != Some(0));
            // HI opens towards its stop.
            let wrong = if property == Property::M { start - low } else { high - start };
            let (end, error) = (bench.get(Property::END), bench.get(Property::ERROR));
            let what = format!("node {node}, phases {phases:?}, inverted {inverted}, {property:?}");
            println!("figure: {what}: {wrong:.1} counts the wrong way, END {end:?}, ERROR {error:?}");
            assert!(wrong <= WRONG_WAY, "{what}: {wrong:.1} counts the wrong way");
            assert_ne!(end, Some(EndCode::Arrived.into()), "{what}");
            assert_eq!(bench.get(Property::HALLH).map(|bits| bits >> 30), Some(0), "{what}: not homed");
            // After a stall the spread holds its place.
            assert!(!bench.is_driven() || error == Some(0), "{what}");
            caught += u32::from(error == Some(FaultCode::Wiring.code().into()));
            bench.set(Property::STAT, 2);
            bench.wait_ms(300);
        }
    }
    // The others are held by their own torque, and end as stalled.
    assert!(caught > 0, "ERROR 9 is told");
}

#[test]
fn image_learns_its_wiring_stores_it_and_homes_after_a_reset() {
    let Some(programs) = production() else { return };
    for node in NODES {
        let mut board = board(&programs, node, (PHASES, HALLS, INVERTED));
        let erased = vec![0xFF; STORAGE.len as usize];
        board.machine_mut().chip_mut().flash.load(STORAGE.start, &erased);
        let mut bench = Bench::with(board);
        assert_eq!(bench.get(Property::FIND), Some(FindState::Unknown.into()));
        bench.set(Property::CMD, 13);
        bench.wait_ms(300);
        assert!(!bench.is_driven() && bench.get(Property::MODE) == Some(0), "node {node}: HI is refused");
        let start = counts(&bench);
        let mut state = None;
        for _ in 0..4 {
            bench.set(Property::FIND, 1);
            let ended = |bench: &mut Bench| {
                state = bench.get(Property::FIND);
                state != Some(FindState::Learning.into())
            };
            let (low, high) = watch(&mut bench, tater_fw::find::LIMIT_MS.into(), ended);
            let moved = (start - low).max(high - start);
            println!("figure: node {node}: FIND moved {moved:.1} counts, state {state:?}");
            assert!(moved <= WRONG_WAY, "node {node}: {moved:.1} counts");
            if state == Some(FindState::Learned.into()) {
                break;
            }
        }
        assert_eq!(state, Some(FindState::Learned.into()), "node {node}");
        let from = counts(&bench);
        bench.set(Property::FIND, 2);
        bench.wait_ms(1_500);
        assert_eq!(bench.get(Property::FIND), Some(FindState::Tested.into()), "node {node}");
        bench.set(Property::FIND, if counts(&bench) > from { 3 } else { 4 });
        bench.wait_ms(300);
        assert_eq!(bench.get(Property::FIND), Some(FindState::Known.into()), "node {node}");
        let wiring = bench.get(Property::WIRING);
        bench.board_mut().power_off();
        bench.wait_ms(10);
        bench.board_mut().power_on();
        bench.wait_ms(100);
        bench.wake();
        bench.wait_ms(300);
        assert_eq!(
            (bench.get(Property::WIRING), bench.get(Property::FIND)),
            (wiring, Some(FindState::Known.into()))
        );
        bench.set(Property::CMD, 13);
        watch(&mut bench, 12_000, |bench| bench.get(Property::END) != Some(0));
        assert_eq!(bench.get(Property::END), Some(EndCode::Arrived.into()), "node {node}");
        assert_eq!(bench.get(Property::ERROR), Some(0), "node {node}");
        assert_eq!(bench.get(Property::HALLH).map(|bits| bits >> 30), Some(1), "node {node}: homed");
    }
}
