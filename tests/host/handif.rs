//! The MIT handif: 38400 baud; supervisory answers from the first LF, one character more, to two before `=>`; RealTime with gains, strain and
//! two bytes of position, a byte each 20 ms and a second for a block. Compared with the plant.

use god::Memory;
use hil_world::hand::Motorized;

use board_emu::hand::boards;

use super::serial::{Port, native};
use crate::emulated::bench::production;

/// It has no time limit for a command.
const FOREVER_MS: u64 = 60_000;
const BLOCK_MS: u64 = 1_000;
const BYTE_MS: u64 = 20;

struct Handif<S> {
    port: Port<S>,
}

impl<S: Motorized> Handif<S> {
    /// A hand that has been set up for it once: 38400 baud and COMPAT 262, kept.
    fn connect(boards: impl Fn() -> Vec<S>) -> Self {
        let mut port = Port::open(boards(), Memory::default());
        for line in ["PSET COMPAT 262", "PSAVE"] {
            port.write(format!("{line}\r").as_bytes());
            port.read_until(b"=> ", FOREVER_MS).expect("a prompt");
        }
        let mut hand = Self { port: Port::open(boards(), Memory::new(port.hand.memory().stored())) };
        hand.port.write(b"PSET BAUD 384\r");
        hand.port.baud = 384;
        hand.port.wait_ms(1_000);
        assert_eq!(hand.command(""), "", "pressing Enter");
        hand
    }

    /// It sleeps 10 ms between two commands, and flushes its input.
    fn command(&mut self, line: &str) -> String {
        self.port.wait_ms(10);
        self.port.clear();
        self.port.write(format!("{line}\r").as_bytes());
        let text =
            self.port.read_until(b"=>", FOREVER_MS).unwrap_or_else(|| panic!("no prompt after {line}"));
        let text = &text[..text.len() - 4];
        // Without a LF there is the echo alone.
        let lf = text.iter().position(|&byte| byte == b'\n');
        let answer = lf.and_then(|at| text.get(at + 2..)).unwrap_or(&[]);
        String::from_utf8_lossy(answer).trim().to_owned()
    }

    fn numbers(&mut self, line: &str) -> Vec<i64> {
        let text = self.command(line);
        let number = |word: &str| word.parse().unwrap_or_else(|_| panic!("{line}: {text:?}"));
        text.split_whitespace().map(number).collect()
    }

    /// The acknowledgement is the first `*` or LF; a block comes a byte each 20 ms.
    fn realtime(&mut self, bytes: &[u8], len: usize) -> Vec<u8> {
        self.port.clear();
        self.port.write(bytes);
        let star = (0..BLOCK_MS)
            .find_map(|_| self.port.read(1, 1).filter(|byte| matches!(byte[..], [b'*' | b'\n'])));
        assert_eq!(star.as_deref(), Some(&b"*"[..]), "after {bytes:?}");
        let mut block = Vec::new();
        while block.len() < len {
            block.extend(self.port.read(1, BYTE_MS).expect("a byte of the block"));
        }
        block
    }

    fn are_at(&self, goals: &[(usize, f64)], what: &str) {
        for &(motor, gcl) in goals {
            let at = self.port.gcl(motor);
            assert!((at - gcl).abs() <= 82.5, "{what}: motor {motor} is at {at}, not {gcl}");
        }
    }

    /// Spread, fingers 1 to 3, and the spread again.
    fn set_positions(&mut self, positions: [i32; 4]) {
        for place in [0, 1, 2, 3, 0] {
            let motor = ["S", "1", "2", "3"][place];
            assert_eq!(self.command(&format!("{motor}M {}", positions[place])), "");
        }
        let goal = |place: usize| (if place == 0 { 4 } else { place }, f64::from(positions[place]));
        self.are_at(&[goal(0), goal(1), goal(2), goal(3)], "positions");
    }
}

fn drives<S: Motorized>(mut hand: Handif<S>) {
    assert_eq!(hand.command("HI"), "");
    hand.port.mark_zeros();
    for line in ["GO", "SO"] {
        assert_eq!(hand.command(line), "", "{line}");
    }
    assert_eq!(hand.command("GM 5000"), "");
    hand.are_at(&[(1, 5000.0), (2, 5000.0), (3, 5000.0)], "GM 5000");
    assert_eq!(hand.command("3M 0"), "");
    hand.set_positions([0, 5000, 10_000, 15_000]);
    let read = hand.numbers("FGET P");
    for (motor, read) in [1, 2, 3, 4].into_iter().zip(&read) {
        assert!((hand.port.gcl(motor) - *read as f64).abs() <= 55.0, "{read:?}");
    }
    // Angles by the ratio of the earlier hand, 125 and 17.5 counts a degree: pi, pi/3, pi/4, pi/5.
    hand.set_positions([3150, 7500, 5625, 4500]);
    for (line, count) in [("123FGET BS", 3), ("123FGET BP", 3), ("123FGET SG", 3)] {
        assert_eq!(hand.numbers(line).len(), count, "{line}");
    }
    assert_eq!(hand.command("GC"), "");
    assert_eq!(hand.command("GO"), "");
    // RealTime: closing at 20 x LCVC 1, then opening at 50.
    assert_eq!(hand.command("123FSET LCV 1 LCVC 1 LCPG 1 LFV 0 LFS 1 LFAP 1 LFDP 0 LFDPC 1"), "");
    hand.realtime(b"123LOOP\r", 0);
    let position = |block: &[u8], finger: usize| {
        f64::from(i16::from_be_bytes([block[3 * finger + 1], block[3 * finger + 2]]))
    };
    for (velocity, blocks) in [(20_i8, 35), (-50, 20)] {
        let before: Vec<f64> = (1..=3).map(|motor| hand.port.gcl(motor)).collect();
        let begin_us = hand.port.hand.now_us();
        let velocity_byte = velocity.cast_unsigned();
        let mut block = Vec::new();
        for _ in 0..blocks {
            block = hand.realtime(&[b'C', velocity_byte, 100, velocity_byte, 100, velocity_byte, 100], 9);
        }
        let seconds = (hand.port.hand.now_us() - begin_us) as f64 * 1e-6;
        for (finger, before) in before.iter().enumerate() {
            let at = hand.port.gcl(finger + 1);
            let moved = at - before;
            let wanted = 55.0 * f64::from(velocity) * seconds;
            // The first block's start and the last one's end; the joint's stop.
            assert!(
                (moved - wanted).abs() <= 0.1 * wanted.abs() + 110.0 || at < -1300.0,
                "{moved} of {wanted} GCL counts"
            );
            assert!(
                (position(&block, finger) - at).abs() <= 110.0,
                "finger {finger}: {} at {at}",
                position(&block, finger)
            );
        }
    }
    // ^C with the CR that it adds to every command.
    hand.command("\x03");
    assert_eq!(hand.numbers("FGET P").len(), 4);
    assert_eq!(hand.command("T"), "");
}

#[test]
fn handif_drives_a_native_hand() {
    drives(Handif::connect(native));
}

#[test]
fn handif_drives_an_emulated_hand() {
    let Some(programs) = production() else { return };
    drives(Handif::connect(|| boards(&programs)));
}
