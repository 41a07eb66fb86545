//! A whole hand of emulated boards, for hosts that speak with its GOD over TCP.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};

use hil_world::board::SimBoard;
use hil_world::hand::serial::Serial;
use hil_world::hand::{Hand, Motorized};
use hil_world::plant::Model;
use tater_wire::Node;
use wraptor::configure_tcp;

use crate::board::Board;
use crate::image::Programs;
use crate::session::load;

/// Simulated time between two looks at the connection, µs.
const STEP_US: u64 = 1000;

/// Most bytes of GOD's output in a step.
const ROOM: usize = 1 << 16;

/// A board with the hand's motor of this node and both programs in its flash, without power.
#[must_use]
pub fn flashed(programs: &Programs, node: Node) -> Board {
    let rig = SimBoard::standard(node, Model::Averaged, 1).rig().clone();
    let mut board = Board::new(rig, node, programs, 1);
    load(&mut board, programs);
    board
}

/// The seven boards of a hand at power-up.
#[must_use]
pub fn boards(programs: &Programs) -> Vec<Board> {
    let board = |node| {
        let mut board = flashed(programs, node);
        board.power_on();
        board
    };
    (1..=7).filter_map(Node::new).map(board).collect()
}

/// Serves one host after another, as fast as the machine can. Time stands still between hosts; one that comes too early waits, one that
/// does not read is disconnected.
///
/// # Errors
/// A connection cannot be accepted.
pub fn serve<S: Motorized>(listener: &TcpListener, hand: &mut Hand<S>) -> io::Result<()> {
    loop {
        let (mut host, _) = listener.accept()?;
        let mut line = Serial::new(false);
        // A host that cannot be set up, or fails, has left.
        let set_up = configure_tcp(&host).and_then(|()| host.set_nonblocking(true));
        while set_up.is_ok() && exchange(&mut host, &mut line, hand).is_ok() {}
        line.hang_up(hand);
        // The output of what the hang-up aborts is not for the next host.
        loop {
            hand.run_until(hand.now_us() + STEP_US);
            hand.take_tx();
            if hand.io().waits_for_line() {
                break;
            }
        }
    }
}

/// Passes bytes both ways, and time.
///
/// # Errors
/// The host has left.
fn exchange<S: Motorized>(host: &mut TcpStream, line: &mut Serial, hand: &mut Hand<S>) -> io::Result<()> {
    let (mut bytes, mut heard) = ([0; 1024], Vec::new());
    match host.read(&mut bytes) {
        Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
        Ok(len) => line.put(&bytes[..len], hand),
        Err(error) if error.kind() == ErrorKind::WouldBlock => {}
        Err(error) => return Err(error),
    }
    let until_us = hand.now_us() + STEP_US;
    line.run_until(hand, until_us, &mut heard, ROOM);
    host.write_all(&heard)
}
