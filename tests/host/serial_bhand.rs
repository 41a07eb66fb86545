//! serial_bhand: a ROS node at 9600 baud that reads lines with a timeout of 100 ms, drops those with letters, takes the last number for the
//! answer, and sends motions one behind the other without waiting. Compared with the plant.

use god::Memory;
use hil_world::hand::Motorized;

use board_emu::hand::boards;

use super::serial::{Port, native};
use crate::emulated::bench::production;

const TIMEOUT_MS: u64 = 100;

/// Motors by their names, and their numbers.
const FINGERS: [(&str, usize); 4] = [("1", 1), ("2", 2), ("3", 3), ("S", 4)];

struct Connect<S> {
    port: Port<S>,
}

impl<S: Motorized> Connect<S> {
    /// Reads a byte first, to see that the port is there.
    fn command(&mut self, line: &str) {
        let _ = self.port.read(1, TIMEOUT_MS);
        self.port.write(format!("{line}\r").as_bytes());
    }

    /// Lines until none comes within the timeout.
    fn read_lines(&mut self) -> Vec<String> {
        let mut lines = Vec::new();
        while let Some(line) = self.port.read_until(b"\n", TIMEOUT_MS) {
            lines.push(String::from_utf8_lossy(&line).replace(['\r', '\n'], ""));
        }
        // What has no line end is a line too when the time is over.
        let rest = self.port.unread().to_vec();
        self.port.clear();
        lines.push(String::from_utf8_lossy(&rest).replace(['\r', '\n'], ""));
        lines
    }

    fn number(&mut self, line: &str) -> i64 {
        self.command(line);
        let lines = self.read_lines();
        let has_letters = |line: &String| line.chars().any(|character| character.is_ascii_alphabetic());
        let has_digits = |line: &String| line.chars().any(|character| character.is_ascii_digit());
        let number = lines.iter().rfind(|line| !has_letters(line) && has_digits(line));
        let number = number.unwrap_or_else(|| panic!("{line}: {lines:?}"));
        number.trim().parse().unwrap_or_else(|_| panic!("{line}: {lines:?}"))
    }

    fn are_at(&mut self, positions: [i64; 4], what: &str) {
        for ((name, motor), position) in FINGERS.into_iter().zip(positions) {
            let at = self.port.gcl(motor);
            assert!((at - position as f64).abs() <= 82.5, "{what}: {name} is at {at}, not {position}");
            let read = self.number(&format!("{name}FGET P"));
            assert!((at - read as f64).abs() <= 55.0, "{what}: {name} reads {read} at {at}");
        }
    }

    /// Its node publishes once a second; a motion takes as long as it takes.
    fn pass(&mut self, seconds: u64) {
        self.port.wait_ms(1_000 * seconds);
        self.read_lines();
    }
}

fn drives<S: Motorized>(boards: Vec<S>) {
    let mut hand = Connect { port: Port::open(boards, Memory::default()) };
    hand.command("HI");
    hand.pass(15);
    hand.port.mark_zeros();
    hand.are_at([0; 4], "HI");
    // A speed for each, opening and closing.
    for parameter in ["MOV", "MCV"] {
        for (name, _) in FINGERS {
            hand.command(&format!("{name}FSET {parameter} 400"));
        }
    }
    hand.pass(2);
    for (name, _) in FINGERS {
        assert_eq!(hand.number(&format!("{name}FGET MOV")), 400, "{name}");
    }
    // A position for each, one behind the other.
    let positions = [4000, 6000, 8000, 2000];
    for ((name, _), position) in FINGERS.into_iter().zip(positions) {
        hand.command(&format!("{name}M {position}"));
    }
    hand.pass(15);
    hand.are_at(positions, "positions");
    for (line, positions) in [
        ("123O", [0, 0, 0, 2000]),
        ("123C", [18_205, 18_205, 18_205, 2000]),
        ("123O", [0, 0, 0, 2000]),
        ("SC", [0, 0, 0, 9157]),
        ("SO", [0; 4]),
    ] {
        hand.command(line);
        hand.pass(8);
        hand.are_at(positions, line);
    }
    hand.command("123TC");
    hand.pass(8);
    assert!((1..=3).all(|motor| hand.port.gcl(motor) > 18_000.0), "to the stop");
}

#[test]
fn serial_bhand_drives_a_native_hand() {
    drives(native());
}

#[test]
fn serial_bhand_drives_an_emulated_hand() {
    let Some(programs) = production() else { return };
    drives(boards(&programs));
}
