use super::{Decoder, MAX_DATA, Record};
use crate::tek::tests::record;
use crate::tek::{TekError, TekErrorKind};
use proptest::prelude::*;
use std::{format, string::String, vec::Vec};

fn last(text: &str) -> Result<Option<(u64, Vec<u8>)>, TekError> {
    let mut decoder = Decoder::default();
    let mut given = None;
    for (i, character) in text.bytes().enumerate() {
        given = match decoder.push(character)? {
            None => None,
            Some(record) => {
                assert_eq!(i + 1, text.len(), "a record before its end");
                Some(match record {
                    Record::Data { address, bytes } => (address, bytes.to_vec()),
                    Record::End { entry } => (entry, Vec::new()),
                    Record::Symbols => (0, Vec::new()),
                })
            }
        };
    }
    Ok(given)
}

fn wrong(text: &str) -> (u32, TekErrorKind) {
    let error = last(text).expect_err("the text is wrong");
    (error.column, error.kind)
}

#[test]
fn records_of_other_programs_are_read() {
    // The example in the usual description of the format, and the termination that GNU objcopy writes.
    assert_eq!(last("1A626810000000202020202020"), Ok(Some((0x1000_0000, [0x20; 6].to_vec()))));
    assert_eq!(last("0781010"), Ok(Some((0, [].to_vec()))));
}

#[test]
fn addresses_of_every_width_are_read() {
    for digits in 1..=16_usize {
        let address = 0xFEDC_BA98_7654_3210_u64 >> (64 - 4 * digits);
        let count = digits % 16;
        let text = record('6', &format!("{count:X}{address:0digits$X}00FF"));
        assert_eq!(last(&text), Ok(Some((address, [0x00, 0xFF].to_vec()))), "{text}");
        let text = record('8', &format!("{count:X}{address:0digits$X}"));
        assert_eq!(last(&text), Ok(Some((address, [].to_vec()))), "{text}");
    }
}

#[test]
fn the_longest_and_the_shortest_records_are_read() {
    let text = record('6', &format!("10{}", "A5".repeat(MAX_DATA)));
    assert_eq!(&text[..2], "FF");
    assert_eq!(last(&text), Ok(Some((0, [0xA5; MAX_DATA].to_vec()))));
    assert_eq!(last(&record('6', "17")), Ok(Some((7, [].to_vec()))));
    assert_eq!(last("05308"), Ok(Some((0, [].to_vec()))));
    assert_eq!(last("203335*ABS*20_binary_a_bin_si227"), Ok(Some((0, [].to_vec()))), "from GNU objcopy");
    assert_eq!(last(&record('3', "5$%._z1")), Ok(Some((0, [].to_vec()))));
}

#[test]
fn each_defect_is_reported_with_its_position() {
    use TekErrorKind::*;
    let rows = [
        (String::from("G"), (2, Digit { found: b'G' })),
        ("4g".into(), (3, Digit { found: b'g' })),
        ("/".into(), (2, Character { found: b'/' })),
        ("04".into(), (2, Short { found: 4, expected: 5 })),
        ("00".into(), (2, Short { found: 0, expected: 5 })),
        ("066".into(), (2, Short { found: 6, expected: 7 })),
        ("068".into(), (2, Short { found: 6, expected: 7 })),
        ("077".into(), (4, Type { found: b'7' })),
        ("076X".into(), (5, Digit { found: b'X' })),
        ("0760_".into(), (6, Digit { found: b'_' })),
        ("0A6005".into(), (7, Digits { found: 5, expected: 4 })),
        ("0A6000".into(), (7, Digits { found: 16, expected: 4 })),
        ("0A6003".into(), (7, Odd { found: 1 })),
        ("0A8003".into(), (7, Tail { found: 10, expected: 9 })),
        ("0A60041a".into(), (9, Digit { found: b'a' })),
        ("0C60040000*".into(), (12, Character { found: b'*' })),
        ("0A3001 ".into(), (8, Character { found: b' ' })),
        ("*C3".into(), (2, Character { found: b'*' })),
        ("0C60040000\n".into(), (12, Character { found: b'\n' })),
        ("0781110".into(), (5, Checksum { found: 0x10, expected: 0x11 })),
        (record('6', "0FFFFFFFFFFFFFFFF0000"), (8, Wrap { address: u64::MAX, len: 2 })),
    ];
    for (text, expected) in rows {
        assert_eq!(wrong(&text), expected, "{text}");
    }
}

#[test]
fn last_record_is_there_until_the_next_begins() {
    let mut decoder = Decoder::default();
    assert_eq!(decoder.last(), None);
    for character in record('6', "81000000000").bytes() {
        decoder.push(character).expect("a record");
    }
    assert!(matches!(decoder.last(), Some(Record::Data { address: 0x1000_0000, bytes: [0] })), "{decoder:?}");
    decoder.push(b'0').expect("the first digit of a length");
    assert_eq!(decoder.last(), None);
}

#[test]
fn error_and_termination_persist() {
    let mut decoder = Decoder::default();
    let mut push = |text: &str| text.bytes().map(|c| decoder.push(c).map(|_| ())).last().unwrap();
    assert_eq!(push(&record('6', "81000000000")), Ok(()));
    let error = push("0A7").unwrap_err();
    assert_eq!((error.record, error.line, error.column), (2, 2, 4));
    assert_eq!(push(&record('6', "810000000FF")), Err(error));

    let mut decoder = Decoder::default();
    let mut push = |text: &str| text.bytes().map(|c| decoder.push(c).map(|_| ())).last().unwrap();
    assert_eq!(push(&record('8', "10")), Ok(()));
    let error = push("0").unwrap_err();
    assert_eq!(error.kind, TekErrorKind::AfterEnd { found: b'0' });
    assert_eq!((error.record, error.column), (2, 2));
}

fn noise() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![4 => prop::sample::select(b"0123456789ABCDEF368".to_vec()), 1 => any::<u8>()];
    prop::collection::vec(byte, 0..600)
}

proptest! {
    #[test]
    fn any_bytes_neither_panic_nor_give_false_records(bytes in noise()) {
        let mut decoder = Decoder::default();
        let mut from = 0;
        for (i, &byte) in bytes.iter().enumerate() {
            match decoder.push(byte) {
                Err(_) => break,
                Ok(None) => {}
                Ok(Some(given)) => {
                    let text = std::str::from_utf8(&bytes[from..=i]).unwrap();
                    let (kind, rest) = (char::from(bytes[from + 2]), &text[5..]);
                    prop_assert_eq!(text, record(kind, rest));
                    let len = if let Record::Data { bytes, .. } = given { bytes.len() } else { 0 };
                    prop_assert!(len <= MAX_DATA, "{} bytes", len);
                    from = i + 1;
                }
            }
        }
    }

    #[test]
    fn encoded_data_record_decodes_to_the_same(
        address in any::<u32>(),
        data in prop::collection::vec(any::<u8>(), 0..=120),
    ) {
        let hex: String = data.iter().map(|b| format!("{b:02X}")).collect();
        let text = record('6', &format!("8{address:08X}{hex}"));
        prop_assert_eq!(last(&text), Ok(Some((u64::from(address), data))));
    }
}

/// A wrong digit changes the sum by 1 to 15. In LL or in the number of address digits it is an error of another kind, or the
/// record ends elsewhere.
#[test]
fn one_wrong_digit_is_always_detected() {
    const RIGHT: &[u8; 26] = b"1A626810000000202020202020";
    for at in 0..RIGHT.len() {
        for &digit in b"0123456789ABCDEF" {
            let mut text = *RIGHT;
            text[at] = digit;
            let mut decoder = Decoder::default();
            let whole = text.iter().any(|&c| matches!(decoder.push(c), Ok(Some(_))));
            assert_eq!(whole, text == *RIGHT, "digit {at} as {}", char::from(digit));
        }
    }
}
