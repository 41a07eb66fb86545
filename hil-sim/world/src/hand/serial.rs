//! The serial line between a hand and its host: bytes wait until GOD has room, and on request each takes the ten bit times of
//! parameter BAUD (manual 5.4.1).

use std::collections::VecDeque;

use god::framing::{self, Framing, Kind};
use god::io::ABORT;

use super::{Hand, Motorized};

/// Bits per byte: start, eight data bits, stop.
const BITS: u64 = 10;

/// Poll interval while bytes wait for GOD on an unpaced line, µs.
const LOOK_US: u64 = 100;

/// The line and the bytes on it.
#[derive(Debug, Default)]
pub struct Serial {
    paced: bool,
    /// Of the bytes put on an unpaced line, to tell ^C from data of packets; and the time of the last one, µs.
    framing: Framing,
    put_us: u64,
    to_god: VecDeque<u8>,
    /// Arrival time of the byte on its way to GOD, µs.
    there_us: Option<u64>,
    /// The byte on its way to the host and its arrival time, µs.
    back: Option<(u8, u64)>,
}

impl Serial {
    /// A line at BAUD if `paced`, otherwise an infinitely fast one.
    #[must_use]
    pub fn new(paced: bool) -> Self {
        Self { paced, ..Self::default() }
    }

    /// Transmits bytes of the host. In text mode on an unpaced line ^C discards the bytes still waiting.
    pub fn put<S: Motorized>(&mut self, bytes: &[u8], hand: &mut Hand<S>) {
        if hand.io().is_raw() || hand.now_us() - self.put_us >= framing::SILENCE_US && self.framing.is_open()
        {
            self.framing = Framing::default();
        }
        self.put_us = hand.now_us();
        for &byte in bytes {
            let is_data = self.paced || hand.io().is_raw() || self.framing.accept(byte) != Kind::Text;
            if byte == ABORT && !is_data {
                self.to_god.clear();
                hand.interrupt();
            } else {
                self.to_god.push_back(byte);
            }
        }
    }

    /// Transmits a break condition, or a Telnet client's Interrupt Process or Break, which a device server makes one: aborts at once, whatever
    /// mode the line is in. Bytes of the host that are on the line are lost.
    pub fn put_break<S: Motorized>(&mut self, hand: &mut Hand<S>) {
        self.framing = Framing::default();
        self.to_god.clear();
        self.there_us = None;
        hand.push_break();
    }

    /// Bytes that have not reached GOD yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.to_god.len()
    }

    /// Whether no byte is on the line, in either direction.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.to_god.is_empty() && self.back.is_none()
    }

    /// The host disconnects: bytes in transit are lost.
    pub fn hang_up<S: Motorized>(&mut self, hand: &mut Hand<S>) {
        *self = Self::new(self.paced);
        hand.hang_up();
    }

    /// Advances hand and line to `until_us`. At most `room` received bytes are appended to `heard`; GOD waits with the rest.
    pub fn run_until<S: Motorized>(
        &mut self,
        hand: &mut Hand<S>,
        until_us: u64,
        heard: &mut Vec<u8>,
        room: usize,
    ) {
        let room = heard.len() + room;
        loop {
            self.exchange(hand, heard, room);
            let now_us = hand.now_us();
            if now_us >= until_us {
                return;
            }
            let next_us = if self.paced {
                let back_us = self.back.filter(|_| heard.len() < room).map(|(_, at)| at);
                // A byte that GOD sends between two polls is late by a fortieth of a byte time at most.
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

    fn byte_us<S: Motorized>(&self, hand: &Hand<S>) -> u64 {
        if self.paced { BITS * 10_000 / u64::from(hand.io().baud().max(1)) } else { 0 }
    }

    fn exchange<S: Motorized>(&mut self, hand: &mut Hand<S>, heard: &mut Vec<u8>, room: usize) {
        let (now_us, byte_us) = (hand.now_us(), self.byte_us(hand));
        while let Some(&byte) = self.to_god.front() {
            let there_us = *self.there_us.get_or_insert(now_us + byte_us);
            // GOD always has room for ^C.
            let is_abort = hand.io().is_abort(byte);
            if there_us > now_us || hand.io().rx_room() == 0 && !is_abort {
                break;
            }
            hand.push_rx(&[byte]);
            self.to_god.pop_front();
            self.there_us = None;
        }
        while heard.len() < room {
            let Some((byte, at_us)) = self.back.or_else(|| Some((hand.pop_tx()?, now_us + byte_us))) else {
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
    use crate::plant::Model;
    use god::Memory;

    const FINE_US: u64 = 10;

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

    fn hand() -> Hand {
        let mut hand = Hand::new(Model::Averaged, 1, Memory::default());
        hand.run_until(1_000);
        assert!(hand.take_tx().ends_with(b"=> "));
        hand
    }

    const ANSWER: &[u8] = b"\r\n\rERR 32\r\n\r=> ";

    #[test]
    fn paced_byte_takes_ten_bits_each_way() {
        let (mut hand, mut line) = (hand(), Serial::new(true));
        // 9600 Bd is the default (manual 5.4.1).
        for (order, answer, byte_us) in [("", 0, 1_041), ("PSET BAUD 384\r", 19, 260)] {
            times_us(&mut line, &mut hand, order.as_bytes(), answer);
            let times = times_us(&mut line, &mut hand, b"FROB\r", 4 + ANSWER.len());
            for (place, &time_us) in (2..).zip(&times) {
                // One byte time to GOD and one back for the first echo; after that the line carries one byte per byte time.
                let due_us = byte_us * place;
                // The line is polled forty times a byte.
                let expected = due_us..=due_us + byte_us / 40 + 1 + FINE_US;
                assert!(expected.contains(&time_us), "{time_us} is not in {expected:?} us: {times:?}");
            }
        }
    }

    #[test]
    fn unpaced_bytes_arrive_at_once() {
        let (mut hand, mut line) = (hand(), Serial::new(false));
        let times = times_us(&mut line, &mut hand, b"FROB\r", 4 + ANSWER.len());
        assert_eq!(times, [FINE_US; 4 + ANSWER.len()]);
    }
}
