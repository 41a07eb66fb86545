//! Exchange with GNU objcopy, where binutils is installed.

use std::process::Command;

use super::{BASE, Scratch, images, record, tek};

/// Whether GNU objcopy is installed and knows the format; prints if not.
fn installed() -> bool {
    let info = Command::new("objcopy").arg("--info").output();
    let knows = info.is_ok_and(|output| String::from_utf8_lossy(&output.stdout).contains("tekhex"));
    if !knows {
        println!("skipped: no GNU objcopy with tekhex is installed");
    }
    knows
}

/// Runs a program of binutils; returns its standard error if it failed.
fn binutils(program: &str, arguments: &[&str]) -> Result<(), String> {
    let output = Command::new(program).args(arguments).output().expect("binutils is installed");
    if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

#[test]
fn output_of_objcopy_is_decoded() {
    if !installed() {
        return;
    }
    let scratch = Scratch::new("from-gnu");
    for (base, bytes) in images() {
        let (input, file) = (scratch.put("in.bin", &bytes), scratch.path("gnu.tek"));
        for strip in [&["-S"][..], &[]] {
            let base = base.to_string();
            let arguments = ["-I", "binary", "-O", "tekhex", "--change-addresses", &base, &input, &file];
            assert_eq!(binutils("objcopy", &[&arguments, strip].concat()), Ok(()));
            let said = tek(&["decode", &file, "-o", &scratch.path("out.bin")]);
            assert_eq!(said.code, Some(0), "{}", said.err);
            assert!(scratch.get("out.bin") == bytes, "{} bytes from {base} on", bytes.len());
            assert_eq!(tek(&["dump", &file]).code, Some(0));
        }
    }
}

/// objcopy reads our data records, CR LF included, but only inside a section, which our profile has no record
/// for: the test inserts one.
#[test]
fn objcopy_reads_encoded_file_with_a_section() {
    if !installed() {
        return;
    }
    let scratch = Scratch::new("to-gnu");
    for (base, bytes) in images() {
        let (input, ours) = (scratch.put("in.bin", &bytes), scratch.path("ours.tek"));
        assert_eq!(tek(&["encode", &input, "--base", &base.to_string(), "-o", &ours]).code, Some(0));
        let back = scratch.path("back.bin");
        let read = |file: &str| binutils("objcopy", &["-I", "tekhex", "-O", "binary", file, &back]);
        let error = read(&ours).expect_err("there is no section");
        assert!(error.contains("has no sections"), "{error}");

        // Name and range; the end is exclusive.
        let end = base + bytes.len() as u32;
        let section = record('3', &format!("5.data18{base:08X}8{end:08X}"));
        let text = [format!("%{section}\r\n").as_bytes(), &scratch.get("ours.tek")].concat();
        assert_eq!(read(&scratch.put("section.tek", &text)), Ok(()));
        assert!(scratch.get("back.bin") == bytes, "{} bytes from {base:#x} on", bytes.len());
    }
}

/// Uses the program headers of a real linker.
#[test]
fn application_linked_by_gnu_ld_is_encoded() {
    // This machine's linker may not know 32-bit ELF.
    let knows = Command::new("ld").arg("-V").output();
    if !installed() {
        return;
    }
    if !knows.is_ok_and(|o| String::from_utf8_lossy(&o.stdout).contains("elf_i386")) {
        println!("skipped: no GNU ld for 32-bit ELF is installed");
        return;
    }
    let scratch = Scratch::new("linked");
    let bytes: Vec<u8> = (0..999_u32).map(|i| (i % 253) as u8).collect();
    let (input, object, linked) = (scratch.put("in.bin", &bytes), scratch.path("a.o"), scratch.path("a.elf"));
    let convert = ["-I", "binary", "-O", "elf32-i386", "-B", "i386", &input, &object];
    assert_eq!(binutils("objcopy", &convert), Ok(()));
    // -N: the segment contains no headers, as on a microcontroller.
    let place = format!("-Tdata={BASE}");
    assert_eq!(
        binutils("ld", &["-m", "elf_i386", "-N", "-e", "0x08004000", &place, "-o", &linked, &object]),
        Ok(())
    );
    let file = scratch.path("a.tek");
    let said = tek(&["encode", &linked, "--base", BASE, "-o", &file]);
    assert_eq!(said.code, Some(0), "{}", said.err);
    assert_eq!(tek(&["decode", &file, "-o", &scratch.path("out.bin")]).code, Some(0));
    assert!(scratch.get("out.bin") == bytes);
}
