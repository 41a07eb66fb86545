//! Barrett's API 4.4.3 by serial: its `Init` looks for the banner's words with a line end behind them, after it has cut off trailing blanks.
//! Compared with the plant.

use god::Memory;
use hil_world::hand::Motorized;

use board_emu::hand::boards;

use super::serial::{Port, native};
use crate::emulated::bench::production;

/// 15 s and 50 ms for each character.
const READ_MS: u64 = 15_000;

const BANNER: &str = "BarrettHand Firmware\n";

struct Api<S> {
    port: Port<S>,
}

impl<S: Motorized> Api<S> {
    /// The echo, the answer to `=> ` without blanks at its ends; the number behind ERR.
    fn call(&mut self, line: &str) -> Result<String, i32> {
        self.port.clear();
        self.port.write(format!("{line}\r").as_bytes());
        let limit_ms = READ_MS + 50 * line.len() as u64;
        let echo = self.port.read(line.len(), limit_ms);
        assert_eq!(echo.as_deref(), Some(line.as_bytes()), "the echo of {line}");
        if line == "RESET" {
            self.port.baud = 96;
        }
        let text = self.port.read_until(b"=> ", limit_ms).unwrap_or_else(|| panic!("no prompt after {line}"));
        let text: String = text.into_iter().map(char::from).collect();
        let text = text.trim_start().trim_end_matches("=> ").trim_end().to_owned();
        match text.strip_prefix("ERR ") {
            Some(code) => Err(code.split_whitespace().next().and_then(|code| code.parse().ok()).unwrap_or(0)),
            None => Ok(text),
        }
    }

    fn init(&mut self) {
        assert_eq!(self.call(""), Ok(String::new()), "clears errors");
        let banner = self.call("RESET").expect("no error");
        assert!(banner.contains(BANNER), "-9: {banner:?}");
        assert_eq!(self.call("HI"), Ok(String::new()));
        self.port.mark_zeros();
    }

    fn numbers(&mut self, line: &str) -> Vec<i64> {
        let text = self.call(line).unwrap_or_else(|code| panic!("{line}: ERR {code}"));
        text.split_whitespace().map(|word| word.parse().expect("a number")).collect()
    }

    fn is_at(&self, motors: &[usize], gcl: f64, line: &str) {
        for &motor in motors {
            let at = self.port.gcl(motor);
            // A hall count, and half of one that GOD rounds.
            assert!((at - gcl).abs() <= 82.5, "{line}: motor {motor} is at {at}");
        }
    }
}

const FINGERS: &[usize] = &[1, 2, 3];

fn drives<S: Motorized>(boards: Vec<S>) {
    let mut api = Api { port: Port::open(boards, Memory::default()) };
    api.init();
    for (line, motors, gcl) in [
        ("C", FINGERS, 18_205.0),
        ("O", FINGERS, 0.0),
        ("GM 5000", FINGERS, 5000.0),
        ("GIC 1000", FINGERS, 6000.0),
        ("GIO 2000", FINGERS, 4000.0),
        ("SM 3000", &[4], 3000.0),
        ("1M 12128", &[1], 12_128.0),
        ("GHOME", FINGERS, 0.0),
        ("SHOME", &[4], 0.0),
    ] {
        assert_eq!(api.call(line), Ok(String::new()), "{line}");
        api.is_at(motors, gcl, line);
    }
    // Each motor's DP, then M of all.
    for (prefix, position) in [("1", 2000), ("2", 4000), ("3", 6000), ("S", 1000)] {
        assert_eq!(api.call(&format!("{prefix}FSET DP {position}")), Ok(String::new()));
    }
    assert_eq!(api.call("M"), Ok(String::new()));
    for (motor, position) in [(1, 2000.0), (2, 4000.0), (3, 6000.0), (4, 1000.0)] {
        api.is_at(&[motor], position, "M");
    }
    let read = api.numbers("FGET P");
    for (motor, read) in [1, 2, 3, 4].into_iter().zip(read) {
        assert!((api.port.gcl(motor) - read as f64).abs() <= 55.0, "motor {motor} reads {read}");
    }
    assert_eq!(api.numbers("PGET TEMP")[0] / 10, 35);
    assert_eq!(api.call("BOGUS"), Err(32));
    assert_eq!(api.call("GT"), Ok(String::new()));
}

#[test]
fn barretts_api_by_serial_drives_a_native_hand() {
    drives(native());
}

#[test]
fn barretts_api_by_serial_drives_an_emulated_hand() {
    let Some(programs) = production() else { return };
    drives(boards(&programs));
}
