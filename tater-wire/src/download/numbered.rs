//! The data of numbered frames, and the values of VERS that start a download.

/// SET VERS to this value starts a download with one character per frame.
pub const START: u16 = 0x00AA;

/// SET VERS to this value starts a download with numbered frames. For a board that ignores it, [`START`]
/// follows.
pub const START_NUMBERED: u16 = 0x01AA;

/// Characters in a numbered frame.
pub const CHARACTERS: usize = 8;

/// Number of characters before a numbered frame: 24 bits on the wire.
#[must_use]
pub const fn before(frame: u32) -> u32 {
    frame.wrapping_mul(CHARACTERS as u32)
}

/// The data of a numbered frame: frame `n` of a file contains its characters `8n` to `8n + 7` and the number
/// `n` modulo 256. Characters beyond the eighth are dropped, missing ones are 0.
#[must_use]
pub fn pack(number: u8, characters: &[u8]) -> [u8; CHARACTERS] {
    let mut data = [0; CHARACTERS];
    for (bit, byte) in (0u8..).zip(&mut data) {
        let character = characters.get(usize::from(bit)).map_or(0, |character| character & 0x7F);
        *byte = character | (number >> bit & 1) << 7;
    }
    data
}

/// Number and characters of a numbered frame; `None` for other data.
#[must_use]
pub fn unpack(data: &[u8]) -> Option<(u8, [u8; CHARACTERS])> {
    let mut characters = *<&[u8; CHARACTERS]>::try_from(data).ok()?;
    let mut number = 0;
    for (bit, byte) in (0u8..).zip(&mut characters) {
        number |= (*byte >> 7) << bit;
        *byte &= 0x7F;
    }
    Some((number, characters))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbered_frame_round_trips_number_and_characters() {
        for number in 0..=255 {
            assert_eq!(unpack(&pack(number, b"%09AZ_az")), Some((number, *b"%09AZ_az")));
            assert_eq!(unpack(&pack(number, b"8F")), Some((number, *b"8F\0\0\0\0\0\0")));
        }
        assert_eq!((before(0), before(3)), (0, 24));
        assert_eq!(pack(0x81, b"0123456789"), [0xB0, b'1', b'2', b'3', b'4', b'5', b'6', 0xB7]);
    }

    #[test]
    fn other_lengths_are_not_numbered_frames() {
        for len in (0..CHARACTERS).chain([9]) {
            assert_eq!(unpack(&[b'0'; 9][..len]), None);
        }
    }
}
