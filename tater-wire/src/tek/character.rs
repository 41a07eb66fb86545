//! The values of characters.

/// A character's contribution to a checksum; `None` if it cannot be in a record.
#[must_use]
pub const fn value(character: u8) -> Option<u8> {
    match character {
        b'0'..=b'9' => Some(character - b'0'),
        b'A'..=b'Z' => Some(character - b'A' + 10),
        b'$' => Some(36),
        b'%' => Some(37),
        b'.' => Some(38),
        b'_' => Some(39),
        b'a'..=b'z' => Some(character - b'a' + 40),
        _ => None,
    }
}

/// Value of a hexadecimal digit; lower case is not one.
pub(super) const fn digit(character: u8) -> Option<u8> {
    match value(character) {
        Some(value) if value < 16 => Some(value),
        _ => None,
    }
}
