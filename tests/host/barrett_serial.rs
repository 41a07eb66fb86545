//! The serial hosts of Barrett's own library and of programs like it: a BH8-262 that is found at any baud rate.
//!
//! They read as many echo bytes as they sent, skip white space and read to `=> `; others skip to the first LF, drop one character more, and
//! two before `=> `.

use god::Memory;
use hil_world::hand::Motorized;

use board_emu::hand::boards;

use super::serial::{Port, native};
use crate::emulated::bench::production;

/// 15 s and 50 ms for each character.
const READ_MS: u64 = 15_000;
/// Of a RealTime block.
const BLOCK_MS: u64 = 10_000;

struct Host<S> {
    port: Port<S>,
}

impl<S: Motorized> Host<S> {
    fn new(boards: Vec<S>) -> Self {
        Self { port: Port::open(boards, Memory::default()) }
    }

    /// Sends a line and reads the answer in both ways, which must agree.
    fn command(&mut self, line: &str) -> Result<String, u16> {
        self.port.write(format!("{line}\r").as_bytes());
        let limit_ms = READ_MS + 50 * line.len() as u64;
        let bytes =
            self.port.read_until(b"=> ", limit_ms).unwrap_or_else(|| panic!("no prompt after {line}"));
        let text: String = bytes.into_iter().map(char::from).collect();
        let counted = text[line.len()..].trim_start().trim_end_matches("=> ").trim().to_owned();
        let (_, after) = text.split_once('\n').expect("a LF");
        let skipped = after[1..].trim_end_matches("=> ");
        assert_eq!(skipped[..skipped.len().saturating_sub(2)].trim(), counted, "{text:?}");
        match counted.strip_prefix("ERR ") {
            Some(code) => Err(code.parse().expect("a number")),
            None => Ok(counted),
        }
    }

    fn numbers(&mut self, line: &str) -> Vec<i64> {
        let text = self.command(line).unwrap_or_else(|code| panic!("{line}: ERR {code}"));
        text.split_whitespace().map(|word| word.parse().expect("a number")).collect()
    }

    /// `Init` of Barrett's library: an empty line must succeed, and RESET at 9600 baud answer with its words and LF, once white space is trimmed
    /// from both ends.
    fn init(&mut self) -> bool {
        assert_eq!(self.command(""), Ok(String::new()));
        self.port.write(b"RESET\r");
        self.port.baud = 96;
        assert_eq!(self.port.read(5, READ_MS).as_deref(), Some(&b"RESET"[..]));
        let bytes = self.port.read_until(b"=> ", READ_MS).expect("a prompt");
        let text = String::from_utf8(bytes).expect("text");
        let is_white = |c: char| matches!(c, ' ' | '\r' | '\n' | '\t');
        let trimmed = text.trim_end_matches("=> ").trim_matches(is_white);
        assert!(!trimmed.starts_with("ERR"), "{trimmed:?}");
        trimmed.contains("BarrettHand Firmware\n")
    }

    /// The hand answers at the new rate; the host waits a second, clears and sends an empty line.
    fn set_baud(&mut self, baud: u16) {
        self.port.write(format!("PSET BAUD {baud}\r").as_bytes());
        self.port.baud = baud;
        self.port.wait_ms(1_000);
        self.port.clear();
        assert_eq!(self.command(""), Ok(String::new()), "{baud}");
    }
}

#[test]
fn barrett_host_finds_the_hand_and_resets_it() {
    let mut host = Host::new(native());
    host.port.write(b"\x03");
    assert_eq!(host.port.read_until(b"=> ", 1_500).as_deref(), Some(&b"\r\n\r=> "[..]));
    for baud in god::parameter::BAUDS {
        host.set_baud(baud as u16);
        assert_eq!(host.numbers("PGET BAUD"), [baud]);
    }
    // RESET ends at the stored rate, 9600.
    assert!(host.init());
    assert_eq!(host.port.hand.io().baud(), 96);
}

#[test]
fn barrett_host_moves_and_reads_parameters() {
    moves(Host::new(native()));
}

fn moves<S: Motorized>(mut host: Host<S>) {
    host.set_baud(384);
    for line in
        ["HI", "C", "O", "M 1000", "IC 500", "IO 500", "TC", "TO", "T", "HOME", "FDEF", "FSAVE", "FLOAD"]
    {
        assert_eq!(host.command(line), Ok(String::new()), "{line}");
    }
    for (line, count) in
        [("FGET P", 4), ("123FGET P", 3), ("SFGET P", 1), ("FGET S", 4), ("PGET TEMP", 1), ("1FGET BP", 1)]
    {
        assert_eq!(host.numbers(line).len(), count, "{line}");
    }
    // The flags that it reads before RealTime, and those that it sets, on a hand of either kind.
    for compat in ["0", "262"] {
        assert_eq!(host.command(&format!("PSET COMPAT {compat}")), Ok(String::new()));
        let flags = "LCV 1 LCVC 3 LCPG 0 LCT 0 LFV 1 LFVC 1 LFS 1 LFAP 1 LFDP 0 LFDPC 1 LFBP 0 LFAIN 0";
        assert_eq!(host.command(&format!("123SFSET {flags}")), Ok(String::new()));
        assert_eq!(host.command("PSET LFT 1 LFDPD 0"), Ok(String::new()));
        assert_eq!(
            host.numbers("1FGET LCV LCPG LCT LFV LFS LFAP LFDP LFBP LFAIN"),
            [1, 0, 0, 1, 1, 1, 0, 0, 0]
        );
    }
}

/// Velocity in; velocity, strain, position and temperature back, of all four.
#[test]
fn barrett_host_runs_realtime_with_compat_262() {
    runs_realtime(Host::new(native()));
}

#[test]
fn barrett_host_moves_and_runs_realtime_on_emulated_boards() {
    let Some(programs) = production() else { return };
    let mut host = Host::new(boards(&programs));
    assert!(host.init());
    moves(host);
    runs_realtime(Host::new(boards(&programs)));
}

fn runs_realtime<S: Motorized>(mut host: Host<S>) {
    host.set_baud(384);
    assert_eq!(host.command("PSET COMPAT 262 LFT 1"), Ok(String::new()));
    assert_eq!(host.command("HI"), Ok(String::new()));
    assert_eq!(
        host.command("123SFSET LCV 1 LCVC 3 LCPG 0 LFV 1 LFVC 1 LFS 1 LFAP 1 LFDP 0"),
        Ok(String::new())
    );
    host.port.write(b"123SLOOP\r");
    assert_eq!(host.port.read(9, READ_MS).as_deref(), Some(&b"123SLOOP*"[..]));
    let size = 1 + 4 * (1 + 1 + 2) + 1;
    let mut last = Vec::new();
    let begin_us = host.port.hand.now_us();
    for _ in 0..100 {
        host.port.write(b"C\x1E\x1E\x1E\x1E");
        last = host.port.read(size, BLOCK_MS).expect("a block");
    }
    let rate = 100e6 / (host.port.hand.now_us() - begin_us) as f64;
    println!("figure: a BH8-262's host at 38400 baud: {rate:.0} blocks/s of four motors");
    let position = |motor: usize| i16::from_be_bytes([last[3 + 4 * motor], last[4 + 4 * motor]]);
    assert!((0..4).all(|motor| position(motor) > 1_000), "{last:?}");
    assert_eq!(last[size - 1], 35);
    // RTAbort: ^C as a command of one character.
    host.port.write(b"\x03");
    assert_eq!(host.port.read_until(b"=> ", READ_MS).as_deref(), Some(&b"\r\n\r=> "[..]), "no ERR 16384");
    assert_eq!(host.numbers("FGET P").len(), 4);
}
