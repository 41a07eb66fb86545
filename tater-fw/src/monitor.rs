//! The monitor: what runs after a reset. It never moves the motor.

use crate::board::Board;
use crate::storage::Store;
use servo_core::sense::commutation::Bridge;
use servo_core::units::Micros;
use tater_wire::Frame;

/// What comes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// The monitor goes on.
    Stay,
    /// There is a verified application, and it has been asked for: jump to it.
    Start,
}

/// The monitor on a board.
#[derive(Debug)]
pub struct Monitor<B: Board> {
    board: B,
    store: Store,
}

impl<B: Board> Monitor<B> {
    /// After a reset: bridge off, brake engaged, no motion.
    pub fn new(mut board: B) -> Self {
        board.bridge(Bridge::Off);
        board.brake(false);
        let store = Store::open(board.flash());
        Self { board, store }
    }

    /// A frame from the bus, any frame: those for other nodes are skipped.
    pub fn receive(&mut self, _frame: &Frame, _now: Micros) {
        let _ = &self.store;
    }

    /// What is due: at most one flash operation, a request, a time-out. To be called over and over.
    pub fn step(&mut self, _now: Micros) -> Next {
        Next::Start
    }

    /// The hardware.
    #[must_use]
    pub const fn board(&self) -> &B {
        &self.board
    }

    /// The hardware.
    pub const fn board_mut(&mut self) -> &mut B {
        &mut self.board
    }

    /// The hardware, for the application.
    pub fn into_board(self) -> B {
        self.board
    }
}
