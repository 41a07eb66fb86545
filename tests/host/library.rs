//! The host library `wraptor` against GOD with native and with emulated boards, in simulated time as fast as the machine can.

use std::net::TcpListener;
use std::thread;
use std::time::Duration;

use board_emu::hand::{boards, serve};
use board_emu::image::Programs;
use god::Memory;
use hil_world::hand::{Hand as Simulated, Motorized};
use tater_wire::{Node, Property};
use wraptor::{BoardState, Boards, Connect, Control, DownloadProgress, Firmware, Format, Hand, no_progress};

use super::serial::native;
use crate::emulated::bench::{flashed, folder, production};

/// Limit of a call: emulated boards are slower than real ones.
const LIMIT: Duration = Duration::from_secs(600);

/// Serves a hand of these boards. Returns the address.
fn served<S: Motorized>(assembled: impl FnOnce() -> Vec<S> + Send + 'static) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address").to_string();
    thread::spawn(move || serve(&listener, &mut Simulated::with(assembled(), Memory::default())));
    address
}

fn connected(address: &str, boards: Boards) -> Hand {
    Connect::tcp(address).boards(boards).connect(LIMIT).expect("connected")
}

/// Loaded where they run: they belong to one thread.
fn programs() -> Programs {
    production().expect("it was there before")
}

fn node(number: u8) -> Node {
    Node::new(number).expect("a node")
}

/// Wakes, homes, moves, sets, reads, runs RealTime.
fn uses_everything(address: &str) {
    let mut hand = connected(address, Boards::Wake);
    hand.find_zero("S", LIMIT, &mut no_progress).expect("homed");
    hand.set("4", Property::MT, 600, LIMIT).expect("set");
    assert_eq!(hand.get("4", Property::MT, LIMIT), Ok(vec![(node(4), 600)]));
    hand.move_halls("4", 60, LIMIT, &mut no_progress).expect("moved");
    let place = hand.get("4", Property::P, LIMIT).expect("a position")[0].1;
    assert!((59..=61).contains(&place), "{place}");
    let mut realtime = hand.realtime("S", Format::default(), LIMIT).expect("RealTime");
    let feedback = realtime.exchange(&[Control::default()], LIMIT);
    assert!(feedback.is_ok(), "{feedback:?}");
    realtime.end(LIMIT).expect("a prompt");
    assert_eq!(hand.faults(LIMIT), Ok(vec![]));
}

#[test]
fn library_runs_on_native_boards() {
    uses_everything(&served(native));
}

#[test]
fn library_runs_on_emulated_boards() {
    if production().is_some() {
        uses_everything(&served(|| boards(&programs())));
    }
}

/// The production image through GOD, to a board that is flashed with it: the monitor's own code takes it.
#[test]
fn emulated_board_takes_a_download_through_god() {
    if production().is_none() {
        return;
    }
    let text = std::fs::read(folder("production").join("tater.tek")).expect("`cargo xtask image` makes it");
    let address = served(|| {
        let mut board = flashed(&programs(), 4);
        board.power_on();
        vec![board]
    });
    let mut hand = connected(&address, Boards::Any);
    let mut last: Option<DownloadProgress> = None;
    hand.download("4", &Firmware::new(text).expect("sealed"), LIMIT, &mut |progress| {
        last = Some(*progress);
        std::ops::ControlFlow::Continue(())
    })
    .expect("it runs it");
    assert_eq!(last.expect("progress").percent(), 100);
    assert_eq!(hand.boards(LIMIT).expect("states")[3], BoardState::Ready);
}
