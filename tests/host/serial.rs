//! A program's serial port: bytes take their time at the program's baud rate, and every read has the program's timeout.

use god::Memory;
use hil_world::board::SimBoard;
use hil_world::hand::serial::Serial;
use hil_world::hand::{Hand, Motorized};
use hil_world::node::Node;
use hil_world::plant::Model;
use tater_wire::Node as Id;

/// Native boards in their monitors, nodes 1 to 7.
pub(super) fn native() -> Vec<Node> {
    let node = |number| Id::new(number).expect("a node");
    (1..=7)
        .map(|number| Node::new(SimBoard::standard(node(number), Model::Averaged, 1 + u64::from(number))))
        .collect()
}

/// Time after which every monitor answers, us.
const BOOT_US: u64 = 200_000;

pub(super) struct Port<S> {
    pub hand: Hand<S>,
    line: Serial,
    heard: Vec<u8>,
    /// The program's baud rate / 100.
    pub baud: u16,
    /// Where each motor truly was when HI had ended, hall counts.
    zeros: Vec<f64>,
}

impl<S: Motorized> Port<S> {
    /// A hand of these boards at power-up, and a program at 9600 baud.
    pub fn open(boards: Vec<S>, memory: Memory) -> Self {
        let mut hand = Hand::with(boards, memory);
        hand.run_until(BOOT_US);
        hand.take_tx();
        let baud = hand.io().baud();
        Self { hand, line: Serial::new(true), heard: Vec::new(), baud, zeros: vec![0.0; 7] }
    }

    fn counts(&self) -> Vec<f64> {
        self.hand.bus().stations().map(|station| station.rig().truth().counts).collect()
    }

    /// Takes the present places for the zeros of [`Self::gcl`]: HI presses the stops, whose gears give way by a count or two, so that the
    /// zeros are that far from the drawing's.
    pub fn mark_zeros(&mut self) {
        self.zeros = self.counts();
    }

    /// Where a motor, 1 to 7, truly is, GCL counts from the marked zero.
    pub fn gcl(&self, motor: usize) -> f64 {
        55.0 * (self.counts()[motor - 1] - self.zeros[motor - 1])
    }

    pub fn write(&mut self, bytes: &[u8]) {
        assert_eq!(self.hand.io().baud(), self.baud, "at another rate the hand would read garbage");
        self.line.put(bytes, &mut self.hand);
    }

    pub fn wait_ms(&mut self, ms: u64) {
        let until_us = self.hand.now_us() + 1_000 * ms;
        self.line.run_until(&mut self.hand, until_us, &mut self.heard, 1 << 16);
    }

    /// Reads exactly so many bytes; `None` at the timeout.
    pub fn read(&mut self, count: usize, timeout_ms: u64) -> Option<Vec<u8>> {
        for _ in 0..=timeout_ms {
            if self.heard.len() >= count {
                return Some(self.heard.drain(..count).collect());
            }
            self.wait_ms(1);
        }
        None
    }

    /// Reads up to and including `end`; `None` at the timeout.
    pub fn read_until(&mut self, end: &[u8], timeout_ms: u64) -> Option<Vec<u8>> {
        for _ in 0..=timeout_ms {
            if let Some(at) = self.heard.windows(end.len()).position(|bytes| bytes == end) {
                return Some(self.heard.drain(..at + end.len()).collect());
            }
            self.wait_ms(1);
        }
        None
    }

    /// Throws away what has come.
    pub fn clear(&mut self) {
        self.heard.clear();
    }

    pub fn unread(&self) -> &[u8] {
        &self.heard
    }
}
