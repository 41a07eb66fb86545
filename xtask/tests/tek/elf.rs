//! Linked applications.

use super::{Scratch, tek};

/// A program header: type, virtual and physical address, bytes.
type Segment<'a> = (u32, u32, u32, &'a [u8]);

const LOAD: u32 = 1;
const NOTE: u32 = 4;

/// An executable of a little-endian 32-bit ARM, by the ELF specification: header, program headers, bytes.
fn elf(entry: u32, segments: &[Segment<'_>]) -> Vec<u8> {
    let halves = |numbers: &[u16]| numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    let words = |numbers: &[u32]| numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    // 32 bits, little-endian, version 1; then type 2 (executable), machine 40 (ARM).
    let mut file = b"\x7fELF\x01\x01\x01".to_vec();
    file.resize(16, 0);
    file.extend(halves(&[2, 40]));
    file.extend(words(&[1, entry, 52, 0, 0]));
    file.extend(halves(&[52, 32, segments.len() as u16, 40, 0, 0]));
    let mut at = 52 + 32 * segments.len() as u32;
    for &(kind, virtual_address, physical, bytes) in segments {
        let len = bytes.len() as u32;
        // More memory than file: zeros that the application clears itself.
        file.extend(words(&[kind, at, virtual_address, physical, len, len + 8, 4, 4]));
        at += len;
    }
    for (_, _, _, bytes) in segments {
        file.extend_from_slice(bytes);
    }
    file
}

#[test]
fn bytes_are_placed_at_physical_addresses() {
    let scratch = Scratch::new("elf");
    // Text, initial data copied to RAM at the start, zeros in RAM, and a note that is not loaded.
    let file = elf(
        0x0800_4101,
        &[
            (LOAD, 0x0800_4000, 0x0800_4000, &[1, 2, 3]),
            (LOAD, 0x2000_0000, 0x0800_4008, &[4, 5]),
            (LOAD, 0x2000_0100, 0x2000_0100, &[]),
            (NOTE, 0, 0, &[6; 20]),
        ],
    );
    let (input, output) = (scratch.put("a.elf", &file), scratch.path("a.tek"));
    for arguments in [&[][..], &["--base", "0x08004000"], &["--base", "134234112"]] {
        let said = tek(&[&["encode", &input, "-o", &output], arguments].concat());
        assert_eq!(said.code, Some(0), "{}", said.err);
        let said = tek(&["decode", &output, "-o", &scratch.path("a.bin")]);
        assert_eq!(scratch.get("a.bin"), [1, 2, 3, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 4, 5]);
        assert!(said.err.contains("base 0x08004000, entry 0x08004101"), "{}", said.err);
    }
    // The gap is not written.
    assert!(tek(&["verify", &output]).out.contains("3 records, 5 bytes in 0x08004000 to 0x08004009"));
}

#[test]
fn other_elf_files_are_rejected() {
    let scratch = Scratch::new("noelf");
    let good = elf(0, &[(LOAD, 0, 0x0800_4000, &[1; 8])]);
    let wide = [&good[..4], &[2], &good[5..]].concat();
    let twice = elf(0, &[(LOAD, 0, 0x0800_4000, &[1; 8]), (LOAD, 0, 0x0800_4004, &[1; 8])]);
    let rows: [(&[u8], &[&str], &str); 7] = [
        (
            &good,
            &["--base", "0x08000000"],
            "found a first physical address of 0x08004000, expected 0x08000000",
        ),
        (&good[..good.len() - 1], &[], "found a segment for 0x08004000 whose bytes are beyond the end"),
        (&good[..60], &[], "found a damaged file, expected a 32-bit ELF file"),
        (&good[..20], &[], "found a damaged file, expected a 32-bit ELF file"),
        (&wide, &[], "found a damaged file, expected a 32-bit ELF file"),
        (&twice, &[], "found two segments with bytes for 0x08004004, expected one"),
        (&elf(0, &[(NOTE, 0, 0, &[1])]), &[], "found no segment to load"),
    ];
    for (bytes, arguments, words) in rows {
        let (input, output) = (scratch.put("a.elf", bytes), scratch.path("a.tek"));
        let said = tek(&[&["encode", &input, "-o", &output], arguments].concat());
        assert_eq!(said.code, Some(1), "{words}: {}", said.err);
        assert!(said.err.starts_with(&format!("error: {input}: {words}")), "{}", said.err);
    }
    assert_eq!(scratch.names(), ["a.elf"], "nothing was written");
}
