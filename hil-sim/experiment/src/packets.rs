//! Packets in the output of a hand after `0 S REPLY 1` (docs/wire.md): told apart from text, and shown as hexadecimal digits.

use god::boards::parse_report;
use tater_wire::Frame;

/// First byte of a packet from a board, which is to a group; to a node it would be 0. Neither occurs in text.
const HEADS: [u8; 2] = [0x00, 0x04];

const HEADER: usize = 3;

/// Whether a byte of text begins a packet instead.
#[must_use]
pub fn is_head(byte: u8) -> bool {
    HEADS.contains(&byte)
}

/// Length of the packet at the start of these bytes; `None` if it is not complete.
#[must_use]
pub fn len(bytes: &[u8]) -> Option<usize> {
    let len = HEADER + usize::from(*bytes.get(2)?);
    (bytes.len() >= len).then_some(len)
}

/// The packet as hexadecimal digits, and what it says: `04 86 04 88 00 03 00 (4 MODE=3)`.
#[must_use]
pub fn text(packet: &[u8]) -> String {
    let digits: Vec<String> = packet.iter().map(|byte| format!("{byte:02X}")).collect();
    let meaning = meaning(packet).map(|meaning| format!(" ({meaning})"));
    digits.join(" ") + &meaning.unwrap_or_default()
}

/// What a packet says, as the hand prints it without REPLY 1: `4 MODE=3`.
#[must_use]
pub fn meaning(packet: &[u8]) -> Option<String> {
    let (&[high, low, _], data) = packet.split_first_chunk()?;
    let frame = Frame::from_raw(u16::from_be_bytes([high, low]), data)?;
    let (motor, property, value) = parse_report(&frame)?;
    Some(format!("{} {}={value}", motor.number(), property.row().name))
}
