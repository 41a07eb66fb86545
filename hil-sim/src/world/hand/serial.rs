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
            if there_us > now_us || hand.io().rx_room() == 0 && !is_abort {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::plant::Model;
    use god::Memory;

    /// How finely it is looked, us.
    const FINE_US: u64 = 10;

    /// When each byte of an answer of so many comes after bytes were put on the line, us.
    fn times_us(line: &mut Serial, hand: &mut Hand, bytes: &[u8], answer: usize) -> Vec<u64> {
        let begin_us = hand.now_us();
        let (mut heard, mut times) = (Vec::new(), Vec::new());
        line.put(bytes, hand);
        while times.len() < answer {
            let after_us = hand.now_us() - begin_us;
            assert!(after_us < 1_000_000, "{heard:?} for {bytes:?}");
            line.run_until(hand, begin_us + after_us + FINE_US, &mut heard, 1024);
            times.resize(heard.len(), after_us + FINE_US);
        }
        assert_eq!(times.len(), answer, "{}", String::from_utf8_lossy(&heard));
        times
    }

    /// A hand that waits for a line.
    fn hand() -> Hand {
        let mut hand = Hand::new(Model::Averaged, 1, Memory::default());
        hand.run_until(1_000);
        assert!(hand.said().ends_with(b"=> "));
        hand
    }

    /// What FROB comes to after its echo.
    const ANSWER: &[u8] = b"\r\n\rERR 32\r\n\r=> ";

    #[test]
    fn a_byte_takes_ten_bits_of_baud_each_way() {
        let (mut hand, mut line) = (hand(), Serial::new(true));
        // 9600 Bd is the default (manual 5.4.1).
        for (order, answer, byte_us) in [("", 0, 1_041), ("PSET BAUD 384\r", 19, 260)] {
            times_us(&mut line, &mut hand, order.as_bytes(), answer);
            let times = times_us(&mut line, &mut hand, b"FROB\r", 4 + ANSWER.len());
            for (place, &time_us) in (2..).zip(&times) {
                // The first comes in and goes back; from then on one is behind the other, CR and the first of the answer like an echo.
                let due_us = byte_us * place;
                // GOD's next byte is looked for forty times a byte.
                let expected = due_us..=due_us + byte_us / 40 + 1 + FINE_US;
                assert!(expected.contains(&time_us), "{time_us} is not in {expected:?} us: {times:?}");
            }
        }
    }

    #[test]
    fn without_pace_all_is_there_at_once() {
        let (mut hand, mut line) = (hand(), Serial::new(false));
        let times = times_us(&mut line, &mut hand, b"FROB\r", 4 + ANSWER.len());
        assert_eq!(times, [FINE_US; 4 + ANSWER.len()]);
    }
}
