//! Files of other programs: srecord, linkers for DSPs, devices without an end.

use std::process::Command;

use super::{BASE, Scratch, application, images, record, tek};

/// Output of srec_cat 1.64 for 45 bytes: LF, and no termination record.
const SRECORD: &str = "%4E6A880800400068656C6C6F20776F726C642C207468697320697320616E20696D616765206F66\n\
                       %2A6C38080040202034352062797465732E2E2E2E2E\n";

#[test]
fn file_without_termination_is_decoded_with_a_warning_and_not_verified() {
    let scratch = Scratch::new("srecord");
    let (file, out) = (scratch.put("a.tek", SRECORD.as_bytes()), scratch.path("a.bin"));
    let said = tek(&["decode", &file, "-o", &out]);
    assert_eq!(said.code, Some(0), "{}", said.err);
    assert_eq!(scratch.get("a.bin"), b"hello world, this is an image of 45 bytes.....");
    assert!(said.err.starts_with(&format!("warning: {file}: found no termination record")), "{}", said.err);
    assert!(said.err.ends_with("base 0x08004000, no entry\n"), "{}", said.err);
    let said = tek(&["dump", &file]);
    assert_eq!((said.code, said.out.lines().count()), (Some(0), 2), "{}", said.err);
    assert!(said.err.starts_with("warning: "), "{}", said.err);
    // A board would wait for the rest.
    let strict = SRECORD.replace('\n', "\r\n");
    let strict = strict.lines().next().expect("a line").to_owned() + "\r\n";
    let missing = "expected a termination record (type 8)";
    for (content, words) in [(SRECORD, "expected CR LF"), (&strict, missing)] {
        let said = tek(&["verify", &scratch.put("b.tek", content.as_bytes())]);
        assert!(said.code == Some(1) && said.err.contains(words), "{}", said.err);
    }
    // A line that is cut, and a file without a record, are damaged.
    for content in [SRECORD.trim_end(), "", "\n"] {
        let said = tek(&["decode", &scratch.put("b.tek", content.as_bytes()), "-o", &out]);
        assert!(said.code == Some(1) && said.err.starts_with("error: "), "{}", said.err);
    }
}

/// A sealed image is not enough: neither verify nor download take a file without a termination record.
#[test]
fn download_refuses_a_file_without_termination() {
    let scratch = Scratch::new("srecord-download");
    scratch.encoded("a.tek", &application(100), &["--seal", "600"]);
    let text = String::from_utf8(scratch.get("a.tek")).expect("text");
    let cut: String =
        text.lines().filter(|line| line.as_bytes()[3] == b'6').map(|line| format!("{line}\r\n")).collect();
    let file = scratch.put("cut.tek", cut.as_bytes());
    assert_eq!(tek(&["decode", &file, "-o", &scratch.path("a.bin")]).code, Some(0));
    let mut download = Command::new(env!("CARGO_BIN_EXE_xtask"));
    // The file is checked before the adapter is looked for.
    let output = download.args(["download", &file, "--node", "4", "--slcan", "127.0.0.1:1"]).output();
    let output = output.expect("xtask starts");
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("expected a termination record (type 8)"), "{error}");
}

#[test]
fn output_of_srec_cat_is_decoded() {
    if !Command::new("srec_cat").arg("-VERSion").output().is_ok_and(|output| output.status.success()) {
        println!("skipped: srecord is not installed");
        return;
    }
    let scratch = Scratch::new("from-srecord");
    for (base, bytes) in images() {
        let (input, file, out) =
            (scratch.put("in.bin", &bytes), scratch.path("a.tek"), scratch.path("out.bin"));
        let mut srecord = Command::new("srec_cat");
        srecord.args([&input, "-binary", "-offset", &base.to_string(), "-o", &file, "-Tektronix_Extended"]);
        assert!(srecord.status().expect("it is installed").success());
        let said = tek(&["decode", &file, "-o", &out]);
        assert_eq!(said.code, Some(0), "{}", said.err);
        assert!(scratch.get("out.bin") == bytes, "{} bytes from {base} on", bytes.len());
    }
}

/// A DSP's addresses are those of words of 16 or 32 bits, as in Barrett's earlier firmware for a TMS320F2810: 32 bytes take 16 or 8 of them.
#[test]
fn word_addresses_are_decoded_as_the_error_suggests() {
    let scratch = Scratch::new("words");
    let bytes: Vec<u8> = (0..100).collect();
    for unit in [2_u32, 4] {
        let piece = |(number, piece): (u32, &[u8])| {
            let hex: String = piece.iter().map(|byte| format!("{byte:02X}")).collect();
            format!("%{}\r\n", record('6', &format!("6{:06X}{hex}", 0x3D_8000 + number * 32 / unit)))
        };
        let data: String = (0..).zip(bytes.chunks(32)).map(piece).collect();
        let file = scratch.put("dsp.tek", format!("{data}%{}\r\n", record('8', "63D8000")).as_bytes());
        let decode =
            |option: &[&str]| tek(&[&["decode", &file, "-o", &scratch.path("a.bin")], option].concat());
        let (said, unit) = (decode(&[]), unit.to_string());
        let hint = format!("decode it with --bytes-per-address {unit}\n");
        assert!(said.code == Some(1) && said.err.contains(":2:8: record 2: found 0x003d80"), "{}", said.err);
        assert!(said.err.ends_with(&hint), "{}", said.err);
        let said = decode(&["--bytes-per-address", &unit]);
        assert_eq!(said.code, Some(0), "{}", said.err);
        let words = format!("base 0x003d8000, entry 0x003d8000, {unit} bytes at each address\n");
        assert!(said.err.ends_with(&words), "{}", said.err);
        assert!(scratch.get("a.bin") == bytes);
        for wrong in ["0", "3", "-2", "two"] {
            let said = decode(&[&format!("--bytes-per-address={wrong}")]);
            assert!(said.code == Some(2) && said.err.contains("expected 1 (bytes), 2 or 4"), "{}", said.err);
        }
    }
    // Records that truly overlap get no such advice.
    let twice = SRECORD.lines().next().expect("a line").to_owned() + "\n";
    let said =
        tek(&["decode", &scratch.put("a.tek", twice.repeat(2).as_bytes()), "-o", &scratch.path("a.bin")]);
    assert!(said.code == Some(1) && said.err.ends_with("encode the image again\n"), "{}", said.err);
    // Addresses whose bytes have none.
    let last = format!("%{}\n", record('6', "0FFFFFFFFFFFFFFFFAA"));
    let file = scratch.put("a.tek", last.as_bytes());
    let said = tek(&["decode", &file, "-o", &scratch.path("a.bin"), "--bytes-per-address", "2"]);
    assert!(said.code == Some(1) && said.err.contains(":1:8: "), "{}", said.err);
}

/// Without the limits each of these ends when the memory is full.
#[cfg(unix)]
#[test]
fn input_without_an_end_is_refused() {
    let scratch = Scratch::new("endless");
    let out = scratch.path("out");
    // 1 GiB, where 64 MiB are read at most.
    let limited = |script: &str| {
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("ulimit -v 1048576; {script}"), env!("CARGO_BIN_EXE_xtask"), &out]);
        let output = shell.output().expect("a shell");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let line = format!("%{}", record('3', "5.data1111F"));
    for (script, code) in [
        (format!("\"$0\" tek encode /dev/zero --base {BASE} -o \"$1\""), 2),
        (format!("head -c 20000000 /dev/zero | \"$0\" tek encode /dev/stdin --base {BASE} -o \"$1\""), 1),
        ("\"$0\" tek verify /dev/zero".to_owned(), 2),
        ("\"$0\" download /dev/zero --node 4 --slcan 127.0.0.1:1".to_owned(), 2),
        (format!("yes '{line}' | \"$0\" tek decode /dev/stdin -o \"$1\""), 2),
        (format!("yes '{line}' | \"$0\" tek dump /dev/stdin | tail -n 1"), 0),
    ] {
        let (found, error) = limited(&script);
        assert_eq!(found, Some(code), "{script}: {error}");
        assert!(
            error.contains("found more than") && !error.contains("memory allocation"),
            "{script}: {error}"
        );
        assert!(!std::path::Path::new(&out).exists(), "{script}");
    }
}
