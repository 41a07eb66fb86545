//! Where packets begin and end among the bytes of the host (docs/wire.md, decision 0055).
//!
//! Bytes are framed as they arrive, not as they are read: a 0x03 in a whole packet is data, and any other is ^C, which takes effect at once,
//! or with the silence that shows that its packet is not whole.

use heapless::Vec;

/// ^C, outside of packets.
pub const ABORT: u8 = 3;

/// Silence after which a packet counts as broken off, µs: a byte takes 16.7 ms at 600 baud.
pub const SILENCE_US: u64 = 20_000;

/// Most data bytes: those of a CAN frame.
const MAX_DATA: u8 = 8;

/// From here on no identifier of a host goes on after 0x00: its sender is node 0, so that only the destination's five bits are left.
const MIN_NO_IDENTIFIER: u8 = 0x20;

/// Longest packet, bytes.
pub const LENGTH: usize = 11;

/// The bytes of a packet.
pub type Packet = Vec<u8, LENGTH>;

/// Bytes that begin a packet where a line would begin: the upper bits of a host's identifier, to a node and to a group.
const HEADS: [u8; 2] = [0x00, 0x04];

/// What a byte is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Of a line, or ^C.
    Text,
    /// The first of a packet, unless text follows: then it was a NUL of the line.
    Head,
    /// Another of a packet.
    Data,
    /// Of a packet with a wrong length, or after it.
    Discarded,
    /// The same, and ^C: nobody can tell whether it was meant as data, and a motor that stands does no harm.
    Stop,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    LineStart,
    Line,
    /// After this byte of [`HEADS`].
    Head(u8),
    /// After the identifier.
    Identifier,
    /// This many data bytes are missing.
    Data(u8),
    /// After a wrong length or a lost byte no later byte can be trusted to begin a packet, until the host is silent.
    Discarding,
}

/// The state of the host's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Framing {
    state: State,
    /// Whether 0x03 is among the bytes since the last head: if the packet breaks off, it is ^C. Of those that are discarded, since the last line
    /// end: its answer is that of ^C, and a line behind it has a host that waits for another.
    has_abort: bool,
}

impl Framing {
    /// Takes the next byte. CR, LF and ^C end a line. A NUL is no head if no identifier follows: Telnet ends a line by CR NUL.
    pub fn accept(&mut self, byte: u8) -> Kind {
        let (state, kind) = match (self.state, byte) {
            (State::LineStart, head) if HEADS.contains(&head) => (State::Head(head), Kind::Head),
            (State::LineStart | State::Line, b'\r' | b'\n' | ABORT) => (State::LineStart, Kind::Text),
            (State::LineStart | State::Line, _) | (State::Head(0), MIN_NO_IDENTIFIER..) => {
                (State::Line, Kind::Text)
            }
            // Fillers behind CR, as slow printers needed them. No packet is for node 0, the host.
            (State::Head(0), 0) => (State::Head(0), Kind::Head),
            (State::Head(_), _) => (State::Identifier, Kind::Data),
            (State::Identifier, 0) | (State::Data(1), _) => (State::LineStart, Kind::Data),
            (State::Identifier, len @ 1..=MAX_DATA) => (State::Data(len), Kind::Data),
            (State::Data(missing), _) => (State::Data(missing.saturating_sub(1)), Kind::Data),
            (State::Identifier, _) if self.has_abort => (State::Discarding, Kind::Stop),
            (State::Discarding, ABORT) => (State::Discarding, Kind::Stop),
            (State::Identifier | State::Discarding, _) => (State::Discarding, Kind::Discarded),
        };
        self.has_abort = match state {
            State::LineStart | State::Line | State::Head(_) => false,
            State::Discarding if self.is_discarding() && matches!(byte, b'\r' | b'\n') => false,
            State::Identifier | State::Data(_) | State::Discarding => self.has_abort || byte == ABORT,
        };
        self.state = state;
        kind
    }

    /// Whether [`SILENCE_US`] of silence end something: a packet that is not complete, or bytes that are discarded.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        matches!(self.state, State::Head(_) | State::Identifier | State::Data(_) | State::Discarding)
    }

    /// Whether bytes are discarded.
    #[must_use]
    pub const fn is_discarding(&self) -> bool {
        matches!(self.state, State::Discarding)
    }

    /// Whether 0x03 is among the bytes of the packet that is not complete, or of those that are discarded.
    #[must_use]
    pub const fn has_abort(&self) -> bool {
        self.has_abort
    }

    /// A byte of a packet was lost: the rest is discarded.
    pub const fn discard(&mut self) {
        self.state = State::Discarding;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(bytes: &[u8]) -> std::string::String {
        let mut framing = Framing::default();
        let letter = |&byte: &u8| match framing.accept(byte) {
            Kind::Text => 't',
            Kind::Head => 'h',
            Kind::Data => 'd',
            Kind::Discarded => '-',
            Kind::Stop => '!',
        };
        bytes.iter().map(letter).collect()
    }

    #[test]
    fn bytes_are_text_packet_or_discarded() {
        for (bytes, expected) in [
            (&b"\x00\x01\x01\x30"[..], "hddd"),
            (b"\x04\x04\x01\x03C\r", "hdddtt"),
            (b"\x04\x04\x00C\x00\r\x00", "hddttth"),
            (b"C\x04\x01\x01\r\n\x04", "tttttth"),
            (b"\x03\x00\x03\x08\x03\x03\x03\x03\x03\x03\x03\x03\x03", "thddddddddddt"),
            (b"\x00\x01\x09\x00\r\x03\x00\x03", "hd---!-!"),
            (b"\x00\x03\x09\x00", "hd!-"),
            // CR NUL of Telnet; a NUL within a line.
            (b"\r\0FGET\0\r\0\x1F\x01\x30\0 \x7F", "thtttttthdddhtt"),
            (b"\x04\x20\x00", "hdd"),
            (b"\0\0\0A\r\0\0\x01\x01\x30", "hhhtthhddd"),
            (b"\x00\x01\x02\x30\x31\x00\x02\x01\x08", "hddddhddd"),
            (b"\x01\x00", "tt"),
        ] {
            assert_eq!(kinds(bytes), expected, "{bytes:?}");
        }
    }

    #[test]
    fn packet_remembers_an_abort_until_it_is_whole() {
        for (bytes, has_abort) in [
            (&b"\x03"[..], false),
            (b"\x00", false),
            (b"\x00\x03", true),
            (b"\x00\x03\x01", true),
            (b"\x00\x03\x01\x30", false),
            (b"\x00\x01\x03\x03", true),
            (b"\x00\x01\x03\x05\x06", true),
            (b"\x00\x01\x02\x05", false),
            (b"\x00\x01\x03\x05\x06\x07\x00\x01", false),
            (b"\x00\x01\x09\x03\x00", true),
            (b"\x00\x03\r", true),
            (b"\x00\x01\x09\x03C\r", false),
            (b"\x00\x01\x09C\r\x03", true),
        ] {
            let mut framing = Framing::default();
            bytes.iter().for_each(|&byte| _ = framing.accept(byte));
            assert_eq!(framing.has_abort(), has_abort, "{bytes:?}");
            framing.discard();
            assert_eq!(framing.has_abort(), has_abort, "{bytes:?}, and a lost byte");
        }
    }
}
