//! Files: the encoder's output, and the reader's input in each dialect.

use super::{Decoder, Dialect, Encoder, Foreign, Reader, Record, TekError, TekErrorKind, end, value};
use proptest::prelude::*;
use std::{collections::BTreeMap, format, string::String, vec, vec::Vec};

/// `LLTCC...` of a type and the text after the checksum.
pub(super) fn record(kind: char, rest: &str) -> String {
    let len = rest.len() + 5;
    let sum: u32 = format!("{len:02X}{kind}{rest}").bytes().map(|c| u32::from(value(c).unwrap())).sum();
    format!("{len:02X}{kind}{:02X}{rest}", sum % 256)
}

/// A byte for each address, and the entry.
type Image = (BTreeMap<u64, u8>, Option<u64>);

fn take(image: &mut Image, record: Option<Record<'_>>) {
    match record {
        Some(Record::Data { address, bytes }) => image.0.extend((address..).zip(bytes.iter().copied())),
        Some(Record::End { entry }) => image.1 = Some(entry),
        Some(Record::Symbols) | None => {}
    }
}

fn read(file: &[u8], dialect: Dialect) -> Result<Image, TekError> {
    let (mut reader, mut image) = (Reader::new(dialect), Image::default());
    for &byte in file {
        take(&mut image, reader.push(byte)?);
    }
    take(&mut image, reader.finish()?);
    Ok(image)
}

/// The monitor's view of a file: of each line the characters after the first, up to one below '0'.
fn streamed(file: &[u8]) -> Result<Image, TekError> {
    let (mut decoder, mut image) = (Decoder::default(), Image::default());
    for line in file.split_inclusive(|&c| c == b'\n') {
        for &character in line[1..].iter().take_while(|&&c| c >= b'0') {
            take(&mut image, decoder.push(character)?);
        }
    }
    Ok(image)
}

fn pieces() -> impl Strategy<Value = Vec<(u32, Vec<u8>)>> {
    prop::collection::vec((0..100_u32, prop::collection::vec(any::<u8>(), 1..200)), 0..8)
}

fn encode(base: u32, pieces: &[(u32, Vec<u8>)], entry: u32) -> (Vec<u8>, Image) {
    let (mut file, mut bytes, mut address) = (Vec::new(), BTreeMap::new(), base);
    for (gap, piece) in pieces {
        address += gap;
        bytes.extend((u64::from(address)..).zip(piece.iter().copied()));
        for line in Encoder::new(address, piece).unwrap() {
            file.extend_from_slice(line.as_bytes());
        }
        address += u32::try_from(piece.len()).unwrap();
    }
    file.extend_from_slice(end(entry).as_bytes());
    (file, (bytes, Some(u64::from(entry))))
}

fn line_end() -> impl Strategy<Value = &'static str> {
    prop::sample::select(vec!["\n", "\r", "\r\n", " \r\n", "\t\n", "  \t \r", "\r\r\n", "\n\n", "\r\n \r\n"])
}

proptest! {
    #[test]
    fn images_with_gaps_survive_encode_and_read(base in 0..0xFFFF_0000_u32, pieces in pieces(), entry in any::<u32>()) {
        let (file, image) = encode(base, &pieces, entry);
        prop_assert_eq!(read(&file, Dialect::Ti), Ok(image.clone()));
        prop_assert_eq!(read(&file, Dialect::Gnu), Ok(image.clone()));
        prop_assert_eq!(streamed(&file), Ok(image));
    }

    /// Hosts stop at a character below '0' and read no more than 98 characters.
    #[test]
    fn encoded_files_are_downloadable_by_hosts(base in 0..0xFFFF_0000_u32, pieces in pieces()) {
        let (file, _) = encode(base, &pieces, base);
        for line in file.split_inclusive(|&c| c == b'\n') {
            let text = line.strip_suffix(b"\r\n").and_then(|line| line.strip_prefix(b"%")).unwrap();
            prop_assert!(text.iter().all(|&c| c >= b'0') && text.len() <= 78);
        }
    }

    #[test]
    fn any_bytes_do_not_panic(noise in prop::collection::vec(any::<u8>(), 0..400), at in 0..200_usize) {
        let pieces: [(u32, Vec<u8>); 1] = [(0, Vec::from([1; 80]))];
        let (mut file, _) = encode(0, &pieces, 0);
        file.splice(at..at, noise);
        for dialect in [Dialect::Ti, Dialect::Gnu] {
            let _ = read(&file, dialect);
        }
    }

    /// A truncated file is detected in each dialect; only the last line's end may be missing.
    #[test]
    fn truncated_file_is_detected(pieces in pieces(), part in 0..1000_usize) {
        let (mut file, _) = encode(0, &pieces, 0);
        file.truncate(file.len() * part / 1000);
        let whole = file.ends_with(b"%0E81E800000000") || file.ends_with(b"%0E81E800000000\r");
        for dialect in [Dialect::Ti, Dialect::Gnu] {
            prop_assert_eq!(read(&file, dialect).is_err(), !whole);
        }
    }

    /// Whatever ends the lines, stands behind them or follows the last one, the records are the same.
    #[test]
    fn line_ends_blanks_and_padding_change_no_record(
        pieces in pieces(),
        ends in prop::collection::vec(line_end(), 1..8),
        mark in prop::sample::select(vec!["", "\u{FEFF}"]),
        repeated in 0..3_usize,
        tail in prop::sample::select(vec!["", "\x1A", "\x1A\x1A\x1A", "\n\0\0", "\r\n\r\n", "  ", "\n\x1A"]),
    ) {
        let (file, image) = encode(0, &pieces, 7);
        let mut lines: Vec<&str> = core::str::from_utf8(&file).unwrap().lines().collect();
        let last = lines[lines.len() - 1];
        lines.extend(core::iter::repeat_n(last, repeated));
        let with_ends = lines.iter().zip(ends.iter().cycle()).flat_map(|(line, end)| [*line, *end]);
        let mut text: String = core::iter::once(mark).chain(with_ends).collect();
        for last_end in [true, false] {
            if !last_end {
                text.truncate(text.trim_end().len());
            }
            let text = format!("{text}{tail}");
            for dialect in [Dialect::Ti, Dialect::Gnu] {
                prop_assert_eq!(read(text.as_bytes(), dialect), Ok(image.clone()), "{:?}", text);
            }
        }
    }
}

#[test]
fn encoded_lines_match_the_published_example() {
    let line = Encoder::new(0x1000_0000, &[0x20; 6]).unwrap().next().unwrap();
    assert_eq!(line.as_bytes(), b"%1A626810000000202020202020\r\n");
    let full = Encoder::new(0, &[0xFF; 33]).unwrap().next().unwrap();
    assert_eq!(full.as_bytes().len(), 79 + 2);
    assert!(full.as_bytes().starts_with(b"%4E6"));
}

#[test]
fn last_address_is_encoded_and_none_after_it() {
    let last = u32::MAX - 32;
    assert_eq!(Encoder::new(last, &[0; 33]).unwrap().count(), 2);
    assert!(Encoder::new(last, &[0; 34]).is_none());
    assert_eq!(Encoder::new(u32::MAX, &[]).unwrap().count(), 0);
}

/// Output of GNU objcopy 2.40 for 39 bytes: LF, a section, padding.
const GNU: &str = "%4D6787800400068656C6C6F20776F726C64203031323334353637383920616263646566676869\n\
                   %4D6A2780040206A6B6C6D6E6F7000000000000000000000000000000000000000000000000000\n\
                   %1C3215.data17800400078004027\n\
                   %0781010\n";

#[test]
fn gnu_objcopy_file_is_read_with_its_section() {
    let mut reader = Reader::new(Dialect::Gnu);
    let (mut image, mut sections) = (Image::default(), Vec::new());
    for byte in GNU.bytes() {
        take(&mut image, reader.push(byte).unwrap());
        let section = reader.section();
        assert!(section.is_none() || byte == b'\n', "before the end of its record");
        sections.extend(section);
    }
    assert_eq!(reader.finish(), Ok(None));
    assert_eq!(image.1, Some(0));
    assert_eq!((sections.len(), &sections[0]), (1, &(0x0800_4000..0x0800_4027)));
    let text = b"hello world 0123456789 abcdefghijklmnop";
    assert_eq!(text.len(), 39);
    let inside: Vec<u8> = image.0.range(0x0800_4000..0x0800_4027).map(|(_, &byte)| byte).collect();
    assert_eq!(inside, text);
}

#[test]
fn symbol_records_without_a_section_are_skipped() {
    let mut reader = Reader::new(Dialect::Gnu);
    let mut records = 0;
    // Also from GNU objcopy 2.40.
    for byte in "%1F3EF5.data40_binary_a_bin_st10\n%203335*ABS*20_binary_a_bin_si227\n%0530".bytes() {
        if let Some(record) = reader.push(byte).unwrap() {
            records += 1;
            assert_eq!(record, Record::Symbols);
            assert_eq!(reader.section(), None);
        }
    }
    assert_eq!(records, 2);
}

#[test]
fn strict_dialect_reports_what_the_other_accepts() {
    use TekErrorKind::*;
    let (crlf, none) = (format!("%{}\r\n", record('8', "800000000")), String::new());
    let data = |rest: &str| format!("%{}\r\n", record('6', rest));
    let rows = [
        (format!("%{}\r\n", record('8', "10")), &none, 7, AddressWidth { found: 1 }),
        (data("70000000FF"), &crlf, 7, AddressWidth { found: 7 }),
        (data("00000000000000000FF"), &crlf, 7, AddressWidth { found: 16 }),
        (data("800000000"), &crlf, 16, DataBytes { found: 0 }),
        (data(&format!("800000000{}", "00".repeat(33))), &crlf, 16, DataBytes { found: 33 }),
        (format!("%{}\r\n", record('3', "5.data1111F")), &crlf, 4, Symbols),
    ];
    for (text, rest, column, kind) in rows {
        let file = format!("{text}{rest}");
        let error = TekError { record: 1, line: 1, column, kind };
        assert_eq!(read(file.as_bytes(), Dialect::Ti), Err(error), "{text}");
        assert!(kind.is_dialect(), "{kind}");
        assert_eq!(read(file.as_bytes(), Dialect::Gnu).map(|_| ()), Ok(()), "{text}");
    }
    assert_eq!(read(crlf.as_bytes(), Dialect::Ti).map(|_| ()), Ok(()));
}

/// The other defects, in both dialects. Defects inside a record are in the decoder's tests.
#[test]
fn bad_line_is_reported_with_its_position() {
    use TekErrorKind::*;
    let rows = [
        ("", 1, 1, NoEnd),
        ("\r\n", 2, 1, NoEnd),
        ("\u{FEFF}%", 1, 2, Line { found: 0, expected: 5 }),
        ("x", 1, 1, Start { found: b'x' }),
        ("\n\r\r\n :", 4, 1, Start { found: b' ' }),
        (" %0781010\r\n", 1, 1, Start { found: b' ' }),
        ("%", 1, 2, Line { found: 0, expected: 5 }),
        ("%0\r\n", 1, 3, Line { found: 1, expected: 5 }),
        ("%07\r\n", 1, 4, Line { found: 2, expected: 7 }),
        ("%0781\0", 1, 6, Character { found: 0 }),
        ("%0781 010\r\n", 1, 6, Character { found: b' ' }),
        ("%0781\r010", 1, 6, Line { found: 4, expected: 7 }),
        ("%0781010 0\r\n", 1, 9, Character { found: b' ' }),
        ("%07810101\r\n", 1, 9, Line { found: 8, expected: 7 }),
        ("%0X81010\r\n", 1, 3, Digit { found: b'X' }),
        ("%0381010\r\n", 1, 2, Short { found: 3, expected: 5 }),
        ("%0781*10\r\n", 1, 6, Character { found: b'*' }),
        ("%1A626810000000202020202020\r\n", 2, 1, NoEnd),
        ("%0E81E800000000\r\n%0E81E80000000", 2, 1, AfterEnd { found: b'%' }),
        ("%0E81E800000000\r\n%0E81F800000001\r\n", 2, 6, AfterEnd { found: b'F' }),
        ("%0E81E800000000\r\nx", 2, 1, AfterEnd { found: b'x' }),
        ("%0E81E800000000\r\n\x1A%0E81E800000000", 2, 1, AfterEnd { found: b'%' }),
        ("\x1A%0E81E800000000", 1, 1, AfterEnd { found: b'%' }),
    ];
    for (text, line, column, kind) in rows {
        for dialect in [Dialect::Ti, Dialect::Gnu] {
            let error = read(text.as_bytes(), dialect).unwrap_err();
            assert_eq!((error.line, error.column, error.kind), (line, column, kind), "{text:?}");
            assert!(!kind.is_dialect(), "{kind}");
        }
    }
    for (dialect, expected) in [(Dialect::Ti, 98), (Dialect::Gnu, 256)] {
        let error = read(&[b'%'; 300], dialect).unwrap_err();
        assert_eq!((error.column, error.kind), (u32::from(expected) + 1, Long { expected }));
    }
}

#[test]
fn files_of_other_formats_are_named() {
    let utf_16: Vec<u8> = "%0781010\r\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let big: Vec<u8> = "%0781010\r\n".encode_utf16().flat_map(u16::to_be_bytes).collect();
    let rows: [(&[u8], Foreign); 11] = [
        (b":020000040800F2\r\n", Foreign::IntelHex),
        (b"S00F000068656C6C6F\r\n", Foreign::SRecord),
        (b"S214", Foreign::SRecord),
        (&utf_16, Foreign::Utf16),
        (&[b"\xFF\xFE", &*utf_16].concat(), Foreign::Utf16),
        (&big, Foreign::Utf16),
        (&[b"\xFE\xFF", &*big].concat(), Foreign::Utf16),
        (b"\x7fELF", Foreign::Binary),
        (b"\0\x50\0\x20", Foreign::Binary),
        (b"\xFF\xFF\xFF\xFF", Foreign::Binary),
        (b"\x1f\x8b", Foreign::Binary),
    ];
    for (file, found) in rows {
        for dialect in [Dialect::Ti, Dialect::Gnu] {
            let error = TekError { record: 1, line: 1, column: 1, kind: TekErrorKind::Foreign { found } };
            assert_eq!(read(file, dialect), Err(error), "{file:?}");
        }
    }
    for (text, found) in [("Some words", b'S'), ("S", b'S'), (":-)", b':'), ("<html>", b'<')] {
        let error = TekError { record: 1, line: 1, column: 1, kind: TekErrorKind::Start { found } };
        assert_eq!(read(text.as_bytes(), Dialect::Ti), Err(error), "{text:?}");
    }
}

#[test]
fn error_persists() {
    let mut reader = Reader::new(Dialect::Gnu);
    let error = reader.push(b'x').unwrap_err();
    assert_eq!(reader.push(b'%'), Err(error));
    assert_eq!(reader.finish(), Err(error));
}

#[test]
fn error_text_has_position_and_defect() {
    let error = read(b"%0781010\n!\n", Dialect::Gnu).unwrap_err();
    let words = "found '!' after the termination record, expected the end of the file";
    assert_eq!(format!("{error}"), format!("record 2, line 2, column 1: {words}"));
}
