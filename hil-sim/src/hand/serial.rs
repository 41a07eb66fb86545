//! The serial line between a hand and its host: bytes wait for room at GOD, and, where it is asked for, each takes the ten bits that
//! it has at BAUD (manual 5.4.1).

use std::collections::VecDeque;

use god::io::ABORT;

use super::Hand;

/// Bits of a byte on the line: start, eight, stop.
const BITS: u64 = 10;

/// Looks between two ends of a stretch of time, us, where bytes wait for GOD and the line has no pace: it takes bytes at once.
const LOOK_US: u64 = 100;

/// The line, and what is on it.
#[derive(Debug, Default)]
pub struct Serial {
    paced: bool,
    to_god: VecDeque<u8>,
    /// When the byte that is on its way to GOD is there, us.
    there_us: Option<u64>,
    /// The byte on its way to the host, and when it is there, us.
    back: Option<(u8, u64)>,
}

impl Serial {
    /// A line whose bytes take their time if `paced`, and else none.
    #[must_use]
    pub fn new(paced: bool) -> Self {
        Self { paced, ..Self::default() }
    }

    /// The host puts bytes on the line. In text ^C goes before all that still waits, which it makes void.
    pub fn put(&mut self, bytes: &[u8], hand: &Hand) {
        for &byte in bytes {
            if byte == ABORT && !hand.io().is_raw() && !self.paced {
                self.to_god.clear();
            }
            self.to_god.push_back(byte);
        }
    }

    /// Bytes that have not come to GOD yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.to_god.len()
    }

    /// Whether nothing is on it.
    #[must_use]
    pub fn is_quiet(&self) -> bool {
        self.to_god.is_empty() && self.back.is_none()
    }

    /// The host has gone: what it has said and not heard is lost.
    pub fn hang_up(&mut self, hand: &mut Hand) {
        *self = Self::new(self.paced);
        hand.hang_up();
    }

    /// Lets time pass in a hand and on its line; what comes to the host is appended to `heard`, up to `room` bytes: GOD waits
    /// with the rest.
    pub fn run_until(&mut self, hand: &mut Hand, until_us: u64, heard: &mut Vec<u8>, room: usize) {
        let room = heard.len() + room;
        loop {
            self.exchange(hand, heard, room);
            let now_us = hand.now_us();
            if now_us >= until_us {
                return;
            }
            let next_us = if self.paced {
                let back_us = self.back.filter(|_| heard.len() < room).map(|(_, at)| at);
                // A byte that GOD begins to say in between is late by so much: a fortieth of one at 38400 Bd.
                let look_us = now_us + self.byte_us(hand) / 40 + 1;
                self.there_us.unwrap_or(u64::MAX).min(back_us.unwrap_or(look_us)).max(now_us + 1)
            } else if self.to_god.is_empty() {
                u64::MAX
            } else {
                now_us + LOOK_US
            };
            hand.run_until(next_us.min(until_us));
        }
    }

    fn byte_us(&self, hand: &Hand) -> u64 {
        if self.paced { BITS * 10_000 / u64::from(hand.io().baud().max(1)) } else { 0 }
    }

    /// What can go over the line now.
    fn exchange(&mut self, hand: &mut Hand, heard: &mut Vec<u8>, room: usize) {
        let (now_us, byte_us) = (hand.now_us(), self.byte_us(hand));
        while let Some(&byte) = self.to_god.front() {
            let there_us = *self.there_us.get_or_insert(now_us + byte_us);
            let is_abort = byte == ABORT && !hand.io().is_raw();
            if there_us > now_us || hand.io().room() == 0 && !is_abort {
                break;
            }
            hand.hear(&[byte]);
            self.to_god.pop_front();
            self.there_us = None;
        }
        while heard.len() < room {
            let Some((byte, at_us)) = self.back.or_else(|| Some((hand.say()?, now_us + byte_us))) else {
                break;
            };
            self.back = Some((byte, at_us));
            if at_us > now_us {
                break;
            }
            heard.push(byte);
            self.back = None;
        }
    }
}
