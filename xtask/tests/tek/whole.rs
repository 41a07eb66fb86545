//! Valid files.

use super::{BASE, Scratch, application, images, record, tek};

#[test]
fn bytes_round_trip_through_encode_and_decode() {
    let scratch = Scratch::new("round");
    for (base, bytes) in images() {
        let (input, output) = (scratch.put("in.bin", &bytes), scratch.path("out.tek"));
        let said = tek(&["encode", &input, "--base", &base.to_string(), "-o", &output]);
        assert_eq!(said.code, Some(0), "{}", said.err);
        let said = tek(&["decode", &output, "-o", &scratch.path("out.bin")]);
        assert_eq!(said.code, Some(0), "{}", said.err);
        assert!(said.err.contains(&format!("{} bytes, base {base:#010x}", bytes.len())), "{}", said.err);
        assert!(scratch.get("out.bin") == bytes, "{} bytes from {base:#x} on", bytes.len());
    }
    assert_eq!(scratch.names(), ["in.bin", "out.bin", "out.tek"], "nothing temporary stays");
}

#[test]
fn sealed_image_is_verified() {
    let scratch = Scratch::new("sealed");
    // 101 bytes are padded to 104.
    scratch.encoded("sealed.tek", &application(101), &["--seal", "601"]);
    let file = scratch.path("sealed.tek");
    let said = tek(&["verify", &file]);
    assert_eq!(said.code, Some(0), "{}", said.err);
    let first = format!("{file}: 5 records, 104 bytes in 0x08004000 to 0x08004067, entry 0x08004000\n");
    let second = said.out.strip_prefix(&first).unwrap_or_else(|| panic!("{}", said.out));
    let crc = second
        .strip_prefix("complete and downloadable; sealed: version 601, CRC-32 0x")
        .and_then(|text| text.strip_suffix('\n'));

    assert_eq!(tek(&["decode", &file, "-o", &scratch.path("out.bin")]).code, Some(0));
    let image = scratch.get("out.bin");
    let header = tater_wire::image::Header::verify(&image, &tater_f103::map::MAP).expect("it is sealed");
    assert_eq!(crc, Some(format!("{:08x}", header.crc).as_str()));
    assert_eq!((header.len, header.version), (104, 601));
    assert_eq!(image[0x2C..101], application(101)[0x2C..]);
    assert_eq!(image[101..], [0xFF; 3]);
}

#[test]
fn unsealed_image_is_valid() {
    let scratch = Scratch::new("unsealed");
    let words = "complete and downloadable; not sealed: a monitor will reject it, `cargo xtask tek encode --seal VERSION`";
    for len in [1, 43, 44, 200] {
        scratch.encoded("a.tek", &vec![0xFF; len], &[]);
        let said = tek(&["verify", &scratch.path("a.tek")]);
        assert_eq!(said.code, Some(0), "{}", said.err);
        assert!(said.out.contains(words), "{}", said.out);
    }
    let help = tek(&["verify", "--help"]).out;
    assert!(help.contains("complete and downloadable") && help.contains("sealed"), "{help}");
    // Only the monitor's place for the header counts.
    scratch.encoded("a.tek", &application(100), &["--seal", "600"]);
    assert_eq!(tek(&["decode", &scratch.path("a.tek"), "-o", &scratch.path("a.bin")]).code, Some(0));
    let (image, elsewhere) = (scratch.path("a.bin"), scratch.path("b.tek"));
    assert_eq!(tek(&["encode", &image, "--base", "0x08004100", "-o", &elsewhere]).code, Some(0));
    assert!(tek(&["verify", &elsewhere]).out.contains("not sealed: "));
}

#[test]
fn unsealable_image_is_rejected() {
    let scratch = Scratch::new("seal");
    let mut no_stack = application(100);
    no_stack[3] = 0;
    let mut used = application(100);
    used[0x20] = 1;
    let rows: [(&[u8], &str, &str); 4] = [
        (&application(40), BASE, "the image has 40 bytes"),
        (&no_stack, BASE, "the initial stack pointer, is 0x00005000"),
        (&used, BASE, "its reserved vectors are in use"),
        (&application(100), "0x08004004", "found a first address of 0x08004004, expected 0x08004000"),
    ];
    for (bytes, base, words) in rows {
        let (input, output) = (scratch.put("in.bin", bytes), scratch.path("out.tek"));
        let said = tek(&["encode", &input, "--base", base, "-o", &output, "--seal", "1"]);
        assert_eq!(said.code, Some(1), "{words}");
        let (found, next) = said.err.split_once("\n  next: ").unwrap_or_else(|| panic!("{}", said.err));
        assert!(found.starts_with(&format!("error: {input}: ")) && found.contains(words), "{found}");
        assert!(
            next.contains("the application's address 0x08004000") && next.contains("vector table"),
            "{next}"
        );
    }
    assert_eq!(scratch.names(), ["in.bin"], "nothing was written");
}

#[test]
fn gaps_are_filled_up_to_the_limit() {
    let scratch = Scratch::new("gaps");
    let at = |address: &str, bytes: &str| format!("%{}\r\n", record('6', &(String::from(address) + bytes)));
    let end = format!("%{}\r\n", record('8', "800000000"));
    let rows = [
        (at("800000004", "01") + &at("800000000", "02"), Ok(vec![2, 0xFF, 0xFF, 0xFF, 1])),
        (
            at("FFFFFFFFFFFFFFF0", "03") + &at("FFFFFFFFFFFFFFE0", "04"),
            Ok([&[4][..], &[0xFF; 15], &[3]].concat()),
        ),
        (at("0FFFFFFFFFFFFFFFF", "05"), Ok(vec![5])),
        (at("10", "06") + &at("0FFFFFFFFFFFFFFFF", "05"), Err("expected at most 16 MiB")),
        (at("801000000", "07") + &at("10", "07"), Err("found addresses from 0x00000000 to 0x01000000")),
        (
            at("10", "0808") + &at("11", "08"),
            Err(":2:8: record 2: found 0x00000001 in two records, expected one"),
        ),
    ];
    for (text, expected) in rows {
        let file = scratch.put("a.tek", (text.clone() + &end).as_bytes());
        let said = tek(&["decode", &file, "-o", &scratch.path("a.bin")]);
        match expected {
            Ok(bytes) => assert_eq!((said.code, scratch.get("a.bin")), (Some(0), bytes), "{text}"),
            Err(words) => assert!(said.code == Some(1) && said.err.contains(words), "{text}{}", said.err),
        }
    }
}

#[test]
fn dump_prints_records_up_to_the_first_error() {
    let scratch = Scratch::new("dump");
    let good = scratch.encoded("a.tek", &[0xAB; 34], &[]);
    let said = tek(&["dump", &scratch.path("a.tek")]);
    let ab = |n: usize| " ab".repeat(n);
    let [first, second] = [("1  data        0x08004000  32", 32), ("2  data        0x08004020   2", 2)]
        .map(|(text, n)| format!("     {text} bytes:{}\n", ab(n)));
    assert_eq!(said.out, format!("{first}{second}     3  termination 0x08004000 is the entry\n"));
    assert_eq!(said.code, Some(0));

    let cut = scratch.put("cut.tek", &good[..95]);
    let said = tek(&["dump", &cut]);
    assert_eq!((said.code, said.out), (Some(1), first));
    assert!(said.err.contains("cut.tek:2:15: record 2: "), "{}", said.err);
}

#[test]
fn unreadable_or_unwritable_file_exits_2() {
    let scratch = Scratch::new("usage");
    let (missing, folder) = (scratch.path("missing.tek"), scratch.path("."));
    let bytes = scratch.put("a.bin", b"a");
    let tek_file = {
        scratch.encoded("a.tek", b"a", &[]);
        scratch.path("a.tek")
    };
    let (out, nowhere) = (scratch.path("out"), scratch.path("no/where"));
    let rows: [(&[&str], &str); 10] = [
        (&["verify", &missing], "missing.tek: cannot be read: "),
        (&["dump", &folder], ".: cannot be read: "),
        (&["decode", &missing, "-o", &out], "missing.tek: cannot be read: "),
        (&["encode", &missing, "--base", "0", "-o", &out], "missing.tek: cannot be read: "),
        (&["encode", &bytes, "-o", &out], "a.bin: is no ELF file, so its address must be given: --base 0x"),
        (&["encode", &bytes, "--base", "0xG", "-o", &out], "expected an address up to 0xFFFFFFFF"),
        (&["encode", &bytes, "--base", "0", "-o", &out, "--seal", "65536"], "65536"),
        (&["encode", &bytes, "--base", "0", "-o", &nowhere], "no/where: cannot be written: "),
        (&["decode", &tek_file, "-o", &nowhere], "no/where: cannot be written: "),
        (&["encode", &bytes, "--base", "0"], "--output"),
    ];
    for (arguments, words) in rows {
        let said = tek(arguments);
        assert_eq!(said.code, Some(2), "{arguments:?}: {}", said.err);
        assert!(said.err.contains(words), "{arguments:?}: {}", said.err);
        let file = words.contains(": cannot be ");
        assert!(!file || said.err.contains("\n  next: check "), "{arguments:?}: {}", said.err);
    }
    let said = tek(&["encode", &bytes, "--base", "0xFFFFFFFF", "-o", &out]);
    assert_eq!(said.code, Some(0), "the last address has room for one byte: {}", said.err);
    let two = scratch.put("two.bin", b"ab");
    let said = tek(&["encode", &two, "--base", "0xFFFFFFFF", "-o", &out]);
    assert_eq!(said.code, Some(1));
    assert!(said.err.contains("found 2 bytes from 0xffffffff on, expected no address above"), "{}", said.err);
    let empty = scratch.put("empty.bin", b"");
    let said = tek(&["encode", &empty, "--base", "0", "-o", &out]);
    assert!(said.code == Some(1) && said.err.contains("empty.bin: found no bytes"), "{}", said.err);
}

/// GNU's files: unrecorded bytes of a section are 0, and bytes around sections are padding.
#[test]
fn sections_delimit_the_image() {
    let scratch = Scratch::new("sections");
    let section = |from: u32, to: u32| format!("%{}\n", record('3', &format!("1a12{from:02X}2{to:02X}")));
    let padded = format!("%{}\n", record('6', "21000000001020300000004"));
    let end = "%0781010\n";
    let rows = [
        (section(0x13, 0x1B) + &padded, Ok(vec![1, 2, 3, 0, 0, 0, 4, 0])),
        (
            padded.clone() + &section(0x13, 0x16) + &section(0x18, 0x1B),
            Ok(vec![1, 2, 3, 0xFF, 0xFF, 0, 4, 0]),
        ),
        (
            section(0x13, 0x16) + &section(0x80, 0x80) + &padded,
            Err("found 0x04 for 0x00000019, which is in no section"),
        ),
    ];
    for (text, expected) in rows {
        let file = scratch.put("a.tek", (text.clone() + end).as_bytes());
        let said = tek(&["decode", &file, "-o", &scratch.path("a.bin")]);
        match expected {
            Ok(bytes) => {
                assert_eq!((said.code, scratch.get("a.bin")), (Some(0), bytes), "{text}{}", said.err)
            }
            Err(words) => assert!(said.code == Some(1) && said.err.contains(words), "{text}{}", said.err),
        }
    }
}

/// A file is replaced, not overwritten: a reader of the old one, here by another link, keeps its contents. A
/// symbolic link stays.
#[cfg(unix)]
#[test]
fn files_are_replaced_completely() {
    let scratch = Scratch::new("replace");
    let old = scratch.encoded("a.tek", &[1], &[]);
    std::fs::hard_link(scratch.path("a.tek"), scratch.path("other.tek")).expect("same folder");
    std::os::unix::fs::symlink("a.tek", scratch.path("link.tek")).expect("same folder");
    let new = scratch.encoded("link.tek", &[2], &[]);
    assert_ne!(old, new);
    assert!(scratch.get("other.tek") == old && scratch.get("a.tek") == new);
    assert!(std::path::Path::new(&scratch.path("link.tek")).is_symlink());
    assert_eq!(scratch.names(), ["a.tek", "in.bin", "link.tek", "other.tek"]);
}
