//! Length of a frame on the bus with stuff bits; at 1 Mbit/s a bit is a microsecond (ISO 11898-1).

use tater_wire::Frame;

/// Recessive bits after every frame, error frames included.
pub const INTERMISSION: u64 = 3;

/// Longest error frame: the superposed flags of all stations (at most 12 bits) and the delimiter.
pub const ERROR_FRAME: u64 = 12 + 8;

/// CRC delimiter, acknowledge slot and delimiter, end of frame: not stuffed.
const UNSTUFFED: u64 = 1 + 2 + 7;

/// x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1.
const POLYNOMIAL: u16 = 0x4599;

/// Bits from the start of frame to the end of frame, without the intermission: 44 + 8 a byte, and the stuff bits.
#[must_use]
pub fn bits(frame: &Frame) -> u64 {
    let mut head = Bits::default();
    head.push(0, 1);
    head.push(frame.raw_id(), 11);
    // Remote, extended and reserved bit, then the length.
    head.push(u16::try_from(frame.data().len()).unwrap_or(0), 3 + 4);
    for byte in frame.data() {
        head.push(u16::from(*byte), 8);
    }
    let crc = head.crc;
    head.push(crc, 15);
    head.count + UNSTUFFED
}

/// The first bit in which two frames of one identifier differ, counted from the start of frame with stuff bits, and whether that of the first frame is
/// recessive; `None` if they are equal.
#[must_use]
pub fn difference(one: &Frame, other: &Frame) -> Option<(u64, bool)> {
    let fields = |frame: &Frame| {
        let len = u16::try_from(frame.data().len()).unwrap_or(0);
        let bytes: Vec<u16> = frame.data().iter().map(|byte| u16::from(*byte)).collect();
        // Remote, extended and reserved bit, then the length.
        std::iter::once((len, 3 + 4)).chain(bytes.into_iter().map(|byte| (byte, 8)))
    };
    let mut head = Bits::default();
    head.push(0, 1);
    head.push(one.raw_id(), 11);
    for ((value, len), (other, _)) in fields(one).zip(fields(other)) {
        let differing = value ^ other;
        if differing != 0 {
            let below = differing.ilog2();
            head.push(value >> below >> 1, len - 1 - below);
            return Some((head.count + 1, value >> below & 1 == 1));
        }
        head.push(value, len);
    }
    None
}

#[derive(Default)]
struct Bits {
    /// Includes stuff bits.
    count: u64,
    last: bool,
    run: u8,
    crc: u16,
}

impl Bits {
    fn push(&mut self, value: u16, len: u32) {
        for shift in (0..len).rev() {
            let bit = value >> shift & 1 == 1;
            let feedback = bit != (self.crc >> 14 & 1 == 1);
            self.crc = self.crc << 1 & 0x7FFF ^ if feedback { POLYNOMIAL } else { 0 };
            self.run = if self.count > 0 && bit == self.last { self.run + 1 } else { 1 };
            (self.last, self.count) = (bit, self.count + 1);
            if self.run == 5 {
                // A stuff bit has the opposite level and starts a run of its own.
                (self.last, self.run, self.count) = (!bit, 1, self.count + 1);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame(id: u16, data: &[u8]) -> Frame {
        Frame::from_raw(id, data).expect("a classic frame")
    }

    /// Independent implementation: a string of bits, the CRC by long division, stuffing by a search for runs of five.
    fn by_text(frame: &Frame) -> u64 {
        let mut text = format!("0{:011b}000{:04b}", frame.raw_id(), frame.data().len());
        frame.data().iter().for_each(|byte| text.push_str(&format!("{byte:08b}")));
        let mut rest = 0u32;
        for bit in text.clone().chars().chain("0".repeat(15).chars()) {
            rest = rest << 1 | u32::from(bit == '1');
            if rest & 1 << 15 != 0 {
                rest ^= 1 << 15 | u32::from(POLYNOMIAL);
            }
        }
        text.push_str(&format!("{rest:015b}"));
        let mut sent = String::new();
        for bit in text.chars() {
            sent.push(bit);
            if sent.ends_with("00000") {
                sent.push('1');
            } else if sent.ends_with("11111") {
                sent.push('0');
            }
        }
        sent.len() as u64 + 10
    }

    #[test]
    fn hand_computed_frames() {
        // Host to itself, no data: 34 zeros (the CRC of zeros is 0). A stuffed one follows the first 5 zeros, then each
        // further 5: 6 stuff bits in 30, and 4 zeros left.
        assert_eq!(bits(&frame(0, &[])), 44 + 6);
        // 0x555, no data: 0 10101010101 000 0000, and the CRC 110 0111 0100 1100: one stuff bit, inside the 7 zeros.
        assert_eq!(bits(&frame(0x555, &[])), 44 + 1);
        // 0x014, one byte of 1: 0 00000010100 000 0001 00000001, and the CRC 111 0111 0101 0011: one stuff bit in the 7 zeros
        // at the beginning, one in the 5 of identifier and control, one in the 7 of the byte.
        assert_eq!(bits(&frame(0x014, &[1])), 44 + 8 + 3);
    }

    #[test]
    fn crc_matches_the_can_polynomial() {
        let mut head = Bits::default();
        b"123456789".iter().for_each(|byte| head.push(u16::from(*byte), 8));
        assert_eq!(head.crc, 0x059E, "the check value of CRC-15/CAN in catalogues");
    }

    #[test]
    fn eight_bytes_take_108_bits_and_at_most_24_stuff_bits() {
        let alternating = [0xAA, 0x55, 0xAA, 0x55, 0x99, 0x66, 0x5A, 0xA5];
        let shortest = (0..0x800).map(|id| bits(&frame(id, &alternating))).min();
        assert_eq!(shortest, Some(44 + 64), "some identifiers need no stuffing at all");
        assert_eq!(44 + 64 + INTERMISSION, 111, "the field's figure for eight bytes, intermission included");
        // 98 bits are stuffed: at most one in the first 5, then one in every 4: 24. The reserved bits and the length keep
        // frames below that.
        let mut longest = 0;
        for id in 0..0x800 {
            for fill in [0x00, 0xFF, 0x0F, 0xF0, 0x1E, 0x3C, 0x78, 0x87, 0xC3, 0xE1] {
                let bits = bits(&frame(id, &[fill; 8]));
                assert!((108..=108 + 24).contains(&bits), "{id:03X} {fill:02X}: {bits}");
                longest = longest.max(bits);
            }
        }
        assert!(longest > 108 + 16, "{longest}: 16 and more are easily had");
    }

    #[test]
    fn first_difference_is_counted_with_its_stuff_bits() {
        // 0x555 and a length of 1: 1 + 11 + 7 bits precede the byte, and a stuffed one after the first five of six zeros.
        let apart = |one: &[u8], other: &[u8]| difference(&frame(0x555, one), &frame(0x555, other));
        assert_eq!(apart(&[0b0101_0101], &[0b0101_0101]), None);
        assert_eq!(apart(&[0b0101_0101], &[0b0111_0101]), Some((20 + 3, false)));
        assert_eq!(apart(&[0b0111_0101], &[0b0101_0101]), Some((20 + 3, true)));
        assert_eq!(
            apart(&[0x55, 0x55], &[0x55]),
            Some((12 + 3 + 2 + 1 + 1, true)),
            "0010 and 0001, behind five zeros"
        );
        // Another stuffed one after five zeros of the byte.
        assert_eq!(apart(&[0b1000_0000], &[0b1000_0001]), Some((20 + 7 + 1 + 1, false)));
    }

    proptest! {
        #[test]
        fn any_frame_has_the_length_of_its_bits(id in 0u16..0x800, data in proptest::collection::vec(prop_oneof![any::<u8>(), Just(0), Just(0xFF)], 0..=8)) {
            let frame = frame(id, &data);
            prop_assert_eq!(bits(&frame), by_text(&frame));
            let fixed = 44 + 8 * data.len() as u64;
            prop_assert!((fixed..=fixed + (fixed - 11) / 4).contains(&bits(&frame)));
        }
    }
}
