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
    for content in [SRECORD.to_owned(), SRECORD.replace('\n', "\r\n")] {
        let said = tek(&["verify", &scratch.put("b.tek", content.as_bytes())]);
        let missing = "expected a termination record (type 8)";
        assert!(said.code == Some(1) && said.err.contains(missing), "{}", said.err);
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
        // Only Barrett's own tools download it; ours say what it is.
        let said = tek(&["verify", &file]);
        let hint = format!("`cargo xtask tek decode --bytes-per-address {unit}` reads it");
        assert!(said.code == Some(1) && said.err.contains(&hint), "{}", said.err);
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
    assert!(
        said.code == Some(1) && said.err.ends_with("copy the file again from where it came from\n"),
        "{}",
        said.err
    );
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

/// What editors, mail and transfers do to lines: verify, decode and dump take all of it, and the bytes are the same.
#[test]
fn line_ends_blanks_and_a_repeated_end_are_accepted() {
    let scratch = Scratch::new("line-ends");
    let text = String::from_utf8(scratch.encoded("whole.tek", &application(100), &["--seal", "600"]));
    let text = text.expect("ASCII");
    let end = text.lines().last().expect("a termination").to_owned();
    let whole = tek(&["verify", &scratch.path("whole.tek")]);
    let summary = |out: &str| out.split_once(": ").map(|(_, rest)| rest.to_owned());
    assert_eq!(tek(&["decode", &scratch.path("whole.tek"), "-o", &scratch.path("whole.bin")]).code, Some(0));
    for (name, file) in [
        ("LF", text.replace('\r', "")),
        ("CR", text.replace('\n', "")),
        ("CR CR LF", text.replace('\r', "\r\r")),
        ("LF CR", text.replace("\r\n", "\n\r")),
        ("mixed", text.replacen("\r\n", "\n", 1).replacen("\r\n", "\r", 1)),
        ("blanks", text.replace('\r', "  \r")),
        ("tabs", text.replace("\r\n", "\t\n")),
        ("empty lines", format!("\r\n{}\r\n\r\n", text.replacen("\r\n", "\r\n\n", 1))),
        ("lines of blanks", format!("{} \t\r\n", text.replacen("\r\n", "\r\n  \r\n", 1))),
        ("no last end", text.trim_end().to_owned()),
        ("no last end, blanks", format!("{}  ", text.trim_end())),
        ("control-Z", format!("{text}\x1A")),
        ("control-Z in the last line", format!("{}\x1A", text.trim_end())),
        ("padded with control-Z", format!("{text}{}", "\x1A".repeat(127))),
        ("padded with NUL", format!("{text}{}", "\0".repeat(127))),
        ("two terminations", format!("{text}{end}\r\n")),
        ("three terminations, LF, no last end", format!("{text}{end}\n{end}")),
        ("byte order mark", format!("\u{FEFF}{text}")),
    ] {
        let file = scratch.put("a.tek", file.as_bytes());
        let said = tek(&["verify", &file]);
        assert_eq!((said.code, summary(&said.out)), (Some(0), summary(&whole.out)), "{name}: {}", said.err);
        let said = tek(&["decode", &file, "-o", &scratch.path("a.bin")]);
        assert_eq!(said.code, Some(0), "{name}: {}", said.err);
        assert!(!said.err.contains("warning"), "{name}: {}", said.err);
        assert!(scratch.get("a.bin") == scratch.get("whole.bin"), "{name}");
        assert_eq!(tek(&["dump", &file]).code, Some(0), "{name}");
    }
}

/// No advice and no default makes a whole file of one that has lost records.
#[test]
fn lost_record_is_never_sealed_again_unnoticed() {
    let scratch = Scratch::new("lost");
    let text = String::from_utf8(scratch.encoded("whole.tek", &application(256), &["--seal", "600"]));
    let text = text.expect("ASCII");
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    let last = lines.len() - 2;
    for lost in 0..=last {
        let rest: String = (0..).zip(&lines).filter(|(at, _)| *at != lost).map(|(_, line)| *line).collect();
        let file = scratch.put("lost.tek", rest.as_bytes());
        let said = tek(&["verify", &file]);
        // Without its first record the file has no seal, and says so.
        let copy = if lost == 0 { "compare it with the original" } else { "copy the file again" };
        assert!((said.err + &said.out).contains(copy), "record {lost}");
        let out = scratch.path("lost.bin");
        let said = tek(&["decode", &file, "-o", &out]);
        assert!(said.code == Some(0) && said.err.contains("warning: "), "record {lost}: {}", said.err);
        let gap = format!("no record brings {:#010x}", 0x0800_4000 + 32 * lost);
        assert_eq!(said.err.contains(&gap), (1..last).contains(&lost), "record {lost}: {}", said.err);
        let again = scratch.path("again.tek");
        let seal = ["encode", &out, "--base", BASE, "-o", &again, "--seal", "601"];
        let said = tek(&seal);
        assert_eq!(said.code, Some(1), "record {lost}: {}", said.err);
        let refused = lost == 0 || said.err.contains("does not fit") && said.err.contains("--replace-seal");
        assert!(refused, "record {lost}: {}", said.err);
        assert!(!scratch.names().contains(&"again.tek".to_owned()), "record {lost}");
        if lost > 1 {
            let said = tek(&[&seal[..], &["--replace-seal"]].concat());
            assert_eq!(said.code, Some(0), "record {lost}: {}", said.err);
            std::fs::remove_file(&again).expect("it was written");
        }
        let said = tek(&["encode", &out, "--base", BASE, "-o", &again]);
        assert_eq!(said.err.contains("warning: "), lost > 0, "record {lost}: {}", said.err);
        std::fs::remove_file(&again).expect("it was written");
    }
    // A whole image takes another version.
    assert_eq!(tek(&["decode", &scratch.path("whole.tek"), "-o", &scratch.path("a.bin")]).code, Some(0));
    let said =
        tek(&["encode", &scratch.path("a.bin"), "--base", BASE, "-o", &scratch.path("a.tek"), "--seal", "7"]);
    assert_eq!(said.code, Some(0), "{}", said.err);
}

/// The commands in the errors, as they stand there, with the names put in.
#[test]
fn other_formats_are_converted_by_the_commands_of_their_errors() {
    let scratch = Scratch::new("formats");
    let image = application(256);
    let input = scratch.put("in.bin", &image);
    for (format, name) in [("ihex", "Intel hex"), ("srec", "Motorola S-records")] {
        let (file, out) = (scratch.path("a.hex"), scratch.path("a.hex.bin"));
        let make = ["-I", "binary", "-O", format, "--change-addresses", BASE, &input, &file];
        if !Command::new("objcopy").args(make).status().is_ok_and(|status| status.success()) {
            println!("skipped: no objcopy is installed");
            return;
        }
        for action in [&["verify", &file][..], &["dump", &file], &["decode", &file, "-o", &out]] {
            let said = tek(action);
            assert!(said.code == Some(1) && said.err.contains(name), "{}", said.err);
        }
        let said = tek(&["verify", &file]).err;
        let commands: Vec<&str> = said.split('`').skip(1).step_by(2).collect();
        let [objcopy, encode] = commands[..] else { panic!("two commands: {said}") };
        let named = |command: &str| {
            let words = command.split(' ').map(|word| word.replace("FILE", &file).replace("ADDRESS", BASE));
            words.collect::<Vec<String>>()
        };
        let objcopy = named(objcopy);
        assert!(Command::new(&objcopy[0]).args(&objcopy[1..]).status().is_ok_and(|status| status.success()));
        let encode = named(encode);
        assert_eq!(encode[..3], ["cargo", "xtask", "tek"]);
        let encode: Vec<&str> = encode[3..].iter().map(String::as_str).collect();
        assert_eq!(tek(&encode).code, Some(0));
        let said = tek(&["decode", &format!("{file}.tek"), "-o", &out]);
        assert!(said.code == Some(0) && scratch.get("a.hex.bin") == image, "{}", said.err);
    }
}
