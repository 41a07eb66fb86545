//! How long a frame occupies the bus, bit stuffing counted: at 1 Mbit/s a bit is a microsecond (ISO 11898-1).

use tater_wire::Frame;

/// Bits of silence after every frame, error frames included.
pub const INTERMISSION: u64 = 3;

/// Most bits of an error frame: the flags of all stations (6, superposed to at most 12) and the delimiter.
pub const ERROR_FRAME: u64 = 12 + 8;

/// CRC delimiter, acknowledge slot and delimiter, end of frame: they are not stuffed.
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

/// The bits so far, as a transmitter counts them.
#[derive(Default)]
struct Bits {
    /// With the stuff bits.
    count: u64,
    last: bool,
    /// Equal bits up to now.
    run: u8,
    crc: u16,
}

impl Bits {
    /// The lowest `len` bits of a value, most significant first.
    fn push(&mut self, value: u16, len: u32) {
        for shift in (0..len).rev() {
            let bit = value >> shift & 1 == 1;
            let feedback = bit != (self.crc >> 14 & 1 == 1);
            self.crc = self.crc << 1 & 0x7FFF ^ if feedback { POLYNOMIAL } else { 0 };
            self.run = if self.count > 0 && bit == self.last { self.run + 1 } else { 1 };
            (self.last, self.count) = (bit, self.count + 1);
            if self.run == 5 {
                // The opposite bit is put in, and begins a run of its own.
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

    /// The same by another way: the whole frame as a text of bits, the CRC by long division, the stuffing by looking for
    /// runs of five.
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
        // 0x555, no data: 0 10101010101 000 0000 and the CRC's 15 bits. After the last one of the identifier 7 zeros: a stuff
        // bit after 5 of them, 2 left, and the CRC is 0x5F45 = 101 1111 0100 0101: one more inside 11111.
        assert_eq!(bits(&frame(0x555, &[])), 44 + 2);
    }

    #[test]
    fn eight_bytes_take_108_bits_and_at_most_24_stuff_bits() {
        // Bytes that alternate, and the lengths over many identifiers: the shortest are what a frame without stuffing takes
        // but for its 4 + 3 control bits, of which 3 + 1 zeros never make 5.
        let lengths: Vec<u64> = (0..0x800)
            .map(|id| bits(&frame(id, &[0xAA, 0x55, 0xAA, 0x55, 0x99, 0x66, 0x5A, 0xA5])))
            .collect();
        assert_eq!(lengths.iter().min(), Some(&(44 + 64)));
        assert_eq!(44 + 64 + INTERMISSION, 111, "the field's figure for eight bytes, intermission included");
        // Runs of 5, then of 4 that begin with the stuff bit: 0 0000, then 1111, 0000, ... The identifier 0x078 begins so,
        // the reserved bits and the length (8) leave the pattern, so that 24 stuff bits are a bound, not reached.
        for id in 0..0x800 {
            for fill in [0x00, 0xFF, 0x0F, 0xF0, 0x1E, 0x3C, 0x78, 0x87, 0xC3, 0xE1] {
                let bits = bits(&frame(id, &[fill; 8]));
                assert!((108..=108 + 24).contains(&bits), "{id:03X} {fill:02X}: {bits}");
            }
        }
        assert_eq!(
            bits(&frame(0x078, &[0x3C, 0x3C, 0x3C, 0x3C, 0x3C, 0x3C, 0x3C, 0x3C])),
            by_text(&frame(0x078, &[0x3C; 8]))
        );
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
