//! Where packets begin and end among the bytes of the host (docs/wire.md, decision 0055).
//!
//! Bytes are framed as they arrive, not as they are read: a 0x03 in a packet is data, and any other is ^C, which takes effect at once.

use heapless::Vec;

/// ^C, outside of packets.
pub const ABORT: u8 = 3;

/// Silence after which a packet counts as broken off, µs: a byte takes 16.7 ms at 600 baud.
pub const SILENCE_US: u64 = 20_000;

/// Most data bytes: those of a CAN frame.
const MAX_DATA: u8 = 8;

/// Two bytes of identifier and one of length.
const HEADER: u8 = 3;

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
    /// The first of a packet.
    Head,
    /// Another of a packet.
    Data,
    /// Of a packet with a wrong length, or after it.
    Discarded,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    LineStart,
    Line,
    /// This many bytes of the header.
    Header(u8),
    /// This many data bytes are missing.
    Data(u8),
    /// After a wrong length or a lost byte no later byte can be trusted to begin a packet, until the host is silent.
    Discarding,
}

/// The state of the host's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Framing(State);

impl Framing {
    /// Takes the next byte. CR, LF and ^C end a line.
    pub fn accept(&mut self, byte: u8) -> Kind {
        let (state, kind) = match (self.0, byte) {
            (State::LineStart, head) if HEADS.contains(&head) => (State::Header(1), Kind::Head),
            (State::LineStart | State::Line, b'\r' | b'\n' | ABORT) => (State::LineStart, Kind::Text),
            (State::LineStart | State::Line, _) => (State::Line, Kind::Text),
            (State::Header(count), _) if count < HEADER - 1 => (State::Header(count + 1), Kind::Data),
            (State::Header(_), 0) | (State::Data(1), _) => (State::LineStart, Kind::Data),
            (State::Header(_), len @ 1..=MAX_DATA) => (State::Data(len), Kind::Data),
            (State::Data(missing), _) => (State::Data(missing.saturating_sub(1)), Kind::Data),
            (State::Header(_) | State::Discarding, _) => (State::Discarding, Kind::Discarded),
        };
        self.0 = state;
        kind
    }

    /// Whether [`SILENCE_US`] of silence end something: a packet that is not complete, or bytes that are discarded.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        matches!(self.0, State::Header(_) | State::Data(_) | State::Discarding)
    }

    /// Whether bytes are discarded.
    #[must_use]
    pub const fn is_discarding(&self) -> bool {
        matches!(self.0, State::Discarding)
    }

    /// A byte of a packet was lost: the rest is discarded.
    pub const fn discard(&mut self) {
        self.0 = State::Discarding;
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
            (b"\x00\x01\x09\x00\r\x03", "hd----"),
            (b"\x00\x01\x02\x30\x31\x00\x02\x01\x08", "hddddhddd"),
            (b"\x01\x00", "tt"),
        ] {
            assert_eq!(kinds(bytes), expected, "{bytes:?}");
        }
    }
}
