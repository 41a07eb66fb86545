//! What a Telnet client or a device server in Telnet mode puts between the bytes of a host (RFC 854): options are refused, the rest is
//! dropped, and Interrupt Process, Break and Abort Process are a break of the line.
//!
//! 0xFF is data in packets and in RealTime, and no character of a line. So it introduces a command of Telnet only where a line could
//! stand, and in RealTime where a block would begin (decision 0072). A client that doubles 0xFF in packets has to send raw TCP.

use god::framing::{Framing, Kind, SILENCE_US};

/// Introduces a command.
const IAC: u8 = 255;

const DONT: u8 = 254;
const DO: u8 = 253;
const WONT: u8 = 252;
const WILL: u8 = 251;
const SUBNEGOTIATION: u8 = 250;
const INTERRUPT_PROCESS: u8 = 244;
const BREAK: u8 = 243;
const END_OF_SUBNEGOTIATION: u8 = 240;
const ABORT_PROCESS: u8 = 238;
/// The lowest command (RFC 1184).
const FIRST_COMMAND: u8 = 236;

/// Longest subnegotiation that is skipped, bytes. A silence and a stop of Telnet end one as well: without its end it must not hide ^C.
const MAX_SUBNEGOTIATION: u8 = 128;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Data,
    /// After IAC.
    Command,
    /// After WILL, WONT, DO or DONT.
    Option(u8),
    /// So many bytes of a subnegotiation, and whether the last one was IAC.
    Sub(u8, bool),
}

/// What has arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// A byte for the hand.
    Byte(u8),
    /// A break of the line.
    Break,
    /// The refusal of an option, for the client.
    Answer([u8; 3]),
}

/// The state of a client's bytes.
#[derive(Debug, Default)]
pub struct Telnet {
    state: State,
    framing: Framing,
    /// After a NUL where a line could begin, such as that of CR NUL: no packet goes on with 0xFF.
    is_after_nul: bool,
    /// Time of the last byte, µs.
    last_us: u64,
}

impl Telnet {
    /// Takes bytes that arrive now, while the hand is in RealTime (`is_raw`) or not.
    pub fn accept(&mut self, bytes: &[u8], now_us: u64, is_raw: bool, mut each: impl FnMut(Heard)) {
        let is_silent = now_us.saturating_sub(self.last_us) >= SILENCE_US;
        self.last_us = now_us;
        if is_raw || is_silent && self.framing.is_open() {
            self.framing = Framing::default();
        }
        if is_silent && matches!(self.state, State::Sub(..)) {
            self.state = State::Data;
        }
        if is_raw {
            self.state = State::Data;
            // No block begins with this byte; one that is 20 ms late is broken off.
            let mut rest = bytes;
            while let [IAC, command, after @ ..] = rest
                && is_silent
                && *command >= FIRST_COMMAND
                && *command < WILL
            {
                if is_stop(*command) {
                    each(Heard::Break);
                }
                rest = after;
            }
            rest.iter().for_each(|&byte| each(Heard::Byte(byte)));
            return;
        }
        for &byte in bytes {
            self.accept_text(byte, &mut each);
        }
    }

    fn accept_text(&mut self, byte: u8, each: &mut impl FnMut(Heard)) {
        let is_in_packet = self.framing.is_open() && !self.framing.is_discarding() && !self.is_after_nul;
        self.state = match (self.state, byte) {
            (State::Data, IAC) if !is_in_packet => State::Command,
            (State::Data, _) => {
                self.pass(byte, each);
                State::Data
            }
            (State::Command, WILL..=DONT) => State::Option(byte),
            (State::Command, SUBNEGOTIATION) => State::Sub(0, false),
            (State::Command | State::Sub(_, true), command) if is_stop(command) => {
                self.framing = Framing::default();
                each(Heard::Break);
                State::Data
            }
            (State::Command, FIRST_COMMAND..=249) => State::Data,
            // An escaped 0xFF, or none of Telnet's: the hand judges it.
            (State::Command, _) => {
                self.pass(IAC, each);
                if byte != IAC {
                    self.pass(byte, each);
                }
                State::Data
            }
            (State::Option(verb), option) => {
                match verb {
                    WILL => each(Heard::Answer([IAC, DONT, option])),
                    DO => each(Heard::Answer([IAC, WONT, option])),
                    _ => {}
                }
                State::Data
            }
            (State::Sub(_, true), END_OF_SUBNEGOTIATION) | (State::Sub(MAX_SUBNEGOTIATION.., _), _) => {
                State::Data
            }
            (State::Sub(len, was_iac), _) => State::Sub(len + 1, byte == IAC && !was_iac),
        };
    }

    fn pass(&mut self, byte: u8, each: &mut impl FnMut(Heard)) {
        self.is_after_nul = self.framing.accept(byte) == Kind::Head && byte == 0;
        each(Heard::Byte(byte));
    }
}

const fn is_stop(command: u8) -> bool {
    matches!(command, INTERRUPT_PROCESS | BREAK | ABORT_PROCESS)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Data as it is, `<!>` for a break, `<254 1>` for a refusal.
    fn heard(telnet: &mut Telnet, bytes: &[u8], now_us: u64, is_raw: bool) -> String {
        let mut text = String::new();
        telnet.accept(bytes, now_us, is_raw, |heard| match heard {
            Heard::Byte(byte) => text.push(char::from(byte)),
            Heard::Break => text.push_str("<!>"),
            Heard::Answer([_, verb, option]) => text.push_str(&format!("<{verb} {option}>")),
        });
        text
    }

    fn of_text(bytes: &[u8]) -> String {
        heard(&mut Telnet::default(), bytes, 0, false)
    }

    #[test]
    fn commands_of_telnet_are_taken_out_of_lines() {
        for (bytes, expected) in [
            (&b"FGET P\r"[..], "FGET P\r"),
            (b"\xFF\xFB\x01\xFF\xFD\x03FGET P\r", "<254 1><252 3>FGET P\r"),
            (b"\xFF\xFC\x01\xFF\xFE\x03C\r", "C\r"),
            (b"FG\xFF\xF1ET\xFF\xF9 P\r", "FGET P\r"),
            (b"HI\r\xFF\xF4\xFF\xF2VERS\r", "HI\r<!>VERS\r"),
            (b"HI\r\0\xFF\xF4\xFF\xFD\x01C", "HI\r\0<!><252 1>C"),
            (b"\xFF\xF3", "<!>"),
            (b"\xFF\xEE", "<!>"),
            (b"\xFF\xFA\x1F\x00\x50\x03\xFF\xFF\x18\xFF\xF0C\r", "C\r"),
            (b"\xFF\xFA\x18\xFF\xF4C\r", "<!>C\r"),
            (b"C \xFF\xFF\r", "C \u{FF}\r"),
            (b"C \xFFA\r", "C \u{FF}A\r"),
        ] {
            assert_eq!(of_text(bytes), expected, "{bytes:?}");
        }
        // One that breaks off ends in silence.
        let mut telnet = Telnet::default();
        assert_eq!(heard(&mut telnet, b"\xFF\xFA\x18", 0, false), "");
        assert_eq!(heard(&mut telnet, b"\x03", SILENCE_US, false), "\x03");
        // A command may come in pieces.
        let mut telnet = Telnet::default();
        let pieces: String =
            b"\xFF\xFD\x01\xFF\xF4C".iter().map(|&byte| heard(&mut telnet, &[byte], 0, false)).collect();
        assert_eq!(pieces, "<252 1><!>C");
    }

    #[test]
    fn subnegotiation_without_an_end_is_given_up() {
        let mut bytes = b"\xFF\xFA".to_vec();
        bytes.extend([1; 200]);
        bytes.push(3);
        assert!(of_text(&bytes).ends_with('\u{3}'));
    }

    #[test]
    fn packets_and_blocks_keep_their_bytes() {
        // SET with data of 0xFF, and such that Telnet would take for commands.
        for data in [[0xFF; 4], [0xFF, 0xF4, 0xFF, 0xF3], [0xFF, 0xFB, 1, 3]] {
            let packet = [&[0, 4, 4][..], &data].concat();
            let text: String = packet.iter().map(|&byte| char::from(byte)).collect();
            assert_eq!(of_text(&packet), text);
            assert_eq!(of_text(&[&packet[..], b"\xFF\xF4"].concat()), format!("{text}<!>"));
            let mut telnet = Telnet::default();
            let block = [b"C".as_slice(), &data].concat();
            let text: String = block.iter().map(|&byte| char::from(byte)).collect();
            assert_eq!(heard(&mut telnet, &block, 1_000_000, true), text);
            // The rest of a block that TCP has split.
            let rest: String = data.iter().map(|&byte| char::from(byte)).collect();
            assert_eq!(heard(&mut telnet, &data, 1_000_000 + SILENCE_US - 1, true), rest);
            assert!(
                heard(&mut telnet, b"\xFF\xF4\xFF\xF2", 1_000_000 + 2 * SILENCE_US, true).starts_with("<!>")
            );
        }
        // In a packet with a wrong length, and after one that has broken off.
        assert_eq!(of_text(b"\0\x01\x09\x05\xFF\xF4"), "\0\u{1}\u{9}\u{5}<!>");
        let mut telnet = Telnet::default();
        assert_eq!(heard(&mut telnet, b"\0\x01\x04\x05", 0, false), "\0\u{1}\u{4}\u{5}");
        assert_eq!(heard(&mut telnet, b"\xFF\xF4", SILENCE_US, false), "<!>");
    }
}
