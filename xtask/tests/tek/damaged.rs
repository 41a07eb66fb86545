//! Damaged files: exit code 1, and a message with line, column, found, expected and next step.

use super::{Scratch, application, record, tek};

struct Row {
    name: &'static str,
    file: Vec<u8>,
    /// Line and column; (0, 0) for the image as a whole.
    place: (u32, u32),
    words: String,
}

fn row(name: &'static str, file: impl Into<Vec<u8>>, place: (u32, u32), words: impl Into<String>) -> Row {
    Row { name, file: file.into(), place, words: words.into() }
}

/// Lines of a valid file of 100 bytes: three full records, one of 4 bytes, the termination.
fn good() -> [String; 5] {
    let bytes: Vec<u8> = (0..100).collect();
    let piece = |(i, piece): (usize, &[u8])| {
        let hex: String = piece.iter().map(|byte| format!("{byte:02X}")).collect();
        data(0x0800_4000 + 32 * i as u32, &hex)
    };
    let mut lines: Vec<String> = bytes.chunks(32).enumerate().map(piece).collect();
    lines.push(line('8', "808004000"));
    lines.try_into().expect("five lines")
}

fn line(kind: char, rest: &str) -> String {
    format!("%{}\r\n", record(kind, rest))
}

fn data(address: u32, hex: &str) -> String {
    line('6', &format!("8{address:08X}{hex}"))
}

/// The valid file with one line changed.
fn with(number: usize, change: impl Fn(&str) -> String) -> String {
    let mut lines = good();
    lines[number - 1] = change(&lines[number - 1]);
    lines.concat()
}

/// The valid file with a character of a line replaced.
fn put(number: usize, column: usize, character: &str) -> String {
    with(number, |line| {
        assert_ne!(&line[column - 1..column], character, "the replacement changes nothing");
        format!("{}{character}{}", &line[..column - 1], &line[column..])
    })
}

/// The valid file with text inserted before a column of a line.
fn insert(number: usize, column: usize, text: &str) -> String {
    with(number, |line| format!("{}{text}{}", &line[..column - 1], &line[column - 1..]))
}

const HEX: &str = "expected a hexadecimal digit, 0-9 or A-F";
const START: &str = "expected % at the start of a line";
const NO_END: &str = "found the end of the file, expected a termination record (type 8)";
const AFTER: &str = "after the termination record, expected the end of the file";
const ALPHABET: &str = "expected a character of a record: 0-9 A-Z a-z $ % . _";

/// Typical accidents of files.
fn transported() -> Vec<Row> {
    let [a, b, c, d, end] = good();
    let all = good().concat();
    let utf_16: Vec<u8> = all.encode_utf16().flat_map(u16::to_le_bytes).collect();
    vec![
        row("empty", "", (1, 1), NO_END),
        row("cut in a record", &all[..200], (3, 39), "found 37 characters after %, expected 78"),
        row("cut in a record's head", &all[..83], (2, 3), "found 1 characters after %, expected 5"),
        row("cut between records", [a.as_str(), &b].concat(), (3, 1), NO_END),
        row("UTF-16", utf_16, (1, 1), "found text in UTF-16, expected Extended Tektronix hex"),
        row("lower case", all.to_lowercase(), (1, 3), format!("found 'e', {HEX}")),
        row("space at the start", format!(" {all}"), (1, 1), format!("found a space, {START}")),
        row("text after the end", format!("{all}ok\r\n"), (6, 1), format!("found 'o' {AFTER}")),
        row("text after control-Z", format!("{all}\x1A%"), (6, 1), format!("found '%' {AFTER}")),
        row(
            "control-Z in the middle",
            [&*a, &b, "\x1A", &c, &d, &end].concat(),
            (3, 1),
            format!("found '%' {AFTER}"),
        ),
        row("NUL bytes only", vec![0; 4096], (1, 1), "found a binary file, expected Extended Tektronix hex"),
        row("ELF", b"\x7fELF\x01\x01\x01", (1, 1), "found a binary file, expected Extended Tektronix hex"),
        row(
            "Intel hex",
            ":020000040800F2\r\n",
            (1, 1),
            "found a file of Intel hex, expected Extended Tektronix hex",
        ),
        row(
            "S-records",
            "S00600004844521B\n",
            (1, 1),
            "found a file of Motorola S-records, expected Extended",
        ),
        row("a page of an error", "<html>404</html>", (1, 1), format!("found '<', {START}")),
        row("a record lost its %", all.replacen("\n%", "\n", 1), (2, 1), format!("found '4', {START}")),
        row("two %", insert(4, 1, "%"), (4, 2), format!("found '%', {HEX}")),
    ]
}

/// Ten million bytes that are no records.
fn noise() -> Vec<Row> {
    const LEN: usize = 10_000_000;
    let mut state = 1_u32;
    let any: Vec<u8> = (0..LEN)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        })
        .collect();
    assert_ne!(any[0], b'%');
    let all = good().concat();
    let [_, _, _, _, end] = good();
    let after = [all.as_bytes(), &any].concat();
    vec![
        row("10 MB of noise", any.clone(), (1, 1), START),
        row("10 MB of noise after a file", after, (6, 1), AFTER),
        row(
            "10 MB of one line",
            vec![b'%'; LEN],
            (1, 99),
            "found a longer line, expected at most 98 characters",
        ),
        row(
            "10 MB of terminations",
            end.repeat(LEN / 17),
            (1, 4),
            "found a termination record before any data",
        ),
        row(
            "a record 1000 times",
            good()[0].repeat(1000),
            (2, 8),
            "found address 0x08004000, expected 0x08004020 or above",
        ),
    ]
}

fn heads() -> Vec<Row> {
    let checksum = |n| with(n, |line| format!("{}00{}", &line[..4], &line[6..]));
    vec![
        row("checksum", checksum(3), (3, 5), "expected 00, as the record says"),
        row("a data digit", put(2, 40, "F"), (2, 5), "found characters of checksum"),
        row("an address digit", put(2, 15, "1"), (2, 5), "found characters of checksum"),
        row("the type", put(2, 4, "8"), (2, 7), "found a termination record of length 4E, expected 0E"),
        row("the termination's checksum", put(5, 6, "9"), (5, 5), "expected 29, as the record says"),
        row("length too long", put(2, 2, "5"), (2, 80), "found 78 characters after %, expected 94"),
        row("length too short", put(2, 3, "C"), (2, 78), "found 78 characters after %, expected 76"),
        row("length 4", with(2, |_| "%0461\r\n".into()), (2, 2), "found length 04, expected at least 05"),
        row(
            "length of no address",
            with(2, |_| line('6', "8")),
            (2, 2),
            "found length 06, expected at least 07",
        ),
        row("length no number", put(2, 3, "G"), (2, 3), format!("found 'G', {HEX}")),
        row(
            "unknown type",
            with(2, |_| line('5', "808004020")),
            (2, 4),
            "found record type '5', expected 6 (data)",
        ),
        row(
            "symbols",
            with(2, |_| line('3', "5.data1111F")),
            (2, 4),
            "found a symbol record (type 3), expected",
        ),
    ]
}

fn digits() -> Vec<Row> {
    vec![
        row(
            "zero address digits",
            with(2, |line| redone(line, 7, "0")),
            (2, 7),
            "found 16 address digits, expected 8",
        ),
        row(
            "7 address digits",
            with(2, |_| line('6', "7800402000")),
            (2, 7),
            "found 7 address digits, expected 8",
        ),
        row(
            "too few address digits",
            with(2, |_| line('6', "8080040")),
            (2, 7),
            "found 8 address digits, expected at most 6",
        ),
        row(
            "odd number of digits",
            with(2, |_| line('6', "8080040000")),
            (2, 7),
            "found 1 data digits, expected two a byte",
        ),
        row(
            "no data",
            with(2, |_| line('6', "808004020")),
            (2, 16),
            "found 0 data bytes in a record, expected 1 to 32",
        ),
        row(
            "33 bytes",
            with(2, |_| data(0x0800_4020, &"AA".repeat(33))),
            (2, 16),
            "found 33 data bytes in a record",
        ),
        row(
            "line of 99 characters",
            with(2, |_| data(0x0800_4020, &"A".repeat(84))),
            (2, 99),
            "found a longer line",
        ),
        row(
            "termination with data",
            with(5, |_| line('8', "80800400000")),
            (5, 7),
            "found a termination record of length 10, expected 0E",
        ),
        row("lower case digit", with(2, |line| redone(line, 26, "a")), (2, 26), format!("found 'a', {HEX}")),
        row("character below '0'", put(2, 30, "/"), (2, 30), format!("found '/', {ALPHABET}")),
        row("space for a digit", put(2, 30, " "), (2, 30), format!("found a space, {ALPHABET}")),
        row("NUL for a digit", put(2, 30, "\0"), (2, 30), format!("found byte 0x00, {ALPHABET}")),
        row("character above ASCII", put(2, 30, "é"), (2, 30), format!("found byte 0xc3, {ALPHABET}")),
        row("a digit too many", insert(2, 30, "0"), (2, 80), "found 79 characters after %, expected 78"),
        row("LF in a record", insert(2, 30, "\n"), (2, 30), "found 28 characters after %, expected 78"),
        row("CR in a record", insert(2, 30, "\r"), (2, 30), "found 28 characters after %, expected 78"),
    ]
}

/// A line with a character replaced and its checksum corrected, if the character has a value.
fn redone(line: &str, column: usize, character: &str) -> String {
    let kind = char::from(line.as_bytes()[3]);
    let rest = format!("{}{character}{}", &line[..column - 1], &line[column..].trim_end());
    self::line(kind, &rest[6..])
}

/// Errors between records.
fn order() -> Vec<Row> {
    let [a, b, c, d, end] = good();
    let next = |at: u32| format!("expected {at:#010x} or above: the record overlaps");
    let outside = "expected 0x08004000 to 0x08010fff";
    vec![
        row("a record twice", [&*a, &b, &b, &c, &d, &end].concat(), (3, 8), next(0x0800_4040)),
        row("records in the wrong order", [&*b, &a, &c, &d, &end].concat(), (2, 8), next(0x0800_4040)),
        row("an overlap of one byte", with(4, |_| data(0x0800_405F, "FF")), (4, 8), next(0x0800_4060)),
        row("below the application", with(1, |_| data(0x0800_3FFF, "0102")), (1, 8), outside),
        row("beyond the application", with(4, |_| data(0x0801_0FFF, "0102")), (4, 8), outside),
        row("the monitor's address", with(1, |_| data(0x0800_0000, "01")), (1, 8), outside),
        row("address 0", with(1, |_| data(0, "01")), (1, 8), "found addresses 0x00000000 to 0x00000000"),
        row("the last address", with(4, |_| data(0xFFFF_FFFF, "01")), (4, 8), outside),
        row("no termination", [&*a, &b, &c, &d].concat(), (5, 1), NO_END),
        row(
            "another termination",
            [&*a, &b, &c, &d, &end, &line('8', "808004001")].concat(),
            (6, 6),
            format!("found 'B' {AFTER}"),
        ),
        row(
            "data between two terminations",
            [&*a, &b, &c, &end, &d, &end].concat(),
            (5, 2),
            format!("found '1' {AFTER}"),
        ),
        row(
            "half a termination twice",
            format!("{}%0E8", good().concat()),
            (6, 1),
            format!("found '%' {AFTER}"),
        ),
        row(
            "data after the termination",
            [&*a, &b, &end, &c, &d].concat(),
            (4, 2),
            format!("found '4' {AFTER}"),
        ),
        row("a termination only", end, (1, 4), "found a termination record before any data"),
    ]
}

/// Valid records of an invalid image.
fn images() -> Vec<Row> {
    let scratch = Scratch::new("damaged-images");
    scratch.encoded("sealed.tek", &application(100), &["--seal", "600"]);
    let decoded = tek(&["decode", &scratch.path("sealed.tek"), "-o", &scratch.path("sealed.bin")]);
    assert_eq!(decoded.code, Some(0));
    let sealed = scratch.get("sealed.bin");
    let changed = |at: usize| {
        let mut image = sealed.clone();
        image[at] ^= 1;
        scratch.encoded("changed.tek", &image, &[])
    };
    let crc = "the image's CRC-32 is 0x";
    vec![
        row("another byte in a sealed image", changed(99), (0, 0), crc),
        row("another version in a sealed image", changed(0x28), (0, 0), crc),
        row(
            "a sealed image cut short",
            scratch.encoded("a.tek", &sealed[..96], &[]),
            (0, 0),
            "the image has 96 bytes",
        ),
        row("a header of another length", changed(0x20), (0, 0), "the image has 101 bytes"),
        row(
            "a header with no stack",
            changed(3),
            (0, 0),
            "the first word, the initial stack pointer, is 0x21005000",
        ),
        row("a header with an even reset", changed(4), (0, 0), "the reset vector is 0x08004030"),
    ]
}

/// The message of a row if it is not the expected one.
fn check(scratch: &Scratch, row: &Row) -> Result<(), String> {
    let path = scratch.put("damaged.tek", &row.file);
    let said = tek(&["verify", &path]);
    let Row { name, place: (line, column), words, .. } = row;
    let start = match line {
        0 => format!("error: {path}: {words}"),
        line => format!("error: {path}:{line}:{column}: record {line}: "),
    };
    let named = said.err.starts_with(&start) && said.err.contains(words.as_str());
    // The next step.
    let brief = said.out.is_empty() && said.err.lines().count() == 2;
    match said.code {
        Some(1) if named && brief => Ok(()),
        code => Err(format!("{name}: {code:?} {}{}expected {line}:{column}, {words}", said.out, said.err)),
    }
}

#[test]
fn each_kind_of_damage_is_located() {
    let scratch = Scratch::new("damaged");
    let whole = scratch.put("good.tek", good().concat().as_bytes());
    assert_eq!(tek(&["verify", &whole]).code, Some(0), "else no row means anything");
    let rows: Vec<Row> =
        [transported(), noise(), heads(), digits(), order(), images()].into_iter().flatten().collect();
    let wrong: Vec<String> = rows.iter().filter_map(|row| check(&scratch, row).err()).collect();
    assert!(wrong.is_empty(), "{} of {} rows\n{}", wrong.len(), rows.len(), wrong.join("\n"));
    println!("{} kinds of damage", rows.len());
}
