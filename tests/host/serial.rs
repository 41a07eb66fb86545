//! A program's serial port: bytes take their time at the program's baud rate, and every read has the program's timeout.

use god::Memory;
use hil_sim::hand::Hand;
use hil_sim::hand::serial::Serial;
use hil_sim::plant::Model;

pub(super) struct Port {
    pub hand: Hand,
    line: Serial,
    heard: Vec<u8>,
    /// The program's baud rate / 100.
    pub baud: u16,
}

impl Port {
    /// A hand at power-up, and a program at 9600 baud.
    pub fn open(memory: Memory) -> Self {
        let mut hand = Hand::new(Model::Averaged, 1, memory);
        hand.run_until(1_000);
        hand.take_tx();
        let baud = hand.io().baud();
        Self { hand, line: Serial::new(true), heard: Vec::new(), baud }
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
